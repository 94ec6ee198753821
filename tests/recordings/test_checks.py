"""A good recording has no faults; each damage done to it is found, where it was done, and nothing else is."""

import numpy as np
import pytest

from pido import config
from pido.core.errors import RecordingError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings import read_recording
from pido.recordings.check import blanked, check, usable_mask
from pido.recordings.derive import with_motion
from pido.recordings.resample import resample

N, RATE = 3000, 50.0


def _good(rng=None):
    """Sinusoidal motion with exact derivatives, a spindle at 3000 rpm, and currents with noise."""
    rng = rng or np.random.default_rng(0)
    t = np.arange(N) / RATE
    columns = {"time": t}
    for i, axis in enumerate("xyz"):
        w, r = 0.9 + 0.4 * i, 20.0 + 5 * i
        columns[f"pos_{axis}"] = 200 + r * np.sin(w * t)
        columns[f"v_{axis}"] = r * w * np.cos(w * t)
        columns[f"a_{axis}"] = -r * w**2 * np.sin(w * t)
        columns[f"curr_{axis}"] = 2 * np.tanh(columns[f"v_{axis}"]) + 0.05 * rng.normal(size=N)
    columns["v_sp"] = 18000.0 + 200 * np.sin(0.3 * t)
    columns["a_sp"] = 60 * np.cos(0.3 * t)
    columns["pos_sp"] = 18000.0 * t - 200 / 0.3 * np.cos(0.3 * t)
    columns["curr_sp"] = 1.0 + 0.05 * rng.normal(size=N)
    return Recording(PartInfo(part="p", machine="m"), columns)


def _spoiled(name, change, rows=slice(None)):
    good = _good()
    values = good[name].copy()
    values[rows] = change(values[rows])
    return good.with_columns(**{name: values})


@pytest.mark.parametrize("machine", [None, "dmc60h"])
def test_a_good_recording_has_no_faults(machine):
    assert check(_good(), config.machine(machine) if machine else None) == ()


@pytest.mark.parametrize("rpm", [3000.0, 6000.0])
def test_an_angle_that_stands_still_because_each_sample_is_a_whole_turn_is_no_fault(rpm):
    """Counted from 0 to 360 degrees, sampled at 50 Hz."""
    steady, good = np.full(N, 6 * rpm), _good()
    turning = good.with_columns(v_sp=steady, a_sp=np.zeros(N), pos_sp=np.full(N, 258.725))
    assert check(turning, None) == ()
    slower = turning.with_columns(v_sp=0.9 * steady)
    assert {(f.kind, f.column) for f in check(slower, None)} >= {("constant", "pos_sp")}


@pytest.mark.parametrize(
    ("column", "factor", "unit"),
    [
        ("v_x", 60.0, "mm/min"),
        ("v_y", 1e-3, "m/s"),
        ("v_sp", 1 / 6, "1/min"),
        ("v_sp", 1 / 360, "1/s"),
        ("v_sp", np.pi / 180, "rad/s"),
        ("a_x", 1e-3, "m/s²"),
        ("pos_z", 1e-3, "m"),
        ("pos_y", 1 / 25.4, "inch"),
        ("time", 1e3, "ms"),
    ],
)
def test_a_unit_slip_is_named_with_its_column_and_unit(column, factor, unit):
    faults = check(_spoiled(column, lambda v: v * factor))
    slips = [f for f in faults if f.kind == "unit_slip"]
    assert [f.column for f in slips] == [column]
    assert unit in slips[0].advice
    assert slips[0].severity == "error"


POSITIONS, SPEEDS, CHANGES = ([f"{p}_{a}" for a in "xyz"] for p in ("pos", "v", "a"))


def _scaled(*factors, without=()):
    """The good recording with some columns times a factor; `without`: columns that were not recorded."""
    good = _good()
    columns = {name: values for name, values in good.columns.items() if name not in without}
    for names, factor in factors:
        columns |= {name: columns[name] * factor for name in names}
    return with_motion(Recording(good.part, columns))


