"""The store: a folder that only grows. One Parquet file per recording, named by its content; an index in SQLite.

In:  recordings. Out: entries in production order, and recordings back by digest.

    <root>/index.sqlite                  what has been seen, once
    <root>/parts/<2>/<digest>.parquet    the content
    <root>/rejected/<name>               what could not be used, as it came
    <root>/rejected/<name>.reason.txt    why

A file is written beside its place, flushed, renamed, and only then entered in the index within one transaction. A
process that dies in between leaves at most a file that no entry names: it is invisible, and the next add of the same
content takes it over. SQLite serialises two processes; the second of two equal adds finds the first one's entry.

A part that was withdrawn keeps its file and its line; it is no longer among the entries, and its name is free for
another recording. Who withdrew it and why is in a workspace's audit log (`pido.withdrawal`).

The same samples under a part.json that says otherwise are the stored part, which stays as it is: what differs is said.
Where that part was withdrawn, and what was cut with what is said otherwise, they are a part of its own: the corrected.

A recording that comes again with further columns completes the stored one: a new file beside the old one, which stays,
and the part's entry is the new one from then on. By the old digest the old content is still read.
"""

from __future__ import annotations

import logging
import os
import shutil
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from pido.core.errors import StoreError, UnavailableError
from pido.core.files import replacing
from pido.core.names import file_name
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.store import content
from pido.store.sizes import COLUMNS, Sizes, beside, sizes

log = logging.getLogger(__name__)
_SCHEMA = """
CREATE TABLE IF NOT EXISTS entries (
    digest TEXT PRIMARY KEY,
    machine TEXT NOT NULL,
    part TEXT NOT NULL,
    "order" INTEGER,
    start_time_s REAL,
    samples INTEGER NOT NULL,
    source TEXT NOT NULL,
    UNIQUE (machine, part)
) STRICT
"""
_SIGNALS = "CREATE TABLE IF NOT EXISTS signals (digest TEXT PRIMARY KEY, signals TEXT NOT NULL) STRICT"
_WITHDRAWN = "CREATE TABLE IF NOT EXISTS withdrawn (digest TEXT PRIMARY KEY, part TEXT NOT NULL) STRICT"
_BESIDE = 5
"""Newest parts that the currents of an arriving one are compared with."""
_COMPLETED = "CREATE TABLE IF NOT EXISTS completed (digest TEXT PRIMARY KEY, whole TEXT NOT NULL) STRICT"
_FIELDS = 'digest, machine, part, "order", start_time_s, samples, source'


@dataclass(frozen=True, slots=True)
class Entry:
    """What the index knows about one stored part. `new` says whether `add` just stored it; `gained`: the columns with
    which `add` just completed it; `told`: what the part.json that `add` got says otherwise, and what to do, or ''."""

    digest: str
    machine: str
    part: str
    order: int | None
    start_time_s: float | None
    samples: int
    source: str
    new: bool = False
    gained: tuple[str, ...] = ()
    told: str = ""


