"""Whose turn it is among the arrivals of a machine that runs were asked for together: production order decides, not
which of their processes Prefect starts first.

In:  what this run is about, and the machine's other runs on the server. Out: it returns when those before it in
production order have ended.

An earlier run that fails, is cancelled or is killed has ended, too: nobody waits for a part that is not coming. A run
that has no process (killed, or not started at all) is waited for only as long as a start may take.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from prefect.client.orchestration import get_client
from prefect.client.schemas.objects import FlowRun

from flows import ownership
from flows.submit import ARRIVAL, MACHINE, STARTING, runs
from pido.arrivals import production_order
from pido.workspace import Workspace

LOOK_S = 0.5
Order = tuple[float, float, list[tuple[int, int, str]]]


def take_turn(
    workspace: Workspace,
    path: Path,
    run: str | None,
    tags: Sequence[str],
    on_wait: Callable[[str], None] = lambda words: None,
) -> None:
    """Wait until no other run of this machine is about an arrival that comes before `path` in production order.

    run, tags : this run's id and what it was tagged with when it was asked for (`flows.submit`). One that names no
        machine, as a run that a person started on Prefect's pages, waits for nobody.
    on_wait : told whom it waits for, in words, once
    """
    machine = [tag for tag in tags if tag.startswith(MACHINE)]
    if not machine:
        return
    mine, began, told = production_order(path), time.monotonic(), False
    while earlier := _before(workspace, run, machine, mine):
        if time.monotonic() - began > STARTING.total_seconds():
            earlier = [one for one in earlier if workspace.locked(f"run {one.id}")]
            if not earlier:
                return
        if not told:
            first = ", ".join(sorted({_path(one).name for one in earlier}))
            on_wait(f"before {path.name} comes {first}, which a run is about; it is waited for")
            told = True
        time.sleep(LOOK_S)


def _before(workspace: Workspace, run: str | None, machine: list[str], mine: Order) -> list[FlowRun]:
    with get_client(sync_client=True) as client:
        live = runs(client, [ownership.tag(workspace.root), ARRIVAL, *machine])
    # What has left the inbox is done, and its run about to end.
    others = [one for one in live if str(one.id) != run and _path(one).exists()]
    return [one for one in others if production_order(_path(one)) < mine]


def _path(run: FlowRun) -> Path:
    return Path(run.parameters.get("path", ""))
