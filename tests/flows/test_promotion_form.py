"""The approval form on a real server: the run waits without a process, and the answer becomes the stored decision."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from flows.server import die_with_parent, prefect_server, stop
from pido.tracking import bundle, promotion
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

pytestmark = [pytest.mark.servers, pytest.mark.slow]
MACHINE = "mill 1/hall ü"


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    place = Workspace.open(tmp_path / "plant")
    for number in (1, 2):
        models = {f"{axis}.skops": f"{axis}{number}".encode() for axis in ("x", "y", "z", "sp")}
        made = bundle.save(place.bundles, {"machine": MACHINE, "parts": [f"p{number}"]}, models)
        gate = {"passed": True, "words": "no axis is worse"}
        Ledger(place.ledger).finished(f"run{number}", MACHINE, f"p{number}", f"part {number}", made.digest, gate, {})
    return place


def waited(look, state: str, patience_s: float = 120.0):
    end = time.monotonic() + patience_s
    while (found := look()).state.name != state:
        assert time.monotonic() < end, f"{found.state} instead of {state}"
        assert not found.state.is_final() or found.state.name == state, str(found.state)
        time.sleep(0.5)
    return found


def answered(answer, patience_s: float = 30.0) -> None:
    """Prefect says Suspended a moment before the form can be answered."""
    end = time.monotonic() + patience_s
    while True:
        try:
            return answer()
        except RuntimeError as error:
            if "schema not found" not in str(error) or time.monotonic() > end:
                raise
        time.sleep(0.5)


def test_an_answered_form_puts_the_version_in_force_under_the_name_of_who_answered(workspace, tmp_path):
    with prefect_server(tmp_path / "prefect"):
        from prefect.client.orchestration import get_client
        from prefect.deployments import run_deployment
        from prefect.flow_runs import resume_flow_run

        environment = {**os.environ, "PREFECT_RUNNER_POLL_FREQUENCY": "1", "MLFLOW_TRACKING_URI": "http://127.0.0.1:9"}
        with (tmp_path / "worker.log").open("wb") as log:
            worker = subprocess.Popen(
                [sys.executable, "-m", "flows.serve", "--workspace", str(workspace.root)],
                env=environment, stdout=log, stderr=log, start_new_session=True, preexec_fn=die_with_parent,
            )  # fmt: skip
        try:
            with get_client(sync_client=True) as client:
                end = time.monotonic() + 120
                while not client.read_deployments() or len(client.read_deployments()) < 4:
                    assert worker.poll() is None, (tmp_path / "worker.log").read_text()[-2000:]
                    assert time.monotonic() < end, "the worker serves nothing"
                    time.sleep(0.5)
                asked = run_deployment("promote/approval", parameters={"machine": MACHINE, "version": 2}, timeout=0)
                waited(lambda: client.read_flow_run(asked.id), "Suspended")
                assert promotion.champion(workspace, MACHINE) is None
                answer = {"approve": True, "by": "A. Ito", "reason": "three good parts"}
                answered(lambda: resume_flow_run(asked.id, run_input=answer))
                waited(lambda: client.read_flow_run(asked.id), "Completed")
        finally:
            stop(worker)
    record = promotion.champion(workspace, MACHINE)
    assert record is not None
    assert (record.version, record.by, record.reason) == (2, "A. Ito", "three good parts")
    assert len(promotion.history(workspace, MACHINE)) == 1
