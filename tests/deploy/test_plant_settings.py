"""The plant's settings and its compose file: what can be checked without starting a server."""

from __future__ import annotations

import dataclasses
import os
import re
import stat
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from deploy import postgres
from deploy.entry import login_file, with_login
from deploy.services import services
from deploy.settings import DATABASES, SECRETS, load, read_env
from pido.core.errors import PidoError
from pido.workspace import MLFLOW_PAGE

ROOT = Path(__file__).parents[2]
COMPOSE = yaml.safe_load((ROOT / "docker-compose.yml").read_text())


@pytest.fixture
def settings(tmp_path, monkeypatch):
    for name in SECRETS:
        monkeypatch.delenv(name, raising=False)
    return load(tmp_path / "plant")


def test_the_compose_file_is_valid_under_the_compose_specification():
    call = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", "vendor.compose-spec", "docker-compose.yml"]
    done = subprocess.run(call, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_containers_and_processes_are_the_same_services_in_the_same_order(settings, monkeypatch):
    monkeypatch.setattr(postgres, "command", lambda settings: ["postgres"])
    monkeypatch.setattr(postgres, "user", lambda: None)
    assert [s.name for s in services(settings)] == list(COMPOSE["services"])


def test_the_token_of_approval_reaches_the_worker_and_no_other_service(settings, monkeypatch):
    monkeypatch.setattr(postgres, "command", lambda settings: ["postgres"])
    monkeypatch.setattr(postgres, "user", lambda: None)

    def with_it() -> list[str]:
        return [s.name for s in services(settings) if "PIDO_APPROVAL_TOKEN" in s.environment]

    assert with_it() == []
    monkeypatch.setenv("PIDO_APPROVAL_TOKEN", "open sesame")
    assert with_it() == ["worker"]
    in_compose = {n for n, s in COMPOSE["services"].items() if "PIDO_APPROVAL_TOKEN" in s.get("environment", {})}
    assert in_compose == {"worker"}
    assert COMPOSE["services"]["worker"]["environment"]["PIDO_APPROVAL_TOKEN"] == "${PIDO_APPROVAL_TOKEN:-}"


@pytest.mark.parametrize("name", COMPOSE["services"])
def test_every_container_is_watched_limited_without_rights_and_not_root(name):
    service = COMPOSE["services"][name]
    assert service["healthcheck"]["test"]
    assert {"cpus", "memory"} <= set(service["deploy"]["resources"]["limits"])
    assert str(service["user"]).split(":")[0] not in ("", "0", "root")
    assert "no-new-privileges:true" in service["security_opt"]
    assert not service.get("privileged")


def test_nothing_listens_beyond_this_machine_unless_asked():
    assert read_env(ROOT / "deploy" / "plant.env")["PIDO_BIND"] == "127.0.0.1"
    for name, service in COMPOSE["services"].items():
        for port in service.get("ports", []):
            assert port.startswith(("127.0.0.1:", "${PIDO_BIND:-127.0.0.1}:")), f"{name}: {port}"


def _interpolated(text: str, values: dict[str, str]) -> str:
    """As compose does it: `:-` and `:?` take an empty value for none."""
    while "${" in text:
        text = re.sub(r"\$\{(\w+)(?::-([^${}]*)|:\?[^${}]*)?\}", lambda m: values.get(m[1]) or m[2] or "", text)
    return text


def _as_container(values: dict[str, str]) -> tuple[str, list[str], str]:
    """Prefect's address for browsers, how MLflow is started, and where the worker's links to it lead."""
    command = [_interpolated(word, values) for word in COMPOSE["services"]["mlflow"]["command"]]
    address = COMPOSE["services"]["prefect"]["environment"]["PREFECT_SERVER_UI_API_URL"]
    links = _interpolated(COMPOSE["services"]["worker"]["environment"][MLFLOW_PAGE], values)
    return _interpolated(address, values), [part for word in command for part in word.split("=")], links


def _as_process(values: dict[str, str], folder: Path, monkeypatch) -> tuple[str, list[str], str]:
    monkeypatch.setattr(postgres, "command", lambda settings: ["postgres"])
    monkeypatch.setattr(postgres, "user", lambda: None)
    for name, value in values.items():
        monkeypatch.setenv(name, value)
    _, prefect, mlflow, worker, _ = services(load(folder))
    return prefect.environment["PREFECT_SERVER_UI_API_URL"], mlflow.command, worker.environment[MLFLOW_PAGE]


@pytest.mark.parametrize("arrangement", ["process", "container"])
@pytest.mark.parametrize(
    ("values", "called"),
    [({}, "127.0.0.1"), ({"PIDO_BIND": "192.168.1.20"}, "192.168.1.20"),
     ({"PIDO_BIND": "0.0.0.0", "PIDO_HOST": "192.168.1.20"}, "192.168.1.20"),
     ({"PIDO_BIND": "0.0.0.0", "PIDO_HOST": "plant-pc"}, "plant-pc")],
)  # fmt: skip
def test_both_pages_work_by_the_name_that_browsers_call(arrangement, values, called, tmp_path, monkeypatch):
    from mlflow.server.security_utils import is_allowed_host_header, should_block_cors_request

    made = _as_container(values) if arrangement == "container" else _as_process(values, tmp_path, monkeypatch)
    prefect, mlflow, links = made
    hosts, origins = (mlflow[mlflow.index(o) + 1].split(",") for o in ("--allowed-hosts", "--cors-allowed-origins"))
    assert prefect == f"http://{called}:4200/api"
    assert links == f"http://{called}:5000"
    assert is_allowed_host_header(hosts, f"{called}:5000")
    assert not should_block_cors_request(f"http://{called}:5000", "POST", origins)
    assert not is_allowed_host_header(hosts, "elsewhere.example:5000")
    if arrangement == "process":
        here = load(tmp_path)
        assert is_allowed_host_header(hosts, here.mlflow_uri.removeprefix("http://"))
        assert "0.0.0.0" not in here.prefect_api


def test_an_address_that_nobody_can_call_is_refused_without_a_name(tmp_path, monkeypatch):
    monkeypatch.setenv("PIDO_BIND", "0.0.0.0")
    with pytest.raises(PidoError, match=r"PIDO_BIND = 0\.0\.0\.0 .* Set PIDO_HOST"):
        load(tmp_path)
    for name in ("prefect", "mlflow"):
        host = _interpolated(COMPOSE["services"][name]["environment"]["PIDO_HOST"], {"PIDO_BIND": "0.0.0.0"})
        call = [sys.executable, "-m", "deploy.entry", "true"]
        done = subprocess.run(call, env={**os.environ, "PIDO_HOST": host}, capture_output=True, text=True, check=False)
        assert done.returncode == 1
        assert "Set PIDO_HOST" in done.stderr


def test_no_secret_stands_in_the_repository_and_compose_asks_for_each():
    text = (ROOT / "docker-compose.yml").read_text()
    known = read_env(ROOT / "deploy" / "plant.env")
    for name in SECRETS:
        assert name not in known
        assert f"${{{name}:?" in text
    for service in COMPOSE["services"].values():
        for name, value in service.get("environment", {}).items():
            if re.search("PASSWORD|SECRET|AUTH_STRING|URI$|CONNECTION_URL", name) and "://mlflow" not in value:
                assert "${" in value or "://{login}@" in value, name


def test_both_arrangements_make_the_same_databases():
    made = re.findall(r"CREATE DATABASE (\w+)", (ROOT / "deploy" / "databases.sql").read_text())
    assert tuple(made) == DATABASES


def test_the_guides_command_brings_every_value_that_compose_asks_for():
    [file] = re.findall(r"docker compose --env-file (\S+) up", (ROOT / "docs" / "guide" / "plant.md").read_text())
    asked = set(re.findall(r"\$\{(\w+):\?", (ROOT / "docker-compose.yml").read_text()))
    assert asked <= {*read_env(ROOT / file), *SECRETS}


@pytest.mark.parametrize("password", ["a@b", "a/b#c?d=e:f", "100 %", "%40", "{login}", "ü'\""])
def test_any_password_reaches_the_database_from_a_container_and_from_a_process(settings, password):
    from sqlalchemy import make_url

    inside = with_login({
        "PIDO_POSTGRES_USER": "pi do", "PIDO_POSTGRES_PASSWORD": password,
        **{k: v for s in COMPOSE["services"].values() for k, v in s["environment"].items() if "{login}" in v},
    })  # fmt: skip
    outside = dataclasses.replace(settings, postgres_user="pi do", postgres_password=password)
    for address in (*inside.values(), outside.database("mlflow", "psycopg2")):
        found = make_url(address)
        assert (found.username, found.password) == ("pi do", password)
        assert found.host in ("postgres", "127.0.0.1")
    assert len(inside) == 3


def test_missing_secrets_are_made_once_and_readable_by_the_owner_alone(settings, monkeypatch):
    file = settings.folder / "secrets.env"
    monkeypatch.setattr(postgres, "command", lambda settings: ["postgres"])
    monkeypatch.setattr(postgres, "user", lambda: None)
    services(settings)
    assert stat.S_IMODE((settings.folder / "mlflow_auth.ini").stat().st_mode) == 0o600
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert load(settings.folder) == settings
    assert len({settings.postgres_password, settings.prefect_password, settings.mlflow_password}) == 3


def test_no_secret_is_made_for_a_plant_whose_database_has_one_already(tmp_path, monkeypatch):
    for name in SECRETS:
        monkeypatch.setenv(name, "ours")
    (tmp_path / "postgres").mkdir()
    (tmp_path / "postgres" / "PG_VERSION").write_text("15\n")
    assert load(tmp_path).postgres_password == "ours"
    monkeypatch.delenv("PIDO_MLFLOW_PASSWORD")
    with pytest.raises(PidoError, match=r"not in secrets.env: PIDO_MLFLOW_PASSWORD\. Set them in the environment"):
        load(tmp_path)
    assert not (tmp_path / "secrets.env").exists()


def test_a_port_that_is_none_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("PIDO_MLFLOW_PORT", "http")
    with pytest.raises(PidoError, match="PIDO_MLFLOW_PORT = 'http'"):
        load(tmp_path)


def test_a_password_with_a_per_cent_sign_survives_the_login_file():
    import configparser

    parser = configparser.ConfigParser()
    parser.read_string(login_file("postgresql://u:a%40b@h/d", "admin"))
    assert parser["mlflow"]["database_uri"] == "postgresql://u:a%40b@h/d"


@pytest.mark.parametrize("from_environment", [False, True])
def test_the_line_that_points_a_shell_at_the_plant_holds_no_password_and_brings_it(
    settings, tmp_path, monkeypatch, from_environment
):
    from deploy.plant import shell

    if from_environment:
        monkeypatch.setenv("PIDO_MLFLOW_PASSWORD", "it's $secret")
        settings = load(tmp_path / "other plant")
    line = shell(settings)
    assert settings.mlflow_password not in line
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MLFLOW_")}
    shown = "MLFLOW_TRACKING_URI MLFLOW_TRACKING_USERNAME MLFLOW_TRACKING_PASSWORD PIDO_WORKSPACE"
    call = ["bash", "-ec", f"{line}; printenv {shown}"]
    done = subprocess.run(call, env=environment, capture_output=True, text=True, check=True)
    asked = [settings.mlflow_uri, settings.mlflow_user, settings.mlflow_password, str(settings.workspace)]
    assert done.stdout.splitlines() == asked
