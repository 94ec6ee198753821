"""Weights that make a physical equation local (paper, eq. 9 and 10), and sums over samples under them.

In:  centres of bins and points of M, and per axis how wide, how flat and how global the weight is.
Out: weights (bins, points); and, without ever holding them all, their product with a matrix of per-point sums.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TypeVar

import numba
import numpy as np
from joblib import cpu_count
from threadpoolctl import ThreadpoolController

from pido.core.arrays import Float1D, Float2D
from pido.core.errors import FitError

S = TypeVar("S")
T = TypeVar("T")

ROWS, BINS = 1024, 512  # a tile of weights is 4 MiB: made, used and overwritten inside the cache; longer sums cost less
MANY_BINS = 4096
"""Bins from which on they are split over threads; fewer share the work on each row, so the rows are split."""


@dataclass(frozen=True, slots=True)
class Kernel:
    """w = exp(-(dv_x² + dv_y² + (alpha dAR)²) / (2 sigma²)) + beta   (eq. 10)

    alpha : mm/s per mm² – how much area removal counts beside speed
    beta : – weight of a sample however far away it is
    sigma : mm/s – width

    The Gaussian has the peak 1. As a normalised density its peak would be about 5e-5 at the paper's values, 200 to 425
    times *smaller* than beta, and each local equation would be the global one to three digits.

    >>> away = np.array([[3.0, 4.0, 0.0]])
    >>> round(Kernel(alpha=0.1, beta=0.02, sigma=5.0).weights(np.zeros((1, 3)), away).item(), 6)
    0.626531
    """

    alpha: float
    beta: float
    sigma: float

    def __post_init__(self) -> None:
        if not (self.alpha >= 0 and self.beta >= 0 and self.sigma > 0):
            raise FitError(f"kernel {self}: alpha >= 0, beta >= 0 and sigma > 0 are needed.")

    def weights(self, centres: Float2D, points: Float2D) -> Float2D:
        """(b, n): the definition, all at once; for few points."""
        metric = np.array([1.0, 1.0, self.alpha])
        distance = ((np.asarray(centres)[:, None] - np.asarray(points)[None]) * metric) ** 2
        return np.exp(-distance.sum(axis=2) / (2 * self.sigma**2)) + self.beta


PAPER_KERNELS = (
    Kernel(0.0976, 0.0200, 4.8381),
    Kernel(0.0701, 0.0170, 4.8086),
    Kernel(0.1126, 0.0130, 4.8327),
    Kernel(0.0826, 0.0170, 4.7882),
)
"""Modal values of table 2 for x, y, z, sp."""


@dataclass(frozen=True, eq=False)
class WeightedSums:
    """sums : (b, k) – sum over points of weight times the point's row; total, squared : (b,) – sum of w, of w²."""

    sums: Float2D
    total: Float1D
    squared: Float1D


def weighted_sums(
    centres: Float2D,
    points: Float2D,
    counts: Float1D,
    rows: Callable[[int, int], Float2D],
    whole: Float1D,
    kernel: Kernel,
) -> WeightedSums:
    """Sums of `rows(start, stop)` (stop - start, width) under the kernel at each centre.

    points : (n, 3); counts : (n,) – how many samples a point stands for; whole : (width,) – sum of all rows
    The rows may come `padded`. Rows or bins are split into eight shares, one BLAS thread each; what a share holds does
    not depend on how many cores there are, and neither does the result.
    """
    centres, points = np.ascontiguousarray(centres, float), np.ascontiguousarray(points, float)
    n, b, width = len(points), len(centres), padded(len(whole))
    tables = [np.unique(centres[:, d], return_inverse=True) for d in range(3)]
    by_bins = b >= MANY_BINS
    cuts = np.unique(np.linspace(0, -(-(b if by_bins else n) // 512), 9).astype(int)) * 512
    shares = [slice(int(low), int(high)) for low, high in pairwise(cuts)]

    def work(share: slice) -> tuple[Float2D, Float1D, Float1D]:
        own, (low_row, high_row, _) = (share, (0, n, 1)) if by_bins else (slice(0, b), share.indices(n))
        at = [where[own] for _, where in tables]
        b_own = len(at[0])
        sums, total, squared = np.zeros((b_own, width)), np.zeros(b_own), np.zeros(b_own)
        weight, product = np.empty(BINS * ROWS), np.empty((BINS, width))
        for start in range(low_row, high_row, ROWS):
            stop = min(start + ROWS, high_row)
            block = rows(start, stop)
            # exp(a + b + c) = exp(a) exp(b) exp(c): three small tables instead of one exp per bin and point
            ex, ey, ez = (
                np.exp(-0.5 * (m * (u[:, None] - points[start:stop, d]) / kernel.sigma) ** 2)
                for d, ((u, _), m) in enumerate(zip(tables, (1.0, 1.0, kernel.alpha), strict=True))
            )
            for low in range(0, b_own, BINS):
                bins = slice(low, min(low + BINS, b_own))
                many = bins.stop - low
                w = weight[: many * (stop - start)].reshape(many, stop - start)
                ix, iy, iz = (where[bins] for where in at)
                _fill(w, ex, ey, ez, ix, iy, iz, counts[start:stop], total[bins], squared[bins])
                np.matmul(w, block, out=product[:many])
                sums[bins] += product[:many]
        return sums, total, squared

    made = in_threads(work, shares, size=b * n * width)
    sums, total, squared = (
        np.concatenate(values) if by_bins else np.sum(values, axis=0) for values in zip(*made, strict=True)
    )
    return add_share(WeightedSums(sums[:, : len(whole)], total, squared), whole, float(counts.sum()), kernel.beta)


def padded(width: int) -> int:
    """Columns that a block of rows has inside: whole groups of four, which products go through 4 % faster."""
    return -(-width // 4) * 4


def in_threads(work: Callable[[S], T], shares: Sequence[S], size: int) -> list[T]:
    """`work` on each share, at once where the task is large (`size` operations), with one BLAS thread each: two pools
    of threads on the same cores wait for each other, on a busy machine for longer than the work takes."""
    with _blas().limit(limits=1, user_api="blas"):
        if size < 1e8 or len(shares) == 1:
            return [work(share) for share in shares]
        with ThreadPoolExecutor(min(len(shares), cpu_count())) as pool:
            return list(pool.map(work, shares))


@cache
def _blas() -> ThreadpoolController:
    # Compiled products run on scipy's BLAS, numpy has its own: only libraries that are loaded here are limited.
    # Looking for them takes milliseconds, setting their limits microseconds.
    import scipy.linalg.cython_blas  # noqa: F401

    return ThreadpoolController()


def add_share(local: WeightedSums, whole: Float1D, n: float, beta: float) -> WeightedSums:
    """beta is the same for all bins, so its part is one sum: sum (k + beta) r = sum k r + beta sum r."""
    return WeightedSums(
        local.sums + beta * whole,
        local.total + beta * n,
        local.squared + 2 * beta * local.total + beta**2 * n,
    )


@numba.njit(nogil=True, cache=True, fastmath=True)
def _fill(w, ex, ey, ez, ix, iy, iz, counts, total, squared):
    for b in range(w.shape[0]):
        x, y, z = ex[ix[b]], ey[iy[b]], ez[iz[b]]
        s, q = 0.0, 0.0
        for r in range(w.shape[1]):
            k = x[r] * y[r] * z[r]
            w[b, r] = k
            s += k * counts[r]
            q += k * k * counts[r]
        total[b] += s
        squared[b] += q
