"""`pido watch`: see parts arrive in an inbox and run an iteration for each."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pido.cli.inputs import Input
from pido.cli.places import workspace_option

if TYPE_CHECKING:
    from pido.arrivals import Arrived
    from pido.backlog import Backlog
    from pido.workspace import Workspace

log = logging.getLogger(__name__)
BEAT_S = 10.0
FIRST_WORD_S, LAST_WORD_S = 60.0, 3600.0
"""After which time a state that lasts is told again, and the longest such time, s."""
SWEEP_S = 30.0
"""How often runs without a process are looked for, their diagnoses asked for anew, MLflow told what it missed, s."""


@click.command()
@click.argument("inbox", type=Input(file_okay=False))
@workspace_option
@click.option("--machine", default=None, help="machine of recordings that do not name theirs")
@click.option("--prefect", is_flag=True, help="run each part as a flow on the Prefect server (PREFECT_API_URL)")
@click.option("--once", is_flag=True, help="take what has arrived, then end")
def command(inbox: Path, folder: Path, machine: str | None, prefect: bool, once: bool) -> None:
    """Files and folders that appear in INBOX, by rename, slow copy or upload, each go through one iteration.

    What came while nobody watched is found at the start. A part that arrives twice counts once. What cannot be used
    goes to the rejected area with its reason. Parts of one machine are done one after another, in production order.
    One whose iteration fails holds up no other: it is tried again, more and more seldom, and `pido status` names it.

    \b
    pido watch plant/inbox --workspace plant
    pido watch plant/inbox --workspace plant --once
    """
    from pido.arrivals import Inbox
    from pido.backlog import Backlog
    from pido.core.errors import InputError, PidoError
    from pido.departures import bring_back
    from pido.workspace import Workspace

    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    for chatty in ("httpx", "watchfiles"):
        logging.getLogger(chatty).setLevel(logging.WARNING)
    if prefect:
        _named_server()
    workspace, inbox = Workspace.open(folder), inbox.absolute()  # a worker may have been started elsewhere
    place, root = inbox.resolve(), workspace.root.resolve()
    if root.is_relative_to(place) or (place.is_relative_to(root) and not place.is_relative_to(root / "inbox")):
        raise InputError(f"{inbox}: belongs to the workspace, or holds it. Watch {workspace.inbox}, or one elsewhere.")
    backlog = Backlog(workspace, inbox)
    take = (_through_prefect if prefect else _in_this_process)(workspace, machine, backlog)
    watched = Inbox(inbox, workspace.settings.settle_s)
    stirred = threading.Event()
    due = _every(SWEEP_S)
    _beat(workspace.root / "watcher.alive")
    if not once:
        _listen(inbox, stirred)
    while True:
        stirred.clear()
        held = bring_back(workspace, inbox)
        arrived, waiting = watched.look()
        take(arrived)
        if due():
            _tell_mlflow(workspace)
        left = [one for one in arrived if os.path.lexists(one.path)]
        waiting |= held and not left
        if once and not waiting and all(backlog.reason(one) for one in left):
            if left:
                faults = "\n".join(f"  {one.path.name}: {backlog.reason(one)}" for one in left)
                raise PidoError(f"{inbox}: {len(left)} arrival(s) are still to be done:\n{faults}")
            return
        stirred.wait(min(workspace.settings.settle_s, 1.0) if waiting or left else workspace.settings.scan_s)


def _in_this_process(workspace: Workspace, machine: str | None, backlog: Backlog) -> Callable[[list[Arrived]], None]:
    from pido.arrivals import may_have_paused
    from pido.core.errors import PidoError
    from pido.core.files import refusal
    from pido.plain import run

    def take(arrived: list[Arrived]) -> None:
        for one in backlog.due(arrived):
            try:
                patient = may_have_paused(one, workspace.settings.settle_s)
                answer = run(workspace, [one.path], machine, _silent, from_inbox=True, patient=patient)
            except Exception as error:  # a fault of this program that one part meets holds up no other
                expected = isinstance(error, PidoError | OSError)
                said = refusal(error) if isinstance(error, OSError) else str(error)
                name = type(error).__name__
                reason = said or name if expected else f"internal error ({name}: {error})"
                again = backlog.tried(one, reason)
                line = "%s is still to be done, and tried again in %.0f s: %s"
                log.warning(line, one.path.name, again, reason, exc_info=not expected)
                continue
            for done in answer["done"]:
                log.info("%s: version %d of %s", one.path.name, done["version"], done["machine"])
            for refused in answer["rejected"]:
                log.warning("%s", refused["reason"])

    return take


def _silent(done: int, total: int, what: str) -> None:
    """Nobody watches a watcher's progress: its log says what was done."""


