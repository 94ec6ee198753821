"""A whole plant as `make plant` starts it: parts arrive, a version is promoted, all of it is saved,
destroyed and brought back. One plant for all tests of this module, in their order."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from plain_parts import parts as made_up
from plain_parts import with_simulation

from benchmarks.plant_chaos import Plant, full_state, in_mlflow, settled, until
from deploy import postgres
from pido.recordings.folder import write_folder
from pido.tracking import promotion
from pido.tracking.ledger import Ledger

MACHINE = "cmx600v"
SETTINGS = "[method]\nadaptive = false\ncompare_with_model = false\n"
PARTS = 3


pytestmark = [
    pytest.mark.servers,
    pytest.mark.slow,
    pytest.mark.skipif(not postgres.is_installed(), reason="PostgreSQL is missing (apt-get install postgresql)"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]


@pytest.fixture(scope="module")
def place() -> Iterator[Path]:
    """Where the database's own user may enter, which pytest's temporary folders are not."""
    folder = Path(tempfile.mkdtemp(prefix="pido-plant-", dir="/tmp"))
    folder.chmod(0o755)
    yield folder
    shutil.rmtree(folder)


@pytest.fixture(scope="module")
def plant(place: Path) -> Iterator[Plant]:
    (place / "old" / "workspace").mkdir(parents=True)
    (place / "old" / "workspace" / "workspace.toml").write_text(SETTINGS)
    with Plant(place / "old", place / "old.log") as running, running.as_client():
        for part in made_up(PARTS):
            folder = write_folder(with_simulation(part).rows(slice(0, 700)), place / "parts" / part.part.part)
            running.drop(folder)
        yield running


def artifacts(plant: Plant) -> dict[str, str]:
    """Key -> content of the artifacts on Prefect's pages."""
    from prefect.client.orchestration import get_client

    with plant.as_client(), get_client(sync_client=True) as client:
        return {a.key: str(a.data) for a in client.read_artifacts() if a.key}


def test_parts_that_arrive_are_taken_and_a_version_that_passed_its_gate_is_promoted_from_the_command_line(plant):
    ledger = Ledger(plant.workspace.ledger)
    until(lambda: len(ledger.parts(MACHINE)) == PARTS, "the parts were not taken")
    assert settled(plant, MACHINE, {}) == ""
    version = [v.version for v in ledger.versions(MACHINE) if v.gate["passed"]][-1]
    assert plant.decide("approve", str(version)).wait(120) == 0
    record = promotion.champion(plant.workspace, MACHINE)
    assert record is not None
    assert (record.version, record.by) == (version, "chaos")
    assert settled(plant, MACHINE, {}) == "", "MLflow's aliases have followed"


def test_the_physics_of_the_newest_parts_was_looked_at(plant):
    found = until(lambda: {"iteration", "diagnosis"} <= set(artifacts(plant)) and artifacts(plant), "no diagnosis")
    assert f"Diagnosis of {MACHINE}" in found["diagnosis"]
    until(lambda: "diagnosis-report" in artifacts(plant), "no link to the report in MLflow")
    assert "RMSE" in found["iteration"]


def test_everything_comes_back_in_another_folder_after_the_plant_was_destroyed(plant, place):
    before = full_state(plant.workspace, MACHINE)
    assert len(before["parts"]) == PARTS
    call = [sys.executable, "-m", "deploy.plant", "--folder"]
    archive = str(place / "backup.tar")
    subprocess.run([*call, str(plant.folder), "backup", archive], check=True)
    plant.stop()
    assert plant.left() == [], "nothing of a plant that was stopped is left running"
    shutil.rmtree(plant.folder)
    subprocess.run([*call, str(place / "new"), "restore", archive], check=True)
    with Plant(place / "new", place / "new.log") as again, again.as_client():
        assert settled(again, MACHINE, before) == ""
        assert in_mlflow(again, MACHINE) == ""
        assert {"iteration", "diagnosis"} <= set(artifacts(again))
    assert again.left() == []
