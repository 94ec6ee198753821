"""What an equation says where no sample has been."""

import numpy as np
import pytest

from pido.config import machine
from pido.core.columns import INPUTS
from pido.core.samples import Samples
from pido.equations.choose import choose, fit_chosen
from pido.feature_space.density import relevant_bins
from pido.feature_space.grid import EQUATION_GRID

DMC = machine("dmc60h")


def milled(n: int, seed: int) -> Samples:
    """A spindle that turns at one speed with a little ripple, and a current that follows the ripple and the torque."""
    rng = np.random.default_rng(seed)
    inputs = np.zeros((n, len(INPUTS)))
    inputs[:, 0] = rng.uniform(-8, 8, n)
    inputs[:, 6], inputs[:, 11] = 19_200 + rng.normal(0, 60, n), rng.uniform(0, 5, n)
    currents = rng.normal(0, 0.05, (n, 4))
    inputs[:, 7] = rng.normal(0, 30, n)
    currents[:, 3] += 20 + 0.002 * inputs[:, 7] + 0.4 * inputs[:, 11] - 0.004 * (inputs[:, 6] - 19_200)
    direction = np.column_stack([np.sign(inputs[:, 0]), np.zeros(n), np.zeros(n), np.ones(n)])
    return Samples.real(inputs, np.zeros(n), currents, direction, "p", np.arange(n))


@pytest.fixture(scope="module")
def fitted():
    real = milled(1500, 0)
    choice = choose(real, DMC, count=3)
    bins = relevant_bins(real.reduced, EQUATION_GRID)
    return real, [fit_chosen(real, bins, DMC, choice, blend=blend) for blend in (True, False)]


def test_a_state_that_no_sample_is_like_gets_a_current_near_the_mean(fitted):
    real, (contained, open_) = fitted
    stopped = milled(50, 1)
    stopped.inputs[:, 6] = 2_000.0  # the straight line through the ripple says 89 A there
    mean = real.currents[:, 3].mean()
    assert np.abs(contained.predict(stopped)[:, 3] - mean).max() < 5.0
    assert np.abs(open_.predict(stopped)[:, 3] - mean).max() > 20.0


def test_an_acceleration_that_no_sample_had_follows_newtons_law(fitted):
    _, (contained, open_) = fitted
    runs_up = milled(50, 4)
    runs_up.inputs[:, 7] = 9_000.0  # 300 times what the samples had, with a slope that is known to 2 %
    np.testing.assert_allclose(contained.predict(runs_up), open_.predict(runs_up), atol=0.02)
    assert np.abs(contained.predict(runs_up)[:, 3] - runs_up.currents[:, 3] - 0.002 * 9_000.0).max() < 2.0


def test_an_acceleration_whose_slope_nobody_knows_gets_a_current_near_the_mean(fitted):
    real, (contained, open_) = fitted
    runs_up = milled(50, 4)
    runs_up.inputs[:, 7] = 9e6
    mean = real.currents[:, 3].mean()
    assert (
        np.abs(contained.predict(runs_up)[:, 3] - mean).max() < 0.1 * np.abs(open_.predict(runs_up)[:, 3] - mean).min()
    )


def test_states_like_those_of_the_samples_keep_their_current(fitted):
    _, (contained, open_) = fitted
    new = milled(400, 2)
    same = np.isclose(contained.predict(new), open_.predict(new), atol=0.02).all(axis=1)
    assert same.mean() > 0.98


def test_both_ways_to_ask_give_the_same_current(fitted):
    _, (contained, _) = fitted
    rows = milled(60, 3)
    rows.inputs[::2, 6] = 5_000.0
    np.testing.assert_allclose(contained.predict(rows), contained.predict_with_support(rows)[0], atol=1e-9)
