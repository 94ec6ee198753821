"""One servo axis and the spindle against closed forms."""

import numpy as np
import pytest

from pido.core.errors import SettingsError
from pido.synthetic.drive import CYCLE_S, Drive, run_axis
from pido.synthetic.spindle import Spindle, run_spindle

TIME = np.arange(0.0, 6.0, CYCLE_S)
ZERO = np.zeros(len(TIME))


def smooth_move(distance, start, duration):
    """Position, speed, acceleration of a rest-to-rest move (fifth-order polynomial)."""
    u = np.clip((TIME - start) / duration, 0, 1)
    pos = distance * u**3 * (10 - 15 * u + 6 * u**2)
    v = distance / duration * 30 * u**2 * (1 - u) ** 2
    a = distance / duration**2 * 60 * u * (1 - u) * (1 - 2 * u)
    return pos, v, a


def forward_at(speed):
    """Constant speed after a smooth start of 1 s."""
    u = np.clip(TIME / 1.0, 0, 1)
    v = speed * (3 * u**2 - 2 * u**3)
    a = speed * 6 * u * (1 - u)
    return np.cumsum(v) * CYCLE_S, v, a


def test_an_axis_at_rest_holds_its_weight_and_does_not_move():
    drive = Drive(gravity_n=2250.0, force_per_ampere=450.0, lost_motion_mm=0.01)
    out = run_axis(drive, ZERO, ZERO, ZERO, ZERO, ZERO)
    np.testing.assert_allclose(out.current, 5.0, atol=1e-9)
    np.testing.assert_allclose(out.pos, 0.0, atol=1e-9)


def test_an_axis_without_load_draws_no_current_at_rest():
    out = run_axis(Drive(), ZERO, ZERO, ZERO, ZERO, ZERO)
    assert np.abs(out.current).max() == 0.0


@pytest.mark.parametrize("speed", [10.0, 60.0, -60.0])
def test_steady_motion_needs_coulomb_and_viscous_friction_and_the_load(speed):
    drive = Drive(coulomb_n=180.0, viscous=1.5, stribeck_mm_s=0.5, force_per_ampere=400.0, asymmetry=0.1)
    out = run_axis(drive, *forward_at(speed), ZERO + 50.0, ZERO)
    expected = (180.0 * (1 + 0.1 * np.sign(speed)) * np.sign(speed) + 1.5 * speed + 50.0) / 400.0
    assert out.current[-1] == pytest.approx(expected, rel=1e-4)


def test_below_breakaway_friction_is_a_spring_and_above_it_a_constant():
    # Bristle: dF/dx = sigma (1 - F/g), so F = g (1 - exp(-sigma x / g)); the encoder is on the motor.
    drive = Drive(coulomb_n=200.0, stribeck_n=0.0, viscous=0.0, bristle_n_mm=2e4, force_per_ampere=400.0)
    for way in (1e-3, 5e-3, 1.0):
        out = run_axis(drive, *smooth_move(way, 0.5, 4.0), ZERO, ZERO)
        force = out.current[-1] * 400.0
        table = out.pos[-1] - force / drive.screw_n_mm
        assert force == pytest.approx(200.0 * (1 - np.exp(-2e4 * table / 200.0)), rel=2e-3)


def test_the_sign_of_the_last_motion_is_held_unless_friction_creeps_away():
    move = smooth_move(-20.0, 0.5, 2.0)
    held = run_axis(Drive(), *move, ZERO, ZERO).current[-1]
    creeping = run_axis(Drive(hold=0.0), *move, ZERO, ZERO).current[-1]
    assert held < -0.2
    assert abs(creeping) < 1e-3


def test_inertia_current_is_mass_times_acceleration():
    drive = Drive(coulomb_n=0.0, stribeck_n=0.0, viscous=0.0, motor_kg=600, table_kg=400, force_per_ampere=500.0)
    pos, v, a = smooth_move(40.0, 0.5, 2.0)
    out = run_axis(drive, pos, v, a, ZERO, ZERO)
    assert np.abs(out.current - 1.0 * a / 500.0).max() < 0.02 * np.abs(a / 500.0).max()


def test_motor_work_over_a_forth_and_back_is_what_friction_took():
    drive = Drive(coulomb_n=200.0, stribeck_n=0.0, viscous=0.0, bristle_n_mm=1e5, force_per_ampere=400.0)
    forth, back = smooth_move(20.0, 0.2, 2.0), smooth_move(20.0, 3.0, 2.0)
    out = run_axis(drive, *(f - b for f, b in zip(forth, back, strict=True)), ZERO, ZERO)
    work = np.trapezoid(out.current * 400.0 * out.v, TIME)
    assert work == pytest.approx(200.0 * 40.0, rel=0.01)


def test_the_current_never_exceeds_the_drives_limit():
    drive = Drive(current_max_a=3.0)
    out = run_axis(drive, *smooth_move(200.0, 0.5, 0.4), ZERO, ZERO)
    assert np.abs(out.current).max() <= 3.0
    assert np.abs(out.current).max() > 2.9


def test_beyond_the_knee_the_same_torque_needs_more_current():
    drive = Drive(gravity_n=2000.0, force_per_ampere=400.0, knee_a=2.0, bend=0.1)
    assert run_axis(drive, ZERO, ZERO, ZERO, ZERO, ZERO).current[-1] == pytest.approx(5.0 + 0.1 * 3.0**2, rel=1e-6)


def test_ripple_has_the_period_of_the_screw():
    drive = Drive(coulomb_n=0.0, stribeck_n=0.0, viscous=0.0, ripple_n=40.0, ripple_mm=10.0, force_per_ampere=400.0)
    out = run_axis(drive, *forward_at(20.0), ZERO, ZERO)
    rows = TIME > 2.0
    np.testing.assert_allclose(out.current[rows], 0.1 * np.sin(2 * np.pi * out.pos[rows] / 10.0), atol=0.005)


def test_play_is_crossed_without_the_tables_friction():
    drive = Drive(lost_motion_mm=0.2, coulomb_n=300.0, force_per_ampere=400.0)
    forth, back = smooth_move(20.0, 0.2, 2.0), smooth_move(20.0, 3.0, 2.5)
    out = run_axis(drive, *(f - b for f, b in zip(forth, back, strict=True)), ZERO, ZERO)
    way_back = 20.0 - out.pos
    crossing = (TIME > 3.0) & (way_back > 0.05) & (way_back < 0.15)
    after = (TIME > 3.0) & (way_back > 2.0) & (way_back < 10.0)
    assert np.abs(out.current[crossing]).min() < 0.3 * np.abs(out.current[after]).mean()


def test_the_spindle_at_speed_draws_drag_windage_and_the_cut():
    s = Spindle(coulomb_nm=0.4, viscous=5e-4, windage=7e-7, torque_per_ampere=1.1)
    w = np.radians(18000.0)
    out = run_spindle(s, ZERO + 18000.0, ZERO + 2.0)
    assert out.current[-1] == pytest.approx((0.4 + 5e-4 * w + 7e-7 * w**2 + 2.0) / 1.1, rel=1e-6)


@pytest.mark.parametrize("fault", [{"table_kg": 0.0}, {"coulomb_n": -1.0}, {"soft_share": 2.0}, {"screw_n_mm": 1e9}])
def test_an_impossible_drive_is_refused_by_name(fault):
    with pytest.raises(SettingsError, match=r"axis x"):
        Drive(**fault).check("x")
