"""The ledger: what arrived, what became of it, and which iterations and versions there are. It is the truth.

In:  facts, each written in one transaction of a local SQLite file.
Out: the same facts. Everything else - MLflow, Prefect, events - may be lost and is brought up to it again.

Light on purpose: a second pass over known parts imports neither MLflow nor scikit-learn.
"""

from __future__ import annotations

import json
import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pido.core.errors import UnavailableError

_SCHEMA = """
CREATE TABLE IF NOT EXISTS arrivals(
  key TEXT PRIMARY KEY, name TEXT NOT NULL, state TEXT NOT NULL CHECK (state IN ('taken', 'rejected')),
  part TEXT, reason TEXT NOT NULL DEFAULT '', at REAL NOT NULL,
  machine TEXT NOT NULL DEFAULT '', lies TEXT NOT NULL DEFAULT '');
CREATE TABLE IF NOT EXISTS parts(
  number INTEGER PRIMARY KEY AUTOINCREMENT, digest TEXT NOT NULL UNIQUE, machine TEXT NOT NULL,
  name TEXT NOT NULL, at REAL NOT NULL, completed TEXT NOT NULL DEFAULT '');
CREATE TABLE IF NOT EXISTS iterations(
  run_key TEXT PRIMARY KEY, machine TEXT NOT NULL, part TEXT NOT NULL, version INTEGER NOT NULL,
  summary TEXT NOT NULL, logged TEXT NOT NULL DEFAULT '', at REAL NOT NULL, place TEXT NOT NULL DEFAULT '');
CREATE TABLE IF NOT EXISTS versions(
  machine TEXT NOT NULL, version INTEGER NOT NULL, bundle TEXT NOT NULL, run_key TEXT NOT NULL,
  gate TEXT NOT NULL, at REAL NOT NULL, PRIMARY KEY (machine, version), UNIQUE (machine, bundle));
"""
_ADDED = {"iterations": ("place",), "arrivals": ("machine", "lies"), "parts": ("completed",)}
"""Columns that a ledger of an older version has not, all of them text."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """A file or folder that arrived. `part`: digest of the part in it; `reason`: why it was rejected; `at`: when that
    was said, s since 1970; `machine`: '' where nobody said it; `lies`: where in the workspace it was put, or ''."""

    key: str
    name: str
    state: str
    part: str | None
    reason: str
    at: float
    machine: str
    lies: str


@dataclass(frozen=True, slots=True)
class Iteration:
    """One iteration that is finished. `logged`: id of its MLflow run, '' while MLflow has not got it."""

    run_key: str
    machine: str
    part: str
    version: int
    summary: dict[str, Any]
    logged: str


@dataclass(frozen=True, slots=True)
class Version:
    """A trained bundle with the gate's verdict: {'passed': bool, 'words': str, ...}."""

    machine: str
    version: int
    bundle: str
    run_key: str
    gate: dict[str, Any]
    at: float