@pytest.mark.parametrize(
    ("factors", "told"),
    [
        ([(["time"], 1 / 60)], {"time": "minutes"}),
        ([(["time"], 1 / 3600)], {"time": "hours"}),
        ([(["time"], 50.0)], {"time": "a step of 1 becomes 0.02 s"}),  # the number of the row
        ([(["time"], 0.1)], {"time": "a step of 0.002 becomes 0.02 s"}),
        ([(["time"], 1.25)], {"time": "1.25 times as fast"}),
        ([(POSITIONS, 1e-3)], {"pos_x, pos_y, pos_z": "like m;"}),
        ([(POSITIONS, 1 / 25.4)], {"pos_x, pos_y, pos_z": "inch"}),
        ([(POSITIONS, 1e3)], {"pos_x, pos_y, pos_z": "µm"}),
        ([(POSITIONS, 1e4)], {"pos_x, pos_y, pos_z": "No unit is that factor"}),  # counts
        ([(SPEEDS, 60.0)], {"v_x, v_y, v_z": "mm/min"}),
        ([(CHANGES, 1e-3)], {"a_x, a_y, a_z": "m/s²"}),
        ([(SPEEDS, 1e-3), (CHANGES, 1e-3)], {"v_x, v_y, v_z": "m/s", "a_x, a_y, a_z": "m/s²"}),
        ([(SPEEDS, 60.0), (CHANGES, 3600.0)], {"v_x, v_y, v_z": "mm/min", "a_x, a_y, a_z": "mm/min²"}),
        ([(["v_sp", "a_sp"], np.pi / 180)], {"v_sp": "rad/s", "a_sp": "rad/s²"}),
        ([(["pos_sp"], np.pi / 180)], {"pos_sp": "rad"}),
        ([(["time"], 1e3), (["v_sp"], 1 / 6)], {"time": "ms", "v_sp": "1/min"}),
        ([(["pos_x"], 1e-3), (["v_y"], 60.0)], {"pos_x": "like m;", "v_y": "mm/min"}),
    ],
)
def test_what_explains_all_ratios_with_the_fewest_slips_is_named_and_nothing_else(factors, told):
    faults = check(_scaled(*factors))
    assert {f.kind for f in faults} == {"unit_slip"}
    said = {f.column: f"{f.what} {f.advice}" for f in faults}
    assert said.keys() == told.keys()
    assert all(unit in said[column] for column, unit in told.items())


def test_an_angle_of_the_spindle_and_derived_accelerations_are_no_evidence():
    angle = _good().with_columns(pos_sp=_good()["pos_sp"] % 360, v_sp=_good()["v_sp"] / 6)
    assert [(f.column, "1/min" in f.advice) for f in check(angle) if f.kind == "unit_slip"] == [("v_sp", True)]
    slipped = check(_scaled((["time"], 50.0), without=(*CHANGES, "a_sp")))
    assert [f.column for f in slipped if f.kind == "unit_slip"] == ["time"]


@pytest.mark.parametrize("without", [(), (*POSITIONS, "pos_sp")])
def test_accelerations_that_one_filter_made_smaller_are_no_time_of_another_clock(without):
    smaller = _scaled(([*CHANGES, "a_sp"], 0.85), without=without)
    assert [f.column for f in check(smaller) if f.kind == "unit_slip"] == []


def test_accelerations_of_ramps_that_last_a_few_samples_are_no_time_of_another_clock():
    """Differences of speeds flatten the peaks of such a ramp; the positions say that time is right."""
    steeper = _scaled((["a_x"], 1.098), (["a_y"], 1.075))
    assert [f.column for f in check(steeper) if f.kind == "unit_slip"] == []


def test_explanations_as_good_as_one_another_are_all_named():
    """Without accelerations and spindle: positions in m, or time in ms; either is a mill at 1 Hz or 1 kHz."""
    spindle = [name for name in _good().columns if name.endswith("_sp")]
    slow = _scaled((["time"], 50.0), without=(*CHANGES, *spindle))  # 1 Hz and right
    slow = slow.with_columns(**{v: slow[v] / 50 for v in SPEEDS})
    found = _scaled((POSITIONS, 1e-3), without=(*CHANGES, *spindle))
    found = Recording(found.part, {**slow.columns, **{p: found[p] for p in POSITIONS}}, found.notes)
    (fault,) = (f for f in check(found) if f.kind == "unit_slip")
    assert set(fault.column.split(", ")) >= {"time", "pos_x", "pos_y", "pos_z"}
    assert "'pos_x', 'pos_y', 'pos_z' in m" in fault.what
    assert "'time' in ms" in fault.what


