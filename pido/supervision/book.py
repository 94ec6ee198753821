"""The book of a machine's monitor: verdicts, alarms and the answers to them, one JSON line each, never changed.

In:  records.
Out: the same records, and what they say of alarms (`pido.monitoring.records`).

A line is written under a lock in one call and flushed to disk; a line that a dying process left unfinished is ended and
ignored. Watching the same part again with the same outcome writes nothing.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from urllib.parse import unquote

from pido.core.clock import utc_now
from pido.core.errors import RegistryError
from pido.monitoring import records
from pido.monitoring.alarms import Alarm
from pido.monitoring.answers import Answer
from pido.store import Store
from pido.tracking.ledger import Ledger
from pido.tracking.promotion import check_person
from pido.tracking.withdrawn import withdrawn
from pido.workspace import Workspace, digest_of

_ALARM = ("part", "axis", "t_start", "t_end", "tool", "block", "size_a", "spreads")


class Book:
    """Records of one machine, oldest first."""

    def __init__(self, workspace: Workspace, machine: str) -> None:
        self._workspace, self.machine = workspace, machine
        self.path = workspace.book(machine)

    def records(self) -> list[dict[str, Any]]:
        """Every whole line."""
        return records.read(self.path)

    def verdict(self, record: dict[str, Any]) -> None:
        """A part was judged. The newest record of a part counts."""
        known = [r for r in self.records() if r["kind"] == "verdict" and r["digest"] == record["digest"]]
        if known and {k: v for k, v in known[-1].items() if k not in ("at", "kind")} == record:
            return
        self._append({"kind": "verdict", **record})

    def answer(self, alarm: str, *, true: bool, by: str, reason: str) -> dict[str, Any]:
        """Somebody says what an alarm was; said again, the newer answer counts. Returns the alarm's record.

        Raises RegistryError for an alarm that is not known, an answer without a name or a reason, or without the
        credential that approval asks for: an answer decides what the next models learn from.
        """
        check_person(self._workspace, by, reason)
        known = self.raised()
        if alarm not in known:
            raise RegistryError(f"machine {self.machine}: no alarm '{alarm}'. Known: {', '.join(known) or 'none'}.")
        self._append({"kind": "answer", "alarm": alarm, "true": true, "by": by, "reason": reason})
        return known[alarm]

    def alarms(self) -> dict[str, dict[str, Any]]:
        """By identifier: those of every part's newest verdict, and older ones that were answered."""
        return records.alarms(self.records())

    def raised(self) -> dict[str, dict[str, Any]]:
        """By identifier: all that can be answered, of verdicts that a newer one has replaced too."""
        return records.raised(self.records())

    def answers(self) -> list[Answer]:
        """What was said last of each alarm; `Alarm.part` is the part's digest."""
        alarms, owner = self.alarms(), self._owners()
        return [
            Answer(_as_alarm(alarms[i], owner(alarms[i])), r["true"], r["by"], r["reason"])
            for i, r in self._said().items()
            if i in alarms
        ]

    def answered(self) -> dict[str, str]:
        """What was said last of each alarm, or of its part where that was withdrawn, in words."""
        gone, owner = withdrawn(self._workspace, self.machine), self._owners()
        out = {i: gone[part] for i, alarm in self.raised().items() if (part := owner(alarm)) in gone} if gone else {}
        said = {i: f"{'true' if r['true'] else 'false'} alarm, says {r['by']}" for i, r in self._said().items()}
        return {i: f"withdrawn with its part, says {record.by}" for i, record in out.items()} | said

    def open_alarms(self) -> list[Alarm]:
        """Alarms that nobody has answered yet, `part` being the digest; none of parts that are withdrawn."""
        alarms = self.alarms()
        if not alarms:
            return []
        answered, owner, gone = self._said(), self._owners(), withdrawn(self._workspace, self.machine)
        return [
            _as_alarm(alarm, part)
            for name, alarm in alarms.items()
            if name not in answered and (part := owner(alarm)) not in gone
        ]

    def unjudged(self) -> set[str]:
        """Digests of parts of which the newest verdict says that they could not be judged."""
        owner = self._owners()
        verdicts = [r for r in self.records() if r["kind"] == "verdict"]
        return records.unjudged([{**r, "digest": owner(r)} for r in verdicts])

    def learnt_from(self, digest: str) -> bool:
        """Whether this part was taken in and went through an iteration, so that model and band know it."""
        known = Ledger(self._workspace.ledger).iterations(self.machine)
        return self._owners()({"digest": digest}) in {iteration.part for iteration in known}

    def _owners(self) -> Callable[[Mapping[str, Any]], str]:
        """From a record to the digest of its part. Of a part that was followed: of the one that was taken in under its
        name, if there is one; a verdict from before that was withdrawn is no word on its successor."""
        stored = {e.part: e.digest for e in Store(self._workspace.store).entries(self.machine)}
        gone = withdrawn(self._workspace, self.machine).values()

        def owner(record: Mapping[str, Any]) -> str:
            digest = str(record["digest"])
            name = records.name_in(digest)
            if name is None:
                return digest
            before = [r.part for r in gone if r.name == name and record.get("at", "~") <= r.at]
            return before[0] if before else stored.get(name, digest)

        return owner

    def _said(self) -> dict[str, dict[str, Any]]:
        return records.said(self.records())

    def _append(self, record: dict[str, Any]) -> None:
        line = json.dumps({**record, "at": utc_now()}, sort_keys=True)
        with self._held() as handle:
            torn = handle.tell() > 0 and self.path.read_bytes()[-1:] != b"\n"
            handle.write(("\n" if torn else "") + line + "\n")
            handle.flush()
            os.fsync(handle.fileno())

    @contextmanager
    def _held(self) -> Iterator[Any]:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a", encoding="utf-8") as handle:
            fcntl.flock(handle, fcntl.LOCK_EX)
            handle.seek(0, os.SEEK_END)
            yield handle


def alarm_id(machine: str, digest: str, alarm: Alarm) -> str:
    """The same alarm of the same part has the same identifier, from its beginning on."""
    return digest_of([machine, digest, alarm.axis, round(alarm.t_start, 1)])[:10]


def _as_alarm(record: dict[str, Any], part: str) -> Alarm:
    """An alarm from its record. part : its digest"""
    return Alarm(**{**{name: record[name] for name in _ALARM}, "part": part})


def find_alarm(workspace: Workspace, alarm: str) -> Book:
    """The book that holds an alarm. Raises RegistryError where none does."""
    for path in sorted(workspace.monitor.glob("*/book.jsonl")):
        book = Book(workspace, unquote(path.parent.name))
        if alarm in book.raised():
            return book
    raise RegistryError(
        f"{workspace.root}: no alarm '{alarm}' here. `pido monitor PART` shows the identifiers of its alarms."
    )
