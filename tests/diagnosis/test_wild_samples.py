"""A few wrong samples of a current are set aside and said; a true peak, however rare, never is."""

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.core.wild import wild_samples
from pido.diagnosis.diagnose import diagnose
from tests.plain_parts import parts, with_simulation

WHERE = slice(500, 503)


def moved(number=1, rate=50.0, rows=1200):
    """One axis to and fro, friction and noise, and a simulation without the viscous part of it."""
    rng = np.random.default_rng(number)
    t = np.arange(rows) / rate
    v = np.convolve(np.repeat(rng.choice([-12.0, -5.0, 5.0, 12.0], rows // 50), 50), np.ones(9) / 9, "same")
    held = 0.5 * np.sign(v)
    columns = {
        "time": t, "pos_x": np.cumsum(v) / rate, "v_x": v, "a_x": np.gradient(v, t), "curr_x_sim": held,
        "curr_x": held + 0.03 * v + rng.normal(0, 0.03, rows),
    }  # fmt: skip
    return Recording(PartInfo(part=f"p{number}", machine="m", order=number), columns)


def put(recording, column, rows, values):
    changed = recording[column].copy()
    changed[rows] = values
    return recording.with_columns(**{column: changed})


@pytest.mark.parametrize("column", ["curr_x", pytest.param("curr_x_sim", marks=pytest.mark.thorough)])
@pytest.mark.parametrize("value", [pytest.param(100.0, marks=pytest.mark.thorough), -9999.0])
def test_what_a_few_wrong_samples_would_hide_is_found_without_them(column, value):
    found = diagnose([moved(1), put(moved(2), column, WHERE, value), moved(3)])
    assert [(f.axis, f.mechanism) for f in found.findings] == [("x", "viscous_friction")]
    assert found.findings[0].fit.rmse_after == pytest.approx(0.03, rel=0.1)
    (said,) = [note for note in found.notes if "set aside" in note]
    assert f"part p2, axis x: 3 samples of '{column}' are set aside (10.00 to 10.04 s)" in said
    assert f"{value:.4g}" in said


@pytest.mark.parametrize("simulated", [True, False])
@pytest.mark.parametrize("rate", [20.0, 50.0, 500.0])
def test_wrong_samples_are_those_that_were_put_there(simulated, rate):
    recordings = [moved(k, rate) for k in (1, 2)]
    if not simulated:
        recordings = [Recording(r.part, {n: v for n, v in r.columns.items() if n != "curr_x_sim"}) for r in recordings]
    for rows in ([0], [500, 501, 502], [700, 900], [1199]):
        one, other = wild_samples([recordings[0], put(recordings[1], "curr_x", rows, 60.0)], "curr_x")
        assert not one.any()
        assert np.flatnonzero(other).tolist() == rows


def test_a_force_that_comes_and_goes_is_left_alone():
    """Forces of many times the usual current for tenths of a second, of several heights and lengths."""
    for seed in range(1, 21):
        rng = np.random.default_rng(seed)
        recording = moved(seed)
        current = recording["curr_x"].copy()
        for start in rng.integers(50, 1100, 6):
            current[start : start + rng.integers(2, 40)] += rng.uniform(1, 60)
        assert not wild_samples([recording.with_columns(curr_x=current)], "curr_x")[0].any()


def test_a_ringing_is_left_alone():
    for height in (2.0, 20.0, 500.0):
        recording = moved(rate=500.0, rows=6000)
        since = np.maximum(recording.time - 5.0, 0.0)
        ringing = height * np.exp(-since / 0.05) * np.sin(2 * np.pi * 40 * since)
        assert not wild_samples([recording.with_columns(curr_x=recording["curr_x"] + ringing)], "curr_x")[0].any()


@pytest.mark.parametrize("where", ["a_x", "v_x", "mrr_sim", "curr_x_sim"])
def test_a_peak_beside_which_something_else_stands_out_is_true(where):
    """The one rapid, the one bite of the tool, or what the simulation predicts, among hours of slow motion."""
    recording = moved().with_columns(mrr_sim=np.zeros(1200))
    lone = put(recording, "curr_x", WHERE, 60.0)
    assert wild_samples([lone], "curr_x")[0].sum() == 3
    largest = np.abs(recording[where]).max()
    assert not wild_samples([put(lone, where, slice(503, 506), 5 * max(largest, 1.0))], "curr_x")[0].any()


def test_an_axis_that_holds_still_but_for_one_short_move_keeps_its_peak():
    rng = np.random.default_rng(0)
    t = np.arange(6000) / 50.0
    v = np.zeros(6000)
    v[3000:3004] = [5.0, 60.0, 60.0, 5.0]
    current = 1.5 + rng.normal(0, 0.002, 6000) + 0.2 * v
    for columns in ({"v_z": v, "a_z": np.gradient(v, t)}, {"pos_z": np.cumsum(v) / 50}):
        recording = Recording(PartInfo(part="p", machine="m"), {"time": t, "curr_z": current, **columns})
        assert not wild_samples([recording], "curr_z")[0].any()


def test_a_current_beside_which_nothing_of_its_axis_was_recorded_is_not_judged():
    recording = put(moved(), "curr_x", WHERE, -9999.0)
    bare = Recording(recording.part, {n: recording[n] for n in ("time", "curr_x")})
    assert not wild_samples([bare], "curr_x")[0].any()


def test_missing_samples_and_constant_currents_are_not_wrong():
    recording = put(moved(), "curr_x", slice(100, 400), np.nan)
    assert not wild_samples([recording], "curr_x")[0].any()
    assert not wild_samples([recording.with_columns(curr_x=np.full(1200, 2.0))], "curr_x")[0].any()


def test_plain_parts_keep_every_sample():
    made = [with_simulation(r) for r in parts(4)]
    for column in ("curr_x", "curr_y", "curr_z", "curr_sp", "curr_x_sim", "curr_sp_sim"):
        assert not any(rows.any() for rows in wild_samples(made, column))
