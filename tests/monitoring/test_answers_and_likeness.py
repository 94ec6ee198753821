"""Answers change the band; the guess names the signal that the residual follows."""

import numpy as np
import pytest

from pido.monitoring.alarms import judge
from pido.monitoring.answers import Answer, to_calibrate_on
from pido.monitoring.band import learn
from pido.monitoring.likeness import looks_like
from pido.monitoring.residuals import PartResiduals


def _part(name: str, seed: int, step: float = 0.0) -> PartResiduals:
    rng = np.random.default_rng(seed)
    n = 3000
    residual = np.full((n, 4), np.nan)
    residual[:, 0] = rng.normal(size=n) * 0.05
    residual[1000:1100, 0] += step
    return PartResiduals(name, np.arange(n) / 50, residual, np.ones((n, 4)), np.full(n, "1"), np.zeros(n, np.int64))


def test_an_alarm_called_false_widens_the_band_and_one_called_true_does_not():
    good = [_part("a", 0), _part("b", 1)]
    odd = _part("c", 2, step=0.25)
    band = learn(good)
    (alarm,) = judge(odd, band).alarms
    parts = [*good, odd]
    width = {
        true: np.ptp(learn(to_calibrate_on(parts, [alarm], [Answer(alarm, true, "ann")])).limits("x", "1", 0))
        for true in (True, False)
    }
    assert width[False] > 1.2 * width[True]


@pytest.mark.parametrize(
    ("signal", "name"), [("v_x", "viscous_friction"), ("a_x", "inertia"), ("f_x_sim", "cutting_force")]
)
def test_the_guess_is_the_signal_that_the_residual_follows(signal, name):
    rng = np.random.default_rng(5)
    signals = {
        column: np.convolve(rng.normal(size=520), np.ones(21) / 21, "valid") for column in ("v_x", "a_x", "f_x_sim")
    }
    residual = signals[signal] + 0.05 * rng.normal(size=500)
    assert looks_like("x", residual, signals) == name


def test_a_residual_that_follows_nothing_is_unknown():
    rng = np.random.default_rng(6)
    assert looks_like("x", rng.normal(size=500), {"v_x": rng.normal(size=500)}) == "unknown"
