"""What an event sets off, and what stays on for a while after it: found without a name, with its level and times."""

import numpy as np
import pytest

from pido.diagnosis.latched import Latched, Switched
from pido.diagnosis.state import axis_states
from pido.diagnosis.transients import Transient
from pido.diagnosis.waves import Wave
from tests.diagnosis.planted import found_in, part


def crossings(above):
    """+1 where it becomes true, -1 where it becomes false."""
    return np.diff(above.astype(float), prepend=float(above[0]))


def after(state, events, answer):
    """The answers to all events so far, each to the time since it."""
    out = np.zeros(len(state.time))
    for at in np.flatnonzero(events):
        since = state.time - state.time[at]
        out += np.where(since >= 0, events[at] * answer(np.maximum(since, 0.0)), 0.0)
    return out


def cutting(k, recording):
    """Cuts of some seconds, at times that differ by part."""
    return recording.with_columns(mrr_sim=10.0 * ((recording.time + k) % 7.0 < 3.0))


def test_a_shock_as_the_tool_enters_the_material():
    def shock(state):
        enters = np.maximum(crossings(state.engaged), 0.0)
        return after(state, enters, lambda t: np.exp(-t / 0.15))

    term = found_in(shock, strength=1.0, change=cutting)
    assert term.mechanism == Transient("t_cut", "s", "up")
    assert dict(term.shape)["tau"] == pytest.approx(0.15, rel=0.2)
    assert "after the tool enters the material" in term.mechanism.conditions("x", dict(term.shape))[0]


def test_a_kick_as_another_axis_turns():
    def kick(state):
        return after(state, np.diff(state.others["y"].held, prepend=0.0) / 2, lambda t: np.exp(-t / 0.1))

    term = found_in(kick, strength=1.0, stops=True)
    assert term.mechanism == Transient("held_y", "–", "both")
    assert dict(term.shape)["tau"] == pytest.approx(0.1, rel=0.2)
    assert "axis y turns to +" in term.mechanism.conditions("x", dict(term.shape))[0]


def test_what_rings_whenever_a_speed_is_passed_is_found_with_that_speed():
    w, zeta, level = 2 * np.pi * 3.0, 0.08, 5.0

    def shaken(state):
        return after(state, crossings(np.abs(state.v) > level), lambda t: np.exp(-zeta * w * t) * np.cos(w * t))

    term = found_in(shaken, strength=3.0)
    assert isinstance(term.mechanism, Transient)
    assert (term.mechanism.signal, term.mechanism.rings) == ("v_x", True)
    shape = dict(term.shape)
    assert shape["c"] == pytest.approx(level, rel=0.05)
    assert shape["f"] == pytest.approx(3.0, rel=0.05)


def test_what_stays_switched_on_for_a_while_is_found_with_its_time():
    def chopped(state):
        above = np.abs(state.others["y"].v) > 8.0
        last = np.maximum.accumulate(np.where(above, np.arange(len(above)), -1))
        return ((last >= 0) & (state.time - state.time[last] <= 1.2)) - 0.4

    term = found_in(chopped, strength=3.0)
    assert isinstance(term.mechanism, Latched)
    assert term.mechanism.signal == "v_y"
    assert dict(term.shape)["T"] == pytest.approx(1.2, rel=0.1)


@pytest.mark.parametrize("carried", ["", "v_x"])
def test_what_is_switched_on_at_one_speed_and_off_at_another_is_found_with_both(carried):
    def geared(state):
        on, out = False, np.zeros(len(state.v))
        for i, u in enumerate(np.abs(state.others["y"].v)):
            on = u > 9.0 or (on and u >= 3.0)
            out[i] = on
        return (out - 0.4) * (np.sign(state.v) if carried else 1.0)

    term = found_in(geared, strength=3.0)
    assert isinstance(term.mechanism, Switched)
    assert (term.mechanism.signal, term.mechanism.carried) == ("v_y", carried)
    assert (dict(term.shape)["c_on"], dict(term.shape)["c_off"]) == pytest.approx((9.0, 3.0), rel=0.1)


def test_what_comes_again_with_the_volume_removed():
    def edge(state):
        step = np.diff(state.time, prepend=state.time[0])
        removed = np.cumsum(state.mrr * step)
        return state.v * (0.5 - removed / 13.0 % 1.0)

    term = found_in(edge, strength=2.0, change=cutting)
    assert isinstance(term.mechanism, Wave)
    assert (term.mechanism.place, term.mechanism.signal) == ("removed", "v_x")
    assert dict(term.shape)["L"] == pytest.approx(13.0, rel=0.01)


def test_oil_that_comes_again_with_the_way_of_all_axes():
    def oiled(state):
        way = np.cumsum(np.abs(np.diff(state.pos, prepend=0.0)) + np.abs(np.diff(state.places["y"], prepend=0.0)))
        return state.held * (0.5 - way / 40.0 % 1.0)

    term = found_in(oiled, stops=True)
    assert isinstance(term.mechanism, Wave)
    assert (term.mechanism.place, term.mechanism.signal) == ("way_all", "held_x")
    assert dict(term.shape)["L"] == pytest.approx(40.0, rel=0.01)


def test_a_transient_counts_from_its_last_event_on_its_side():
    (state,) = axis_states([part(0)], "x")
    above = np.abs(state.v) > 5.0
    (up,) = Transient("v_x", "mm/s", "up", even=True, level=True).regressors(state, c=5.0, tau=0.5).T
    starts = np.flatnonzero(crossings(above) > 0)
    assert np.all(up[: starts[0]] == 0.0)
    assert np.all(up[starts] == 1.0)
    assert up[starts[0] + 1] == pytest.approx(np.exp(-(state.time[1] - state.time[0]) / 0.5))
    (both,) = Transient("v_x", "mm/s", "both", even=True, level=True).regressors(state, c=5.0, tau=0.5).T
    assert np.all(both[np.flatnonzero(crossings(above) < 0)] == -1.0)
