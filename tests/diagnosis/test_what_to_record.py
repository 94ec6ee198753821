"""Which recording tells more about a law without a name: by what it hangs on, and what the data at hand leave open."""

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.answers import to_record
from pido.diagnosis.arms import Arm
from pido.diagnosis.dynamics import Ringing
from pido.diagnosis.formulas import LEVEL, Formula, Surface
from pido.diagnosis.gates import Gate
from pido.diagnosis.late import Lagged
from pido.diagnosis.signals import signals
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from pido.diagnosis.unknowns import recording_of_unknown
from pido.diagnosis.waves import Wave


def states(**changed):
    """x, y and z go their own ways; a tool cuts now and then. 50 samples per second."""
    t = np.arange(6000) / 50.0
    ways = {"x": (50, 1.0, 2.3), "y": (30, 1.7, 0.4), "z": (9, 0.6, 1.9)}
    columns = {f"pos_{a}": k * (np.sin(f * t + k) + 0.4 * np.sin(g * t)) for a, (k, f, g) in ways.items()}
    columns |= {"time": t}
    columns |= {f"v_{a}": np.gradient(columns[f"pos_{a}"], t) for a in "xyz"}
    columns |= {f"a_{a}": np.gradient(columns[f"v_{a}"], t) for a in "xyz"}
    columns |= {"v_sp": 12000.0 + 6000 * np.sin(0.2 * t), "a_sp": 1200 * np.cos(0.2 * t), "coolant": t // 20 % 2}
    columns |= {
        "mrr_sim": 200.0 * (t // 7 % 2) * (1 + 0.5 * np.sin(0.9 * t)),
        "f_x_sim": 90 * (t // 7 % 2) * np.sin(3 * t),
    }
    columns |= {"m_sp_sim": 2.0 * (t // 7 % 2) * (1 + 0.5 * np.cos(1.3 * t))} | changed
    return axis_states([Recording(PartInfo(part="p1", machine="m", start_time_s=0.0), columns)], "x")


def formula(*names):
    return Term(Formula(tuple((n, "u") for n in names), "(mm/s)"))


@pytest.mark.parametrize(
    ("term", "says"),
    [
        (formula("v_y"), "moves of the y axis alone in the air at five speeds from 0."),
        (formula("MRR"), "the same path with material, at two depths of cut, and without it"),
        (Term(Surface(("pos_z",), ((-9.0, 0.0, 9.0),), (False,))), "move of the z axis over its whole travel"),
        (Term(Wave("pos_y", "mm", "", "–"), (("L", 12.0),)), "move of the y axis over its whole travel"),
        (formula("uptime"), "at start-up, after an hour of running and after an hour's pause"),
        (formula("v_sp"), "the idling spindle at five speeds from 1000 to 3000 rpm"),
        (formula("a_z"), "of the z axis at one feed with the acceleration limited"),
        (formula("coolant"), "coolant on and off every 10 s"),
        (formula("d_x"), "to and fro moves"),
        (formula("rested_x"), "stops of 1, 3, 10 and 30 s"),
        (Term(LEVEL, gates=(Gate("AR", low=2.0),)), "with material, at two depths of cut, and without it"),
    ],
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_the_recording_changes_what_the_law_hangs_on(term, says):
    asked = to_record(term, None, states=states())
    assert says in asked
    assert "correlation" not in asked  # here everything goes its own way


def test_every_signal_that_a_law_may_hang_on_has_a_recording():
    (state,) = states()
    for name in signals(state):
        assert to_record(formula(name), None, states=[state]), name


def test_two_quantities_are_changed_one_at_a_time():
    asked = to_record(Term(Arm("pos_y", "v_x", "mm/s")), None, states=states())
    assert "moves of the x axis alone" in asked
    assert "move of the y axis over its whole travel" in asked
    assert asked.endswith("what only their product makes is not")


def test_what_goes_with_the_quantity_in_these_data_is_named():
    (plain,) = states()
    asked = to_record(formula("v_x"), None, states=states(v_z=0.2 * plain.v + 0.05, a_z=0.2 * plain.a))
    assert asked.startswith(
        "in these data the speed of the x axis goes with the speed of the z axis (correlation 1.00)"
    )


def test_one_direction_is_said_to_be_one():
    (plain,) = states()
    asked = to_record(formula("v_x"), None, states=states(v_x=np.abs(plain.v)))
    assert "the speed of the x axis has one direction only in these data" in asked


def test_what_rings_needs_samples_and_what_is_late_needs_time():
    ringing = to_record(Term(Ringing("a_x", "mm/s²"), (("f", 8.0), ("zeta", 0.05))), None, states=states())
    assert "record at least 80 samples per second; these data have 50" in ringing
    slow = to_record(Term(Lagged("v_x", "u", "mm/s"), (("tau", 40.0),)), None, states=states())
    assert "40 s late: hold each for 120 s" in slow


def test_what_has_a_name_or_hangs_on_nothing_asks_for_no_recording():
    assert recording_of_unknown(Term(LEVEL), states()) == ""
    assert to_record(formula("v_x"), None) == ""
