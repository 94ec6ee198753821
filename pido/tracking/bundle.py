"""A bundle: everything that goes into force together - four models, equation, limits, digest of the training set.

In:  named files as bytes, and the digests of what they hold.
Out: a folder `bundles/<digest>`, written beside and renamed, so that it is there whole or not at all.

Nothing of a bundle is used before its bytes have been checked against its manifest: a model file that was swapped is
found before it is opened.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pido.core.errors import RegistryError
from pido.core.files import write_atomically
from pido.workspace import digest_of


@dataclass(frozen=True, slots=True)
class Bundle:
    """A bundle on disk. `content` decides its digest: machine, parts, data, models, equation, limits, settings."""

    folder: Path
    digest: str
    content: dict[str, Any]
    files: dict[str, str]  # name -> SHA-256

    def read(self, name: str) -> bytes:
        """The bytes of one file, checked. Raises RegistryError if they are not those of the manifest."""
        try:
            data = (self.folder / name).read_bytes()
        except OSError as error:
            raise RegistryError(f"{self.folder / name}: cannot be read ({error.strerror}).") from None
        if hashlib.sha256(data).hexdigest() != self.files.get(name):
            raise RegistryError(
                f"{self.folder / name}: not the file that was registered; it is not loaded. "
                "Roll back to another version, or bring the bundle back from a backup."
            )
        return data


def save(bundles: Path, content: Mapping[str, Any], files: Mapping[str, bytes]) -> Bundle:
    """Write a bundle, unless the same one is there already. Returns it, checked."""
    digest = digest_of(dict(content))
    folder = bundles / digest
    if folder.exists():
        return verify(load(bundles, digest))
    temporary = bundles / f".{digest}.{os.getpid()}.new"
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir(parents=True)
    try:
        for name, data in files.items():
            write_atomically(temporary / name, data)
        manifest = {
            "content": dict(content),
            "files": {name: hashlib.sha256(data).hexdigest() for name, data in files.items()},
        }
        write_atomically(temporary / "manifest.json", json.dumps(manifest, sort_keys=True, indent=1, default=str))
        try:
            temporary.rename(folder)
        except OSError:
            if not folder.exists():  # else another process was quicker with the same content
                raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return verify(load(bundles, digest))


def load(bundles: Path, digest: str) -> Bundle:
    """The bundle with this digest. Raises RegistryError where it is missing or its manifest was changed."""
    folder = bundles / digest
    try:
        manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        bundle = Bundle(folder, digest, manifest["content"], manifest["files"])
    except (OSError, json.JSONDecodeError, KeyError, TypeError) as error:
        raise RegistryError(f"{folder}: this bundle is missing or its manifest is unreadable ({error}).") from None
    if digest_of(bundle.content) != digest:
        raise RegistryError(f"{folder}: its manifest is not the one that was registered; the bundle is not used.")
    return bundle


def verify(bundle: Bundle) -> Bundle:
    """Check every file of a bundle; returns it, or raises RegistryError naming the file."""
    for name in bundle.files:
        bundle.read(name)
    return bundle
