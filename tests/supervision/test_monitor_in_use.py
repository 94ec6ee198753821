"""The monitor around a workspace: verdicts, answers and what follows, a file that grows."""

import csv
import hashlib
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from pido.cli import pido
from pido.cli.monitor import in_a_line
from pido.core.errors import RecordingError, RegistryError, StoreError
from pido.core.recording import Recording
from pido.monitoring.alarms import Alarm, Verdict
from pido.parts import samples_of
from pido.recordings import read_recording
from pido.recordings.folder import write_folder
from pido.reports.monitor import monitor_page
from pido.reports.page import render
from pido.supervision import NO_SAFETY_STOP
from pido.supervision.book import Book, alarm_id
from pido.supervision.part import Expectation, NamedAlarm, headline, monitor, not_judged, recorded
from pido.supervision.stream import follow_file
from pido.tracking.ledger import Ledger
from pido.tracking.promotion import TOKEN
from pido.workspace import Workspace

MACHINE = "cmx600v"


JUMP_A = 200.0


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace that has seen one part, and two more beside it, the second with a jump during its longest cut."""
    from pido.plain import run
    from pido.synthetic.families import impellers
    from pido.synthetic.machine import produce
    from pido.synthetic.mills import newer_vertical

    root = tmp_path_factory.mktemp("plant")
    mill = newer_vertical()
    made = produce(mill, mill.plan(impellers(mill.machine, 3)), with_simulation=False)
    first, second, third = (one.recording for one in made)
    workspace = Workspace.open(root / "ws")
    run(workspace, [write_folder(first, root / "first")], None, lambda done, total, what: None)
    write_folder(second, root / "good")
    start, end = _longest_cut(third)
    current = np.array(third["curr_x"])
    current[(third.time > start) & (third.time < end)] += JUMP_A
    write_folder(Recording(third.part, {**third.columns, "curr_x": current}), root / "bad")
    (root / "when.json").write_text(json.dumps([start, end]))
    return root


def _longest_cut(recording: Recording) -> tuple[float, float]:
    cutting = np.concatenate([[0], recording["mrr_sim"] > 0, [0]]).astype(int)
    edges = np.flatnonzero(np.diff(cutting)).reshape(-1, 2)
    first, last = edges[np.argmax(edges[:, 1] - edges[:, 0])]
    middle = recording.time[(first + last) // 2]
    return float(middle - 0.8), float(middle + 0.8)


def _call(*arguments: object, status: int = 0) -> str:
    result = CliRunner().invoke(pido, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == status, result.output
    return result.stdout


def _part(folder: Path, name: str, rows: slice, curr_x: float) -> Path:
    """Some rows of the plant's part `good` under another name, with a current that is off by so much, A."""
    recording = read_recording(folder / "good")
    columns = {key: np.array(values)[rows] for key, values in recording.columns.items()}
    columns["curr_x"] += curr_x
    return write_folder(Recording(recording.part.model_copy(update={"part": name}), columns), folder / name)


def test_a_jump_is_an_alarm_with_axis_time_size_and_words_and_the_answer_says_it_is_no_safety_stop(plant):
    answer = json.loads(_call("monitor", plant / "bad", "-w", plant / "ws", "--json"))
    start, end = json.loads((plant / "when.json").read_text())
    (alarm,) = [a for a in answer["alarms"] if a["axis"] == "x" and a["t_start"] < end and a["t_end"] > start]
    assert alarm["size_a"] == pytest.approx(JUMP_A, rel=0.1)
    assert alarm["looks_like"]
    assert answer["no_safety_stop"] == NO_SAFETY_STOP
    assert not answer["good"]
    assert "safety" in _call("monitor", "--help")


def test_judging_the_same_part_again_adds_nothing_to_the_book_and_keeps_its_identifiers(plant):
    before = json.loads(_call("monitor", plant / "bad", "-w", plant / "ws", "--json"))
    book = Book(Workspace.open(plant / "ws"), MACHINE)
    lines = book.path.read_text()
    after = json.loads(_call("monitor", plant / "bad", "-w", plant / "ws", "--json"))
    assert before == after
    assert book.path.read_text() == lines


