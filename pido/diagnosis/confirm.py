"""Is it more than noise, and does it hold on data that the fit had not seen?

In:  one axis of all parts, the joint model, its noise.
Out: p values that blocks stand behind, errors before and after on unseen parts, intervals by block bootstrap.
Source: cluster-robust Wald test (Liang and Zeger 1986; small-sample form CR1); false discovery rate (Benjamini and
Hochberg 1995); a variance of few blocks judged beside that of all (as Smyth 2004); amplitudes of single blocks
(Ibragimov and Müller 2010); resampled blocks carry the whole joint fit (Künsch 1989, with the weights of Rubin 1981).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from pido.core.arrays import Array1D, Bool1D, Float1D, Float2D, Int1D
from pido.diagnosis.events import ExternalForce
from pido.diagnosis.finding import HeldOut
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.terms import Term, held_back, solve, solve_normal
from pido.diagnosis.whiten import Noise

SIGNIFICANT = 0.01  # q value, over every axis, mechanism and shape that was tried
LESS_WHERE_WRONG = 0.045  # of the error where a wrong coefficient or a shift in time acts: three tenths of the noise
_DRAWS = 400
_MANY_BLOCKS = 30  # beyond which Student's t of their number is nearly normal
_OF_A_BASE = 1e-3  # of the power of a term of the equation, by which it is drawn to zero in folds
_SOME = 0.01  # of the power of the block that has most of a term's: enough to tell the amplitude
_FEWEST_ALIKE = 6  # blocks
_MERGED = (1, 4, 16)  # blocks that count as one observation
_FEWEST_UNITS = 6  # observations to resample
_FEWEST_PARTS_TO_RESAMPLE = 6


@dataclass(frozen=True)
class Whitened:
    """Base and terms of a joint model as whitened rows, and where each term's rows are."""

    X: Float2D
    y: Float1D
    spans: tuple[slice, ...]


def whitened(mismatch: Mismatch, noise: Noise, terms: Sequence[Term]) -> Whitened:
    columns = [t.columns(mismatch.states) for t in terms]
    sizes = np.cumsum([len(mismatch.base), *[len(c) for c in columns]])
    spans = tuple(slice(int(i), int(j)) for i, j in itertools.pairwise(sizes))
    return Whitened(
        noise.whiten(np.concatenate([mismatch.base, *columns])), noise.whiten(mismatch.target[None])[0], spans
    )


def p_value(model: Whitened, which: int, block: Int1D, pooled: bool = False, least: float = 0.0) -> float:
    """Two-sided p of one term given all others: the larger of the classical F test and the block-robust Wald test.

    pooled : where few blocks speak for the term, but at least so many, all blocks say how far their sums scatter
    """
    own = model.spans[which]
    others = np.delete(model.X, np.r_[own], axis=0)
    X = model.X[own]
    X = X[np.any(X, axis=1)]  # a form does without some amplitudes: no question is asked of them
    if not len(X):
        return 1.0
    if len(others):
        weights = [solve(others, x)[0] for x in X]
        X = X - np.asarray(weights) @ others
    gamma, _ = solve(others, model.y)
    y = model.y - gamma @ others if len(others) else model.y
    beta, _ = solve(X, y)
    residual = y - beta @ X
    k, n = len(X), int(np.count_nonzero(model.y))
    free = max(1, n - len(model.X))
    gain = float(y @ y - residual @ residual)
    classical = float(stats.f.sf(max(gain, 0.0) / k / (residual @ residual / free), k, free))
    scores = _sums(X * residual, block)  # (blocks, k)
    q = np.bincount(block, np.einsum("ij,ij->j", X / _size(X)[:, None], X / _size(X)[:, None]))
    effective = float(q.sum() ** 2 / max(np.sum(q**2), 1e-300))  # blocks that carry the information
    bread = np.linalg.pinv(X @ X.T, rcond=1e-9)
    meat = scores.T @ scores * effective / max(effective - 1.0, 0.5)
    cover = bread @ meat @ bread
    wald = float(beta @ np.linalg.pinv(cover, rcond=1e-9) @ beta) / k
    robust = float(stats.f.sf(wald, k, max(1.0, effective - 1.0)))
    if pooled and least <= effective < _MANY_BLOCKS:
        # A variance of few blocks is hardly known. What all blocks say of it is: how far their sums scatter beyond what
        # independent rows would. The larger of the two stands, with the certainty of all blocks.
        rows = np.maximum(np.bincount(block, model.y != 0), 1)
        scatter = float(np.mean(np.bincount(block, residual) ** 2 / rows)) / float(residual @ residual / free)
        wald = min(wald, gain / k / (residual @ residual / free) / max(1.0, scatter))
        robust = min(robust, float(stats.f.sf(wald, k, len(rows) - 1)))
    if pooled and k == 1 and effective < _MANY_BLOCKS:
        robust = min(robust, 2 * _p_of_blocks_alike(X[0], y, block))
    return float(min(1.0, max(classical, robust)))


