"""The contract as an outside reader has it: a schema and checks written by hand from its text, no code of pido's.

`pido diagnose` and `pido correct` run as commands on part folders; only what stands in their files is looked at.
"""

import json
import re
import subprocess
import sys

import jsonschema
import numpy as np
import pyarrow.parquet as pq
import pytest
from plain_parts import parts, with_simulation

from pido.diagnosis import contract
from pido.diagnosis.finding import Diagnosis, PartSeries
from pido.recordings import read_recording
from pido.recordings.folder import write_folder

AXES = ["x", "y", "z", "sp"]
VOCABULARY = re.findall(
    r"\w+",
    """
coulomb_friction viscous_friction stribeck_friction standstill_friction friction_asymmetry load_dependent_friction
position_dependent_friction presliding_hysteresis backlash inertia gravity_load axis_coupling torque_ripple
cutting_force edge_force tool_wear material_hard_zone coolant_load
spindle_viscous_drag spindle_windage spindle_inertia spindle_torque_load
thermal_drift current_saturation external_force
time_misalignment sensor_gain sensor_offset sensor_clipping input_fault unknown
""",
)
KIND = dict.fromkeys(VOCABULARY, "missing_physics") | dict.fromkeys(
    ("time_misalignment", "sensor_gain", "sensor_offset", "sensor_clipping", "input_fault"), "data_fault"
) | {"unknown": "unexplained"}  # fmt: skip

NUMBER = {"type": "number"}
TEXT = {"type": "string", "minLength": 1}
SHARE = {"type": "number", "minimum": 0, "maximum": 1}
MECHANISM = {"type": "string", "pattern": f"^(miscalibrated:)?({'|'.join(VOCABULARY)})$"}


def record(**keys):
    return {"type": "object", "properties": keys, "required": list(keys), "additionalProperties": False}


def many(item, **more):
    return {"type": "array", "items": item, **more}


PARAMETER = record(value=NUMBER, unit=TEXT, ci95=many(NUMBER, minItems=2, maxItems=2))
WHERE = record(
    summary=TEXT,
    conditions=many(TEXT),
    intervals=many(record(part=TEXT, t_start=NUMBER, t_end=NUMBER, score=SHARE)),
)
FIT = record(
    scheme=TEXT,
    rmse_before={**NUMBER, "minimum": 0},
    rmse_after={**NUMBER, "minimum": 0},
    r2_before={**NUMBER, "maximum": 1},
    r2_after={**NUMBER, "maximum": 1},
    p_value=SHARE,
)
FINDING = record(
    axis={"enum": AXES},
    mechanism=MECHANISM,
    kind={"enum": ["missing_physics", "miscalibrated", "data_fault", "unexplained"]},
    equation=TEXT,
    parameters={"type": "object", "additionalProperties": PARAMETER},
    where=WHERE,
    evidence=record(p_value=SHARE, q_value=SHARE, delta_bic=NUMBER),
    fit=FIT,
    replaces=many(TEXT),
    alternatives=many(record(mechanism=MECHANISM, delta_bic=NUMBER)),
)
SCHEMA = record(
    schema={"const": "pido.diagnosis/1"},
    findings=many(FINDING),
    clean_axes=many({"enum": AXES}, uniqueItems=True),
)