class Store:
    """Append-only and content-addressed; safe with several processes at once."""

    def __init__(self, root: Path) -> None:
        self.root = Path(root)
        self._index = self.root / "index.sqlite"

    def add(self, recording: Recording, source: str = "") -> Entry:
        """Keep a recording. What was seen before is found again (`new` is False); nothing is written twice: the same
        content, and the same measured samples of the machine, whatever part.json calls them. Columns that the stored
        one has not complete it, where the others are the same.

        Raises StoreError where the machine already has a part of this name with other content, where this one was
        withdrawn, and where its currents are in another unit than those of the machine's other parts.
        """
        digest = content.digest(recording)
        part = recording.part
        known = self._find(digest)
        if known is not None:
            self._refuse_withdrawn(digest)
        if known is not None and self.path(digest).exists():
            return known
        signals = content.signals(recording)
        twin = self._measured(part.machine, len(recording), signals)
        corrected = twin is not None and self._corrects(twin, recording)
        same = None if corrected else twin
        if same is not None:
            self._refuse_withdrawn(same.digest)
        if same is not None and same.digest != digest:  # its own file may be gone, and is written again
            return self._complete(same, recording, source)
        self._refuse_other_content(part.machine, part.part, digest)
        self.compare_currents(recording)
        self._write(recording, source, self.path(digest))
        row = (digest, part.machine, part.part, part.order, part.start_time_s, len(recording), source)
        with self._connect() as index:
            index.execute("BEGIN IMMEDIATE")
            found = index.execute(f"SELECT {_FIELDS} FROM entries WHERE digest = ?", (digest,)).fetchone()
            same = _same(index, part.machine, signals)
            if found is None and same is not None and not (corrected and same == twin):
                index.execute("ROLLBACK")  # another process was first
                return self._complete(same, recording, source)
            if found is None:
                try:
                    index.execute(f"INSERT INTO entries ({_FIELDS}) VALUES (?, ?, ?, ?, ?, ?, ?)", row)
                except sqlite3.IntegrityError:
                    index.execute("ROLLBACK")
                    self._refuse_other_content(part.machine, part.part, digest)
                    raise
                if signals is not None:
                    index.execute("INSERT OR REPLACE INTO signals VALUES (?, ?)", (digest, signals))
            index.execute("COMMIT")
        return Entry(*row, new=True) if found is None else Entry(*found)

    def as_kept(self, recording: Recording) -> tuple[Recording, Entry | None]:
        """The recording as `add` keeps it, and the stored part of this machine with the same measured samples, whatever
        it is called, unless it was withdrawn and this one corrects it: where there is one, its columns with what this
        one adds to them. Nothing is written."""
        same = self._measured(recording.part.machine, len(recording), content.signals(recording))
        if same is not None and self._corrects(same, recording):
            return recording, None
        if same is None or not self.path(same.digest).exists():
            return recording, same
        return content.completed(content.read(self.path(same.digest), None), recording).recording, same

    def today(self, digests: Iterable[str]) -> dict[str, str]:
        """By digest, the one that stands for it now: of the part that it was completed to, or itself."""
        found = {digest: digest for digest in digests}
        if found and self._index.exists():
            with self._connect() as index:
                found |= {old: new for old, new in index.execute("SELECT * FROM completed") if old in found}
        return found

    def before(self, digest: str) -> tuple[str, ...]:
        """What this part was before columns were added to it, in digests."""
        with self._connect() as index:
            rows = index.execute("SELECT digest FROM completed WHERE whole = ? ORDER BY digest", (digest,)).fetchall()
        return tuple(old for (old,) in rows)

    def newest_sizes(self, machine: str) -> dict[str, Sizes]:
        """How large the currents of the machine's newest parts are, by part: what others are compared with."""
        others = [entry for entry in self.entries(machine) if self.path(entry.digest).exists()]
        return {entry.part: _sizes_of(self.path(entry.digest)) for entry in others[-_BESIDE:]}

    def beside_stored(self, recording: Recording) -> str:
        """What is odd about the size of the currents beside those of the machine's newest parts, '' where nothing is.

        Raises StoreError where they are a thousand times as large, or a thousandth: mA.
        """
        part = recording.part
        found = beside(part.part, sizes(recording), self.newest_sizes(part.machine))
        if found is not None and found.unit:
            raise StoreError(found.words)
        return found.words if found else ""

    def compare_currents(self, recording: Recording) -> None:
        """As `beside_stored`; what is odd is warned of."""
        if odd := self.beside_stored(recording):
            log.warning("%s", odd)

    def withdraw(self, digest: str) -> None:
        """Take a part out of the entries and give its name free; nothing is deleted. Once is enough."""
        with self._connect() as index:
            index.execute("BEGIN IMMEDIATE")
            row = index.execute("SELECT part FROM entries WHERE digest = ?", (digest,)).fetchone()
            known = index.execute("SELECT 1 FROM withdrawn WHERE digest = ?", (digest,)).fetchone()
            if row is not None and known is None:
                index.execute("INSERT INTO withdrawn VALUES (?, ?)", (digest, row[0]))
                aside = f"{row[0]} (withdrawn {digest[:12]})"  # (machine, part) is unique
                index.execute("UPDATE entries SET part = ? WHERE digest = ?", (aside, digest))
            index.execute("COMMIT")

    def reinstate(self, digest: str) -> None:
        """Bring a withdrawn part back. Raises StoreError where another part has its name or its samples by now."""
        with self._connect() as index:
            index.execute("BEGIN IMMEDIATE")
            row = index.execute("SELECT part FROM withdrawn WHERE digest = ?", (digest,)).fetchone()
            if row is not None and (other := _same_samples(index, digest)):
                index.execute("ROLLBACK")
                raise StoreError(
                    f"part '{row[0]}' ({digest[:12]}) cannot come back: part '{other}' has its samples, with another "
                    "description. Withdraw that one first."
                )
            if row is not None:
                try:
                    index.execute("UPDATE entries SET part = ? WHERE digest = ?", (row[0], digest))
                except sqlite3.IntegrityError:
                    index.execute("ROLLBACK")
                    raise StoreError(
                        f"part '{row[0]}' ({digest[:12]}) cannot come back: another recording has its name by now. "
                        "Withdraw that one first."
                    ) from None
                index.execute("DELETE FROM withdrawn WHERE digest = ?", (digest,))
            index.execute("COMMIT")

    def withdrawn(self, machine: str | None = None) -> tuple[Entry, ...]:
        """Parts that were withdrawn, under the names that they had."""
        if not self._index.exists():
            return ()
        with self._connect() as index:
            names = dict(index.execute("SELECT digest, part FROM withdrawn").fetchall())
        found = [replace(entry, part=names[d]) for d in sorted(names) if (entry := self._find(d)) is not None]
        return tuple(entry for entry in found if machine in (None, entry.machine))

    def why_withdrawn(self, digest: str) -> str:
        """Why this recording is not taken in again, in words; '' where it was not withdrawn."""
        gone = next((entry for entry in self.withdrawn() if entry.digest == digest), None)
        if gone is None:
            return ""
        return (
            f"this recording is part '{gone.part}' of machine '{gone.machine}' ({digest[:12]}), which was withdrawn: "
            "it is not taken in again. `pido status` says by whom and why, "
            f"`pido withdraw {digest[:12]} --undo` brings it back."
        )

    def entries(self, machine: str | None = None) -> tuple[Entry, ...]:
        """All parts (of one machine) in production order: order, then start time, then digest; unknown ones last.
        Without those that were withdrawn: whoever learns, judges or compares takes its parts from here."""
        if not self._index.exists():
            return ()
        with self._connect() as index:
            rows = index.execute(
                f"SELECT {_FIELDS} FROM entries WHERE digest NOT IN (SELECT digest FROM withdrawn)"
            ).fetchall()
        last = float("inf")
        found = [entry for row in rows if machine in (None, (entry := Entry(*row)).machine)]
        return tuple(
            sorted(
                found,
                key=lambda e: (
                    last if e.order is None else e.order,
                    last if e.start_time_s is None else e.start_time_s,
                    e.digest,
                ),
            )
        )

    def entry(self, digest: str) -> Entry | None:
        """The part with this content, or the one that it was completed to; None where there is none. One lookup,
        however many parts there are."""
        return self._find(digest)

    def has(self, digest: str) -> bool:
        """Whether this content was stored."""
        return self._find(digest) is not None

    def load(self, digest: str, columns: Iterable[str] | None = None) -> Recording:
        """A stored recording; with `columns`, only these and time are read. Raises StoreError where it is not there."""
        if not self.has(digest):
            raise StoreError(f"{self.root}: no part with digest {digest[:12]}. `pido ingest` adds one.")
        return content.read(self.path(digest), columns)

    def path(self, digest: str) -> Path:
        """Where the content of this digest lies."""
        return self.root / "parts" / digest[:2] / f"{digest}.parquet"

    def reject(self, path: Path, reason: str, source: Path | None = None) -> Path:
        """Move what cannot be used to the rejected area, with the reason beside it; the index is not touched.

        source : where it came from, if that is not `path`

        What may not be taken away from where it lies is copied. Raises StoreError for a folder that holds this store,
        and for what lies in it.
        """
        path = Path(path).absolute()
        own, given = self.root.resolve(), path.parent.resolve() / path.name
        if own.is_relative_to(given) or given.is_relative_to(own):
            raise StoreError(f"{path}: lies in the store {self.root}, or holds it. It stays where it is.")
        area = self.root / "rejected"
        area.mkdir(parents=True, exist_ok=True)
        for place in _free_names(area, file_name(path.name)):
            try:
                # The reason first, exclusively: it reserves the name against a second process.
                with place.with_name(f"{place.name}.reason.txt").open("x", encoding="utf-8") as handle:
                    handle.write(f"{source or path}\n{reason}\n")
            except FileExistsError:
                continue
            _move(path, place)
            return place
        raise StoreError(f"{area}: no free name for {path.name}; tidy the rejected area up.")

    def _find(self, digest: str) -> Entry | None:
        if not self._index.exists():
            return None
        with self._connect() as index:
            row = index.execute(
                f"SELECT {_FIELDS} FROM entries WHERE digest = "
                "coalesce((SELECT whole FROM completed WHERE digest = ?1), ?1)",
                (digest,),
            ).fetchone()
        return None if row is None else Entry(*row)

    def _complete(self, same: Entry, recording: Recording, source: str) -> Entry:
        if not self.path(same.digest).exists():
            return self._say_same(same, recording, "")
        stored = content.read(self.path(same.digest), None)
        found = content.completed(stored, recording)
        same = replace(same, told=_told(same, stored.part, recording.part))
        if not found.gained:
            return self._say_same(same, recording, found.left_out)
        digest = content.digest(found.recording)
        self._write(found.recording, f"{same.source}, {source}", self.path(digest))
        with self._connect() as index:
            index.execute("BEGIN IMMEDIATE")
            ours = index.execute("UPDATE entries SET digest = ? WHERE digest = ?", (digest, same.digest)).rowcount
            if ours:
                index.execute(
                    "INSERT OR REPLACE INTO signals SELECT ?, signals FROM signals WHERE digest = ?",
                    (digest, same.digest),
                )
                index.execute("UPDATE completed SET whole = ? WHERE whole = ?", (digest, same.digest))
                index.execute("INSERT INTO completed VALUES (?, ?)", (same.digest, digest))
            index.execute("COMMIT")
        if not ours:  # another process was first
            return self.add(recording, source)
        log.warning(
            "part '%s' of machine '%s' has the samples of '%s' (%s) and brings %s: they complete it (now %s)%s",
            recording.part.part, same.machine, same.part, same.digest[:12], ", ".join(found.gained), digest[:12],
            same.told and f". {same.told}",
        )  # fmt: skip
        return replace(same, digest=digest, gained=found.gained)

    def _measured(self, machine: str, samples: int, signals: str | None) -> Entry | None:
        """Parts of as many samples that a release before had stored are read once, and only what was measured."""
        if signals is None or not self._index.exists():
            return None
        with self._connect() as index:
            older = index.execute(
                "SELECT digest FROM entries WHERE machine = ? AND samples = ? AND digest NOT IN "
                "(SELECT digest FROM signals)",
                (machine, samples),
            ).fetchall()
            for (digest,) in older:
                try:
                    stored = content.read(self.path(digest), content.MEASURED, missing_ok=True)
                except StoreError as error:
                    log.warning("%s. Whether an arrival has its samples cannot be said.", error)
                    continue
                index.execute("INSERT OR REPLACE INTO signals VALUES (?, ?)", (digest, content.signals(stored) or ""))
            return _same(index, machine, signals)

    def _say_same(self, same: Entry, recording: Recording, left_out: str) -> Entry:
        log.warning(
            "part '%s' of machine '%s' has the samples of '%s' (%s), which is in the store already: it is the same "
            "recording, whatever its part.json says, and is not learnt from twice%s%s",
            recording.part.part, same.machine, same.part, same.digest[:12], same.told and f". {same.told}",
            left_out and f". {left_out}",
        )  # fmt: skip
        return same

    def _corrects(self, same: Entry, recording: Recording) -> bool:
        """Whether the stored part with these samples was withdrawn, and another description of what was cut comes."""
        if not self.why_withdrawn(same.digest) or not self.path(same.digest).exists():
            return False
        otherwise = content.says_otherwise(content.described(self.path(same.digest)), recording.part)
        return bool(otherwise.keys() - content.IDENTIFYING)

    def _refuse_withdrawn(self, digest: str) -> None:
        if gone := self.why_withdrawn(digest):
            raise StoreError(gone)

    def _refuse_other_content(self, machine: str, part: str, digest: str) -> None:
        if not self._index.exists():
            return
        with self._connect() as index:
            row = index.execute("SELECT digest FROM entries WHERE machine = ? AND part = ?", (machine, part)).fetchone()
        if row is not None and row[0] != digest:
            raise StoreError(
                f"part '{part}' of machine '{machine}' is in the store with other content "
                f"(there {row[0][:12]}, here {digest[:12]}). A stored part never changes: give this one its own name, "
                "or, where the stored one is wrong, take that out first: `pido withdraw`."
            )

    def _write(self, recording: Recording, source: str, place: Path) -> None:
        with replacing(place) as temporary:
            content.write(recording, source, temporary)

    @contextmanager
    def _connect(self) -> Iterator[sqlite3.Connection]:
        self.root.mkdir(parents=True, exist_ok=True)
        try:
            with closing(sqlite3.connect(self._index, timeout=60.0, isolation_level=None)) as index:
                index.execute("PRAGMA journal_mode = WAL")
                index.execute("PRAGMA synchronous = FULL")
                index.execute(_SCHEMA)
                index.execute(_SIGNALS)
                index.execute(_WITHDRAWN)
                index.execute(_COMPLETED)
                yield index
        except sqlite3.DatabaseError as error:
            raise UnavailableError(f"{self._index}: {error}. If it is damaged, restore it from the backup.") from None


