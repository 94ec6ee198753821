"""From the watcher to Prefect: one run per arrival, asked for again when a run was lost.

In:  what has arrived, by digest. Out: a flow run, or none where one is waiting or running already; dead runs put right.

The ledger decides whether an arrival still has to be done; a run is only how. A run that says Running while no process
holds its lock is dead (worker and run were killed together): it is set to Crashed here, and asked for again.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from uuid import NAMESPACE_URL, uuid5

from httpx import HTTPError
from prefect.client.orchestration import get_client
from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterState, FlowRunFilterStateType, FlowRunFilterTags
from prefect.client.schemas.objects import FlowRun, StateType
from prefect.deployments import run_deployment
from prefect.events import emit_event
from prefect.exceptions import ObjectNotFound, PrefectException
from prefect.runtime import flow_run
from prefect.states import Crashed

from pido.workspace import Workspace, digest_of

log = logging.getLogger(__name__)
DEPLOYMENT = "new-part/arrivals"
ARRIVAL = "arrival"
AT_ONCE = 2
"""Runs of arrivals that are asked for at a time: one at work, one that has started up and waits for the machine. More
would only hold the worker's slots against diagnoses, approvals and the night; what waits stays in the inbox."""
DIAGNOSIS = "diagnose/newest"
WAITING = [StateType.SCHEDULED, StateType.PENDING]
BUSY = [StateType.RUNNING, StateType.PENDING, StateType.CANCELLING]
LIVE = [*WAITING, StateType.RUNNING, StateType.PAUSED, StateType.CANCELLING]
SILENT = timedelta(seconds=30)
STARTING = timedelta(seconds=75)
"""A run that is about to start has no process of its own yet; it is forked within a second (`flows.warm`)."""
SURE_S = 5.0
"""Between a run's last work and its word that it has ended, its process holds no lock for a moment, s."""
AWAY = (HTTPError, PrefectException, OSError, RuntimeError)
"""What is raised where Prefect's server is away, or goes away while it is asked."""


def submit(workspace: str, path: str, digest: str, machine: str | None) -> bool:
    """Ask for a run for this arrival, unless it has one, or AT_ONCE others have. Returns whether one was asked for."""
    tag = f"{ARRIVAL}:{digest[:16]}"
    live = _runs(ARRIVAL)
    if len(live) >= AT_ONCE or any(tag in run.tags for run in live):
        return False
    run_deployment(
        DEPLOYMENT,
        parameters={"workspace": workspace, "path": path, "machine": machine},
        tags=[ARRIVAL, tag],
        timeout=0,
    )
    emit_event(
        "pido.part.arrived",
        resource={"prefect.resource.id": f"pido.arrival.{digest[:16]}"},
        payload={"workspace": workspace, "path": path},
        id=uuid5(NAMESPACE_URL, digest),
    )
    log.info("asked Prefect to run %s (%s)", path, tag)
    return True


def ask_diagnosis(workspace: str, machine: str) -> str:
    """Ask for a diagnosis of the machine's newest parts; one that is waiting already will see them too.

    Returns why it was not asked for, '' if it was: whatever it is, the iteration is done and stays so.
    """
    tag = f"diagnosis:{digest_of(machine)[:16]}"
    try:
        if not _runs(tag, WAITING):
            parameters = {"workspace": workspace, "machine": machine}
            run_deployment(DIAGNOSIS, parameters=parameters, tags=[tag], timeout=0, as_subflow=False)
    except ObjectNotFound:
        return f"no worker serves {DIAGNOSIS}"
    except AWAY as error:
        return f"Prefect cannot be asked ({error})"
    return ""


@contextmanager
def alive(workspace: Workspace) -> Iterator[None]:
    """Around all that a flow does: the lock that tells `sweep` that this run has a process."""
    with workspace.lock(f"run {flow_run.id}"):
        try:
            yield
        finally:
            workspace.forget(f"run {flow_run.id}")


def sweep(workspace: Workspace) -> int:
    """Set runs to Crashed that say they have a process and have none: nobody holds the lock that a run takes at its
    start. Returns how many. A run that has just started, is about to, or is just telling its end is left alone.
    """
    with get_client(sync_client=True) as client:
        silent = [run for run in _runs(None, BUSY, client) if _without_process(run, workspace)]
        if not silent:
            return 0
        time.sleep(SURE_S)
        dead = [run for run in _runs(None, BUSY, client) if run.id in {s.id for s in silent}]
        dead = [run for run in dead if _without_process(run, workspace)]
        for run in dead:
            client.set_flow_run_state(run.id, Crashed(message="its process is gone"), force=True)
            log.warning("run %s had no process any more: set to Crashed", run.name)
    return len(dead)


def _without_process(run: FlowRun, workspace: Workspace) -> bool:
    assert run.state is not None
    starting = run.state.type == StateType.PENDING
    silent = datetime.now(UTC) - run.state.timestamp > (STARTING if starting else SILENT)
    return silent and not workspace.locked(f"run {run.id}")


def _runs(tag: str | None, states: Sequence[StateType] = LIVE, client=None) -> list[FlowRun]:
    wanted = FlowRunFilter(
        tags=FlowRunFilterTags(all_=[tag]) if tag else None,
        state=FlowRunFilterState(type=FlowRunFilterStateType(any_=list(states))),
    )
    if client is not None:
        return client.read_flow_runs(flow_run_filter=wanted)
    with get_client(sync_client=True) as own:
        return own.read_flow_runs(flow_run_filter=wanted)
