"""The flow on a real local Prefect server: the same result as the plain call, rejected input, nothing left running."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from datetime import timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest
from plain_parts import parts as made_up

from flows.pages import key
from flows.server import prefect_server
from pido.recordings.folder import write_folder
from pido.tracking import bundle, promotion
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

pytestmark = pytest.mark.servers

SETTINGS = "[method]\nadaptive = false\ncompare_with_model = false\n"


@pytest.fixture(scope="module")
def api(tmp_path_factory):
    with prefect_server(tmp_path_factory.mktemp("prefect")) as address:
        yield address


def place(root: Path) -> Workspace:
    root.mkdir()
    (root / "inbox").mkdir()
    (root / "workspace.toml").write_text(SETTINGS)
    return Workspace.open(root)


def deliver(workspace: Workspace, number: int) -> Path:
    part = list(made_up(number))[-1].rows(slice(0, 700))
    return write_folder(part, workspace.inbox / part.part.part)


def flow(workspace: Workspace, *paths: Path) -> subprocess.CompletedProcess[str]:
    """Flow runs in a process of their own, as a worker would start them."""
    code = "import sys; from flows.new_part import new_part; [new_part(sys.argv[1], p) for p in sys.argv[2:]]"
    call = [sys.executable, "-c", code, str(workspace.root), *map(str, paths)]
    return subprocess.run(call, capture_output=True, text=True, check=False, env=os.environ.copy())


def content(workspace: Workspace) -> dict:
    last = Ledger(workspace.ledger).versions("cmx600v")[-1]
    found = bundle.load(workspace.bundles, last.bundle).content
    return {name: found[name] for name in ("parts", "data", "models", "equation", "limits", "seed")}


def test_parts_through_the_flow_end_in_the_same_models_as_plain_calls(api, tmp_path):
    flowed, plainly = place(tmp_path / "flowed"), place(tmp_path / "plain")
    done = flow(flowed, *[deliver(flowed, number) for number in (1, 2)])
    assert done.returncode == 0, done.stderr[-2000:]
    given = [str(deliver(plainly, number)) for number in (1, 2)]
    call = [sys.executable, "-m", "pido.cli", "iterate", *given, "--workspace", str(plainly.root)]
    subprocess.run(call, check=True, capture_output=True)
    assert content(flowed) == content(plainly)
    assert not list(flowed.inbox.iterdir()), "what was taken in has left the inbox"
    assert all(i.logged for i in Ledger(flowed.ledger).iterations("cmx600v"))
    names = {t["name"].rsplit("-", 1)[0] for t in _task_runs(api)}
    assert {"ingest", "relevant bins", "refit", "PiA and PiE", "retrain", "evaluate", "publish", "log"} <= names


def test_a_recording_that_cannot_be_used_fails_its_run_and_lies_in_the_rejected_area(api, tmp_path):
    workspace = place(tmp_path / "plant")
    broken = workspace.inbox / "broken.json"
    broken.write_text('{"Header": ')
    assert flow(workspace, broken).returncode != 0
    assert not broken.exists()
    assert len(list((workspace.store / "rejected").glob("*.reason.txt"))) == 1
    assert Ledger(workspace.ledger).machines() == []


def test_a_copy_that_paused_is_left_and_a_part_that_comes_again_is_said_to_be_known(api, tmp_path):
    workspace = place(tmp_path / "plant")
    part = deliver(workspace, 1)
    shutil.copytree(part, again := part.with_name("again"))
    recording, half = part / "recording.parquet", tmp_path / "recording.parquet"
    recording.rename(half)
    code = (
        "import sys; from flows.new_part import new_part; workspace, part, again, half = sys.argv[1:]\n"
        "from pathlib import Path\n"
        "state = new_part(workspace, part, patient=True, return_state=True)\n"
        "print(state.type.value, state.name, state.message)\n"
        "Path(half).rename(Path(part) / 'recording.parquet')\n"
        "for path in (part, again): print(new_part(workspace, path))\n"
    )
    call = [sys.executable, "-c", code, *map(str, (workspace.root, part, again, half))]
    done = subprocess.run(call, capture_output=True, text=True, check=False, env=os.environ.copy())
    assert done.returncode == 0, done.stderr[-2000:]
    left, first, second = done.stdout.splitlines()[-3:]
    assert left.startswith("COMPLETED LeftForLater Left in the inbox for a later look.")
    assert Ledger(workspace.ledger).rejections() == []
    assert "'new': True" in first
    assert "'new': False" in second
    assert "Nothing new: this is part demo-01 of cmx600v, which is known already" in done.stderr
    assert done.stderr.count("no diagnosis") == 1, "none is asked for what is known"
    assert list(workspace.inbox.iterdir()) == []


def test_a_part_waits_in_the_inbox_while_the_plants_settings_are_at_fault(api, tmp_path):
    workspace = place(tmp_path / "plant")
    part = deliver(workspace, 1)
    (workspace.root / "workspace.toml").write_text('[jobs]\ncmx600v = "share/gear.toml"\n')
    done = flow(workspace, part)
    assert done.returncode != 0
    assert "gear.toml: no such settings file" in done.stderr
    assert part.exists()
    assert Ledger(workspace.ledger).rejections() == []


@pytest.mark.thorough
def test_a_machine_that_fails_does_not_end_the_night_for_the_others(api, tmp_path):
    workspace = place(tmp_path / "plant")
    other = next(made_up(1, machine="dmc60h")).rows(slice(0, 700))
    assert flow(workspace, deliver(workspace, 1), write_folder(other, workspace.inbox / "other")).returncode == 0
    (workspace.root / "workspace.toml").write_text('seed = 1\njobs = { cmx600v = "gear.toml" }\n' + SETTINGS)
    code = "import sys; from flows.new_part import nightly; nightly(sys.argv[1])"
    night = subprocess.run([sys.executable, "-c", code, str(workspace.root)], capture_output=True, text=True)
    assert night.returncode != 0
    assert "1 machine(s) failed, and no other:\n  cmx600v: " in night.stderr
    ledger = Ledger(workspace.ledger)
    assert [len(ledger.iterations(machine)) for machine in ("cmx600v", "dmc60h")] == [1, 2]


@pytest.mark.thorough
def test_what_a_killed_run_had_published_and_not_told_is_told_by_the_next_one(api, tmp_path):
    workspace = place(tmp_path / "plant")
    part = deliver(workspace, 1)
    code = "import sys; from flows.new_part import new_part; new_part(*sys.argv[1:])"
    call = [sys.executable, "-c", code, str(workspace.root), str(part)]
    with socket.create_server(("127.0.0.1", 0)) as silent:  # an MLflow that takes calls and never answers
        silent.settimeout(180)
        own = {**os.environ, "MLFLOW_TRACKING_URI": f"http://127.0.0.1:{silent.getsockname()[1]}"}
        with (tmp_path / "log").open("wb") as log:
            run = subprocess.Popen(call, env=own, stdout=log, stderr=log)
            try:
                with silent.accept()[0]:
                    run.kill()
            finally:
                run.kill()
                run.wait()
    assert len(Ledger(workspace.ledger).iterations("cmx600v")) == 1, "it was published"
    wanted = key("iteration", "cmx600v") + f"-{workspace.id}"
    assert not _artifacts(api, wanted)
    done = subprocess.run(call, capture_output=True, text=True, check=False, env=os.environ.copy())
    assert done.returncode == 0, done.stderr[-2000:]
    assert "no diagnosis: no worker serves" in done.stderr, "it was asked for"
    assert "Nothing new" not in done.stderr
    [page] = _artifacts(api, wanted)
    assert "version 1" in page["data"]
    assert not part.exists()
    assert not list(workspace.work.iterdir())
    deliver(workspace, 1)
    again = subprocess.run(call, capture_output=True, text=True, check=False, env=os.environ.copy())
    assert "Nothing new" in again.stderr
    assert "no diagnosis" not in again.stderr
    assert len(_artifacts(api, wanted)) == 1


ASKED_FOR = """
import threading, time
from prefect.client.orchestration import get_client
from prefect.states import Completed
from flows import ownership
from flows.new_part import new_part
from pido.cli.watch import command

