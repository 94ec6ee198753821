"""A diagnosis into MLflow: its files with the newest run of the machine.

In:  a workspace, a machine, a folder of `pido diagnose`. Out: artifacts `diagnosis/` of that run, and its address.
"""

from __future__ import annotations

from pathlib import Path

from pido.tracking.ledger import Ledger
from pido.tracking.mlflow_store import KEY, client, experiment, not_installed
from pido.tracking.pages import address
from pido.workspace import Workspace


def attach(workspace: Workspace, machine: str, folder: Path) -> tuple[str, str]:
    """Log the files of `folder`: (where MLflow's pages show them, '' without a server; why they were not logged)."""
    if missing := not_installed():
        return "", missing
    from mlflow.exceptions import MlflowException

    versions = Ledger(workspace.ledger).iterations(machine)
    if not versions:
        return "", f"machine '{machine}' has no iteration yet"
    try:
        with client(workspace) as store:
            place = experiment(workspace, store, machine)
            runs = store.search_runs([place], f"tags.`{KEY}` = '{versions[-1].run_key}'")
            if not runs:
                return "", "the run of the newest iteration is not in MLflow yet"
            run = runs[0].info.run_id
            store.log_artifacts(run, str(folder), "diagnosis")
    except (MlflowException, OSError) as error:
        return "", str(error).splitlines()[0]
    return address(workspace, place, run, "diagnosis/report.html"), ""
