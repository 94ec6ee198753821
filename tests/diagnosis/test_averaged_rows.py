"""Rows that a search averages: what acts in proportion to itself explains the averaged target to the letter."""

from dataclasses import replace

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.gates import PATH_SPEED, Gate, between, gate_variable, inside
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.state import axis_states

STRIDE = 10


def _states(rows=6000):
    """At 500 Hz, x goes to and fro with stops, under a force that comes and goes with the teeth; y beside it."""
    rng, t = np.random.default_rng(0), np.arange(rows) / 500.0
    columns = {"time": t}
    for axis in "xy":
        speeds = rng.uniform(-12, 12, rows // 50) * (rng.random(rows // 50) > 0.3)
        v = np.convolve(np.repeat(speeds, 50), np.ones(9) / 9, "same")
        v = np.where(np.abs(v) < 1e-9, 0.0, v)
        columns |= {f"v_{axis}": v, f"pos_{axis}": np.cumsum(v) / 500.0, f"a_{axis}": np.gradient(v, t)}
    columns["f_x_sim"] = 100.0 * np.maximum(0.0, np.sin(2 * np.pi * 83.0 * t)) * (t > 4.0)
    columns["curr_x_sim"] = 2.0 * np.sign(columns["v_x"]) + 0.01 * columns["f_x_sim"]
    return axis_states([Recording(PartInfo(part="p", machine="m", order=1), columns)], "x")


LAWS = {
    "coulomb_friction": {"rest": 0.0}, "standstill_friction": {"rest": 0.0}, "inertia": {}, "cutting_force": {},
    "axis_coupling": {"source": 5.0}, "sensor_gain": {},
}  # fmt: skip


@pytest.mark.parametrize("law", LAWS)
def test_a_law_in_proportion_explains_the_averaged_target(law):
    mechanism = next(m for m in CATALOGUE if m.id == law)
    states = _states()
    shape = {**mechanism.starts(states)[0], **LAWS[law]}
    whole = mechanism.regressors(states[0], **shape).ravel()
    mismatch = lay_out(states, [whole], stride=STRIDE)
    averaged = mechanism.regressors(mismatch.states[0], **shape).ravel()
    assert np.std(mismatch.target) > 0
    np.testing.assert_allclose(averaged, mismatch.target, atol=1e-9 * np.abs(whole).max())


def test_a_row_is_usable_where_all_that_it_averages_is():
    (state,) = _states()
    spoilt = np.ones(len(state.time), bool)
    spoilt[123] = False
    others = {a: replace(o, wrong=~spoilt) for a, o in state.others.items()}
    mismatch = lay_out([replace(state, usable=spoilt, others=others)], [np.zeros(len(spoilt))], stride=STRIDE)
    assert np.flatnonzero(~mismatch.usable).tolist() == [12]
    assert np.flatnonzero(mismatch.states[0].others["y"].wrong).tolist() == [12]


@pytest.mark.parametrize("gate", [Gate("v_x", high=3.0), Gate("|v_x|", 2.0, 8.0), Gate(PATH_SPEED, low=4.0)], ids=str)
def test_a_limit_that_is_passed_within_a_row_counts_for_the_share_of_it(gate):
    states = _states()
    whole = inside(states[0], (gate,))
    mismatch = lay_out(states, [whole], stride=STRIDE)
    share = inside(mismatch.states[0], (gate,))
    partly = (mismatch.target > 0) & (mismatch.target < 1)
    assert partly.sum() > 20
    sharp = np.round(share)
    assert np.mean((share - mismatch.target)[partly] ** 2) < 0.5 * np.mean((sharp - mismatch.target)[partly] ** 2)
    np.testing.assert_array_equal(share[~partly], mismatch.target[~partly])


@pytest.mark.parametrize("variable", ["v_x", "|v_x|", PATH_SPEED])
@pytest.mark.parametrize("stride", [1, STRIDE])
def test_what_of_a_row_lies_between_two_limits_is_what_a_gate_says(variable, stride):
    states = _states()
    (state,) = lay_out(states, [np.zeros(len(states[0].time))], stride=stride).states
    limits = np.array([-3.0, 0.0, 2.0, 2.5, 8.0])
    shares = between(gate_variable(state, variable), state.ranges.get(variable), limits).toarray()
    ends = zip([-np.inf, *limits], [*limits, np.inf], strict=True)
    np.testing.assert_allclose(shares, [inside(state, (Gate(variable, *each),)) for each in ends], atol=1e-12)
    np.testing.assert_allclose(shares.sum(axis=0), 1.0)
