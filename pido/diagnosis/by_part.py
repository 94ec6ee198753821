"""Whether a coefficient that the simulation has wrong is wrong by the same factor in every part.

In:  the joint model of one axis, and the factor of one of its terms over all parts.
Out: the factor of each part with its interval, and whether parts that have one and the same would differ as much.
A mass that is clamped, a tool, another setting of a slide: what differs between parts is not in any one coefficient.
Source: amplitudes of single parts beside all other terms (Frisch and Waugh 1933), their errors by blocks (Liang and
Zeger 1986); means of unequal and estimated variances compared (Welch 1951, Biometrika 38, 330), which is the weighted
chi-square of Cochran (1954) where the variances are known well; how far the true ones scatter (DerSimonian and Laird
1986).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from pido.core.arrays import Float1D, Float2D, Int1D
from pido.diagnosis.confirm import whitened
from pido.diagnosis.estimate import FORM
from pido.diagnosis.finding import ByPart, Estimate
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.terms import Term, solve
from pido.diagnosis.whiten import Noise

_FEWEST_BLOCKS = 4.0  # of a part, that carry the term: fewer do not say how well its amplitude is known
_BY_CHANCE = 1e-3  # how often parts that are alike may be said to differ
_MATTERS = 0.2  # of what the coefficient lacks, that parts have to scatter by: less is the form's, not the parts'


def by_part(
    mismatch: Mismatch, noise: Noise, terms: Sequence[Term], which: int, amplitude: float, factor: float
) -> ByPart | None:
    """The factor of each part that shows it, of a term with one amplitude; None where fewer than three parts do.

    amplitude, factor : of all parts together; what is missing of the simulation's coefficient is in proportion
    """
    model = whitened(mismatch, noise, terms)
    own = model.spans[which]
    if own.stop - own.start != 1:
        return None
    others = np.delete(model.X, np.r_[own], axis=0)
    found: dict[str, tuple[float, float, float]] = {}
    for p, part in enumerate(mismatch.parts):
        rows = mismatch.part == p
        one = _amplitude(model.X[own.start, rows], others[:, rows], model.y[rows], mismatch.block[rows])
        if one is not None:
            found[part] = one
    if len(found) < 3:
        return None
    size, error, blocks = (np.array(v) for v in zip(*found.values(), strict=True))
    weight = error**-2
    scale = (factor - 1) / amplitude
    half = np.abs(scale) * error * stats.t.ppf(0.975, blocks - 1)
    factors = {
        part: Estimate(float(f), "–", (float(f - h), float(f + h)))
        for part, f, h in zip(found, 1 + scale * size, half, strict=True)
    }
    p_value, spread = _alike(size, weight, blocks), float(np.abs(scale)) * _scatter(size, weight)
    return ByPart(factors, p_value, spread, p_value < _BY_CHANCE and spread > max(FORM, _MATTERS * abs(factor - 1)))


def _amplitude(x: Float1D, others: Float2D, y: Float1D, block: Int1D) -> tuple[float, float, float] | None:
    """Amplitude of x beside others, its standard error, and the number of blocks that carry it; of one part."""
    whole = float(x @ x)
    if len(others):
        x, y = x - solve(others, x)[0] @ others, y - solve(others, y)[0] @ others
    power = float(x @ x)
    if power <= 1e-6 * whole or whole == 0:
        return None
    size = float(x @ y) / power
    left = y - size * x
    of_block = np.unique(block, return_inverse=True)[1]
    carried = np.bincount(of_block, x**2)
    blocks = float(carried.sum() ** 2 / np.sum(carried**2))
    if blocks < _FEWEST_BLOCKS:
        return None
    by_blocks = float(np.sum(np.bincount(of_block, x * left) ** 2)) / power**2 * blocks / (blocks - 1)
    free = max(1, int(np.count_nonzero(y)) - len(others) - 1)
    classical = float(left @ left) / free / power
    variance = max(by_blocks, classical)
    return (size, float(np.sqrt(variance)), blocks) if variance > 0 else None


def _alike(size: Float1D, weight: Float1D, blocks: Float1D) -> float:
    """p of means that are one and the same (Welch); weight : one over each one's variance."""
    k, share = len(size), weight / weight.sum()
    between = float(weight @ (size - share @ size) ** 2) / (k - 1)
    unsure = float(np.sum((1 - share) ** 2 / (blocks - 1)))
    ratio = between / (1 + 2 * (k - 2) / (k**2 - 1) * unsure)
    return float(stats.f.sf(ratio, k - 1, (k**2 - 1) / (3 * unsure)))


def _scatter(size: Float1D, weight: Float1D) -> float:
    """Standard deviation of what is measured, beyond that of the measuring."""
    share = weight / weight.sum()
    excess = float(weight @ (size - share @ size) ** 2) - (len(size) - 1)
    return float(np.sqrt(max(0.0, excess / (weight.sum() * (1 - float(share @ share))))))
