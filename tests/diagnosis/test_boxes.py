"""Sums over every box of a grid, against the rows themselves."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array

from pido.diagnosis import boxes
from pido.diagnosis.boxes import (
    cuts_of,
    fine_cuts_of,
    gains_of_each,
    gains_of_intervals,
    gains_together,
    grid_at,
    of_unit_length,
    own_products,
    places_in,
    places_of,
)
from pido.diagnosis.library import Basis
from pido.diagnosis.regions import _best_box


def variables(rng, n=400):
    """A feed in levels, a speed, and a removed area that is mostly none."""
    return {
        "v_x": rng.choice([-6.0, 0.0, 0.0, 3.0, 12.0], n),
        "v_y": rng.normal(size=n),
        "AR": np.maximum(0.0, rng.normal(size=n)),
    }


def rows_of(box, grid, known):
    inside = np.ones(len(known["v_x"]), bool)
    for gate in grid.gates(box):
        inside &= (known[gate.variable] >= gate.low) & (known[gate.variable] < gate.high)
    return inside


@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0, 1, exclude_max=True))
def test_the_sum_over_a_box_is_that_of_the_rows_within_its_limits(seed, share):
    rng = np.random.default_rng(seed)
    known = variables(rng)
    places = {v: places_of(x) for v, x in known.items()}
    grid = grid_at(known, cuts_of(places), *({v: at.limits} for v, at in places.items()))
    values = rng.normal(size=(2, 400)).astype(np.float32)
    box = int(share * len(grid.limits))
    inside = rows_of(box, grid, known)
    np.testing.assert_allclose(grid.sums(values)[:, box], values[:, inside].sum(axis=1), atol=1e-3)
    assert grid.limits[box] == len(grid.gates(box))


@pytest.mark.parametrize("columns", [1, 3])
def test_what_a_term_takes_away_in_a_box_is_the_least_squares_fit_of_the_rows_there(columns):
    rng = np.random.default_rng(columns)
    known = variables(rng)
    grid = grid_at(known, cuts_of({v: places_of(x) for v, x in known.items()}))
    X, y = rng.normal(size=(columns, 400)).astype(np.float32), rng.normal(size=400).astype(np.float32)
    unit = of_unit_length(X)
    own = own_products(grid, unit)
    gain = gains_of_each(grid, unit, y, np.zeros(1), own)[0] if columns == 1 else gains_together(grid, unit, y, own)
    for box in rng.choice(len(gain), 50):
        inside = rows_of(box, grid, known)
        if inside.sum() > 2 * columns:
            beta, *_ = np.linalg.lstsq(X[:, inside].T, y[inside], rcond=None)
            assert gain[box] == pytest.approx(np.sum((beta @ X[:, inside]) ** 2), rel=1e-2, abs=1e-3)


def test_boxes_asked_piece_by_piece_are_those_asked_at_once(monkeypatch):
    rng = np.random.default_rng(4)
    known = variables(rng)
    grid = grid_at(known, cuts_of({v: places_of(x) for v, x in known.items()}), {"v_y": np.array([0.0])})
    X, y = rng.normal(size=(3, 400)).astype(np.float32), rng.normal(size=400).astype(np.float32)
    unit = of_unit_length(X)
    own = own_products(grid, unit)
    whole = gains_together(grid, unit, y, own)
    monkeypatch.setattr(boxes, "_AT_ONCE", 1000)
    assert max(piece.shape[1] for piece in grid.pieces(X)) < len(grid.limits) / 4
    np.testing.assert_allclose(gains_together(grid, unit, y, own), whole, rtol=1e-4)


def test_an_amplitude_of_the_wrong_sign_takes_nothing_away():
    rng = np.random.default_rng(0)
    known = variables(rng)
    grid = grid_at(known, cuts_of({v: places_of(x) for v, x in known.items()}))
    x = of_unit_length(np.abs(rng.normal(size=(1, 400))).astype(np.float32))
    own = own_products(grid, x)
    assert gains_of_each(grid, x, -x[0], np.array([1]), own).max() == 0
    assert gains_of_each(grid, x, -x[0], np.array([-1]), own).max() > 0


def test_no_limit_lies_within_a_level():
    levels = np.repeat([0.0, 4.0, 9.0], 100)
    cuts = cuts_of({"v_x": places_of(levels)})["v_x"]
    assert set(np.searchsorted([0.0, 4.0, 9.0], cuts)) <= {1, 2}
    assert not np.isin(cuts, levels).any()


def test_a_variable_that_mostly_stays_at_one_value_is_cut_where_the_other_rows_differ():
    rng = np.random.default_rng(0)
    removed = np.where(rng.random(20_000) < 0.7, 0.0, rng.uniform(2.0, 12.0, 20_000))
    removed[:200] = 300.0  # a few holes, drilled
    places = places_in({"AR": removed}, removed >= 0.0)["AR"]
    assert np.sum((places.limits > 2.0) & (places.limits < 12.0)) >= 10
    assert np.sum(places.limits < 2.0) == 1
    cuts = cuts_of({"AR": places})["AR"]
    assert np.sum((cuts > 2.0) & (cuts < 12.0)) >= 5
    fine = fine_cuts_of({"AR": places})["AR"]
    assert set(fine) <= set(places.limits)
    assert len(np.unique(fine)) == len(fine) <= 16


def test_what_two_columns_take_away_between_limits_is_the_least_squares_fit_beside_the_model():
    rng = np.random.default_rng(3)
    n, classes = 600, 5
    cell = rng.integers(0, classes, n)
    columns, base = rng.normal(size=(2, n)), rng.normal(size=(1, n))
    Q = base / np.linalg.norm(base)
    y = 2.0 * columns[0] * (cell >= 1) * (cell <= 3) + rng.normal(size=n)
    residual = y - (Q @ y) @ Q
    rows = (columns[:, None] * (cell == np.arange(classes)[:, None])).reshape(-1, n)
    single = [a.astype(np.float32) for a in (Q, residual)]
    first, last, gain = gains_of_intervals(csr_array(rows), 2, *single)
    for i, j, g in zip(first, last, gain, strict=True):
        X = np.concatenate([Q, columns * ((cell >= i) & (cell <= j))])
        left = y - np.linalg.lstsq(X.T, y, rcond=None)[0] @ X
        assert g == pytest.approx(residual @ residual - left @ left, rel=5e-3, abs=0.5)
    best = int(np.argmax(gain))
    assert (first[best], last[best]) == (1, 3)


def test_a_space_that_nothing_cuts_has_no_box():
    grid = grid_at({"v_x": np.arange(5.0)}, {"v_x": np.zeros(0)})
    assert grid.by_limits == {}
    assert _best_box(_basis(), np.array([3.0], np.float32), grid, 10.0) == (0, -np.inf)


def test_the_best_box_pays_for_each_of_its_limits():
    grid = grid_at({"v_x": np.arange(5.0)}, {"v_x": np.array([1.5, 3.5])})
    limits = [len(grid.gates(k)) for k in range(len(grid.limits))]
    gain = np.array([(0.0, 20.0, 21.0)[count] for count in limits], np.float32)
    cheap, dear = (_best_box(_basis(), gain, grid, limit)[0] for limit in (0.1, 10.0))
    assert (limits[cheap], limits[dear]) == (2, 1)
    assert _best_box(_basis(), gain, grid, 10.0)[1] == pytest.approx(-100 * np.log(1 - 20.0 / 100.0) - 10.0)


def _basis() -> Basis:
    """Hundred rows whose squares sum up to a hundred."""
    return Basis(np.zeros((0, 100)), np.ones(100), 100.0, 100, 0, 0.0)
