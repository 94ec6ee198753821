"""What `simulate`, `correct` and `diagnose` read and where they write: nothing that was recorded is replaced."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis import contract
from pido.diagnosis.finding import Diagnosis, PartSeries
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.models import AxisModel, as_json
from pido.diagnosis.terms import Term
from pido.recordings import read_recording
from pido.recordings.folder import write_folder

VISCOUS = Term(next(m for m in CATALOGUE if m.id == "viscous_friction"))


def part(folder, name, machine="cmx600v"):
    t = np.arange(600) * 0.02
    v = 10 * np.sin(t)
    columns = {"time": t, "pos_x": -10 * np.cos(t), "v_x": v, "a_x": 10 * np.cos(t), "curr_x": v, "curr_x_sim": 0.9 * v}
    return write_folder(Recording(PartInfo(part=name, machine=machine), columns), folder / name)


@pytest.fixture
def place(tmp_path):
    """A diagnosis, two recorded parts, and a program with its job."""
    model = as_json({"x": AxisModel("x", 0.1, (VISCOUS,), (np.full(1, 0.1),))})
    contract.write(Diagnosis((), ("x",), {}, model), tmp_path / "diagnosis")
    for name in ("p01", "p02"):
        part(tmp_path, name)
    (tmp_path / "job.toml").write_text('machine = "cmx600v"\n[tools.T1]\ndiameter_mm = 10.0\nteeth = 2\n')
    (tmp_path / "slot.mpf").write_text("G90 G0 X0 Y0 Z5\nG1 X10 F600\nM30\n")
    return tmp_path


def contents(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize(
    "words",
    [
        "simulate {}/slot.mpf --job {}/job.toml --out {}/p01",
        "simulate {}/slot.mpf --job {}/job.toml --out {}/p01/recording.parquet",
        "simulate {}/slot.mpf --job {}/job.toml --out {}/about",
        "correct {}/diagnosis {}/p01 --out {}/p01/recording.parquet",
        "correct {}/diagnosis {}/p01 --out {}/p01/corrected.parquet",
        "correct {}/diagnosis {}/p01 --out {}/p02/recording.parquet",
        "correct {}/diagnosis {}/p01 --after {}/p02 --out {}/p02/corrected.parquet",
        "correct {}/diagnosis {}/p01 --out {}/diagnosis/model.json",
        "correct {}/diagnosis {}/p01 --out {}/slot.mpf",
    ],
)
def test_what_was_recorded_or_is_read_is_not_replaced(words, place, call):
    (place / "about").mkdir()
    (place / "about" / "part.json").write_text('{"part": "p09", "machine": "cmx600v"}')
    before = contents(place)
    code, out, err = call(*words.format(*[place] * 4).split())
    assert (code, out) == (1, "")
    assert err.startswith("pido: --out ")
    assert contents(place) == before


@pytest.mark.parametrize("name", ["diagnosis.json", "model.json", "details.json", "report.html", "parts"])
def test_a_file_of_somebody_else_is_not_replaced_by_a_diagnosis(name, place, call):
    (place / "mine").mkdir()
    (place / "mine" / name).write_text('{"schema": "of something else"}')
    (place / "empty").mkdir()  # reading this would be an error as well
    before = contents(place)
    code, out, err = call("diagnose", place / "empty", "--out", place / "mine")
    assert (code, out) == (1, "")
    assert err.startswith(f"pido: --out {place}/mine: ")
    assert f"mine/{name}" in err
    assert contents(place) == before


@pytest.mark.parametrize("out", ["mine", "diagnosis"])
def test_a_recording_in_the_folder_of_the_series_is_not_removed_by_a_diagnosis(out, place, call):
    (place / out / "parts").mkdir(parents=True, exist_ok=True)
    (place / out / "parts" / "of_monday.parquet").write_bytes((place / "p01" / "recording.parquet").read_bytes())
    before = contents(place)
    code, _, err = call("diagnose", place / "p01", "--out", place / out)
    assert code == 1
    assert "of_monday.parquet" in err
    assert contents(place) == before


def test_a_diagnosis_takes_the_place_of_an_earlier_one_and_goes_beside_what_it_does_not_replace(place, call):
    out = place / "diagnosis"
    (out / "parts").mkdir(exist_ok=True)
    for name in ("note.txt", "parts/note.txt"):
        (out / name).write_text("to be cut on Monday")
    for k, name in enumerate(("p01", "p02")):
        noise = np.random.default_rng(k).normal(0, 0.1, 600)
        changed(place / name, curr_x=read_recording(place / name)["curr_x"] + noise)
        code, _, err = call("diagnose", place / name, "--out", out)
        assert code == 0, err
    assert {p.name for p in (out / "parts").iterdir()} == {"p02.parquet", "note.txt"}
    assert (out / "note.txt").exists()


@pytest.mark.parametrize("out", ["simulated", "simulated.parquet", "simulated.PARQUET"])
def test_a_simulation_takes_the_place_of_an_earlier_one(out, place, call):
    words = ("simulate", place / "slot.mpf", "--job", place / "job.toml", "--out", place / out)
    assert call(*words, "--engagement")[0] == 0
    assert call(*words)[0] == 0
    assert "a_p" not in read_recording(place / out)


def test_a_simulation_is_not_written_under_the_name_of_another_format(place, call):
    code, _, err = call("simulate", place / "slot.mpf", "--job", place / "job.toml", "--out", place / "slot.csv")
    assert code != 0
    assert "NAME.parquet" in err
    assert not (place / "slot.csv").exists()


def test_a_simulation_goes_into_a_folder_that_holds_something_else(place, call):
    (place / "mine").mkdir()
    (place / "mine" / "note.txt").write_text("to be cut on Monday")
    code, _, err = call("simulate", place / "slot.mpf", "--job", place / "job.toml", "--out", place / "mine")
    assert code == 0, err
    assert read_recording(place / "mine").part.program == "slot.mpf"
    assert (place / "mine" / "note.txt").exists()


def test_a_correction_takes_the_place_of_an_earlier_one(place, call):
    for name in ("p01", "p02"):
        code, _, err = call("correct", place / "diagnosis", place / name, "--out", place / "corrected.parquet")
        assert code == 0, err


def changed(folder, **columns):
    recording = read_recording(folder)
    return write_folder(recording.with_columns(**columns), folder)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda t: 1000.0 * t, "looks like ms"),
        (lambda t: np.where(t == t[7], t[6], t), "time stands still"),
        (lambda t: np.where(t == t[7], np.nan, t), "time is missing"),
        (lambda t: t[::-1], "time goes backward"),
    ],
)
def test_a_part_whose_time_is_none_is_not_corrected(change, says, place, call):
    changed(place / "p01", time=change(read_recording(place / "p01").time))
    code, out, err = call("correct", place / "diagnosis", place / "p01", "--out", place / "c.parquet")
    assert (code, out) == (1, "")
    assert says in err


def test_a_part_in_another_unit_is_corrected_and_said(place, call):
    changed(place / "p01", v_x=60.0 * read_recording(place / "p01")["v_x"])
    code, _, err = call("correct", place / "diagnosis", place / "p01", "--out", place / "c.parquet")
    assert code == 0
    assert "It looks like mm/min" in err


def test_a_recorded_current_that_is_not_read_is_not_spoken_of(place, call):
    changed(place / "p01", curr_x=np.full(600, np.nan), curr_y=np.full(600, np.nan))
    code, _, err = call("correct", place / "diagnosis", place / "p01", "--out", place / "c.parquet")
    assert (code, err) == (0, "")


def test_what_is_derived_or_assumed_of_a_part_that_is_corrected_is_said(place, call):
    recording = read_recording(place / "p01")
    table = pd.DataFrame({name: recording[name] for name in ("pos_x", "v_x", "a_x", "curr_x_sim")})
    table.to_csv(place / "p03.csv", index=False)
    write_folder(replace(recording, columns={n: c for n, c in recording.columns.items() if n != "v_x"}), place / "p01")
    words = ("correct", place / "diagnosis", place / "p03.csv", "--after", place / "p01")
    code, _, err = call(*words, "--out", place / "c.parquet")
    assert code == 0, err
    assert "p03: no time column: rows are 20 ms apart" in err
    assert "p01: " in err
    assert "v_x" in err


def test_a_table_without_a_recorded_current_is_corrected_as_its_folder_is(place, call):
    recording = read_recording(place / "p01")
    bare = {name: column for name, column in recording.columns.items() if name != "curr_x"}
    pd.DataFrame(bare).to_csv(place / "p01.csv", index=False)
    write_folder(replace(recording, columns=bare), place / "p01")
    for name in ("p01", "p01.csv"):
        code, _, err = call("correct", place / "diagnosis", place / name, "--out", place / f"{name}.parquet")
        assert code == 0, err
    of_folder, of_table = (pd.read_parquet(place / f"{name}.parquet") for name in ("p01", "p01.csv"))
    pd.testing.assert_frame_equal(of_folder, of_table)


def test_an_infinite_speed_is_missing_in_a_correction_and_said_without_a_warning(place, call):
    changed(place / "p01", v_x=np.where(np.arange(600) == 50, np.inf, read_recording(place / "p01")["v_x"]))
    code, _, err = call("correct", place / "diagnosis", place / "p01", "--out", place / "c.parquet")
    assert code == 0
    assert "part p01: infinite values of v_x are taken as missing." in err
    assert "Warning" not in err


@pytest.mark.parametrize(("made_on", "code"), [("cmx600v", 0), ("dmc60h", 1), (None, 0)])
def test_a_diagnosis_is_applied_to_parts_of_its_own_machine(made_on, code, place, call):
    file = place / "diagnosis" / "model.json"
    model = json.loads(file.read_text())
    file.write_text(json.dumps(model if made_on is None else model | {"machine": made_on}))
    words = ("correct", place / "diagnosis", place / "p01", "--out", place / "c.parquet")
    got, _, err = call(*words)
    assert got == code
    assert not code or "is of machine 'cmx600v', and the diagnosis of 'dmc60h'" in err


@pytest.mark.parametrize(
    "words",
    [
        "simulate {0}/slot.mpf --job {0}/broken.toml --out {0}/job.toml/simulated",
        "simulate {0}/slot.mpf --job {0}/broken.toml --out {0}/job.toml/simulated.parquet",
        "correct {0}/diagnosis {0}/broken --out {0}/job.toml/c.parquet",
        "diagnose {0}/broken --out {0}/job.toml/diagnosis",
    ],
)
def test_a_place_that_cannot_be_written_is_said_before_anything_is_read(words, place, call):
    (place / "broken.toml").touch()
    (place / "broken").mkdir()
    code, out, err = call(*words.format(place).split())
    assert (code, out) == (1, "")
    assert f"{place}/job.toml/" in err
    assert "cannot be written" in err


@pytest.mark.parametrize("name", ["c.csv", "c.CSV", "c.json"])
def test_a_correction_is_not_written_under_the_name_of_another_format(name, place, call):
    code, _, err = call("correct", place / "diagnosis", place / "p01", "--out", place / name)
    assert code == 2
    assert "NAME.parquet is written" in err
    assert not (place / name).exists()


@pytest.mark.parametrize("file", ["diagnosis.json", "model.json", "parts/p09.parquet", "parts"])
def test_a_file_of_a_diagnosis_stands_for_its_folder(file, place, call):
    series = PartSeries(np.zeros(1), {"x": np.zeros(1)}, {"x": np.zeros(1)}, {"x": np.zeros(1)})
    contract.write_series(series, place / "diagnosis" / "parts" / "p09.parquet")
    code, _, err = call("correct", place / "diagnosis" / file, place / "p01", "--out", place / "c.parquet")
    assert code == 0, err


@pytest.mark.parametrize(
    "damage",
    [
        {"axes": {"x": {"delay": []}}},
        {"axes": {"x": {"delay": ["soon", 0.0]}}},
        {"axes": {"x": {"noise_level": "low"}}},
        {"history": [[1.0]]},
        {"worn": [], "parts": [], "orders": [], "history": []},
    ],
)
def test_a_model_that_is_damaged_is_said_to_be(damage, place, call):
    file = place / "diagnosis" / "model.json"
    model = json.loads(file.read_text())
    model["axes"]["x"] |= damage.pop("axes", {}).get("x", {})
    file.write_text(json.dumps(model | damage))
    code, _, err = call("correct", place / "diagnosis", place / "p01", "--out", place / "c.parquet")
    assert code == 1
    assert err.startswith("pido: the model of this diagnosis is damaged")
    assert "Run 'pido diagnose' again." in err
