"""A workspace that is copied or moved takes its MLflow artifacts along, and leaves those of the original alone."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from click.testing import CliRunner
from plain_parts import parts as made_up

from pido import plain
from pido.cli.iterate import command as iterate_again
from pido.cli.status import command as status
from pido.recordings.folder import write_folder
from pido.tracking.mlflow_store import client, experiment, model_names
from pido.workspace import Workspace

pytestmark = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::FutureWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]
MACHINE = "cmx600v"


def iterate(place: Workspace, number: int) -> None:
    *_, part = made_up(number)
    folder = write_folder(part.rows(slice(0, 600)), place.root / "given" / part.part.part)
    answer = plain.run(place, [folder], None, lambda *a: None)
    assert (answer["fault"], len(answer["done"])) == ("", 1)


@pytest.fixture(scope="module")
def original(tmp_path_factory) -> Workspace:
    root: Path = tmp_path_factory.mktemp("plant") / "hall 1, 100 %_a"  # what an address writes in another way
    root.mkdir()
    (root / "workspace.toml").write_text("compare = false\n[method]\nadaptive = false\ncompare_with_model = false\n")
    iterate(Workspace.open(root), 1)
    return Workspace.open(root)


def everything(folder: Path) -> dict[Path, bytes]:
    return {p.relative_to(folder): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def files_of_runs(place: Workspace) -> list[set[str]]:
    """What MLflow lists per run, oldest first; every model can be loaded from where MLflow says it is."""
    import mlflow

    with client(place) as store:
        runs = store.search_runs([experiment(place, store, MACHINE)], order_by=["attributes.start_time"])
        for name in model_names(MACHINE).values():
            for version in store.search_model_versions(f"name = '{name}'"):
                assert mlflow.sklearn.load_model(f"models:/{name}/{version.version}") is not None
        listed = [mlflow.artifacts.list_artifacts(artifact_uri=run.info.artifact_uri) or [] for run in runs]
    assert all(run.info.artifact_uri.startswith(place.root.as_uri() + "/") for run in runs)
    return [{Path(file.path).name for file in files} for files in listed]


def test_a_copy_writes_into_itself_and_a_moved_one_finds_what_it_had(original, tmp_path):
    before = everything(original.root)
    shutil.copytree(original.root, tmp_path / "copy")
    (tmp_path / "copy" / "workspace.id").unlink(missing_ok=True)
    iterate(Workspace.open(tmp_path / "copy"), 2)
    assert everything(original.root) == before
    assert files_of_runs(Workspace.open(tmp_path / "copy")) == [{"iteration", "report"}] * 2
    (tmp_path / "copy").rename(tmp_path / "moved")
    moved, ask = Workspace.open(tmp_path / "moved"), ["--workspace", str(tmp_path / "moved")]
    assert f"MLflow looks for artifacts in {(tmp_path / 'copy').as_uri()}" in CliRunner().invoke(status, ask).output
    assert "nothing to do" in CliRunner().invoke(iterate_again, ask).output
    assert "MLflow looks" not in CliRunner().invoke(status, ask).output
    assert files_of_runs(moved) == [{"iteration", "report"}] * 2
    with closing(sqlite3.connect(moved.root / "mlflow.db")) as db:
        dump = "\n".join(db.iterdump())
    assert (tmp_path / "copy").as_uri() + "/" not in dump
    assert original.root.as_uri() not in dump


def test_what_was_not_copied_is_still_found_where_it_is(original, tmp_path):
    shutil.copytree(original.root, tmp_path / "copy", ignore=shutil.ignore_patterns("mlartifacts"))
    place = Workspace.open(tmp_path / "copy")
    with client(place) as store:
        found = store.get_experiment(experiment(place, store, MACHINE))
        (run,) = store.search_runs([found.experiment_id])
    assert found.artifact_location.startswith(place.root.as_uri())
    assert run.info.artifact_uri.startswith(original.root.as_uri())


def test_a_store_that_two_workspaces_share_and_a_folder_by_another_name_stay_as_they_are(original, tmp_path):
    before = (original.root / "mlflow.db").read_bytes()
    (tmp_path / "link").symlink_to(original.root)
    for place in (Workspace.open(tmp_path / "other", tracking_uri=original.tracking_uri),
                  Workspace.open(tmp_path / "link")):  # fmt: skip
        with client(place) as store:
            assert store.get_experiment_by_name(f"pido {MACHINE}").artifact_location.startswith(original.root.as_uri())
    assert (original.root / "mlflow.db").read_bytes() == before
