"""A friction that nothing but standstill shows is what the axis holds there, whatever curve over speed fits it too."""

import numpy as np
import pytest

from pido.diagnosis.forms import plainest
from pido.diagnosis.library import Library
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from tests.diagnosis.planted import NOISE, part, white

BY_ID = {m.id: m for m in CATALOGUE}


@pytest.mark.parametrize(("v_s", "name"), [(0.05, "standstill_friction"), (8.0, "stribeck_friction")])
def test_what_falls_with_speed_before_the_axis_moves_is_held_at_standstill(v_s, name):
    states = axis_states([part(k, stops=True) for k in range(3)], "x")
    rng = np.random.default_rng(0)
    effect = [s.held * np.exp(-np.abs(s.v) / v_s) for s in states]
    mismatch = lay_out(states, [e + rng.normal(0, NOISE, len(e)) for e in effect])
    noise = white(mismatch)
    falls = Term(BY_ID["stribeck_friction"], (("v_s", v_s), ("delta", 1.0), ("rest", 1.0)))
    library = Library(mismatch, [falls, Term(BY_ID["standstill_friction"], (("rest", 0.0),))])
    library.whiten(noise)
    assert [t.name for t in plainest(library, noise, [falls])] == [name]
