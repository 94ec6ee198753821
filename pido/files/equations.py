"""Fitted local equations on disk, bit for bit: arrays in an .npz file, names in its header, no pickle.

In:  `LocalEquations` and a path. Out: the file, and back. The machine and accepted physics (extra terms) are not in the
file: they are given when it is read, and must be those that it was fitted with.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from pido.core.errors import FitError
from pido.core.machining import Machine
from pido.equations.fit import GlobalEquation, LocalEquations
from pido.equations.terms import ExtraTerm, TermSet, term_set
from pido.equations.weights import Kernel
from pido.feature_space.grid import Grid
from pido.workspace import write_atomically

_LOCAL = ("bins", "coefficients", "effective", "global_share", "noise", "rank", "locality")
_OVERALL = ("coefficients", "factor", "effective", "noise", "rank")


def dump(equations: LocalEquations) -> bytes:
    """All of it as the bytes of an .npz file. The same equations give the same bytes."""
    header = {
        "terms": equations.terms.id,
        "names": list(equations.terms.names),
        "grid": list(equations.grid.width),
        "kernels": [asdict(k) for k in equations.kernels],
        "blend": equations.blend,
        "dropped": list(equations.overall.dropped),
        "machine": equations.machine.id,
    }
    arrays = {name: getattr(equations, name) for name in _LOCAL}
    arrays |= {f"overall_{name}": getattr(equations.overall, name) for name in _OVERALL}
    arrays |= {f"factor_{i}": values for i, values in enumerate(equations._factor)}
    arrays["header"] = np.frombuffer(json.dumps(header, sort_keys=True).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def save(equations: LocalEquations, path: Path) -> Path:
    """Write; a reader sees a whole file or none."""
    write_atomically(path, dump(equations))
    return path


def load(source: Path | bytes, machine: Machine, extras: Sequence[tuple[ExtraTerm, int]] = ()) -> LocalEquations:
    """The equations in a file. FitError if they were fitted for another machine or with other terms."""
    with np.load(io.BytesIO(source) if isinstance(source, bytes) else source, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    header = json.loads(arrays["header"].tobytes())
    terms = _terms(header, extras)
    if header["machine"] != machine.id:
        raise FitError(f"these equations are of machine '{header['machine']}', not of '{machine.id}'.")
    overall = {name: arrays[f"overall_{name}"] for name in _OVERALL}
    return LocalEquations(
        terms=terms,
        machine=machine,
        grid=Grid(tuple(header["grid"])),
        kernels=tuple(Kernel(**k) for k in header["kernels"]),
        blend=header["blend"],
        overall=GlobalEquation(terms=terms, machine=machine, dropped=tuple(header["dropped"]), **overall),
        _factor=tuple(arrays[f"factor_{i}"] for i in range(sum(n.startswith("factor_") for n in arrays))),
        **{name: arrays[name] for name in _LOCAL},
    )


def digest(equations: LocalEquations) -> str:
    """SHA-256 of everything that decides a prediction."""
    total = hashlib.sha256()
    for name in _LOCAL:
        total.update(np.ascontiguousarray(getattr(equations, name)).tobytes())
    for name in _OVERALL:
        total.update(np.ascontiguousarray(getattr(equations.overall, name)).tobytes())
    total.update(repr((equations.terms.names, equations.grid, equations.kernels, equations.blend)).encode())
    return total.hexdigest()


def _terms(header: dict, extras: Sequence[tuple[ExtraTerm, int]]) -> TermSet:
    terms = term_set(header["terms"].split("+")[0])
    for term, size in extras:
        terms = terms.extended(term, size)
    if list(terms.names) != header["names"]:
        raise FitError(
            f"these equations have the terms {', '.join(header['names'])}; give the accepted physics that they were "
            f"fitted with (got {', '.join(terms.names)})."
        )
    return terms