def test_judging_a_part_does_not_take_it_into_the_store(plant):
    workspace = Workspace.open(plant / "ws")
    known = Ledger(workspace.ledger).parts(MACHINE)
    _call("monitor", plant / "good", "-w", plant / "ws", status=3)
    assert Ledger(workspace.ledger).parts(MACHINE) == known


def test_a_true_alarm_leaves_its_samples_out_of_the_next_training_set_and_only_those(plant):
    workspace = Workspace.open(plant / "ws")
    (digest,) = Ledger(workspace.ledger).parts(MACHINE)
    book, rows, key = Book(workspace, MACHINE), samples_of(workspace, digest), workspace.run_key(MACHINE, [digest])
    start, end = rows.row[100] / 50.0, rows.row[160] / 50.0
    alarm = Alarm(digest, "x", start, end, "", 3, 1.0, 9.0)
    name = alarm_id(MACHINE, digest, alarm)
    said = {"id": name, "part": "IMP-01", "axis": "x", "t_start": start, "t_end": end, "tool": "", "block": 3,
            "size_a": 1.0, "spreads": 9.0, "looks_like": "unknown"}  # fmt: skip
    book.verdict({"part": "IMP-01", "digest": digest, "machine": MACHINE, "good": False, "alarms": [said]})
    _call("monitor", "answer", name, "--false", "--by", "ann", "--reason", "tool was new", "-w", plant / "ws")
    assert len(samples_of(workspace, digest)) == len(rows)
    assert workspace.run_key(MACHINE, [digest]) == key
    call = ["monitor", "answer", name, "--true", "--by", "ann", "--reason", "insert was chipped", "-w", plant / "ws"]
    assert "part IMP-01, axis x" in _call(*call)
    left = samples_of(workspace, digest)
    gone = np.setdiff1d(rows.row, left.row)
    assert gone.tolist() == rows.row[100:161].tolist()
    assert workspace.run_key(MACHINE, [digest]) != key
    _call("monitor", "answer", name, "--false", "--by", "ann", "--reason", "was the coolant", "-w", plant / "ws")
    assert workspace.run_key(MACHINE, [digest]) == key


def test_an_answer_asks_for_the_credential_that_approval_asks_for(tmp_path, monkeypatch):
    token = hashlib.sha256(b"open sesame").hexdigest()
    book = Book(Workspace.open(tmp_path, approval_token_sha256=token), "m1")
    said = {"id": "a1", "part": "p", "axis": "x", "t_start": 1.0, "t_end": 2.0, "tool": "", "block": 3, "size_a": 1.0,
            "spreads": 9.0, "looks_like": "unknown"}  # fmt: skip
    book.verdict({"part": "p", "digest": "d1", "machine": "m1", "good": False, "alarms": [said]})
    for wrong in ("", "open"):
        monkeypatch.setenv(TOKEN, wrong)
        with pytest.raises(RegistryError, match="credential"):
            book.answer("a1", true=True, by="ann", reason="insert was chipped")
    assert book.answers() == []
    monkeypatch.setenv(TOKEN, "open sesame")
    book.answer("a1", true=True, by="ann", reason="insert was chipped")
    assert [a.true for a in book.answers()] == [True]


def _book_with_alarms(root: Path, *names: str) -> Book:
    """A book of one part whose alarms stand at 1 to 2 s, 2 to 3 s, and so on."""
    book = Book(Workspace.open(root), "m1")
    said = [
        {"id": name, "part": "p", "axis": "x", "t_start": float(k), "t_end": k + 1.0, "tool": "", "block": 3,
         "size_a": 1.0, "spreads": 9.0, "looks_like": "unknown"}
        for k, name in enumerate(names, start=1)
    ]  # fmt: skip
    book.verdict({"part": "p", "digest": "d1", "machine": "m1", "good": False, "alarms": said})
    return book


