"""Weighted least squares from packed sums: many bins, one Gram matrix each, up to four axes on the right.

In:  sums and total weights per bin. Out: coefficients, a factor for leverage, the rank, and the local noise.

    c = argmin  sum_n w_n (I_n - x_n c)² / sum_n w_n  +  floor² sum_{j != constant} c_j²

Columns are scaled by the machine's range already; floor is a share of that range (`TermSet.floor`). The constant is not
penalised. Columns that are zero, or a multiple of the constant, over all samples are dropped by rule and reported.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from pido.core.arrays import Bool1D, Float1D, Float2D, Float3D, Int1D
from pido.equations.rows import unpack
from pido.equations.weights import WeightedSums, in_threads


@dataclass(frozen=True, eq=False)
class Solution:
    """Of b bins and the axes that share their weights.

    coefficients : (b, axes, p), A at full range; factor : (b, p, p) – lower triangular F with leverage |F x|² / n_eff
    rank : (b,); effective : (b,) – (sum w)² / sum w²; noise : (b, axes), A – weighted residual standard deviation
    moved : (b, axes), A² – weighted mean square of the difference to the equation `around`
    """

    coefficients: Float3D
    factor: Float3D
    rank: Int1D
    effective: Float1D
    noise: Float2D
    moved: Float2D


def excited(sums: Float1D, p: int, constant: int) -> Bool1D:
    """(p,): whether a column says anything that the constant does not, judged over all samples (packed sum)."""
    gram = unpack(sums[None], p)[0][0]
    size, shared = np.diag(gram), gram[constant]
    spread = size * size[constant] - shared**2
    keep = spread > 1e-12 * np.maximum(size * size[constant], 1e-300)
    keep &= size > 0
    keep[constant] = True
    return keep


def solve(weighted: WeightedSums, keep: Bool1D, constant: int, floor: float, around: Float2D | None = None) -> Solution:
    """Coefficients of each bin for the axes that its sums hold; columns outside `keep` get zero.

    around : (axes, p) – coefficients (of the global equation) that `moved` is measured from
    """
    p = len(keep)
    gram, right, square = unpack(weighted.sums / weighted.total[:, None], p)
    right = np.ascontiguousarray(right)
    ridge = np.full(p, floor**2)
    ridge[constant] = 0.0
    coefficients, factor = np.zeros_like(right), np.zeros_like(gram)
    rank = np.zeros(len(gram), np.int64)
    # kept columns first: their part of the factor solves the fit, and the whole of it is the leverage, so that a row
    # which moves a column that no sample moved has next to no support
    columns = np.r_[np.flatnonzero(keep), np.flatnonzero(~keep)]
    half = -(-len(gram) // 2)
    in_threads(
        lambda rows: _solve(
            gram[rows], right[rows], ridge, columns, int(keep.sum()), coefficients[rows], factor[rows], rank[rows]
        ),
        [slice(0, half), slice(half, None)],
        size=len(gram) * p**3,
    )
    effective = weighted.total**2 / weighted.squared
    fitted = np.matmul(coefficients, gram)
    residual = square - 2 * (coefficients * right).sum(axis=2) + (coefficients * fitted).sum(axis=2)
    spare = np.maximum(effective - rank, 1.0)
    noise = np.sqrt(np.maximum(residual, 0.0) * (effective / spare)[:, None])
    away = coefficients - (0.0 if around is None else around)
    moved = (away * np.matmul(away, gram)).sum(axis=2)
    return Solution(coefficients, factor, rank, effective, noise, moved)


@numba.njit(nogil=True, cache=True)
def _solve(gram, right, ridge, columns, kept, coefficients, factor, rank):
    m, axes = len(columns), right.shape[1]
    for b in range(gram.shape[0]):
        # equilibrated to a unit diagonal: pivots are then shares of a column that the columns before do not explain
        d, low = np.empty(m), np.zeros((m, m))
        for i in range(m):
            size = gram[b, columns[i], columns[i]] + ridge[columns[i]]
            d[i] = 1.0 / np.sqrt(size) if size > 0.0 else 0.0
        for j in range(m):
            pivot = 1.0 if d[j] > 0.0 else 0.0
            for k in range(j):
                pivot -= low[j, k] ** 2
            share = ridge[columns[j]] * d[j] ** 2
            if j < kept and pivot > 4.0 * share and pivot > 1e-11:
                rank[b] += 1
            if pivot <= 1e-14:  # explained to rounding, and not even the ridge tells: leave the column out
                low[j, j] = 0.0
                continue
            low[j, j] = np.sqrt(pivot)
            for i in range(j + 1, m):
                s = gram[b, columns[i], columns[j]] * d[i] * d[j]
                for k in range(j):
                    s -= low[i, k] * low[j, k]
                low[i, j] = s / low[j, j]
        for a in range(axes):
            y = np.zeros(kept)
            for i in range(kept):
                if low[i, i] > 0.0:
                    s = right[b, a, columns[i]] * d[i]
                    for k in range(i):
                        s -= low[i, k] * y[k]
                    y[i] = s / low[i, i]
            for i in range(kept - 1, -1, -1):
                if low[i, i] > 0.0:
                    s = y[i]
                    for k in range(i + 1, kept):
                        s -= low[k, i] * y[k]
                    y[i] = s / low[i, i]
                else:
                    y[i] = 0.0
                coefficients[b, a, columns[i]] = y[i] * d[i]
        for j in range(m):  # inverse of the factor, column by column
            if low[j, j] == 0.0:
                continue
            f = np.zeros(m)
            f[j] = 1.0 / low[j, j]
            for i in range(j + 1, m):
                if low[i, i] > 0.0:
                    s = 0.0
                    for k in range(j, i):
                        s -= low[i, k] * f[k]
                    f[i] = s / low[i, i]
            for i in range(j, m):
                factor[b, columns[i], columns[j]] = f[i] * d[j]
