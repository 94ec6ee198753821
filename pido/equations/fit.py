"""One equation for all samples, and one per bin of the reduced space (paper, eq. 9 to 13), for four axes at once.

In:  samples (exact distances: the definition) or per-bin statistics (fast), bins, a term set, a kernel per axis.
Out: `LocalEquations`: currents, leverage, standard error and support wherever a sample lies.
"""

from __future__ import annotations

import logging
import threading
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field

import numba
import numpy as np

from pido.core.arrays import Bool1D, Float1D, Float2D, Float3D, Int1D, Int2D
from pido.core.axes import AXES
from pido.core.errors import FitError
from pido.core.machining import Machine
from pido.core.samples import Samples
from pido.equations.moments import Moments
from pido.equations.rows import columns, patterns, products, stack, total
from pido.equations.separable import NEAR, Columns
from pido.equations.solve import Solution, excited, solve
from pido.equations.terms import PAPER, TermSet
from pido.equations.weights import (
    PAPER_KERNELS,
    ROWS,
    Kernel,
    WeightedSums,
    add_share,
    in_threads,
    padded,
    weighted_sums,
)
from pido.feature_space.density import locate
from pido.feature_space.grid import EQUATION_GRID, Grid

log = logging.getLogger(__name__)
_CHUNK = 1 << 15


@dataclass(frozen=True, eq=False)
class GlobalEquation:
    """One set of coefficients for all samples.

    coefficients : (4, p), A at the machine's range; NaN for an axis without current
    factor : (4, p, p); effective : (4,) – number of samples; noise : (4,), A; rank : (4,)
    dropped : names of terms that the samples cannot tell from the constant, or that are zero throughout
    """

    terms: TermSet
    machine: Machine
    coefficients: Float2D
    factor: Float3D
    effective: Float1D
    noise: Float1D
    rank: Int1D
    dropped: tuple[str, ...]

    def predict(self, samples: Samples) -> Float2D:
        """(n, 4), A: currents by this equation; NaN for an axis that was not recorded."""
        return self.terms.design(samples, self.machine) @ self.coefficients.T

    def leverage(self, samples: Samples) -> Float2D:
        """(n, 4): x' (sum x x')^-1 x of each row and axis."""
        return self.leverage_of(self.terms.design(samples, self.machine))

    def leverage_of(self, design: Float2D) -> Float2D:
        """(n, 4): the same of rows of the design matrix. Axes that share their samples share their leverage."""
        at, out = np.zeros(len(design), np.int64), np.empty((len(design), 4))
        for axis in range(4):
            same = next((k for k in range(axis) if np.array_equal(self.factor[k], self.factor[axis])), axis)
            if same == axis:
                out[:, axis] = _quadratic(design, self.factor[axis][None], at)
            else:
                out[:, axis] = out[:, same]
        return out / np.maximum(self.effective, 1.0)


