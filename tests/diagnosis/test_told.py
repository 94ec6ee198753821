"""What an operator reads of a finding, of effects whose truth is known: which way it goes, and when it is there."""

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.answers import words
from pido.diagnosis.arms import Arm, Eased
from pido.diagnosis.gates import PATH_SPEED, Gate
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term

BY_ID = {m.id: m for m in CATALOGUE}
SLOWEST, FASTEST = 9000.0, 30000.0  # deg/s, of a spindle that also stands


def states(spindle=(SLOWEST, FASTEST), rows=4000):
    """x goes to and fro all the time; y moves, the spindle turns and coolant is on in every other stretch of time."""
    t = np.arange(rows) * 0.02
    on = (t // 8) % 2
    v_x, v_y = 10 * np.sin(t), on * (6 + 4 * np.cos(t))
    speed = on * np.where((t // 16) % 2, *spindle)
    columns = {"time": t, "v_x": v_x, "v_y": v_y, "v_sp": speed, "coolant": on, "curr_x_sim": 0.1 * v_x}
    columns |= {f"a_{a}": np.gradient(columns[f"v_{a}"], t) for a in ("x", "y", "sp")}
    columns |= {f"pos_{a}": np.cumsum(columns[f"v_{a}"]) * 0.02 for a in "xy"}
    return axis_states([Recording(PartInfo(part="p1", machine="m"), columns)], "x")


def eased(k_0, k_1, c, by="v_sp", **how):
    unit = "deg/s" if by == "v_sp" else "mm/s"
    return words(Term(Eased(by, "v_x", "sgn u", "mm/s", unit), (("c", c),)), states(**how), {"k_0": k_0, "k_1": k_1})


def test_a_law_that_is_whole_at_the_slowest_turning_is_told_as_turning():
    told = eased(0.26, -0.26, 0.05 * SLOWEST)
    assert told.name == "more friction while the spindle turns"
    assert told.name in told.summary
    assert "deg/s" not in told.summary
    assert set(told.conditions) == {"v_x != 0", "v_sp != 0"}
    assert "while the spindle stands" in told.to_record


def test_a_law_that_changes_over_the_speeds_of_the_spindle_is_told_by_its_numbers():
    told = eased(0.26, -0.26, SLOWEST)
    assert told.name == ""
    assert "deg/s" in told.summary


@pytest.mark.parametrize(
    ("k_0", "k_1", "name", "condition"),
    [
        (-0.2, 0.21, "less friction while the spindle turns", "v_sp != 0"),
        (0.01, 0.2, "more friction while the spindle stands", "v_sp = 0"),
        (0.1, 0.2, "less friction while the spindle turns, and more than simulated while the spindle stands", None),
    ],
)
def test_more_or_less_and_on_or_off_follow_the_sizes(k_0, k_1, name, condition):
    told = eased(k_0, k_1, 300.0)
    assert told.name == name
    assert told.conditions == ("v_x != 0", condition)[: 1 + (condition is not None)]


def test_another_axis_moves_and_coolant_is_on():
    assert eased(0.2, -0.2, 0.1, by="v_y").name == "more friction while the y axis moves"
    oil = words(Term(Arm("coolant", "v_x", "mm/s", "–", form="sgn u")), states(), {"k_0": 0.0, "k_1": -0.2})
    assert oil.name == "less friction while coolant is on"


def test_a_spindle_that_never_stands_is_no_switch():
    always = states()
    turning = [s for s in axis_states([_turning(always)], "x")]
    term = Term(Eased("v_sp", "v_x", "sgn u", "mm/s", "deg/s"), (("c", 300.0),))
    assert words(term, turning, {"k_0": 0.26, "k_1": -0.26}).name == ""


def _turning(states):
    (s,) = states
    columns = {"time": s.time, "v_x": s.v, "a_x": s.a, "pos_x": s.pos, "v_sp": np.full(len(s.time), SLOWEST)}
    return Recording(PartInfo(part="p1", machine="m"), {**columns, "a_sp": 0 * s.time, "curr_x_sim": s.sim})


@pytest.mark.parametrize(
    ("gate", "said"),
    [
        (Gate("|v_y|", low=1.0), "only while the y axis moves (|v_y| > 1 mm/s)"),
        (Gate("|v_y|", high=1.0), "only while the y axis stands (|v_y| < 1 mm/s)"),
        (Gate("|v_y|", low=6.0), "only where |v_y| > 6 mm/s"),
        (Gate("|v_y|", low=1.0, high=6.0), "only where |v_y| > 1 mm/s and |v_y| < 6 mm/s"),
        (Gate("v_x", low=1.0), "only where v_x > 1 mm/s"),
        (Gate(PATH_SPEED, low=1.0), "only where path speed > 1 mm/s"),  # it never stands
    ],
)
def test_a_limit_below_the_slowest_motion_means_motion(gate, said):
    told = words(Term(BY_ID["coulomb_friction"], (("rest", 0.0), ("v_0", 0.1)), (gate,)), states())
    assert told.summary.endswith(f", {said}")
    assert gate.condition in told.conditions


@pytest.mark.parametrize(
    ("along", "rises", "size", "said"),
    [
        (1, 0, 0.5, "friction that falls"),  # T exp(-t/tau) against the motion goes to nothing
        (1, 0, -0.5, "friction that grows"),
        (1, 1, 0.5, "friction that grows"),
        (1, 1, -0.5, "friction that falls"),
        (2, 1, -0.02, "friction that goes with the speed and falls"),
        (0, 0, -0.5, "a load that fades"),
        (0, 1, 0.5, "a load that builds up"),
    ],
)
def test_what_warms_is_called_what_it_is_and_says_which_way_it_goes(along, rises, size, said):
    shape = {"tau": 234.0, "clock": 2.0, "along": float(along), "rises": float(rises)}
    told = words(Term(BY_ID["thermal_drift"], tuple(shape.items())), states(), {"T": size})
    assert told.name.startswith(said)
    assert "234 s" in told.summary
    assert ("by 0.5 A" in told.summary) == (along < 2)
    assert said.rsplit(" ", 1)[1] in told.summary
    assert "pauses" in told.summary


def test_a_scale_is_told_as_a_factor():
    assert words(Term(BY_ID["sensor_gain"]), states(), {"g - 1": 0.0699}).summary.endswith("× 1.070")


@pytest.mark.parametrize(
    ("full", "said", "conditions"),
    [
        (0, "within 0.0268 mm after a reversal of the x axis", ("travel since reversal < 0.0268",)),
        (1, "whichever way the x axis moves and while it holds, its sign turning within 0.0268 mm", ()),
        (2, "after a reversal of the x axis and at standstill", ("travel since reversal < 0.0268 or v_x = 0",)),
    ],
)
def test_presliding_friction_is_told_to_act_where_its_form_does(full, said, conditions):
    term = Term(BY_ID["presliding_hysteresis"], (("x_0", 0.0268 / 3), ("full", float(full))))
    told = words(term, states(), {"F_p": 0.3})
    assert said in told.summary
    assert told.conditions == conditions
    column = term.columns(states())[0]
    away = np.concatenate([s.moving & (s.since_reversal > 1.0) for s in states()])  # mm, forty times the way
    assert bool(np.any(np.abs(column[away]) > 0.5)) == (full == 1)
    assert ("after each reversal" in told.name) == (full == 1)


@pytest.mark.parametrize(
    ("form", "knee", "gates", "high"),
    [
        (1, 1.0, (), True),
        (0, 0.9, (), True),
        (1, 1.0, (Gate("v_x", low=-2.0, high=2.0),), False),  # 0.1 A/(mm/s) * 2 mm/s, of 1 A
        (0, 0.1, (Gate("v_x", low=-2.0, high=2.0),), False),
        (1, 1.0, (Gate("v_x", low=8.0),), True),
    ],
)
def test_a_saturation_is_told_of_high_torque_only_where_the_current_is_high(form, knee, gates, high):
    term = Term(BY_ID["current_saturation"], (("I_k", knee), ("form", float(form))), gates)
    summary = words(term, states(), {"s": -0.1}).summary
    assert ("high torque" in summary) == high
    assert ("at currents of at most 0.19" in summary) == (not high)  # 95 % of the rows there
    assert ("low beside the axis' 1 A" in summary) == (not high)
