"""The watcher where Prefect is not named, is away, or has no worker: it says which and waits; `pido status` sees it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import pytest
from served_worker import waited

from flows.server import die_with_parent, free_port, prefect_server, stop
from pido.cli.watch import FIRST_WORD_S, LAST_WORD_S, _Told

pytestmark = pytest.mark.servers


@pytest.fixture
def plant(tmp_path) -> Path:
    root = tmp_path / "plant"
    (root / "inbox" / "p01").mkdir(parents=True)
    (root / "inbox" / "p01" / "part.json").write_text("{}")
    (root / "workspace.toml").write_text("settle_s = 0.1\n")
    subprocess.run([sys.executable, "-c", LEDGER, str(root)], check=True)
    return root


LEDGER = "import sys; from pido.workspace import Workspace as W; from pido.tracking.ledger import Ledger as L\n"
LEDGER += "L(W.open(sys.argv[1]).ledger)"


def shell(home: Path, **named: str) -> dict[str, str]:
    """An environment in which Prefect keeps its own files in `home`, and is named as asked."""
    plain = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT_")}
    return {**plain, "PREFECT_HOME": str(home), **named}


def watch(plant: Path, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    call = [sys.executable, "-m", "pido.cli", "watch", str(plant / "inbox"), "-w", str(plant), "--prefect", "--once"]
    return subprocess.run(call, capture_output=True, text=True, check=False, env=environment, timeout=90)


def still_to_do(plant: Path) -> list[dict]:
    call = [sys.executable, "-m", "pido.cli", "status", "-w", str(plant), "--json"]
    return json.loads(subprocess.run(call, capture_output=True, text=True, check=True).stdout)["still_to_do"]


def test_a_server_that_is_not_named_is_said_at_once_and_none_is_started(plant, tmp_path):
    done = watch(plant, shell(tmp_path / "home"))
    assert done.returncode == 1
    assert done.stderr.startswith("pido: PREFECT_API_URL is not set: ")
    assert len(done.stderr.splitlines()) == 1
    assert not list((tmp_path / "home").glob("prefect.db*"))


def test_a_server_that_is_away_ends_one_look_with_what_waits(plant, tmp_path):
    address = f"http://127.0.0.1:{free_port()}/api"
    done = watch(plant, shell(tmp_path / "home", PREFECT_API_URL=address))
    assert done.returncode == 1
    assert f"1 arrival(s) are still to be done:\n  p01: Prefect cannot be reached at {address}" in done.stderr
    [one] = still_to_do(plant)
    assert (Path(one["path"]).name, one["tries"]) == ("p01", 0)
    assert one["reason"].startswith("Prefect cannot be reached at")


@pytest.mark.thorough
def test_without_a_worker_prefect_was_reached_and_the_watcher_says_so_once_and_status_says_what_waits(plant, tmp_path):
    call = [sys.executable, "-m", "pido.cli", "watch", str(plant / "inbox"), "-w", str(plant), "--prefect"]
    with prefect_server(tmp_path / "prefect"), (tmp_path / "log").open("wb") as log:
        watcher = subprocess.Popen(call, stderr=log, start_new_session=True, preexec_fn=die_with_parent)
        try:
            [one] = waited(lambda: still_to_do(plant), 60)
            assert "no worker serves new-part for" in one["reason"]
            time.sleep(4.0)
        finally:
            stop(watcher)
    said = (tmp_path / "log").read_text()
    assert said.count("no worker serves") == 1, said
    assert "Prefect is there, but no worker serves" in said
    assert "cannot be reached" not in said
    shown = subprocess.run([*call[:3], "status", "-w", str(plant)], capture_output=True, text=True, check=True).stdout
    assert "still to do  p01, waiting: Prefect is there, but no worker serves" in shown


def test_a_state_that_lasts_is_told_less_and_less_often_and_its_end_is(caplog):
    clock = [0.0]
    tell, told = _Told(lambda: clock[0]), []
    caplog.set_level("INFO")
    while clock[0] < 86400.0:
        before = len(caplog.records)
        tell("away; asked again")
        told += [clock[0]] if len(caplog.records) > before else []
        clock[0] += 30.0
    assert told[:4] == [0.0, FIRST_WORD_S, 3 * FIRST_WORD_S, 7 * FIRST_WORD_S]
    assert max(b - a for a, b in pairwise(told)) == LAST_WORD_S
    tell("")
    tell("")
    assert caplog.messages[-1] == "that is over: away"
    assert len(caplog.messages) == len(told) + 1
