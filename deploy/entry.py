"""First process of a container: completes addresses of databases, writes MLflow's login file, becomes the command.

In:  the environment: PIDO_POSTGRES_USER and PIDO_POSTGRES_PASSWORD, which take the place of {login} in other values;
PIDO_MLFLOW_AUTH_DATABASE, where the container is MLflow's; PIDO_HOST, where it has pages. Out: never; the command takes
its place.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import quote

EVERYWHERE = ("0.0.0.0", "::")
"""Addresses to listen on, by which nobody can be called."""
NO_HOST = (
    "is every address of this machine, and none that a browser could call. Set PIDO_HOST to the name or address by "
    "which others call this machine, such as plant-pc or 192.168.1.20"
)


def login(user: str, password: str) -> str:
    """User and password as they stand in an address, whatever signs are in them.

    >>> login("pido", "a@b/c")
    'pido:a%40b%2Fc'
    """
    return f"{quote(user, safe='')}:{quote(password, safe='')}"


def with_login(environment: Mapping[str, str]) -> dict[str, str]:
    """The environment with the database's login in place of {login}, and without user and password."""
    rest = dict(environment)
    who = login(rest.pop("PIDO_POSTGRES_USER", ""), rest.pop("PIDO_POSTGRES_PASSWORD", ""))
    return {name: value.replace("{login}", who) for name, value in rest.items()}


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
    environment = with_login(os.environ)
    if (host := environment.get("PIDO_HOST")) in EVERYWHERE:
        sys.exit(f"PIDO_BIND = {host} {NO_HOST}.")
    database = environment.pop("PIDO_MLFLOW_AUTH_DATABASE", None)
    if database:
        path = Path(environment["MLFLOW_AUTH_CONFIG_PATH"])
        path.touch(mode=0o600)
        path.write_text(login_file(database, environment["MLFLOW_AUTH_ADMIN_USERNAME"]), encoding="utf-8")
    os.execvpe(sys.argv[1], sys.argv[1:], environment)


if __name__ == "__main__":
    main()
