"""A simulation that is of something else is told as that, and no physics is made of it."""

from dataclasses import replace

import numpy as np
import pytest

from pido.core.errors import DiagnosisError
from pido.core.recording import Recording
from pido.diagnosis.belongs import of_another
from pido.diagnosis.diagnose import diagnose
from tests.diagnosis.feeds import NOISE, recordings


def parts() -> list[Recording]:
    """x in motion and the spindle, both simulated as they are but for noise."""
    rng = np.random.default_rng(7)
    return [
        r.with_columns(**{f"curr_{a}": r[f"curr_{a}_sim"] + rng.normal(0, NOISE, len(r)) for a in ("x", "sp")})
        for r in recordings()
    ]


def simulated(recording: Recording, values) -> Recording:
    return recording.with_columns(curr_x_sim=values)


def test_a_simulation_that_is_its_own_is_compared_whatever_it_lacks():
    rng = np.random.default_rng(3)
    for r in (made := parts()):
        poor = simulated(r, 0.004 * r["a_x"])  # without all friction
        loud = r.with_columns(curr_x=r["curr_x"] + rng.normal(0, 1.0, len(r)))
        late = simulated(r, np.roll(r["curr_x_sim"], 150))
        biased = simulated(r, 0.1 * r["curr_x_sim"] + 5)
        for each in (poor, loud, late, biased, simulated(r, np.zeros(len(r)))):
            assert of_another([each, *(o for o in made if o is not r)], "x") is None


@pytest.mark.parametrize("rate", [0.5, 2.0])
def test_rows_of_another_rate_are_told_with_the_time_between_them(rate):
    made = [simulated(r, np.interp(np.arange(len(r)) / rate, np.arange(len(r)), r["curr_x_sim"])) for r in parts()]
    reason = of_another(made, "x")
    assert reason is not None
    assert f"its rows are {20 / rate:.4g} ms apart, not 20 ms" in reason
    assert "As wrong in p1, p2" in reason


def test_the_simulation_of_another_part_is_told_with_that_part():
    first, second, third = parts()
    made = [first, simulated(second, third["curr_x_sim"]), simulated(third, second["curr_x_sim"])]
    reason = of_another(made, "x")
    assert reason is not None
    assert reason.startswith("in part p1, 'curr_x_sim' is another part's: the recording follows that of part p2")


def test_the_simulation_of_another_axis_is_told_with_that_axis():
    made = [r.with_columns(curr_x_sim=r["curr_sp_sim"], curr_sp_sim=r["curr_x_sim"]) for r in parts()]
    reason = of_another(made, "x")
    assert reason is not None
    assert "the recording follows 'curr_sp_sim'" in reason


def test_two_axes_that_move_together_are_not_exchanged_because_one_lacks_its_friction():
    rng = np.random.default_rng(8)
    made = [
        replace(r, columns={k: v for k, v in r.columns.items() if "_sp" not in k}).with_columns(
            curr_x_sim=0.004 * r["a_x"],
            curr_y=r["curr_x"] + rng.normal(0, NOISE, len(r)),
            curr_y_sim=r["curr_x_sim"],
        )
        for r in parts()
    ]
    assert of_another(made, "x") is None


def test_a_simulation_that_follows_nothing_is_told_where_all_it_could_follow_is_there():
    rng = np.random.default_rng(4)
    strange = [simulated(r, np.convolve(rng.normal(0, 1, len(r)), np.ones(30) / 8, "same")) for r in parts()]
    assert of_another(strange, "x") is None  # what it follows, a process force, may not be among the columns
    loaded = [r.with_columns(mrr_sim=np.abs(r["v_x"])) for r in strange]
    reason = of_another(loaded, "x")
    assert reason is not None
    assert "nor any speed, acceleration or load of this part" in reason


def test_the_axis_is_left_out_with_the_reason_and_the_others_get_their_answer():
    turned = [simulated(r, -r["curr_x_sim"]) for r in parts()]
    found = diagnose(turned)
    assert found.findings == ()
    assert found.clean_axes == ("sp",)
    assert any("axis x is left out: in part p" in n and "'curr_x_sim' has the opposite sign" in n for n in found.notes)
    only = [replace(r, columns={k: v for k, v in r.columns.items() if "_sp" not in k}) for r in turned]
    with pytest.raises(DiagnosisError, match="opposite sign"):
        diagnose(only)
