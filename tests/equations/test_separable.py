import numpy as np
import pytest

from pido.equations.separable import Columns
from pido.equations.weights import Kernel


def cells(offset, seed=0):
    """Cells on a ragged grid, their centroids up to `offset` beside the grid's points, and sums of either sign."""
    rng = np.random.default_rng(seed)
    index = np.argwhere(rng.random((12, 9, 7)) < 0.6)
    points = index * [1.0, 1.0, 10.0] + offset * rng.uniform(-1, 1, (len(index), 3)) * [1.0, 1.0, 10.0]
    return index, points, rng.integers(1, 50, len(index)).astype(float), rng.normal(size=(len(index), 6))


def bins(seed=1, n=80):
    rng = np.random.default_rng(seed)
    return (
        np.unique(
            np.column_stack([rng.integers(-2, 14, n), rng.integers(-2, 11, n), 10 * rng.integers(0, 7, n)]), axis=0
        )
        + 0.5
    )


def direct(index, points, counts, rows, centres, kernel):
    w = Kernel(kernel.alpha, 0.0, kernel.sigma).weights(centres, points)
    return w @ rows, w @ counts, w**2 @ counts


def test_dimension_by_dimension_gives_what_all_pairs_give_where_cells_lie_on_the_grid():
    kernel, centres, made = Kernel(0.1, 0.02, 3.0), bins(), cells(0.0)
    index, points, counts, rows = made
    found = Columns(points, index, counts, rows).sums(centres, kernel)
    for got, expected in zip((found.sums, found.total, found.squared), direct(*made, centres, kernel), strict=True):
        np.testing.assert_allclose(got, expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("sigma", [2.0, 4.0])
def test_what_the_slope_misses_falls_with_the_square_of_the_way_to_the_grid(sigma):
    kernel, centres = Kernel(0.1, 0.02, sigma), bins()
    errors = []
    for offset in (0.2, 0.1):
        index, points, counts, rows = made = cells(offset)
        found = Columns(points, index, counts, rows).sums(centres, kernel)
        errors.append(np.sqrt(np.mean((found.sums - direct(*made, centres, kernel)[0]) ** 2)))
        assert errors[-1] < (offset / sigma) ** 2 * np.abs(rows).sum(axis=0).max()
    assert 3.0 < errors[0] / errors[1] < 5.0


def test_the_way_and_the_operations_are_those_of_the_cells_at_hand():
    index = np.array([[0, 0, 0], [0, 0, 1], [0, 3, 0], [5, 0, 0]])
    points = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 10.0], [0.0, 3.0, 0.0], [5.0, 0.0, 0.0]])
    made = Columns(points, index, np.ones(4), np.ones((4, 1)))
    assert made.way() == pytest.approx(0.1)
    # 4 cells, 3 columns, 2 slabs; bins: 2 AR, 3 pairs (v_y, AR), 4 in all
    centres = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 10.0], [0.0, 2.0, 10.0]])
    assert made.operations(centres) == 3 * 4 * 2 + 3 * 3 * 3 + 2 * 2 * 4
