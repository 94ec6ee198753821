"""An attempt at something, in a process of its own: it ends, or is killed; and what must be the same afterwards.

In:  a workspace, and what is attempted there. Out: whether it ended well; the state that is left.

The process is forked from this one with everything imported, so that a kill at 50 ms hits the work and not Python's
start. It tells MLflow nothing.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pido import plain, production
from pido.store import Store
from pido.tracking import bundle
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

Attempt = Callable[[], None]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one kind of fault."""

    kind: str
    faults: int
    cut_off: int  # attempts that did not reach their end
    lost: int
    doubled: int
    same: bool  # the state at the end is the undisturbed one

    @property
    def clean(self) -> bool:
        return self.same and not self.lost and not self.doubled


def take(place: Workspace, folder: Path) -> None:
    """One part through one iteration; raises where it was not taken."""
    answer = plain.run(place, [folder], None, silent)
    if answer["rejected"]:
        raise RuntimeError(answer["rejected"][0]["reason"])


def taken_in(place: Workspace, folder: Path) -> None:
    """One part through one iteration; raises where it was left alone because it was not at rest."""
    answer = plain.run(place, [folder], None, silent)
    if not answer["done"]:
        raise RuntimeError("not at rest")


def from_inbox(place: Workspace, arrived: Path) -> None:
    """One part out of the inbox; raises where it was not taken. What is refused is on record as rejected."""
    answer = plain.run(place, [arrived], None, silent, from_inbox=True)
    if answer["rejected"]:
        raise RuntimeError(answer["rejected"][0]["reason"])


def silent(done: int, total: int, what: str) -> None:
    """Nobody watches."""


def state(place: Workspace, machine: str) -> dict[str, Any]:
    """What must not depend on any fault: parts in the store and in the ledger, and the content of the last bundle."""
    ledger = Ledger(place.ledger)
    versions = ledger.versions(machine)
    content = bundle.verify(bundle.load(place.bundles, versions[-1].bundle)).content if versions else {}
    return {
        "parts": sorted(ledger.parts(machine)),
        "store": sorted(e.digest for e in Store(place.store).entries()),
        "bundle": json.dumps(content, sort_keys=True, default=str),
        "unfinished": sorted(p.name for p in place.work.iterdir()) if place.work.exists() else [],
    }


def start_process(attempt: Attempt, log: Path | None) -> int:
    """Fork; the child does `attempt` and nothing else. Its words go to `log`. Returns its process id."""
    sys.stdout.flush()
    child = os.fork()
    if child:
        return child
    code = 1
    try:
        out = os.open(log or os.devnull, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        os.dup2(out, 1)
        os.dup2(out, 2)
        production.log = lambda root: {"logged": 0, "fault": ""}
        attempt()
        code = 0
    except BaseException:
        os.write(2, traceback.format_exc().encode())
    finally:
        os._exit(code)


def killed(process: int) -> int:
    """kill -9; 1 if it was still at work, 0 if it had ended already."""
    os.kill(process, signal.SIGKILL)
    return int(os.WIFSIGNALED(os.waitpid(process, 0)[1]))


def ended(process: int) -> bool:
    """Wait for a process; whether it ended well."""
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 0
