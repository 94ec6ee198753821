"""Arrivals that could not be done yet: which are tried again now, and what `pido status` says of the others.

In:  what an inbox holds, look after look, and why tries failed.
Out: what is due; all that is not done, in a file in the workspace's `backlog/`.

An arrival is known by its digest, so one that is brought again otherwise starts afresh. Each further try waits twice as
long as the one before, and never holds up another arrival.
"""

from __future__ import annotations

import json
import logging
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from pido.arrivals import Arrived
from pido.core.files import write_atomically
from pido.workspace import Workspace, digest_of

log = logging.getLogger(__name__)
FIRST_S, LONGEST_S = 2.0, 300.0
"""How long the second try waits, and how long any waits at most, s."""


@dataclass(frozen=True, slots=True)
class Standing:
    """An arrival that is still there. `tries`: 0 while it waits for its turn; `reason`: why it is not done, '' while it
    waits or its first try may be on its way."""

    path: str
    tries: int
    reason: str


class Backlog:
    """Of one inbox. `now`: a clock that never jumps, s."""

    def __init__(self, workspace: Workspace, inbox: Path, now: Callable[[], float] = time.monotonic) -> None:
        self._file = _folder(workspace) / f"{digest_of(str(inbox))[:16]}.json"
        self._now = now
        self._tried: dict[str, Standing] = {}
        self._next: dict[str, float] = {}
        self._here: list[Arrived] = []
        self._held = ""
        self._written: list[Standing] | None = None

    def due(self, arrived: Sequence[Arrived]) -> list[Arrived]:
        """What is to be tried now: what was tried least first, else in the order given. What is gone is forgotten."""
        here, self._here = {one.digest for one in arrived}, list(arrived)
        self._tried = {key: standing for key, standing in self._tried.items() if key in here}
        self._next = {key: when for key, when in self._next.items() if key in here}
        self._write()
        now = self._now()
        waited = [one for one in arrived if self._next.get(one.digest, now) <= now]
        return sorted(waited, key=lambda one: self.tries(one))

    def tries(self, one: Arrived) -> int:
        """How often this arrival was tried."""
        known = self._tried.get(one.digest)
        return 0 if known is None else known.tries

    def tried(self, one: Arrived, reason: str = "") -> float:
        """It was tried, and is not done for this reason. Returns after how long it is tried again, s."""
        tries = self.tries(one) + 1
        wait = min(FIRST_S * 2.0 ** (tries - 1), LONGEST_S)
        self._tried[one.digest] = Standing(str(one.path), tries, reason)
        self._next[one.digest] = self._now() + wait
        self._write()
        return wait

    def held(self, reason: str) -> None:
        """Nothing can be tried for this reason, '' where that is over."""
        self._held = reason
        self._write()

    def reason(self, one: Arrived) -> str:
        """Why this arrival could not be done, '' where nothing is known against it."""
        known = self._tried.get(one.digest)
        return known.reason or self._held if known else self._held

    def _write(self) -> None:
        standing = [Standing(str(one.path), self.tries(one), self.reason(one)) for one in self._here]
        if standing == self._written:
            return
        try:
            write_atomically(self._file, json.dumps([asdict(one) for one in standing]))
            self._written = standing
        except OSError as error:  # a full disk is often why an arrival stands; its watcher goes on
            log.warning("%s: cannot be written (%s); `pido status` does not say what stands", self._file, error)


def standing(workspace: Workspace) -> list[Standing]:
    """What stands in the inboxes of a workspace, by name."""
    kept = [json.loads(file.read_text(encoding="utf-8")) for file in sorted(_folder(workspace).glob("*.json"))]
    found = [Standing(**one) for inbox in kept for one in inbox]
    return sorted((one for one in found if os.path.lexists(one.path)), key=lambda one: one.path)


def _folder(workspace: Workspace) -> Path:
    return workspace.root / "backlog"
