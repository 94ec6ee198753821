"""Against sines, whose derivatives and attenuation are known in closed form."""

import numpy as np
import pytest

from pido.core.errors import RecordingError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings.derive import with_motion
from pido.recordings.resample import resample, to_50_hz

PART = PartInfo(part="p", machine="m")


def _recording(t, **columns):
    return Recording(PART, {"time": t, **columns})


@pytest.mark.parametrize("f", [0.5, 2.0, 5.0])
def test_derived_speed_and_acceleration_have_the_stated_attenuation_and_no_phase(f):
    T, w = 0.02, 2 * np.pi * f
    t = np.arange(1000) * T
    recording = with_motion(_recording(t, pos_x=np.sin(w * t)))
    inner = slice(1, -1)
    np.testing.assert_allclose(recording["v_x"][inner], (np.sin(w * T) / T * np.cos(w * t))[inner], atol=1e-9)
    expected = -((2 / T * np.sin(w * T / 2)) ** 2) * np.sin(w * t)
    np.testing.assert_allclose(recording["a_x"][inner], expected[inner], atol=1e-7)


def test_recorded_speeds_are_kept():
    t = np.arange(100) / 50
    recording = with_motion(_recording(t, pos_x=t, v_x=np.full(100, 7.0)))
    assert (recording["v_x"] == 7.0).all()
    np.testing.assert_allclose(recording["a_x"], 0.0, atol=1e-9)


def test_nothing_is_derived_across_a_gap_or_a_missing_value():
    t = np.r_[np.arange(50), 200 + np.arange(50)] / 50.0
    p = np.r_[np.zeros(50), np.full(50, 1000.0)]
    p[20] = np.nan
    recording = with_motion(_recording(t, pos_x=p))
    assert np.flatnonzero(np.isnan(recording["v_x"])).tolist() == [20]
    known = np.isfinite(recording["v_x"])
    np.testing.assert_allclose(recording["v_x"][known], 0.0, atol=1e-8)
    np.testing.assert_allclose(recording["a_x"][known], 0.0, atol=1e-6)


@pytest.mark.parametrize("kind", ["angle", "counter"])
def test_spindle_speed_is_right_where_its_position_starts_again(kind):
    t = np.arange(2000) / 500
    turned = 3600.0 * t
    position = turned % 360 if kind == "angle" else np.where(t < 2, turned + 1e6, turned)
    np.testing.assert_allclose(with_motion(_recording(t, pos_sp=position))["v_sp"], 3600.0, rtol=1e-6)


@pytest.mark.parametrize(
    ("rate", "rpm", "fastest"),
    [
        (50.0, 3000.0, None),  # one turn per sample: the angle stands still
        (50.0, 1600.0, None),
        (50.0, 100.0, None),  # true, but 3100 1/min look the same
        (500.0, 6000.0, 144_000.0),  # a machine of 24 000 1/min
        (500.0, 18_000.0, None),  # the run-up goes through half a turn per sample
    ],
)
def test_no_speed_is_derived_from_an_angle_whose_turns_between_samples_are_not_known(rate, rpm, fastest):
    t = np.arange(int(8 * rate)) / rate
    turned = 6 * rpm * np.where(t < 2, t**2 / 4, t - 1)  # up in two seconds
    recording = _recording(t, pos_sp=turned % 360, pos_x=t)
    found = with_motion(recording, fastest)
    assert {"v_x", "a_x"} <= found.columns.keys()
    assert not {"v_sp", "a_sp"} & found.columns.keys()
    assert [n for n in found.notes if n.startswith("v_sp and a_sp are not derived: pos_sp is an angle")]
    recorded = with_motion(recording.with_columns(v_sp=np.full(len(t), 6 * rpm)), fastest)
    np.testing.assert_allclose(recorded["a_sp"], 0.0, atol=1e-6)  # a speed that was recorded needs no turns


def test_the_slowest_machine_makes_its_turns_known_at_any_rate():
    t = np.arange(2000) / 50
    found = with_motion(_recording(t, pos_sp=(3600.0 * t) % 360), spindle_max_deg_s=8000.0)
    np.testing.assert_allclose(found["v_sp"], 3600.0, rtol=1e-6)


def test_an_angle_whose_turns_are_not_known_is_resampled_to_what_it_was_at_the_nearest_sample():
    t = np.arange(1000) / 100
    angle = (10_000.0 * t) % 360
    low = to_50_hz(_recording(t, pos_sp=angle, v_sp=np.full(1000, 10_000.0)))
    np.testing.assert_allclose(low["pos_sp"], angle[::2])


@pytest.mark.parametrize(("source", "target"), [(500.0, 50.0), (1000.0, 50.0), (500.0, 60.0), (130.0, 50.0)])
def test_resampling_keeps_slow_signals_in_phase_and_removes_fast_ones(source, target):
    t = np.arange(int(8 * source)) / source
    slow, fast = 0.1 * target, 0.8 * target
    recording = _recording(t, curr_x=np.sin(2 * np.pi * slow * t), curr_y=np.sin(2 * np.pi * fast * t))
    low = resample(recording, target)
    assert low.sample_rate_hz == pytest.approx(target)
    inner = (low.time > 1) & (low.time < 7)
    # Between the samples of the source the filtered signal is read off linearly: (w T)^2 / 8 at most.
    bound = 2e-3 + (2 * np.pi * slow / source) ** 2 / 8
    np.testing.assert_allclose(low["curr_x"][inner], np.sin(2 * np.pi * slow * low.time[inner]), atol=bound)
    assert np.abs(low["curr_y"][inner]).max() < 5e-3


def test_a_gap_and_missing_values_survive_resampling():
    t = np.r_[np.arange(1000), 5000 + np.arange(1000)] / 500.0
    current = np.r_[np.zeros(1000), np.ones(1000)]
    current[300:400] = np.nan
    low = to_50_hz(_recording(t, curr_x=current, nc_line=np.r_[np.full(1000, 3.0), np.full(1000, 8.0)]))
    assert not ((low.time > 2.02) & (low.time < 9.98)).any()
    np.testing.assert_allclose(low["curr_x"][low.time < 0.55], 0.0, atol=1e-12)
    np.testing.assert_allclose(low["curr_x"][low.time > 5], 1.0, atol=1e-12)
    assert np.isnan(low["curr_x"][(low.time > 0.6) & (low.time < 0.79)]).all()
    assert set(low["nc_line"]) == {3.0, 8.0}


def test_a_rate_above_the_recordings_is_refused():
    with pytest.raises(RecordingError, match="never"):
        resample(_recording(np.arange(100) / 10.0, curr_x=np.zeros(100)), 50.0)