new_part.to_deployment("arrivals", tags=[ownership.tag("plant")]).apply()
words = ["plant/inbox", "--workspace", "plant", "--prefect"]
threading.Thread(target=command.main, args=[words], kwargs={"standalone_mode": False}, daemon=True).start()
with get_client(sync_client=True) as client:
    while not (runs := [run for run in client.read_flow_runs() if "unread.csv" in run.parameters.get("path", "")]):
        time.sleep(0.2)
    client.set_flow_run_state(runs[0].id, Completed(), force=True)
print(runs[0].parameters["workspace"], runs[0].parameters["path"])
"""


def test_a_run_is_asked_for_by_paths_that_hold_wherever_its_worker_was_started(api, tmp_path):
    workspace = place(tmp_path / "plant")
    (workspace.inbox / "unread.csv").write_text("time,curr_x")
    call = [sys.executable, "-c", ASKED_FOR]
    done = subprocess.run(call, capture_output=True, text=True, check=True, cwd=tmp_path, timeout=120)
    assert done.stdout.split()[-2:] == [str(workspace.root), str(workspace.inbox / "unread.csv")]


TWO_AT_A_TIME = """
import os
import sys
from pathlib import Path
from types import SimpleNamespace
from prefect.client.orchestration import get_client
from prefect.deployments import run_deployment
from prefect.states import Completed, Crashed
from flows import ownership
from flows.new_part import new_part
from pido.arrivals import Arrived
from pido.backlog import Backlog
from pido.cli.watch import _through_prefect
from pido.workspace import Workspace

