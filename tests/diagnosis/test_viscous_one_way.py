"""What differs between the directions of an axis in a box, without a step, is viscous friction between limits."""

from dataclasses import replace

import numpy as np
import pytest

from pido.diagnosis.forms import plainest
from pido.diagnosis.gates import Gate
from pido.diagnosis.library import Library
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.select import grid_terms
from tests.diagnosis.planted import planted

NAMES = ("viscous_friction", "friction_asymmetry")
UPWARDS = Gate("v_y", low=0.0)


def asked(effect, side, gates):
    """What is made of an asymmetry on one side."""
    library, noise = planted(lambda s: effect(s) * (s.others["y"].v >= 0 if gates else 1.0))
    terms = [t for m in CATALOGUE if m.id in NAMES for t in grid_terms(m, library.mismatch.states, m.id)]
    library = Library(library.mismatch, terms)
    library.whiten(noise)
    one_way = next(t for t in terms if dict(t.shape).get("side") == side)
    (out,) = plainest(library, noise, [replace(one_way, gates=gates)])
    return out.name, {(g.variable, g.low, g.high) for g in out.gates}


@pytest.mark.parametrize(("side", "limit"), [(1.0, ("v_x", 0.0, np.inf)), (2.0, ("v_x", -np.inf, 0.0))])
def test_without_a_step_it_is_viscous_friction_in_that_direction(side, limit):
    sign = 3 - 2 * side
    name, limits = asked(lambda s: 0.4 * s.v * (sign * s.v > 0), side, (UPWARDS,))
    assert name == "viscous_friction"
    assert limits == {limit, ("v_y", 0.0, np.inf)}


def test_with_a_step_it_stays_a_difference():
    name, _ = asked(lambda s: (1.0 + 0.4 * s.v) * (s.v > 0), 1.0, (UPWARDS,))
    assert name == "friction_asymmetry"


def test_everywhere_it_stays_a_difference():
    name, _ = asked(lambda s: 0.4 * s.v * (s.v > 0), 1.0, ())
    assert name == "friction_asymmetry"
