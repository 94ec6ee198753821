"""Where along the travel an effect acts, and at which rhythm, in words for an operator."""

import numpy as np
import pytest

from pido.diagnosis.finding import Interval
from pido.diagnosis.locate import rhythm, strongest_stretch
from pido.diagnosis.state import axis_states
from tests.diagnosis.planted import part


def places():
    states = axis_states([part(k) for k in range(3)], "x")
    return states, np.concatenate([np.asarray(s.pos, float) for s in states])


def test_a_rough_stretch_of_the_travel_is_told_from_end_to_end():
    states, pos = places()
    low, high = np.quantile(pos, [0.3, 0.5])
    effect = np.where((pos > low) & (pos < high), 0.3, 0.02) * np.sign(np.random.default_rng(0).normal(size=len(pos)))
    width = np.ptp(pos) / 40
    found = strongest_stretch(states, effect)
    assert found is not None
    np.testing.assert_allclose(found, (low, high), atol=width)


def test_no_stretch_is_told_where_there_are_two_or_it_is_most_of_the_travel():
    states, pos = places()
    ends = np.quantile(pos, [0.2, 0.3, 0.6, 0.7])
    two = ((pos > ends[0]) & (pos < ends[1])) | ((pos > ends[2]) & (pos < ends[3]))
    assert strongest_stretch(states, two * 0.3) is None
    assert strongest_stretch(states, np.full(len(pos), 0.3)) is None
    assert strongest_stretch(states, np.zeros(len(pos))) is None


def times(*starts_of_parts):
    return [Interval(f"p{k}", t, t + 8.0, 0.9) for k, starts in enumerate(starts_of_parts) for t in starts]


def test_a_force_that_comes_again_after_the_same_time_has_a_rhythm():
    pump = times((4.9, 45.0), (2.4, 42.4, 82.5), (23.1, 63.0), (14.5, 54.5))
    assert rhythm(pump) == pytest.approx(40.0, abs=0.2)


def test_forces_at_any_time_or_of_which_too_few_are_known_have_none():
    assert rhythm(times((4.9, 45.0), (2.4, 30.0, 82.5), (23.1, 63.0))) is None
    assert rhythm(times((0.0,), (3.0,), (8.0,), (9.0,), (1.0,))) is None
    assert rhythm(times((4.9, 45.0, 85.1))) is None
    assert rhythm([]) is None
