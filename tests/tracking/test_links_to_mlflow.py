"""Links to MLflow's pages on a real server that the worker calls by one address and people by another."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from served_worker import waited

from flows.new_part import page
from flows.server import answers, die_with_parent, free_port, stop
from pido.tracking import bundle
from pido.tracking.diagnoses import attach
from pido.tracking.ledger import Ledger
from pido.tracking.mlflow_store import KEY, client, experiment
from pido.tracking.pages import address_of, how_to_open
from pido.workspace import MLFLOW_PAGE, Workspace

pytestmark = [
    pytest.mark.servers,
    pytest.mark.thorough,
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::FutureWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]
MACHINE, RUN = "m1", "run1"


@pytest.fixture(scope="module")
def port(tmp_path_factory) -> Iterator[int]:
    """Of an MLflow server."""
    home, number = tmp_path_factory.mktemp("mlflow"), free_port()
    call = [sys.executable, "-m", "mlflow", "server", "--host", "127.0.0.1", "--port", str(number), "--workers", "1",
            "--backend-store-uri", f"sqlite:///{home / 'mlflow.db'}",
            "--artifacts-destination", str(home / "artifacts")]  # fmt: skip
    with (home / "log").open("wb") as out:
        server = subprocess.Popen(call, stdout=out, stderr=out, start_new_session=True, preexec_fn=die_with_parent)
    try:
        waited(lambda: answers(f"http://127.0.0.1:{number}/health"), 120)
        yield number
    finally:
        stop(server)


def with_a_run(workspace: Workspace) -> str:
    """An iteration that MLflow has: its run."""
    made = bundle.save(workspace.bundles, {"machine": MACHINE, "parts": ["p1"]}, {"x.skops": b"x"})
    gate = {"passed": True, "words": "no axis is worse"}
    Ledger(workspace.ledger).finished(RUN, MACHINE, "p1", "part 1", made.digest, gate, {})
    with client(workspace) as store:
        run = store.create_run(experiment(workspace, store, MACHINE), tags={KEY: RUN}).info.run_id
    Ledger(workspace.ledger).logged(RUN, run, workspace.tracking_place)
    return run


def links(workspace: Workspace, tmp_path: Path) -> list[str]:
    """To an iteration's run, and to the report of a diagnosis."""
    (tmp_path / "report.html").write_text("a diagnosis")
    one = Ledger(workspace.ledger).iteration(RUN)
    assert one is not None
    report, fault = attach(workspace, MACHINE, tmp_path)
    assert fault == ""
    return [address_of(workspace, one), report]


def test_links_lead_where_browsers_find_mlflow_and_the_worker_goes_on_calling_it_by_its_own_address(
    port, tmp_path, monkeypatch
):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"http://127.0.0.1:{port}")
    monkeypatch.setenv(MLFLOW_PAGE, f"http://localhost:{port}/")
    place = Workspace.open(tmp_path / "plant")
    run = with_a_run(place)
    to_run, to_report = links(place, tmp_path)
    assert to_run.startswith(f"http://localhost:{port}/#/experiments/")
    assert to_report.startswith(f"http://localhost:{port}/#/experiments/")
    assert f"/runs/{run}?" in to_run
    assert f"/runs/{run}/artifacts/diagnosis/report.html?" in to_report
    assert answers(to_run), "by this name, too, the server answers"
    outcome = {"machine": MACHINE, "version": 1, "part": {"name": "p"}, "gate": {"words": ""}, "run_key": RUN,
               "metrics": {}}  # fmt: skip
    assert f"({to_run})" in page(place, outcome, "")
    assert how_to_open(place, MACHINE) == to_run.replace(f"/{run}", "")
    assert answers(how_to_open(place, MACHINE))
    (place.root / "workspace.toml").write_text('tracking_page = "https://plant.example/mlflow"\n')
    named = Workspace.open(place.root)
    assert all(link.startswith("https://plant.example/mlflow/#/") for link in links(named, tmp_path))


def test_without_a_name_for_people_links_lead_to_the_server_and_do_not_hold_its_password(port, tmp_path, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"http://ann:secret@127.0.0.1:{port}/")
    monkeypatch.delenv(MLFLOW_PAGE, raising=False)
    place = Workspace.open(tmp_path / "plant")
    with_a_run(place)
    assert all(link.startswith(f"http://127.0.0.1:{port}/#/") for link in links(place, tmp_path))
    monkeypatch.setenv(MLFLOW_PAGE, "http://plant-pc:5000")
    other = Workspace.open(tmp_path / "other", tracking_uri=f"http://127.0.0.1:{port}")
    assert other.tracking_page == other.tracking_uri, "what the environment names is of the environment's server"
    for name in ("MLFLOW_TRACKING_URI", MLFLOW_PAGE):
        monkeypatch.delenv(name)
    assert Workspace.open(tmp_path / "alone").tracking_page == "", "nothing serves a file"
