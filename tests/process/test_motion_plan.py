"""Motion from a toolpath: limits, way, stops, lag, in closed form."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pido.config import machine
from pido.core.errors import ProgramError, SettingsError
from pido.core.part import PartInfo
from pido.nc import interpret
from pido.process.motion import Dynamics, plan_motion

MILL = machine("cmx600v")
A, J = 5000.0, 50000.0
IDEAL = Dynamics()


def path(*lines):
    return interpret("\n".join(("G0 X0 Y0 Z0", *lines)), start=(0, 0, 0))


def test_a_line_from_rest_to_rest_takes_the_time_of_the_s_curve():
    # 100 mm at 100 mm/s with j = 50000: v < a²/j, so each ramp is a triangle of acceleration, 2 sqrt(v/j) long.
    motion = plan_motion(path("G1 X100 F6000"), MILL, 1000.0)
    expected = 100 / 100 + 2 * math.sqrt(100 / J)
    assert motion.block_end[-1] == pytest.approx(expected, abs=1e-4)
    assert np.abs(motion.a[:, 0]).max() == pytest.approx(math.sqrt(100 * J), rel=0.02)


def test_a_rapid_reaches_the_axis_speed_and_takes_v_over_a_plus_a_over_j_more_than_length_over_speed():
    motion = plan_motion(path("G0 X500"), MILL, 1000.0)
    assert motion.block_end[-1] == pytest.approx(500 / 500 + 500 / A + A / J, abs=1e-4)
    assert motion.v[:, 0].max() == pytest.approx(500.0, rel=1e-6)
    assert np.abs(motion.a[:, 0]).max() == pytest.approx(A, rel=1e-6)


@given(seed=st.integers(0, 2**32 - 1), smooth=st.booleans())
@settings(max_examples=30, deadline=None)
def test_no_axis_ever_exceeds_its_limits_and_the_path_is_completed(seed, smooth):
    rng = np.random.default_rng(seed)
    lines = ["G64" if smooth else "G60"]
    for x, y, z, f in rng.uniform([0, 0, -20, 200], [200, 200, 0, 20000], (12, 4)):
        lines.append(f"{'G0' if rng.random() < 0.3 else 'G1'} X{x:.3f} Y{y:.3f} Z{z:.3f} F{f:.0f}")
    toolpath = path(*lines)
    motion = plan_motion(toolpath, MILL, 500.0)
    assert np.abs(motion.v_sp).max() <= 500 * (1 + 1e-9)
    assert np.abs(motion.a_sp).max() <= A * (2.0 if smooth else 1 + 1e-6)  # in a rounded corner both limits may add up
    np.testing.assert_allclose(np.abs(motion.pos_sp[-1] - toolpath.end[-1]).max(), 0, atol=2.0)
    assert np.all(np.diff(motion.block_end) > 0)
    if not smooth:
        jerk = np.diff(motion.a_sp, axis=0) * 500.0
        assert np.abs(jerk).max() <= J * (1 + 1e-6)


def test_speed_is_the_derivative_of_position_and_acceleration_that_of_speed():
    motion = plan_motion(
        path("G1 X30 F3000", "G2 X50 Y20 I0 J20", "G1 Y40", "G0 Z30"), MILL, 2000.0, Dynamics(kv_per_s=40)
    )
    for pos, v, a in ((motion.pos_sp, motion.v_sp, motion.a_sp), (motion.pos[:, :3], motion.v[:, :3], motion.a[:, :3])):
        np.testing.assert_allclose(np.gradient(pos, motion.time, axis=0)[1:-1], v[1:-1], atol=0.6)
        rms = np.sqrt(np.mean((np.gradient(v, motion.time, axis=0) - a) ** 2))
        assert rms < 0.02 * np.abs(a).max()


def test_on_a_circle_speed_is_the_feed_and_acceleration_points_to_its_centre():
    motion = plan_motion(path("G2 X0 Y0 I20 J0 F6000"), MILL, 500.0)
    middle = slice(len(motion) // 4, len(motion) // 2)
    np.testing.assert_allclose(np.linalg.norm(motion.v[middle, :3], axis=1), 100.0, rtol=1e-3)
    towards = np.array([20.0, 0.0]) - motion.pos[middle, :2]
    np.testing.assert_allclose(motion.a[middle, :2], 100.0**2 / 20.0**2 * towards, atol=0.02 * 500)


def test_a_small_circle_is_run_no_faster_than_its_centripetal_acceleration_allows():
    motion = plan_motion(path("G64", "G2 X0 Y0 I0.5 J0 F20000"), MILL, 2000.0)
    assert np.linalg.norm(motion.v_sp[:, :2], axis=1).max() <= math.sqrt(A * 0.5) * 1.001


def test_exact_stop_rests_at_the_corner_and_smoothing_passes_it():
    corner = ("G1 X20 F1200", "Y20")
    stopping, passing = (plan_motion(path(mode, *corner), MILL, 1000.0) for mode in ("G60", "G64"))

    def slowest(motion):
        speed = np.linalg.norm(motion.v_sp, axis=1)
        return speed[(motion.time > 0.5) & (motion.time < motion.time[-1] - 0.5)].min()

    assert slowest(stopping) < 0.6
    assert slowest(passing) > 5.0
    assert passing.block_end[-1] < stopping.block_end[-1]


def test_g641_begins_to_round_at_the_given_distance_and_stays_within_it():
    motion = plan_motion(path("G641 ADIS=2", "G1 X20 F1200", "Y20"), MILL, 1000.0)
    gap = np.linalg.norm(motion.pos_sp - [20, 0, 0], axis=1).min()
    assert gap == pytest.approx(2 / 2 / math.sqrt(2), abs=0.02)  # the parabola's apex: half way to the corner


def test_collinear_blocks_under_g64_are_one_move():
    one = plan_motion(path("G64", "G1 X100 F6000"), MILL, 1000.0)
    many = plan_motion(path("G64", "G1 F6000", *(f"X{x}" for x in range(1, 101))), MILL, 1000.0)
    assert many.block_end[-1] == pytest.approx(one.block_end[-1], abs=1e-6)
    assert np.unique(many.nc_line).size == 100


def test_a_dwell_and_a_change_of_speed_hold_the_axes():
    plain = plan_motion(path("G1 X10 F1200", "X20"), MILL, 100.0).block_end[-1]
    waiting = plan_motion(path("G1 X10 F1200", "G4 F3", "X20"), MILL, 100.0).block_end[-1]
    assert waiting - plain == pytest.approx(3.0, abs=1e-3)


def test_feed_waits_for_the_spindle_and_its_angle_is_the_integral_of_its_speed():
    motion = plan_motion(path("G1 X10 F1200 S6000 M3"), MILL, 1000.0, replace(IDEAL, spindle_tolerance=0.0))
    run_up = 36000.0 / MILL.spindle_acc_deg_s2
    moved = motion.time[np.flatnonzero(motion.v[:, 0] > 1e-6)[0]]
    assert moved == pytest.approx(run_up, abs=0.02)
    assert motion.v[-1, 3] == pytest.approx(36000.0)
    np.testing.assert_allclose(
        np.diff(motion.pos[:, 3]) * 1000, (motion.v[1:, 3] + motion.v[:-1, 3]) / 2, rtol=1e-6, atol=1e-6
    )


def test_the_servo_lag_at_constant_speed_is_speed_over_kv():
    motion = plan_motion(path("G1 X100 F3000"), MILL, 50.0, Dynamics(kv_per_s=25.0))
    middle = len(motion) // 2
    assert motion.pos_sp[middle, 0] - motion.pos[middle, 0] == pytest.approx(50.0 / 25.0, rel=1e-6)


def test_after_an_exact_stop_the_next_block_waits_until_the_lag_is_inside_the_window():
    dynamics = Dynamics(kv_per_s=30.0, stop_window_mm=0.01)
    motion = plan_motion(path("G1 X50 F3000", "Y50"), MILL, 2000.0, dynamics)
    leaves = np.flatnonzero(motion.pos_sp[:, 1] > 0)[0]
    assert 50.0 - motion.pos[leaves, 0] == pytest.approx(0.01, rel=0.15)


def test_each_block_costs_the_overhead_once():
    blocks = [f"X{x}" for x in range(10, 60, 10)]
    ends = [
        plan_motion(path("G1 F1200", *blocks), MILL, 50.0, Dynamics(block_overhead_s=t)).block_end[-1] for t in (0, 0.1)
    ]
    assert ends[1] - ends[0] == pytest.approx(0.4, abs=1e-6)  # four borders


def test_a_motion_is_a_recording_with_block_tool_and_coolant():
    recording = plan_motion(path("M8", "G1 X10 F600"), MILL).recording(PartInfo(part="p", machine="cmx600v"))
    assert recording.sample_rate_hz == pytest.approx(50.0)
    assert set(np.unique(recording["nc_line"])) == {3.0}
    assert recording["coolant"].all()
    assert "v_sp" in recording


def test_an_impossible_machine_and_an_empty_program_are_refused():
    lame = replace(MILL, axes={**MILL.axes, "x": replace(MILL.axes["x"], a_max=0.0, v_max=-1.0)})
    with pytest.raises(SettingsError, match=r"x\.v_max = -1, x\.a_max = 0"):
        plan_motion(path("G1 X1 F100"), lame)
    with pytest.raises(ProgramError, match="moves nothing"):
        plan_motion(interpret("M30\n"), MILL)
    with pytest.raises(SettingsError, match="kv_per_s"):
        Dynamics(kv_per_s=-1.0)


def test_a_hundred_thousand_samples_are_planned_in_about_a_second():
    rng = np.random.default_rng(3)
    points = np.cumsum(rng.normal(0, 0.5, (40_000, 2)), axis=0) % 300
    toolpath = path("G64", "G1 F6000", *(f"X{x:.3f} Y{y:.3f}" for x, y in points))
    plan_motion(toolpath.take(slice(0, 10)), MILL)
    begin = time.process_time()
    motion = plan_motion(toolpath, MILL, 50.0, Dynamics(kv_per_s=30.0))
    seconds = time.process_time() - begin
    assert len(motion) > 10_000
    assert seconds < 4.0 * max(1.0, len(motion) / 100_000)
