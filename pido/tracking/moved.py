"""MLflow's addresses after a workspace was moved or copied: its embedded store keeps artifacts by absolute path.

In:  a workspace whose store is its own SQLite file. Out: the folder that the store still pointed into, if it did.

MLflow has no call for this, so its tables are changed, in one transaction: an experiment writes where the workspace is
now; a run, a model or a version is found here where its files are here, and stays where only the old folder has them.
"""

from __future__ import annotations

import logging
import sqlite3
from contextlib import closing
from pathlib import Path
from urllib.parse import unquote, urlsplit

from pido.workspace import Workspace

log = logging.getLogger(__name__)

FOLDER = "mlartifacts"
"""Where the artifacts of the embedded store lie in a workspace, one folder per machine."""
_OURS = "name LIKE 'pido %'"  # experiments that `mlflow_store.experiment` made; others lie where somebody wanted them
_FILES = (("runs", "artifact_uri"), ("logged_models", "artifact_location"), ("model_versions", "storage_location"))


def left_behind(workspace: Workspace) -> list[str]:
    """Addresses of folders that this workspace was in and its experiments still write to."""
    file = workspace.root / "mlflow.db"
    if not workspace.tracks_alone or not file.exists():
        return []  # a server, or a store that several workspaces share, has its own places
    with closing(sqlite3.connect(file.as_uri() + "?mode=ro", uri=True)) as db:
        return _left_behind(db, workspace.root)


def settle(workspace: Workspace) -> None:
    """Let the store of a workspace that was moved or copied write and find its artifacts here; the caller holds the
    lock 'mlflow'. Doing it again changes nothing."""
    if not left_behind(workspace):
        return
    here = workspace.root.as_uri()
    with closing(sqlite3.connect(workspace.root / "mlflow.db", timeout=30.0, isolation_level=None)) as db:
        db.execute("BEGIN IMMEDIATE")
        for there in _left_behind(db, workspace.root):
            db.execute(
                "UPDATE experiments SET artifact_location = ? || substr(artifact_location, ?) "
                f"WHERE artifact_location LIKE ? ESCAPE '!' AND {_OURS}",
                (here, len(there) + 1, _within(f"{there}/{FOLDER}")),
            )
            for table, column in _FILES:
                for (address,) in _all(db, table, column, there):
                    found = here + address[len(there) :]
                    if _path(found).exists() or not _path(address).exists():
                        db.execute(f"UPDATE {table} SET {column} = ? WHERE {column} = ?", (found, address))
            for (source,) in _all(db, "datasets", "dataset_source", f'{{"uri": "{there}'):
                new = source.replace(f'"{there}/', f'"{here}/')
                db.execute("UPDATE datasets SET dataset_source = ? WHERE dataset_source = ?", (new, source))
            log.warning("this workspace was at %s: MLflow finds and writes its artifacts at %s now", there, here)
        db.execute("COMMIT")


def _left_behind(db: sqlite3.Connection, root: Path) -> list[str]:
    found = set()
    for (address,) in _all(db, "experiments", "artifact_location", "file://", _OURS):
        there, folder, machine = address.rpartition(f"/{FOLDER}/")
        if folder and "/" not in machine and there != root.as_uri() and not _same(_path(there), root):
            found.add(there)
    return sorted(found)


def _same(one: Path, other: Path) -> bool:
    """Whether both are one folder, by another name."""
    return one.exists() and one.samefile(other)


def _all(db: sqlite3.Connection, table: str, column: str, there: str, which: str = "TRUE") -> list[tuple[str]]:
    """Different values of a column that begin with an address and go on below it; none where MLflow has no such one."""
    if column not in {row[1] for row in db.execute(f"PRAGMA table_info({table})")}:
        return []
    query = f"SELECT DISTINCT {column} FROM {table} WHERE {column} LIKE ? ESCAPE '!' AND {which}"
    return db.execute(query, (_within(there),)).fetchall()


def _within(address: str) -> str:
    """Of LIKE: all below an address, whose own signs stand for themselves."""
    return address.replace("!", "!!").replace("%", "!%").replace("_", "!_") + "/%"


def _path(address: str) -> Path:
    return Path(unquote(urlsplit(address).path))