@dataclass(frozen=True, eq=False)
class LocalEquations:
    """One set of coefficients per bin and axis; outside the fitted bins, the global equation.

    bins : (b,), ascending ids of `grid`
    coefficients : (4, b, p), A at the machine's range; NaN for an axis without current
    effective : (4, b) – (sum w)² / sum w², how many samples a bin's equation really rests on
    global_share : (4, b) – share of a bin's weight that is beta's, so the same for all bins
    noise : (4, b), A – weighted residual of the fit; rank : (4, b)
    locality : (4,), A² – mean square by which bins differ from the global equation beyond what noise explains
    """

    terms: TermSet
    machine: Machine
    grid: Grid
    bins: Int1D
    kernels: tuple[Kernel, ...]
    coefficients: Float3D
    effective: Float2D
    global_share: Float2D
    noise: Float2D
    rank: Int2D
    locality: Float1D
    overall: GlobalEquation
    blend: bool = False
    _factor: tuple[Float3D, ...] = field(default=(), repr=False)

    def predict(self, samples: Samples) -> Float2D:
        """(n, 4), A: currents (eq. 13). With `blend`, drawn to the global equation as support runs out (`share`)."""
        return self.predict_with_support(samples)[0] if self.blend else self._predict_plain(samples)

    def predict_with_support(self, samples: Samples) -> tuple[Float2D, Float2D, Float2D]:
        """Currents, their standard error and their leverage: (n, 4) in A, (n, 4) in A, (n, 4).

        leverage : x' (sum w x x' / sum w)^-1 x over the effective number of samples. The variance of a prediction is
            leverage times noise²; a direction that no sample moved in has a very large one, however many lie near.
        The blend is the empirical-Bayes one: a bin differs from the global equation by a spread with variance
        `locality`, its estimate is off by leverage times noise², so the bin's own word counts
        locality / (locality + leverage noise²).
        """
        n = len(samples)
        current, error, leverage = np.empty((n, 4)), np.empty((n, 4)), np.empty((n, 4))
        for start in range(0, n, _CHUNK):
            part = samples.take(slice(start, start + _CHUNK))
            rows = slice(start, start + len(part))
            design = self.terms.design(part, self.machine)
            known, at = locate(self.bins, self.grid.ids(part.reduced))
            common, everywhere = design @ self.overall.coefficients.T, np.full((len(part), 4), np.nan)
            fitted = np.asarray(np.isfinite(self.overall.coefficients).all(axis=1))
            # the global equation's leverage counts where it speaks: outside the bins, or blended with one
            needed = np.ones(len(part), bool) if self.blend or not fitted.all() else ~known
            everywhere[needed] = self.overall.leverage_of(np.ascontiguousarray(design[needed]))
            here, b = np.ascontiguousarray(design[known]), at[known]
            for axis in range(4):
                out, lev = common[:, axis].copy(), everywhere[:, axis].copy()
                err = np.sqrt(lev) * self.overall.noise[axis]
                if known.any() and fitted[axis]:
                    own = _dot(here, self.coefficients[axis], b)
                    h = _quadratic(here, self._factor[axis], b) / self.effective[axis][b]
                    variance = h * self.noise[axis][b] ** 2
                    trust = np.ones(len(b))
                    if self.blend:
                        trust = self.locality[axis] / np.maximum(self.locality[axis] + variance, 1e-300)
                    out[known] = trust * own + (1 - trust) * out[known]
                    if self.blend:
                        err[known] = np.sqrt(trust**2 * variance + (1 - trust) ** 2 * err[known] ** 2)
                    else:
                        err[known] = np.sqrt(variance)
                    lev[known] = h
                current[rows, axis], error[rows, axis], leverage[rows, axis] = out, err, lev
        return current, error, leverage

    def _predict_plain(self, samples: Samples) -> Float2D:
        out = np.empty((len(samples), 4))
        for start in range(0, len(samples), _CHUNK):
            part = samples.take(slice(start, start + _CHUNK))
            design = self.terms.design(part, self.machine)
            known, at = locate(self.bins, self.grid.ids(part.reduced))
            values = design @ self.overall.coefficients.T
            here = np.ascontiguousarray(design[known])
            for axis in range(4):
                values[known, axis] = _dot(here, self.coefficients[axis], at[known])
            out[start : start + len(part)] = values
        return out


def fit_global(samples: Samples, machine: Machine, terms: TermSet = PAPER) -> GlobalEquation:
    """One equation for all samples, each with weight 1 (paper: the global PE). FitError where there are none."""
    return _Rows(samples, terms, machine).overall()


def fit_local(
    samples: Samples,
    bins: Int1D,
    machine: Machine,
    *,
    terms: TermSet = PAPER,
    kernels: Sequence[Kernel] = PAPER_KERNELS,
    grid: Grid = EQUATION_GRID,
    blend: bool = False,
) -> LocalEquations:
    """One equation per bin, every sample weighted by its own distance (eq. 10 to 12): the exact form."""
    return _Rows(samples, terms, machine).local(bins, kernels, grid, blend)


def fit_local_from(
    moments: Moments,
    bins: Int1D,
    *,
    kernels: Sequence[Kernel] = PAPER_KERNELS,
    grid: Grid = EQUATION_GRID,
    blend: bool = False,
) -> LocalEquations:
    """The same from per-bin statistics: a sample's weight is that of the centroid of its cell.

    Costs bins times cells, whatever the number of samples. The difference to the exact form falls with
    (cell width / sigma)²; `approximation` measures it.
    """
    return _Cells(moments).local(bins, kernels, grid, blend)


def fit_global_from(moments: Moments) -> GlobalEquation:
    """The global equation from per-bin statistics: exactly the one that the samples give."""
    return _Cells(moments).overall()


def approximation(fast: LocalEquations, exact: LocalEquations, samples: Samples) -> Float1D:
    """(4,): rms difference of two fits' predictions over the noise of the second: what the fast form costs."""
    difference = fast.predict(samples) - exact.predict(samples)
    return np.sqrt(np.mean(difference**2, axis=0)) / np.median(exact.noise, axis=1)


