"""After an iteration: what physics the simulation of the latest parts left out, on Prefect's pages and in MLflow.

In:  a workspace, a machine, how many of its newest parts. Out: `diagnosis/<machine>/` in the workspace with the files
of `pido diagnose`, a markdown artifact, and the same files with the newest run of the machine in MLflow.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from prefect import flow, task
from prefect.artifacts import create_markdown_artifact
from prefect.cache_policies import NO_CACHE

from pido.core.errors import DiagnosisError
from pido.core.names import file_name
from pido.diagnosis import contract
from pido.diagnosis.diagnose import diagnose
from pido.parts import machine_of
from pido.reports.diagnosis import diagnosis_page
from pido.reports.page import write_page
from pido.store import Store
from pido.tracking.diagnoses import attach
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

PARTS = 6
"""Of the newest parts that are diagnosed together: enough to judge on parts left out, few enough for minutes."""


@task(name="diagnose", cache_policy=NO_CACHE, persist_result=False)
def find(workspace: str, machine: str, count: int) -> dict[str, Any]:
    """Diagnose the newest parts: {'folder', 'lines', 'notes'}. Parts that cannot be compared are an answer too."""
    place = Workspace.open(workspace)
    known = set(Ledger(place.ledger).parts(machine))
    store = Store(place.store)
    newest = [e.digest for e in store.entries() if e.digest in known][-count:]
    folder = place.root / "diagnosis" / file_name(machine)
    recordings = [store.load(digest) for digest in newest]
    try:
        result = diagnose(recordings, machine=machine_of(place, machine), seed=place.settings.seed)
    except DiagnosisError as error:
        return {"folder": None, "lines": [], "notes": [str(error)]}
    contract.write(result, folder)
    write_page(diagnosis_page(result, recordings), folder / "report.html")
    lines = [
        f"| {f.axis} | {f.mechanism} | {f.where.summary} | {f.fit.rmse_before:.3g} | {f.fit.rmse_after:.3g} |"
        for f in result.findings
    ]
    return {"folder": str(folder), "lines": lines, "notes": list(result.notes)}


@task(name="diagnosis into MLflow", cache_policy=NO_CACHE, persist_result=False)
def log(workspace: str, machine: str, folder: str) -> str:
    """Why MLflow has not got it, or ''."""
    return attach(Workspace.open(workspace), machine, Path(folder))


@flow(name="diagnose", flow_run_name="diagnose {machine}", persist_result=False)
def diagnose_newest(workspace: str, machine: str, count: int = PARTS) -> dict[str, Any]:
    """Diagnose the newest parts of a machine; nothing of the iteration depends on it."""
    found = find(workspace, machine, count)
    fault = log(workspace, machine, found["folder"]) if found["folder"] else ""
    create_markdown_artifact(key="diagnosis", markdown=page(machine, found), description=machine)
    return {**found, "fault": fault}


def page(machine: str, found: dict[str, Any]) -> str:
    """Markdown for Prefect's pages."""
    table = ["| axis | mechanism | where | RMSE before | after |", "|---|---|---|---|---|", *found["lines"]]
    body = table if found["lines"] else ["Nothing significant." if found["folder"] else "No answer:"]
    return "\n".join([f"# Diagnosis of {machine}", "", *body, "", *found["notes"]])
