"""What each sample, or each bin of samples, adds to the normal equations of all four axes.

In:  design matrix (n, p) and currents (n, 4). Out: rows of width p(p+1)/2 + axes (p + 1): the products that any
weighted least squares needs. A current that is missing is left out of its axis, never filled in.
"""

from __future__ import annotations

import numba
import numpy as np

from pido.core.arrays import Float1D, Float2D, Float3D, Int1D
from pido.equations.weights import in_threads


def width(p: int, axes: int = 4) -> int:
    """Number of entries of a packed row for so many axes."""
    return p * (p + 1) // 2 + axes * (p + 1)


def columns(p: int, axes: list[int]) -> Int1D:
    """Entries of a packed row of all four axes that make the packed row of some of them."""
    gram, axis = p * (p + 1) // 2, np.asarray(axes)
    right = gram + axis[:, None] * p + np.arange(p)
    return np.r_[np.arange(gram), right.ravel(), gram + 4 * p + axis]


def patterns(currents: Float2D) -> Int1D:
    """(n,): which axes were recorded, bit i for axis i. Samples of one pattern share one Gram matrix."""
    return np.isfinite(currents) @ (1 << np.arange(4))


def stack(design: Float2D, currents: Float2D) -> Float2D:
    """(n, p + 4): design and currents side by side; a missing current counts nothing because its axis skips the row."""
    return np.ascontiguousarray(np.column_stack([design, np.where(np.isfinite(currents), currents, 0.0)]))


@numba.njit(nogil=True, cache=True)
def products(z: Float2D, p: int, axes: Int1D, out: Float2D) -> None:
    """Packed row of each sample: x_i x_j for i <= j, then x_j I_axis, then I_axis²."""
    for r in range(z.shape[0]):
        row, into, k = z[r], out[r], 0
        for i in range(p):
            x = row[i]
            for j in range(i, p):
                into[k - i + j] = x * row[j]
            k += p - i
        for axis in axes:
            x = row[p + axis]
            for j in range(p):
                into[k + j] = x * row[j]
            k += p
        for axis in axes:
            into[k] = row[p + axis] ** 2
            k += 1


def unpack(sums: Float2D, p: int) -> tuple[Float3D, Float3D, Float2D]:
    """Gram matrices (b, p, p), right hand sides (b, axes, p) and squared currents (b, axes) of packed sums."""
    i, j = np.triu_indices(p)
    gram = np.empty((len(sums), p, p))
    gram[:, i, j] = gram[:, j, i] = sums[:, : len(i)]
    rest = sums[:, len(i) :]
    axes = rest.shape[1] // (p + 1)
    return gram, rest[:, : axes * p].reshape(-1, axes, p), rest[:, axes * p :]


@numba.njit(nogil=True, cache=True)
def accumulate(z: Float2D, starts: Int1D, p: int, out: Float2D) -> None:
    """Packed sum of each run of rows: run c is z[starts[c]:starts[c + 1]], written to out[c].

    Rows are read once. A long run goes through BLAS; for a short one its call would cost more than the work.
    """
    q = z.shape[1]
    square = np.empty((q, q))
    for c in range(len(starts) - 1):
        low, high = starts[c], starts[c + 1]
        if high - low >= 16:
            block = z[low:high]
            np.dot(block.T, block, square)
        else:
            square[:] = 0.0
            for r in range(low, high):
                for i in range(p):
                    x = z[r, i]
                    for j in range(i, q):
                        square[i, j] += x * z[r, j]
                for i in range(p, q):
                    square[i, i] += z[r, i] ** 2
        k = 0
        for i in range(p):
            for j in range(i, p):
                out[c, k] = square[i, j]
                k += 1
        for axis in range(4):
            for j in range(p):
                out[c, k] = square[j, p + axis]
                k += 1
        for axis in range(4):
            out[c, k] = square[p + axis, p + axis]
            k += 1


def total(z: Float2D, p: int) -> Float1D:
    """Packed sum over all rows."""
    out = np.zeros((1, width(p)))
    # one BLAS thread: for so little work a second one waits, on a busy machine for seconds
    in_threads(lambda into: accumulate(z, np.array([0, len(z)]), p, into), [out], size=z.size)
    return out[0]
