"""The approval form on a real server: the run waits without a process, and the answer becomes the stored decision."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from served_worker import served, waited

from flows.pages import key
from flows.server import prefect_server
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


def reached(look, state: str) -> None:
    """Wait until the run is in this state; another final one is a fault."""

    def right() -> bool:
        found = look().state
        assert not found.is_final() or found.name == state, str(found)
        return found.name == state

    waited(right, 120)


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
        from prefect.client.schemas.filters import LogFilter
        from prefect.deployments import run_deployment
        from prefect.flow_runs import resume_flow_run

        with (
            get_client(sync_client=True) as client,
            served(workspace, tmp_path / "worker.log", client, MLFLOW_TRACKING_URI="http://127.0.0.1:9"),
        ):
            asked = run_deployment("promote/approval", parameters={"machine": MACHINE, "version": 2}, timeout=0)
            reached(lambda: client.read_flow_run(asked.id), "Suspended")
            assert promotion.champion(workspace, MACHINE) is None
            answer = {"decision": "approve", "by": "A. Ito", "reason": "three good parts"}
            for wrong in ({}, {**answer, "decision": ""}, {**answer, "by": " "}, {"by": "A. Ito", "reason": "good"}):
                with pytest.raises(RuntimeError, match=r"is a required|is not one of|does not match"):
                    answered(lambda wrong=wrong: resume_flow_run(asked.id, run_input=wrong))
                assert client.read_flow_run(asked.id).state.name == "Suspended", "it goes on waiting"
            answered(lambda: resume_flow_run(asked.id, run_input=answer))
            reached(lambda: client.read_flow_run(asked.id), "Completed")
            said = client.read_flow_run(asked.id).state.message
            assert "version 2 is in force, decided by A. Ito" in said
            assert said.endswith(": three good parts")
            ours = LogFilter(flow_run_id={"any_": [asked.id]})
            waited(lambda: said in [line.message for line in client.read_logs(ours)], 30)  # they come in batches
            assert [a.key for a in client.read_artifacts() if a.flow_run_id == asked.id] == [key("decision", MACHINE)]
    record = promotion.champion(workspace, MACHINE)
    assert record is not None
    assert (record.version, record.by, record.reason) == (2, "A. Ito", "three good parts")
    assert len(promotion.history(workspace, MACHINE)) == 1
