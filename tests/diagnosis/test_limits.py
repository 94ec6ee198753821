"""Limits of a box that an axis passes within a few samples, from where averages of these have put them."""

from dataclasses import replace

import numpy as np
import pytest

from pido.diagnosis.estimate import settle_shapes
from pido.diagnosis.gates import Gate
from pido.diagnosis.limits import on_every_row, straight_within
from pido.diagnosis.terms import Term, behind, fit
from pido.physics.drive import Loop
from tests.diagnosis.feeds import BY_ID, laid_out

LOW, HIGH, MASS = 1.0, 4.0, 0.02


def inertia(low, high, lag=0.0):
    return Term(BY_ID["inertia"], (), (Gate("|v_x|", low=low), Gate("|v_x|", high=high)), loop=Loop(lag))


@pytest.mark.parametrize("lag", [0.0, 0.03])
@pytest.mark.parametrize("found", [(0.4, 7.0), (1.6, 3.0), (0.5, 4.0)])
def test_limits_go_where_every_row_has_them(found, lag):
    def effect(s):
        inside = MASS * s.a * ((np.abs(s.v) >= LOW) & (np.abs(s.v) < HIGH))
        return behind(inside[None], [s], Loop(lag))[0]

    mismatch, noise = laid_out(effect)
    (term,) = on_every_row(mismatch, noise, [inertia(*found, 0.6 * lag)])
    low, high = (g.low if np.isfinite(g.low) else g.high for g in term.gates)
    assert low == pytest.approx(LOW, rel=0.1)
    assert high == pytest.approx(HIGH, rel=0.1)
    assert fit(mismatch, noise, [term]).amplitudes[0][0] == pytest.approx(MASS, rel=0.05)
    assert term.lag == pytest.approx(lag, abs=0.005)


def test_terms_without_limits_and_their_shapes_stay_as_they_are():
    mismatch, noise = laid_out(lambda s: 0.3 * np.sign(s.v) * s.moving)
    terms = [Term(BY_ID["coulomb_friction"], (("rest", 0.0),)), Term(BY_ID["inertia"])]
    assert on_every_row(mismatch, noise, terms) == terms


@pytest.mark.parametrize(
    ("effect", "name"),
    [(lambda v: 0.1 * v, "viscous_friction"), (lambda v: 0.4 * np.tanh(v / 1.5), "coulomb_friction")],
)
def test_a_friction_that_rises_straight_in_its_box_is_viscous_once_the_limits_are_right(effect, name):
    box = (Gate("|v_x|", low=LOW), Gate("|v_x|", high=HIGH))
    mismatch, noise = laid_out(lambda s: effect(s.v) * ((np.abs(s.v) >= LOW) & (np.abs(s.v) < HIGH)))
    bent = Term(BY_ID["coulomb_friction"], (("rest", 3.0), ("v_0", 2.5)), box)
    (term,) = straight_within(mismatch, noise, settle_shapes(mismatch, noise, [bent]))
    assert (term.name, term.gates) == (name, box)
    assert straight_within(mismatch, noise, [replace(bent, gates=())])[0].name == "coulomb_friction"