@lru_cache(maxsize=64)
def _sizes_of(path: Path) -> Sizes:
    """Of a stored part, whose content never changes. One whose file is damaged says nothing here."""
    try:
        return sizes(content.read(path, COLUMNS, missing_ok=True))
    except StoreError as error:
        log.warning("%s Arriving currents are not compared with it.", error)
        return {}


def _same(index: sqlite3.Connection, machine: str, signals: str | None) -> Entry | None:
    fields = ", ".join(f"e.{name}" for name in _FIELDS.split(", "))
    row = index.execute(
        f"SELECT {fields} FROM entries e JOIN signals s ON s.digest = e.digest "
        "WHERE e.machine = ? AND s.signals = ? "
        'ORDER BY e.digest IN (SELECT digest FROM withdrawn), e."order", e.start_time_s, e.digest LIMIT 1',
        (machine, signals),
    ).fetchone()
    return None if row is None else Entry(*row)


def _same_samples(index: sqlite3.Connection, digest: str) -> str:
    """Which other part, that was not withdrawn, has the samples of this one; '' where none."""
    row = index.execute(
        "SELECT e.part FROM entries e JOIN signals s ON s.digest = e.digest JOIN entries own ON own.digest = ?1 "
        "WHERE e.digest != ?1 AND e.machine = own.machine AND e.digest NOT IN (SELECT digest FROM withdrawn) "
        "AND s.signals = (SELECT signals FROM signals WHERE digest = ?1 AND signals != '')",
        (digest,),
    ).fetchone()
    return "" if row is None else row[0]


