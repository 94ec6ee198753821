"""From the watcher to Prefect: one run per arrival, asked for again when a run was lost.

In:  what has arrived, by digest. Out: a flow run, or none where one is waiting or running already; dead runs put right.

The ledger decides whether an arrival still has to be done; a run is only how. A run that says Running while no process
holds its lock is dead (worker and run were killed together): it is set to Crashed here, and asked for again.
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from uuid import NAMESPACE_URL, uuid5

from httpx import HTTPError
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterState, FlowRunFilterStateType, FlowRunFilterTags
from prefect.client.schemas.objects import FlowRun, StateType
from prefect.deployments import run_deployment
from prefect.events import emit_event
from prefect.exceptions import PrefectException
from prefect.runtime import flow_run
from prefect.settings import PREFECT_API_URL
from prefect.states import Crashed

from flows import ownership
from pido import wanted
from pido.arrivals import machine_said
from pido.workspace import Workspace, digest_of, without_secrets

log = logging.getLogger(__name__)
ARRIVAL, MACHINE = "arrival", "machine:"
"""Tags of runs about arrivals, and with what the tag begins that names the machine of each."""
AT_ONCE = 2
"""Runs of a machine's arrivals that are asked for at a time: one at work, one that has started up and waits for its
turn (`flows.turns`). More would only hold the worker's slots against other machines; what waits stays in the inbox."""
DIAGNOSIS = "diagnose"
WAITING = [StateType.SCHEDULED, StateType.PENDING]
BUSY = [StateType.RUNNING, StateType.PENDING, StateType.CANCELLING]
LIVE = [*WAITING, StateType.RUNNING, StateType.PAUSED, StateType.CANCELLING]
DECIDED = [StateType.FAILED, StateType.CANCELLED]
ENDED = [*DECIDED, StateType.COMPLETED, StateType.CRASHED]
LONG_AGO = datetime.min.replace(tzinfo=UTC)
SILENT = timedelta(seconds=30)
STARTING = timedelta(seconds=75)
"""A run that is about to start has no process of its own yet; it is forked within a second (`flows.warm`)."""
SURE_S = 5.0
"""Between a run's last work and its word that it has ended, its process holds no lock for a moment, s."""
AWAY = (HTTPError, PrefectException, OSError, RuntimeError, ownership.NotServedError)
"""What is raised where Prefect's server or the worker is away, or goes away while it is asked."""


def server() -> str:
    """The address of Prefect's API, from the environment or Prefect's own settings; '' where none is named."""
    return PREFECT_API_URL.value() or ""


def fault_of(error: Exception) -> str:
    """One of AWAY in a person's words: whether Prefect is away, or has no worker."""
    if isinstance(error, ownership.NotServedError):
        return f"Prefect is there, but {error} yet"
    said = str(error).strip() or type(error).__name__
    return f"Prefect cannot be reached at {without_secrets(server())} ({said.splitlines()[0]})"


