"""Signals that cannot be true are found where they are, and nothing else is."""

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.comparable import comparable_axes
from pido.diagnosis.datafaults import clipped, input_findings
from pido.diagnosis.faults import HUNG, clipping, displaced, faulty, input_faults
from pido.recordings import read_recording


def axis_in_motion(rate: float, seed: int = 0, noise: float = 0.003, box: bool = False) -> Recording:
    """One axis to and fro at changing feed with stops: exact, then sampled with noise; `box` averages each sample."""
    fine = 2000
    t = np.arange(0.0, 40.0, 1 / fine)
    wanted = np.repeat(np.random.default_rng(seed).choice([-30.0, -8.0, -1.0, 0.0, 0.0, 1.0, 8.0, 30.0], 25), 3200)[
        : len(t)
    ]
    kernel = np.hanning(402)[1:-1]
    v = np.convolve(wanted, kernel / kernel.sum(), "same")
    pos, a = 100 + np.cumsum(v) / fine, np.gradient(v, t)
    m = int(fine / rate)
    pick = (lambda s: s.reshape(-1, m).mean(axis=1)) if box else (lambda s: s[::m])
    rng = np.random.default_rng(seed + 1)
    n = len(pick(t))
    columns = {
        "time": pick(t) - pick(t)[0],
        "pos_x": np.round(pick(pos), 3),
        "v_x": pick(v) + rng.normal(0, noise, n),
        "a_x": pick(a) + rng.normal(0, 30 * noise, n),
        "v_sp": 6000.0 + rng.normal(0, 3.0, n),
        "pos_sp": np.mod(np.cumsum(np.full(n, 6000.0 / rate)), 360.0),
    }
    return Recording(PartInfo(part="p", machine="m"), columns)


@pytest.mark.parametrize("rate", [50.0, 100.0, 500.0])
@pytest.mark.parametrize("noise", [0.0, 0.003, 0.05])
@pytest.mark.parametrize("box", [False, True])
def test_a_true_recording_has_no_fault_however_fast_noisy_or_smoothed(rate, noise, box):
    for seed in range(3):
        assert input_faults(axis_in_motion(rate, seed, noise, box)) == {}


def test_a_measured_acceleration_that_is_rough_while_it_is_large_is_no_fault():
    for seed in range(6):
        recording = axis_in_motion(50.0, seed, noise=0.0)
        a = recording["a_x"]
        rough = np.random.default_rng(seed).normal(0, 0.15, len(a)) * np.abs(a)
        assert input_faults(recording.with_columns(a_x=a + rough)) == {}
        spiked = put(recording.with_columns(a_x=a + rough), "a_x", slice(700, 702), 4 * np.abs(a).max())
        assert set(input_faults(spiked)) == {"a_x"}


def test_a_speed_that_a_filter_delays_is_no_fault_at_its_peaks():
    """Slow work with small changes of speed nearly all the time, and a few rapids that turn without a pause."""
    t = np.arange(0.0, 40.0, 0.002)
    v = 5.0 + np.sin(t) + 150.0 * np.sin(2 * np.pi * t / 0.2) * (np.mod(t, 10.0) < 0.2)
    pos = np.cumsum(v) * 0.002
    late = v[0] + lfilter([0.3], [1, -0.7], v - v[0])
    columns = {"time": t, "pos_x": pos, "v_x": late, "a_x": np.gradient(late, t)}
    assert input_faults(Recording(PartInfo(part="p", machine="m"), columns)) == {}


def test_a_speed_that_was_smoothed_over_the_end_of_its_record_is_no_fault():
    t = np.arange(0.0, 40.0, 0.002)
    v = 5.0 + np.sin(t) - 500.0 * np.maximum(t - 39.9, 0.0)
    smooth = v.copy()
    smooth[-8:] += 16.0 * (np.arange(1, 9) / 8) ** 2
    columns = {"time": t, "pos_x": np.cumsum(v) * 0.002, "v_x": smooth, "a_x": np.gradient(smooth, t)}
    assert input_faults(Recording(PartInfo(part="p", machine="m"), columns)) == {}


