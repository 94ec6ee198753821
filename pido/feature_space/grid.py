"""The bins B_ijk of the reduced feature space (paper, eq. 8 and 9).

In:  points of M = (v_x mm/s, v_y mm/s, AR mm²), and a width per dimension.
Out: one whole number per point that names its bin; only bins that occur are ever stored.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Float2D, Int1D, Int2D
from pido.core.errors import FitError

_BITS = 19
_HALF = 1 << (_BITS - 1)
_MASK = (1 << _BITS) - 1


@dataclass(frozen=True, slots=True)
class Grid:
    """Half-open bins [xi_i, xi_i+1) x [eta_j, eta_j+1) x [zeta_k, zeta_k+1), edges at whole multiples of the width.

    Every finite point lies in exactly one bin. The paper samples on 2 x 2 x 2 (experiment 2, validation) and fits
    equations on 1 x 1 x 10 (experiment 1).

    >>> grid = Grid()
    >>> grid.index(grid.ids(np.array([[3.9, -0.1, 0.0]]))).tolist()
    [[1, -1, 0]]
    """

    width: tuple[float, float, float] = (2.0, 2.0, 2.0)  # mm/s, mm/s, mm²

    def __post_init__(self) -> None:
        if len(self.width) != 3 or not all(w > 0 and np.isfinite(w) for w in self.width):
            raise FitError(f"bin widths {self.width}: three positive numbers are needed (mm/s, mm/s, mm²).")

    def ids(self, points: Float2D) -> Int1D:
        """Bin of each point: (n,), one int64 per bin, ordered by v_x, then v_y, then AR.

        Raises FitError where a coordinate is not finite or more than 262 143 bins away from zero.
        """
        points = np.asarray(points, float).reshape(-1, 3)
        if not np.isfinite(points).all():
            row = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
            raise FitError(f"point {row} of the reduced space is {points[row]}: leave samples with missing values out.")
        width = np.asarray(self.width)
        index = np.floor(points / width)
        # x / w can round up to the next whole number just below an edge: the edges i * w decide, not the quotient
        index -= points < index * width
        index += points >= (index + 1) * width
        if np.abs(index).max(initial=0) >= _HALF:
            raise FitError(
                f"a point of the reduced space lies {np.abs(index).max():.3g} bins from zero: check its units."
            )
        i, j, k = (index.astype(np.int64) + _HALF).T
        return (i << (2 * _BITS)) | (j << _BITS) | k

    def index(self, ids: Int1D) -> Int2D:
        """(n, 3): the whole numbers i, j, k of each bin; its lower edges are i, j, k times the width."""
        ids = np.asarray(ids, np.int64)
        index: Int2D = np.column_stack([ids >> (2 * _BITS), (ids >> _BITS) & _MASK, ids & _MASK]) - _HALF
        return index

    def low(self, ids: Int1D) -> Float2D:
        """(n, 3): lower edge of each bin, which belongs to it."""
        return self.index(ids).astype(float) * np.asarray(self.width)

    def high(self, ids: Int1D) -> Float2D:
        """(n, 3): upper edge of each bin, which does not belong to it."""
        return (self.index(ids) + 1).astype(float) * np.asarray(self.width)

    def centres(self, ids: Int1D) -> Float2D:
        """(n, 3): middle of each bin (eq. 9)."""
        return self.index(ids).astype(float) * np.asarray(self.width) + 0.5 * np.asarray(self.width)

    def id_of(self, index: Int2D) -> Int1D:
        """The bins with these whole numbers: the inverse of `index`."""
        i, j, k = (np.asarray(index, np.int64).reshape(-1, 3) + _HALF).T
        return (i << (2 * _BITS)) | (j << _BITS) | k


def touched(bins: Int1D, grid: Grid, other: Grid) -> Int1D:
    """Bins of `other` that share any volume with `bins` of `grid`, ascending."""
    if not len(bins):
        return np.zeros(0, np.int64)
    low = other.index(other.ids(grid.low(bins)))
    high = other.index(other.ids(np.nextafter(grid.high(bins), -np.inf)))
    spans = [np.arange((high - low)[:, d].max() + 1) for d in range(3)]
    index = low[:, None] + np.stack(np.meshgrid(*spans, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.unique(other.id_of(index[(index <= high[:, None]).all(axis=2)]))


SAMPLING_GRID = Grid((2.0, 2.0, 2.0))
EQUATION_GRID = Grid((1.0, 1.0, 10.0))
