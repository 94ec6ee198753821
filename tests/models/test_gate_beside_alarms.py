"""What the gate makes of parts that are full of alarms, and of errors that no earlier part had."""

import numpy as np
import pytest

from pido.models.promotion import gate

EQUAL = np.array([0.2, 0.2, 0.2, 0.5])


def shares(*x_y_z_sp: float) -> np.ndarray:
    return np.array(x_y_z_sp)


def judged(parts: list[str], alarmed=None, **more):
    errors = dict.fromkeys(parts, EQUAL)
    return gate(errors, errors, alarmed=alarmed, **more)


def test_an_axis_that_is_mostly_open_alarms_on_the_only_part_does_not_pass_and_the_reason_is_in_words():
    said = judged(["p3"], {"p3": shares(0.9, 0.0, 0.0, 0.0)})
    assert not said.passed
    assert [a.axis for a in said.axes if not a.passed] == ["x"]
    assert "open alarms cover 90%" in said.words
    assert judged(["p3"]).passed


def test_one_part_of_several_that_is_full_of_alarms_is_said_and_stops_nothing():
    said = judged(["p2", "p3"], {"p3": shares(0.9, 0.0, 0.3, 0.0)})
    assert said.passed
    assert said.alarms == ("alarms that nobody has answered cover part p3 by x 90%, z 30%",)
    assert said.alarms[0] in said.words


@pytest.mark.parametrize("share", [0.0, 0.05, 0.1, np.nan])
def test_few_alarms_or_an_axis_that_was_not_recorded_are_not_spoken_of(share):
    said = judged(["p3"], {"p3": shares(share, 0.0, 0.0, 0.0)})
    assert said.passed
    assert said.alarms == ()


@pytest.mark.parametrize(("before", "doubted"), [(0.019, True), (0.021, False), (np.nan, False)])
def test_errors_of_both_sides_ten_times_those_of_all_parts_before_are_said(before, doubted):
    said = judged(["p3"], earlier={"p3": {"p1": shares(0.001, 1, 1, 1), "p2": shares(before, 1, 1, 1)}})
    if np.isnan(before):
        said = judged(["p3"], earlier={"p3": {"p2": shares(before, 1, 1, 1)}})
    assert said.passed
    assert bool(said.doubts) is doubted
    assert ("x 0.2 A beside at most 0.019 A" in said.words) is doubted


def test_errors_of_one_side_alone_are_what_the_gate_compares_anyway():
    said = gate({"p3": EQUAL}, {"p3": 0.01 * EQUAL}, earlier={"p3": {"p2": 0.01 * EQUAL}})
    assert not said.passed
    assert said.doubts == ()
