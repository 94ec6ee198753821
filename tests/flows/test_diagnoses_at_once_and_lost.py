"""Two diagnoses of a machine at once, and killed ones, on a real Prefect server: none holds a process in vain, none is
lost, none is asked for without end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path

import psutil
import pytest
from click.testing import CliRunner
from plain_parts import parts as made_up
from plain_parts import with_simulation

from flows.server import prefect_server
from pido import parts, wanted
from pido.cli.status import command as status
from pido.recordings.folder import write_folder
from pido.tracking import bundle
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

pytestmark = [pytest.mark.servers, pytest.mark.filterwarnings("ignore::ResourceWarning")]
MACHINE = "cmx600v"
RUN = """
import os, signal, sys
from prefect import tags
from flows import diagnose, ownership, submit
from flows.diagnose import diagnose_newest

if sys.argv[3:] == ["halted"]:
    diagnose_into = diagnose.diagnose_into
    def halted(*given, **named):
        os.kill(os.getpid(), signal.SIGSTOP)
        return diagnose_into(*given, **named)
    diagnose.diagnose_into = halted

with tags(ownership.tag(sys.argv[1]), submit._diagnosis_of(sys.argv[2])):
    state = diagnose_newest(*sys.argv[1:3], return_state=True)
print(state.type.value, state.name, state.message)
"""


@pytest.fixture(scope="module")
def api(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with prefect_server(tmp_path_factory.mktemp("prefect")) as address:
        yield address


@pytest.fixture
def place(tmp_path: Path) -> Workspace:
    workspace = Workspace.open(tmp_path / "plant")
    takes(workspace, 1)
    return workspace


def takes(workspace: Workspace, number: int) -> None:
    """A part as after its iteration, and a wish for its diagnosis that nobody could be asked for."""
    from flows.diagnose import PARTS, _of

    part = with_simulation(list(made_up(number))[-1].rows(slice(0, 400)))
    folder = write_folder(part, workspace.root.parent / "parts" / part.part.part)
    known = parts.ingest(str(workspace.root), str(folder))
    made = bundle.save(workspace.bundles, {"machine": MACHINE, "parts": [part.part.part]}, {"x.skops": b"x"})
    gate = {"passed": True}
    Ledger(workspace.ledger).finished(f"run{number}", MACHINE, known["part"], known["name"], made.digest, gate, {})
    wanted.wish(workspace, MACHINE, _of(workspace, MACHINE, PARTS))


@contextmanager
def at_work(workspace: Workspace, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A diagnosis in a process of its own that halts itself (SIGSTOP) when it has begun and before it searches: halted
    from here, it can hold a lock that others take for a moment, and they wait for good."""
    call = [sys.executable, "-c", RUN, str(workspace.root), MACHINE, "halted"]
    with log.open("wb") as out:
        process = subprocess.Popen(call, env=os.environ.copy(), stdout=out, stderr=out)
        try:
            end = time.monotonic() + 180
            while psutil.Process(process.pid).status() != psutil.STATUS_STOPPED:
                assert process.poll() is None, log.read_text()[-2000:]
                assert time.monotonic() < end, log.read_text()[-2000:]
                time.sleep(0.05)
            yield process
        finally:
            process.kill()
            process.wait()


def said(workspace: Workspace) -> str:
    done = CliRunner().invoke(status, ["--workspace", str(workspace.root)], catch_exceptions=False)
    return "\n".join(line for line in done.output.splitlines() if line.startswith("diagnosis"))


@contextmanager
def offered(workspace: Workspace) -> Iterator[object]:
    """Prefect's client, while the flow is on offer for the workspace and no worker takes its runs."""
    from prefect.client.orchestration import get_client

    from flows import ownership
    from flows.diagnose import diagnose_newest

    name = f"newest-{workspace.id}"
    given = {"workspace": str(workspace.root)}
    diagnose_newest.to_deployment(name, tags=[ownership.tag(workspace.root)], parameters=given).apply()
    with get_client(sync_client=True) as client:
        yield client


def waiting(client: object, workspace: Workspace) -> list:
    from flows import ownership, submit

    return submit.runs(client, [ownership.tag(workspace.root), submit._diagnosis_of(MACHINE)], submit.WAITING)  # type: ignore[arg-type]