class _Evidence(ABC):
    """What equations are fitted on: points that each stand for `counts` samples and carry a packed row."""

    terms: TermSet
    machine: Machine
    points: Float2D
    counts: Int1D
    pattern: Int1D

    @abstractmethod
    def local_sums(
        self, centres: Float2D, which: Int1D | None, axes: list[int], whole: Float1D, kernel: Kernel
    ) -> WeightedSums:
        """Sums of the packed rows of `axes` under a kernel, over the points `which` (of all); `whole` without one."""

    @abstractmethod
    def total(self, which: Int1D | None) -> Float1D:
        """Sum of the packed rows of the points `which` (of all), for all axes."""

    def subset(self, axis: int) -> Int1D | None:
        """Points with a current on `axis`; None for all of them."""
        has = (self.pattern >> axis) & 1 == 1
        return None if has.all() else np.flatnonzero(has)

    def overall(self) -> GlobalEquation:
        if not len(self.counts):
            raise FitError("an equation needs samples, and there are none: add a recorded part first.")
        p = len(self.terms)
        coefficients, factor = np.full((4, p), np.nan), np.zeros((4, p, p))
        effective, noise, rank = np.zeros(4), np.full(4, np.nan), np.zeros(4, np.int64)
        lost: set[str] = set()
        for axes, which in self._groups(None):
            counts = self.counts if which is None else self.counts[which]
            if not counts.sum():
                continue
            sums, n = self.total(which)[columns(p, axes)], np.array([float(counts.sum())])
            keep, own = excited(sums, p, self.terms.constant), self.terms.own(AXES[axes[0]])
            weighted = WeightedSums(sums[None], n, n)
            one = solve(weighted, keep, self.terms.constant, self.terms.floor, own=own, prior=self.terms.prior)
            coefficients[axes], factor[axes], noise[axes] = one.coefficients[0], one.factor[0], one.noise[0]
            effective[axes], rank[axes] = one.effective[0], one.rank[0]
            lost |= {self.terms.names[k] for k in np.flatnonzero(own & ~keep)}
        dropped = tuple(name for name in self.terms.names if name in lost)
        log.debug("global equation '%s': %d samples, rank %s, dropped: %s", self.terms.id, len(self.counts),
                  dict(zip(AXES, rank.tolist(), strict=True)), ", ".join(dropped) or "none")  # fmt: skip
        return GlobalEquation(self.terms, self.machine, coefficients, factor, effective, noise, rank, dropped)

    def local(self, bins: Int1D, kernels: Sequence[Kernel], grid: Grid, blend: bool) -> LocalEquations:
        bins, overall = np.unique(np.asarray(bins, np.int64)), self.overall()
        if len(kernels) != 4:
            raise FitError(f"{len(kernels)} kernels for the axes {', '.join(AXES)}: one each is needed.")
        centres, p, b = grid.centres(bins), len(self.terms), len(bins)
        coefficients, effective, share = np.full((4, b, p), np.nan), np.ones((4, b)), np.ones((4, b))
        noise, rank, locality = np.full((4, b), np.nan), np.zeros((4, b), np.int64), np.zeros(4)
        factors: list[Float3D] = [np.zeros((b, p, p))] * 4
        for axes, which in self._groups(kernels) if b else ():
            counts = self.counts if which is None else self.counts[which]
            if not len(counts):
                continue
            kernel, whole = kernels[axes[0]], self.total(which)[columns(p, axes)]
            keep = excited(whole, p, self.terms.constant)
            sums = self.local_sums(centres, which, axes, whole, kernel)
            if not (sums.total > 0).all():
                raise FitError(f"{kernel} leaves a bin without any weight: give beta a small positive value.")
            base = overall.coefficients[axes]
            own = self.terms.own(AXES[axes[0]])
            one = solve(sums, keep, self.terms.constant, self.terms.floor, base, own, self.terms.prior)
            coefficients[axes] = one.coefficients.transpose(1, 0, 2)
            effective[axes], rank[axes], noise[axes] = one.effective, one.rank, one.noise.T
            share[axes] = kernel.beta * counts.sum() / sums.total
            locality[axes] = _locality(one)
            for axis in axes:
                factors[axis] = one.factor
        log.debug("local equations '%s': %d bins, median effective samples %s", self.terms.id, b,
                  dict(zip(AXES, np.median(effective, axis=1).round().tolist(), strict=True)) if b else {})  # fmt: skip
        return LocalEquations(
            self.terms, self.machine, grid, bins, tuple(kernels), coefficients, effective, share, noise, rank,
            locality, overall, blend, tuple(factors),
        )  # fmt: skip

    def _groups(self, kernels: Sequence[Kernel] | None) -> list[tuple[list[int], Int1D | None]]:
        """Axes that share weights, samples and columns, so that one Gram matrix serves them all."""
        groups: dict[object, tuple[list[int], Int1D | None]] = {}
        for axis in range(4):
            which = self.subset(axis)
            own = self.terms.own(AXES[axis]).tobytes()
            key = (None if kernels is None else kernels[axis], None if which is None else which.tobytes(), own)
            groups.setdefault(key, ([], which))[0].append(axis)
        return list(groups.values())


