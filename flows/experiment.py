"""An experiment as a run: what `pido experiment` does, started from Prefect's pages and repeatable.

In:  a workspace, the name of an experiment, its data. Out: `experiments/<name>/` in the workspace with results and
report, and an artifact with the verdict. A run that was killed continues where it was when it is started again.
"""

from __future__ import annotations

import io
import json
from contextlib import redirect_stdout
from typing import Any

from prefect import flow, task
from prefect.artifacts import create_markdown_artifact
from prefect.cache_policies import NO_CACHE

from flows.ownership import key
from flows.submit import alive
from pido.cli.experiment import command
from pido.workspace import Workspace


@task(name="experiment", cache_policy=NO_CACHE, persist_result=False)
def run(workspace: str, arguments: list[str]) -> list[dict[str, Any]]:
    """Verdict and tables per data set, by the command itself; its files go to the workspace."""
    out = Workspace.open(workspace).root / "experiments"
    said = io.StringIO()
    with redirect_stdout(said):
        command.main([*arguments, "--out", str(out), "--json"], prog_name="pido experiment", standalone_mode=False)
    told = json.loads(said.getvalue())
    return told if isinstance(told, list) else [told]


@flow(name="experiment", flow_run_name="experiment {name}", persist_result=False)
def experiment(
    workspace: str, name: str, data: list[str] | None = None, quick: bool = False, repeats: int | None = None,
    seed: int = 0, workers: int | None = None, cluster: str | None = None, fresh: bool = False,
) -> list[dict[str, Any]]:  # fmt: skip
    """Run one experiment; the arguments are those of `pido experiment`. fresh : in place of what an earlier one left"""
    arguments = [name, "--seed", str(seed), *(["--quick"] if quick else []), *(["--fresh"] if fresh else [])]
    for source in data or []:
        arguments += ["--data", source]
    for option, value in (("--repeats", repeats), ("--workers", workers), ("--cluster", cluster)):
        arguments += [option, str(value)] if value is not None else []
    place = Workspace.open(workspace)
    with alive(place):
        told = run(workspace, arguments)
    lines = [f"**{one.get('data', name)}**: {one['verdict']}" for one in told]
    report = f"Reports: `{place.root / 'experiments' / name}`"
    text = "\n\n".join([f"# {name}", *lines, report])
    create_markdown_artifact(key=key(place, "experiment"), markdown=text, description=name)
    return told
