"""Local fits beside what a user would write by hand: `python -m benchmarks.fits`.

Rows of {work, peer, ratio, goal, error}. Peers fit one bin at a time; they are timed on a few bins and multiplied by
the number of bins (said in the row). Alternatives are timed in turn, medians of several runs; errors are rms
differences of predictions over the noise's standard deviation, against the exact fits.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from pido.config import machine
from pido.core.samples import Samples
from pido.equations.fit import LocalEquations, fit_local, fit_local_from
from pido.equations.moments import Moments
from pido.equations.rows import accumulate, stack, width
from pido.equations.terms import PAPER
from pido.equations.weights import PAPER_KERNELS, Kernel
from pido.feature_space.grid import EQUATION_GRID, Grid

NOISE = 0.2
CELLS = Grid((1.5, 1.5, 15.0))
MACHINE = machine("dmc60h")


def samples(n: int, seed: int = 0) -> Samples:
    """Full-rank rows with realistic ranges, |v| up to 15 mm/s, AR up to 200 mm², currents from a nonlinear law."""
    rng = np.random.default_rng(seed)
    inputs = rng.normal(size=(n, 13)) * np.array([4, 4, 1, 100, 100, 20, 20000, 3000, 60, 60, 20, 0.3, 30.0])
    inputs[:, :2] = rng.uniform(-15, 15, size=(n, 2))
    currents = (
        np.tanh(inputs[:, :1])
        + 0.05 * inputs[:, [1, 0, 2, 1]]
        + 0.01 * inputs[:, [8]]
        + rng.normal(scale=NOISE, size=(n, 4))
    )
    direction = np.sign(inputs[:, [0, 1, 2, 6]])
    return Samples.real(inputs, rng.uniform(0, 200, n), currents, direction, "bench", np.arange(n))


def bins_of(count: int) -> np.ndarray:
    """`count` bins of 1 x 1 x 10 spread over the space that `samples` fills."""
    i, j, k = np.meshgrid(np.arange(-15, 15), np.arange(-15, 15), np.arange(20), indexing="ij")
    every = EQUATION_GRID.id_of(np.column_stack([i.ravel(), j.ravel(), k.ravel()]))
    return np.sort(np.random.default_rng(1).permutation(every)[:count])


def timed(call: Callable[[], Any], repeats: int = 3) -> tuple[float, Any]:
    """Median wall time and the last result."""
    times, result = [], None
    for _ in range(repeats):
        start = time.perf_counter()
        result = call()
        times.append(time.perf_counter() - start)
    return float(np.median(times)), result


def dgemm_rate() -> float:
    """FLOP/s of a square float64 product on all cores, one BLAS thread per core as the fits use them."""
    a = np.random.default_rng(0).random((3000, 3000))
    return 2 * 3000**3 / min(timed(lambda: a @ a)[0] for _ in range(3))


def peers(X: np.ndarray, y: np.ndarray, points: np.ndarray, centres: np.ndarray, kernels: tuple[Kernel, ...]) -> dict:
    """Seconds per bin for all four axes, by peer: the loops that a user would write."""
    import statsmodels.api as sm
    from sklearn.linear_model import LinearRegression

    def weights(centre: np.ndarray, axis: int) -> np.ndarray:
        return kernels[axis].weights(centre[None], points)[0]

    def lstsq(centre: np.ndarray) -> None:
        for axis in range(4):
            root = np.sqrt(weights(centre, axis))
            np.linalg.lstsq(root[:, None] * X, root * y[:, axis], rcond=None)

    def sklearn(centre: np.ndarray) -> None:
        for axis in range(4):
            LinearRegression(fit_intercept=False).fit(X, y[:, axis], sample_weight=weights(centre, axis))

    def statsmodels(centre: np.ndarray) -> None:
        for axis in range(4):
            sm.WLS(y[:, axis], X, weights=weights(centre, axis)).fit()

    result = {}
    for name, one, count in (
        ("np.linalg.lstsq", lstsq, 3),
        ("scikit-learn", sklearn, 2),
        ("statsmodels", statsmodels, 2),
    ):
        result[name] = timed(lambda one=one, count=count: [one(c) for c in centres[:count]], 1)[0] / count
    return result


QUICK = {"n": 5_000, "b": 100, "large": (50_000, 500)}


def run(n: int = 100_000, b: int = 1000, large: tuple[int, int] = (2_000_000, 10_000)) -> Iterator[dict[str, Any]]:
    """All rows of the table."""
    return lines(n, b, large, 5)


def lines(
    n: int = 100_000, b: int = 1000, large: tuple[int, int] = (2_000_000, 10_000), repeats: int = 3
) -> Iterator[dict[str, Any]]:
    """The rows, each as soon as it is measured."""
    data, bins = samples(n), bins_of(b)
    kernels = PAPER_KERNELS
    fit_local(data.take(slice(0, 3000)), bins[:10], MACHINE)  # compiled before the clock starts
    exact_time, exact = timed(lambda: fit_local(data, bins, MACHINE, kernels=kernels), repeats)
    X, centres = PAPER.design(data, MACHINE), EQUATION_GRID.centres(bins)
    away = _away_from_lstsq(X, data, centres[:2], exact)
    for name, goal in (("np.linalg.lstsq", 25), ("scikit-learn", 80), ("statsmodels", 150)):
        seconds = peers_cache(X, data, centres, kernels)[name] * b
        work, peer = f"exact local fits, {n} rows, {b} bins, 4 axes", f"{name}, bin after bin (extrapolated)"
        told = f"predictions within {away:.0e} of the noise of `lstsq` with the same ridge (goal 1e-6)"
        yield row(work, peer, seconds / exact_time, f">= {goal}", told) | {"within": away <= 1e-6}
    # of a kernel of its own, each axis takes x x', x I and I²; the symmetric half is not counted
    flop = 2.0 * n * b * width(len(PAPER), 1) * len(set(kernels))
    rate = dgemm_rate()
    yield row(
        "exact local fits, share of the machine's dgemm rate",
        f"dgemm {rate / 1e9:.0f} GFLOP/s",
        flop / exact_time / rate,
        ">= 0.8",
        f"{exact_time:.2f} s",
    )
    moments = Moments(PAPER, MACHINE, CELLS)
    moments.add(data)
    fit_local_from(moments, bins[:300])  # compiled before the clock starts
    fast_time, fast = timed(lambda: fit_local_from(moments, bins, kernels=kernels), 5)
    probe = data.take(slice(0, 20_000))
    error = np.sqrt(np.mean((fast.predict(probe) - exact.predict(probe)) ** 2)) / NOISE
    yield row(
        "fits from sufficient statistics, same",
        "the exact fits",
        exact_time / fast_time,
        ">= 10",
        f"{error:.4f} of the noise (goal 0.005), {fast_time:.3f} s",
    ) | {"within": bool(error <= 0.005)}
    yield from _large(*large)


def _away_from_lstsq(X: np.ndarray, data: Samples, centres: np.ndarray, exact: LocalEquations) -> float:
    """Largest rms difference of predictions on x to numpy's least squares with the same ridge, over the noise."""
    penalty, worst = np.eye(len(PAPER)) * PAPER.floor, 0.0
    penalty[PAPER.constant] = 0.0
    for b, centre in enumerate(centres):
        w = exact.kernels[0].weights(centre[None], data.reduced)[0]
        root = np.sqrt(w / w.sum())
        A, y = np.vstack([root[:, None] * X, penalty]), np.r_[root * data.currents[:, 0], np.zeros(len(PAPER))]
        c = np.linalg.lstsq(A, y, rcond=None)[0]
        worst = max(worst, float(np.sqrt(np.mean((X @ (c - exact.coefficients[0, b])) ** 2))) / NOISE)
    return worst


