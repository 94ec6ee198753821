"""Backup and restore of everything a plant holds, one file each.

In:  a plant's folder. Out: a .tar with the workspace, MLflow's artifacts, the settings' secrets, and a dump of each
database. It may be taken while the plant runs: what arrives meanwhile is done by the restored plant.
"""

from __future__ import annotations

import shutil
import sqlite3
import tarfile
import tempfile
from collections.abc import Container
from contextlib import closing
from pathlib import Path

from deploy import postgres
from deploy.settings import PlantSettings
from pido import departures
from pido.core.errors import StoreError
from pido.workspace import Workspace, arrival_digest

_SQLITE = ("", "-wal", "-shm", "-journal")
"""Endings of the files of one database."""


def backup(settings: PlantSettings, archive: Path) -> None:
    """Write `archive`; a failed backup leaves an older file of that name as it was.

    Left out is what a start makes again: locks, signs of life, logs, `derived/`, iterations on their way.
    Raises StoreError where a database of the workspace is damaged, SettingsError where one of PostgreSQL's is.
    """
    archive = archive.absolute()
    archive.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=archive.parent) as temporary:
        copy = Path(temporary) / "plant"
        copy.mkdir()
        _snapshot(settings, copy, {archive, Path(temporary)})
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


def _snapshot(settings: PlantSettings, copy: Path, left_out: set[Path]) -> None:
    """Everything of the plant into the empty folder `copy`, without what is `left_out`.

    The order makes it whole while parts arrive. Decisions are read before the ledger, which then knows their versions;
    what the ledger names in store, bundles, runs and MLflow was written before it, and is read after it; and whatever
    has arrived and is not done by that ledger lies in the copy's inbox.
    """
    folder, place = settings.folder, settings.workspace
    there = copy / place.relative_to(folder)
    there.mkdir()
    _copy(place / "registry", there / "registry")
    done = {path.name for path in _inside(place / "taken")}
    databases = [place / "ledger.db", place / "mlflow.db", place / "store" / "index.sqlite"]
    for database in databases:
        if database.exists():
            _copy_sqlite(database, copy / database.relative_to(folder))
    dumps = copy / "dumps"
    dumps.mkdir()
    postgres.dump(settings, dumps)
    with departures.halted(Workspace.open(place)):  # between inbox and taken an arrival would be in neither
        _copy_arrivals(place, there, done)
    left_out = left_out | {database.with_name(database.name + end) for database in databases for end in _SQLITE}
    left_out |= {folder / name for name in ("postgres", "logs")}
    left_out |= {place / name for name in ("registry", "inbox", "taken")}  # as above
    left_out |= {place / name for name in ("locks", "derived", "work", "worker.alive", "watcher.alive")}
    _copy(folder, copy, left_out)


def _copy_arrivals(place: Path, there: Path, done: Container[str]) -> None:
    """Inbox and taken arrivals. Of the latter, those that are not `done` by the ledger's copy go back to its inbox."""
    inbox = there / "inbox"
    inbox.mkdir()
    for arrival in _inside(place / "inbox"):
        _copy(arrival, inbox / arrival.name)
        if not _is_there(arrival):
            _remove(inbox / arrival.name)  # perhaps half of it
    for arrival in _inside(place / "taken"):
        if arrival.name in done:
            (there / "taken").mkdir(exist_ok=True)
            _copy(arrival, there / "taken" / arrival.name)
            continue
        key, _, name = arrival.name.partition("-")  # as `pido.departures` calls it
        if not _is_there(inbox / name):
            _copy(arrival, inbox / name)
        elif not arrival_digest(inbox / name).startswith(key):
            raise StoreError(
                f"{place}: two arrivals called {name} came while the backup was made, and its inbox can hold one. "
                "Make the backup again."
            )


def _copy_sqlite(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        with closing(sqlite3.connect(source)) as old, closing(sqlite3.connect(target)) as new:
            old.backup(new)
    except sqlite3.DatabaseError as error:
        raise StoreError(f"{source}: cannot be copied ({error}). Bring it back from an older backup.") from None


def _copy(source: Path, target: Path, left_out: Container[Path] = ()) -> None:
    """A file, a link, or a folder with all that is in it. What vanishes meanwhile is left out: the plant goes on."""
    try:
        if source.is_symlink() or not source.is_dir():
            shutil.copy2(source, target, follow_symlinks=False)
            return
        target.mkdir(exist_ok=True)
        for inside in _inside(source):
            if inside not in left_out:
                _copy(inside, target / inside.name, left_out)
        shutil.copystat(source, target)
    except FileNotFoundError:
        if _is_there(source):
            raise


def _inside(folder: Path) -> list[Path]:
    """What lies in a folder, nothing where it is gone. Sorted: a seal before its log, a log before its champion."""
    try:
        return sorted(folder.iterdir())
    except FileNotFoundError:
        return []


def _is_there(path: Path) -> bool:
    return path.is_symlink() or path.exists()


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