new_part.to_deployment("arrivals", tags=[ownership.tag(sys.argv[1])]).apply()
new_part.to_deployment("arrivals-elsewhere", tags=["workspace:elsewhere"]).apply()
for name in ("one", "two", "three"):
    theirs = {"workspace": "", "path": name}
    run_deployment("new-part/arrivals-elsewhere", parameters=theirs, tags=["arrival"], timeout=0)
clock, place = [0.0], Workspace.open(sys.argv[1])
os.chdir(place.root)
inbox = [Arrived(Path(f"part {k}"), str(k) * 64, 60.0) for k in range(5)]
for one in inbox:
    one.path.touch()
backlog = Backlog(place, place.inbox, lambda: clock[0])
look = _through_prefect(place, None, backlog)
with get_client(sync_client=True) as client:
    def all_runs():
        return sorted(client.read_flow_runs(), key=lambda run: run.created)
    def asked():
        paths = [run.parameters.get("path", "") for run in all_runs()]
        return [int(path[5:]) for path in paths if path.startswith("part ")]
    def ends(part, state):
        runs = [run for run in all_runs() if run.parameters.get("path") == f"part {part}"]
        client.set_flow_run_state(runs[-1].id, state, force=True)
    look(inbox)
    look(inbox)
    assert asked() == [0, 1], "two at a time, the first in production order"
    inbox[0].path.unlink()
    ends(0, Completed())
    look(inbox)
    assert asked() == [0, 1, 2], "a run took it away since the inbox was looked at: it is not asked for again"
    ends(1, Crashed())
    look(inbox[1:])
    assert asked() == [0, 1, 2, 3], "what was asked for before lets the others go first"
    ends(2, Completed())
    ends(3, Completed())
    clock[0] = 2.0
    look([inbox[1], inbox[4]])
    assert asked() == [0, 1, 2, 3, 4, 1], "a run that was lost is asked for again"
    ends(1, Crashed())
    clock[0] = 5.0
    look([inbox[1]])
    assert len(asked()) == 6, "but more and more seldom"
    clock[0] = 6.0
    look([inbox[1]])
    assert asked() == [0, 1, 2, 3, 4, 1, 1]
    assert "2 run(s) have not taken it" in backlog.reason(inbox[1])
    for machine, name in (("b", "part 7"), ("b", "part 8"), ("b", "part 9"), ("c", "part 6")):
        (place.inbox / name).mkdir()
        (place.inbox / name / "part.json").write_text('{"machine": "%s"}' % machine)
    others = [Arrived(place.inbox / f"part {k}", str(k) * 64, 1.0) for k in (7, 8, 9, 6)]
    look([*inbox[1:4], *others])
    look([*inbox[1:4], *others])
    paths = [Path(run.parameters["path"]).name for run in all_runs()[-3:]]
    assert paths == ["part 7", "part 8", "part 6"], f"no machine's queue holds up another's: {paths}"
    clock[0], brief = 100.0, others[3]
    client.set_flow_run_state(all_runs()[-1].id, Completed(), force=True)
    def asked_for():
        ours = [run.parameters for run in all_runs() if run.parameters.get("path") == str(brief.path)]
        return [each["patient"] for each in ours]
    look([brief])
    assert asked_for() == [True], "a copy that paused is looked at once, and left"
    look([Arrived(brief.path, brief.digest, 60.0)])
    assert asked_for() == [True, False], "and refused when it has stayed so for long"
