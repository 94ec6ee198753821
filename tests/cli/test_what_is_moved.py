"""What the verbs that take parts in may move, and what stays where a person has put it."""

import os
import shutil

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings.folder import write_folder


def part(folder, name="p01"):
    rows = np.arange(600)
    columns = {
        "time": rows / 50.0, "pos_x": 5.0 * np.sin(rows / 80.0), "v_x": 50.0 / 16.0 * np.cos(rows / 80.0),
        "curr_x": np.sin(rows / 50.0),
    }  # fmt: skip
    write_folder(Recording(PartInfo(part=name, machine="m", order=1), columns), folder / name)
    return folder / name


def everything(folder):
    return {p.relative_to(folder): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.parametrize("words", ["plant", ".", "plant/store", "plant/bundles"])
def test_a_workspace_is_no_inbox_of_its_own(call, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    for folder in ("inbox", "store", "bundles"):
        (tmp_path / "plant" / folder).mkdir(parents=True)
    (tmp_path / "plant" / "ledger.db").write_text("what is known")
    before = everything(tmp_path)
    code, _, err = call("watch", words, "--workspace", "plant", "--once")
    assert code == 1
    assert f"{os.sep}inbox" in err
    assert everything(tmp_path) == before


def test_a_folder_of_recordings_stays_where_it_is(call, tmp_path):
    for name in ("p01", "p02"):
        part(tmp_path / "lot", name)
    before = everything(tmp_path / "lot")
    code, out, err = call("ingest", tmp_path / "lot", "--store", tmp_path / "store")
    assert code == 1
    assert "2 of them" in err
    assert str(tmp_path / "store" / "rejected") not in out
    assert everything(tmp_path / "lot") == before


@pytest.mark.parametrize("given", [".", "store", "store/parts"])
def test_what_holds_the_store_or_lies_in_it_is_not_moved(call, tmp_path, monkeypatch, given):
    monkeypatch.chdir(tmp_path)
    assert call("ingest", part(tmp_path), "--store", "store")[0] == 0
    before = everything(tmp_path)
    code, _, err = call("ingest", given, "--store", "store")
    assert code == 1
    assert "Traceback" not in err
    assert everything(tmp_path) == before


def test_a_damaged_part_in_which_the_store_lies_is_not_moved(call, tmp_path):
    own = part(tmp_path)
    (own / "recording.parquet").write_bytes(b"cut off")
    code, _, err = call("ingest", own, "--store", own / "store")
    assert code == 1
    assert "stays where it is" in err
    assert (own / "recording.parquet").read_bytes() == b"cut off"


def test_from_another_disk_a_damaged_file_is_copied_and_then_taken_away(call, tmp_path, monkeypatch):
    bad = tmp_path / "bad.csv"
    bad.write_text("no recording")
    monkeypatch.setattr(type(bad), "rename", lambda *_: (_ for _ in ()).throw(OSError(18, "Invalid cross-device link")))
    code, _, _ = call("ingest", bad, "--store", tmp_path / "store")
    assert code == 1
    assert not bad.exists()
    assert (tmp_path / "store" / "rejected" / "bad.csv").read_text() == "no recording"


def test_an_iteration_whose_workspace_lies_in_the_part_is_refused_before_anything_is_made(call, tmp_path):
    own = part(tmp_path)
    code, _, err = call("iterate", own, "--workspace", own / "plant", "--air-cut")
    assert code == 1
    assert "holds the workspace" in err
    assert not (own / "plant").exists()


def test_a_fault_of_the_program_over_one_file_does_not_cost_the_others(call, tmp_path, monkeypatch):
    from pido import recordings

    good, odd = part(tmp_path), tmp_path / "odd.csv"
    shutil.copy(good / "recording.parquet", odd)
    whole = recordings.read_recording

    def reads(path, **more):
        if path == odd:
            raise ZeroDivisionError("nobody thought of this")
        return whole(path, **more)

    monkeypatch.setattr(recordings, "read_recording", reads)
    code, out, err = call("ingest", odd, good, "--store", tmp_path / "store")
    assert code == 1
    assert "internal error" in err
    assert "nobody thought of this" in err
    assert "stored" in out
    assert odd.exists()
