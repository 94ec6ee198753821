"""Process quantities that come after the part: in a workspace they complete it, and its iteration is done again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plain_parts import parts as made_up

from pido import comparison, plain, production
from pido.core.columns import INPUTS, PROCESS
from pido.core.recording import Recording
from pido.parts import look_at, samples_of
from pido.recordings.folder import write_folder
from pido.supervision.book import Book
from pido.tracking import promotion
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

MACHINE = "cmx600v"
QUICK = "[method]\nadaptive = false\ncompare_with_model = false\n"


@pytest.fixture(scope="module")
def recordings() -> list[Recording]:
    return [part.rows(slice(0, 700)) for part in made_up(2)]


@pytest.fixture(autouse=True)
def without_mlflow(monkeypatch):
    monkeypatch.setattr(production, "log", lambda root: {"logged": 0, "fault": ""})


def bare(recording: Recording) -> Recording:
    columns = {name: values for name, values in recording.columns.items() if name not in PROCESS}
    return Recording(recording.part, columns)


def opened(root: Path, settings: str) -> Workspace:
    root.mkdir(exist_ok=True)
    (root / "workspace.toml").write_text(settings + QUICK)
    return Workspace.open(root)


def iterate(workspace: Workspace, recording: Recording, place: Path):
    return plain.run(workspace, [write_folder(recording, place)], None, lambda *about: None)


def test_an_air_cut_that_turns_out_to_have_cut_is_learnt_from_anew_with_the_forces_that_come_later(
    recordings, tmp_path, caplog
):
    first, second = recordings
    workspace = opened(tmp_path / "plant", "air_cut = true\n")
    iterate(workspace, bare(first), tmp_path / "bare")
    iterate(workspace, second, tmp_path / "second")
    ledger = Ledger(workspace.ledger)
    old, other = ledger.parts(MACHINE)
    assert not samples_of(workspace, old).inputs[:, INPUTS.index("f_x_sim")].any()
    ledger.judged(MACHINE, 2, {"passed": True, "words": "set by this test"})
    promotion.approve(workspace, MACHINE, 2, by="ann", reason="a test")

    workspace = opened(tmp_path / "plant", "")
    answer = iterate(workspace, first, tmp_path / "whole")
    assert not answer["rejected"]
    assert "they complete it" in caplog.text
    (done,) = answer["done"]
    new = done["part"]["digest"]
    assert done["part"]["name"] == first.part.part
    assert done["metrics"], "foretold by models of the other part"
    assert ledger.parts(MACHINE) == [other, new]
    assert samples_of(workspace, new).inputs[:, INPUTS.index("f_x_sim")].any()
    # Bare or whole, it is the same part from now on, and nothing is due.
    for number, recording in enumerate((first, bare(first))):
        assert not iterate(workspace, recording, tmp_path / f"again-{number}")["done"]
    name = look_at(workspace, write_folder(bare(first), tmp_path / "looked at"))[3]
    assert name == new
    # The champion learnt from these currents, under the digest that the part had then.
    version = ledger.versions(MACHINE)[-1]
    assert "parts" not in comparison.judge_again(workspace, version)


def test_what_was_said_of_an_alarm_holds_for_the_completed_part(recordings, tmp_path):
    workspace = opened(tmp_path / "plant", "air_cut = true\n")
    iterate(workspace, bare(recordings[0]), tmp_path / "bare")
    (old,) = Ledger(workspace.ledger).parts(MACHINE)
    alarm = {"id": "a1", "part": "demo-01", "axis": "x", "t_start": 2.0, "t_end": 5.0, "tool": "", "block": 1,
             "size_a": 1.0, "spreads": 9.0, "looks_like": "unknown"}  # fmt: skip
    book = Book(workspace, MACHINE)
    book.verdict({"part": "demo-01", "digest": old, "machine": MACHINE, "good": False, "alarms": [alarm]})
    book.answer("a1", true=True, by="ann", reason="a test")
    iterate(workspace, recordings[0], tmp_path / "whole")
    (new,) = Ledger(workspace.ledger).parts(MACHINE)
    assert workspace.excluded(MACHINE) == {new: [[2.0, 5.0]]}
    for digest in (old, new):
        time = comparison.clock(workspace, samples_of(workspace, digest))
        assert len(time)
        assert not np.any((time >= 2.0) & (time <= 5.0))


def test_forces_that_are_not_whole_complete_nothing_and_say_what_is_missing(recordings, tmp_path):
    workspace = opened(tmp_path / "plant", "air_cut = true\n")
    iterate(workspace, bare(recordings[0]), tmp_path / "bare")
    (old,) = Ledger(workspace.ledger).parts(MACHINE)
    some = Recording(recordings[0].part, {k: v for k, v in recordings[0].columns.items() if k != "mrr_sim"})
    (refused,) = iterate(workspace, some, tmp_path / "some")["rejected"]
    assert "mrr_sim was not recorded and cannot be taken as 0" in refused["reason"]
    assert Ledger(workspace.ledger).parts(MACHINE) == [old]
