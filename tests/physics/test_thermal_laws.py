"""Warming and cooling against the differential equation."""

import numpy as np
import pytest

from pido.physics.thermal import coldness, coldness_after


def test_a_machine_warms_by_63_percent_in_one_time_constant():
    np.testing.assert_allclose(coldness(np.array([0.0, 60.0, 6e4]), tau=60.0), [1.0, np.exp(-1), 0.0], atol=1e-12)


@pytest.mark.parametrize("tau", [20.0, 300.0])
def test_running_and_pausing_follow_the_first_order_equation_integrated_step_by_step(tau):
    runs = [(10.0, 70.0), (100.0, 180.0), (900.0, 1000.0)]
    start, step = 1100.0, 0.02
    warm = 0.0
    for t in np.arange(runs[0][0], start, step):
        running = any(a <= t < b for a, b in runs)
        warm += step * ((1.0 if running else 0.0) - warm) / tau
    assert coldness_after(runs, start, tau) == pytest.approx(1 - warm, abs=2e-3)


def test_a_machine_is_cold_before_its_first_part_and_after_a_long_pause():
    assert coldness_after([], 5.0, 60.0) == 1.0
    assert coldness_after([(0.0, 500.0)], 1e6, 60.0) == pytest.approx(1.0)


def test_without_pauses_the_parts_make_one_run():
    assert coldness_after([(0.0, 40.0), (40.0, 90.0)], 90.0, 60.0) == pytest.approx(np.exp(-90 / 60))