def test_what_is_left_out_of_training_is_what_the_book_says_though_a_process_died_behind_its_line(tmp_path):
    book = _book_with_alarms(tmp_path, "a1", "a2")
    (book.path.parent / "excluded.json").write_text("{}")  # as an older version could leave it, killed between the two
    code = "import os, signal, sys\nfrom pido.supervision.book import Book\nfrom pido.workspace import Workspace\n"
    code += "sync, book = os.fsync, Book(Workspace.open(sys.argv[1]), 'm1')\n"
    code += "os.fsync = lambda handle: (sync(handle), os.kill(os.getpid(), signal.SIGKILL))\n"
    code += "book.answer('a1', true=True, by='ann', reason='insert was chipped')"
    assert subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False).returncode == -9
    assert book.answered() == {"a1": "true alarm, says ann"}
    assert Workspace.open(tmp_path).excluded("m1") == {"d1": [[1.0, 2.0]]}


def test_answers_that_come_at_once_all_count(tmp_path):
    names = [f"a{k}" for k in range(12)]
    _book_with_alarms(tmp_path, *names)
    code = "import sys\nfrom pido.supervision.book import Book\nfrom pido.workspace import Workspace\n"
    code += "book = Book(Workspace.open(sys.argv[1]), 'm1')\n"
    code += "for name in sys.argv[2:]: book.answer(name, true=True, by='ann', reason='insert was chipped')"
    people = [subprocess.Popen([sys.executable, "-c", code, str(tmp_path), *names[k::2]]) for k in (0, 1)]
    assert [person.wait() for person in people] == [0, 0]
    assert Workspace.open(tmp_path).excluded("m1") == {"d1": [[k, k + 1.0] for k in range(1, 13)]}


def test_an_answer_to_an_alarm_that_nobody_raised_says_how_to_see_the_alarms(plant):
    with pytest.raises(RegistryError, match="pido monitor PART"):
        _call("monitor", "answer", "nothing", "--true", "--by", "a", "--reason", "b", "-w", plant / "ws")


def test_a_line_that_a_dying_process_left_unfinished_is_no_part_of_the_book(tmp_path):
    book = Book(Workspace.open(tmp_path), "m1")
    book.verdict({"part": "a", "digest": "d1", "machine": "m1", "good": True, "alarms": []})
    with book.path.open("a") as handle:
        handle.write('{"kind": "verdict", "part": "b"')
    book.verdict({"part": "c", "digest": "d3", "machine": "m1", "good": True, "alarms": []})
    assert [r["part"] for r in book.records()] == ["a", "c"]


def _csv(folder: Path, path: Path) -> int:
    recording = read_recording(folder)
    names = list(recording.columns)
    with path.open("w", newline="") as handle:
        writer = csv.writer(handle)
        writer.writerow(names)
        writer.writerows(zip(*(recording[name] for name in names), strict=True))
    return len(recording)


def test_a_growing_file_is_followed_to_its_end_and_its_jump_is_seen_as_it_happens(plant, tmp_path):
    whole = tmp_path / "whole.csv"
    count = _csv(plant / "bad", whole)
    live = tmp_path / "live.csv"
    text, place, now = whole.read_bytes(), [0], [0.0]

    def recorder(seconds: float) -> None:
        """Writes on while the reader waits, and stops in the middle of lines."""
        now[0] += seconds
        live.write_bytes(text[: place[0]])
        place[0] += 20_011

    events = list(
        follow_file(
            Workspace.open(plant / "ws"), live, machine=MACHINE, idle_s=0.5, sleep=recorder, clock=lambda: now[0]
        )
    )
    start, end = json.loads((plant / "when.json").read_text())
    jump = next(e for e in events if e["kind"] == "alarm" and e["axis"] == "x" and start <= e["t_end"] <= end)
    assert jump["t_end"] < start + 0.6
    assert events[-1]["kind"] == "end"
    assert events[-1]["samples"] == count
    assert not events[-1]["good"]