def _locality(one: Solution) -> Float1D:
    by_chance = one.noise**2 * (one.rank / one.effective)[:, None]
    return np.maximum(np.mean(one.moved - by_chance, axis=0), 0.0)


class _Rows(_Evidence):
    """Samples themselves: each its own point."""

    def __init__(self, samples: Samples, terms: TermSet, machine: Machine) -> None:
        self.terms, self.machine = terms, machine
        self.points, self.pattern = samples.reduced, patterns(samples.currents)
        self.counts = np.ones(len(samples), np.int64)
        self._z = stack(terms.design(samples, machine), samples.currents)
        self._total: Float1D | None = None
        if not (np.isfinite(self._z).all() and np.isfinite(self.points).all()):
            raise FitError("some samples have missing inputs. They are never filled in: leave them out.")

    def local_sums(
        self, centres: Float2D, which: Int1D | None, axes: list[int], whole: Float1D, kernel: Kernel
    ) -> WeightedSums:
        p, local, wanted = len(self.terms), threading.local(), np.asarray(axes)
        z, points = (self._z, self.points) if which is None else (self._z[which], self.points[which])

        def tile(start: int, stop: int) -> Float2D:
            if not hasattr(local, "buffer"):
                local.buffer = np.zeros((ROWS, padded(len(whole))))
            out = local.buffer[: stop - start]
            products(z[start:stop], p, wanted, out)
            return out

        return weighted_sums(centres, points, np.ones(len(points)), tile, whole, kernel)

    def total(self, which: Int1D | None) -> Float1D:
        if which is not None:
            return total(self._z[which], len(self.terms))
        if self._total is None:
            self._total = total(self._z, len(self.terms))
        return self._total


class _Cells(_Evidence):
    """Per-bin statistics: each occupied cell is a point at its centroid."""

    def __init__(self, moments: Moments) -> None:
        self.terms, self.machine = moments.terms, moments.machine
        self.points, self.counts, self.pattern, self._sums = moments.cells()
        self._index = moments.grid.index(moments.keys >> 4)

    def local_sums(
        self, centres: Float2D, which: Int1D | None, axes: list[int], whole: Float1D, kernel: Kernel
    ) -> WeightedSums:
        rows = slice(None) if which is None else which
        points, counts = self.points[rows], self.counts[rows].astype(float)
        wanted = columns(len(self.terms), axes)
        sums = self._sums[rows][:, wanted]
        cells = Columns(points, self._index[rows], counts, sums)
        few = cells.operations(centres) < 0.5 * len(points) * len(centres)
        if few and cells.way() <= NEAR * kernel.sigma:
            return add_share(cells.sums(centres, kernel), whole, float(counts.sum()), kernel.beta)
        block = np.zeros((len(points), padded(len(wanted))))
        block[:, : len(wanted)] = sums
        return weighted_sums(centres, points, counts, lambda start, stop: block[start:stop], whole, kernel)

    def total(self, which: Int1D | None) -> Float1D:
        return (self._sums if which is None else self._sums[which]).sum(axis=0)


def _dot(design: Float2D, coefficients: Float2D, at: Int1D) -> Float1D:
    """x . c of each row under the coefficients of its bin."""
    return np.einsum("rj,rj->r", design, coefficients[at])


def _quadratic(design: Float2D, factor: Float3D, at: Int1D) -> Float1D:
    """|F x|² of each row under the factor of its bin."""
    out, half = np.empty(len(design)), -(-len(design) // 2)
    in_threads(
        lambda rows: _squares(design[rows], factor, at[rows], out[rows]),
        [slice(0, half), slice(half, None)],
        size=10 * design.size * design.shape[1],
    )
    return out


@numba.njit(nogil=True, cache=True, fastmath={"contract", "reassoc"})
def _squares(design: Float2D, factor: Float3D, at: Int1D, out: Float1D) -> None:
    p = design.shape[1]
    for r in range(len(design)):
        f, total_square = factor[at[r]], 0.0
        for i in range(p):
            s = 0.0
            for j in range(p):
                s += f[i, j] * design[r, j]
            total_square += s * s
        out[r] = total_square


def usable(samples: Samples) -> Bool1D:
    """(n,): rows with every input and at least one current: those that an equation or model can learn from."""
    return (
        np.isfinite(samples.inputs).all(axis=1)
        & np.isfinite(samples.ar)
        & np.isfinite(samples.direction).all(axis=1)
        & np.isfinite(samples.currents).any(axis=1)
    )
