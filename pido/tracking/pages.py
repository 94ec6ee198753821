"""Where MLflow's pages show a run, for those that are served.

In:  a workspace and a run. Out: an address for people's browsers, '' where nothing serves pages.
"""

from __future__ import annotations

from pido.tracking.ledger import Iteration
from pido.tracking.mlflow_store import client, not_installed
from pido.workspace import Workspace


def address(workspace: Workspace, experiment: str, run: str, artifact: str = "") -> str:
    """Of a run in an experiment, or of one of its artifacts."""
    if not workspace.tracking_page:
        return ""
    page = f"experiments/{experiment}/runs/{run}" + (f"/artifacts/{artifact}" if artifact else "")
    # Without the question MLflow goes on to its pages for language models, where a run's artifacts are not found again.
    return f"{workspace.tracking_page}/#/{page}?workflowType=machine_learning"


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