@pytest.mark.parametrize(
    ("factor", "said"), [(1000.0, "looks like mA"), (1e-3, "multiply its currents by 1000"), (40.0, "")]
)
def test_currents_in_mA_are_refused_while_the_part_is_followed_as_they_are_at_arrival(plant, tmp_path, factor, said):
    ws, part, live = Workspace.open(plant / "ws"), read_recording(plant / "good"), tmp_path / f"by {factor}.csv"
    currents = {name: values * factor for name, values in part.columns.items() if name.startswith("curr_")}
    _csv(write_folder(part.with_columns(**currents), tmp_path / "part"), live)
    events = follow_file(ws, live, machine=MACHINE, idle_s=0.0)
    if said:
        with pytest.raises(StoreError, match=said):
            list(events)
        assert not [r for r in Book(ws, MACHINE).records() if r.get("part") == live.stem]
    else:
        *_, end = events
        assert any("look at the export" in note for note in end["notes"])


def test_a_file_without_what_a_model_needs_is_refused_with_the_names_of_the_columns(plant, tmp_path):
    live = tmp_path / "live.csv"
    live.write_text("time,v_x,curr_x\n0.0,1.0,2.0\n")
    with pytest.raises(RecordingError, match="f_x_sim"):
        list(follow_file(Workspace.open(plant / "ws"), live, machine=MACHINE, idle_s=0.0))


def test_the_page_of_a_judged_part_is_small_shows_its_alarms_and_does_not_run_what_a_name_says(plant):
    judgement = monitor(Workspace.open(plant / "ws"), str(plant / "bad"))
    html = render(monitor_page(replace(judgement, part="<script>alert(1)</script>")))
    assert "<script>alert(1)" not in html
    assert len(html.encode()) < 3e6
    assert judgement.alarms[0].id in html
    assert NO_SAFETY_STOP in html.replace("&#39;", "'")


def test_what_was_said_of_an_alarm_stands_beside_it(plant):
    call = ["monitor", plant / "bad", "-w", plant / "ws"]
    name = json.loads(_call(*call, "--json"))["alarms"][0]["id"]
    _call("monitor", "answer", name, "--true", "--by", "ann", "--reason", "insert was chipped", "-w", plant / "ws")
    (line,) = [line for line in _call(*call).splitlines() if name in line]
    assert line.endswith("(true alarm, says ann)")
    assert json.loads(_call(*call, "--json"))["answered"] == {name: "true alarm, says ann"}


def test_a_part_without_a_whole_window_is_not_judged_rather_than_good_at_once_and_while_it_is_followed(plant, tmp_path):
    first = int(np.flatnonzero(read_recording(plant / "good")["mrr_sim"] > 0)[0])
    brief = _part(plant, "brief", rows=slice(first + 15), curr_x=5.0)
    call = ["monitor", brief, "-w", plant / "ws"]
    assert _call(*call, status=3).startswith("brief   not judged")
    answer = json.loads(_call(*call, "--json", status=3))
    assert (answer["good"], answer["verdict"], answer["alarms"]) == (False, "not judged", [])
    assert answer["notes"][-1].startswith("no stretch with the tool in engagement lasts 0.5 s")
    assert "Nothing unusual" not in render(monitor_page(monitor(Workspace.open(plant / "ws"), str(brief))))
    _csv(brief, tmp_path / "brief.csv")
    follow = ["monitor", "--follow", tmp_path / "brief.csv", "-w", plant / "ws", "--machine", MACHINE, "--idle-s", 0]
    assert _call(*follow, status=3).startswith("brief   not judged")
    book = Book(Workspace.open(plant / "ws"), MACHINE)
    at_once, followed = [r for r in book.records() if r.get("part") == "brief"]
    for said in ("good", "verdict", "judged", "unwatched", "notes"):
        assert followed[said] == at_once[said]
    assert book.unjudged() == {at_once["digest"], followed["digest"]}


def _without(plant: Path, name: str, where: Callable[[np.ndarray], np.ndarray], *columns: str) -> Path:
    recording = read_recording(plant / "good")
    gone = where(np.arange(len(recording)) / len(recording))
    lacking = {c: np.where(gone, np.nan, recording[c]) for c in columns}
    part = recording.part.model_copy(update={"part": name})
    return write_folder(Recording(part, {**recording.columns, **lacking}), plant / name)


