"""The worker on a real server: what it offers, and a part diagnosed after its iteration without holding it up."""

from __future__ import annotations

import os
import subprocess
import sys
from datetime import timedelta
from functools import partial
from pathlib import Path

import pytest
from plain_parts import parts as made_up
from served_worker import OFFERED, offered, served, waited

from benchmarks.plant_chaos import FORKS, VICTIMS, processes
from flows.server import prefect_server
from pido.recordings.folder import write_folder
from pido.tracking import bundle, promotion
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

pytestmark = [pytest.mark.servers, pytest.mark.slow]
MACHINE = "cmx600v"
SETTINGS = "compare = false\n[method]\nadaptive = false\ncompare_with_model = false\n"


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    (tmp_path / "plant" / "inbox").mkdir(parents=True)
    (tmp_path / "plant" / "workspace.toml").write_text(SETTINGS)
    return Workspace.open(tmp_path / "plant")


def test_each_arrival_is_diagnosed_in_a_run_of_its_own_and_night_and_experiments_are_offered(workspace, tmp_path):
    with prefect_server(tmp_path / "prefect"):
        from prefect.client.orchestration import get_client
        from prefect.deployments import run_deployment

        from flows.submit import submit

        with get_client(sync_client=True) as client, served(workspace, tmp_path / "worker.log", client):

            def ended(flow: str) -> list:
                ours = {f.id for f in client.read_flows() if f.name == flow}
                return [r for r in client.read_flow_runs() if r.flow_id in ours and r.state.is_final()]

            night = offered(client)["nightly/nightly"].schedules
            assert [s.schedule.cron for s in night if s.active] == ["0 3 * * *"]
            recording = next(iter(made_up(1)))
            part = write_folder(recording, workspace.inbox / recording.part.part)
            assert submit(str(workspace.root), str(part), "0" * 64, None)
            arrival = waited(lambda: ended("new-part"), 180)[0]
            diagnosed = waited(lambda: ended("diagnose"), 300)[0]
            assert (arrival.state.name, diagnosed.state.name) == ("Completed", "Completed")
            assert diagnosed.parent_task_run_id is None, "the iteration did not wait for it"
            assert {f"iteration-{MACHINE}", f"diagnosis-{MACHINE}"} <= {a.key for a in client.read_artifacts()}
            assert arrival.name == recording.part.part
            ours = [command for _, command in processes(str(tmp_path))]
            assert any(VICTIMS[FORKS] in c for c in ours), "runs are forked from a process that has imported everything"
            night_run = run_deployment("nightly/nightly", timeout=180, poll_interval=1)
            assert night_run.state.name == "Completed"
            assert len(ended("diagnose")) == 1, "what is diagnosed already is not asked for again"
    assert (workspace.root / "diagnosis" / MACHINE / "diagnosis.json").exists()
    [iteration] = Ledger(workspace.ledger).iterations(MACHINE)
    assert "diagnosis/report.html" in logged(workspace, iteration.logged)


def logged(workspace: Workspace, run: str) -> set[str]:
    from mlflow import MlflowClient

    return {f.path for f in MlflowClient(workspace.tracking_uri).list_artifacts(run, "diagnosis")}


def test_an_iteration_does_not_need_anyone_who_diagnoses(workspace, tmp_path):
    recording = next(iter(made_up(1)))
    part = write_folder(recording, workspace.inbox / recording.part.part)
    code = "import sys; from flows.new_part import new_part; new_part(*sys.argv[1:])"
    with prefect_server(tmp_path / "prefect"):
        call = [sys.executable, "-c", code, str(workspace.root), str(part)]
        done = subprocess.run(call, capture_output=True, text=True, check=False, env=os.environ.copy())
    assert done.returncode == 0, done.stderr[-2000:]
    assert "no diagnosis: no worker serves" in done.stderr
    assert len(Ledger(workspace.ledger).iterations(MACHINE)) == 1


def test_what_an_operator_pauses_stays_paused_and_the_time_of_the_night_follows_the_settings(workspace, tmp_path):
    with prefect_server(tmp_path / "prefect"):
        from prefect.client.orchestration import get_client

        with get_client(sync_client=True) as client:

            def nights() -> list[tuple[str, bool]]:
                return [(s.schedule.cron, s.active) for s in offered(client)["nightly/nightly"].schedules]

            with served(workspace, tmp_path / "worker.log", client):
                known = offered(client)
                assert nights() == [("0 3 * * *", True)]
                night = known["nightly/nightly"]
                client.update_deployment_schedule(night.id, night.schedules[0].id, active=False)
                client.pause_deployment(known["diagnose/newest"].id)
            with served(workspace, tmp_path / "again.log", client, PIDO_NIGHTLY="30 4 * * *"):
                waited(lambda: nights() == [("30 4 * * *", False)], 60)
                waited(lambda: (workspace.root / "worker.alive").exists(), 60)
                paused = {name for name, deployment in offered(client).items() if deployment.paused}
                assert paused == {"diagnose/newest"}