@pytest.mark.parametrize("fault", [0.0, 60.0])
def test_a_quick_turn_whose_acceleration_is_smoothed_is_no_spike(fault):
    """2 mm/s to and fro, turned in 30 ms three times, in a record that blurs its acceleration beside feeds of 25 mm/s
    that change slowly."""
    t = np.arange(0.0, 60.0, 0.01)
    slow = np.where((t > 9.005) & (t < 20.005) | (t > 31.005), 2.0, -2.0)
    fast = 25.0 * np.sin(np.pi * (t - 35.0) / 10) ** 2 * (t > 35.0) * (t < 55.0)
    true = np.convolve(np.pad(slow, 1, "edge"), [0.35, 0.55, 0.1], "valid") + fast
    a = uniform_filter1d(np.gradient(true, t), 5)
    v = np.round((true + fault * (np.arange(len(t)) == 2500)) / 0.025) * 0.025
    columns = {"time": t, "pos_x": np.round(np.cumsum(true) * 0.01, 3), "v_x": v, "a_x": np.round(a / 0.25) * 0.25}
    found = input_faults(Recording(PartInfo(part="p", machine="m"), columns))
    assert set(found) <= {"v_x", "a_x"} if fault else not found
    assert ("v_x" in found) == bool(fault)


def test_an_acceleration_that_came_and_went_between_samples_is_no_spike_and_one_without_a_change_of_speed_is():
    t = np.arange(0.0, 60.0, 0.0005)
    wanted = np.repeat(np.random.default_rng(3).choice([-6.0, -2.0, 0.0, 2.0, 6.0], 25), 4800)
    slow = np.convolve(wanted, np.ones(1000) / 1000, "same") + 3.0 * (t > 30.006)  # one step of 3 mm/s within 5 ms
    v = np.convolve(slow, np.ones(10) / 10, "same")
    a, seen = np.gradient(v, t), slice(12, -200, 32)
    columns = {"time": t[seen] - t[12], "pos_x": np.cumsum(v)[seen] * 0.0005, "v_x": v[seen], "a_x": a[seen]}
    at = int(np.argmin(np.abs(t[seen] - 30.006)))
    columns["a_x"][at] = 550.0  # caught at its height
    recording = Recording(PartInfo(part="p", machine="m"), columns)
    assert input_faults(recording) == {}
    assert set(input_faults(put(recording, "a_x", slice(1500, 1501), 550.0))) == {"a_x"}


def test_a_move_between_two_slow_samples_is_no_counter_reset():
    """20 Hz: 6 mm under 8 m/s², of which the samples show the end alone."""
    fine = np.arange(60_000) / 1000.0
    pulse = np.r_[np.full(27, 8000.0), np.full(27, -8000.0)]
    a = np.zeros(len(fine))
    for k, start in enumerate(range(2_000, 58_000, 4_000)):
        a[start : start + 16 * len(pulse)] = np.repeat(pulse / 64, 16) * (-1) ** k
    a[30_502 : 30_502 + len(pulse)] = pulse
    v = np.cumsum(a) / 1000.0
    slow = {"time": fine, "pos_x": np.cumsum(v) / 1000.0, "v_x": v, "a_x": a, "curr_x": 1e-4 * a}
    recording = Recording(PartInfo(part="p", machine="m"), {n: x[::50] for n, x in slow.items()})
    assert input_faults(recording) == {}


def test_the_last_digits_of_a_constant_speed_are_no_fault():
    t = np.arange(0.0, 40.0, 0.004)
    v = np.full(len(t), 55440.0)
    v[12:16] += 1e-8
    columns = {"time": t, "v_sp": v, "a_sp": np.where((t > 0.035) & (t < 0.061), 3e-6, 0.0)}
    assert input_faults(Recording(PartInfo(part="p", machine="m"), columns)) == {}


