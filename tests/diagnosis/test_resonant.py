"""A motion or a load that is felt otherwise around one value of another quantity is a law of its own."""

from dataclasses import replace

import numpy as np
import pytest

from pido.diagnosis.flexible import Coarse
from pido.diagnosis.formulas import Peak
from pido.diagnosis.models import AxisModel, as_json, axis_models
from pido.diagnosis.resonant import Resonant, resonant
from pido.diagnosis.terms import Term
from tests.diagnosis.planted import NOISE, STEP, found_in


def turning(k, recording):
    """With a spindle that is slowed down and sped up all the time, to another speed every half second."""
    rng = np.random.default_rng(50 + k)
    v = np.interp(recording["time"], np.arange(0, 31, 0.5), rng.uniform(2000, 12_000, 62))
    turned = {"v_sp": v, "a_sp": np.gradient(v, STEP), "pos_sp": np.cumsum(v) * STEP % 360}
    return replace(recording, columns={**recording.columns, **turned})


def spindle(state):
    return state.others["sp"].v


def test_a_friction_that_a_resonance_of_the_spindle_eases_is_one_law():
    def eased(state):
        return (0.6 - np.exp(-(((spindle(state) - 6000) / 1500) ** 2))) * np.sign(state.v) * state.moving

    term = found_in(eased, strength=4.0, change=turning)
    assert isinstance(term.mechanism, Resonant)
    assert (term.mechanism.by, term.mechanism.signal, term.mechanism.even) == ("v_sp", "v_x", True)
    shape = dict(term.shape)
    assert shape["c"] == pytest.approx(6000, rel=0.05)
    assert shape["b"] == pytest.approx(1500, rel=0.2)
    model = AxisModel("x", NOISE, (term,), (np.ones(2),))
    assert axis_models(as_json({"x": model}))["x"].terms == (term,)


def test_a_friction_that_is_less_from_one_speed_of_the_spindle_to_another_ends_there():
    def within(state):
        fast = spindle(state)
        return (0.6 - ((fast > 4000) & (fast < 9000))) * np.sign(state.v) * state.moving

    term = found_in(within, strength=4.0, change=turning)
    assert isinstance(term.mechanism, Resonant)
    assert term.mechanism.flat
    shape = dict(term.shape)
    assert shape["c"] - shape["b"] == pytest.approx(4000, abs=200)
    assert shape["c"] + shape["b"] == pytest.approx(9000, abs=200)
    said, _ = term.mechanism.conditions("x", shape)
    assert said.startswith("with sgn(v_x), more or less of it for |v_sp| from ")
    model = AxisModel("x", NOISE, (term,), (np.ones(2),))
    assert axis_models(as_json({"x": model}))["x"].terms == (term,)


def test_a_current_that_has_a_peak_by_itself_stays_one():
    term = found_in(lambda s: np.exp(-(((np.abs(s.v) - 6.0) / 1.5) ** 2)))
    assert isinstance(term.mechanism, Peak)


def test_what_it_takes_away_is_what_least_squares_say():
    rng = np.random.default_rng(3)
    n = 4000
    known = {"v_x": (rng.normal(0, 5, n), "mm/s"), "feed_rev": (rng.uniform(0, 9, n), "mm")}
    weights, values = rng.uniform(0.5, 2.0, n), rng.normal(0, 1, n)
    values += 0.4 * known["v_x"][0] * np.exp(-(((known["feed_rev"][0] - 4.0) / 1.5) ** 2))
    gain, term = resonant("x", known, Coarse(np.arange(n), np.zeros(n, int), values, weights))[0]
    assert (term.mechanism.by, term.mechanism.signal, term.mechanism.form) == ("feed_rev", "v_x", "u")
    rows = term.mechanism.over(known, dict(term.shape)) * np.sqrt(weights)[:, None]
    wanted = values * np.sqrt(weights)
    left = wanted - rows @ np.linalg.lstsq(rows, wanted, rcond=None)[0]
    assert gain == pytest.approx(wanted @ wanted - left @ left, rel=0.02)


def test_its_middle_stays_within_what_is_met_of_the_quantity():
    law = Resonant("v_y", "v_x", "u", "mm/s", "mm/s", even=True, ends=(0.0, 12.0))
    assert law.moved({"c": 1.0, "b": 4.0}, np.array([-1.0, 0.0])) == {"c": 0.0, "b": 4.0}
    assert law.around("c", {"c": 11.0, "b": 4.0}, []) == (7.0, 12.0)


def test_it_says_where_it_is_otherwise():
    law = Resonant("v_sp", "v_y", "sgn u", "mm/s", "deg/s", even=True, ends=(0.0, 1e5))
    said, _ = law.conditions("y", {"c": 82800.0, "b": 6700.0})
    assert said == "with sgn(v_y), more or less of it around |v_sp| = 8.28e+04 deg/s"
    assert law.equation == "dI = (k_0 + k * exp(-((|v_sp| - c) / b)^2)) * sgn(v_y)"
    assert Term(law, (("c", 82800.0), ("b", 6700.0))).mechanism.reads == {"v_sp", "v_y"}