def _through_prefect(workspace: Workspace, machine: str | None, backlog: Backlog) -> Callable[[list[Arrived]], None]:
    from flows.submit import AWAY, ask_again, fault_of, submit, sweep
    from pido.arrivals import may_have_paused

    due, tell = _every(SWEEP_S), _Told()

    def take(arrived: list[Arrived]) -> None:
        # A server that is away for a while is no reason to stop watching: what has arrived is still there.
        asked = False
        try:
            for one in backlog.due(arrived):
                before, patient = backlog.tries(one), may_have_paused(one, workspace.settings.settle_s)
                if before and patient:
                    continue  # one run has looked at it; the next one decides, when it has rested for long
                asked = True
                place, usual = str(workspace.root), workspace.settings.machine
                if submit(place, str(one.path), one.digest, machine, usual=usual, patient=patient):
                    backlog.tried(one, f"{before} run(s) have not taken it: see its runs in Prefect" if before else "")
            if due():
                asked = True
                sweep(workspace)
                ask_again(workspace)
        except AWAY as error:
            backlog.held(fault_of(error))
            tell(f"{fault_of(error)}; what has arrived waits, and is asked for then")
        else:
            if asked:
                backlog.held("")
                tell("")

    return take


def _named_server() -> None:
    """Raises SettingsError where no server is named: Prefect would start one, which ends with this process."""
    from flows.submit import server
    from pido.core.errors import SettingsError

    if not server():
        raise SettingsError(
            "PREFECT_API_URL is not set: name the Prefect server, as in `export "
            "PREFECT_API_URL=http://127.0.0.1:4200/api`, or leave out --prefect."
        )


class _Told:
    """Warns of a state that lasts: when it begins, then less and less often, and when it is over."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now, self._said, self._wait, self._next = now, "", 0.0, 0.0

    def __call__(self, words: str) -> None:
        """words : the state as it is now, '' where there is nothing to warn of"""
        now, new = self._now(), words != self._said
        if words and (new or now >= self._next):
            self._wait = FIRST_WORD_S if new else min(2 * self._wait, LAST_WORD_S)
            self._next = now + self._wait
            log.warning("%s", words)
        elif new:
            log.info("that is over: %s", self._said.partition(";")[0])
        self._said = words


def _every(seconds: float) -> Callable[[], bool]:
    """Says yes at most once in `seconds`, and the first time it is asked."""
    last = [-seconds]

    def due() -> bool:
        now = time.monotonic()
        if now - last[0] < seconds:
            return False
        last[0] = now
        return True

    return due


def _tell_mlflow(workspace: Workspace) -> None:
    """What MLflow missed while it was away; in a process of its own, for a watcher stays small for months."""
    from pido.core.errors import PidoError
    from pido.tracking.mirror import up_to_date
    from pido.tracking.whereabouts import named_nowhere

    try:
        known = bool(named_nowhere(workspace)) or up_to_date(workspace)  # each iteration says that it is not logged
    except PidoError as error:
        log.warning("whether MLflow has missed anything is not known: %s", error)
        return
    if not known:
        call = [sys.executable, "-c", "import sys; from pido.production import log; log(sys.argv[1])"]
        subprocess.run([*call, str(workspace.root)], check=False)


def _listen(inbox: Path, stirred: threading.Event) -> None:
    """Look at once when something stirs; where the system tells nothing (network folders), the timer does it."""
    from watchfiles import watch

    def wait_for_changes() -> None:
        for _ in watch(inbox, recursive=True, step=200, rust_timeout=5000, yield_on_timeout=False):
            stirred.set()

    threading.Thread(target=wait_for_changes, daemon=True).start()


def _beat(path: Path) -> None:
    def beat() -> None:
        while True:
            path.touch()
            time.sleep(BEAT_S)

    threading.Thread(target=beat, daemon=True).start()