@pytest.mark.thorough
def test_a_second_diagnosis_of_a_machine_ends_at_once_and_the_first_asks_for_what_came_meanwhile(api, place, tmp_path):
    with offered(place) as client:
        with at_work(place, tmp_path / "first.log") as first:
            takes(place, 2)
            call = [sys.executable, "-c", RUN, str(place.root), MACHINE]
            second = subprocess.run(call, capture_output=True, text=True, check=True, timeout=120)
            assert second.stdout.splitlines()[-1].startswith("COMPLETED Folded A diagnosis of cmx600v is at work")
            assert not waiting(client, place)
            first.send_signal(signal.SIGCONT)
            assert first.wait(180) == 0, (tmp_path / "first.log").read_text()[-2000:]
        [run] = waiting(client, place)
        assert run.parameters["machine"] == MACHINE
        assert said(place) == "diagnosis  cmx600v: asked for, and not begun"
        third = subprocess.run(call, capture_output=True, text=True, check=True, timeout=120)
        assert third.stdout.splitlines()[-1].startswith("COMPLETED Completed")
        assert said(place) == "", "both parts are diagnosed"
        assert len(waiting(client, place)) == 1, "nothing is asked for that is done"


def test_a_killed_diagnosis_is_told_by_status_and_asked_for_once_more_and_no_oftener(api, place, tmp_path, monkeypatch):
    from prefect.states import Crashed

    from flows import submit

    monkeypatch.setattr(submit, "SILENT", timedelta(0))
    monkeypatch.setattr(submit, "SURE_S", 0.1)
    wanted.asked(place, MACHINE)
    with offered(place) as client:
        with at_work(place, tmp_path / "log") as process:
            assert said(place) == "diagnosis  cmx600v: at work"
            assert submit.sweep(place) == 0
            assert submit.ask_again(place) == 0, "it is at work"
            process.kill()
            process.wait()
        assert "its process was killed while it ran" in said(place)
        assert submit.sweep(place) == 1
        assert submit.ask_again(place) == 1
        assert submit.ask_again(place) == 0
        [run] = waiting(client, place)
        assert said(place) == "diagnosis  cmx600v: asked for, and not begun"
        client.set_flow_run_state(run.id, Crashed(), force=True)
        with at_work(place, tmp_path / "log") as process:
            process.kill()
        assert submit.sweep(place) == 1
        assert submit.ask_again(place) == 0, "once"
        assert "killed, also when it was asked for again" in said(place)
        takes(place, 2)
        assert said(place) == "diagnosis  cmx600v: wanted; nobody could be asked yet"
        assert submit.ask_again(place) == 1, "the next part's is another"


def test_a_diagnosis_that_a_person_cancelled_is_not_asked_for_again(api, place):
    from prefect.states import Cancelled

    from flows import submit

    with offered(place) as client:
        assert submit.ask_diagnosis(str(place.root), MACHINE) == ""
        [run] = waiting(client, place)
        client.set_flow_run_state(run.id, Cancelled(), force=True)
        assert submit.ask_again(place) == 0
        assert not waiting(client, place)
        assert "it was cancelled in Prefect. To try it sooner" in said(place)


def test_one_that_is_lost_twice_before_it_began_is_said_to_be_lost(api, place):
    from prefect.states import Crashed

    from flows import submit

    with offered(place) as client:
        assert submit.ask_diagnosis(str(place.root), MACHINE) == ""
        for again in (1, 0):
            [run] = waiting(client, place)
            assert said(place) == "diagnosis  cmx600v: asked for, and not begun"
            client.set_flow_run_state(run.id, Crashed(), force=True)
            assert submit.ask_again(place) == again
        assert not waiting(client, place)
        assert "lost before it began, also when it was asked for again" in said(place)
        takes(place, 2)
        assert submit.ask_again(place) == 1, "the next part's is another"


def test_one_that_failed_says_why_and_is_not_asked_for_again(api, place, tmp_path):
    from flows import submit

    (place.root / "workspace.toml").write_text('jobs = { cmx600v = "gear.toml" }\n')
    with offered(place):
        call = [sys.executable, "-c", RUN, str(place.root), MACHINE]
        failed = subprocess.run(call, capture_output=True, text=True, check=True, timeout=120)
        assert failed.stdout.splitlines()[-1].startswith("FAILED")
        wanted.asked(place, MACHINE)
        assert submit.ask_again(place) == 0
        assert "gear.toml: no such settings file" in said(place)