def put(recording: Recording, column: str, rows: slice, values) -> Recording:
    signal = recording[column].copy()
    signal[rows] = values if np.isscalar(values) else signal[rows] + values
    return recording.with_columns(**{column: signal})


@pytest.mark.parametrize("rate", [20.0, 50.0, 100.0, 500.0])
@pytest.mark.parametrize("column", ["pos_x", "v_x", "a_x"])
def test_samples_that_are_missing_are_no_fault_of_their_neighbours(rate, column):
    for seed in range(3):
        recording = axis_in_motion(rate, seed)
        lost = np.random.default_rng(seed).random(len(recording)) < 0.01
        lost |= np.arange(len(recording)) == moving(recording, rate)
        signal = np.where(lost, np.nan, recording[column])
        assert input_faults(recording.with_columns(**{column: signal})) == {}


def moving(recording: Recording, rate: float) -> int:
    """A sample in the middle of a change between two feeds."""
    far = np.abs(recording["a_x"]) > 0.5 * np.abs(recording["a_x"]).max()
    inside = np.flatnonzero(far & (recording.time > 5) & (recording.time < 35))
    return int(inside[len(inside) // 2])


@pytest.mark.parametrize("rate", [50.0, 500.0])
@pytest.mark.parametrize(
    ("column", "seconds", "change"),
    [
        ("pos_x", None, 1500.0),  # a counter reset
        ("pos_x", None, -4.0),  # a small jump
        ("pos_x", 0.0, 25.0),  # one wrong sample
        ("pos_x", 1.5, "frozen"),
        ("v_x", 0.0, 90.0),
        ("v_x", 1.5, "frozen"),
        ("v_x", 1.0, 25.0),  # off by a constant for a second
        ("a_x", 0.0, 3000.0),
        ("a_x", 1.5, "frozen"),
    ],
)
def test_a_wrong_signal_is_found_where_it_is_wrong(rate, column, seconds, change):
    clean = axis_in_motion(rate, seed=2)
    i = moving(clean, rate)
    j = len(clean) if seconds is None else i + 1 + int(seconds * rate)
    values = float(clean[column][i]) if change == "frozen" else np.full(j - i, change)
    found = input_faults(put(clean, column, slice(i, j), values))
    assert column in found
    assert set(found) <= {column, "a_x"}  # an acceleration beside a wrong speed is wrong as well
    first = min(f.t_start for f in found[column])
    assert first == pytest.approx(clean.time[i], abs=0.35 if change == "frozen" else 3 / rate)
    last = max(f.t_end for f in found[column])
    end = clean.time[-1] if seconds is None else clean.time[j - 1]
    assert last <= end + 0.35


def summed(rate: float) -> Recording:
    """A position that is the sum of the speeds: half a sample from the integral of what is sampled."""
    made = axis_in_motion(rate, seed=2, noise=0.0)
    t, v = made.time, made["v_x"]
    return made.with_columns(pos_x=100 + np.cumsum(v) / rate, a_x=np.gradient(v, t))


def while_it_moves(recording: Recording, rate: float, seconds: float = 2.0) -> list[slice]:
    """Windows of the recording in which the axis changes its speed and covers some way."""
    length = int(seconds * rate)
    windows = [slice(i, i + length) for i in range(2 * length, len(recording) - 2 * length, length)]
    moving = [np.abs(recording["v_x"][w]).mean() > 2 and np.ptp(recording["v_x"][w]) > 5 for w in windows]
    return [w for w, moves in zip(windows, moving, strict=True) if moves]


@pytest.mark.parametrize("rate", [50.0, 100.0])
@pytest.mark.parametrize("column", ["pos_x", "v_x", "a_x"])
def test_a_frozen_signal_is_found_where_position_and_speed_are_half_a_sample_apart(column, rate):
    clean = summed(rate)
    assert input_faults(clean) == {}
    windows = while_it_moves(clean, rate)
    assert len(windows) > 5
    for window in windows:
        held = np.flatnonzero(clean[column][window] != clean[column][window.start])
        if len(held) == 0 or held[-1] < rate:
            continue  # it hardly changed, or the value that it has is right
        found = input_faults(put(clean, column, window, clean[column][window.start]))
        assert set(found) == {column}
        assert {f.reason for f in found[column]} == {"frozen while the axis moves"}


def test_a_speed_that_is_half_again_too_large_for_a_while_is_found_beside_a_position_half_a_sample_apart():
    clean = summed(50.0)
    for window in while_it_moves(clean, 50.0):
        found = input_faults(put(clean, "v_x", window, 0.5 * clean["v_x"][window]))
        assert set(found) <= {"v_x", "a_x"}
        marked = in_rows(clean, found["v_x"])
        wrong = np.zeros(len(clean), bool)
        wrong[window] = np.abs(clean["v_x"][window]) > 4
        assert marked[wrong].mean() > 0.5
        assert not marked[: window.start - 2].any()
        assert not marked[window.stop + 2 :].any()


@pytest.mark.parametrize("seconds", [0.1, 0.2, 2.0])
def test_what_comes_after_a_position_that_hung_and_caught_up_is_right(seconds):
    clean = axis_in_motion(50.0, seed=2, noise=0.0)
    fast = int(np.flatnonzero(np.abs(clean["v_x"]) > 29)[40])
    window = slice(fast, fast + int(seconds * 50))
    broken = put(clean, "pos_x", window, clean["pos_x"][fast])
    assert {f.reason for f in input_faults(broken)["pos_x"]} == {"frozen while the axis moves"}
    assert not displaced(broken, "x")[window.stop :].any()
    assert faulty(broken, "x")[window].all()


def test_a_counter_that_resets_is_no_position_that_catches_up():
    clean = summed(50.0)
    fast = int(np.flatnonzero(np.abs(clean["v_x"]) > 29)[40])
    hung = put(clean, "pos_x", slice(fast, fast + 10), clean["pos_x"][fast])
    reset = put(hung, "pos_x", slice(fast + 10, None), np.full(len(clean) - fast - 10, 40.0))
    assert displaced(reset, "x")[fast + 11 :].all()


def test_what_is_done_with_faulty_rows_is_said_as_it_is_done():
    clean = axis_in_motion(50.0, seed=2).with_columns(curr_x=np.ones(2000))
    reset = put(clean, "pos_x", slice(1000, None), np.full(1000, 800.0))
    spiked = put(clean, "v_x", slice(1000, 1002), 90.0)
    lost, wrong = (input_findings([r], ["x"])[0].where.summary for r in (reset, spiked))
    assert lost.endswith("; rows of a displaced position are used without it, all others are set aside")
    assert wrong.endswith("; these rows are set aside")
    assert faulty(reset, "x").sum() < 5


@pytest.mark.parametrize(("v", "size"), [(0.0, 40.0), (0.0, -5.0), (0.0, 1.0), (30.0, 40.0), (30.0, -5.0)])
def test_a_counter_that_resets_beside_a_commanded_speed_is_the_fault_of_the_position(v, size):
    clean = axis_in_motion(50.0, seed=2, noise=0.0)
    same = np.flatnonzero(np.abs(clean["v_x"] - v) < 1e-9)
    i = int(same[len(same) // 2])
    found = input_faults(put(clean, "pos_x", slice(i, len(clean)), np.full(len(clean) - i, size)))
    assert set(found) == {"pos_x"}
    assert min(f.t_start for f in found["pos_x"]) == pytest.approx(clean.time[i], abs=0.05)


def in_rows(recording, found):
    """(n,) – samples within intervals of a column."""
    at = [(recording.time >= f.t_start) & (recording.time <= f.t_end) for f in found]
    return np.any(at, axis=0)


@pytest.mark.parametrize("by", [-45.0, 60.0])
def test_a_speed_in_a_slow_record_that_no_step_of_the_position_comes_near_is_wrong(by):
    """At 20 Hz, in an axis that moves for a tenth of the time, so that its hard motion is faulty in good part."""
    rate = 20.0
    t = np.arange(0.0, 120.0, 0.0005)
    v = 30.0 * np.sin(2 * np.pi * t / 0.6) ** 2 * np.sign(np.sin(2 * np.pi * t / 1.2)) * (np.mod(t, 12.0) < 1.2)
    pick = slice(None, None, int(2000 / rate))
    columns = {"pos_z": np.round(50 + np.cumsum(v) * 0.0005, 3), "v_z": v, "a_z": np.gradient(v, t)}
    true = Recording(PartInfo(part="p", machine="m"), {"time": t[pick], **{k: c[pick] for k, c in columns.items()}})
    assert input_faults(true) == {}
    wrong = np.zeros(len(true), bool)
    for k in range(9):
        wrong[round((12.0 * (k + 1) + 0.3 * k) * rate) + np.arange(5)] = True
    found = input_faults(true.with_columns(v_z=true["v_z"] + by * wrong))
    assert "pos_z" not in found
    marked = in_rows(true, found["v_z"])
    assert np.mean(marked[wrong]) > 0.8
    assert np.sum(marked & ~wrong) < 0.1 * wrong.sum()


def test_a_slow_record_without_positions_for_a_while_or_an_acceleration_contradicts_nothing():
    true = axis_in_motion(20.0)
    gone = np.where((true.time > 10) & (true.time < 20), np.nan, true["pos_x"])
    assert input_faults(true.with_columns(pos_x=gone)) == {}
    assert input_faults(true.with_columns(a_x=np.full(len(true), np.nan))) == {}


def test_a_position_that_stands_beside_a_wrong_speed_is_not_frozen():
    true = axis_in_motion(200.0, noise=0.0)
    standing = np.flatnonzero(true["v_x"] == 0)
    i = int(standing[np.searchsorted(standing, standing[0] + 40)])
    spiked = put(true, "v_x", slice(i - 60, i + 4), 40.0)
    found = input_faults(spiked)
    assert "pos_x" not in found
    marked = in_rows(spiked, found["v_x"])
    assert marked[i - 60 : i + 4].all()


def test_slow_motion_that_a_frozen_speed_missed_is_found_beside_rapids():
    """Rapids make any single step of it look usual; the stretch loses more than any other of its length does."""
    t = np.arange(0.0, 100.0, 0.001)
    rapid = 400.0 * np.sin(2 * np.pi * np.mod(t, 10.0)) ** 3 * (np.mod(t, 10.0) < 1.0)
    v = 5.0 * np.sin(2 * np.pi * t / 4.0) + rapid
    pos = np.cumsum(v) * 0.001 + 5e-5 * np.gradient(v, t)  # the position is read later than the speed
    rng = np.random.default_rng(0)
    columns = {
        "time": t[::20],
        "pos_x": pos[::20] + rng.normal(0, 2e-4, len(t[::20])),
        "v_x": v[::20],
        "a_x": np.gradient(v, t)[::20],
    }
    clean = Recording(PartInfo(part="p", machine="m"), columns)
    assert input_faults(clean) == {}
    i, j = 2220, 2290  # from 44.4 to 45.8 s, through a reversal
    (fault,) = input_faults(put(clean, "v_x", slice(i, j), clean["v_x"][i]))["v_x"]
    assert "frozen" in fault.reason
    assert (fault.t_start, fault.t_end) == pytest.approx((clean.time[i], clean.time[j - 1]), abs=0.05)


@pytest.mark.parametrize("rate", [50.0, 500.0])
def test_a_speed_that_follows_from_a_wrong_position_is_told_by_the_acceleration(rate):
    clean = axis_in_motion(rate, seed=2)
    i = moving(clean, rate)
    leap = np.zeros(len(clean))
    leap[i : i + 4] = 12.0
    broken = clean.with_columns(pos_x=clean["pos_x"] + leap, v_x=clean["v_x"] + np.gradient(leap, clean.time))
    found = input_faults(broken)
    assert {f.t_start for f in found["v_x"]} & set(clean.time[i - 2 : i + 3])
    assert faulty(broken, "x").sum() < 20


@pytest.mark.parametrize("beside", [80.0, 20.0])
def test_a_spike_of_a_wrong_position_during_quick_motion_is_told_by_what_no_drive_does(beside):
    """Rapids change the speed from sample to sample by `beside` mm/s: only twice what the axis does is too much."""
    t = np.arange(0.0, 60.0, 0.02)
    a = beside / 0.02 * np.where(np.mod(t, 3.0) < 0.2, np.sin(2 * np.pi * t / 0.2), 0.0)
    v = 5.0 + np.cumsum(a) * 0.02
    pos = np.cumsum(v) * 0.02
    off = np.zeros(len(t))
    off[1500:1504] = 3.0  # mm, for four samples while the axis is fed
    wrong_v = v + np.gradient(off, 0.02)
    columns = {"time": t, "pos_x": pos + off, "v_x": wrong_v, "a_x": np.gradient(v, 0.02)}
    found = input_faults(Recording(PartInfo(part="p", machine="m"), columns))
    assert ("v_x" in found) == (beside == 20.0)


def test_a_position_stays_lost_after_a_jump_but_its_differences_may_be_used():
    clean = axis_in_motion(100.0, seed=2)
    broken = put(clean, "pos_x", slice(2500, None), np.full(len(clean) - 2500, 800.0))
    assert displaced(broken, "x")[2501:].all()
    assert not displaced(broken, "x")[:2499].any()
    assert faulty(broken, "x").sum() < 5


def test_a_spindle_cannot_turn_back_for_a_moment():
    clean = axis_in_motion(100.0)
    found = input_faults(put(clean, "v_sp", slice(1000, 1004), -5000.0))
    assert [f.t_start for f in found["v_sp"]] == [pytest.approx(10.0)]


@pytest.mark.parametrize(("low", "high"), [(-1.5, 1.5), (-np.inf, 2.0), (-1.0, np.inf), (-1.2, 2.2)])
def test_limits_of_a_current_are_read_exactly_on_each_side_that_has_one(low, high):
    clean = axis_in_motion(100.0)
    rng = np.random.default_rng(3)
    current = 3 * np.sin(1.3 * clean.time) + rng.normal(0, 0.1, len(clean))
    assert clipping(clean.with_columns(curr_x=current), "x") is None
    assert clipping(clean.with_columns(curr_x=np.clip(current, low, high)), "x") == (low, high)


def test_a_limit_whose_last_digits_differ_is_the_limit_of_all_samples_at_it():
    clean = axis_in_motion(100.0)
    rng = np.random.default_rng(3)
    current = np.minimum(3 * np.sin(1.3 * clean.time), 2.0)
    recorded = clean.with_columns(curr_x=current * (1 + 1e-13 * rng.normal(size=len(clean))))
    found = clipping(recorded, "x")
    assert found is not None
    assert np.sum(recorded["curr_x"] >= found[1]) == np.sum(current == 2.0)


@pytest.mark.parametrize("limit", [np.inf, 1.7])
def test_a_coarse_converter_that_repeats_its_largest_value_is_no_limit(limit):
    clean = axis_in_motion(100.0)
    sim = np.clip(3 * np.sin(1.3 * clean.time), -1.985, 1.985)
    step = 0.045  # 1.98 is the next value to 2
    current = np.round((np.minimum(sim, limit) + np.random.default_rng(3).normal(0, 0.003, len(sim))) / step) * step
    recorded = clean.with_columns(curr_x=current, curr_x_sim=sim)
    assert clipping(recorded, "x") is not None
    assert bool(clipped([recorded], "x")) == np.isfinite(limit)


def test_an_air_cut_of_a_real_machine_has_faults_in_the_spindle_only(real_data):
    recording = read_recording(real_data / "kit_dmc60h" / "S235JR_part2_aircut_1.csv")
    found = input_faults(recording)
    assert set(found) <= {"v_sp", "a_sp"}
    spikes = np.abs(recording["v_sp"]) > 1e6
    assert 0 < spikes.sum() <= 24
    marked = np.zeros(len(recording), bool)
    for f in found["v_sp"]:
        marked |= (recording.time >= f.t_start) & (recording.time <= f.t_end)
    assert marked[spikes].all()
    assert marked.sum() < 45


@pytest.mark.parametrize(
    "name", ["emps/DATA_EMPS.mat", *(f"umich_smart_mill/experiment_{k}.csv" for k in ("01", "06", "11", "14"))]
)
def test_real_recordings_without_faults_have_none(real_data, name):
    assert input_faults(read_recording(real_data / name)) == {}


def test_a_note_on_an_extreme_load_says_which_where_and_what_it_may_be():
    made = axis_in_motion(50.0)
    n = len(made)
    rng = np.random.default_rng(3)
    force, line = rng.uniform(50.0, 100.0, n), np.repeat(np.arange(10, 10 + n // 100 + 1), 100)[:n]
    force[700:705] = 2000.0
    columns = {"f_z_sim": force, "f_x_sim": rng.uniform(1.0, 2.0, n), "nc_line": line, "curr_x": rng.normal(0, 1, n)}
    notes: list[str] = []
    comparable_axes([made.with_columns(**columns)], None, notes)
    (note,) = [each for each in notes if "extreme" in each]
    for said in ("part p:", "5 samples", "14.00 to 14.08 s", "NC block 17", "f_z_sim reaches 2000 N", "20 times"):
        assert said in note
    assert "f_x_sim" not in note
    assert "plunges" in note
    assert "rapid" in note


def hanging(noise: float, seed: int = 0) -> tuple[Recording, list[slice]]:
    """An encoder that is noisy at rest hangs twice while its axis moves, and comes back elsewhere."""
    clean = axis_in_motion(100.0, seed, noise)
    rows = [slice(rows.start, rows.start + 60) for rows in while_it_moves(clean, 100.0)[:2]]
    columns = {name: np.array(values, float) for name, values in clean.columns.items()}
    for some in rows:
        columns["pos_x"][some], columns["v_x"][some], columns["a_x"][some] = columns["pos_x"][some.start], 0.0, 0.0
    return Recording(clean.part, columns), rows


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_an_encoder_that_hangs_is_found_where_it_hangs_and_is_right_afterwards(seed):
    """Its signals belong together, as those of an axis at rest do; only that one is noisy here."""
    broken, rows = hanging(0.01, seed)
    found = input_faults(broken)
    for column in ("pos_x", "v_x", "a_x"):
        assert [f.reason for f in found[column]] == [HUNG, HUNG]
        for fault, some in zip(found[column], rows, strict=True):
            assert fault.t_start == pytest.approx(broken.time[some.start], abs=0.02)
            assert fault.t_end == pytest.approx(broken.time[some.stop - 1], abs=0.02)
    assert set(np.flatnonzero(faulty(broken, "x"))) == set(np.concatenate([np.arange(s.start, s.stop) for s in rows]))


def test_where_every_standstill_is_without_noise_none_is_an_encoder_that_hangs():
    """A counter that is set anew while its axis stands leaves the same behind."""
    broken, _ = hanging(0.0)
    assert HUNG not in {f.reason for faults in input_faults(broken).values() for f in faults}