def _told(same: Entry, stored: PartInfo, again: PartInfo) -> str:
    """What a second part.json says otherwise, and what to do, in sentences; '' where nothing."""
    otherwise = content.says_otherwise(stored, again)
    if not otherwise:
        return ""
    says = f"Its part.json says otherwise: {', '.join(otherwise.values())}. What is stored stays"
    if otherwise.keys() <= content.IDENTIFYING:
        return says
    return f"{says}; if it is wrong, `pido withdraw {same.digest[:12]}`, then bring this one again"


def _move(path: Path, place: Path) -> None:
    """By a new name; where that is refused, by a copy, after which the original goes only if all of it may."""
    try:
        path.rename(place)
        return
    except OSError:  # another disk, or a folder from which nothing may be taken away
        pass
    folder = path.is_dir() and not path.is_symlink()
    if folder:
        shutil.copytree(path, place, symlinks=True)
    else:
        shutil.copy2(path, place, follow_symlinks=False)
    inner = [path, *(p for p in path.rglob("*") if p.is_dir() and not p.is_symlink())] if folder else []
    if all(os.access(each, os.W_OK | os.X_OK) for each in (path.parent, *inner)):
        shutil.rmtree(path) if folder else path.unlink()


def _free_names(area: Path, name: str) -> Iterator[Path]:
    yield area / name
    yield from (area / f"{name}.{n}" for n in range(2, 10_000))
