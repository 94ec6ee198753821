"""How many samples lie in which bins, and how evenly (paper, figures 8, 21, 23 and 24)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Float2D, Int1D
from pido.feature_space.grid import Grid


@dataclass(frozen=True, eq=False)
class Occupancy:
    """The occupied bins of a set of points, in ascending order of their ids.

    bins, count : (m,); centroid : (m, 3) – mean of the points in each bin
    """

    bins: Int1D
    count: Int1D
    centroid: Float2D

    def count_in(self, bins: Int1D) -> Int1D:
        """Number of points in each of `bins`, 0 where there is none."""
        return lookup(self.bins, self.count, bins, missing=0)


def occupancy(points: Float2D, grid: Grid) -> Occupancy:
    """Counts and centroids of the bins in which `points` (n, 3) lie."""
    bins, inverse, count = np.unique(grid.ids(points), return_inverse=True, return_counts=True)
    sums = np.column_stack([np.bincount(inverse, points[:, d], minlength=len(bins)) for d in range(3)])
    return Occupancy(bins, count, sums / count[:, None])


def relevant_bins(path: Float2D, grid: Grid) -> Int1D:
    """The bins that a part's planned or recorded path (n, 3) goes through, ascending: those the method cares about."""
    finite = np.isfinite(path).all(axis=1)
    return np.unique(grid.ids(path[finite]))


def balance(points: Float2D, relevant: Int1D, grid: Grid) -> float:
    """Standard deviation of the number of points over the relevant bins: smaller is more even (figures 23 and 24)."""
    return float(np.std(occupancy(points, grid).count_in(relevant))) if len(relevant) else 0.0


def lookup(known: Int1D, values: np.ndarray, wanted: Int1D, missing: float) -> np.ndarray:
    """`values` at `wanted`, where `known` (ascending) says which key each value belongs to; `missing` elsewhere."""
    found, at = locate(known, wanted)
    result = np.full((len(wanted), *values.shape[1:]), missing, dtype=values.dtype)
    result[found] = values[at[found]]
    return result


def locate(known: Int1D, wanted: Int1D) -> tuple[np.ndarray, Int1D]:
    """(whether each wanted key is known, its place in `known`); `known` is ascending."""
    at = np.searchsorted(known, wanted)
    at = np.minimum(at, max(len(known) - 1, 0))
    return (known[at] == wanted) if len(known) else np.zeros(len(wanted), bool), at
