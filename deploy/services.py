"""What runs in a plant, in the order in which it starts: database, Prefect, MLflow, worker, watcher.

In:  the plant's settings. Out: one `Service` each: how it is started, when it is healthy, as whom it runs.
docker-compose.yml says the same for containers; a test holds the two together.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from deploy import postgres
from deploy.entry import login_file
from deploy.settings import PlantSettings
from flows.server import answers
from pido.core.files import write_atomically
from pido.tracking.promotion import TOKEN


@dataclass(frozen=True, slots=True)
class Service:
    """`healthy` is asked until it says yes, at most `patience_s` long."""

    name: str
    command: list[str]
    environment: dict[str, str]
    healthy: Callable[[], bool]
    patience_s: float = 300.0
    user: str | None = None


def services(settings: PlantSettings) -> list[Service]:
    """All of them; each needs those before it."""
    python = sys.executable
    client = settings.client_environment()
    workspace = settings.workspace
    workspace.mkdir(parents=True, exist_ok=True)
    (workspace / "inbox").mkdir(exist_ok=True)
    bind = settings.bind
    return [
        Service(
            "postgres",
            postgres.command(settings),
            {},
            lambda: postgres.ready(settings),
            user=postgres.user(),
        ),
        Service(
            "prefect",
            [python, "-m", "prefect", "server", "start", "--host", bind, "--port", str(settings.prefect_port)],
            {
                **client,
                "PREFECT_HOME": str(settings.folder / "prefect"),
                "PREFECT_SERVER_DATABASE_CONNECTION_URL": settings.database("prefect", "asyncpg"),
                "PREFECT_SERVER_API_AUTH_STRING": f"{settings.prefect_user}:{settings.prefect_password}",
                "PREFECT_SERVER_UI_API_URL": f"{settings.prefect_page}/api",
                "PREFECT_SERVER_UI_SHOW_PROMOTIONAL_CONTENT": "false",
                "PREFECT_LOGGING_SERVER_LEVEL": "WARNING",
            },
            lambda: answers(f"{settings.prefect_api}/health"),
        ),
        Service(
            "mlflow",
            [python, "-m", "mlflow", "server", "--host", bind, "--port", str(settings.mlflow_port), "--workers", "1",
             "--app-name", "basic-auth", "--artifacts-destination", str(settings.folder / "mlartifacts"),
             "--allowed-hosts", ",".join(f"{name}:{settings.mlflow_port}" for name in _names(settings)),
             "--cors-allowed-origins", settings.mlflow_page],
            {
                "MLFLOW_BACKEND_STORE_URI": settings.database("mlflow", "psycopg2"),
                "MLFLOW_AUTH_CONFIG_PATH": str(_mlflow_login(settings)),
                "MLFLOW_AUTH_ADMIN_USERNAME": settings.mlflow_user,
                "MLFLOW_AUTH_ADMIN_PASSWORD": settings.mlflow_password,
                "MLFLOW_FLASK_SERVER_SECRET_KEY": settings.mlflow_secret,
                # Eight processes for jobs that nobody asks for: 2 GB.
                "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false",
                "MLFLOW_DISABLE_TELEMETRY": "true",
                "DO_NOT_TRACK": "1",
            },
            lambda: answers(f"{settings.mlflow_uri}/health"),
        ),
        Service(
            "worker",
            [python, "-m", "flows.serve", "--workspace", str(workspace)],
            {**client, **_credential(), "PREFECT_HOME": str(settings.folder / "worker"),
             "PREFECT_RUNNER_POLL_FREQUENCY": "1"},
            lambda: (workspace / "worker.alive").exists(),
        ),
        Service(
            "watcher",
            [python, "-m", "pido.cli", "watch", str(workspace / "inbox"), "--workspace", str(workspace), "--prefect"],
            {**client, "PREFECT_HOME": str(settings.folder / "watcher")},
            lambda: (workspace / "watcher.alive").exists(),
        ),
    ]  # fmt: skip


def _credential() -> dict[str, str]:
    """With the token of approval in its environment the worker takes decisions on Prefect's pages."""
    return {TOKEN: os.environ[TOKEN]} if os.environ.get(TOKEN) else {}


def _names(settings: PlantSettings) -> list[str]:
    """By which MLflow lets itself be called."""
    return sorted({settings.host, settings.here, "127.0.0.1", "localhost"})


def _mlflow_login(settings: PlantSettings) -> Path:
    path = settings.folder / "mlflow_auth.ini"
    write_atomically(path, login_file(settings.database("mlflow_auth", "psycopg2"), settings.mlflow_user), 0o600)
    return path
