"""Lost motion, waves and what lies beyond a limit, against closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pido.physics.drive import Loop, answered_late, best_stretch, beyond, lost_motion, periods_of, wave


def test_lost_motion_fades_exponentially_and_its_edge_makes_it_a_rectangle():
    s = np.array([0.0, 0.3, 0.6, np.inf])
    np.testing.assert_allclose(lost_motion(s, 0.3), [1.0, np.exp(-1), np.exp(-2), 0.0])
    rectangle = lost_motion(np.array([0.0, 0.2, 0.29, 0.31, 0.4]), 0.3, edge=200.0)
    np.testing.assert_allclose(rectangle, [1.0, 1.0, 1.0, 0.0, 0.0], atol=2e-3)


@given(amplitude=st.floats(0.1, 10), phase=st.floats(-3, 3), period=st.floats(0.5, 50))
def test_two_amplitudes_make_a_wave_of_any_phase(amplitude, phase, period):
    pos = np.linspace(0, 100, 301)
    both = wave(pos, period) @ (amplitude * np.array([np.cos(phase), np.sin(phase)]))
    np.testing.assert_allclose(both, amplitude * np.sin(2 * np.pi * pos / period + phase), atol=1e-8)


@given(current=st.lists(st.floats(-50, 50), min_size=1), limit=st.floats(0, 40))
def test_a_limited_current_is_the_current_without_what_lies_beyond(current, limit):
    values = np.array(current)
    np.testing.assert_allclose(values - beyond(values, limit), np.clip(values, -limit, limit), atol=1e-12)


@pytest.mark.parametrize("period", [0.83, 3.175, 7.3, 16.0])
def test_the_period_of_a_ripple_is_found_in_noise_twice_its_size(period):
    rng = np.random.default_rng(5)
    pos = np.cumsum(rng.choice([-1, 1], 40)[np.arange(20_000) // 500] * 0.05) + 40
    value = np.sin(2 * np.pi * pos / period) + rng.normal(0, 2.0, len(pos))
    resolution = period**2 / np.ptp(pos)
    assert periods_of(pos, value, 0.4, 60.0, 1)[0] == pytest.approx(period, abs=0.6 * resolution)


def test_waiting_at_a_place_makes_no_period():
    """Half of the time the axis waits at one place with an offset: a periodogram over time would see nothing else."""
    travel = np.linspace(0, 50, 5000)
    pos = np.r_[travel, np.full(5000, 20.0)]
    value = np.r_[np.sin(2 * np.pi * travel / 5.0), np.full(5000, 3.0)]
    assert periods_of(pos, value, 0.4, 25.0, 1)[0] == pytest.approx(5.0, rel=0.05)


def test_a_tight_place_is_found_where_it_is():
    rng = np.random.default_rng(6)
    pos = rng.uniform(0, 120, 5000)
    value = 1.0 * ((pos > 30) & (pos < 46)) + rng.normal(0, 0.5, len(pos))
    np.testing.assert_allclose(best_stretch(pos, value, 0.0, 120.0), (30.0, 46.0), atol=4.0)
    assert best_stretch(pos, np.ones(len(pos)), 0.0, 120.0) is None


def test_a_late_answer_follows_a_ramp_by_its_time_constant_and_begins_at_rest_after_a_gap():
    time = np.r_[np.arange(0.0, 1.0, 0.01), np.arange(5.0, 6.0, 0.01)]
    ramp = np.array([2.0 * time, np.full(len(time), 7.0)])
    late = answered_late(ramp, time, 0.05)
    since = np.where(time < 2.0, time, time - 5.0)
    exact = ramp[0] - 2.0 * 0.05 * (1 - np.exp(-since / 0.05))
    np.testing.assert_allclose(late[0], exact, atol=1e-9)
    np.testing.assert_allclose(late[1], 7.0)


@pytest.mark.parametrize("lags", [1, 2, 3])
def test_a_ramp_is_as_late_behind_any_loop_as_its_lag_says(lags):
    time = np.arange(0.0, 2.0, 0.005)
    late = Loop(0.05, lags).answered(2.0 * time[None], time)[0]
    np.testing.assert_allclose(late[-100:], 2.0 * (time[-100:] - 0.05), atol=1e-6)


@pytest.mark.parametrize("lags", [1, 2, 3])
@pytest.mark.parametrize("tau", [0.004, 0.03])
def test_the_matrix_of_a_late_answer_is_the_late_answer_but_for_a_hundredth(tau, lags):
    time = np.r_[np.arange(0.0, 1.0, 0.01), np.arange(5.0, 6.0, 0.01)]
    values = np.random.default_rng(3).normal(size=(2, len(time)))
    values[:, [0, 100]] = 0.0
    late = Loop(tau, lags).answered(values, time)
    np.testing.assert_allclose(values @ Loop(tau, lags).matrix(time).T, late, atol=0.01 * np.abs(values).max())