def test_a_part_waits_for_no_diagnosis_and_two_diagnoses_do_not_run_at_once(workspace, tmp_path):
    with prefect_server(tmp_path / "prefect"):
        from prefect.client.orchestration import get_client
        from prefect.deployments import run_deployment

        with (
            get_client(sync_client=True) as client,
            workspace.lock("wanted a"),
            served(workspace, tmp_path / "worker.log", client),
        ):
            ask = partial(run_deployment, "diagnose/newest", parameters={"machine": "a"}, timeout=0)
            diagnoses = [ask().id for _ in range(4)]
            states = lambda: [client.read_flow_run(run).state.name for run in diagnoses]  # noqa: E731
            waited(lambda: states().count("Running") == 1, 60)
            absent = {"path": str(workspace.inbox / "absent")}
            arrival = run_deployment("new-part/arrivals", parameters=absent, timeout=60, poll_interval=1)
            decision = run_deployment(
                "promote/approval", parameters={"machine": "a", "version": 1}, timeout=60, poll_interval=1
            )
            assert (arrival.state.name, decision.state.name) == ("Failed", "Failed"), "they have run"
            assert sorted(states()) == ["Running", "Scheduled", "Scheduled", "Scheduled"] or states().count("Late")
            assert states().count("Running") == 1
    assert "at capacity" not in (tmp_path / "worker.log").read_text()


def test_what_mlflow_has_not_got_is_said_in_the_log_of_the_run_and_on_its_page(workspace, tmp_path):
    recording = next(iter(made_up(1)))
    part = write_folder(recording, workspace.inbox / recording.part.part)
    with prefect_server(tmp_path / "prefect"):
        from prefect.client.orchestration import get_client
        from prefect.client.schemas.filters import LogFilter
        from prefect.deployments import run_deployment

        with (
            get_client(sync_client=True) as client,
            served(workspace, tmp_path / "worker.log", client, MLFLOW_TRACKING_URI="http://127.0.0.1:9"),
        ):
            run = run_deployment("new-part/arrivals", parameters={"path": str(part)}, timeout=180, poll_interval=1)
            ours = LogFilter(flow_run_id={"any_": [run.id]})
            waited(lambda: any("MLflow has not taken it" in line.message for line in client.read_logs(ours)), 30)
            [page] = [a.data for a in client.read_artifacts() if a.key == f"iteration-{MACHINE}"]
            assert "Not in MLflow yet" in page


def test_a_run_without_a_process_is_told_from_one_that_has_one(workspace, tmp_path, monkeypatch):
    with prefect_server(tmp_path / "prefect"):
        from prefect.client.orchestration import get_client
        from prefect.states import Pending, Running

        from flows import ownership, submit
        from flows.new_part import nightly

        monkeypatch.setattr(submit, "SILENT", timedelta(0))
        monkeypatch.setattr(submit, "SURE_S", 0.1)
        with get_client(sync_client=True) as client:

            def run_in(state, *tags):
                run = client.create_flow_run(nightly, parameters={"workspace": str(workspace.root)}, tags=tags)
                client.set_flow_run_state(run.id, state, force=True)
                return run.id

            ours = ownership.tag(workspace.root)
            dead, alive, starting = run_in(Running(), ours), run_in(Running(), ours), run_in(Pending(), ours)
            others = [run_in(Running()), run_in(Running(), "workspace:elsewhere")]
            with workspace.lock(f"run {alive}"):
                assert submit.sweep(workspace) == 1
            states = [client.read_flow_run(run).state.name for run in (dead, alive, starting)]
            assert states == ["Crashed", "Running", "Pending"]
            monkeypatch.setattr(submit, "STARTING", timedelta(0))
            assert submit.sweep(workspace) == 2
            assert client.read_flow_run(starting).state.name == "Crashed", "it never got a process"
            assert [client.read_flow_run(run).state.name for run in others] == ["Running"] * 2, "of other workspaces"


def decided(place: Workspace) -> None:
    """A version about which nothing is left to decide: its page says so at once."""
    made = bundle.save(place.bundles, {"machine": MACHINE, "parts": ["p1"]}, {"x.skops": b"x"})
    Ledger(place.ledger).finished("run1", MACHINE, "p1", "part 1", made.digest, {"passed": True}, {})
    promotion.reject(place, MACHINE, 1, by="A. Ito", reason="a test")


def test_two_workspaces_on_one_server_keep_their_own_deployments_runs_and_artifacts(workspace, tmp_path):
    (tmp_path / "second").mkdir()
    second = Workspace.open(tmp_path / "second")
    with prefect_server(tmp_path / "prefect"):
        from prefect.client.orchestration import get_client
        from prefect.deployments import run_deployment

        with get_client(sync_client=True) as client:  # from before there were tags: it is the first one's by its folder
            flow, place = client.create_flow_from_name("new-part"), {"workspace": str(workspace.root)}
            client.create_deployment(flow, "arrivals", parameters=place)
        with (
            get_client(sync_client=True) as client,
            served(workspace, tmp_path / "worker.log", client),
            served(second, tmp_path / "second.log", client),
        ):
            places = {name: d.parameters["workspace"] for name, d in offered(client).items()}
            assert {name: place for name, place in places.items() if place == str(workspace.root)}.keys() == OFFERED
            others = {f"{name}-{second.id}" for name in OFFERED}
            assert {name for name, place in places.items() if place == str(second.root)} == others
            shown = {}
            for place, ending in ((workspace, ""), (second, f"-{second.id}")):
                run = run_deployment(f"nightly/nightly{ending}", timeout=120, poll_interval=1)
                assert (run.state.name, run.parameters["workspace"]) == ("Completed", str(place.root))
                decided(place)
                asked = {"machine": MACHINE, "version": 1}
                for _ in range(2):
                    run = run_deployment(f"promote/approval{ending}", parameters=asked, timeout=120, poll_interval=1)
                    shown[run.id] = f"decision-{MACHINE}{ending}"
            assert {a.flow_run_id: a.key for a in client.read_artifacts()} == shown, "a key's artifacts are one's own"
        with get_client(sync_client=True) as client, served(second, tmp_path / "again.log", client):
            assert set(offered(client)) == set(places), "started again, it keeps its names"