_PEERS: dict[str, float] = {}


def peers_cache(X: np.ndarray, data: Samples, centres: np.ndarray, kernels: tuple[Kernel, ...]) -> dict[str, float]:
    if not _PEERS:
        _PEERS.update(peers(X, data.currents, data.reduced, centres, kernels))
    return _PEERS


def _large(n: int, b: int) -> Iterator[dict[str, Any]]:
    data, bins = samples(n), bins_of(b)
    grid = CELLS
    key = grid.ids(data.reduced)
    order = np.argsort(key, kind="stable")
    z = stack(PAPER.design(data, MACHINE), data.currents)[order]
    key = key[order]
    starts = np.r_[np.flatnonzero(np.r_[True, key[1:] != key[:-1]]), n]
    out, half = np.empty((len(starts) - 1, width(len(PAPER)))), len(starts) // 2

    def one_pass() -> None:
        from concurrent.futures import ThreadPoolExecutor

        spans = [(0, half), (half, len(starts) - 1)]
        with threadpool_limits(1), ThreadPoolExecutor(2) as pool:
            list(pool.map(lambda s: accumulate(z, starts[s[0] : s[1] + 1], len(PAPER), out[s[0] : s[1]]), spans))

    pass_time = timed(one_pass)[0]
    read_time = timed(lambda: z.sum())[0]
    yield row(
        f"pass over {n} sorted rows into {len(out)} cells",
        "reading the rows once (sum)",
        pass_time / read_time,
        "<= 10",
        f"{pass_time:.3f} s",
    )
    moments = Moments(PAPER, MACHINE, grid)
    moments.add(data)
    shared = (PAPER_KERNELS[0],) * 4
    own = timed(lambda: fit_local_from(moments, bins, kernels=PAPER_KERNELS))[0]
    one = timed(lambda: fit_local_from(moments, bins, kernels=shared))[0]
    yield row(f"{b} bins from statistics of {n} rows, s", "a kernel per axis (table 2)", own, "<= 0.5", "–")
    yield row(f"{b} bins from statistics of {n} rows, s", "one kernel for all axes", one, "<= 0.5", "–")
    part = samples(15_000, 7)
    update = timed(lambda: moments.add(part), 5)[0]
    yield row("a new part of 15 000 rows added, ms", f"statistics of {n} rows", 1e3 * update, "<= 50", "exact")


def row(work: str, peer: str, ratio: float, goal: str, error: str) -> dict[str, Any]:
    return {"work": work, "peer": peer, "ratio": round(float(ratio), 3), "goal": goal, "error": error}


if __name__ == "__main__":
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    for line in lines():
        print(
            f"{line['ratio']:>10.4g}  goal {line['goal']:<8} {line['work']} | {line['peer']} | {line['error']}",
            flush=True,
        )
