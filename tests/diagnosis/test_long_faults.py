"""A fault that lasts for much of a part is found from its begin to its end, and does not pass for what is usual."""

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.faults import input_faults
from tests.diagnosis.test_input_faults import axis_in_motion


def _for_a_while(clean: Recording, factor, first_s: float, last_s: float) -> Recording:
    rows = (clean.time >= first_s) & (clean.time <= last_s)
    return clean.with_columns(v_x=np.where(rows, factor * clean["v_x"], clean["v_x"]))


def _in_motion_at(clean: Recording, second: float) -> float:
    """s – the first moment from `second` on at which the axis moves fast."""
    return float(clean.time[np.flatnonzero((clean.time >= second) & (np.abs(clean["v_x"]) > 6.0))[0]])


@pytest.mark.parametrize("rate", [50.0, 100.0, 500.0])
@pytest.mark.parametrize("seed", [0, 2, 5])
@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (0.06, "like m/min in place of mm/s"),
        (60.0, "like mm/min in place of mm/s"),
        (1 / 0.06, "like mm/s in place of m/min"),
        (1 / 25.4, "inch/s in place of mm/s"),
        (0.001, "like m/s in place of mm/s"),
        (1.7, "times it throughout"),
    ],
)
def test_a_speed_in_another_unit_for_a_third_of_a_part_is_wrong_throughout_and_nothing_else_is(
    rate, seed, factor, words
):
    clean = axis_in_motion(rate, seed)
    first, last = _in_motion_at(clean, 11.0), _in_motion_at(clean, 24.0)
    found = input_faults(_for_a_while(clean, factor, first, last))
    assert set(found) == {"v_x"}
    (fault,) = found["v_x"]
    assert (fault.t_start, fault.t_end) == (pytest.approx(first, abs=0.1), pytest.approx(last, abs=0.1))
    assert words in fault.reason


def test_a_speed_that_a_wandering_factor_spoils_is_of_no_unit():
    clean = axis_in_motion(100.0, 2)
    found = input_faults(_for_a_while(clean, 0.3 + 0.2 * np.sin(clean.time), 11.0, 24.0))
    assert "v_x" in found
    assert all("throughout" not in f.reason for f in found["v_x"])


@pytest.mark.parametrize("late_s", [0.0, 0.05])
def test_a_speed_that_is_late_throughout_is_no_long_fault(late_s):
    """Turns within half a second, rests of ten, and slow feeds beside rapids."""
    t = np.arange(0.0, 90.0, 0.01)

    def speed(t):
        quick = 80.0 * np.sin(2 * np.pi * t) * (np.mod(t, 30.0) > 15.0) * (np.mod(t, 30.0) < 20.0)
        return quick + 1.5 * np.sin(0.7 * t) * (np.mod(t, 30.0) < 15.0)

    rng = np.random.default_rng(3)
    a = np.gradient(speed(t), t)
    columns = {"time": t, "pos_x": np.cumsum(speed(t)) * 0.01, "v_x": speed(t - late_s) + rng.normal(0, 0.02, len(t))}
    assert input_faults(Recording(PartInfo(part="p", machine="m"), columns | {"a_x": a})) == {}