def test_currents_in_milliampere_are_beyond_the_drive():
    table = config.machine_config("dmc60h")
    x = table.x.model_copy(update={"current_max_a": 20.0})
    machine = table.model_copy(update={"x": x}).build("m")
    faults = check(_spoiled("curr_x", lambda c: c * 1000), machine)
    assert [(f.kind, f.column) for f in faults] == [("unit_slip", "curr_x")]


@pytest.mark.parametrize(
    ("column", "change", "rows", "kind"),
    [
        ("curr_x", lambda c: np.full_like(c, np.nan), slice(100, 120), "missing_value"),
        ("curr_y", lambda c: np.full_like(c, c[0]), slice(500, 700), "frozen"),
        ("pos_x", lambda p: np.full_like(p, p[0]), slice(100, 160), "frozen"),
        ("v_sp", lambda v: v * 0 + 9e6, slice(1000, 1004), "counter_reset"),
        ("v_x", lambda v: v * 0 + 9e4, slice(1000, 1002), "impossible_speed"),
        ("curr_z", lambda c: np.clip(c, -2.03, 2.03), slice(None), "clipped"),
        ("curr_x", lambda c: c * 0 - 9999.0, slice(500, 503), "wild_current"),
    ],
)
def test_damage_is_found_where_it_was_done_and_its_samples_are_left_out(column, change, rows, kind):
    recording = _spoiled(column, change, rows)
    damaged = np.zeros(N, bool)
    damaged[rows] = True
    if kind == "clipped":
        damaged = np.abs(recording[column]) == 2.03
    faults = check(recording)
    found = [f for f in faults if f.kind == kind and f.column == column]
    assert len(found) == 1
    assert found[0].severity == "warning"
    wrong = found[0].mask ^ damaged
    assert wrong.sum() <= 0.02 * damaged.sum() + 1
    assert not (usable_mask(recording, faults) & found[0].mask).any()
    assert usable_mask(recording, faults)[~damaged].mean() > 0.99


@pytest.mark.parametrize("value", [-9999.0, 99999.0, 6553.5])
def test_a_placeholder_is_no_measuring_range_that_was_exceeded(value):
    faults = check(_spoiled("curr_x", lambda c: c * 0 + value, slice(500, 541)))
    assert "clipped" not in {f.kind for f in faults}
    (fault,) = (f for f in faults if f.kind == "placeholder")
    assert (fault.column, fault.severity, fault.rows) == ("curr_x", "warning", 41)
    assert np.flatnonzero(fault.mask).tolist() == list(range(500, 541))
    assert f"is {value:g} in 41 samples" in fault.what


def test_a_dead_channel_is_named():
    faults = check(_spoiled("curr_z", lambda c: c * 0))
    assert [(f.kind, f.column) for f in faults] == [("constant", "curr_z")]


@pytest.mark.parametrize(("step", "kind"), [(-3.0, "time_backward"), (-0.02, "time_repeated")])
def test_time_that_does_not_advance_is_an_error(step, kind):
    faults = check(_spoiled("time", lambda t: t + step, slice(700, None)))
    assert [f.kind for f in faults if f.severity == "error"] == [kind]
    assert faults[0].rows == 1


@pytest.mark.parametrize(
    ("stamp", "repeated"),
    [
        (lambda t: np.floor(10 * t + 1e-6) / 10, N - 600),  # of 50 Hz, written to a tenth of a second
        (lambda t: np.floor(t + 1e-6), N - 60),
        (lambda t: np.repeat(t[::2], 2), N - 1500),
        (lambda t: 0 * t, N - 1),
    ],
    ids=["tenths of a second", "whole seconds", "each twice", "one for all"],
)
def test_time_stamps_that_repeat_everywhere_are_one_error_and_nothing_is_judged_by_them(stamp, repeated):
    spoiled = _spoiled("time", stamp)
    assert [(f.kind, f.rows) for f in check(spoiled)] == [("time_repeated", repeated)]
    with pytest.raises(RecordingError, match=r"time does not advance in \d+ row\(s\), first in row 2;"):
        resample(spoiled, 5.0)


