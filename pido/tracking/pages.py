"""Where MLflow's pages show a run, for those that are served.

In:  a workspace and a run, or a machine. Out: an address for people's browsers; '' of a run where nothing serves pages.
"""

from __future__ import annotations

from pido.tracking.ledger import Iteration
from pido.tracking.mlflow_store import client, not_installed
from pido.tracking.mlflow_store import experiment as experiment_of
from pido.workspace import Workspace

_OF_TRAINING = "?workflowType=machine_learning"
"""Without it MLflow goes on to its pages for language models: an empty overview in place of the runs, and a run whose
artifacts are not found again."""


def address(workspace: Workspace, experiment: str, run: str, artifact: str = "") -> str:
    """Of a run in an experiment, or of one of its artifacts."""
    if not workspace.tracking_page:
        return ""
    page = f"experiments/{experiment}/runs/{run}" + (f"/artifacts/{artifact}" if artifact else "")
    return f"{workspace.tracking_page}/#/{page}{_OF_TRAINING}"


def how_to_open(workspace: Workspace, machine: str) -> str:
    """What a person types and opens, or the address alone, to look at a machine's runs."""
    with client(workspace) as store:
        runs = f"#/experiments/{experiment_of(workspace, store, machine)}/runs{_OF_TRAINING}"
    if workspace.tracking_page:
        return f"{workspace.tracking_page}/{runs}"
    return f"mlflow ui --backend-store-uri {workspace.tracking_uri}   then open http://127.0.0.1:5000/{runs}"


def address_of(workspace: Workspace, iteration: Iteration) -> str:
    """Of the run of an iteration; '' also while MLflow has not got it, or cannot be asked."""
    if not iteration.logged or not workspace.tracking_page or not_installed():
        return ""
    from mlflow.exceptions import MlflowException

    try:
        with client(workspace) as store:
            return address(workspace, store.get_run(iteration.logged).info.experiment_id, iteration.logged)
    except (MlflowException, OSError):
        return ""