"""


def test_two_arrivals_of_a_workspace_have_a_run_at_a_time_in_production_order_and_the_others_wait(api, tmp_path):
    workspace = place(tmp_path / "plant")
    call = [sys.executable, "-c", TWO_AT_A_TIME, str(workspace.root)]
    done = subprocess.run(call, capture_output=True, text=True, check=False, env=os.environ.copy())
    assert done.returncode == 0, done.stderr[-2000:]


def test_a_server_that_was_started_is_gone_when_its_block_ends(tmp_path):
    from flows.server import answers

    with prefect_server(tmp_path / "prefect") as address:
        assert answers(f"{address}/health")
    start = time.monotonic()
    while answers(f"{address}/health") and time.monotonic() - start < 5:
        time.sleep(0.1)
    assert not answers(f"{address}/health")


PAGES = """
import sys
from prefect.client.orchestration import get_client
from flows.promote import promote

for root in sys.argv[1:]:
    promote(root, "mill 1", 1)
with get_client(sync_client=True) as client:
    runs = {run.id: run.parameters["workspace"] for run in client.read_flow_runs() if run.name.startswith("promote")}
    for artifact in client.read_artifacts():
        if artifact.flow_run_id in runs:
            print(runs[artifact.flow_run_id], artifact.key)
"""


def test_workspaces_that_nobody_serves_have_artifacts_of_their_own_about_machines_of_one_name(api, tmp_path):
    """Also from run to run: what is newest under a key is the workspace's own."""
    places = [place(tmp_path / name) for name in ("first", "second")]
    for workspace in places:
        made = bundle.save(workspace.bundles, {"machine": "mill 1", "parts": ["p1"]}, {"x.skops": b"x"})
        Ledger(workspace.ledger).finished("run1", "mill 1", "p1", "part 1", made.digest, {"passed": True}, {})
        promotion.reject(workspace, "mill 1", 1, by="A. Ito", reason="a test")
    roots = [str(workspace.root) for workspace in places]
    call = [sys.executable, "-c", PAGES, *roots, *roots]
    done = subprocess.run(call, capture_output=True, text=True, check=True, env=os.environ.copy())
    shown = [line.split() for line in done.stdout.splitlines()[-4:]]
    expected = [[str(w.root), f"{key('decision', 'mill 1')}-{w.id}"] for w in places]
    assert sorted(shown) == sorted(expected * 2)


def _artifacts(api: str, wanted: str) -> list[dict]:
    return _asked(f"{api}/artifacts/filter", {"artifacts": {"key": {"any_": [wanted]}}})


def _task_runs(api: str) -> list[dict]:
    return _asked(f"{api}/task_runs/filter", {})


def _asked(address: str, about: dict) -> list[dict]:
    request = urllib.request.Request(
        address, data=json.dumps(about).encode(), headers={"Content-Type": "application/json"}
    )
    with urllib.request.urlopen(request, timeout=10) as reply:
        return json.load(reply)


