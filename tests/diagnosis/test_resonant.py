"""A motion or a load that is felt otherwise around one value of another quantity is a law of its own."""

import numpy as np
import pytest

from pido.diagnosis.flexible import Coarse
from pido.diagnosis.formulas import Peak
from pido.diagnosis.models import AxisModel, as_json, axis_models
from pido.diagnosis.resonant import Resonant, resonant
from pido.diagnosis.terms import Term
from tests.diagnosis.planted import NOISE, found_in


def eased_about(c, b, form=np.sign):
    """A friction of x that is less about a speed of y, either way."""
    return lambda s: (0.6 - np.exp(-(((np.abs(s.others["y"].v) - c) / b) ** 2))) * form(s.v) * s.moving


def test_a_friction_that_another_speed_eases_about_one_value_is_one_law():
    term = found_in(eased_about(6.0, 1.5), strength=4.0)
    assert isinstance(term.mechanism, Resonant)
    assert (term.mechanism.by, term.mechanism.signal, term.mechanism.even) == ("v_y", "v_x", True)
    shape = dict(term.shape)
    assert shape["c"] == pytest.approx(6.0, rel=0.05)
    assert shape["b"] == pytest.approx(1.5, rel=0.2)
    model = AxisModel("x", NOISE, (term,), (np.ones(2),))
    assert axis_models(as_json({"x": model}))["x"].terms == (term,)


def test_a_friction_that_is_less_from_one_speed_of_another_axis_to_another_ends_there():
    def within(state):
        fast = np.abs(state.others["y"].v)
        return (0.6 - ((fast > 4.0) & (fast < 9.0))) * np.sign(state.v) * state.moving

    term = found_in(within, strength=4.0)
    assert isinstance(term.mechanism, Resonant)
    assert term.mechanism.flat
    shape = dict(term.shape)
    assert shape["c"] - shape["b"] == pytest.approx(4.0, abs=0.3)
    assert shape["c"] + shape["b"] == pytest.approx(9.0, abs=0.3)
    said, _ = term.mechanism.conditions("x", shape)
    assert said.startswith("with sgn(v_x), more or less of it for |v_y| from ")
    model = AxisModel("x", NOISE, (term,), (np.ones(2),))
    assert axis_models(as_json({"x": model}))["x"].terms == (term,)


def test_a_current_that_has_a_peak_by_itself_stays_one():
    term = found_in(lambda s: np.exp(-(((np.abs(s.v) - 6.0) / 1.5) ** 2)))
    assert isinstance(term.mechanism, Peak)


def test_what_it_takes_away_is_what_least_squares_say():
    rng = np.random.default_rng(3)
    n = 4000
    known = {"v_x": (rng.normal(0, 5, n), "mm/s"), "AR": (rng.uniform(0, 9, n), "mm²")}
    weights, values = rng.uniform(0.5, 2.0, n), rng.normal(0, 1, n)
    values += 0.4 * known["v_x"][0] * np.exp(-(((known["AR"][0] - 4.0) / 1.5) ** 2))
    gain, term = resonant("x", known, Coarse(np.arange(n), np.zeros(n, int), values, weights))[0]
    assert (term.mechanism.by, term.mechanism.signal, term.mechanism.form) == ("AR", "v_x", "u")
    rows = term.mechanism.over(known, dict(term.shape)) * np.sqrt(weights)[:, None]
    wanted = values * np.sqrt(weights)
    left = wanted - rows @ np.linalg.lstsq(rows, wanted, rcond=None)[0]
    assert gain == pytest.approx(wanted @ wanted - left @ left, rel=0.02)


def test_friction_along_its_own_travel_has_a_name_and_is_not_asked_for():
    rng = np.random.default_rng(4)
    known = {"v_x": (rng.normal(0, 5, 500), "mm/s"), "pos_x": (rng.uniform(0, 100, 500), "mm")}
    few = Coarse(np.arange(500), np.zeros(500, int), known["v_x"][0] * known["pos_x"][0], np.ones(500))
    assert resonant("x", known, few) == []


def test_its_middle_stays_within_what_is_met_of_the_quantity():
    term = found_in(lambda s: 1 / (1 + (s.others["y"].v / 3.0) ** 2) * s.held * s.moving, strength=4.0)
    if isinstance(term.mechanism, Resonant):
        assert dict(term.shape)["c"] >= 0
    law = Resonant("v_y", "v_x", "u", "mm/s", "mm/s", even=True, ends=(0.0, 12.0))
    assert law.moved({"c": 1.0, "b": 4.0}, np.array([-1.0, 0.0])) == {"c": 0.0, "b": 4.0}
    assert law.around("c", {"c": 11.0, "b": 4.0}, []) == (7.0, 12.0)


def test_it_says_where_it_is_otherwise():
    law = Resonant("v_sp", "v_y", "sgn u", "mm/s", "deg/s", even=True, ends=(0.0, 1e5))
    said, _ = law.conditions("y", {"c": 82800.0, "b": 6700.0})
    assert said == "with sgn(v_y), more or less of it around |v_sp| = 8.28e+04 deg/s"
    assert law.equation == "dI = (k_0 + k * exp(-((|v_sp| - c) / b)^2)) * sgn(v_y)"
    assert Term(law, (("c", 82800.0), ("b", 6700.0))).mechanism.reads == {"v_sp", "v_y"}