class Ledger:
    """Facts of one workspace. Safe for several processes; a killed writer leaves all of a fact or nothing of it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        with self._open() as db:
            # Not whether there is a file: who made it may have died, or found the disk full, before its last table.
            if db.execute("SELECT 1 FROM sqlite_master WHERE name = 'versions'").fetchone() is None:
                db.execute("PRAGMA journal_mode=WAL")
                db.executescript(_SCHEMA)
            if _missing(db):
                db.execute("BEGIN IMMEDIATE")
                for table, column in _missing(db):  # still, inside the lock
                    db.execute(f"ALTER TABLE {table} ADD COLUMN {column} TEXT NOT NULL DEFAULT ''")
                db.execute("COMMIT")

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        try:
            db = sqlite3.connect(self.path, timeout=60.0, isolation_level=None)
            try:
                db.execute("PRAGMA synchronous=FULL")
                yield db
            finally:
                db.close()
        except sqlite3.OperationalError as error:
            raise UnavailableError(
                f"{self.path}: the ledger cannot be read or written ({error}). Nothing was changed. "
                "Check free space and permissions of the workspace."
            ) from error
        except sqlite3.DatabaseError as error:
            raise UnavailableError(
                f"{self.path}: the ledger is damaged ({error}). Bring it back from a backup; the store is safe."
            ) from error

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        with self._open() as db:
            db.execute("BEGIN IMMEDIATE")
            try:
                yield db
                db.execute("COMMIT")
            except BaseException:
                if db.in_transaction:
                    db.execute("ROLLBACK")
                raise

    def _rows(self, query: str, *values: Any) -> list[tuple[Any, ...]]:
        with self._open() as db:
            return db.execute(query, values).fetchall()

    def arrival(self, key: str) -> Arrival | None:
        """What became of the arrival with this digest, or None."""
        rows = self._rows(f"SELECT {_ARRIVAL} FROM arrivals WHERE key = ?", key)
        return Arrival(*rows[0]) if rows else None

    def took(self, key: str, name: str, part: str, machine: str = "") -> None:
        """This arrival is the part with digest `part` of `machine`, and that part is in the store."""
        self._arrived(key, name, "taken", part, "", machine)

    def rejected(self, key: str, name: str, reason: str, machine: str = "") -> None:
        """This arrival, of `machine` if somebody said one, cannot be used."""
        self._arrived(key, name, "rejected", None, reason, machine)

    def _arrived(self, key: str, name: str, state: str, part: str | None, reason: str, machine: str) -> None:
        with self._transaction() as db:
            db.execute(
                "INSERT INTO arrivals(key, name, state, part, reason, machine, at) VALUES (?, ?, ?, ?, ?, ?, ?) "
                "ON CONFLICT(key) DO UPDATE SET state = excluded.state, part = excluded.part, "
                "reason = excluded.reason, machine = excluded.machine, at = excluded.at",
                (key, name, state, part, reason, machine, time.time()),
            )

    def put_aside(self, key: str, lies: str) -> None:
        """What was rejected under `key` lies there now, in the workspace."""
        with self._transaction() as db:
            db.execute("UPDATE arrivals SET lies = ? WHERE key = ? AND state = 'rejected'", (lies, key))

    def rejections(self) -> list[Arrival]:
        """The arrivals that could not be used, newest last, without those that were put right: a later one of the same
        name and machine was taken in."""
        rows = self._rows(
            f"SELECT {_ARRIVAL} FROM arrivals AS r WHERE state = 'rejected' AND NOT EXISTS ("
            "SELECT 1 FROM arrivals AS t WHERE t.state = 'taken' AND t.name = r.name AND t.at >= r.at "
            "AND (t.machine = r.machine OR t.machine = '' OR r.machine = '')) ORDER BY at"
        )
        return [Arrival(*row) for row in rows]

    def parts(self, machine: str) -> list[str]:
        """Digests of the parts that went through an iteration, in the order of arrival; not of those that columns were
        added to since: as they are now, they have gone through one of their own, or are yet to."""
        query = "SELECT digest FROM parts WHERE machine = ? AND completed = '' ORDER BY number"
        return [d for (d,) in self._rows(query, machine)]

    def completed(self, before: str, part: str, machine: str, name: str) -> None:
        """Columns were added to the part `before`: it is `part` now, and an iteration with it is due."""
        with self._transaction() as db:
            db.execute(
                "INSERT INTO parts(digest, machine, name, at, completed) VALUES (?, ?, ?, ?, ?) "
                "ON CONFLICT(digest) DO UPDATE SET completed = excluded.completed",
                (before, machine, name, time.time(), part),
            )

    def machine_of(self, part: str) -> str | None:
        """The machine of a part that went through an iteration, or None."""
        rows = self._rows("SELECT machine FROM parts WHERE digest = ?", part)
        return rows[0][0] if rows else None

    def machines(self) -> list[str]:
        return [m for (m,) in self._rows("SELECT DISTINCT machine FROM parts WHERE completed = '' ORDER BY machine")]

    def iteration(self, run_key: str) -> Iteration | None:
        rows = self._rows(f"SELECT {_ITERATION} FROM iterations WHERE run_key = ?", run_key)
        return _iteration(rows[0]) if rows else None

    def iterations(self, machine: str) -> list[Iteration]:
        """All iterations of a machine, oldest first."""
        rows = self._rows(f"SELECT {_ITERATION} FROM iterations WHERE machine = ? ORDER BY rowid", machine)
        return [_iteration(row) for row in rows]

    def not_logged(self, place: str) -> list[Iteration]:
        """Iterations that MLflow at `place` (`Workspace.tracking_place`) has not got yet, or of which an older version
        did not write down where they are, oldest first."""
        query = f"SELECT {_ITERATION} FROM iterations WHERE logged = '' OR place != ? ORDER BY rowid"
        rows = self._rows(query, place)
        return [_iteration(row) for row in rows]

    def finished(
        self,
        run_key: str,
        machine: str,
        part: str,
        name: str,
        bundle: str,
        gate: dict[str, Any],
        summary: dict[str, Any],
    ) -> int:
        """An iteration is done: its part counts from now on and its bundle has a version. One transaction.

        A bundle that is already there keeps its version: the same state never gets two numbers.
        """
        now = time.time()
        with self._transaction() as db:
            done = db.execute("SELECT version FROM iterations WHERE run_key = ?", (run_key,)).fetchone()
            if done:
                return int(done[0])
            db.execute(
                "INSERT OR IGNORE INTO parts(digest, machine, name, at) VALUES (?, ?, ?, ?)", (part, machine, name, now)
            )
            known = db.execute(
                "SELECT version FROM versions WHERE machine = ? AND bundle = ?", (machine, bundle)
            ).fetchone()
            if known:
                version = int(known[0])
            else:
                last = db.execute("SELECT MAX(version) FROM versions WHERE machine = ?", (machine,)).fetchone()[0]
                version = (last or 0) + 1
                db.execute(
                    "INSERT INTO versions(machine, version, bundle, run_key, gate, at) VALUES (?, ?, ?, ?, ?, ?)",
                    (machine, version, bundle, run_key, json.dumps(gate), now),
                )
            db.execute(
                "INSERT INTO iterations(run_key, machine, part, version, summary, at) VALUES (?, ?, ?, ?, ?, ?)",
                (run_key, machine, part, version, json.dumps(summary), now),
            )
        return version

    def judged(self, machine: str, version: int, gate: dict[str, Any]) -> None:
        """The gate's verdict on a version, given again beside another champion."""
        with self._transaction() as db:
            db.execute(
                "UPDATE versions SET gate = ? WHERE machine = ? AND version = ?", (json.dumps(gate), machine, version)
            )

    def logged(self, run_key: str, mlflow_run: str, place: str) -> None:
        """MLflow at `place` has this iteration under `mlflow_run`."""
        with self._transaction() as db:
            db.execute("UPDATE iterations SET logged = ?, place = ? WHERE run_key = ?", (mlflow_run, place, run_key))

    def versions(self, machine: str) -> list[Version]:
        """All versions of a machine, oldest first."""
        rows = self._rows(
            "SELECT machine, version, bundle, run_key, gate, at FROM versions WHERE machine = ? ORDER BY version",
            machine,
        )
        return [Version(m, v, bundle, key, json.loads(gate), at) for m, v, bundle, key, gate, at in rows]


def _missing(db: sqlite3.Connection) -> list[tuple[str, str]]:
    """(Table, column) of what an older version did not write down."""
    there = {table: {row[1] for row in db.execute(f"PRAGMA table_info({table})")} for table in _ADDED}
    return [(table, column) for table, columns in _ADDED.items() for column in columns if column not in there[table]]


_ARRIVAL = "key, name, state, part, reason, at, machine, lies"
_ITERATION = "run_key, machine, part, version, summary, logged"


def _iteration(row: tuple[Any, ...]) -> Iteration:
    run_key, machine, part, version, summary, logged = row
    return Iteration(run_key, machine, part, version, json.loads(summary), logged)
