"""Where MLflow keeps things: one SQLite file in the workspace, or a server; reached, prepared and named here.

In:  a workspace. Out: a client on a database whose tables are there.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from pido.core.axes import AXES
from pido.core.names import file_name
from pido.tracking.descriptions import NOTE, of_experiment
from pido.tracking.ledger import Ledger
from pido.tracking.moved import FOLDER, settle
from pido.workspace import Workspace, without_secrets

if TYPE_CHECKING:
    from mlflow import MlflowClient

os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
os.environ.setdefault("DO_NOT_TRACK", "1")
os.environ.setdefault("MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT", "true")
# A server that is away is found out in seconds, not minutes: the iteration is logged when it is there again.
os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "2")
os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "20")


KEY, VERSION, BUNDLE, OWNER = "pido.run_key", "pido.version", "pido.bundle", "pido.workspace"
"""Tags: of a run, of the version that it made and its bundle, and the id of the workspace that they are of."""
DATABASES = ("sqlite", "postgresql", "mysql", "mssql")
PATIENCE_S = 5
"""For a database to answer, s."""
KIND, TRAINING = "mlflow.experimentKind", "custom_model_development"
"""What MLflow takes such an experiment for; any other is one of language models."""


def not_installed() -> str:
    """'' or what to do where the library is installed without MLflow: everything else works, and is logged later."""
    return "" if find_spec("mlflow") else "MLflow is not installed: pip install 'pido[servers]'"


@contextmanager
def client(workspace: Workspace) -> Iterator[MlflowClient]:
    """A client, with one writer at a time where the store is a SQLite file.

    SQLite: two processes that create the tables at the same moment would kill each other, and two writers stall.
    Raises ConnectionError, soon, where the store is a database that does not answer.
    """
    import mlflow

    logging.getLogger("mlflow").setLevel(logging.WARNING)  # it tells of every table that it makes
    uri = workspace.tracking_uri
    _answers(uri)
    with _same_environment():
        mlflow.set_tracking_uri(uri)
        mlflow.set_registry_uri(uri)
    if uri.startswith("sqlite:"):
        with workspace.lock("mlflow"):
            settle(workspace)
            yield mlflow.MlflowClient(tracking_uri=uri, registry_uri=uri)
    else:
        yield mlflow.MlflowClient(tracking_uri=uri, registry_uri=uri)


def _answers(uri: str) -> None:
    """MLflow itself tries a database that is away fifteen times within minutes, with a page of its log for each."""
    kind = uri.partition(":")[0].partition("+")[0]
    if kind not in DATABASES:
        return
    import sqlalchemy
    from sqlalchemy.exc import SQLAlchemyError

    try:
        address = sqlalchemy.make_url(uri)
        if kind == "sqlite" and address.database:
            Path(address.database).parent.mkdir(parents=True, exist_ok=True)
        driver = address.get_dialect().driver
        timed = {"connect_timeout": PATIENCE_S} if driver in ("psycopg2", "psycopg", "pymysql", "mysqldb") else {}
        engine = sqlalchemy.create_engine(uri, connect_args=timed, poolclass=sqlalchemy.NullPool)
        with engine.connect() as connection:
            sqlalchemy.inspect(connection).has_table("experiments")
    except (SQLAlchemyError, ImportError, ValueError) as error:
        why = str(getattr(error, "orig", None) or error).strip() or type(error).__name__
        said = f"MLflow's database {without_secrets(uri)} cannot be used: {why.splitlines()[0]}"
        raise ConnectionError(said) from None


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


def ending(workspace: Workspace, store: MlflowClient, machine: str) -> str:
    """What the names of a machine's experiment and models end with: nothing for the first workspace that has a machine
    of this name on a server, and nothing in a workspace's own file, else the workspace's id.

    An experiment of older versions, which says not whose it is, is of the workspace whose run is the first in it.
    """
    if workspace.tracks_alone:
        return ""
    first = store.get_experiment_by_name(_experiment(machine, ""))
    if first is None:
        return ""
    if OWNER in first.tags:
        ours = first.tags[OWNER] == workspace.id
    else:
        runs = store.search_runs(
            [first.experiment_id], f"tags.`{KEY}` != ''", max_results=1, order_by=["start_time ASC"]
        )
        ours = not runs or Ledger(workspace.ledger).iteration(runs[0].data.tags[KEY]) is not None
    return "" if ours else f"-{workspace.id}"


def experiment(workspace: Workspace, store: MlflowClient, machine: str) -> str:
    """Id of the machine's experiment; artifacts of the embedded store lie in the workspace."""
    name = _experiment(machine, ending(workspace, store, machine))
    wanted = {KIND: TRAINING, OWNER: workspace.id, NOTE: of_experiment(machine)}
    found = store.get_experiment_by_name(name)
    if found is not None:
        for tag, value in wanted.items():
            if tag not in found.tags:
                store.set_experiment_tag(found.experiment_id, tag, value)
        return found.experiment_id
    embedded = workspace.tracking_uri.startswith("sqlite:")
    place = (workspace.root / FOLDER / file_name(machine)).as_uri() if embedded else None
    return store.create_experiment(name, artifact_location=place, tags=wanted)


def _experiment(machine: str, ending: str) -> str:
    return f"pido {machine}{ending}"


def model_names(machine: str, ending: str = "") -> dict[str, str]:
    """Axis -> name of the registered model."""
    return {axis: f"{file_name(machine)}-{axis}{ending}" for axis in AXES}