def test_a_gap_is_found_with_its_length():
    faults = check(_good().rows(np.r_[0:1000, 1200:N]))
    assert [f.kind for f in faults] == ["gap"]
    assert "4.02 s" in faults[0].what


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_missing_time_is_named_by_its_row(value):
    (fault,) = check(_spoiled("time", lambda t: t + value, slice(100, 101)))
    assert (fault.kind, fault.rows) == ("time_missing", 1)
    assert "first in row 101" in fault.what
    assert fault.t_start == pytest.approx(100 / RATE, abs=1.01 / RATE)


@pytest.mark.parametrize(("start", "kinds"), [(1.7e9, ["clock_time"]), (-1.7e9, ["clock_time"]), (600.0, [])])
def test_time_of_a_clock_is_no_time_from_the_first_sample_and_that_of_a_piece_is(start, kinds):
    assert [f.kind for f in check(_spoiled("time", lambda t: t + start)) if f.severity == "error"] == kinds


@pytest.mark.parametrize("missing", [1, 5])
def test_a_missing_speed_of_the_spindle_is_no_counter_reset(missing):
    rows = slice(700, 700 + missing)
    good = _spoiled("v_sp", lambda v: v * np.nan, rows)
    assert [(f.kind, f.column, f.rows) for f in check(good)] == [("missing_value", "v_sp", missing)]
    assert not usable_mask(good, check(good))[rows].any()
    assert usable_mask(good, check(good)).sum() == N - missing


@pytest.mark.parametrize(
    ("column", "values", "severity"),
    [
        ("coolant", np.full(N, 5.0), "error"),
        ("coolant", np.r_[2.0, np.ones(N - 1)], "warning"),
        ("nc_line", np.full(N, np.inf), "error"),
        ("nc_line", np.r_[-np.inf, np.ones(N - 1)], "warning"),
        ("mrr_sim", np.r_[np.zeros(N - 400), np.full(400, -7.0)], "error"),
        ("mrr_sim", np.r_[np.full(N - 4, 30.0), np.full(4, -7.0)], "warning"),
    ],
)
def test_values_that_a_column_cannot_have_are_said_and_left_out(column, values, severity):
    recording = _good().with_columns(**{column: values})
    faults = [f for f in check(recording) if f.kind == "outside_contract"]
    assert [(f.column, f.severity) for f in faults] == [(column, severity)]
    assert not usable_mask(recording, tuple(faults))[faults[0].mask].any()


@pytest.mark.parametrize(
    ("column", "values"),
    [
        ("coolant", np.r_[np.nan, 0.0, np.ones(N - 2)]),
        ("nc_line", np.r_[np.nan, np.arange(N - 1.0)]),
        ("mrr_sim", np.r_[-1e-9, np.full(N - 1, 30.0)]),
    ],
)
def test_values_that_a_column_may_have_are_no_fault(column, values):
    assert check(_good().with_columns(**{column: values})) == ()


