"""The settings of a plant: `deploy/plant.env`, the environment over it, and secrets that are never in the repository.

In:  the plant's folder. Out: one `PlantSettings`, the same names as in docker-compose.yml.
"""

from __future__ import annotations

import dataclasses
import os
import secrets
from dataclasses import dataclass
from pathlib import Path

from deploy.entry import EVERYWHERE, NO_HOST, login
from pido.core.errors import SettingsError
from pido.core.files import write_atomically
from pido.workspace import MLFLOW_PAGE

FILE = Path(__file__).with_name("plant.env")
SECRETS = ("PIDO_POSTGRES_PASSWORD", "PIDO_PREFECT_PASSWORD", "PIDO_MLFLOW_PASSWORD", "PIDO_MLFLOW_SECRET")
DATABASES = ("prefect", "mlflow", "mlflow_auth")


@dataclass(frozen=True, slots=True)
class PlantSettings:
    """Where the services listen and who may use them. `folder` holds everything that they write.

    bind : the address that they listen on
    host : the name or address by which browsers call them
    """

    folder: Path
    bind: str
    host: str
    postgres_port: int
    prefect_port: int
    mlflow_port: int
    postgres_user: str
    prefect_user: str
    mlflow_user: str
    nightly: str
    postgres_password: str
    prefect_password: str
    mlflow_password: str
    mlflow_secret: str

    @property
    def workspace(self) -> Path:
        return self.folder / "workspace"

    @property
    def here(self) -> str:
        """By which worker and watcher, on this machine, call the services."""
        return "127.0.0.1" if self.bind in EVERYWHERE else self.bind

    @property
    def prefect_api(self) -> str:
        return f"http://{self.here}:{self.prefect_port}/api"

    @property
    def mlflow_uri(self) -> str:
        return f"http://{self.here}:{self.mlflow_port}"

    @property
    def prefect_page(self) -> str:
        return f"http://{self.host}:{self.prefect_port}"

    @property
    def mlflow_page(self) -> str:
        return f"http://{self.host}:{self.mlflow_port}"

    def database(self, name: str, driver: str) -> str:
        """Address of a database for SQLAlchemy."""
        who = login(self.postgres_user, self.postgres_password)
        return f"postgresql+{driver}://{who}@127.0.0.1:{self.postgres_port}/{name}"

    def client_environment(self) -> dict[str, str]:
        """What a client (worker, watcher, a person's shell) needs to be let in."""
        return {
            "PREFECT_API_URL": self.prefect_api,
            "PREFECT_API_AUTH_STRING": f"{self.prefect_user}:{self.prefect_password}",
            "MLFLOW_TRACKING_URI": self.mlflow_uri,
            "MLFLOW_TRACKING_USERNAME": self.mlflow_user,
            "MLFLOW_TRACKING_PASSWORD": self.mlflow_password,
            MLFLOW_PAGE: self.mlflow_page,
            "PIDO_WORKSPACE": str(self.workspace),
            "PIDO_NIGHTLY": self.nightly,
            "DO_NOT_TRACK": "1",
            "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
            "MLFLOW_DISABLE_TELEMETRY": "true",
        }


def load(folder: Path) -> PlantSettings:
    """The settings for a plant in `folder`. Missing secrets of a new one are made and kept there, readable by the owner
    alone; one that has a database was made with its secrets.

    Raises SettingsError naming every value that is missing, is no port number, or is no address to be called by.
    """
    folder = folder.absolute()
    values = {**read_env(FILE), **{k: v for k, v in os.environ.items() if k.startswith("PIDO_")}}
    values |= {k: v for k, v in _secrets(folder).items() if not os.environ.get(k)}
    values["PIDO_HOST"] = values.get("PIDO_HOST") or values.get("PIDO_BIND", "")
    faults = []
    fields: dict[str, str | int] = {}
    for name in (f.name for f in dataclasses.fields(PlantSettings) if f.name != "folder"):
        value = values.get(f"PIDO_{name.upper()}", "")
        if not value:
            faults.append(f"PIDO_{name.upper()} is missing")
        elif name == "host" and value in EVERYWHERE:
            faults.append(f"PIDO_BIND = {value} {NO_HOST}")
        elif name.endswith("_port"):
            if not value.isdigit() or not 0 < int(value) < 65536:
                faults.append(f"PIDO_{name.upper()} = {value!r} is no port number (1 to 65535)")
            else:
                fields[name] = int(value)
        else:
            fields[name] = value
    if faults:
        raise SettingsError(f"{FILE}: " + "; ".join(faults) + ". Set them there or in the environment.")
    return PlantSettings(folder=folder, **fields)  # type: ignore[arg-type]


def read_env(path: Path) -> dict[str, str]:
    """NAME=value lines; blank lines and lines that begin with # are left out."""
    result = {}
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            name, equals, value = line.partition("=")
            if not equals:
                raise SettingsError(f"{path}, line {number}: {line!r} is not NAME=value.")
            result[name.strip()] = value.strip()
    return result


def _secrets(folder: Path) -> dict[str, str]:
    path = folder / "secrets.env"
    known = read_env(path) if path.exists() else {}
    missing = [name for name in SECRETS if name not in known and not os.environ.get(name)]
    if missing and (folder / "postgres" / "PG_VERSION").exists():
        raise SettingsError(
            f"{folder}: this plant was made with passwords that are not in {path.name}: {', '.join(missing)}. Set "
            "them in the environment, as where it was started."
        )
    if missing:
        known |= {name: secrets.token_urlsafe(24) for name in missing}
        write_atomically(path, "".join(f"{name}={value}\n" for name, value in known.items()), 0o600)
    return known
