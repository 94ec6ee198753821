"""Fitted estimators as bytes, without pickle: skops, and a closed list of types that may come back.

In:  a fitted scikit-learn estimator, or bytes from a bundle (checked against its manifest before they come here).
Out: the other one. A file that holds a type outside the list is refused with its name; nothing of it is run.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from importlib.metadata import version
from typing import Any

from pido.core.errors import RegistryError

TRUSTED = ("sklearn.tree._tree.Tree", "sklearn.ensemble._hist_gradient_boosting.predictor.TreePredictor")


def dump(estimator: Any) -> bytes:
    """A fitted estimator as a skops file. Raises RegistryError naming types that could not be read back."""
    import skops.io

    data = skops.io.dumps(estimator, compression=zipfile.ZIP_DEFLATED)
    trusted_types(data)
    return data


def load(data: bytes) -> Any:
    """The estimator in a skops file. Raises RegistryError for a damaged file or a type that is not on the list."""
    import skops.io

    return skops.io.loads(data, trusted=trusted_types(data))


def trusted_types(data: bytes) -> list[str]:
    """The types in a skops file beyond skops' own list, all of which are on ours."""
    import skops.io

    try:
        found = skops.io.get_untrusted_types(data=data)
    except Exception as error:
        raise RegistryError(f"this model file cannot be read ({error}); it is not loaded.") from error
    strange = [name for name in found if name not in TRUSTED]
    if strange:
        raise RegistryError(f"this model file holds {', '.join(strange)}, which pido never writes; it is not loaded.")
    return found


@contextmanager
def compressed() -> Iterator[None]:
    """What MLflow writes as skops files in the block is compressed, as `dump` does it: a third of the size, and each
    model is in MLflow once more. MLflow itself has no setting for it."""
    import skops.io

    plain = skops.io.dump
    skops.io.dump = partial(plain, compression=zipfile.ZIP_DEFLATED)
    try:
        yield
    finally:
        skops.io.dump = plain


def requirements() -> list[str]:
    """What a model file needs to be opened elsewhere."""
    return [f"{name}=={version(name)}" for name in ("scikit-learn", "skops", "numpy")]