def pido(*words):
    done = subprocess.run(
        [sys.executable, "-m", "pido.cli", *map(str, words)], capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Three parts without viscous friction on x in their simulation, and a fourth that stays at home."""
    place = tmp_path_factory.mktemp("contract")
    folders = [
        write_folder(with_simulation(part, (("x", "viscous_friction"),)), place / part.part.part) for part in parts(4)
    ]
    pido("diagnose", *folders[:3], "--out", place / "out")
    return place / "out", folders


@pytest.fixture(scope="module")
def answer(made):
    return json.loads((made[0] / "diagnosis.json").read_text(encoding="utf-8"))


def test_the_answer_has_the_keys_and_types_of_the_contract_and_no_others(answer):
    jsonschema.validate(answer, SCHEMA)


def test_the_mechanism_is_named_with_the_kind_that_the_vocabulary_gives_it(answer):
    assert [(f["axis"], f["mechanism"]) for f in answer["findings"]] == [("x", "viscous_friction")]
    for finding in answer["findings"]:
        name = finding["mechanism"]
        assert finding["kind"] == ("miscalibrated" if name.startswith("miscalibrated:") else KIND[name])


def test_every_axis_has_a_finding_or_is_clean(answer):
    found = {f["axis"] for f in answer["findings"]}
    assert found | set(answer["clean_axes"]) == set(AXES)
    assert not found & set(answer["clean_axes"])


def test_evidence_and_intervals_are_what_they_say(answer, made):
    last = {f.name: float(pq.read_table(f / "recording.parquet")["time"][-1].as_py()) for f in made[1]}
    for finding in answer["findings"]:
        assert finding["evidence"]["p_value"] <= finding["evidence"]["q_value"] <= 0.05
        assert finding["fit"]["rmse_after"] < finding["fit"]["rmse_before"]
        assert finding["fit"]["r2_after"] > finding["fit"]["r2_before"]
        assert "part" in finding["fit"]["scheme"]
        for one in finding["where"]["intervals"]:
            assert 0 <= one["t_start"] <= one["t_end"] <= last[one["part"]]
        for name, parameter in finding["parameters"].items():
            low, high = parameter["ci95"]
            assert low <= parameter["value"] <= high, name


def test_the_parameter_is_the_true_one_in_its_unit(answer):
    ((_, friction),) = answer["findings"][0]["parameters"].items()
    assert friction["unit"] == "A/(mm/s)"
    assert friction["value"] == pytest.approx(0.02, rel=0.05)


@pytest.mark.parametrize("number", [0, 1, 2])
def test_the_series_of_a_part_has_its_rows_columns_and_units(made, number):
    out, folders = made
    folder = folders[number]
    series, recording = (
        pq.read_table(out / "parts" / f"{folder.name}.parquet"),
        pq.read_table(folder / "recording.parquet"),
    )
    wanted = {"time"} | {f"{n}{a}{m}" for a in AXES for n, m in (("mismatch_", ""), ("mismatch_score_", ""))}
    assert set(series.column_names) == wanted | {f"curr_{a}_corrected" for a in AXES}
    get = {name: series[name].to_numpy() for name in series.column_names}
    np.testing.assert_array_equal(get["time"], recording["time"].to_numpy())
    for axis in AXES:
        assert np.isfinite(get[f"mismatch_{axis}"]).all()
        assert ((get[f"mismatch_score_{axis}"] >= 0) & (get[f"mismatch_score_{axis}"] <= 1)).all()
        simulated = recording[f"curr_{axis}_sim"].to_numpy()
        np.testing.assert_allclose(get[f"curr_{axis}_corrected"], simulated + get[f"mismatch_{axis}"], atol=1e-12)
    assert not get["mismatch_y"].any()  # nothing was found there
    np.testing.assert_allclose(get["mismatch_x"], 0.02 * recording["v_x"].to_numpy(), atol=0.02)
    units = {field.name: (field.metadata or {}).get(b"unit") for field in series.schema}
    assert units["time"] == b"s"
    assert units["mismatch_x"] == units["curr_x_corrected"] == b"A"


def test_only_the_parts_that_were_named_have_series(made):
    out, folders = made
    assert {p.stem for p in (out / "parts").iterdir()} == {f.name for f in folders[:3]}


def test_a_correction_reads_no_recorded_current_and_writes_the_same_columns(made, tmp_path):
    out, folders = made
    table = pq.read_table(folders[3] / "recording.parquet")
    blind = tmp_path / folders[3].name
    blind.mkdir()
    pq.write_table(table.drop_columns([f"curr_{a}" for a in AXES]), blind / "recording.parquet")
    (blind / "part.json").write_bytes((folders[3] / "part.json").read_bytes())
    for source, target in ((folders[3], "seen"), (blind, "blind")):
        pido("correct", out, source, "--out", tmp_path / "new" / f"{target}.parquet")
    seen, unseen = (pq.read_table(tmp_path / "new" / f"{name}.parquet") for name in ("seen", "blind"))
    assert seen.equals(unseen)
    assert seen.column_names == pq.read_table(out / "parts" / f"{folders[0].name}.parquet").column_names
    recorded = table["curr_x"].to_numpy()
    before, after = (np.std(recorded - t[c].to_numpy()) for t, c in ((table, "curr_x_sim"), (seen, "curr_x_corrected")))
    assert after < 1.1 * 0.05 < before


def test_a_correction_holds_no_number_where_what_it_follows_from_is_missing(made, tmp_path):
    out, folders = made
    whole = read_recording(folders[3])
    missing = np.arange(len(whole)) // 50 == 4
    part = write_folder(whole.with_columns(v_x=np.where(missing, np.nan, whole["v_x"])), tmp_path / "holed")
    pido("correct", out, part, "--out", tmp_path / "corrected.parquet")
    series = pq.read_table(tmp_path / "corrected.parquet")
    for axis in AXES:
        for name in (f"mismatch_{axis}", f"mismatch_score_{axis}", f"curr_{axis}_corrected"):
            np.testing.assert_array_equal(np.isnan(series[name].to_numpy()), missing & (axis == "x"), name)


def test_diagnosing_fewer_parts_into_the_same_folder_leaves_none_of_the_others_behind(made, tmp_path):
    time = np.arange(3.0)
    one = PartSeries(time, {"x": time}, {"x": time}, {"x": time})
    contract.write(Diagnosis((), (), {"a": one, "b": one}, {}), tmp_path)
    contract.write(Diagnosis((), (), {"b": one}, {}), tmp_path)
    assert [p.name for p in (tmp_path / "parts").iterdir()] == ["b.parquet"]


@pytest.mark.parametrize("place", ["here", "new"])
def test_a_diagnosis_that_cannot_be_written_leaves_the_former_one_and_what_lies_beside_it(place, tmp_path):
    time = np.arange(3.0)
    fits = PartSeries(time, {"x": time}, {"x": time}, {"x": time})
    contract.write(Diagnosis((), ("x",), {"a": fits}, {}), tmp_path / "here")
    (tmp_path / "here" / "of.json").write_text("[]")
    (tmp_path / "here" / "parts" / "note.txt").write_text("worn")
    before = {p.relative_to(tmp_path): p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    half = PartSeries(time, {"x": time[:2]}, {"x": time}, {"x": time})
    with pytest.raises(ValueError, match="length"):
        contract.write(Diagnosis((), ("x",), {"b": fits, "c": half}, {}), tmp_path / place)
    assert {p.relative_to(tmp_path): p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before
    assert not (tmp_path / "new").exists()
    contract.write(Diagnosis((), ("x",), {"b": fits}, {}), tmp_path / "here")
    assert {p.name for p in (tmp_path / "here").iterdir()} == {
        "diagnosis.json", "details.json", "model.json", "parts", "of.json",
    }  # fmt: skip
    assert {p.name for p in (tmp_path / "here" / "parts").iterdir()} == {"b.parquet", "note.txt"}


def test_conditions_are_comparisons_of_columns(answer):
    for finding in answer["findings"]:
        for condition in finding["where"]["conditions"]:
            assert re.search(r"[<>=≠]", condition), condition
