"""Weighted least squares from packed sums: many bins, one Gram matrix each, up to four axes on the right.

In:  sums and total weights per bin. Out: coefficients, a factor for leverage, the rank, and the local noise.

    c = argmin  sum_n w_n (I_n - x_n c)² / sum_n w_n  +  floor² sum_{j != constant} (c_j - prior_j)²

The prior is zero, but for accepted physics, which comes with the size at which it was found. The ridge is so small that
it decides only what the samples say nothing of: friction of a direction that none of them took. Columns are scaled by
the machine's range already; floor is a share of that range (`TermSet.floor`). The constant is not penalised. Columns
that are zero, or a multiple of the constant, over all samples are dropped by rule and reported.
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


def solve(
    weighted: WeightedSums, keep: Bool1D, constant: int, floor: float, around: Float2D | None = None,
    own: Bool1D | None = None, prior: Float1D | None = None,
) -> Solution:  # fmt: skip
    """Coefficients of each bin for the axes that its sums hold; columns outside `keep` get their prior.

    around : (axes, p) – coefficients (of the global equation) that `moved` is measured from
    own : (p,) – columns that are in the equation of these axes; the others have no leverage either. None: all
    prior : (p,), A at full range. None: zero
    """
    p, b = len(keep), len(weighted.total)
    axes = weighted.sums.shape[1] // (p + 1) - p // 2  # of p (p + 1) / 2 + axes (p + 1) entries
    around = np.zeros((axes, p)) if around is None else np.ascontiguousarray(around)
    ridge = np.full(p, floor**2)
    ridge[constant] = 0.0
    coefficients, factor = np.zeros((b, axes, p)), np.zeros((b, p, p))
    rank, residual, moved = np.zeros(b, np.int64), np.empty((b, axes)), np.empty((b, axes))
    # kept columns first: their part of the factor solves the fit, and the whole of it is the leverage, so that a row
    # which moves a column that no sample moved has next to no support
    there = np.ones(p, bool) if own is None else own
    before = np.zeros(p) if prior is None else np.where(there, prior, 0.0)
    columns = np.r_[np.flatnonzero(keep & there), np.flatnonzero(~keep & there)]
    half = -(-b // 2)
    in_threads(
        lambda rows: _solve(
            weighted.sums[rows], weighted.total[rows], ridge, columns, int((keep & there).sum()), around, before,
            coefficients[rows], factor[rows], rank[rows], residual[rows], moved[rows],
        ),
        [slice(0, half), slice(half, None)],
        size=b * p**3,
    )  # fmt: skip
    effective = weighted.total**2 / weighted.squared
    spare = np.maximum(effective - rank, 1.0)
    noise = np.sqrt(np.maximum(residual, 0.0) * (effective / spare)[:, None])
    return Solution(coefficients, factor, rank, effective, noise, moved)


@numba.njit(nogil=True, cache=True)
def _solve(sums, total, ridge, columns, kept, around, prior, coefficients, factor, rank, residual, moved):
    p, m, axes = len(ridge), len(columns), len(around)
    gram, right, square = np.empty((p, p)), np.empty((axes, p)), np.empty(axes)
    # up[k, i] is the Cholesky factor's entry (i, k), inverse[i, k] that of its inverse: the innermost loops run along
    # memory, and each sum is taken in the order of k
    d, up, inverse, rest, y = np.empty(m), np.empty((m, m)), np.empty((m, m)), np.empty(m), np.empty(m)
    for b in range(len(sums)):
        packed = 0
        for i in range(p):
            for j in range(i, p):
                gram[i, j] = gram[j, i] = sums[b, packed] / total[b]
                packed += 1
        for a in range(axes):
            for i in range(p):
                right[a, i] = sums[b, packed] / total[b]
                packed += 1
        for a in range(axes):
            square[a] = sums[b, packed + a] / total[b]
        # equilibrated to a unit diagonal: pivots are then shares of a column that the columns before do not explain
        for i in range(m):
            size = gram[columns[i], columns[i]] + ridge[columns[i]]
            d[i] = 1.0 / np.sqrt(size) if size > 0.0 else 0.0
        up[:] = 0.0
        for j in range(m):
            pivot = 1.0 if d[j] > 0.0 else 0.0
            for k in range(j):
                pivot -= up[k, j] ** 2
            share = ridge[columns[j]] * d[j] ** 2
            if j < kept and pivot > 4.0 * share and pivot > 1e-11:
                rank[b] += 1
            if pivot <= 1e-14:  # explained to rounding, and not even the ridge tells: leave the column out
                continue
            for i in range(j + 1, m):
                rest[i] = gram[columns[i], columns[j]] * d[i] * d[j]
            for k in range(j):
                for i in range(j + 1, m):
                    rest[i] -= up[k, i] * up[k, j]
            up[j, j] = np.sqrt(pivot)
            for i in range(j + 1, m):
                up[j, i] = rest[i] / up[j, j]
        for a in range(axes):
            for i in range(kept):  # what the prior leaves, whose own prior is zero
                y[i] = right[a, columns[i]]
                for j in range(p):
                    y[i] -= gram[columns[i], j] * prior[j]
                y[i] *= d[i]
            for k in range(kept):
                y[k] = y[k] / up[k, k] if up[k, k] > 0.0 else 0.0
                for i in range(k + 1, kept):
                    y[i] -= up[k, i] * y[k]
            for i in range(kept - 1, -1, -1):
                s = y[i]
                for k in range(i + 1, kept):
                    s -= up[i, k] * y[k]
                y[i] = s / up[i, i] if up[i, i] > 0.0 else 0.0
                coefficients[b, a, columns[i]] = y[i] * d[i]
            for i in range(p):
                coefficients[b, a, i] += prior[i]
            c, error, away = coefficients[b, a], square[a], 0.0
            for i in range(p):
                fitted, beside = 0.0, 0.0
                for j in range(p):
                    fitted += gram[i, j] * c[j]
                    beside += gram[i, j] * (c[j] - around[a, j])
                error += c[i] * (fitted - 2.0 * right[a, i])
                away += (c[i] - around[a, i]) * beside
            residual[b, a], moved[b, a] = error, away
        for i in range(m):  # inverse of the factor, row by row
            inverse[i] = 0.0
            if up[i, i] == 0.0:
                continue
            for k in range(i):
                for j in range(k + 1):
                    inverse[i, j] -= up[k, i] * inverse[k, j]
            for j in range(i):
                inverse[i, j] /= up[i, i]
            inverse[i, i] = 1.0 / up[i, i]
            for j in range(i + 1):
                factor[b, columns[i], columns[j]] = inverse[i, j] * d[j]