def test_rows_in_shuffled_packets_are_an_error():
    good = _good()
    order = np.random.default_rng(3).permutation(N // 10)
    rows = (order[:, None] * 10 + np.arange(10)).ravel()
    shuffled = good.rows(rows).with_columns(time=good.time)
    assert any(f.kind == "shuffled" and f.severity == "error" for f in check(shuffled))


def test_a_row_written_twice_is_left_out_once():
    good = _good()
    twice = good.rows(np.r_[0:500, 499, 500:N]).with_columns(time=np.arange(N + 1) / RATE)
    faults = [f for f in check(twice) if f.kind == "duplicate"]
    assert np.flatnonzero(faults[0].mask).tolist() == [500]


def test_all_faults_are_listed_at_once():
    bad = _spoiled("v_x", lambda v: v * 60).with_columns(pos_q=np.zeros(N))
    columns = {k: v for k, v in bad.columns.items() if k != "curr_y"}
    columns["curr_z"] = np.where(np.arange(N) < 5, np.nan, columns["curr_z"])
    faults = check(Recording(bad.part, columns))
    assert {(f.kind, f.column) for f in faults} == {
        ("unit_slip", "v_x"),
        ("unknown_column", "pos_q"),
        ("missing_column", "curr_y"),
        ("missing_value", "curr_z"),
    }
    assert not usable_mask(bad, faults).any()


def test_empty_rows_are_one_fault_and_each_current_is_one_of_its_own():
    lost = np.isin(np.arange(N), (40, 41, 90))
    columns = {
        n: c if n == "time" or c.dtype == object else np.where(lost, np.nan, c) for n, c in _good().columns.items()
    }
    faults = check(Recording(_good().part, columns))
    assert {(f.kind, f.rows, f.severity) for f in faults} == {("missing_value", 3, "warning")}
    (inputs,) = [f for f in faults if "curr" not in f.column]
    assert {"pos_x", "v_sp", "a_sp"} <= set(inputs.column.split(", "))
    assert f"{len(inputs.column.split(', '))} columns are missing in" in inputs.what
    assert sorted(f.column for f in faults if f is not inputs) == ["curr_sp", "curr_x", "curr_y", "curr_z"]
    assert (usable_mask(_good(), faults) == ~lost).all()


def test_a_tool_that_never_cuts_is_an_error_unless_it_is_an_air_cut():
    recording = _good().with_columns(mrr_sim=np.zeros(N))
    assert check(recording) == ()
    [fault] = check(recording, air_cut=False)
    assert fault.kind == "never_engaged"
    assert "air cut" in fault.advice
    [fault] = check(recording.with_columns(f_x_sim=np.full(N, -80.0)), air_cut=False)
    assert fault.advice == "f_x_sim is not: export both as simulated."


@pytest.mark.parametrize("n", [0, 1, 2, 10])
def test_too_few_samples_are_an_error(n):
    assert any(f.kind == "too_short" and f.severity == "error" for f in check(_good().rows(slice(0, n))))


@pytest.mark.real
@pytest.mark.parametrize("machine", [None, "dmc60h"])
def test_the_spindle_resets_of_the_published_air_cut_are_found_and_little_else_is(real_data, machine):
    recording = read_recording(real_data / "kit_dmc60h" / "S235JR_part2_aircut_1.csv")
    faults = check(recording, config.machine(machine) if machine else None)
    assert {f.kind for f in faults} == {"counter_reset"}
    lost = ~usable_mask(recording, faults)
    impossible = np.abs(recording["v_sp"]) > 30_000  # 24 samples; the program turns at 3200 rpm at most
    assert impossible.sum() == 24
    assert lost[impossible].all()
    assert lost[np.abs(recording["a_sp"]) > 1e5].all()
    assert lost.sum() <= 60


def test_a_fault_of_one_current_costs_that_current_and_one_of_an_input_the_whole_sample():
    rows, good = np.arange(N), _good()
    columns = {name: np.array(values) for name, values in good.columns.items()}
    columns["curr_x"][rows % 12 == 0] = np.nan
    columns["v_y"][100:120] = np.nan
    bad = Recording(good.part, columns)
    left = blanked(bad, check(bad))
    gone = (rows >= 100) & (rows < 120)
    np.testing.assert_array_equal(np.isnan(left["curr_x"]), gone | (rows % 12 == 0))
    np.testing.assert_array_equal(np.isnan(left["curr_y"]), gone)
    np.testing.assert_array_equal(left["pos_x"], good["pos_x"])
    assert blanked(good, ()) is good


@pytest.mark.parametrize(("there", "hint"), [((), "Did you mean 'f_x_sim'? "), (("f_x_sim",), "")])
def test_a_force_is_no_misspelt_speed(there, hint):
    """A hint that is followed must not make a speed of a force, nor name a column that is there."""
    columns = {"time": np.arange(200) * 0.01, "f_x": np.ones(200)} | {name: np.ones(200) for name in there}
    told = [f for f in check(Recording(PartInfo(part="p", machine="m"), columns)) if f.column == "f_x"]
    assert [f.advice for f in told] == [f"{hint}Rename or drop it."]