def test_values_that_the_recording_lacks_are_warned_of_and_too_many_of_them_are_no_good_part(plant, tmp_path):
    currents = ("curr_x", "curr_y", "curr_z", "curr_sp")
    x_gone = _without(plant, "x_gone", lambda at: at > 0.55, "curr_x")
    one = json.loads(_call("monitor", x_gone, "-w", plant / "ws", "--json", status=3))  # a band of one part is too wide
    assert 0.75 < one["too_wide"] < 1.0
    assert any("values are missing where the tool is engaged (x " in note for note in one["notes"])
    for name, columns in (("all_gone", currents), ("input_gone", ("f_x_sim",))):
        # Up to nine tenths of the part, 10 of each 30 samples are gone: no window there has enough.
        part = _without(plant, name, lambda at: (np.arange(len(at)) % 30 < 10) & (at < 0.9), *columns)
        said = json.loads(_call("monitor", part, "-w", plant / "ws", "--json", status=3))
        assert (said["verdict"], said["good"]) == ("not judged", False)
        assert any("the recording lacks too many values" in note for note in said["notes"])
        _csv(part, tmp_path / f"{name}.csv")
        follow = ["monitor", "--follow", tmp_path / f"{name}.csv", "-w", plant / "ws", "--machine", MACHINE]
        assert _call(*follow, "--idle-s", 0, status=3).splitlines()[-1].startswith(f"{name}   not judged")


@pytest.mark.parametrize(
    ("alarms", "judged", "good", "said"),
    [((), 0.19, False, "not judged: only 19% of it could be"), ((), 0.6, True, "nothing unusual"),
     ((Alarm("p", "x", 1.0, 2.0, "", 3, 1.0, 9.0),), 0.19, False, "1 alarm(s); only 19% of it could be judged")],
)  # fmt: skip
def test_silence_about_most_of_a_part_is_no_verdict_and_the_share_is_said(plant, alarms, judged, good, said):
    verdict = Verdict("p", alarms, (), 800, judged)
    band = Expectation.of(Workspace.open(plant / "ws"), MACHINE).band(1.0)
    record = recorded(verdict, band, [NamedAlarm("a1", a, "unknown") for a in alarms], [])
    assert (headline(record), record["good"]) == (said, good)
    assert "unlike anything" in not_judged(verdict, band)


def test_a_band_from_one_part_that_would_let_twice_the_current_pass_does_not_call_a_part_good(plant):
    call = ["monitor", plant / "good", "-w", plant / "ws"]
    record = json.loads(_call(*call, "--json", status=3))
    assert (record["good"], record["verdict"], record["blind"]) == (False, "not judged", ["x", "y", "z", "sp"])
    assert "reaches as far as all that the axis draws" in record["notes"][-1]
    assert "the band is too wide on x, y, z, sp" in _call(*call, status=3)
    page = monitor_page(monitor(Workspace.open(plant / "ws"), str(plant / "good")))
    assert "as far as all that the axis draws" in page.verdict
    assert record["digest"] not in Book(Workspace.open(plant / "ws"), MACHINE).unjudged()  # by it the band narrows


def _followed(plant: Path, folder: Path, path: Path, status: int = 0) -> list[str]:
    """What is said of a part that was written into this file."""
    _csv(folder, path)
    call = ["monitor", "--follow", path, "-w", plant / "ws", "--machine", MACHINE, "--idle-s", 0]
    return _call(*call, status=status).splitlines()


def test_the_next_part_in_a_file_of_the_same_name_is_no_part_of_the_one_that_is_followed(plant, tmp_path):
    live, following = tmp_path / "mill.csv", tmp_path / "next.csv"
    count = _csv(plant / "good", live)
    _csv(plant / "bad", following)

    def recorder(seconds: float) -> None:
        if following.exists():
            following.rename(live)

    ws = Workspace.open(plant / "ws")
    *_, end = follow_file(ws, live, machine=MACHINE, idle_s=60.0, sleep=recorder, clock=lambda: 0.0)
    assert (end["samples"], end["verdict"]) == (count, "not judged")
    assert any("the next part is written into it" in note for note in end["notes"])
    *_, end = follow_file(ws, live, machine=MACHINE, idle_s=0.0)
    assert end["verdict"] == "alarms"
    assert [r["verdict"] for r in Book(ws, MACHINE).records() if r.get("part") == "mill"] == ["not judged", "alarms"]


