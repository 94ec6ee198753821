import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import wasserstein_distance_nd

from pido.core.errors import FitError
from pido.feature_space.density import balance, occupancy, relevant_bins
from pido.feature_space.distance import wasserstein
from pido.feature_space.grid import Grid, touched

width = st.tuples(*[st.floats(0.01, 50.0)] * 3)
finite = st.floats(-600.0, 600.0)
point = st.tuples(finite, finite, finite)


@given(width, st.lists(point, min_size=1, max_size=30))
def test_every_finite_sample_lies_in_exactly_one_half_open_bin(width, points):
    grid, points = Grid(width), np.array(points)
    ids = grid.ids(points)
    assert ((grid.low(ids) <= points) & (points < grid.high(ids))).all()


@given(width, st.tuples(*[st.integers(-400, 400)] * 3))
def test_a_lower_edge_belongs_to_its_bin_and_an_upper_one_to_the_next(width, index):
    grid = Grid(width)
    edge = np.array([index]) * np.array(width)
    assert grid.index(grid.ids(edge)).tolist() == [list(index)]
    below = np.nextafter(edge, -np.inf)
    assert grid.index(grid.ids(below)).tolist() == [[i - 1 for i in index]]


@given(width, st.lists(point, min_size=1, max_size=30))
def test_ids_name_their_bins_and_centres_lie_in_them(width, points):
    grid = Grid(width)
    ids = grid.ids(np.array(points))
    assert (grid.id_of(grid.index(ids)) == ids).all()
    assert (grid.ids(grid.centres(ids)) == ids).all()


def test_a_missing_value_is_refused_and_not_put_anywhere():
    with pytest.raises(FitError, match="point 1"):
        Grid().ids(np.array([[0.0, 0, 0], [np.nan, 0, 0]]))


def test_counts_add_up_and_centroids_are_means():
    points = np.array([[0.5, 0.5, 0.5], [1.5, 0.5, 1.5], [3.0, 0.5, 0.5]])
    found = occupancy(points, Grid())
    assert found.count.tolist() == [2, 1]
    np.testing.assert_allclose(found.centroid, [[1.0, 0.5, 1.0], [3.0, 0.5, 0.5]])


def test_an_even_set_has_balance_zero_and_empty_relevant_bins_count():
    path = np.array([[1.0, 1, 1], [3.0, 1, 1]])
    bins = relevant_bins(np.vstack([path, [[np.nan, 0, 0]]]), Grid())
    assert balance(path, bins, Grid()) == 0.0
    assert balance(np.repeat(path[:1], 4, axis=0), bins, Grid()) == pytest.approx(2.0)  # counts 4 and 0


@given(st.lists(point, min_size=1, max_size=8))
def test_bins_of_another_grid_that_share_volume_hold_every_point_of_a_bin(points):
    coarse, fine = Grid((2.0, 2.0, 2.0)), Grid((1.0, 1.0, 10.0))
    bins = np.unique(coarse.ids(np.array(points)))
    low, high = coarse.low(bins), coarse.high(bins)
    inside = low + np.random.default_rng(0).random((50, *low.shape)) * (high - low) * (1 - 1e-12)
    assert np.isin(fine.ids(inside.reshape(-1, 3)), touched(bins, coarse, fine)).all()


def test_wasserstein_distance_agrees_with_a_linear_programme_on_the_points_themselves():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(40, 3)), rng.normal(loc=2.0, size=(30, 3))
    fine = Grid((1e-3, 1e-3, 1e-3))
    assert wasserstein(a, b, fine) == pytest.approx(wasserstein_distance_nd(a, b), rel=1e-6)
    assert wasserstein(a, b) == pytest.approx(wasserstein_distance_nd(a, b), abs=2 * np.sqrt(12))
    assert wasserstein(a, a) == pytest.approx(0.0, abs=1e-6)
