"""Other ways to make rows: what each promises."""

import numpy as np
import pytest

from pido.core.samples import Samples
from pido.feature_space.grid import SAMPLING_GRID
from pido.sampling.rivals import ROW_RIVALS, dense_weights, geometric_smote, noise, smote


@pytest.fixture
def real() -> Samples:
    """A current that is linear in the inputs, in bins of some twenty rows."""
    rng = np.random.default_rng(0)
    n = 300
    inputs = rng.normal(size=(n, 13))
    inputs[:, :2] = rng.uniform(0, 8, (n, 2))
    currents = np.column_stack([inputs @ rng.normal(size=13) for _ in range(4)])
    return Samples.real(inputs, np.full(n, 3.0), currents, np.ones((n, 4)), "p", np.arange(n))


def asked(real):
    bins, count = np.unique(SAMPLING_GRID.ids(real.reduced), return_counts=True)
    return bins, np.where(count >= 2, 6, 0), count


@pytest.mark.parametrize("name", ["noise", "SMOTE-R", "geometric SMOTE"])
def test_each_bin_gets_what_was_asked_for(name, real):
    bins, number, _ = asked(real)
    made = ROW_RIVALS[name](real, bins, number, SAMPLING_GRID, np.random.default_rng(1))
    np.testing.assert_array_equal(np.array([(made.voxel == b).sum() for b in bins]), number)
    assert np.isfinite(made.currents).all()
    assert (made.row == -1).all()


def test_a_linear_current_stays_exact_between_two_rows(real):
    bins, number, _ = asked(real)
    made = smote(real, bins, number, SAMPLING_GRID, np.random.default_rng(1))
    coefficients = np.linalg.lstsq(real.inputs, real.currents, rcond=None)[0]
    np.testing.assert_allclose(made.inputs @ coefficients, made.currents, atol=1e-9)
    np.testing.assert_array_equal(SAMPLING_GRID.ids(made.reduced), made.voxel)  # a bin is convex


def test_geometric_smote_stays_in_the_sphere_through_a_neighbour(real):
    bins, number, _ = asked(real)
    made = geometric_smote(real, bins, number, SAMPLING_GRID, np.random.default_rng(1))
    spread = np.std(real.inputs, axis=0)
    ids = SAMPLING_GRID.ids(real.reduced)
    for row in range(0, len(made), 17):
        mine = real.inputs[ids == made.voxel[row]] / spread
        to_rows = np.linalg.norm(mine - made.inputs[row] / spread, axis=1)
        widest = np.linalg.norm(mine[:, None] - mine[None], axis=2).max()
        assert to_rows.min() <= widest


def test_noise_keeps_the_mean_and_adds_a_twentieth_of_the_spread(real):
    bins = np.unique(SAMPLING_GRID.ids(real.reduced))
    made = noise(real, bins, np.full(len(bins), 400), SAMPLING_GRID, np.random.default_rng(2))
    near = np.abs(made.inputs[:, None, 5] - real.inputs[None, :, 5]).min(axis=1)
    assert near.max() < 0.05 * 6 * np.std(real.inputs[:, 5])
    assert abs(made.currents.mean() - real.currents.mean()) < 0.5 * real.currents.std()


def test_rare_currents_weigh_more_and_the_mean_weight_is_one():
    rng = np.random.default_rng(0)
    currents = np.r_[rng.normal(0, 1, 950), rng.normal(12, 1, 50)][:, None].repeat(4, axis=1)
    weights = dense_weights(currents)
    np.testing.assert_allclose(weights.mean(axis=0), 1.0)
    assert weights[950:].mean() > 1.5 * weights[:950].mean()
    np.testing.assert_allclose(dense_weights(currents, alpha=0.0), 1.0)


@pytest.mark.parametrize("name", list(ROW_RIVALS))
def test_the_same_generator_makes_the_same_rows(name, real):
    bins, number, _ = asked(real)
    one, two = (ROW_RIVALS[name](real, bins, number, SAMPLING_GRID, np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(one.inputs, two.inputs)
    np.testing.assert_array_equal(one.currents, two.currents)
