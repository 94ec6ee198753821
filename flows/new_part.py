"""A part through one iteration under Prefect: the path of `pido iterate`, one task per stage.

In:  a workspace and the path of what arrived. Out: a run whose tasks, retries and artifact are on Prefect's pages; the
result itself is in the workspace, bit for bit the one of the plain call. Paths and digests are handed on, never data.

Its physics is looked at in a run of its own (`flows.diagnose`), which is asked for and not waited for.

One run per machine at a time is held by the workspace's own lock, which the kernel frees when a run is killed. A stage
that failed for want of a disk or a server is tried again; input that cannot be used is not.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from prefect import flow, get_run_logger, task
from prefect.artifacts import create_markdown_artifact
from prefect.cache_policies import NO_CACHE
from prefect.runtime import flow_run

from flows.diagnose import due, in_markdown
from flows.submit import alive, ask_diagnosis
from pido import departures, parts, production
from pido.core.errors import PidoError, UnavailableError
from pido.tracking.figures import markdown
from pido.workspace import Workspace


def _worth_another_try(task: Any, run: Any, state: Any) -> bool:
    """Whether a failed stage may succeed when it is done again: not for input, settings or decisions."""
    failure = state.result(raise_on_failure=False)
    return not isinstance(failure, PidoError) or isinstance(failure, UnavailableError)


_STAGE: dict[str, Any] = {
    "retries": 2,
    "retry_delay_seconds": [1, 5],
    "retry_condition_fn": _worth_another_try,
    "cache_policy": NO_CACHE,
    "persist_result": False,
}

ingest = task(name="ingest", **_STAGE)(production.ingest)
begin = task(name="plan", **_STAGE)(production.begin)
bins = task(name="relevant bins", **_STAGE)(production.bins)
refit = task(name="refit", **_STAGE)(production.refit)
balance = task(name="PiA and PiE", **_STAGE)(production.balance)
retrain = task(name="retrain", **_STAGE)(production.retrain)
evaluate = task(name="evaluate", **_STAGE)(production.evaluate)
publish = task(name="publish", **_STAGE)(production.publish)
log = task(name="log", **_STAGE)(production.log)


def _named() -> str:
    """Runs are listed by what arrived, not by where it lies."""
    return Path(flow_run.parameters["path"]).name


@flow(name="new-part", flow_run_name=_named, persist_result=False)
def new_part(workspace: str, path: str, machine: str | None = None) -> dict[str, Any]:
    """One arrival: taken in, or rejected with its reason; then one iteration. Known parts end at once."""
    place = Workspace.open(workspace)
    with alive(place):
        try:
            arrived = ingest(workspace, path, machine)
        except parts.Refused as refused:
            departures.reject(place, Path(path), refused.key, str(refused), move=True)
            raise
        outcome = iteration(workspace, arrived["machine"], arrived["part"])
        departures.put_away(place, Path(path), arrived["key"])
        return outcome


@flow(name="retrain", flow_run_name="retrain {machine}", persist_result=False)
def retrain_machine(workspace: str, machine: str) -> dict[str, Any]:
    """Bring a machine's challenger up to its parts and settings, also when nothing arrived."""
    with alive(Workspace.open(workspace)):
        return iteration(workspace, machine, None)


@flow(name="nightly", persist_result=False)
def nightly(workspace: str) -> list[dict[str, Any]]:
    """Every machine of the workspace once, and whatever MLflow has not got yet; at the end, which machines failed."""
    with alive(Workspace.open(workspace)):
        return production.every_machine(workspace, lambda machine: iteration(workspace, machine, None), log)[0]


def iteration(workspace: str, machine: str, part: str | None) -> dict[str, Any]:
    """The stages of one iteration, inside the machine's lock."""
    logger, place = get_run_logger(), Workspace.open(workspace)
    with place.lock(machine):
        key = begin(workspace, machine, part)
        if production.done(workspace, key):
            logger.info("nothing new: this state is known")
        else:
            bins(workspace, key)
            refit(workspace, key)
            balance(workspace, key)
            retrain(workspace, key)
            evaluate(workspace, key)
            publish(workspace, key)
            production.clear(workspace, key)
        log(workspace)
    if due(workspace, machine) and (fault := ask_diagnosis(str(place.root), machine)):
        logger.warning("no diagnosis: %s", fault)
    outcome = production.outcome(workspace, key)
    create_markdown_artifact(key="iteration", markdown=_page(outcome), description=_headline(outcome))
    return {"machine": machine, "part": outcome["part"]["name"], "version": outcome["version"], "run_key": key}


def _headline(outcome: dict[str, Any]) -> str:
    """What stands over the list of all iterations."""
    return f"{_name(outcome)}, version {outcome['version']}: {outcome['gate']['words']}"


def _page(outcome: dict[str, Any]) -> str:
    head = [f"# {_name(outcome)}: version {outcome['version']}", "", outcome["gate"]["words"], ""]
    return "\n".join([*head, *markdown(outcome["metrics"])])


def _name(outcome: dict[str, Any]) -> str:
    return in_markdown(outcome["part"]["name"])
