"""Two columns of a part folder instead of the currents: a measured force, and a simulation that lacks part of it."""

import json
import re

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from pido.cli.correct import command as correct_command
from pido.cli.diagnose import command as diagnose_command
from pido.core.errors import DiagnosisError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.diagnose import diagnose
from pido.diagnosis.pair import Pair, pair_of
from pido.recordings import read_recording
from pido.recordings.folder import write_folder


def part(place, number, rows=1200):
    """The measured force f_x is the simulated one and 4 N/(mm/s) that a guideway adds; 5 N of noise."""
    rng = np.random.default_rng(number)
    t = np.arange(rows) * 0.02
    v = np.convolve(np.repeat(rng.choice([-12.0, -5.0, 5.0, 12.0], rows // 50), 50), np.ones(9) / 9, "same")
    simulated = 200.0 * np.sin(0.7 * t + number)
    columns = {
        "time": t, "pos_x": np.cumsum(v) * 0.02, "v_x": v, "a_x": np.gradient(v, t), "f_x_sim": simulated,
        "f_x": simulated + 4.0 * v + rng.normal(0, 5.0, rows), "curr_x": rng.normal(0, 1, rows),
    }  # fmt: skip
    return write_folder(
        Recording(PartInfo(part=f"p{number}", machine="m", order=number), columns), place / f"p{number}"
    )


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    place = tmp_path_factory.mktemp("pair")
    parts = [part(place, k) for k in range(1, 5)]
    call = [*map(str, parts[:3]), "--pair", "f_x:f_x_sim", "--out", str(place / "out")]
    answer = CliRunner().invoke(diagnose_command, call)
    assert answer.exit_code == 0, answer.output
    return place, parts


def test_a_measured_force_keeps_its_name_beside_the_simulated_one(diagnosed):
    recording = read_recording(diagnosed[1][0])
    assert {"f_x", "f_x_sim"} <= set(recording.columns)
    assert np.std(recording["f_x"] - recording["f_x_sim"]) > 10


def test_the_finding_is_in_newtons(diagnosed):
    answer = json.loads((diagnosed[0] / "out" / "diagnosis.json").read_text())
    (finding,) = answer["findings"]
    assert (finding["axis"], finding["mechanism"]) == ("x", "viscous_friction")
    (friction,) = finding["parameters"].values()
    assert friction["unit"] == "N/(mm/s)"
    assert friction["value"] == pytest.approx(4.0, rel=0.05)
    assert finding["equation"].startswith("d(f_x) = ")
    assert finding["fit"]["rmse_after"] == pytest.approx(5.0, rel=0.1)


def test_series_and_page_say_newtons(diagnosed):
    out = diagnosed[0] / "out"
    series = pq.read_table(out / "parts" / "p1.parquet")
    assert series.schema.field("mismatch_x").metadata == {b"unit": b"N"}
    recording = read_recording(diagnosed[1][0])
    left = recording["f_x"] - series["curr_x_corrected"].to_numpy()
    assert np.std(left) == pytest.approx(5.0, rel=0.1)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "f_x, N" in page
    assert re.search(r"falls from \d+\.?\d* to \d+\.?\d* N\.", page)


def test_a_correction_needs_the_simulated_column_alone(diagnosed, tmp_path):
    place, parts = diagnosed
    whole = pq.read_table(parts[3] / "recording.parquet")
    blind = tmp_path / "p4"
    blind.mkdir()
    pq.write_table(whole.drop_columns(["f_x", "curr_x"]), blind / "recording.parquet")
    (blind / "part.json").write_bytes((parts[3] / "part.json").read_bytes())
    answer = CliRunner().invoke(correct_command, [str(place / "out"), str(blind), "--out", str(tmp_path / "c.parquet")])
    assert answer.exit_code == 0, answer.output
    corrected = pq.read_table(tmp_path / "c.parquet")["curr_x_corrected"].to_numpy()
    assert np.std(whole["f_x"].to_numpy() - corrected) == pytest.approx(5.0, rel=0.1)


@pytest.mark.parametrize(
    ("text", "axis", "unit"),
    [
        ("f_x:f_x_sim", "x", "N"),
        ("m_sp:m_sp_sim", "sp", "N·m"),
        ("curr_z:other", "z", "A"),
        ("power:power_sim", "x", ""),
    ],
)
def test_axis_and_unit_are_read_from_the_names(text, axis, unit):
    pair = Pair.parse(text)
    assert (pair.axis, pair.unit, str(pair)) == (axis, unit, text)


@pytest.mark.parametrize("text", ["f_x", "f_x:", ":f_x", "a:b:c", "f_x:f_x"])
def test_what_is_no_pair_is_refused(text):
    with pytest.raises(DiagnosisError, match="RECORDED:SIMULATED"):
        Pair.parse(text)


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("f_x_sim:f_x", ["--pair f_x:f_x_sim"]),
        ("curr_x:curr_y_sim", ["--pair curr_x:curr_x_sim", "--pair curr_y:curr_y_sim"]),
        ("f_x:m_sp", ["--pair f_x:f_x_sim", "--pair m_sp:m_sp_sim"]),
    ],
)
def test_swapped_columns_and_those_of_two_axes_are_refused_with_the_call_that_is_meant(text, meant, tmp_path):
    folder = part(tmp_path, 1)
    recording = read_recording(folder)
    more = {name: recording["curr_x"] for name in ("curr_y_sim", "m_sp")}
    write_folder(recording.with_columns(**more), folder)
    with pytest.raises(DiagnosisError) as refused:
        diagnose([read_recording(folder)], pair=text)
    assert all(call in str(refused.value) for call in meant)


def measured(place, change):
    """Three parts whose measured force is what `change(time, simulated, number)` makes of the simulated one."""
    made = []
    for k in (1, 2, 3):
        recording = read_recording(part(place, k))
        t = recording.time
        simulated = 250 * np.sin(0.7 * t + k) + 150 * np.sin(1.9 * t)
        made.append(recording.with_columns(f_x_sim=simulated, f_x=change(t, simulated, k)))
    return made


def noise(t, k):
    return np.random.default_rng(k).normal(0, 5, len(t))


@pytest.mark.parametrize(
    ("change", "mechanism", "says"),
    [
        (
            lambda t, s, k: np.minimum(s + noise(t, k), 300.0),
            "sensor_clipping",
            ("f_x = min(max(I, lowest), highest)", "wherever f_x reaches 300 N", ("f_x >= 300",)),
        ),
        (
            lambda t, s, k: np.interp(t - 0.08, t, s) + noise(t, k),
            "time_misalignment",
            ("f_x(t) = f_x_sim(t - shift)", "at every change of f_x: the recording comes ", ()),
        ),
    ],
)  # fmt: skip
def test_a_fault_of_the_data_is_told_with_the_names_and_unit_of_the_pair(change, mechanism, says, tmp_path):
    found = diagnose(measured(tmp_path, change), pair="f_x:f_x_sim")
    (finding,) = [f for f in found.findings if f.mechanism == mechanism]
    equation, summary, conditions = says
    assert (finding.equation, finding.where.conditions) == (equation, conditions)
    assert finding.where.summary.startswith(summary)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda t, s, k: np.full(len(t), 7.0), "'f_x' is constant"),
        (lambda t, s, k: s + np.where(k == 2, np.nan, 1.0), "'f_x' has no value in p2"),
        (lambda t, s, k: np.where(np.arange(len(t)) % 5 > 0, np.nan, s), "have both 'f_x' and 'f_x_sim'"),
    ],
)
def test_what_cannot_be_compared_is_refused_with_the_names_of_the_pair(change, says, tmp_path):
    with pytest.raises(DiagnosisError) as refused:
        diagnose(measured(tmp_path, change), pair="f_x:f_x_sim")
    assert says in str(refused.value)
    assert "curr" not in str(refused.value)


def test_wrong_samples_of_a_pair_are_said_of_its_column(tmp_path):
    found = diagnose(
        measured(tmp_path, lambda t, s, k: s + noise(t, k) + 1e6 * ((k == 2) & (np.arange(len(t)) == 500))),
        pair="f_x:f_x_sim",
    )
    (said,) = [note for note in found.notes if "set aside" in note]
    assert "1 sample of 'f_x' is set aside" in said


def test_a_correction_by_a_swapped_pair_that_was_accepted_once_is_still_read():
    assert str(pair_of({"pair": "f_x_sim:f_x"})) == "f_x_sim:f_x"
