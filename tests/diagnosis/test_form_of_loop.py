"""How a drive's loop answers is known by its time, not by its form: an interval has room for that."""

from dataclasses import replace

import numpy as np
import pytest

import pido.diagnosis.estimate as estimates
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.contained import contained
from pido.diagnosis.estimate import estimate, settle_shapes
from pido.diagnosis.loop import answered
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from pido.physics.drive import Loop, answered_late, delayed
from tests.diagnosis.planted import NOISE, STEP, VISCOUS, planted, white

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
    terms = settle_shapes(mismatch, noise, [Term(VISCOUS, loop=Loop(TIME_S))])
    found = estimate(mismatch, noise, terms, np.random.default_rng(0))
    return found.parameters[0]["F_v"], 4.0 * NOISE / np.std(effect)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_interval_of_a_size_holds_whatever_the_form_of_the_loop(count):
    size, true = size_of(Loop(TIME_S, count).answered)
    assert size.ci95[0] < true < size.ci95[1]
    assert size.ci95[1] - size.ci95[0] < 0.4 * true


def test_without_that_room_it_would_not(monkeypatch):
    monkeypatch.setattr(estimates, "_FORM_OF_LOOP", 0.0)
    size, true = size_of(Loop(TIME_S, 3).answered)
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
    (term,) = answered(library.mismatch, noise, [Term(VISCOUS, loop=Loop(found_s))])
    assert bool(term.lag) == stays


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_loop_has_as_many_lags_as_say_more(count):
    library, noise = planted(lambda s: Loop(TIME_S, count).answered(s.v[None], s.time)[0], strength=8.0, change=quick)
    (term,) = answered(library.mismatch, noise, [Term(VISCOUS)])
    assert term.loop.lags == count
    assert term.lag == pytest.approx(TIME_S, rel=0.05)


def test_a_simulation_is_read_behind_a_loop_of_two_lags():
    """x goes to and fro at a few feeds, with a mass and friction: none of it viscous, as one lag would say."""
    states, rng = [], np.random.default_rng(7)
    for k in range(3):
        v = np.repeat(rng.choice([3.0, 6.0, 10.0, 15.0], 40) * rng.choice([-1, 1], 40), 100)
        v = np.convolve(v, np.ones(25) / 25, "same")
        t = np.arange(len(v)) * STEP
        a = np.gradient(v, t)
        drawn = Loop(0.12, 2).answered((0.08 * a + 2.0 * np.sign(v) * (np.abs(v) > 0.05))[None], t)[0]
        columns = {"time": t, "v_x": v, "pos_x": np.cumsum(v) * STEP, "a_x": a, "curr_x_sim": drawn}
        states += axis_states([Recording(PartInfo(part=f"p{k}", machine="m", order=k + 1), columns)], "x")
    mismatch = lay_out(states, [rng.normal(0, NOISE, len(s.time)) for s in states])
    found = contained(mismatch, CATALOGUE, white(mismatch), np.random.default_rng(0))
    assert set(found) == {"inertia", "coulomb_friction"}
    assert found["coulomb_friction"].amplitudes[0] == pytest.approx(2.0, rel=0.03)
    assert found["inertia"].term.loop.lags == 2
