"""What the lines of a monitor's book say: which alarms there are, what was said of them, what not to learn from.

In:  the book, one JSON line per verdict or answer, oldest first. A line cut short by a dying process is no line.
Out: alarms and answers by identifier, and stretches of parts, in s. Nothing is kept beside the book that could differ.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

log = logging.getLogger(__name__)
Record = dict[str, Any]
BY_NAME, FOLLOWED = "name:", "followed:"
Stretches = dict[str, list[list[float]]]
"""By a part's digest: [start, end], s, in order."""


def followed_as(part: str, began: str) -> str:
    """Stands for the digest of a part that is followed, whose content is not known before it has ended.

    began : digest of its beginning; a recorder may write every part into a file of the same name
    """
    return f"{FOLLOWED}{began}:{part}"


def name_in(digest: str) -> str | None:
    """The name that a part was followed under; None where `digest` is one of content.

    >>> name_in(followed_as("p07", "3fa94c01be")), name_in("3fa94c01be"), name_in("name:p06")  # the last: older books
    ('p07', None, 'p06')
    """
    if digest.startswith(FOLLOWED):
        return digest.split(":", 2)[2]
    return digest.removeprefix(BY_NAME) if digest.startswith(BY_NAME) else None


def read(path: Path) -> list[Record]:
    """Every whole line; none where there is no book yet."""
    if not path.exists():
        return []
    found = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if not line.strip():
            continue
        try:
            found.append(json.loads(line))
        except json.JSONDecodeError:
            log.warning("%s: line %d was left unfinished by a process that died; it is ignored", path, number)
    return found


def alarms(records: Sequence[Record]) -> dict[str, Record]:
    """By identifier: those of every part's newest verdict, and older ones that were answered."""
    answered = said(records)
    newest = {r["digest"]: r for r in records if r["kind"] == "verdict"}
    current = {alarm["id"] for record in newest.values() for alarm in record["alarms"]}
    return {name: alarm for name, alarm in raised(records).items() if name in current or name in answered}


def raised(records: Sequence[Record]) -> dict[str, Record]:
    """By identifier: every alarm there ever was, as it was said last."""
    return {
        alarm["id"]: {**alarm, "part": record["part"], "digest": record["digest"], "at": record.get("at", "")}
        for record in records
        if record["kind"] == "verdict"
        for alarm in record["alarms"]
    }


def unjudged(records: Sequence[Record]) -> set[str]:
    """Digests of parts that no alarm and no verdict speaks of: their newest says neither good nor what was wrong.
    Bands learn from the others, also where a band was too wide to judge them: by these it narrows."""
    newest = {r["digest"]: r for r in records if r["kind"] == "verdict"}
    return {d for d, record in newest.items() if not record.get("familiar", record["good"]) and not record["alarms"]}


def said(records: Sequence[Record]) -> dict[str, Record]:
    """What was said last of each alarm, by its identifier."""
    return {r["alarm"]: r for r in records if r["kind"] == "answer"}


def excluded(path: Path) -> Stretches:
    """The stretches of alarms that were last answered as true: not to be learnt from."""
    try:
        at = path.stat()
    except FileNotFoundError:
        return {}
    return {part: [list(stretch) for stretch in where] for part, where in _excluded(path, at.st_size, at.st_mtime_ns)}


@lru_cache(maxsize=64)
def _excluded(path: Path, size: int, changed_ns: int) -> tuple[tuple[str, tuple[tuple[float, float], ...]], ...]:
    """Of the book in this state: it is asked for with each part, and read once."""
    records = read(path)
    known = alarms(records)
    stretches: dict[str, list[tuple[float, float]]] = {}
    for name, answer in said(records).items():
        if answer["true"] and name in known:
            alarm = known[name]
            stretches.setdefault(alarm["digest"], []).append((alarm["t_start"], alarm["t_end"]))
    return tuple((part, tuple(sorted(where))) for part, where in sorted(stretches.items()))
