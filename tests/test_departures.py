"""What leaves the inbox is what was read there, under whatever name the next part comes, and whoever is killed."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from plain_parts import parts as made_up

from pido import departures, parts, plain, production
from pido.recordings.folder import write_folder
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace, arrival_digest

SETTINGS = "compare = false\nsettle_s = 0.05\n[method]\nadaptive = false\ncompare_with_model = false\n"


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    (tmp_path / "plant" / "inbox").mkdir(parents=True)
    (tmp_path / "plant" / "workspace.toml").write_text(SETTINGS)
    return Workspace.open(tmp_path / "plant")


def folder(place: Path, number: int) -> Path:
    return write_folder(list(made_up(number))[-1].rows(slice(0, 500)), place)


def file(place: Path, number: int) -> Path:
    place.write_text(f"part {number}")
    return place


def replaced(place: Path, by: Path) -> None:
    """As an exporter does that delivers under one name."""
    if place.is_dir():
        shutil.rmtree(place)
    by.rename(place)


def silent(done: int, total: int, what: str) -> None:
    """Nobody watches."""


def names(inbox: Path) -> list[str]:
    return [path.name for path in inbox.iterdir()]


def test_a_part_that_comes_under_the_name_of_the_one_at_work_is_the_next(workspace, tmp_path, monkeypatch):
    monkeypatch.setattr(production, "log", lambda root: {"logged": 0, "fault": ""})
    current, second = folder(workspace.inbox / "current", 1), folder(tmp_path / "second", 2)
    iteration, key = plain.one, arrival_digest(second)

    def one(root: str, machine: str, part: str | None) -> tuple[str, str, bool]:
        found = iteration(root, machine, part)
        if second.exists():
            replaced(current, second)
        return found

    monkeypatch.setattr(plain, "one", one)
    for _ in range(2):
        plain.run(workspace, [current], None, silent, from_inbox=True)
    assert len(Ledger(workspace.ledger).parts("cmx600v")) == 2
    assert names(workspace.inbox) == []
    assert [name[:16] for name in names(workspace.taken)] == [key[:16]]


@pytest.mark.parametrize("move", [True, False])
def test_a_good_part_is_not_rejected_for_what_lay_there_before(workspace, tmp_path, move):
    current, good = file(workspace.inbox / "current", 1), folder(tmp_path / "good", 2)
    with pytest.raises(parts.Refused, match="not a recording") as refused:
        parts.ingest(str(workspace.root), str(current))
    current.unlink()
    replaced(current, good)
    assert departures.reject(workspace, current, refused.value.key, "not a recording", move) is None
    assert parts.ingest(str(workspace.root), str(current))["name"] == "demo-02"
    assert Ledger(workspace.ledger).rejections() == []
    assert list((workspace.store / "rejected").glob("*")) == []


@pytest.mark.parametrize("arrival", [folder, file])
def test_what_is_delivered_in_the_moment_of_leaving_keeps_its_place(workspace, tmp_path, monkeypatch, arrival):
    current, second = arrival(workspace.inbox / "current", 1), arrival(tmp_path / "second", 2)
    first, other = arrival_digest(current), arrival_digest(second)
    key_of = departures.key_of

    def looked_at(path: Path) -> str:
        key = key_of(path)
        if path == current:
            replaced(current, second)
        return key

    monkeypatch.setattr(departures, "key_of", looked_at)
    assert departures.put_away(workspace, current, first) is None
    assert arrival_digest(current) == other
    assert names(workspace.inbox) == ["current"]


@pytest.mark.parametrize("arrival", [folder, file])
def test_of_three_parts_under_one_name_none_replaces_another(workspace, tmp_path, monkeypatch, arrival):
    current = arrival(workspace.inbox / "current", 1)
    second, third = arrival(tmp_path / "second", 2), arrival(tmp_path / "third", 3)
    first, *others = (arrival_digest(path) for path in (current, second, third))
    coming, key_of = [second, third], departures.key_of

    def looked_at(path: Path) -> str:
        key = key_of(path)
        replaced(current, coming.pop(0))
        return key

    monkeypatch.setattr(departures, "key_of", looked_at)
    assert departures.put_away(workspace, current, first) is None
    monkeypatch.setattr(departures, "key_of", key_of)
    assert arrival_digest(current) == others[1]
    assert departures.bring_back(workspace, workspace.inbox), "the second waits for its name"
    assert departures.put_away(workspace, current, others[1]) is not None
    assert not departures.bring_back(workspace, workspace.inbox)
    assert arrival_digest(current) == others[0]
    assert names(workspace.inbox) == ["current"]


KILLED = """
import os, signal, sys
from pathlib import Path
from pido import departures
from pido.workspace import Workspace

key_of, current = departures.key_of, Path(sys.argv[2])

def looked_at(path):
    if path != current:
        os.kill(os.getpid(), signal.SIGKILL)
    key = key_of(path)
    (current.parent.parent / "second").rename(current.parent / "waiting")
    current.unlink()
    (current.parent / "waiting").rename(current)
    return key

departures.key_of = looked_at
departures.put_away(Workspace.open(sys.argv[1]), current, key_of(current))
"""


def test_what_a_killed_process_had_set_apart_is_in_the_inbox_again_at_the_next_look(workspace):
    current = file(workspace.inbox / "current", 1)
    file(workspace.root / "second", 2)
    code = [sys.executable, "-c", KILLED, str(workspace.root), str(current)]
    assert subprocess.run(code, check=False, env=os.environ.copy()).returncode == -signal.SIGKILL
    assert not current.exists()
    call = [
        sys.executable,
        "-m",
        "pido.cli",
        "watch",
        str(workspace.inbox),
        "--workspace",
        str(workspace.root),
        "--once",
    ]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert names(workspace.inbox) == []
    [rejected] = Ledger(workspace.ledger).rejections()
    assert (rejected.name, (workspace.store / "rejected" / "current").read_text()) == ("current", "part 2")
