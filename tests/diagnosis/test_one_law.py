"""Two laws in boxes in which they cannot be told from a third, that has one number in both, are this third."""

from dataclasses import replace

import numpy as np
import pytest

from pido.diagnosis.gates import Gate, inside
from pido.diagnosis.library import Library
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.one_law import one_law
from pido.diagnosis.search import another_law
from pido.diagnosis.select import grid_terms
from pido.diagnosis.terms import Term
from tests.diagnosis.planted import planted

NAMES = ("coulomb_friction", "axis_coupling", "viscous_friction")
MECHANISMS = [m for m in CATALOGUE if m.id in NAMES]
THERE = (Gate("v_x", low=3.0), Gate("v_y", low=2.0))
BACK = (Gate("v_x", high=-3.0), Gate("v_y", low=2.0))


def asked(sizes):
    """What is made of a coupling to the sign of v_y in two boxes, over a constant in each, of the sign of v_x."""

    def effect(state):
        v_x, v_y = state.v, state.others["y"].v
        there, back = ((np.sign(v_x) == s) & (np.abs(v_x) > 3) & (v_y > 2) for s in (1, -1))
        return sizes[0] * there - sizes[1] * back

    library, noise = planted(effect)
    terms = [t for m in MECHANISMS for t in grid_terms(m, library.mismatch.states, m.id)]
    library = Library(library.mismatch, terms)
    library.whiten(noise)
    sign = next(t for t in terms if t.name == "axis_coupling" and "sgn" in t.mechanism.equation_in("x", dict(t.shape)))
    return one_law(library, noise, [replace(sign, gates=g) for g in (THERE, BACK)]), library


def test_one_number_in_both_is_one_law():
    out, _ = asked((1.0, 1.0))
    assert [t.name for t in out] == ["coulomb_friction"] * 2
    limits = {(g.variable, g.low > -np.inf): g for t in out for g in t.gates}
    assert limits[("v_x", True)].low == pytest.approx(3.0, abs=0.5)


@pytest.mark.parametrize("sizes", [(1.0, 0.5), (1.0, -1.0)])
def test_two_numbers_are_two_laws(sizes):
    out, _ = asked(sizes)
    assert [t.name for t in out] == ["axis_coupling"] * 2


@pytest.mark.parametrize(("box", "law"), [(THERE, "axis_coupling"), (THERE[1:], None)])
def test_less_of_a_law_is_another_one_where_a_box_does_not_tell_them_apart(box, law):
    """Where x goes one way only, less friction is what the other axis gives it; both ways it is not."""
    library, noise = planted(lambda s: -np.sign(s.v) * np.all([inside(s, (g,)) > 0 for g in box], axis=0))
    less = "miscalibrated:coulomb_friction"
    shapes = {m.id: grid_terms(m, library.mismatch.states, m.id) for m in MECHANISMS}
    shapes["coulomb_friction"] = [replace(t, name=less) for t in shapes["coulomb_friction"]]
    library = Library(library.mismatch, [t for group in shapes.values() for t in group], frozenset({less}))
    library.whiten(noise)
    term = replace(shapes["coulomb_friction"][0], gates=box)
    found = another_law(library, noise, [term], 0)
    assert (None if found is None else found.name) == law


def test_what_acts_everywhere_is_left_as_it_is():
    _, library = asked((1.0, 1.0))
    friction = next(t for t in library.terms if t.name == "coulomb_friction")
    terms = [friction, Term(next(m for m in MECHANISMS if m.id == "viscous_friction"), gates=THERE)]
    assert library.noise is not None
    assert one_law(library, library.noise, terms) == terms
