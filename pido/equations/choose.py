"""Which equation the data at hand ask for: terms, width and reach of the weights, per axis, from held-out stretches.

In:  samples, machine, candidates from plain to rich. Out: one choice per axis, its held-out errors, and the fitted
     equations on any bins.

The paper fixes alpha, beta, sigma for all machines (table 2) and asks for an adaptive choice in its outlook. A richer
candidate must beat a plainer one by more than the scatter between the stretches: the plainest candidate within one
standard error of the best is taken (Breiman et al. 1984, section 3.4.3), if it is within a tenth of its mean square.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pido.core.arrays import Float1D, Float2D, Int1D
from pido.core.axes import AXES
from pido.core.machining import Machine
from pido.core.samples import Samples
from pido.equations.fit import GlobalEquation, LocalEquations, fit_global, fit_local, fit_local_from
from pido.equations.moments import Moments
from pido.equations.terms import ADAPTIVE, CONSTANT, HELD, PAPER, TermSet
from pido.equations.weights import PAPER_KERNELS, Kernel
from pido.feature_space.density import locate, relevant_bins
from pido.feature_space.grid import EQUATION_GRID, SAMPLING_GRID, Grid
from pido.feature_space.regional import HeldOut, covered, folds, join, sectors

log = logging.getLogger(__name__)

EVERYWHERE = Kernel(alpha=0.0, beta=1e9, sigma=1.0)
"""A weight that is the same for all samples to nine digits: the global equation."""

CELLS = Grid((0.5, 0.5, 5.0))
_KEPT = 0.999


@dataclass(frozen=True)
class Candidate:
    """Terms and weights for one axis."""

    terms: TermSet
    kernel: Kernel

    def __str__(self) -> str:
        if self.kernel == EVERYWHERE:
            return f"{self.terms.id}, global"
        return f"{self.terms.id}, sigma {self.kernel.sigma:g} mm/s, beta {self.kernel.beta:g}"


def candidates(*extended: TermSet) -> tuple[Candidate, ...]:
    """From plain to rich: a constant, global equations, then local ones of falling width.

    extended : term sets with accepted physics, tried beside the shipped ones
    """
    sets = (*ADAPTIVE, *extended)
    kernels = [Kernel(0.1, 0.02, 4.8), Kernel(0.1, 0.02, 1.5), Kernel(0.1, 0.002, 0.6)]
    return (
        Candidate(CONSTANT, EVERYWHERE),
        *(Candidate(terms, EVERYWHERE) for terms in (*sets, PAPER)),
        *(Candidate(terms, kernel) for kernel in kernels for terms in sets),
    )


@dataclass(frozen=True, eq=False)
class Choice:
    """What was chosen and why.

    near, beyond : one candidate per axis for bins that hold samples, and for bins that hold none
    held_out : errors of the chosen candidates on rows that their fits had not seen, in either position
    scores : (2, candidates, 4), A – held-out RMSE of every candidate, near and beyond, NaN on an axis for which it has
        nothing of its own; tried : their names
    """

    near: tuple[Candidate, ...]
    beyond: tuple[Candidate, ...]
    held_out: HeldOut | None
    scores: np.ndarray
    tried: tuple[str, ...]


_PRINTED = tuple(Candidate(PAPER, kernel) for kernel in PAPER_KERNELS)
PAPER_CHOICE = Choice(_PRINTED, _PRINTED, None, np.zeros((2, 0, 4)), ())
"""Table 2 everywhere."""


@dataclass(frozen=True, eq=False)
class AxisEquations:
    """Equations of four axes that may differ in terms and weights, and between bins with and without samples.

    near, beyond : ((axes, equations), ...); occupied : bins of `coverage` that hold samples
    support : the global equation in plain inputs and held directions, whatever was chosen. An equation with few terms
        has little leverage anywhere; what the samples never did is still beyond them, so its leverage is added
    mean : (4,), A – of the samples' currents. A row whose leverage is beyond a bound is drawn to it by bound over
        leverage: a spindle that runs up, fitted on parts in which it never did, was off by 90 A where the mean is off
        by 20
    steady : (4,) – bound on the leverage of a row as if no axis accelerated in it: what nearly all samples keep as they
        are. A line through a small range of speeds or loads says nothing far beyond it
    spread : (4,) – bound on the whole leverage, at which the standard error of a prediction is the spread of the
        currents. In acceleration a line goes on by Newton's law, as far as its slope is known
    Infinite bounds: no such rule, as in the paper
    """

    near: tuple[tuple[tuple[int, ...], LocalEquations], ...]
    beyond: tuple[tuple[tuple[int, ...], LocalEquations], ...]
    occupied: Int1D
    coverage: Grid
    support: GlobalEquation
    mean: Float1D = field(default_factory=lambda: np.zeros(4))
    steady: Float1D = field(default_factory=lambda: np.full(4, np.inf))
    spread: Float1D = field(default_factory=lambda: np.full(4, np.inf))

    @property
    def machine(self) -> Machine:
        return self.near[0][1].machine

    def predict(self, samples: Samples) -> Float2D:
        """(n, 4), A: currents; NaN on an axis that was not recorded."""
        current = self._apply(samples, lambda equations, rows: (equations.predict(rows),))[0]
        contained = np.isfinite(self.steady).any()
        return self._contained(current, *_leverages(self.support, samples)) if contained else current

    def predict_with_support(self, samples: Samples) -> tuple[Float2D, Float2D, Float2D]:
        """Currents, standard errors (n, 4) in A, leverages (n, 4); see `LocalEquations.predict_with_support`."""
        current, error, leverage = self._apply(samples, lambda equations, rows: equations.predict_with_support(rows))
        whole, steady = _leverages(self.support, samples)
        return self._contained(current, whole, steady), error, leverage + whole

    def _contained(self, current: Float2D, whole: Float2D, steady: Float2D) -> Float2D:
        """Currents (n, 4), drawn to the mean where a leverage (n, 4) is beyond its bound."""
        trust = np.minimum(self.spread / np.maximum(whole, 1e-300), self.steady / np.maximum(steady, 1e-300))
        return np.where(trust < 1.0, self.mean + trust * (current - self.mean), current)

    def _apply(
        self, samples: Samples, call: Callable[[LocalEquations, Samples], tuple[Float2D, ...]]
    ) -> tuple[Float2D, ...]:
        inside = locate(self.occupied, self.coverage.ids(samples.reduced))[0]
        result: tuple[Float2D, ...] = ()
        for members, which in ((self.near, inside), (self.beyond, ~inside)):
            rows = samples if which.all() else samples.take(which)
            for axes, equations in members:
                values = call(equations, rows)
                result = result or tuple(np.full((len(samples), 4), np.nan) for _ in values)
                for out, value in zip(result, values, strict=True):
                    for axis in axes:
                        out[which, axis] = value[:, axis]
        return result


def fit_chosen(
    samples: Samples,
    bins: Int1D,
    machine: Machine,
    choice: Choice = PAPER_CHOICE,
    *,
    grid: Grid = EQUATION_GRID,
    coverage: Grid = SAMPLING_GRID,
    blend: bool = False,
    exact_up_to: float = 3e8,
) -> AxisEquations:
    """Equations on `bins` (of `grid`) as chosen per axis.

    blend : draw a bin to the global equation, and a row that no sample is like to the mean, as support runs out
    exact_up_to : samples times bins up to which distances are exact; beyond, per-bin statistics are used
    """
    exact = len(samples) * max(len(bins), 1) <= exact_up_to

    def members(axes: Sequence[Candidate]) -> tuple[tuple[tuple[int, ...], LocalEquations], ...]:
        result = []
        for terms in dict.fromkeys(candidate.terms for candidate in axes):
            own = tuple(i for i, candidate in enumerate(axes) if candidate.terms == terms)
            # axes of another member go along with the first kernel: they share its sums and cost nothing
            kernels = [axes[i].kernel if i in own else axes[own[0]].kernel for i in range(4)]
            if exact:
                equations = fit_local(samples, bins, machine, terms=terms, kernels=kernels, grid=grid, blend=blend)
            else:
                moments = Moments(terms, machine, CELLS)
                moments.add(samples)
                equations = fit_local_from(moments, bins, kernels=kernels, grid=grid, blend=blend)
            result.append((own, equations))
        return tuple(result)

    near = members(choice.near)
    beyond = near if choice.beyond == choice.near else members(choice.beyond)
    support = fit_global(samples, machine, HELD)
    equations = AxisEquations(near, beyond, np.unique(coverage.ids(samples.reduced)), coverage, support)
    if not blend:
        return equations
    mean = _mean(samples.currents, 0)
    variance = _mean((samples.currents - mean) ** 2, 0)
    steady = np.quantile(support.leverage(samples), _KEPT, axis=0)
    return replace(equations, mean=mean, steady=steady, spread=variance / np.maximum(support.noise, 1e-300) ** 2)


def _leverages(support: GlobalEquation, samples: Samples) -> tuple[Float2D, Float2D]:
    """(n, 4) twice: leverages of the samples, and of the same as if no axis accelerated."""
    design = support.terms.design(samples, support.machine)
    whole = support.leverage_of(design)
    design[:, [name.startswith("a_") for name in support.terms.names]] = 0.0
    return whole, support.leverage_of(design)


def choose(
    samples: Samples,
    machine: Machine,
    tried: Sequence[Candidate] | None = None,
    *,
    grid: Grid = EQUATION_GRID,
    coverage: Grid = SAMPLING_GRID,
    count: int = 6,
    rows_at_most: int = 30_000,
) -> Choice:
    """The plainest candidate per axis that is within one standard error of the best: on stretches (or parts) left out
    for bins that hold samples, on directions of motion left out for bins that hold none.

    rows_at_most : held-out rows that are scored, evenly taken; every row takes part in the fits.
    """
    tried = tuple(tried or candidates())
    near, near_rows = _errors(samples, machine, tried, folds(samples, count), grid, coverage, rows_at_most)
    far, far_rows = _errors(samples, machine, tried, sectors(samples), grid, coverage, rows_at_most)
    inside = _plainest(near, near_rows.fold)
    out = ~far_rows.covered
    outside = _plainest(far[:, out], far_rows.fold[out]) if out.any() else (inside[0], np.full_like(inside[1], np.nan))
    for i, axis in enumerate(AXES):
        log.info("%s: %s (held out %.4g A, constant %.4g A); beyond the samples: %s", axis, tried[inside[0][i]],
                 inside[1][inside[0][i], i], inside[1][0, i], tried[outside[0][i]])  # fmt: skip
    held_out = join(_pick(near, near_rows, inside[0]), _pick(far, far_rows, outside[0]))
    return Choice(
        tuple(tried[b] for b in inside[0]), tuple(tried[b] for b in outside[0]), held_out,
        np.stack([inside[1], outside[1]]), tuple(map(str, tried)),
    )  # fmt: skip


def _pick(errors: np.ndarray, rows: HeldOut, best: list[int]) -> HeldOut:
    return replace(rows, residual=np.stack([errors[best[i], :, i] for i in range(4)], axis=1))


def _errors(
    samples: Samples, machine: Machine, tried: Sequence[Candidate], fold: Int1D, grid: Grid, coverage: Grid, most: int
) -> tuple[np.ndarray, HeldOut]:
    """(candidates, n, 4) errors on rows left out with their fold; rows of fold -1 are in every fit and not scored."""
    labels = [k for k in np.unique(fold) if k >= 0]
    step = max(1, -(-len(samples) // most))
    parts = {k: samples.take(fold == k) for k in labels}
    scored = {k: parts[k].take(slice(None, None, step)) for k in labels}
    bins = {k: relevant_bins(scored[k].reduced, grid) for k in labels}
    errors = np.full((len(tried), sum(map(len, scored.values())), 4), np.nan)
    for terms in dict.fromkeys(candidate.terms for candidate in tried):
        each = {k: Moments(terms, machine, CELLS) for k in labels}
        together = Moments(terms, machine, CELLS)
        together.add(samples)
        start = 0
        for k in labels:
            each[k].add(parts[k])
            rest, stop = together.without(each[k]), start + len(scored[k])
            for c, candidate in enumerate(tried):
                if candidate.terms == terms and len(rest):
                    equations = fit_local_from(rest, bins[k], kernels=[candidate.kernel] * 4, grid=grid, blend=True)
                    own = [terms.concerns(axis) for axis in AXES]
                    errors[c, start:stop] = np.where(own, scored[k].currents - equations.predict(scored[k]), np.nan)
            start = stop
    points = np.concatenate([scored[k].reduced for k in labels]) if labels else np.zeros((0, 3))
    near = [covered(scored[k].reduced, samples.take(fold != k).reduced, coverage) for k in labels]
    group = np.repeat(np.asarray(labels, np.int64), [len(scored[k]) for k in labels])
    return errors, HeldOut(points, np.full((len(points), 4), np.nan), np.concatenate([*near, np.zeros(0, bool)]), group)


def _plainest(errors: np.ndarray, group: Int1D) -> tuple[list[int], Float2D]:
    labels = np.unique(group)
    square = np.stack([_mean(errors[:, group == g] ** 2, 1) for g in labels])
    scores = np.sqrt(_mean(square, 0))
    best = []
    for axis in range(4):
        mean = scores[:, axis]
        if not np.isfinite(mean).any():
            best.append(0)
            continue
        # paired: what matters is the scatter of the difference, not that of the stretches themselves
        asked = np.flatnonzero(np.isfinite(mean))
        excess = square[:, asked, axis] - square[:, [int(np.nanargmin(mean))], axis]
        excess = excess[np.isfinite(excess).all(axis=1)]
        error = np.std(excess, axis=0, ddof=1) / np.sqrt(len(excess)) if len(excess) > 1 else np.zeros(len(asked))
        # few stretches scatter so much that one standard error excuses anything: a tenth of the error is the most
        allowed = np.minimum(error, 0.1 * np.nanmin(mean) ** 2)
        best.append(int(asked[np.flatnonzero(excess.mean(axis=0) <= allowed)[0]]))
    return best, scores


def _mean(values: np.ndarray, axis: int) -> np.ndarray:
    known = np.isfinite(values)
    number = known.sum(axis=axis)
    return np.where(number > 0, np.where(known, values, 0.0).sum(axis=axis) / np.maximum(number, 1), np.nan)
