"""What a law of friction is at rest: what the simulation holds there, all of it, or nothing."""

from dataclasses import replace

import numpy as np
import pytest

from pido.diagnosis.answers import equation_text
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mechanisms.sliding import SIMULATED, direction
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.search import first_look, search
from pido.diagnosis.sim_rest import with_simulated_rest
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term, fit
from tests.diagnosis.feeds import NOISE, recordings

BY_ID = {m.id: m for m in CATALOGUE}
CURRENT = 0.5  # A, of the simulation's friction


def left_at_rest(state, seed, low=-0.4, high=1.0):
    """What a controller leaves of the friction at each standstill, times the sign of the last motion."""
    stops = np.cumsum(np.diff(state.moving.astype(int), prepend=0) == -1)
    share = np.random.default_rng(seed).uniform(low, high, int(stops[-1]) + 1)
    return np.where(state.moving, state.along, share[stops] * state.held)


def states_with(at_rest, offset=0.3):
    """States whose simulation has, with friction, its viscous part, inertia and a constant, `at_rest` at standstill."""
    plain = axis_states(list(recordings()), "x")
    held = [at_rest(s, k) for k, s in enumerate(plain)]
    sims = [CURRENT * h + 0.002 * s.v + 0.004 * s.a + offset for s, h in zip(plain, held, strict=True)]
    return with_simulated_rest([replace(s, sim=i) for s, i in zip(plain, sims, strict=True)]), held


def looked_at(states, effect, seed=5):
    rng = np.random.default_rng(seed)
    mismatch = lay_out(states, [e + rng.normal(0, NOISE, len(e)) for e in effect])
    return search(first_look(mismatch, np.random.default_rng(0)), 1, False, np.random.default_rng(0))


def test_what_a_simulation_holds_at_rest_is_read_from_its_current():
    states, held = states_with(left_at_rest)
    for state, truth in zip(states, held, strict=True):
        known = state.held != 0
        assert state.sim_held is not None
        assert np.max(np.abs(state.sim_held - truth)[known]) < 0.02


@pytest.mark.parametrize("at_rest", [lambda s, k: s.along, lambda s, k: s.held])
def test_a_simulation_that_holds_nothing_or_all_says_nothing_new(at_rest):
    states, _ = states_with(at_rest)
    assert all(s.sim_held is None for s in states)
    state = states[0]
    assert np.array_equal(direction(state, SIMULATED), state.held)


def test_without_a_simulated_current_nothing_is_read():
    states = axis_states(list(recordings()), "x")
    bare = [replace(s, sim=None) for s in states]
    assert all(s.sim_held is None for s in with_simulated_rest(bare))


def test_a_friction_that_is_too_small_is_too_small_where_its_axis_rests_too():
    states, held = states_with(left_at_rest)
    answer = looked_at(states, [0.1 * h for h in held])
    (found,) = answer.terms
    assert found.name == "miscalibrated:coulomb_friction"
    assert dict(found.shape)["rest"] == SIMULATED
    assert "as far as the simulation holds there" in equation_text(found, "x")


def test_a_friction_that_warms_up_is_held_at_rest():
    states, _ = states_with(lambda s, k: s.along)
    answer = looked_at(states, [0.15 * np.exp(-s.time / 12.0) * s.held for s in states])
    (found,) = answer.terms
    assert found.name == "thermal_drift"
    assert dict(found.shape)["rest"] in (1.0, 2.0)
    assert dict(found.shape)["tau"] == pytest.approx(12.0, rel=0.2)


@pytest.mark.parametrize("stands", [0.0, 1.0])
def test_lost_motion_is_held_at_rest_or_is_not(stands):
    states, _ = states_with(lambda s, k: s.along)
    law = Term(BY_ID["backlash"], (("gap", 1.2), ("edge", 1.0), ("per", 0.0), ("stands", stands)))
    answer = looked_at(states, [0.25 * law.of_part(s)[0] for s in states])
    (found,) = answer.terms
    assert found.name == "backlash"
    assert dict(found.shape)["stands"] == stands
    assert ("at rest 0" in equation_text(found, "x")) == (stands == 1.0)
    mismatch = lay_out(states, [0.25 * law.of_part(s)[0] for s in states])
    (amplitude,) = fit(mismatch, answer.noise, [found]).amplitudes
    assert amplitude[0] == pytest.approx(0.25, rel=0.1)


def test_shapes_of_earlier_versions_mean_what_they_meant():
    (state, *_) = axis_states(list(recordings()), "x")
    lost = (("gap", 1.2), ("edge", 1.0), ("per", 0.0))
    assert np.array_equal(
        Term(BY_ID["backlash"], lost).of_part(state), Term(BY_ID["backlash"], (*lost, ("stands", 0.0))).of_part(state)
    )
    warm = (("tau", 30.0), ("clock", 0.0), ("along", 1.0), ("rises", 0.0))
    assert not Term(BY_ID["thermal_drift"], warm).of_part(state)[0][~state.moving].any()
