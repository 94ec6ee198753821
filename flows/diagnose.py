"""After an iteration: what physics the simulation of the latest parts left out, on Prefect's pages and in MLflow.

In:  a workspace, a machine, how many of its newest parts. Out: `diagnosis/<machine>/` in the workspace with the files
of `pido diagnose`, a markdown artifact, a link, and the same files with the newest run of the machine in MLflow.

It is a run of its own, asked for by the run of the iteration, which goes on without waiting: nothing of the iteration
depends on it. Which parts a folder is about is written into it last, so a diagnosis that was killed is done again, and
one that MLflow has not got is logged by the next call.

One of a machine at a time, whichever worker has it: a second run ends at once, and the first, when it has ended, asks
for one of the parts that have come meanwhile.
"""

from __future__ import annotations

import json
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from prefect import flow, get_run_logger, task
from prefect.artifacts import create_link_artifact, create_markdown_artifact
from prefect.cache_policies import NO_CACHE
from prefect.client.schemas.objects import State
from prefect.runtime import flow_run
from prefect.states import Completed

from flows.ownership import key
from flows.pages import call, in_markdown
from flows.submit import alive, ask_diagnosis
from pido import wanted
from pido.accepted import acceptable
from pido.core.errors import DiagnosisError, UnavailableError
from pido.core.files import write_atomically
from pido.diagnoses import diagnose_into
from pido.diagnosis.finding import Finding
from pido.parts import machine_of
from pido.store import Store
from pido.tracking.diagnoses import attach
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace, code_version

PARTS = 6
"""Of the newest parts that are diagnosed together: enough to judge on parts left out, few enough for minutes."""
MOMENT_S = 2.0
"""Whoever only looks whether a lock is held (`Workspace.locked`) holds it that moment itself, s."""


def due(workspace: str, machine: str, count: int = PARTS) -> bool:
    """Whether the newest parts are not diagnosed yet, or MLflow has not got it."""
    place = Workspace.open(workspace)
    known = _known(place.diagnosis(machine))
    return known.get("of") != _of(place, machine, count) or bool(known.get("fault"))


def ask(place: Workspace, machine: str) -> str:
    """Ask for a diagnosis of the newest parts. Returns why nobody could be asked; the wish stays, and is asked for by
    the watcher."""
    wanted.wish(place, machine, _of(place, machine, PARTS))
    return ask_diagnosis(str(place.root), machine)


@task(name="diagnose", cache_policy=NO_CACHE, persist_result=False)
def find(workspace: str, machine: str, count: int) -> dict[str, Any]:
    """Diagnose the newest parts: {'parts', 'lines', 'notes'}. Parts that cannot be compared are an answer too."""
    place = Workspace.open(workspace)
    recordings = [Store(place.store).load(digest) for digest in _newest(place, machine, count)]
    names = [recording.part.part for recording in recordings]
    try:
        result = diagnose_into(
            place.diagnosis(machine), recordings, made_on=machine, machine=machine_of(place, machine),
            seed=place.settings.seed,
        )  # fmt: skip
    except DiagnosisError as error:
        return {"parts": names, "compared": False, "lines": [], "notes": [str(error)]}
    return {"parts": names, "compared": True, "lines": [*map(line, result.findings)], "notes": list(result.notes)}


@task(name="diagnosis into MLflow", cache_policy=NO_CACHE, persist_result=False)
def log(workspace: str, machine: str) -> tuple[str, str]:
    """(Where MLflow shows it, why MLflow has not got it)."""
    place = Workspace.open(workspace)
    return attach(place, machine, place.diagnosis(machine))


