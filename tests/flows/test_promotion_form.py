"""The approval form on a real server: the run waits without a process, and the answer becomes the stored decision."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from uuid import UUID

import pytest
from prefect.client.orchestration import SyncPrefectClient
from served_worker import served, waited

from flows.pages import key
from flows.server import prefect_server
from pido.tracking import bundle, promotion
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

pytestmark = [pytest.mark.servers, pytest.mark.slow]
MACHINE = "mill 1/hall ü"


@pytest.fixture(scope="module")
def workspace(tmp_path_factory) -> Workspace:
    """Versions 1 and 2 passed their gates, version 3 did not."""
    place = Workspace.open(tmp_path_factory.mktemp("promotion") / "plant")
    for number in (1, 2, 3):
        models = {f"{axis}.skops": f"{axis}{number}".encode() for axis in ("x", "y", "z", "sp")}
        made = bundle.save(place.bundles, {"machine": MACHINE, "parts": [f"p{number}"]}, models)
        gate = {"passed": number < 3, "words": "no axis is worse" if number < 3 else "x is worse by 3 %"}
        Ledger(place.ledger).finished(f"run{number}", MACHINE, f"p{number}", f"part {number}", made.digest, gate, {})
    return place


@pytest.fixture(scope="module")
def client(workspace) -> Iterator[SyncPrefectClient]:
    """Of a server on which a worker offers the flows of `workspace`."""
    with prefect_server(workspace.root.parent / "prefect"):
        from prefect.client.orchestration import get_client

        with (
            get_client(sync_client=True) as found,
            served(workspace, workspace.root.parent / "worker.log", found, MLFLOW_TRACKING_URI="http://127.0.0.1:9"),
        ):
            yield found


def suspended(client: SyncPrefectClient, version: int) -> UUID:
    """A run that waits for the decision on a version."""
    from prefect.deployments import run_deployment

    asked = run_deployment("promote/approval", parameters={"machine": MACHINE, "version": version}, timeout=0)
    reached(lambda: client.read_flow_run(asked.id), "Suspended")
    return asked.id


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


def test_an_answered_form_puts_the_version_in_force_under_the_name_of_who_answered(workspace, client):
    from prefect.client.schemas.filters import LogFilter
    from prefect.flow_runs import resume_flow_run

    run = suspended(client, 2)
    assert promotion.champion(workspace, MACHINE) is None
    answer = {"decision": "approve", "by": "A. Ito", "reason": "three good parts"}
    for wrong in ({}, {**answer, "decision": ""}, {**answer, "by": " "}, {"by": "A. Ito", "reason": "good"}):
        with pytest.raises(RuntimeError, match=r"is a required|is not one of|does not match"):
            answered(lambda wrong=wrong: resume_flow_run(run, run_input=wrong))
        assert client.read_flow_run(run).state.name == "Suspended", "it goes on waiting"
    answered(lambda: resume_flow_run(run, run_input=answer))
    reached(lambda: client.read_flow_run(run), "Completed")
    said = client.read_flow_run(run).state.message
    assert "version 2 is in force, decided by A. Ito" in said
    assert said.endswith(": three good parts")
    ours = LogFilter(flow_run_id={"any_": [run]})
    waited(lambda: said in [line.message for line in client.read_logs(ours)], 30)  # they come in batches
    assert [a.key for a in client.read_artifacts() if a.flow_run_id == run] == [key("decision", MACHINE)]
    record = promotion.champion(workspace, MACHINE)
    assert record is not None
    assert (record.version, record.by, record.reason) == (2, "A. Ito", "three good parts")
    assert [r.version for r in promotion.history(workspace, MACHINE)].count(2) == 1


def test_the_form_of_a_version_that_did_not_pass_its_gate_offers_no_approval_and_takes_a_rejection(workspace, client):
    from prefect.flow_runs import resume_flow_run

    run = suspended(client, 3)
    answer = {"decision": "approve", "by": "A. Ito", "reason": "I insist"}
    with pytest.raises(RuntimeError, match=r"'approve' is not one of \['reject'\]"):
        answered(lambda: resume_flow_run(run, run_input=answer))
    keyset = client.read_flow_run(run).state.state_details.run_input_keyset
    asked = json.loads(client.read_flow_run_input(run, keyset["schema"]))
    assert asked["properties"]["decision"]["enum"] == ["reject"]
    about = json.loads(client.read_flow_run_input(run, keyset["description"]))
    assert "Approval is not offered" in about
    assert "x is worse by 3 %" in about
    answered(lambda: resume_flow_run(run, run_input={**answer, "decision": "reject"}))
    reached(lambda: client.read_flow_run(run), "Completed")
    states = {s.version.version: s.state for s in promotion.standings(workspace, MACHINE)}
    assert states[3] == "rejected"
