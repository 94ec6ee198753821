"""Weights that make a physical equation local (paper, eq. 9 and 10), and sums over samples under them.

In:  centres of bins and points of M, and per axis how wide, how flat and how global the weight is.
Out: weights (bins, points); and, without ever holding them all, their product with a matrix of per-point sums.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import TypeVar

import numba
import numpy as np
from threadpoolctl import ThreadpoolController

from pido.core.arrays import Float1D, Float2D
from pido.core.errors import FitError

T = TypeVar("T")

ROWS, BINS = 2048, 256  # a tile of weights is 4 MiB: it is made, used and overwritten inside the cache


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
    centres: Float2D, points: Float2D, counts: Float1D, rows: Callable[[int, int], Float2D], width: int, kernel: Kernel
) -> WeightedSums:
    """Sums of `rows(start, stop)` (stop - start, width) under the kernel at each centre.

    points : (n, 3); counts : (n,) – how many samples a point stands for
    Bins are split over threads, one BLAS thread each; a bin's sum does not depend on how many there are.
    """
    centres, points = np.ascontiguousarray(centres, float), np.ascontiguousarray(points, float)
    b = len(centres)
    result = WeightedSums(np.zeros((b, width)), np.zeros(b), np.zeros(b))
    tables = [np.unique(centres[:, d], return_inverse=True) for d in range(3)]
    tiles = [(s, min(s + BINS, b)) for s in range(0, b, BINS)]
    workers = max(1, min(len(tiles), os.cpu_count() or 1))

    def work(mine: list[tuple[int, int]]) -> None:
        weight, product = np.empty((BINS, ROWS)), np.empty((BINS, width))
        for start in range(0, len(points), ROWS):
            stop = min(start + ROWS, len(points))
            block, n = rows(start, stop), stop - start
            # exp(a + b + c) = exp(a) exp(b) exp(c): three small tables instead of one exp per bin and point
            ex, ey, ez = (
                np.exp(-0.5 * (m * (u[:, None] - points[start:stop, d]) / kernel.sigma) ** 2)
                for d, ((u, _), m) in enumerate(zip(tables, (1.0, 1.0, kernel.alpha), strict=True))
            )
            for low, high in mine:
                w = weight[: high - low, :n]
                ix, iy, iz = (at[low:high] for _, at in tables)
                _fill(w, ex, ey, ez, ix, iy, iz, counts[start:stop], result.total[low:high], result.squared[low:high])
                np.matmul(w, block, out=product[: high - low])
                result.sums[low:high] += product[: high - low]

    in_threads(work, [tiles[k::workers] for k in range(workers)], size=b * len(points) * width)
    return _add_share(result, points, counts, rows, kernel.beta)


def in_threads(work: Callable[[T], None], shares: list[T], size: int) -> None:
    """`work` on each share, at once where the task is large (`size` operations), with one BLAS thread each: two pools
    of threads on the same cores wait for each other, on a busy machine for longer than the work takes."""
    with _blas().limit(limits=1, user_api="blas"):
        if size < 1e8 or len(shares) == 1:
            for share in shares:
                work(share)
            return
        with ThreadPoolExecutor(len(shares)) as pool:
            list(pool.map(work, shares))


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()  # looking for the libraries takes milliseconds, setting their limits microseconds


def _add_share(
    local: WeightedSums, points: Float2D, counts: Float1D, rows: Callable[[int, int], Float2D], beta: float
) -> WeightedSums:
    """beta is the same for all bins, so its part is one sum: sum (k + beta) r = sum k r + beta sum r."""
    everything = np.zeros(local.sums.shape[1])
    for start in range(0, len(points), ROWS):
        everything += rows(start, min(start + ROWS, len(points))).sum(axis=0)
    n = counts.sum()
    return WeightedSums(
        local.sums + beta * everything,
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
