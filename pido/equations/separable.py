"""Sums over cells under a local weight, one dimension of M after the other.

In:  cells that lie in columns and slabs of a grid, each with its centroid and its packed sums; centres of bins.
Out: the sums of `pido.equations.weights`, for a small part of the operations.

The weight is a product, exp(-(dx² + dy² + dz²)/2) = e(dx) e(dy) e(dz), and bins and cells lie on grids, so many cells
share dx and dy. For each AR of a bin: cells are summed over AR within their column (v_x, v_y), columns over v_y within
their slab (v_x), slabs over v_x. Centroids do not lie on a grid. Along AR each cell keeps its own; across, the
weight at the cell is that at its column (slab) plus its slope times the way between the two, first order in that way.
"""

from __future__ import annotations

import numba
import numpy as np

from pido.core.arrays import Float1D, Float2D, Float3D, Int1D, Int2D
from pido.equations.weights import Kernel, WeightedSums, in_threads

NEAR = 0.2
"""Largest way from a cell to its column or slab, in sigma, that a slope is enough for."""
_CHUNK = 1 << 21  # numbers of a chunk's intermediate sums: 16 MB


class Columns:
    """Cells in the order of their columns, with what does not depend on bins and kernel.

    points : (m, 3) – centroids; index : (m, 3) – place of each cell in the grid; counts : (m,); rows : (m, k)
    """

    def __init__(self, points: Float2D, index: Int2D, counts: Float1D, rows: Float2D) -> None:
        order = np.lexsort((index[:, 2], index[:, 1], index[:, 0]))
        self.counts, self._points = counts[order], points[order]
        self.rows = rows[order]
        place = index[order]
        new_slab = np.r_[True, np.diff(place[:, 0]) != 0]
        new_column = new_slab | np.r_[True, np.diff(place[:, 1]) != 0]
        self.column_starts = np.r_[np.flatnonzero(new_column), len(place)]
        slab_starts = np.r_[np.flatnonzero(new_slab), len(place)]
        self.slab_starts = np.searchsorted(self.column_starts, slab_starts)  # in columns
        self.z = self._points[:, 2]
        self.y, self.to_y = _middles(self._points[:, 1], self.counts, self.column_starts)
        self.x, self.to_x = _middles(self._points[:, 0], self.counts, slab_starts)

    def way(self) -> float:
        """Largest way from a cell to its column or slab, mm/s."""
        return float(max(np.abs(self.to_x).max(), np.abs(self.to_y).max()))

    def operations(self, centres: Float2D) -> int:
        """What `sums` takes, beside cells times bins of the direct way."""
        return self._operations(_Bins(centres))

    def _operations(self, bins: _Bins) -> int:
        return 3 * len(self.z) * len(bins.heights) + 3 * len(self.y) * bins.pairs + 2 * len(self.x) * len(bins.x)

    def sums(self, centres: Float2D, kernel: Kernel) -> WeightedSums:
        """Sums without beta's share: (b, k), and of the counts under the weight and its square."""
        counted, bins = np.column_stack([self.rows, self.counts]), _Bins(centres)
        whole = self._under(bins, counted, kernel)
        squared = self._under(bins, self.counts[:, None], Kernel(kernel.alpha, 0.0, kernel.sigma / np.sqrt(2)))
        return WeightedSums(whole[:, :-1], whole[:, -1], squared[:, 0])

    def _under(self, bins: _Bins, rows: Float2D, kernel: Kernel) -> Float2D:
        x, y, heights, level = bins.x / kernel.sigma, bins.y / kernel.sigma, bins.heights / kernel.sigma, bins.level
        many = max(1, _CHUNK // (3 * len(self.y) * rows.shape[1]))
        at_x, at_y, to_x, to_y = (v / kernel.sigma for v in (self.x, self.y, self.to_x, self.to_y))
        out = np.empty((len(x), rows.shape[1]))

        def work(start: int) -> None:
            stop = min(start + many, len(heights))
            away = kernel.alpha * (heights[start:stop, None] - self.z / kernel.sigma)
            # rows without, and with, the way to their column and slab: what the slope of the weight needs
            under = np.exp(-0.5 * away**2)
            left = np.stack([under, under * to_y, under * to_x], axis=1).reshape(-1, len(self.z))
            columns = np.empty((stop - start, 3, len(self.y), rows.shape[1]))
            _over_cells(left, rows, self.column_starts, columns.reshape(-1, len(self.y), rows.shape[1]))
            for k in range(start, stop):
                here = slice(int(level[k]), int(level[k + 1]))
                _over_columns(columns[k - start], at_x, at_y, self.slab_starts, x[here], y[here], out[here])

        in_threads(work, range(0, len(heights), many), size=self._operations(bins) * rows.shape[1])
        result = np.empty_like(out)
        result[bins.order] = out
        return result


class _Bins:
    """Centres in the order of AR, v_y, v_x.

    heights : (m,) – each AR once; level : (m + 1,) – where its bins begin; pairs : how many (AR, v_y) there are
    """

    def __init__(self, centres: Float2D) -> None:
        self.order = np.lexsort((centres[:, 0], centres[:, 1], centres[:, 2]))
        self.x, self.y, z = np.ascontiguousarray(centres[self.order].T)
        higher = np.r_[True, z[1:] != z[:-1]]
        self.heights, self.level = z[higher], np.r_[np.flatnonzero(higher), len(z)]
        self.pairs = int((higher[1:] | (self.y[1:] != self.y[:-1])).sum()) + 1


def _middles(values: Float1D, counts: Float1D, starts: Int1D) -> tuple[Float1D, Float1D]:
    """Centroid of each run of cells, and the way from it to each of its cells."""
    middle = np.add.reduceat(values * counts, starts[:-1]) / np.add.reduceat(counts, starts[:-1])
    return middle, values - np.repeat(middle, np.diff(starts))


@numba.njit(nogil=True, cache=True)
def _over_cells(left: Float2D, rows: Float2D, starts: Int1D, out: Float3D) -> None:
    """out[:, c] = left times rows, over the cells of column c."""
    for c in range(len(starts) - 1):
        low, high = starts[c], starts[c + 1]
        if high - low == 1:
            for t in range(left.shape[0]):
                w = left[t, low]
                for k in range(rows.shape[1]):
                    out[t, c, k] = w * rows[low, k]
        else:
            out[:, c] = np.dot(np.ascontiguousarray(left[:, low:high]), rows[low:high])


@numba.njit(nogil=True, cache=True)
def _over_columns(
    columns: Float3D, at_x: Float1D, at_y: Float1D, slabs: Int1D, x: Float1D, y: Float1D, out: Float2D
) -> None:
    """Sums of columns over v_y, then of slabs over v_x, for bins of one AR in the order of (v_y, v_x)."""
    first = np.flatnonzero(np.append(True, y[1:] != y[:-1]))
    ends = np.append(first[1:], len(y))
    v_y = y[first]
    width, count = columns.shape[2], len(at_x)
    here, beside = np.empty((len(v_y), count, width)), np.empty((len(v_y), count, width))
    for s in range(count):
        low, high = slabs[s], slabs[s + 1]
        away = v_y.reshape(-1, 1) - at_y[low:high].reshape(1, -1)
        weight = np.exp(-0.5 * away**2)
        here[:, s] = np.dot(weight, columns[0, low:high]) + np.dot(weight * away, columns[1, low:high])
        beside[:, s] = np.dot(weight, columns[2, low:high])
    for p in range(len(v_y)):
        away = x[first[p] : ends[p]].reshape(-1, 1) - at_x.reshape(1, -1)
        weight = np.exp(-0.5 * away**2)
        out[first[p] : ends[p]] = np.dot(weight, here[p]) + np.dot(weight * away, beside[p])
