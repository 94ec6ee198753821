"""How a drive's loop answers is known by its time, not by its form: an interval has room for that."""

from dataclasses import replace

import numpy as np
import pytest

import pido.diagnosis.estimate as estimates
from pido.diagnosis.estimate import estimate, settle_shapes
from pido.diagnosis.loop import answered
from pido.diagnosis.terms import Term
from pido.physics.drive import answered_late, delayed
from tests.diagnosis.planted import NOISE, STEP, VISCOUS, planted

TIME_S = 0.06


def quick(_, recording):
    """Rapids of half a second, of either direction."""
    rng = np.random.default_rng(recording.part.order)
    rows = len(recording["time"])
    v = np.repeat(rng.choice([-60.0, 0.0, 0.0, 60.0], rows // 25), 25)
    v = np.convolve(v, np.ones(9) / 9, "same")
    moved = {"v_x": v, "pos_x": np.cumsum(v) * STEP, "a_x": np.gradient(v, STEP)}
    return replace(recording, columns={**recording.columns, **moved})


def size_of(loop):
    """What is said of a viscous friction behind a loop, and its true size."""
    library, noise = planted(lambda s: loop(s.v[None], s.time)[0], strength=4.0, change=quick)
    mismatch = library.mismatch
    effect = np.concatenate([loop(s.v[None], s.time)[0] for s in mismatch.states])
    terms = settle_shapes(mismatch, noise, [Term(VISCOUS, lag=TIME_S)])
    found = estimate(mismatch, noise, terms, np.random.default_rng(0))
    return found.parameters[0]["F_v"], 4.0 * NOISE / np.std(effect)


def lags(count):
    """A loop of equal lags one after another, of that time in all."""

    def loop(values, time):
        for _ in range(count):
            values = answered_late(values, time, TIME_S / count)
        return values

    return loop


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_interval_of_a_size_holds_whatever_the_form_of_the_loop(count):
    size, true = size_of(lags(count))
    assert size.ci95[0] < true < size.ci95[1]
    assert size.ci95[1] - size.ci95[0] < 0.4 * true


def test_without_that_room_it_would_not(monkeypatch):
    monkeypatch.setattr(estimates, "_FORM_OF_LOOP", 0.0)
    size, true = size_of(lags(3))
    assert not size.ci95[0] < true < size.ci95[1]


def test_a_delay_holds_the_first_value_and_begins_anew_after_a_gap():
    time = np.r_[0.0, 0.1, 0.2, 5.0, 5.1]
    late = delayed(np.array([[1.0, 2.0, 3.0, 10.0, 20.0]]), time, 0.05)
    assert late[0] == pytest.approx([1.0, 1.5, 2.5, 10.0, 15.0])


@pytest.mark.parametrize(("true_s", "found_s", "stays"), [(0.0, 0.1 * STEP, False), (TIME_S, TIME_S, True)])
def test_a_lag_that_is_too_short_to_be_seen_is_none(true_s, found_s, stays):
    def late(state):
        return answered_late(state.v[None], state.time, true_s)[0] if true_s else state.v

    library, noise = planted(late, strength=4.0, change=quick)
    (term,) = answered(library.mismatch, noise, [Term(VISCOUS, lag=found_s)])
    assert bool(term.lag) == stays
