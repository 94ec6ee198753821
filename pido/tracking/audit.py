"""The audit log: who decided what, when and why. It is appended to and never rewritten; each record carries the hash
of the one before, and a seal beside the log (`pido.tracking.seal`) says how far it goes, so that a change, a removal or
a swap anywhere in it shows.

In:  decisions. Out: records, one JSON line each.
A record cut short by a crash is no record: the next append removes the torn tail. What a later release has written (an
action that is not known here, a field more) is a link of the chain as any other: it is kept, counted and shown, and
decides nothing here.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from pido.core.errors import RegistryError
from pido.tracking.seal import check, seal, seal_of, whole_lines

GENESIS = "0" * 64
VERSIONS, PARTS = ("approve", "reject", "rollback"), ("withdraw", "reinstate")
"""Actions about versions, and about parts."""
_UNSAID = {"action": "", "machine": "", "version": 0, "bundle": "", "by": "", "reason": "", "at": ""}


@dataclass(frozen=True, slots=True)
class Record:
    """One decision. `hash` is the SHA-256 of all other fields that say something; `previous` the hash of the record
    before. About a part, `version` is 0, `part` its digest and `name` what it was called."""

    number: int
    action: str  # one of VERSIONS or PARTS, or one that a later release knows
    machine: str
    version: int
    bundle: str
    by: str
    reason: str
    at: str  # UTC, ISO 8601
    previous: str
    hash: str = ""
    part: str = ""
    name: str = ""
    more: Mapping[str, Any] = field(default_factory=dict, hash=False)  # fields that a later release has written

    @classmethod
    def of(cls, line: str | bytes) -> Record:
        """A record as it was written. Raises ValueError, with the reason, where it is none or was changed since."""
        written = json.loads(line)
        if not isinstance(written, dict) or not {"number", "previous", "hash"} <= written.keys():
            raise ValueError("it cannot be read")
        if _hash(written) != written["hash"]:
            raise ValueError("its content does not match its hash")
        known = {one.name for one in fields(cls)} - {"more"}
        own = {**_UNSAID, **{k: v for k, v in written.items() if k in known}}
        return cls(**own, more={k: v for k, v in written.items() if k not in known})

    def plain(self) -> dict[str, Any]:
        """As it is written: a decision about a version has no part."""
        own = asdict(self)
        return own.pop("more") | {k: v for k, v in own.items() if v or k not in ("part", "name")}

    def sealed(self) -> Record:
        return replace(self, hash=_hash(self.plain()))


def read(path: Path) -> list[Record]:
    """All records, checked. Raises RegistryError naming the first record that was tampered with."""
    sealed = seal_of(path)
    lines = whole_lines(path)
    records: list[Record] = []
    for number, line in enumerate(lines, start=1):
        try:
            record = Record.of(line)
        except json.JSONDecodeError:
            raise RegistryError(_tampered(path, number, "it cannot be read")) from None
        except ValueError as error:
            raise RegistryError(_tampered(path, number, str(error))) from None
        before = records[-1].hash if records else GENESIS
        if record.previous != before or record.number != number:
            raise RegistryError(_tampered(path, number, "it does not follow the record before it"))
        records.append(record)
    check(path, sealed, lines)
    return records


def next_record(
    path: Path,
    *,
    action: str,
    machine: str,
    version: int = 0,
    bundle: str = "",
    by: str,
    reason: str,
    at: str,
    part: str = "",
    name: str = "",
) -> Record:
    """The record that would be appended now."""
    records = read(path)
    previous = records[-1].hash if records else GENESIS
    number = len(records) + 1
    return Record(number, action, machine, version, bundle, by, reason, at, previous, part=part, name=name).sealed()


def append(path: Path, record: Record) -> None:
    """Write `record` and see it on the disk. Once is enough: a record that is there already is left alone.

    Raises RegistryError if the log has moved on since the record was made. The caller holds the machine's lock.
    """
    records = read(path)
    if record not in records[-1:]:
        if record.previous != (records[-1].hash if records else GENESIS):
            raise RegistryError(
                f"{path}: another decision was written meanwhile. Look at `pido status` and decide again."
            )
        _write(path, json.dumps(record.plain(), sort_keys=True).encode() + b"\n")
    seal(path)


def _hash(written: Mapping[str, Any]) -> str:
    said = {k: v for k, v in written.items() if k != "hash"}
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()


def _write(path: Path, line: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    whole = sum(len(line) + 1 for line in whole_lines(path))
    with path.open("r+b" if path.exists() else "w+b") as handle:
        handle.truncate(whole)
        handle.seek(whole)
        handle.write(line)
        handle.flush()
        os.fsync(handle.fileno())


def _tampered(path: Path, number: int, what: str) -> str:
    return (
        f"{path}, record {number}: {what}, so this log was changed outside the tool. Nothing is promoted on it: "
        "bring the log back from a backup and compare."
    )
