"""How common a current is among others, and what counts as one step in each input."""

from __future__ import annotations

import numpy as np
from scipy.stats import gaussian_kde

from pido.core.arrays import Float1D, Float2D

_ENOUGH = 5_000  # values that a density is estimated from, evenly among all by rank


def density(values: Float1D) -> Float1D:
    """(n,): how common each value is, 0 (rarest) to 1 (commonest): Gaussian kernel density, Silverman's width."""
    if not np.ptp(values) > 0:
        return np.ones(len(values))
    some = values
    if len(values) > _ENOUGH:
        some = np.sort(values)[np.linspace(0, len(values) - 1, _ENOUGH).astype(np.int64)]
    kernel = gaussian_kde(some, bw_method="silverman")
    points = np.linspace(values.min(), values.max(), 512)
    found = np.interp(values, points, kernel(points))
    return (found - found.min()) / max(float(np.ptp(found)), 1e-300)


def scale_of(inputs: Float2D) -> Float1D:
    """(k,): spread of each column; infinite where it has none, so that it counts for nothing in a distance."""
    spread = np.std(inputs, axis=0)
    return np.where(spread > 1e-12 * np.maximum(np.abs(inputs).max(axis=0, initial=0.0), 1e-300), spread, np.inf)