def test_a_run_lets_those_before_it_in_production_order_go_first_unless_they_have_no_process(
    api, tmp_path, monkeypatch
):
    from prefect.client.orchestration import get_client
    from prefect.states import Failed, Pending, Running, Scheduled

    from flows import ownership, turns
    from flows.new_part import new_part

    workspace, said = place(tmp_path / "plant"), []
    early, late = deliver(workspace, 1), deliver(workspace, 2)
    tags = [ownership.tag(workspace.root), "arrival", "machine:cmx600v"]
    with get_client(sync_client=True) as client:

        def run_in(state, path, *also):
            run = client.create_flow_run(new_part, parameters={"workspace": "", "path": str(path)}, tags=[*tags, *also])
            client.set_flow_run_state(run.id, state, force=True)
            return str(run.id)

        def takes_turn(path, run):
            turns.take_turn(workspace, path, run, tags, said.append)

        second = run_in(Running(), late)
        takes_turn(late, second)  # alone
        first = run_in(Scheduled(), early)
        takes_turn(early, first)
        assert not said

        def ends_meanwhile(run, *states):
            """Each look of a turn finds the run in the next state; the client itself may sleep, and ask again."""
            ends = iter(states)

            def sleep(seconds):
                client.set_flow_run_state(run, next(ends), force=True)

            monkeypatch.setattr(turns, "time", SimpleNamespace(sleep=sleep, monotonic=time.monotonic))
            return ends

        ends = ends_meanwhile(first, Pending(), Running(), Failed(message="a broken part holds up nobody"))
        takes_turn(late, second)
        assert next(ends, "all of its states were waited for") == "all of its states were waited for"
        [words] = said
        assert words == "before demo-02 comes demo-01, which a run is about; it is waited for"

        for _ in range(2):
            run_in(Running(), early)  # killed: it never ends
        monkeypatch.setattr(turns, "STARTING", timedelta(0))
        takes_turn(late, second)
        alive = run_in(Running(), early)
        ends = ends_meanwhile(alive, Failed())
        with workspace.lock(f"run {alive}"):
            takes_turn(late, second)
        assert not list(ends), "one that has a process is waited for, however long it takes"


@pytest.mark.thorough
def test_a_run_that_starts_before_that_of_an_earlier_part_takes_its_part_after_it(api, tmp_path):
    from prefect.client.orchestration import get_client
    from prefect.states import Completed, Running

    from flows import ownership
    from flows.new_part import new_part

    workspace = place(tmp_path / "plant")
    early, late = deliver(workspace, 1), deliver(workspace, 2)
    tags = ["arrival", "machine:cmx600v"]
    code = (
        "import sys, prefect; from flows.new_part import new_part\n"
        "with prefect.tags(*sys.argv[3:]): new_part(*sys.argv[1:3])"
    )
    with get_client(sync_client=True) as client:
        given = {"workspace": "", "path": str(early)}
        first = client.create_flow_run(new_part, parameters=given, tags=[*tags, ownership.tag(workspace.root)])
        with workspace.lock(f"run {first.id}"), (tmp_path / "log").open("w+") as log:
            client.set_flow_run_state(first.id, Running(), force=True)
            call = [sys.executable, "-c", code, str(workspace.root), str(late), *tags]
            second = subprocess.Popen(call, env=os.environ.copy(), stdout=log, stderr=log)
            try:
                end = time.monotonic() + 60
                while "before demo-02 comes demo-01" not in (tmp_path / "log").read_text():
                    assert second.poll() is None, (tmp_path / "log").read_text()[-2000:]
                    assert time.monotonic() < end, (tmp_path / "log").read_text()[-2000:]
                    time.sleep(0.2)
                assert flow(workspace, early).returncode == 0
                client.set_flow_run_state(first.id, Completed(), force=True)
                assert second.wait(120) == 0, (tmp_path / "log").read_text()[-2000:]
            finally:
                second.kill()
    iterations = Ledger(workspace.ledger).iterations("cmx600v")
    assert [one.summary["part"]["name"] for one in iterations] == ["demo-01", "demo-02"]
