"""Where iterations were logged is known to every shell; what derives can be deleted; a database may be away."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from plain_parts import parts as made_up

from pido.recordings.folder import write_folder
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

SETTINGS = "compare = false\n[method]\nadaptive = false\ncompare_with_model = false\n"
MACHINE = "cmx600v"


def pido(*words: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """In a shell that names no MLflow but that of `environment`."""
    own = {name: value for name, value in os.environ.items() if not name.startswith("MLFLOW_")} | environment
    call = [sys.executable, "-m", "pido.cli", *map(str, words)]
    return subprocess.run(call, capture_output=True, text=True, check=False, env=own)


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """A workspace with two iterations, in its own MLflow."""
    root: Path = tmp_path_factory.mktemp("plant")
    (root / "workspace.toml").write_text(SETTINGS)
    parts = [write_folder(p.rows(slice(0, 600)), root / "given" / p.part.part) for p in made_up(2)]
    done = pido("iterate", *parts, "-w", root)
    assert done.returncode == 0, done.stderr
    return root


@pytest.fixture
def plant(made, tmp_path) -> Path:
    return shutil.copytree(made, tmp_path / "plant")


def not_at(root: Path, uri: str) -> int:
    place = Workspace.open(root, tracking_uri=uri)
    return len(Ledger(place.ledger).not_logged(place.tracking_place))


def data_sets(uri: str) -> dict[str, tuple[list[str], str]]:
    """Version -> names of the data sets that its run names as its inputs, and what it says was left out."""
    code = (
        "import json, sys, mlflow\n"
        "store = mlflow.MlflowClient(sys.argv[1])\n"
        "runs = store.search_runs([e.experiment_id for e in store.search_experiments()])\n"
        "print(json.dumps({r.data.tags['pido.version']: [[i.dataset.name for i in r.inputs.dataset_inputs], "
        "r.data.tags.get('pido.left_out', '')] for r in runs if r.info.status == 'FINISHED'}))"
    )
    said = subprocess.run([sys.executable, "-c", code, uri], capture_output=True, text=True, check=True)
    return json.loads(said.stdout.splitlines()[-1])


@pytest.mark.thorough
def test_what_derives_is_made_anew_for_mlflow(plant, tmp_path):
    shutil.rmtree(plant / "derived")
    other = f"sqlite:///{tmp_path / 'other.db'}"
    done = pido("iterate", "-w", plant, MLFLOW_TRACKING_URI=other)
    assert done.returncode == 0, done.stderr
    assert not_at(plant, other) == 0, done.stderr
    found = data_sets(other)
    assert set(found) == {"1", "2"}
    assert all("real" in names and not left_out for names, left_out in found.values())


@pytest.mark.thorough
def test_what_cannot_be_made_anew_is_left_out_and_said_so_and_holds_up_nothing(plant, tmp_path):
    shutil.rmtree(plant / "derived")
    settings = plant / "workspace.toml"
    settings.write_text("rate_hz = 40.0\n" + settings.read_text())  # other rows from now on
    other = f"sqlite:///{tmp_path / 'other.db'}"
    done = pido("iterate", "-w", plant, MLFLOW_TRACKING_URI=other)
    assert done.returncode == 0, done.stderr
    assert "cannot be reached" not in done.stderr
    assert "version 1 of cmx600v: Without its recorded rows" in done.stderr
    assert not_at(plant, other) == 0
    found = data_sets(other)
    assert set(found) == {"1", "2", "3"}
    assert ["real" in found[v][0] for v in "123"] == [False, False, True]
    assert "1 of 1 files are gone" in found["1"][1]


def approved(root: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    for one in Ledger(root / "ledger.db").versions(MACHINE):
        Ledger(root / "ledger.db").judged(MACHINE, one.version, {"passed": True, "words": "set by this test"})
    return pido("approve", "2", "--by", "A. Ito", "--reason", "a test", "-w", root, **environment)


@pytest.mark.thorough
def test_a_shell_that_points_elsewhere_is_told_where_and_makes_no_database(plant, tmp_path):
    server = f"sqlite:///{tmp_path / 'server.db'}"
    assert pido("iterate", "-w", plant, MLFLOW_TRACKING_URI=server).returncode == 0
    for file in plant.glob("mlflow.db*"):
        file.unlink()
    said = pido("status", "-w", plant).stdout
    assert f"2 iteration(s) are logged at {server}; this shell points elsewhere: export MLFLOW_TRACKING_URI=" in said
    assert "are not in MLflow" not in said
    asked = json.loads(pido("status", "-w", plant, "--json").stdout)
    assert (asked["mlflow_at"], asked["not_in_mlflow_yet"]) == (server, 0)
    done = approved(plant)
    assert done.returncode == 0
    assert "version 2 is champion" in done.stdout
    assert f"The decision stands; MLflow's aliases will follow later: logged at {server}" in done.stderr
    assert not list(plant.glob("mlflow.db*"))
    there = pido("status", "-w", plant, MLFLOW_TRACKING_URI=server).stdout
    assert "elsewhere" not in there
    assert "in MLflow" not in there


@pytest.mark.thorough
def test_an_iteration_in_a_shell_that_names_no_mlflow_is_left_to_who_knows_the_server(plant, tmp_path):
    server, own = f"sqlite:///{tmp_path / 'server.db'}", f"sqlite:///{plant / 'mlflow.db'}"
    assert pido("iterate", "-w", plant, MLFLOW_TRACKING_URI=server).returncode == 0
    for file in plant.glob("mlflow.db*"):
        file.unlink()
    third = list(made_up(3))[-1].rows(slice(0, 600))
    part = write_folder(third, tmp_path / third.part.part)
    done = pido("iterate", part, "-w", plant)
    assert done.returncode == 0
    assert "version 3" in done.stdout
    assert f"Not logged from here: iterations are logged at {server}; this shell points elsewhere" in done.stderr
    assert not list(plant.glob("mlflow.db*"))
    assert (not_at(plant, server), json.loads((plant / "mlflow.json").read_text())["address"]) == (1, server)
    code = "import sys; from pido.production import log; log(sys.argv[1])"  # as the plant's watcher does
    subprocess.run([sys.executable, "-c", code, plant], check=True, env={**os.environ, "MLFLOW_TRACKING_URI": server})
    assert set(data_sets(server)) == {"1", "2", "3"}
    assert "known already" in pido("iterate", part, "-w", plant).stdout
    assert "`pido iterate --log-here` would log them here too" in pido("status", "-w", plant).stdout
    assert pido("iterate", "--log-here", "-w", plant).returncode == 0
    assert set(data_sets(own)) == {"1", "2", "3"}
    assert "elsewhere" not in pido("status", "-w", plant).stdout


def test_the_address_that_is_kept_holds_no_password(tmp_path):
    from pido.tracking import whereabouts

    place = Workspace.open(tmp_path, tracking_uri="postgresql://ann:secret@db:5432/mlflow?sslpassword=other")
    whereabouts.remember(place)
    assert whereabouts.elsewhere(Workspace.open(tmp_path)) == ("postgresql://db:5432/mlflow", place.tracking_place)
    assert whereabouts.elsewhere(Workspace.open(tmp_path, tracking_uri="http://named.in.settings")) == ("", "")
    kept = (tmp_path / "mlflow.json").read_text()
    assert "secret" not in kept
    assert "other" not in kept
    assert "ann" not in kept


@pytest.mark.parametrize(
    ("address", "why"),
    [
        ("postgresql://ann:secret@127.0.0.1:9/mlflow", "onnection refused"),
        ("sqlite:///{folder}", "unable to open database file"),
        ("sqlite:///{file}", "file is not a database"),
    ],
)
def test_a_decision_says_soon_that_it_stands_where_mlflows_database_cannot_be_used(plant, tmp_path, address, why):
    (tmp_path / "no.db").write_text("no database, and too long to be taken for an empty one\n" * 9)
    address = address.format(folder=tmp_path, file=tmp_path / "no.db")
    start = time.monotonic()
    done = approved(plant, MLFLOW_TRACKING_URI=address)
    assert time.monotonic() - start < 25
    assert done.returncode == 0
    assert "version 2 is champion" in done.stdout
    [said] = done.stderr.splitlines()
    assert said.startswith("The decision stands; MLflow's aliases will follow later: ")
    assert why in said
    assert "secret" not in said
