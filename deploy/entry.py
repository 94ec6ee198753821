"""First process of a container: writes MLflow's login file from the environment, then becomes the command.

In:  PIDO_MLFLOW_AUTH_DATABASE, where the container is MLflow's. Out: never; the command takes its place.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path


def login_file(database: str, admin: str) -> str:
    """MLflow's login settings; a per cent sign is doubled because the file is read with interpolation."""
    return (
        "[mlflow]\ndefault_permission = READ\n"
        f"database_uri = {database.replace('%', '%%')}\n"
        f"admin_username = {admin}\n"
        "authorization_function = mlflow.server.auth:authenticate_request_basic_auth\n"
        # Else the password is hashed anew, a tenth of a second, for each of the 140 requests of an iteration.
        "auth_cache_ttl_seconds = 300\n"
    )


def main() -> None:
    database = os.environ.pop("PIDO_MLFLOW_AUTH_DATABASE", None)
    if database:
        path = Path(os.environ["MLFLOW_AUTH_CONFIG_PATH"])
        path.touch(mode=0o600)
        path.write_text(login_file(database, os.environ["MLFLOW_AUTH_ADMIN_USERNAME"]), encoding="utf-8")
    os.execvp(sys.argv[1], sys.argv[1:])


if __name__ == "__main__":
    main()