@flow(name="diagnose", flow_run_name="diagnose {machine}", persist_result=False)
def diagnose_newest(workspace: str, machine: str, count: int = PARTS) -> dict[str, Any] | State:
    """Diagnose the newest parts of a machine. What is known already is not searched for again."""
    place = Workspace.open(workspace)
    with alive(place):
        with ExitStack() as turn:
            try:
                turn.enter_context(place.lock(f"diagnosis {machine}", timeout_s=MOMENT_S))
            except UnavailableError:
                return _folded(machine)
            found, link = _found(place, machine, count)
        # Looked at after the turn has ended: who wished before and could not have it has left the wish behind.
        _ask_for_what_came_meanwhile(place, machine, found["of"])
    if found["fault"]:
        get_run_logger().warning("MLflow has not got the diagnosis (%s); the next one brings it", found["fault"])
    about = f"{in_markdown(machine)}: {len(found['lines'])} finding(s) in {len(found['parts'])} part(s)"
    accept = acceptable(place, machine, place.diagnosis(machine)) if found["lines"] else []
    text = page(place, machine, found, accept)
    create_markdown_artifact(key=key(place, "diagnosis", machine), markdown=text, description=about)
    if link:
        text = f"Diagnosis of {in_markdown(machine)}"
        create_link_artifact(
            key=key(place, "diagnosis-report", machine), link=link, link_text=text, description=f"[{text}]({link})"
        )
    return found


def _found(place: Workspace, machine: str, count: int) -> tuple[dict[str, Any], str]:
    """What the diagnosis says, made or known; where MLflow shows it."""
    folder, root = place.diagnosis(machine), str(place.root)
    of, found = _of(place, machine, count), _known(folder)
    wanted.begun(place, machine, of, str(flow_run.id))
    try:
        if found.get("of") != of:
            (folder / "of.json").unlink(missing_ok=True)
            found = {"of": of, **find(root, machine, count)}
        link, found["fault"] = log(root, machine) if found["compared"] else ("", "")
        write_atomically(folder / "of.json", json.dumps(found, sort_keys=True))
    except Exception as error:  # a kill is none: its wish stays as it is
        wanted.failed(place, machine, of, str(error) or type(error).__name__)
        raise
    wanted.done(place, machine, of)
    return found, link


def _folded(machine: str) -> State:
    words = f"A diagnosis of {machine} is at work; when it has ended, it asks for one of what has come meanwhile."
    get_run_logger().info("%s", words)
    return Completed(name="Folded", message=words)


def _ask_for_what_came_meanwhile(place: Workspace, machine: str, of: list[str]) -> None:
    left = wanted.of_machine(place, machine)
    if left is None or left.fault:
        return
    if _of(place, machine, PARTS) == of:
        wanted.done(place, machine, left.of)
    elif missing := ask_diagnosis(str(place.root), machine):
        get_run_logger().warning("no diagnosis of what came meanwhile: %s", missing)


def line(finding: Finding) -> str:
    """A finding as a row of the table on Prefect's pages."""
    fit = finding.fit
    errors = [f"{fit.rmse_before:.3g}", f"{fit.rmse_after:.3g}"] if finding.modelled else ["–", "–"]
    cells = [finding.axis, finding.mechanism, finding.where.summary, *errors]
    return f"| {' | '.join(map(in_markdown, cells))} |"


def page(place: Workspace, machine: str, found: dict[str, Any], accept: list[str]) -> str:
    """Markdown for Prefect's pages. accept : names of the findings that can extend the machine's equation"""
    folder = place.diagnosis(machine)
    table = ["| axis | mechanism | where | RMSE before, A | after, A |", "|---|---|---|---|---|", *found["lines"]]
    body = table if found["lines"] else ["Nothing significant." if found["compared"] else "No answer:"]
    about = f"Newest parts: {in_markdown(', '.join(found['parts']))}."
    where = [f"The whole report: `{folder / 'report.html'}`"] if found["compared"] else []
    for name in accept:
        where.append(f"To make {in_markdown(name)} part of the machine's equation, with your name and your reason:")
        where.append(call(place, machine, "accept-physics", str(folder), "--finding", name))
    notes = map(in_markdown, found["notes"])
    return "\n\n".join([f"# Diagnosis of {in_markdown(machine)}", about, "\n".join(body), *notes, *where])


def _newest(place: Workspace, machine: str, count: int) -> list[str]:
    known = set(Ledger(place.ledger).parts(machine))
    return [e.digest for e in Store(place.store).entries() if e.digest in known][-count:]


def _of(place: Workspace, machine: str, count: int) -> list[str]:
    """What decides a diagnosis: the parts, the settings, the code."""
    return [*_newest(place, machine, count), place.settings_digest(machine), code_version()]


def _known(folder: Path) -> dict[str, Any]:
    try:
        return json.loads((folder / "of.json").read_text(encoding="utf-8"))
    except (FileNotFoundError, json.JSONDecodeError):
        return {}
