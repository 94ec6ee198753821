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
from prefect.client.schemas.objects import State
from prefect.runtime import flow_run
from prefect.states import Completed

from flows.diagnose import ask, due
from flows.ownership import key
from flows.pages import call, in_markdown
from flows.submit import alive
from flows.turns import take_turn
from pido import departures, parts, production
from pido.core.errors import PidoError, UnavailableError
from pido.tracking import pages, promotion
from pido.tracking.figures import markdown
from pido.tracking.ledger import Ledger
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
def new_part(workspace: str, path: str, machine: str | None = None, patient: bool = False) -> dict[str, Any] | State:
    """One arrival: taken in, or rejected with its reason; then one iteration. Known parts end at once.

    patient : what cannot be read may still be on its way (a slow copy that paused): leave it for a later look
    """
    place = Workspace.open(workspace)
    with alive(place):
        take_turn(place, Path(path), flow_run.id, flow_run.tags, get_run_logger().info)
        try:
            arrived = ingest(workspace, path, machine)
        except parts.Changed as changed:
            return _left(str(changed))
        except parts.Refused as refused:
            if patient:
                return _left(f"It cannot be used as it is, and may still be on its way: {refused}")
            departures.reject(place, Path(path), refused.key, str(refused), move=True, machine=refused.machine)
            raise
        outcome = iteration(workspace, arrived["machine"], arrived["part"], name=arrived["name"], told=arrived["told"])
        departures.put_away(place, Path(path), arrived["key"])
        return outcome


def _left(why: str) -> State:
    """Nothing was decided: the watcher sees the arrival again when it has come to rest."""
    get_run_logger().warning("left in the inbox for a later look. %s", why)
    return Completed(name="LeftForLater", message=f"Left in the inbox for a later look. {why}")


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


def iteration(workspace: str, machine: str, part: str | None, name: str = "", told: str = "") -> dict[str, Any]:
    """The stages of one iteration, inside the machine's lock.

    part, name, told : of the arriving part (`parts.ingest`)
    """
    logger, place = get_run_logger(), Workspace.open(workspace)
    with place.lock(machine):
        run_key = begin(workspace, machine, part)
        new = not production.done(workspace, run_key)
        if new:
            bins(workspace, run_key)
            refit(workspace, run_key)
            balance(workspace, run_key)
            retrain(workspace, run_key)
            evaluate(workspace, run_key)
            publish(workspace, run_key)
        # What was needed on the way stays until all is told: a run that is killed after `publish` owes the rest.
        owed = production.on_its_way(workspace, run_key)
        fault = log(workspace)["fault"]
        outcome = production.outcome(workspace, run_key)
        if not owed:
            said = nothing_new(machine, name, outcome["version"]) + (told and f" {told}.")
            logger.info(said)
            create_markdown_artifact(markdown=in_markdown(said), description=in_markdown(said))  # of this run alone
        if (owed or part is None) and due(workspace, machine) and (missing := ask(place, machine)):
            logger.warning("no diagnosis: %s", missing)
        if owed:
            text, headline = page(place, outcome, fault), _headline(outcome)
            create_markdown_artifact(key=key(place, "iteration", machine), markdown=text, description=headline)
            production.clear(workspace, run_key)
    about = outcome["part"]["name"] if owed or not name else name
    return {"machine": machine, "part": about, "version": outcome["version"], "run_key": run_key, "new": new}


def nothing_new(machine: str, part: str, version: int) -> str:
    """What is said of an iteration that was not needed. part : the known one that came again, '' where none came"""
    came = f"this is part {part} of {machine}, which is known already; " if part else ""
    return (
        f"Nothing new: {came}version {version} is the one of today's parts, settings and accepted physics of {machine}."
    )


def page(place: Workspace, outcome: dict[str, Any], fault: str) -> str:
    """Markdown of a new version: the gate's words, how to decide, where MLflow shows it, and the errors.

    fault : why MLflow has not got everything yet, a sentence, or ''
    """
    machine, version = outcome["machine"], outcome["version"]
    lines = [
        f"# {in_markdown(machine)}, part {_name(outcome)}: version {version}",
        in_markdown(outcome["gate"]["words"]),
    ]
    standing = next(s for s in promotion.standings(place, machine) if s.version.version == version)
    if standing.state == "challenger" and standing.version.gate.get("passed"):
        lines += ["To put it in force, with your name and your reason (or by the deployment `promote`):"]
        lines += [call(place, machine, "approve", str(version))]
    found = Ledger(place.ledger).iteration(outcome["run_key"])
    if fault and (found is None or found in Ledger(place.ledger).not_logged(place.tracking_place)):
        lines += [f"Not in MLflow yet ({in_markdown(fault)})."]
    elif found is not None and (link := pages.address_of(place, found)):
        lines += [f"[Its run in MLflow]({link})"]
    return "\n\n".join([*lines, "\n".join(markdown(outcome["metrics"]))])


def _headline(outcome: dict[str, Any]) -> str:
    """What stands over the list of all iterations."""
    what = in_markdown(f"{outcome['machine']}, part {outcome['part']['name']}, version {outcome['version']}")
    return f"{what}: {in_markdown(outcome['gate']['words'])}"


def _name(outcome: dict[str, Any]) -> str:
    return in_markdown(outcome["part"]["name"])
