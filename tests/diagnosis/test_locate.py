"""Where along the travel an effect acts, in words for an operator."""

import numpy as np

from pido.diagnosis.locate import strongest_stretch
from pido.diagnosis.state import axis_states
from tests.diagnosis.planted import part


def places():
    states = axis_states([part(k) for k in range(3)], "x")
    return states, np.concatenate([s.pos for s in states])


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
