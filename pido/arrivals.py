"""The inbox: which files and folders have arrived whole, and in which order they are taken.

In:  a folder that others rename, copy or upload into, looked at again and again.
Out: arrivals that have stopped changing, each with the digest of its bytes, in production order.

Only what was looked at counts, never a notification: what came while nobody watched is found by the next look. No wall
clock is used, so a clock that jumps changes nothing.
"""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import orjson

from pido.core.errors import StoreError
from pido.workspace import arrival_digest, digest_of

PATIENCE = 5
"""What cannot be read is refused only when it has been unchanged for so many times as long as the settings ask for."""
UNFINISHED = (".part", ".partial", ".filepart", ".tmp", ".crdownload", ".swp", "~")
"""Endings under which copying programs write until they are done."""


@dataclass(frozen=True, slots=True)
class Arrived:
    """Something whole in the inbox. `quiet_s`: for how long it has been seen unchanged, s."""

    path: Path
    digest: str
    quiet_s: float


@dataclass(frozen=True, slots=True)
class _Seen:
    state: tuple[tuple[str, int, int, int], ...]
    since: float
    digest: str = ""


def may_have_paused(one: Arrived, settle_s: float) -> bool:
    """Whether what cannot be read may still be on its way, by a slow copy that rests between two files. It is then left
    for a later look; after a long rest it is what it is."""
    return one.quiet_s < PATIENCE * settle_s


class Inbox:
    """Remembers what it saw, so that a growing file is told from a finished one."""

    def __init__(self, folder: Path, settle_s: float) -> None:
        self.folder = folder
        self.settle_s = settle_s
        self._seen: dict[Path, _Seen] = {}

    def look(self) -> tuple[list[Arrived], bool]:
        """(what has arrived whole, in production order; whether something is still on its way)."""
        now = time.monotonic()
        seen: dict[Path, _Seen] = {}
        whole: list[Arrived] = []
        for path in self._candidates():
            state = _state(path)
            before = self._seen.get(path)
            if state is None:
                continue  # vanished while we looked
            if before is None or before.state != state:
                seen[path] = _Seen(state, now)
                continue
            seen[path] = before
            if now - before.since >= self.settle_s:
                digest = before.digest or _digest(path)
                if digest and _state(path) == state:
                    seen[path] = _Seen(state, before.since, digest)
                    whole.append(Arrived(path, digest, now - before.since))
        waiting = len(seen) > len(whole)
        self._seen = seen
        return sorted(whole, key=lambda a: production_order(a.path)), waiting

    def _candidates(self) -> list[Path]:
        if not self.folder.is_dir():
            raise StoreError(f"{self.folder}: no such inbox. Make the folder, or name another one.")
        return [
            p for p in self.folder.iterdir() if not p.name.startswith(".") and not p.name.lower().endswith(UNFINISHED)
        ]


def machine_said(path: Path) -> str:
    """The machine that the part.json of a part that was not read yet names, '' where none does."""
    said = _about(path).get("machine")
    return said if isinstance(said, str) else ""


def production_order(path: Path) -> tuple[float, float, list[tuple[int, int, str]]]:
    """Sort key of a part that was not read yet: `order` and `start_time_s` of its part.json, then its name, with
    numbers in it read as numbers (`part 9` before `part 10`)."""
    order = start = float("inf")
    info = _about(path)
    try:
        order = float(info.get("order", info.get("production_order", order)))
        start = float(info.get("start_time_s", start))
    except (ValueError, TypeError):
        pass  # the reader will complain about it
    pieces = re.findall(r"\d+|\D+", path.name)
    return order, start, [(0, int(p), "") if p.isdigit() and p.isascii() else (1, 0, p) for p in pieces]


def _about(path: Path) -> dict[str, Any]:
    """What the part.json in a folder says; nothing where there is none, or one that the reader will complain about."""
    about = path / "part.json"
    try:
        if path.is_symlink() or about.is_symlink() or not about.is_file():
            return {}
        info = orjson.loads(about.read_bytes())  # nested without end: a ValueError
    except (OSError, ValueError):
        return {}
    return info if isinstance(info, dict) else {}


def _state(path: Path) -> tuple[tuple[str, int, int, int], ...] | None:
    """Name, size, time of change and inode of a file, or of all that is in a folder; None if it vanished."""
    try:
        inside = sorted(path.rglob("*")) if path.is_dir() and not path.is_symlink() else []
        return tuple(
            (str(p), s.st_size, s.st_mtime_ns, s.st_ino)
            for p in (path, *inside)
            for s in (p.stat(follow_symlinks=False),)
        )
    except OSError:
        return None


def _digest(path: Path) -> str:
    """The digest, or '' while the file cannot be read yet (it may still be locked by its writer).

    What is refused for what it is (a link, or one inside) is handed on under a digest of its name: whoever takes it
    says why.
    """
    try:
        return arrival_digest(path)
    except StoreError:
        return digest_of(["refused", str(path)])
    except OSError:
        return ""
