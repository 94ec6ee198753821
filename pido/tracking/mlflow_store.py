"""Where MLflow keeps things: one SQLite file in the workspace, or a server; reached, prepared and named here.

In:  a workspace. Out: a client on a database whose tables are there.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING

from pido.core.axes import AXES
from pido.core.names import file_name
from pido.tracking.moved import FOLDER, settle
from pido.workspace import Workspace

if TYPE_CHECKING:
    from mlflow import MlflowClient

os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
os.environ.setdefault("DO_NOT_TRACK", "1")
os.environ.setdefault("MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT", "true")
# A server that is away is found out in seconds, not minutes: the iteration is logged when it is there again.
os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "2")
os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "20")


KIND, TRAINING = "mlflow.experimentKind", "custom_model_development"
"""MLflow opens such an experiment with its runs; any other with an overview for language models, empty here."""


def not_installed() -> str:
    """'' or what to do where the library is installed without MLflow: everything else works, and is logged later."""
    return "" if find_spec("mlflow") else "MLflow is not installed: pip install 'pido[servers]'"


@contextmanager
def client(workspace: Workspace) -> Iterator[MlflowClient]:
    """A client, with one writer at a time where the store is a SQLite file.

    SQLite: two processes that create the tables at the same moment would kill each other, and two writers stall.
    """
    import mlflow

    logging.getLogger("mlflow").setLevel(logging.WARNING)  # it tells of every table that it makes
    uri = workspace.tracking_uri
    with _same_environment():
        mlflow.set_tracking_uri(uri)
        mlflow.set_registry_uri(uri)
    if uri.startswith("sqlite:"):
        with workspace.lock("mlflow"):
            settle(workspace)
            yield mlflow.MlflowClient(tracking_uri=uri, registry_uri=uri)
    else:
        yield mlflow.MlflowClient(tracking_uri=uri, registry_uri=uri)


@contextmanager
def _same_environment() -> Iterator[None]:
    """MLflow writes its address into the environment, where the next workspace would take it for a setting."""
    names = ("MLFLOW_TRACKING_URI", "MLFLOW_REGISTRY_URI")
    before = {name: os.environ.get(name) for name in names}
    yield
    for name, value in before.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


def experiment(workspace: Workspace, store: MlflowClient, machine: str) -> str:
    """Id of the machine's experiment; artifacts of the embedded store lie in the workspace."""
    name = f"pido {machine}"
    found = store.get_experiment_by_name(name)
    if found is not None:
        if KIND not in found.tags:
            store.set_experiment_tag(found.experiment_id, KIND, TRAINING)
        return found.experiment_id
    embedded = workspace.tracking_uri.startswith("sqlite:")
    place = (workspace.root / FOLDER / file_name(machine)).as_uri() if embedded else None
    return store.create_experiment(name, artifact_location=place, tags={KIND: TRAINING})


def model_names(machine: str) -> dict[str, str]:
    """Axis -> name of the registered model."""
    return {axis: f"{file_name(machine)}-{axis}" for axis in AXES}


def how_to_open(workspace: Workspace) -> str:
    """What a person types, or the address they open, to look at the runs."""
    uri = workspace.tracking_uri
    if uri.startswith("sqlite:"):
        return f"mlflow ui --backend-store-uri {uri}   then open http://127.0.0.1:5000"
    return uri