def submit(
    workspace: str, path: str, digest: str, machine: str | None, *, usual: str | None = None, patient: bool = False
) -> bool:
    """Ask for a run for this arrival, unless it has one, or AT_ONCE others of its machine have. Returns whether one was
    asked for.

    machine : of recordings that do not name theirs; `usual`: what the settings say of them, where this says nothing.
        Those for which nobody says one count together
    patient : what cannot be read may still be on its way (`pido.arrivals.may_have_paused`)
    """
    tag, of = f"{ARRIVAL}:{digest[:16]}", MACHINE + (machine_said(Path(path)) or machine or usual or "")
    with get_client(sync_client=True) as client:
        live = runs(client, [ownership.tag(workspace), ARRIVAL])
        if sum(of in run.tags for run in live) >= AT_ONCE or any(tag in run.tags for run in live):
            return False
        if not os.path.lexists(path):
            return False  # looked at after its runs: the last one has taken it away since the inbox was looked at
        ours = ownership.deployment(client, workspace, ownership.ARRIVALS)
    run_deployment(
        ours.id,
        parameters={"workspace": workspace, "path": path, "machine": machine, "patient": patient},
        tags=[ARRIVAL, tag, of],
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


def ask_diagnosis(workspace: str, machine: str, *, instead_of: str | None = None) -> str:
    """Ask for a diagnosis of the machine's newest parts; one that is waiting already will see them too.

    instead_of : the run that was lost, '' where it had not begun; None where none was lost
    Returns why it was not asked for, '' if it was: whatever it is, the iteration is done and stays so.
    """
    tag = _diagnosis_of(machine)
    try:
        with get_client(sync_client=True) as client:
            if not runs(client, [ownership.tag(workspace), tag], WAITING):
                ours = ownership.deployment(client, workspace, DIAGNOSIS)
                parameters = {"workspace": workspace, "machine": machine}
                run_deployment(ours.id, parameters=parameters, tags=[tag], timeout=0, as_subflow=False)
    except ownership.NotServedError as error:
        return str(error)
    except AWAY as error:
        return f"Prefect cannot be asked ({error})"
    wanted.asked(Workspace.open(workspace), machine, instead_of)
    return ""


def ask_again(workspace: Workspace) -> int:
    """Ask once more, and once only, for each diagnosis whose run was lost, and for each that nobody could be asked for.
    Returns for how many. One that failed, that a person cancelled, or whose second run was lost before it began, too,
    is told as failed and not asked for again.

    After `sweep`: a run that says Running without a process counts as one that is at work.
    """
    count = 0
    for one in wanted.wanted(workspace):
        if one.fault or (one.again and one.run):
            continue
        tags = [ownership.tag(workspace.root), _diagnosis_of(one.machine)]
        with get_client(sync_client=True) as client:
            if runs(client, tags):
                continue
            last = max(runs(client, tags, ENDED), key=lambda run: run.created or LONG_AGO, default=None)
        if one.asked and last is not None and last.state is not None and last.state.type in DECIDED:
            said = (last.state.message or "").strip().splitlines()[:1]
            fault = "it was cancelled in Prefect" if last.state.type == StateType.CANCELLED else "".join(said)
            wanted.failed(workspace, one.machine, one.of, fault.rstrip(".") or "see its run in Prefect")
        elif one.again:
            fault = "its run was lost before it began, also when it was asked for again (is a worker there?)"
            wanted.failed(workspace, one.machine, one.of, fault)
        elif missing := ask_diagnosis(str(workspace.root), one.machine, instead_of=one.run if one.asked else None):
            log.warning("no diagnosis of %s yet: %s", one.machine, missing)
        else:
            count += 1
            log.info("asked Prefect to diagnose %s%s", one.machine, " again: its run was lost" if one.asked else "")
    return count


def _diagnosis_of(machine: str) -> str:
    """Tag of the runs that diagnose it."""
    return f"diagnosis:{digest_of(machine)[:16]}"


@contextmanager
def alive(workspace: Workspace) -> Iterator[None]:
    """Around all that a flow does: the lock that tells `sweep` that this run has a process."""
    with workspace.lock(f"run {flow_run.id}"):
        try:
            yield
        finally:
            workspace.forget(f"run {flow_run.id}")


def sweep(workspace: Workspace) -> int:
    """Set runs of this workspace to Crashed that say they have a process and have none: nobody holds the lock that a
    run takes at its start. Returns how many. A run that has just started, is about to, or is just telling its end is
    left alone; so is whatever else is on the server, for its locks are not here.
    """
    ours = [ownership.tag(workspace.root)]
    with get_client(sync_client=True) as client:
        silent = [run for run in runs(client, ours, BUSY) if _without_process(run, workspace)]
        if not silent:
            return 0
        time.sleep(SURE_S)
        dead = [run for run in runs(client, ours, BUSY) if run.id in {s.id for s in silent}]
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


def runs(client: SyncPrefectClient, tags: list[str], states: Sequence[StateType] = LIVE) -> list[FlowRun]:
    """Those that carry all these tags."""
    return client.read_flow_runs(
        flow_run_filter=FlowRunFilter(
            tags=FlowRunFilterTags(all_=tags),
            state=FlowRunFilterState(type=FlowRunFilterStateType(any_=list(states))),
        )
    )
