"""An arrival that cannot be done is tried again, more and more seldom, and holds up nothing and nobody."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import pytest
from plain_parts import parts as made_up

from pido.arrivals import Arrived
from pido.backlog import FIRST_S, LONGEST_S, Backlog, standing
from pido.core.recording import Recording
from pido.recordings.folder import write_folder
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

SETTINGS = "settle_s = 0.1\ncompare = false\n[method]\nadaptive = false\ncompare_with_model = false\n"


class Inbox:
    """Files in a workspace's inbox, and a clock that is set."""

    def __init__(self, root: Path) -> None:
        self.workspace, self.seconds = Workspace.open(root), 0.0
        self.workspace.inbox.mkdir()
        self.backlog = Backlog(self.workspace, self.workspace.inbox, lambda: self.seconds)

    def arrived(self, name: str, digest: str = "") -> Arrived:
        (self.workspace.inbox / name).touch()
        return Arrived(self.workspace.inbox / name, digest or name, 1.0)


@pytest.fixture
def inbox(tmp_path: Path) -> Inbox:
    return Inbox(tmp_path)


def test_each_try_waits_twice_as_long_as_the_one_before_up_to_minutes(inbox):
    one, tries = inbox.arrived("one"), []
    while inbox.seconds < 3600.0:
        if inbox.backlog.due([one]):
            tries.append(inbox.seconds)
            inbox.backlog.tried(one, "no")
        inbox.seconds += 0.5
    waits = [after - before for before, after in pairwise(tries)]
    assert waits[:4] == [FIRST_S, 2 * FIRST_S, 4 * FIRST_S, 8 * FIRST_S]
    assert max(waits) == waits[-1] == LONGEST_S


def test_what_stands_lets_the_others_go_and_starts_afresh_when_it_is_brought_otherwise(inbox):
    one, other = inbox.arrived("one"), inbox.arrived("other")
    assert inbox.backlog.due([one, other]) == [one, other]
    for _ in range(6):
        wait = inbox.backlog.tried(one, "no")
    assert inbox.backlog.due([one, other]) == [other]
    inbox.seconds += wait
    assert inbox.backlog.due([one, other]) == [other, one], "what was tried least first"
    changed = inbox.arrived("one", "other bytes")
    assert inbox.backlog.due([changed]) == [changed]
    assert inbox.backlog.tried(changed, "no") == FIRST_S


def test_what_stands_is_known_to_others_until_it_is_gone(inbox):
    one, fresh = inbox.arrived("one"), inbox.arrived("fresh")
    inbox.backlog.due([one, fresh])
    inbox.backlog.tried(one, "no material")
    inbox.backlog.tried(fresh)  # its first run is on its way
    later = inbox.arrived("later")
    inbox.backlog.due([one, fresh, later])

    def known() -> list[tuple[str, int, str]]:
        return [(Path(s.path).name, s.tries, s.reason) for s in standing(inbox.workspace)]

    assert known() == [("fresh", 1, ""), ("later", 0, ""), ("one", 1, "no material")]
    inbox.backlog.held("no server")
    assert known() == [("fresh", 1, "no server"), ("later", 0, "no server"), ("one", 1, "no material")]
    inbox.backlog.held("")
    one.path.unlink()
    assert known() == [("fresh", 1, ""), ("later", 0, "")]
    inbox.backlog.due([fresh])
    one.path.touch()
    assert known() == [("fresh", 1, "")]


def bare(number: int, place: Path, machine: str = "cmx600v") -> Path:
    """A part folder without process quantities, of which nobody says what was cut."""
    part = list(made_up(number, machine=machine))[-1].rows(slice(0, 500))
    columns = {name: values for name, values in part.columns.items() if not name.endswith("_sim")}
    return write_folder(Recording(part.part, columns, part.notes), place)


def pido(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "pido.cli", *words], capture_output=True, text=True, check=False)


@pytest.mark.thorough
def test_a_part_whose_iteration_fails_does_not_end_the_watch_and_is_done_when_its_cause_is_mended(tmp_path):
    root, inbox = tmp_path / "plant", tmp_path / "plant" / "inbox"
    inbox.mkdir(parents=True)
    (root / "workspace.toml").write_text("air_cut = true\n" + SETTINGS)
    where = [str(inbox), "--workspace", str(root)]
    bare(1, inbox / "first")
    assert pido("watch", *where, "--once").returncode == 0
    (root / "workspace.toml").write_text(SETTINGS)  # the first part cannot be learnt from any more
    good, other = list(made_up(2))[-1], list(made_up(3, machine="dmc60h"))[-1]
    write_folder(good.rows(slice(0, 500)), inbox / "second")
    write_folder(other.rows(slice(0, 500)), inbox / "third")
    ledger = Ledger(Workspace.open(root).ledger)
    with (tmp_path / "log").open("wb") as log:
        watcher = subprocess.Popen(
            [sys.executable, "-m", "pido.cli", "watch", *where], stderr=log, env=os.environ.copy()
        )
    try:
        end = time.monotonic() + 120
        while not ledger.parts("dmc60h") and watcher.poll() is None and time.monotonic() < end:
            time.sleep(0.1)
        assert ledger.parts("dmc60h"), (tmp_path / "log").read_text()
        assert watcher.poll() is None
    finally:
        watcher.kill()
        watcher.wait()
    waits = json.loads(pido("status", "--workspace", str(root), "--json").stdout)["still_to_do"]
    [left] = [one for one in waits if one["reason"]]  # the third may not have left the inbox yet
    assert (Path(left["path"]).name, left["tries"]) == ("second", 1)
    assert "demo-01: no process quantities were recorded" in left["reason"]
    assert "still to do  second, tried 1 time(s): part demo-01" in pido("status", "--workspace", str(root)).stdout
    ended = pido("watch", *where, "--once")
    assert ended.returncode == 1
    assert "1 arrival(s) are still to be done:\n  second: part demo-01" in ended.stderr
    (root / "workspace.toml").write_text("air_cut = true\n" + SETTINGS)
    assert pido("watch", *where, "--once").returncode == 0
    assert len(ledger.parts("cmx600v")) == 2
    assert json.loads(pido("status", "--workspace", str(root), "--json").stdout)["still_to_do"] == []
