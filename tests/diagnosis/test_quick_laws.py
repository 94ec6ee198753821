"""Laws that are quicker than the memory of the noise, and what was tried beside a finding."""

import numpy as np
import pytest
from scipy.signal import lfilter

from pido.diagnosis.arms import Arm
from pido.diagnosis.formulas import Formula, formulas
from pido.diagnosis.library import Library, basis
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.products import QuickLaws
from pido.diagnosis.search import first_look, search
from pido.diagnosis.signals import common_signals
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from pido.diagnosis.unnamed import best_nameless
from pido.diagnosis.whiten import Noise
from tests.diagnosis.planted import NOISE, VISCOUS, found_in, part

MEMORY = 0.99  # correlation of the noise from row to row


def laid_out(effect):
    """An effect, state -> (n,), A, in noise that remembers for two seconds."""
    states = axis_states([part(k) for k in range(3)], "x")
    rng = np.random.default_rng(4)
    slow = [lfilter([1.0], [1.0, -MEMORY], rng.normal(0, NOISE, len(s.time))) for s in states]
    mismatch = lay_out(states, [effect(s) + e for s, e in zip(states, slow, strict=True)])
    return mismatch, Noise(np.array([MEMORY]), np.full(mismatch.n, NOISE), 1.0, mismatch.usable & ~mismatch.starts)


@pytest.mark.parametrize(("from_", "law"), [(0.0, Formula), (40.0, Arm)])
def test_a_mass_that_changes_along_another_axis_is_found_in_noise_that_wanders(from_, law):
    mismatch, noise = laid_out(lambda s: 6e-5 * s.a * (s.places["y"] - from_))
    library = Library(mismatch, [Term(VISCOUS)])
    library.whiten(noise)
    found = best_nameless(library, noise, [])[0]
    assert found.term.mechanism.reads == {"a_x", "pos_y"}
    assert isinstance(found.term.mechanism, law)
    assert found.bic < basis(library, noise, []).bic - 100


def test_formulas_are_ranked_by_what_whitened_rows_say():
    mismatch, noise = laid_out(lambda s: 1e-8 * s.a**3)
    known = common_signals(mismatch.states)
    library = Library(mismatch, [Term(VISCOUS)])
    library.whiten(noise)
    nothing = basis(library, noise, [])
    best = [f for f in QuickLaws("x", known, noise).best(mismatch.target) if isinstance(f, Formula)]
    assert any(f.factors == (("a_x", "u³"),) for f in best)
    gains = [s.gain for f in best if (s := library.score(Term(f), nothing)) is not None]
    every = [s.gain for f in formulas(known)[::7] if (s := library.score(Term(f), nothing)) is not None]
    assert np.median(gains) > np.quantile(every, 0.95)


def test_what_was_tried_beside_a_finding_is_told_with_what_it_would_bring():
    states = axis_states([part(k) for k in range(3)], "x")
    rng = np.random.default_rng(0)
    mismatch = lay_out(states, [0.02 * s.v + rng.normal(0, NOISE, len(s.v)) for s in states])
    answer = search(first_look(mismatch, rng), 1, False, rng)
    assert [t.name for t in answer.terms] == ["viscous_friction"]
    tried = {r.mechanism: r.reason for r in answer.rejected if "its BIC is" in r.reason}
    assert {"coulomb_friction", "inertia"} <= set(tried)
    assert "viscous_friction" not in tried


def test_what_braking_takes_is_a_product_of_three_quantities():
    def taken(state):
        return np.sqrt(np.maximum(-state.v * state.a, 0.0)) * np.sign(state.v)

    law = found_in(taken).mechanism
    assert isinstance(law, Formula)
    assert law.reads == {"v_x", "a_x", "braking_x"}
    assert law.unit == "(mm/s²)^0.5·(mm/s)^0.5" or law.unit == "(mm/s)^0.5·(mm/s²)^0.5"


def test_a_law_of_two_quantities_has_no_third():
    law = found_in(lambda s: np.abs(s.v) * s.others["y"].v).mechanism
    assert isinstance(law, Formula)
    assert law.reads == {"v_x", "v_y"}


def test_one_more_quantity_is_another_one_and_makes_no_high_power():
    law = Formula((("v_x", "u"), ("v_y", "u")), "(mm/s)·(mm/s)", ((-1.0, 1.0), (-2.0, 2.0)))
    assert law.may_have(("a_x", "u"))
    assert not law.may_have(("a_x", "u²"))
    assert not law.may_have(("v_y", "sgn u"))
    more = law.times(("a_x", "u"), (-3.0, 3.0))
    assert more.unit == "(mm/s)·(mm/s)·(mm/s²)"
    assert more.seen == ((-1.0, 1.0), (-2.0, 2.0), (-3.0, 3.0))
    assert law in more.of_fewer()