def _p_of_blocks_alike(x: Float1D, y: Float1D, block: Int1D) -> float:
    """p that amplitudes, each of one block by itself, are zero on the mean: where one block has most of the power, the
    others say whether it is one event. 1 where too few have some. Source: Ibragimov and Müller 2010."""
    power, inner = np.bincount(block, x**2), np.bincount(block, x * y)
    some = power > _SOME * power.max()
    if some.sum() < _FEWEST_ALIKE:
        return 1.0
    each = inner[some] / power[some]
    return 2 * min(p_of_mean(each), p_of_mean(-each))


def q_values(p: Sequence[float], questions: int) -> list[float]:
    """Benjamini-Hochberg over all questions asked; those that were not kept count as p = 1.

    >>> [round(q, 3) for q in q_values([0.001, 0.01], questions=100)]
    [0.1, 0.5]
    """
    order = np.argsort(p)
    q = np.ones(len(p))
    running = 1.0
    for rank in range(len(p), 0, -1):
        i = order[rank - 1]
        running = min(running, p[i] * questions / rank)
        q[i] = running
    return [float(v) for v in q]


def held_out(
    mismatch: Mismatch, noise: Noise, kept: Sequence[Term], without: Sequence[Term], recorded: Float1D
) -> HeldOut:
    """Errors of the whole model `kept` and of the model `without` a finding, on folds that were not fitted.

    recorded : (n,), A – the recorded current, whose variance R² is counted in
    """
    own = [t for t in kept if t not in without]
    events, fold = forces_among(own), fold_of(mismatch, own)
    # Terms of the equation that the other folds hardly tell apart would take large sizes against one another, which the
    # fold left out shows as an error of many times the current.
    before, after = (cross_residual(mismatch, noise, t, fold, _OF_A_BASE) for t in (without, kept))
    rows = mismatch.usable
    b, a, current = before[rows], after[rows], recorded[rows]
    total = float(np.mean((current - current.mean()) ** 2)) or 1.0
    return HeldOut(
        scheme="leave-one-block-out" if events else mismatch.scheme,
        rmse_before=_rms(b),
        rmse_after=_rms(a),
        r2_before=1 - _rms(b) ** 2 / total,
        r2_after=1 - _rms(a) ** 2 / total,
        p_value=paired_p(before**2 - after**2, mismatch, rows),
    )


def less_error_there(
    mismatch: Mismatch, noise: Noise, kept: Sequence[Term], without: Sequence[Term], rows: Bool1D
) -> float:
    """What `kept` leaves of the error of `without` in these rows (n,), on folds that were not fitted."""
    fold = fold_of(mismatch, [t for t in kept if t not in without])
    before, after = (_rms(cross_residual(mismatch, noise, t, fold)[rows]) for t in (without, kept))
    return after / before if before > 0 else 1.0


def forces_among(terms: Sequence[Term]) -> bool:
    """Whether a force over intervals is among them."""
    return any(isinstance(t.mechanism, ExternalForce) for t in terms)


def fold_of(mismatch: Mismatch, terms: Sequence[Term]) -> Int1D:
    """(n,) – what is left out together to prove `terms`: a force over intervals of one part can be proved on other
    seconds of the same part only."""
    return mismatch.block % 5 if forces_among(terms) else mismatch.fold


def cross_residual(
    mismatch: Mismatch, noise: Noise, terms: Sequence[Term], fold: Int1D | None = None, of_base: float = 0.0
) -> Float1D:
    """(n,), A – residual of each fold under the amplitudes of the other folds.

    of_base : of its power, by which each term of the equation is drawn to zero
    """
    columns = [t.columns(mismatch.states) for t in terms]
    design = np.concatenate([mismatch.base, *columns])
    if len(design) == 0:
        return mismatch.target
    X, y = noise.whiten(design), noise.whiten(mismatch.target[None])[0]
    out = np.empty(mismatch.n)
    fold = mismatch.fold if fold is None else fold
    drawn, base = held_back(X, len(mismatch.base), terms, columns), X[: len(mismatch.base)]
    if len(base) > 1:
        drawn[: len(base)] += of_base * np.einsum("ij,ij->i", base, base)
    ridge = np.diag(drawn)
    members = [np.flatnonzero(fold == k) for k in np.unique(fold)]
    within = [(X[:, rows], y[rows]) for rows in members]
    grams = np.array([a @ a.T for a, _ in within])
    inner = np.array([a @ b for a, b in within])
    for k, rows in enumerate(members):
        others = np.arange(len(members)) != k
        beta, _ = solve_normal(grams[others].sum(axis=0) + ridge, inner[others].sum(axis=0))
        out[rows] = mismatch.target[rows] - beta @ design[:, rows]
    return out


def even(mismatch: Mismatch) -> Noise:
    """Noise that is the same everywhere and forgets at once."""
    return Noise(np.zeros(0), np.ones(mismatch.n), 1.0, mismatch.usable)


def rms_held_out(mismatch: Mismatch, noise: Noise, terms: Sequence[Term], fold: Int1D | None = None) -> float:
    """A, on folds that were not fitted."""
    left = cross_residual(mismatch, noise, terms, fold)[mismatch.usable]
    return float(np.sqrt(np.mean(left**2)))