@pytest.mark.parametrize("begins_alike", [True, False])
def test_alarms_can_be_answered_after_the_next_part_went_into_a_file_of_the_same_name(plant, tmp_path, begins_alike):
    odd = read_recording(plant / "good") if begins_alike else read_recording(plant / "bad")
    start, end = _longest_cut(odd)
    current = np.array(odd["curr_x"])
    current[(odd.time > start) & (odd.time < end)] += JUMP_A
    write_folder(Recording(odd.part, {**odd.columns, "curr_x": current}), tmp_path / "odd")
    same_name = tmp_path / f"recording-{begins_alike}.csv"
    name = next(line.split()[0] for line in _followed(plant, tmp_path / "odd", same_name) if "axis x" in line)
    assert "not judged" in _followed(plant, plant / "good", same_name, status=3)[-1]
    said = _call("monitor", "answer", name, "--true", "--by", "ann", "--reason", "chips", "-w", plant / "ws")
    assert f"part {same_name.stem}, axis x" in said
    book = Book(Workspace.open(plant / "ws"), MACHINE)
    assert name in book.answered()
    first, second = [r["digest"] for r in book.records() if r.get("part") == same_name.stem]
    assert (first == second) == begins_alike


def test_a_followed_alarm_says_its_identifier_as_it_begins_and_what_it_was_as_it_has_ended(plant, tmp_path):
    lines = _followed(plant, plant / "bad", tmp_path / "bad.csv")
    verdict = next(r for r in reversed(Book(Workspace.open(plant / "ws"), MACHINE).records()) if r.get("followed"))
    assert verdict["alarms"]
    for alarm in verdict["alarms"]:
        begins, ended = [line for line in lines if alarm["id"] in line]
        assert "begins" in begins
        assert "looks like" not in begins
        assert ended == f"  {alarm['id']}  has ended: {in_a_line(alarm)}"
    assert lines[-1].startswith(f"bad   {len(verdict['alarms'])} alarm(s)")


def test_an_answer_about_a_part_that_was_only_looked_at_says_that_nothing_changes_yet(plant, tmp_path):
    call = ["--by", "ann", "--reason", "new tool", "-w", plant / "ws"]
    name = json.loads(_call("monitor", plant / "bad", "-w", plant / "ws", "--json"))["alarms"][0]["id"]
    for said in ("--false", "--true"):
        assert "once the part is taken in" in _call("monitor", "answer", name, said, *call)
    name = _followed(plant, plant / "bad", tmp_path / "later.csv")[0].split()[0]
    assert "taken in under the name 'later'" in _call("monitor", "answer", name, "--false", *call)


@pytest.mark.parametrize(("rows", "said"), [(49, "49 samples, 1 too few"), (0, "no sample was written")])
def test_a_file_too_short_to_follow_says_by_how_much(plant, tmp_path, rows, said):
    _csv(plant / "good", tmp_path / "whole.csv")
    lines = (tmp_path / "whole.csv").read_text().splitlines(keepends=True)
    (tmp_path / "live.csv").write_text("".join(lines[: rows + 1]))
    with pytest.raises(RecordingError, match=said):
        list(follow_file(Workspace.open(plant / "ws"), tmp_path / "live.csv", machine=MACHINE, idle_s=0.0))


def test_a_file_that_is_no_text_is_not_followed_and_the_error_names_what_judges_it(plant):
    path = plant / "good" / "recording.parquet"
    with pytest.raises(RecordingError, match=r"CSV.*`pido monitor .*recording\.parquet`"):
        list(follow_file(Workspace.open(plant / "ws"), path, machine=MACHINE, idle_s=0.0))
