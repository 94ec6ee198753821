"""Laws without a name in the box of one with a name, and in a box of their own."""

import numpy as np
import pytest

from pido.core.recording import Recording
from pido.diagnosis.arms import Arm
from pido.diagnosis.formulas import Formula
from pido.diagnosis.gates import Gate
from pido.diagnosis.library import Library, basis
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term, fit
from pido.diagnosis.unnamed import best_nameless
from pido.diagnosis.within import nameless_within
from tests.diagnosis.planted import NOISE, VISCOUS, part, white

BOX = Gate("v_x", 4.0, np.inf)
NAMED = Term(VISCOUS, gates=(BOX,))


def laid_out(effect):
    """`effect`, state -> (n,), A, where x is faster than 4 mm/s; a simulation of nothing, and white noise."""
    rng = np.random.default_rng(2)
    states = axis_states([part(k) for k in range(4)], "x")
    return lay_out(states, [np.where(s.v > 4.0, effect(s), 0.0) + rng.normal(0, NOISE, len(s.v)) for s in states])


def asked(effect, terms):
    mismatch = laid_out(effect)
    noise = white(mismatch)
    library = Library(mismatch, [Term(VISCOUS)])
    return mismatch, noise, nameless_within(library, noise, terms)


def test_a_product_of_two_speeds_in_a_box_is_no_friction_there():
    mismatch, noise, terms = asked(lambda s: 0.004 * s.v * s.others["y"].v, [NAMED])
    (term,) = terms
    assert isinstance(term.mechanism, Formula)
    assert term.mechanism.reads == {"v_x", "v_y"}
    (gate,) = term.gates
    assert gate.variable == "v_x"
    assert gate.low == pytest.approx(4.0, abs=1.0)
    assert np.std(fit(mismatch, noise, terms).residual) < 1.05 * NOISE


@pytest.mark.parametrize(
    "effect",
    [lambda s: 0.03 * s.v, lambda s: 0.03 * s.v * (1 + 0.01 * (s.v - 8.0))],
    ids=["as the textbook says", "bent by less than a tenth"],
)
def test_a_friction_in_a_box_keeps_its_name(effect):
    *_, terms = asked(effect, [NAMED])
    assert terms == [NAMED]


def test_a_friction_everywhere_is_not_asked_about():
    *_, terms = asked(lambda s: 0.004 * s.v * s.others["y"].v, [Term(VISCOUS)])
    assert terms == [Term(VISCOUS)]


def on_an_arm(far):
    """A friction that grows with how far y is from `far` + 5 mm, where x goes one way and y is fast; y is all over."""
    rng = np.random.default_rng(2)
    parts = [part(k) for k in range(4)]
    states = axis_states([Recording(p.part, {**p.columns, "pos_y": p["pos_y"] + far}) for p in parts], "x")
    effects = [0.02 * (s.places["y"] - far - 5.0) * s.v * ((s.v > 2.0) & (s.others["y"].v > -3.0)) for s in states]
    mismatch = lay_out(states, [e + rng.normal(0, NOISE, len(e)) for e in effects])
    noise = white(mismatch)
    library = Library(mismatch, [Term(VISCOUS)])
    library.whiten(noise)
    return library, noise


@pytest.mark.parametrize("far", [pytest.param(0.0, marks=pytest.mark.thorough), 3000.0])
def test_a_law_that_acts_in_a_box_is_found_there_wherever_its_places_are(far):
    library, noise = on_an_arm(far)
    everywhere = [best_nameless(library, noise, [])[-1].term]
    (term,) = nameless_within(library, noise, everywhere)
    assert isinstance(term.mechanism, Arm)
    assert term.mechanism.reads == {"pos_y", "v_x"}
    limits = {g.variable: g.low for g in term.gates}
    assert limits == pytest.approx({"v_x": 2.0, "v_y": -3.0}, abs=0.3)
    assert np.std(fit(library.mismatch, noise, [term]).residual) < 1.02 * NOISE


def test_an_arm_takes_as_much_away_far_from_the_machines_zero():
    gains = []
    for far in (0.0, 30000.0):
        library, noise = on_an_arm(far)
        score = library.score(Term(Arm("pos_y", "v_x", "mm/s"), gates=(BOX,)), basis(library, noise, []))
        assert score is not None
        gains.append(score.gain)
    assert gains[1] == pytest.approx(gains[0], rel=1e-3)


@pytest.mark.thorough
def test_a_law_without_a_name_that_acts_everywhere_is_not_confined():
    mismatch = laid_out(lambda s: 0.0 * s.v)
    states = mismatch.states
    rng = np.random.default_rng(3)
    mismatch = lay_out(states, [0.002 * s.v * s.others["y"].v + rng.normal(0, NOISE, len(s.v)) for s in states])
    noise = white(mismatch)
    library = Library(mismatch, [Term(VISCOUS)])
    library.whiten(noise)
    everywhere = [best_nameless(library, noise, [])[0].term]
    assert nameless_within(library, noise, everywhere) == everywhere


@pytest.mark.thorough
def test_one_law_in_a_box_takes_the_place_of_two_that_stand_for_it():
    library, noise = on_an_arm(0.0)
    coulomb = next(m for m in CATALOGUE if m.id == "coulomb_friction")
    (term,) = nameless_within(library, noise, [Term(VISCOUS), Term(coulomb)])
    assert term.mechanism.reads == {"pos_y", "v_x"}
    assert {g.variable for g in term.gates} == {"v_x", "v_y"}


def test_two_laws_that_act_stay_two():
    states = axis_states([part(k) for k in range(4)], "x")
    rng = np.random.default_rng(3)
    mismatch = lay_out(states, [0.01 * s.v + 0.002 * s.a + rng.normal(0, NOISE, len(s.v)) for s in states])
    noise = white(mismatch)
    library = Library(mismatch, [Term(VISCOUS)])
    both = [Term(VISCOUS), Term(next(m for m in CATALOGUE if m.id == "inertia"))]
    assert nameless_within(library, noise, both) == both
