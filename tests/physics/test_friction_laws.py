"""Friction against limits and against step-by-step integration."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pido.physics.friction import dahl_state, held_direction, stribeck_curve


@pytest.mark.parametrize("delta", [0.5, 1.0, 2.0])
def test_the_stribeck_share_is_one_at_rest_one_over_e_at_v_s_and_gone_far_above(delta):
    share = stribeck_curve(np.array([0.0, 3.0, -3.0, 3e6]), v_s=3.0, delta=delta)
    np.testing.assert_allclose(share, [1.0, np.exp(-1), np.exp(-1), 0.0], atol=1e-12)


@given(v=st.lists(st.sampled_from([-5.0, -0.01, 0.0, 0.01, 5.0]), min_size=1, max_size=60))
def test_a_direction_is_held_until_the_next_real_motion_and_turns_with_the_axis(v):
    speed = np.array(v)
    held = held_direction(speed, dead_band=0.02)
    state, expected = 0.0, []
    for value in v:
        state = np.sign(value) if abs(value) > 0.02 else state
        expected.append(state)
    np.testing.assert_array_equal(held, expected)
    np.testing.assert_array_equal(held_direction(-speed, dead_band=0.02), -held)


def test_a_missing_speed_makes_the_direction_unknown():
    assert held_direction(np.array([3.0, np.nan, 0.0, -3.0]), dead_band=0.02).tolist() == [1.0, 0.0, 0.0, -1.0]


@pytest.mark.parametrize("way", [0.02, 0.1, 0.4, 3.0])
def test_dahl_friction_turns_as_its_differential_equation_says(way):
    """To and fro moves of one length: short ones never turn the friction fully."""
    x_0, steps, turns = 0.1, 4000, 7
    z, expected = 1.0, []
    for k in range(turns):
        h = 1.0 if k % 2 == 0 else -1.0
        for _ in range(steps):
            z += (h - z) / x_0 * way / steps
            expected.append(z)
    since = np.tile(np.arange(1, steps + 1) * way / steps, turns)
    since[:steps] = np.inf
    held = np.repeat([1.0 if k % 2 == 0 else -1.0 for k in range(turns)], steps)
    segment = np.repeat(np.arange(turns, dtype=float), steps)
    np.testing.assert_allclose(dahl_state(held, since, segment, x_0), expected, atol=3e-3)


def test_dahl_friction_becomes_coulomb_friction_as_its_way_vanishes():
    held = np.repeat([1.0, -1.0, 1.0], 50)
    since = np.tile(np.linspace(0.01, 0.5, 50), 3)
    segment = np.repeat([0.0, 1.0, 2.0], 50)
    np.testing.assert_allclose(dahl_state(held, since, segment, 1e-6), held)