def plain_error(mismatch: Mismatch, terms: Sequence[Term]) -> float:
    """A, on folds that were not fitted, under ordinary least squares."""
    return plain_errors(mismatch, terms)[0]


def plain_errors(mismatch: Mismatch, *models: Sequence[Term]) -> tuple[float, ...]:
    """The same of several models to be compared, on the same folds: those that a force among any of them asks for."""
    fold = fold_of(mismatch, list(itertools.chain(*models)))
    return tuple(rms_held_out(mismatch, even(mismatch), terms, fold) for terms in models)


def no_more_error(mismatch: Mismatch, terms: Sequence[Term], others: Sequence[Term], times: float = 1.0) -> bool:
    """Whether the plain error of `terms` on unseen folds is at most so many times that of `others`."""
    now, former = plain_errors(mismatch, terms, others)
    return now <= times * former


def less_error(mismatch: Mismatch, terms: Sequence[Term], others: Sequence[Term], share: float) -> bool:
    """Whether `terms` make the plain error on unseen folds smaller than `others` do, by more than `share` of it."""
    return not no_more_error(mismatch, others, terms, 1 / (1 - share))


def paired_p(gain: Float1D, mismatch: Mismatch, rows: Bool1D | None = None) -> float:
    """One-sided p that the mean gain over blocks is positive (paired t test, blocks as observations)."""
    block = mismatch.block if rows is None else mismatch.block[rows]
    gain = gain if rows is None else gain[rows]
    count = np.bincount(block)
    return p_of_mean(np.bincount(block, gain)[count > 0])


def p_of_mean(values: Array1D) -> float:
    """One-sided p that the mean of independent values is positive (t test); 1 where they are too few to say."""
    if len(values) < 3 or np.ptp(values) == 0:
        return 1.0
    _, p = np.asarray(stats.ttest_1samp(values, 0.0, alternative="greater"))
    return float(p)


def bootstrap(model: Whitened, unit: Int1D, rng: np.random.Generator, draws: int = _DRAWS) -> Float2D:
    """(draws, base + amplitudes): the joint fit on resampled observations; unit : (n,) – which one a row belongs to."""
    order = np.argsort(unit, kind="stable")
    first = np.flatnonzero(np.r_[True, np.diff(unit[order]) > 0])
    rows = np.split(order, first[1:])
    grams = np.array([model.X[:, r] @ model.X[:, r].T for r in rows])
    inner = np.array([model.X[:, r] @ model.y[r] for r in rows])
    size = np.sqrt(np.maximum(np.diag(grams.sum(0)), 1e-300))
    grams, inner = grams / np.outer(size, size), inner / size
    out = np.empty((draws, len(size)))
    for d in range(draws):
        # Random weights of mean 1 (Bayesian bootstrap): no draw loses the only block that shows a term.
        w = rng.exponential(size=len(rows))
        out[d] = np.linalg.pinv(np.einsum("u,uij->ij", w, grams), rcond=1e-9, hermitian=True) @ (w @ inner) / size
    return out


def half_widths(model: Whitened, mismatch: Mismatch, rng: np.random.Generator, draws: int = _DRAWS) -> Float1D:
    """Half of the 95 % interval of every coefficient: the widest over observations of several lengths.

    What a simulation lacks may wander over longer than a block: blocks put together show it (Künsch 1989 on the length
    of a block), as long as enough of them are left to resample.
    """
    beta, covariance = solve(model.X, model.y)
    lengths = [mismatch.block // merged for merged in _MERGED]
    if len(mismatch.states) >= _FEWEST_PARTS_TO_RESAMPLE:
        lengths.append(mismatch.part)
    widest = np.zeros(len(beta))
    for unit in lengths:
        count = len(np.unique(unit))
        if count >= _FEWEST_UNITS or unit is lengths[0]:
            bounds = interval(beta, covariance, bootstrap(model, unit, rng, draws), count)
            widest = np.maximum(widest, [0.5 * (high - low) for low, high in bounds])
    return widest


def interval(beta: Float1D, covariance: Float2D, draws: Float2D, units: int) -> list[tuple[float, float]]:
    """95 % per coefficient: the larger of classical and bootstrap spread, Student's t of the number of units.

    Few units make the bootstrap's spread too small by sqrt((units - 1) / units); that is put back.
    """
    classical = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    resampled = draws.std(axis=0) * np.sqrt(units / max(1, units - 1))
    sd = np.maximum(classical, resampled)
    t = float(stats.t.ppf(0.975, max(2, units - 1))) if units < 30 else 1.96
    t = np.where(resampled > classical, t, 1.96)
    return [(float(b - s * u), float(b + s * u)) for b, s, u in zip(beta, sd, t, strict=True)]


def _size(X: Float2D) -> Float1D:
    return np.sqrt(np.maximum(np.einsum("ij,ij->i", X, X), 1e-300))


def _sums(rows: Float2D, block: Int1D) -> Float2D:
    return np.array([np.bincount(block, r) for r in rows], float).T


def _rms(x: Float1D) -> float:
    return float(np.sqrt(np.mean(x**2))) if len(x) else float("nan")
