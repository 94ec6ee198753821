"""Arrival: by rename, by slow copy, while nobody watched; never half, never twice, in production order."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plain_parts import parts as made_up

from pido import parts
from pido.arrivals import Arrived, Inbox, machine_said, may_have_paused, production_order
from pido.core.errors import SettingsError, StoreError, UnavailableError
from pido.core.recording import Recording
from pido.plain import run
from pido.recordings.folder import write_folder
from pido.store import Store
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace, arrival_digest

SETTLE = 0.05


def whole(inbox: Inbox) -> list[str]:
    return [arrived.path.name for arrived in inbox.look()[0]]


def test_a_file_that_grows_is_not_taken_until_it_stops(tmp_path):
    inbox, file = Inbox(tmp_path, SETTLE), tmp_path / "part.csv"
    for n in range(4):
        with file.open("a") as out:
            out.write(f"{n}\n")
        assert whole(inbox) == []
        time.sleep(SETTLE * 1.2)
    assert whole(inbox) == ["part.csv"]


def test_a_folder_whose_files_still_change_is_not_taken(tmp_path):
    inbox, folder = Inbox(tmp_path, SETTLE), tmp_path / "p01"
    folder.mkdir()
    assert whole(inbox) == []
    time.sleep(SETTLE * 1.2)
    (folder / "recording.parquet").write_bytes(b"half")
    assert whole(inbox) == []
    time.sleep(SETTLE * 1.2)
    assert whole(inbox) == ["p01"]


@pytest.mark.parametrize("name", [".hidden", "p01.csv.part", "p01.filepart", "p01.tmp", "p01~"])
def test_what_copying_programs_write_under_on_the_way_is_left_alone(tmp_path, name):
    (tmp_path / name).write_text("half")
    inbox = Inbox(tmp_path, 1e-9)
    inbox.look()
    assert inbox.look()[0] == []


def test_what_came_while_nobody_watched_is_found(tmp_path):
    (tmp_path / "before.csv").write_text("1")
    inbox = Inbox(tmp_path, SETTLE)
    inbox.look()
    time.sleep(SETTLE * 1.2)
    assert whole(inbox) == ["before.csv"]


def test_a_clock_that_jumps_back_a_year_holds_nothing_up(tmp_path):
    file = tmp_path / "part.csv"
    file.write_text("1")
    inbox = Inbox(tmp_path, SETTLE)
    inbox.look()
    time.sleep(SETTLE * 1.2)
    assert whole(inbox) == ["part.csv"]
    os.utime(file, (1.0, 1.0))  # the same bytes under another time are looked at again
    assert whole(inbox) == []


@given(st.permutations([f"part {n}" for n in range(1, 13)]))
def test_parts_without_an_order_are_taken_by_the_numbers_in_their_names(names):
    ordered = sorted((Path("inbox") / name for name in names), key=production_order)
    assert [p.name for p in ordered] == [f"part {n}" for n in range(1, 13)]


def test_the_order_in_part_json_goes_over_the_name(tmp_path):
    for name, order in (("a", 2), ("b", 1)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "part.json").write_text(json.dumps({"part": name, "machine": "m", "order": order}))
    assert sorted([tmp_path / "a", tmp_path / "b"], key=production_order) == [tmp_path / "b", tmp_path / "a"]


def test_the_digest_of_an_arrival_is_that_of_its_bytes(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "recording.parquet").write_bytes(b"content")
    assert arrival_digest(tmp_path / "one") == arrival_digest(tmp_path / "two")
    (tmp_path / "two" / "recording.parquet").write_bytes(b"Content")
    assert arrival_digest(tmp_path / "one") != arrival_digest(tmp_path / "two")


def test_a_symbolic_link_is_refused_not_followed(tmp_path):
    (tmp_path / "p").mkdir()
    (tmp_path / "p" / "recording.parquet").symlink_to("/etc/hostname")
    with pytest.raises(StoreError, match="symbolic link"):
        arrival_digest(tmp_path / "p")


@pytest.mark.parametrize("linked", ["p", "p/part.json"])
def test_nothing_that_a_link_points_at_decides_the_order_of_parts(tmp_path, linked):
    part = tmp_path / "real" / "p"
    part.mkdir(parents=True)
    (part / "part.json").write_text('{"order": 1}')
    assert production_order(part)[0] == 1
    (tmp_path / "p").mkdir()
    (tmp_path / "p").rmdir() if linked == "p" else None
    (tmp_path / linked).symlink_to(tmp_path / "real" / linked)
    assert production_order(tmp_path / "p")[0] == float("inf")


def test_a_part_with_a_link_in_it_does_not_stop_the_watch(tmp_path):
    (tmp_path / "p").mkdir()
    (tmp_path / "p" / "recording.parquet").symlink_to("/etc/hostname")
    (tmp_path / "good.csv").write_text("1")
    inbox = Inbox(tmp_path, SETTLE)
    inbox.look()
    time.sleep(SETTLE * 1.2)
    assert sorted(whole(inbox)) == ["good.csv", "p"]


def test_a_copy_that_paused_is_left_for_a_later_look_and_refused_only_when_it_stays_so(tmp_path):
    workspace, half = Workspace.open(tmp_path / "plant"), tmp_path / "part.json"
    half.write_text('{"Header": ')
    for patient in (True, False):
        answer = run(workspace, [half], None, lambda done, total, what: None, from_inbox=True, patient=patient)
        assert half.exists() is patient
        assert bool(answer["rejected"]) is bool(Ledger(workspace.ledger).rejections()) is not patient


def test_what_has_rested_for_long_is_no_copy_that_paused(tmp_path):
    assert may_have_paused(Arrived(tmp_path, "d", 9.0), settle_s=2.0)  # its recording came 9 s after its part.json
    assert not may_have_paused(Arrived(tmp_path, "d", 10.0), settle_s=2.0)


@pytest.mark.parametrize("about", ["", "[]", '{"machine": 1}', '{"part": "p"}', "[" * 100_000])
def test_the_machine_of_a_part_is_what_its_part_json_says_if_it_says_one(tmp_path, about):
    (tmp_path / "part.json").write_text(about)
    assert machine_said(tmp_path) == machine_said(tmp_path / "part.json") == machine_said(tmp_path / "none") == ""
    (tmp_path / "part.json").write_text('{"machine": "m1"}')
    assert machine_said(tmp_path) == "m1"


def test_a_watched_inbox_is_emptied_each_part_counted_once_and_bad_input_put_aside(tmp_path):
    root = tmp_path / "plant"
    (root / "inbox").mkdir(parents=True)
    (root / "workspace.toml").write_text("settle_s = 0.1\n[method]\nadaptive = false\ncompare_with_model = false\n")
    part = next(made_up(1)).rows(slice(0, 600))
    for name in ("first", "the same under another name"):
        write_folder(part, root / "inbox" / name)
    (root / "inbox" / "torn.json").write_text('{"Header": ')
    (root / "elsewhere").mkdir()
    for name, target in (("link", root / "elsewhere"), ("loose", "nowhere")):
        (root / "inbox" / name).symlink_to(target)
    for name, about in (("deep", "[" * 100_000), ("huge", '{"part": "p", "machine": "m", "order": 1%s}' % ("0" * 400))):
        shutil.copytree(root / "inbox" / "first", root / "inbox" / name)
        (root / "inbox" / name / "part.json").write_text(about)
    call = [sys.executable, "-m", "pido.cli", "watch", str(root / "inbox"), "--workspace", str(root), "--once"]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    workspace = Workspace.open(root)
    assert list((root / "inbox").iterdir()) == []
    assert len(Ledger(workspace.ledger).parts("cmx600v")) == 1
    rejections = {a.name: a.reason for a in Ledger(workspace.ledger).rejections()}
    assert sorted(rejections) == ["deep", "huge", "link", "loose", "torn.json"]
    assert "symbolic links are not followed" in rejections["link"]
    assert (root / "store" / "rejected" / "link").is_symlink()
    assert (root / "elsewhere").is_dir()


def one_part(tmp_path: Path) -> tuple[Workspace, Path]:
    workspace = Workspace.open(tmp_path / "plant")
    (workspace.root / "workspace.toml").write_text("compare = false\n[method]\nadaptive = false\n")
    part = next(iter(made_up(1))).rows(slice(0, 400))
    return Workspace.open(workspace.root), write_folder(part, workspace.inbox / part.part.part)


def test_a_part_is_not_rejected_for_a_fault_of_the_disk(tmp_path):
    workspace, arrived = one_part(tmp_path)
    workspace.ledger.write_bytes(b"what a failing disk has left " * 100)
    with pytest.raises(UnavailableError, match="damaged"):
        run(workspace, [arrived], None, lambda *about: None, from_inbox=True)
    workspace.ledger.unlink()
    assert arrived.exists()
    assert run(workspace, [arrived], None, lambda *about: None, from_inbox=True)["done"]


JOB = 'machine = "cmx600v"\n[tools.T1]\ndiameter_mm = 10.0\nteeth = 2\n'
CUT = 'material = "S235JR"\nstock = { mesh = "gone.stl" }\n'
FAULTS_OF_THE_PLANT = {
    "half a line was saved": ("rate_hz = \n", ""),
    "a key that is none": ("rate = 50\n", ""),
    "a machine nobody knows": ('machine = "nobody"\n', ""),
    "machines are away": ('machines_file = "share/machines.toml"\n', ""),
    "materials are away": ('materials_file = "share/materials.toml"\n', ""),
    "jobs are away": ('jobs = { cmx600v = "share/job.toml" }\n', ""),
    "a job that is no TOML": ('jobs = { cmx600v = "job.toml" }\n', "machine = \n"),
    "a job of a machine nobody knows": ('jobs = { cmx600v = "job.toml" }\n', JOB.replace("cmx600v", "nobody")),
    "a job of a material nobody knows": ('jobs = { cmx600v = "job.toml" }\n', 'material = "cheese"\n' + JOB),
    "a raw part that is away": ('jobs = { cmx600v = "job.toml" }\n', CUT + JOB),
}


@pytest.mark.parametrize("fault", FAULTS_OF_THE_PLANT)
def test_a_part_is_not_rejected_for_a_fault_of_the_plants_settings(tmp_path, fault):
    workspace, arrived = one_part(tmp_path)
    part = next(iter(made_up(1))).rows(slice(0, 400))
    if "raw part" in fault:  # without process quantities the raw part is asked for
        columns = {name: values for name, values in part.columns.items() if not name.endswith("_sim")}
        part = Recording(part.part, columns, part.notes)
        write_folder(part, arrived)
    settings, job = FAULTS_OF_THE_PLANT[fault]
    good = (workspace.root / "workspace.toml").read_text()
    (workspace.root / "workspace.toml").write_text(settings + good)
    (workspace.root / "job.toml").write_text(job)
    for patient in (True, False):
        with pytest.raises(SettingsError):
            run(workspace, [arrived], None, lambda *about: None, from_inbox=True, patient=patient)
    assert arrived.exists()
    assert Ledger(workspace.ledger).rejections() == []
    (workspace.root / "workspace.toml").write_text("air_cut = true\n" + good)
    assert parts.ingest(str(workspace.root), str(arrived))["new"]


@pytest.mark.parametrize(("key", "value", "named"), [("machine", "nobody", "nobody"), ("oder", 1, "oder")])
def test_a_part_is_rejected_for_a_fault_of_its_own_part_json(tmp_path, key, value, named):
    workspace, arrived = one_part(tmp_path)
    about = json.loads((arrived / "part.json").read_text())
    (arrived / "part.json").write_text(json.dumps({**about, key: value}))
    answer = run(workspace, [arrived], None, lambda *about: None, from_inbox=True)
    assert named in answer["rejected"][0]["reason"]
    assert not arrived.exists()


def test_what_one_machine_has_is_not_silently_known_when_it_comes_as_anothers(tmp_path):
    workspace, folder = one_part(tmp_path)
    csv = workspace.inbox / "part.csv"

    def brought(machine: str) -> dict:
        pd.DataFrame(dict(next(iter(made_up(1))).rows(slice(0, 400)).columns)).to_csv(csv, index=False)
        return run(workspace, [csv], machine, lambda *about: None, from_inbox=True)

    assert brought("cmx600v")["done"]
    for _ in range(2):
        answer = brought("dmc60h")
        assert "part 'part' of machine 'cmx600v' already" in answer["rejected"][0]["reason"]
        assert "part.json" in answer["rejected"][0]["reason"]
    assert brought("cmx600v") == {"done": [], "rejected": [], "fault": ""}
    assert not csv.exists()
    assert [e.machine for e in Store(workspace.store).entries()] == ["cmx600v"]
    for machine in (None, "dmc60h"):  # it names its own
        shutil.copytree(folder, tmp_path / "copy")
        assert parts.ingest(str(workspace.root), str(tmp_path / "copy"), machine)["machine"] == "cmx600v"
        shutil.rmtree(tmp_path / "copy")


def test_a_ledger_whose_making_was_cut_off_is_finished_by_the_next_one(tmp_path):
    (tmp_path / "ledger.db").touch()
    assert Ledger(tmp_path / "ledger.db").machines() == []


@pytest.mark.parametrize("comes_back", [True, False])
def test_what_is_replaced_while_it_is_read_is_left_until_it_rests(tmp_path, monkeypatch, comes_back):
    workspace, arrived = one_part(tmp_path)
    other = write_folder(list(made_up(2))[1].rows(slice(0, 400)), tmp_path / "other" / "part")
    mine = write_folder(next(iter(made_up(1))).rows(slice(0, 400)), tmp_path / "mine" / "part")

    def bring(files: Path) -> None:
        for file in files.iterdir():
            shutil.copy2(file, arrived.parent / ".new").replace(arrived / file.name)

    real = parts._read

    def read(workspace, path: Path, machine: str | None):
        bring(other)  # just then
        try:
            return real(workspace, path, machine)
        finally:
            if comes_back:
                bring(mine)

    monkeypatch.setattr(parts, "_read", read)
    answer = run(workspace, [arrived], None, lambda *about: None, from_inbox=True)
    assert answer == {"done": [], "rejected": [], "fault": ""}
    assert arrived.exists()
    assert Store(workspace.store).entries() == ()
