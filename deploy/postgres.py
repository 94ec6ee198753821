"""A PostgreSQL of the plant's own: its programs found, its cluster made, its databases created, backed up, restored.

In:  the plant's settings. Out: commands to run, and a cluster in `<folder>/postgres`.
PostgreSQL refuses to run as root: then it runs as the user of Debian's package.
"""

from __future__ import annotations

import os
import pwd
import shutil
import subprocess
import tempfile
from pathlib import Path

from deploy.settings import DATABASES, PlantSettings
from pido.core.errors import SettingsError


def programs() -> Path:
    """The folder with initdb, postgres, pg_dump. Raises SettingsError where PostgreSQL is not installed."""
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/postgres"), key=lambda p: float(p.parts[-3]))
    if not found and (on_path := shutil.which("postgres")):
        found = [Path(on_path)]
    if not found:
        raise SettingsError("PostgreSQL is not installed. On Debian: apt-get install postgresql.")
    return found[-1].parent


def user() -> str | None:
    """Whom the server runs as: None for whoever runs this."""
    if os.geteuid() != 0:
        return None
    try:
        return pwd.getpwnam("postgres").pw_name
    except KeyError:
        raise SettingsError(
            "as root, PostgreSQL needs the user 'postgres' of its Debian package, which is not here."
        ) from None


def is_installed() -> bool:
    """Whether a server of its own can be started here."""
    try:
        programs()
        user()
    except SettingsError:
        return False
    return True


def cluster(settings: PlantSettings) -> Path:
    """The folder of the cluster, made at first use: passwords by SCRAM, no socket, no trust."""
    data = settings.folder / "postgres"
    if (data / "PG_VERSION").exists():
        return data
    shutil.rmtree(data, ignore_errors=True)  # what an initdb that was killed has left
    data.mkdir(parents=True, mode=0o700)
    owner = user()
    if owner:
        shutil.chown(data, owner, owner)
        _check_reachable(data, owner)
    with tempfile.NamedTemporaryFile("w", prefix="pido-", dir="/tmp") as password:
        password.write(settings.postgres_password)
        password.flush()
        if owner:
            shutil.chown(password.name, owner, owner)
        _run([
            str(programs() / "initdb"), "-D", str(data), "-U", settings.postgres_user, "--auth=scram-sha-256",
            f"--pwfile={password.name}", "--encoding=UTF8", "--no-locale",
        ])  # fmt: skip
    return data


def command(settings: PlantSettings) -> list[str]:
    """How the server is started."""
    listen = ["-c", "listen_addresses=127.0.0.1", "-c", "unix_socket_directories=", "-p", str(settings.postgres_port)]
    return [str(programs() / "postgres"), "-D", str(cluster(settings)), *listen]


def ready(settings: PlantSettings) -> bool:
    """Whether it answers; makes the databases that are missing. Raises SettingsError where it refuses the password."""
    import psycopg2

    try:
        connection = psycopg2.connect(
            host="127.0.0.1", port=settings.postgres_port, user=settings.postgres_user,
            password=settings.postgres_password, dbname="postgres", connect_timeout=3,
        )  # fmt: skip
    except psycopg2.OperationalError as error:
        if "authentication failed" not in str(error):
            return False
        raise SettingsError(
            f"{settings.folder / 'postgres'}: refuses the password of user '{settings.postgres_user}'. Set "
            "PIDO_POSTGRES_PASSWORD, or the line in secrets.env, to the one that this plant was made with."
        ) from None
    try:
        connection.autocommit = True
        with connection.cursor() as cursor:
            for name in DATABASES:
                cursor.execute("SELECT 1 FROM pg_database WHERE datname = %s", (name,))
                if cursor.fetchone() is None:
                    cursor.execute(f'CREATE DATABASE "{name}"')
    finally:
        connection.close()
    return True


def dump(settings: PlantSettings, folder: Path) -> None:
    """Every database as <folder>/<name>.dump; each is consistent in itself, whatever is written meanwhile."""
    for name in DATABASES:
        _run([str(programs() / "pg_dump"), "-Fc", "-f", str(folder / f"{name}.dump"), "-d", name, *_options(settings)],
             settings, as_server=False)  # fmt: skip


def restore(settings: PlantSettings, folder: Path) -> None:
    """Every database from its dump; what was in it before is replaced."""
    for name in DATABASES:
        _run([str(programs() / "pg_restore"), "--clean", "--if-exists", "--no-owner", "-d", name,
              *_options(settings), str(folder / f"{name}.dump")], settings, as_server=False)  # fmt: skip


def _options(settings: PlantSettings) -> list[str]:
    return ["-h", "127.0.0.1", "-p", str(settings.postgres_port), "-U", settings.postgres_user]


def _run(command: list[str], settings: PlantSettings | None = None, as_server: bool = True) -> None:
    environment = {**os.environ, **({"PGPASSWORD": settings.postgres_password} if settings else {})}
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        cwd="/",
        env=environment,
        user=user() if as_server else None,
    )
    if done.returncode:
        raise SettingsError(f"{' '.join(command[:1])} failed: {done.stderr.strip()[-1500:]}")


def _check_reachable(data: Path, owner: str) -> None:
    if subprocess.run(["test", "-w", str(data)], user=owner, check=False, cwd="/").returncode:
        raise SettingsError(
            f"{data}: user '{owner}', as whom PostgreSQL runs, cannot reach this folder. "
            "Choose a folder whose parents others may enter (mode 755), with --folder."
        )
