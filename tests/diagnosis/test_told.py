"""What an operator reads of a finding, of effects whose truth is known: which way it goes, and when it is there."""

import re

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.answers import equation_text, words
from pido.diagnosis.arms import Arm, Eased
from pido.diagnosis.bends import Bend
from pido.diagnosis.formulas import Formula, Peak, Surface
from pido.diagnosis.gates import PATH_SPEED, Gate
from pido.diagnosis.latched import Latched, Switched
from pido.diagnosis.late import Fading, Lagged, Modulated
from pido.diagnosis.late_arms import LaggedArm
from pido.diagnosis.late_eased import EasedLately
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.signals import signals
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from pido.diagnosis.waves import Wave

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
        (3, "within 0.0268 mm after a reversal of the x axis", ("travel since reversal < 0.0268",)),
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


NAMELESS = [
    (Surface(("v_x", "v_y"), ((-20.0, 30.0), (0.0, 4.0)), (False, False)), {}, "the x axis from -20 to 30 mm/s"),
    (Formula((("a_x", "u"), ("pos_y", "u²")), "mm/s²"), {}, "acceleration of the x axis and the position of"),
    (Peak("v_sp", "deg/s", True), {"c": 18000.0, "w": 900.0}, "either way, is about 18000 deg/s (3000 rpm)"),
    (Bend("pos_x", (10.0, 250.0)), {}, "the position of the x axis from 10 to 250 mm"),
    (Bend("pos_y", (10.0, 250.0), "v_x"), {}, "turning with the direction of motion of the x axis"),
    (Arm("pos_y", "v_x", "mm/s", form="sgn u"), {}, "how far the y axis is from some place"),
    (Lagged("I_x", "u", "A"), {"tau": 0.5}, "the simulated current of the x axis 0.5 s late"),
    (Fading("feed", "u", "mm/s"), {"tau": 0.5}, "changes of the speed along the path"),
    (LaggedArm("v_x", "u", "mm/s", "pos_y", "mm"), {"tau": 0.5}, "how far the y axis is from some place"),
    (Modulated("v_x", "sgn u", "v_sp", "u", "deg/s"), {"tau": 30.0}, "changing with what the speed of the spindle was"),
    (EasedLately("feed", "v_x", "sgn u", "mm/s", "mm/s"), {"tau": 3.0, "c": 5.0},
     "changing with what the speed along the path was in the last 3 s up to some 5 mm/s"),
    (Latched("v_y", "mm/s", True), {"c": 3.0, "T": 2.0}, "the speed of the y axis, either way, is above 3 mm/s"),
    (Switched("feed", "mm/s", False, "I_x", "A"), {"c_on": 9.0, "c_off": 2.0},
     "with the simulated current of the x axis, once the speed along the path is above 9 mm/s"),
    (Wave("pos_x", "mm", "I_x", "A", form="|u|"), {"L": 20.0}, "every 20 mm of the position of the x axis"),
]  # fmt: skip


@pytest.mark.parametrize(("law", "shape", "said"), NAMELESS, ids=lambda v: type(v).__name__)
def test_a_law_without_a_name_is_told_in_words_with_units(law, shape, said):
    term, here = Term(law, tuple(shape.items())), states()
    told = words(term, here)
    assert said in told.summary
    for name in signals(here[0]):
        if name != "coolant":  # which is its own word
            assert not re.search(rf"(?<![a-z ]){re.escape(name)}\b|\b[avf]_|pos_|I_", told.summary), told.summary
    assert told.conditions == law.conditions("x", shape)[1]  # as the contract writes them


def test_a_formula_explains_the_loads_in_it_which_are_no_columns_and_names_their_units():
    text = equation_text(Term(Formula((("v_x", "u"), ("MRR", "u")), "(mm/s)·(mm³/s)")), "x")
    assert text == "dI_x = k * v_x * MRR; MRR = material removal rate, column mrr_sim, mm³/s"
