"""Backup and restore of everything a plant holds, one file each.

In:  a plant's folder. Out: a .tar with the workspace, MLflow's artifacts, the settings' secrets, and a dump of each
database. SQLite files are copied through SQLite, so that a copy taken while one is written is whole.
"""

from __future__ import annotations

import shutil
import sqlite3
import tarfile
import tempfile
from pathlib import Path

from deploy import postgres
from deploy.settings import PlantSettings
from pido.core.errors import StoreError

_LEFT_OUT = ("postgres", "logs", "locks", "derived", "work")
_JOURNALS = ("-wal", "-shm", "-journal")


def backup(settings: PlantSettings, archive: Path) -> None:
    """Write `archive`; a failed backup leaves an older file of that name as it was."""
    archive.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=archive.parent) as temporary:
        copy = Path(temporary) / "plant"
        # The ledger first: what it names is in store, bundles and runs already, for they are written before it.
        for database in sorted(settings.folder.rglob("*.db")):
            _copy_sqlite(database, copy / database.relative_to(settings.folder))
        shutil.copytree(settings.folder, copy, ignore=_ignore, dirs_exist_ok=True, symlinks=True)
        dumps = copy / "dumps"
        dumps.mkdir()
        postgres.dump(settings, dumps)
        new = Path(temporary) / "new.tar"
        with tarfile.open(new, "w") as tar:
            tar.add(copy, arcname=".")
        new.chmod(0o600)
        new.replace(archive)


def unpack(archive: Path, folder: Path) -> None:
    """The content of a backup into `folder`, which must be empty or new."""
    if folder.exists() and any(folder.iterdir()):
        raise StoreError(
            f"{folder}: not empty. A backup is restored into a new folder, so that nothing is overwritten."
        )
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with tarfile.open(archive) as tar:
            tar.extractall(folder, filter="data")
    except (tarfile.TarError, OSError) as error:
        raise StoreError(f"{archive}: not a whole backup ({error}).") from None


def restore_databases(settings: PlantSettings) -> None:
    """The databases from the dumps in the folder, which are then removed."""
    dumps = settings.folder / "dumps"
    postgres.restore(settings, dumps)
    shutil.rmtree(dumps)


def _copy_sqlite(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    with sqlite3.connect(source) as old, sqlite3.connect(target) as new:
        old.backup(new)
    old.close()
    new.close()


def _ignore(folder: str, names: list[str]) -> list[str]:
    return [
        n for n in names if n in _LEFT_OUT or n.endswith((".db", ".alive", ".new", *(f".db{j}" for j in _JOURNALS)))
    ]
