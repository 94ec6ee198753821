"""A real PostgreSQL of the plant's own: made, reached by password only, backed up while it runs, restored elsewhere."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import psycopg2
import pytest

from deploy import backup, postgres
from deploy.plant import Plant, with_free_ports
from deploy.settings import SECRETS, PlantSettings, load

ROOT = Path(__file__).parents[2]
pytestmark = [
    pytest.mark.servers,
    pytest.mark.skipif(not postgres.is_installed(), reason="PostgreSQL is missing (apt-get install postgresql)"),
]


@pytest.fixture
def folder():
    """A place that the database's own user may enter, which pytest's temporary folders are not."""
    place = Path(tempfile.mkdtemp(prefix="pido-plant-", dir="/tmp"))
    place.chmod(0o755)
    yield place
    shutil.rmtree(place)


def connect(settings: PlantSettings, password: str):
    return psycopg2.connect(host="127.0.0.1", port=settings.postgres_port, user=settings.postgres_user,
                            password=password, dbname="prefect", connect_timeout=5)  # fmt: skip


def rows(settings: PlantSettings) -> list[tuple]:
    connection = connect(settings, settings.postgres_password)
    with connection, connection.cursor() as cursor:
        cursor.execute("SELECT name FROM kept")
        found = cursor.fetchall()
    connection.close()
    return found


def test_everything_comes_back_from_one_backup_file(folder):
    settings = with_free_ports(load(folder / "old"))
    with Plant(settings, only=("postgres",)):
        with pytest.raises(psycopg2.OperationalError, match="authentication failed"):
            connect(settings, "guessed")
        connection = connect(settings, settings.postgres_password)
        with connection, connection.cursor() as cursor:
            cursor.execute("CREATE TABLE kept(name TEXT)")
            cursor.execute("INSERT INTO kept VALUES ('a run')")
        connection.close()
        (settings.workspace / "store").mkdir()
        (settings.workspace / "store" / "part").write_text("rows")
        backup.backup(settings, folder / "backup.tar")
    backup.unpack(folder / "backup.tar", folder / "new")
    again = with_free_ports(load(folder / "new"))
    with Plant(again, only=("postgres",)):
        backup.restore_databases(again)
        assert rows(again) == [("a run",)]
    assert (again.workspace / "store" / "part").read_text() == "rows"
    with pytest.raises(psycopg2.OperationalError):
        connect(again, again.postgres_password)  # stopped with its block


def test_a_backup_from_another_shell_says_which_password_it_lacks_and_changes_nothing(folder, monkeypatch):
    place, archive = folder / "plant", folder / "backup.tar"
    call = [sys.executable, "-m", "deploy.plant", "--folder", str(place), "backup", str(archive)]

    def backed_up(**passwords: str) -> subprocess.CompletedProcess[str]:
        environment = {name: value for name, value in os.environ.items() if name not in SECRETS} | passwords
        return subprocess.run(call, capture_output=True, text=True, check=False, env=environment, cwd=ROOT)

    known = dict.fromkeys(SECRETS, "from the environment")
    for name, value in known.items():
        monkeypatch.setenv(name, value)
    with Plant(with_free_ports(load(place)), only=("postgres",)):
        without, wrong = backed_up(), backed_up(**{**known, "PIDO_POSTGRES_PASSWORD": "guessed"})
        assert (without.returncode, wrong.returncode) == (1, 1)
        assert f"not in secrets.env: {', '.join(SECRETS)}. Set" in without.stderr
        assert "refuses the password of user 'pido'. Set PIDO_POSTGRES_PASSWORD" in wrong.stderr
        assert not (place / "secrets.env").exists()
        assert not archive.exists()
        assert backed_up(**known).returncode == 0
    assert archive.exists()


def test_a_service_that_dies_is_started_again(folder):
    settings = with_free_ports(load(folder / "plant"))
    with Plant(settings, only=("postgres",)) as plant:
        first = plant.running["postgres"]
        first.kill()
        first.wait()
        plant.look_after()
        assert plant.running["postgres"].pid != first.pid
        connect(settings, settings.postgres_password).close()
