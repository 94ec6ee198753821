"""The audit log: who decided what, when and why. It is appended to and never rewritten; each record carries the hash
of the one before, so that a change, a removal or a swap anywhere in it shows.

In:  decisions. Out: records, one JSON line each.
A record cut short by a crash is no record: the next append removes the torn tail.
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

from pido.core.errors import RegistryError

GENESIS = "0" * 64


@dataclass(frozen=True, slots=True)
class Record:
    """One decision. `hash` is the SHA-256 of all other fields; `previous` the hash of the record before."""

    number: int
    action: str  # approve, reject, rollback
    machine: str
    version: int
    bundle: str
    by: str
    reason: str
    at: str  # UTC, ISO 8601
    previous: str
    hash: str = ""

    def sealed(self) -> Record:
        fields = {k: v for k, v in asdict(self).items() if k != "hash"}
        return Record(**fields, hash=hashlib.sha256(json.dumps(fields, sort_keys=True).encode()).hexdigest())


def read(path: Path) -> list[Record]:
    """All records, checked. Raises RegistryError naming the first record that was tampered with."""
    records: list[Record] = []
    for number, line in enumerate(_whole_lines(path), start=1):
        try:
            record = Record(**json.loads(line))
        except (json.JSONDecodeError, TypeError):
            raise RegistryError(_tampered(path, number, "it cannot be read")) from None
        before = records[-1].hash if records else GENESIS
        if record.sealed().hash != record.hash:
            raise RegistryError(_tampered(path, number, "its content does not match its hash"))
        if record.previous != before or record.number != number:
            raise RegistryError(_tampered(path, number, "it does not follow the record before it"))
        records.append(record)
    return records


def next_record(
    path: Path, *, action: str, machine: str, version: int, bundle: str, by: str, reason: str, at: str
) -> Record:
    """The record that would be appended now."""
    records = read(path)
    previous = records[-1].hash if records else GENESIS
    return Record(len(records) + 1, action, machine, version, bundle, by, reason, at, previous).sealed()


def append(path: Path, record: Record) -> None:
    """Write `record` and see it on the disk. Once is enough: a record that is there already is left alone.

    Raises RegistryError if the log has moved on since the record was made. The caller holds the machine's lock.
    """
    records = read(path)
    if records and records[-1] == record:
        return
    if record.previous != (records[-1].hash if records else GENESIS):
        raise RegistryError(f"{path}: another decision was written meanwhile. Look at `pido status` and decide again.")
    path.parent.mkdir(parents=True, exist_ok=True)
    whole = b"".join(line + b"\n" for line in _whole_lines(path))
    with path.open("r+b" if path.exists() else "w+b") as handle:
        handle.truncate(len(whole))
        handle.seek(len(whole))
        handle.write(json.dumps(asdict(record), sort_keys=True).encode() + b"\n")
        handle.flush()
        os.fsync(handle.fileno())


def _whole_lines(path: Path) -> list[bytes]:
    if not path.exists():
        return []
    return path.read_bytes().split(b"\n")[:-1]  # what follows the last line feed was cut short


def _tampered(path: Path, number: int, what: str) -> str:
    return (
        f"{path}, record {number}: {what}, so this log was changed outside the tool. Nothing is promoted on it: "
        "bring the log back from a backup and compare."
    )
