"""How far a sample lies from what a model was trained on, and how much larger the residual may be there.

In:  model inputs of the training rows and of the samples; then held-out residuals with the distance of each.
Out: `Support`, which measures distances; `Growth`, a factor that never falls with distance.

A model is worse where it has to extrapolate, and a band that does not know this is too wide where the model is sure and
too narrow where it is not: false alarms on every part that differs from the ones before. Scaling the score by what is
known about its difficulty is normalised conformal prediction (Papadopoulos & Haralambous, 2011; Lei et al., 2018).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import isotonic_regression
from scipy.spatial import KDTree

from pido.core.arrays import Float1D, Float2D

MOST_ROWS = 6000
"""Training rows kept for distances: an even pick of all of them."""
NEIGHBOURS = 3
CLASSES = 10
PER_CLASS = 40
"""Windows needed for one step of the growth curve."""
FAR = 4.0
"""Beyond this many times the largest distance that held-out parts have shown, nothing is said about the residual."""


class Support:
    """Distances from training rows in units of their spread, column by column."""

    def __init__(self, rows: Float2D) -> None:
        """rows : (m, d), m >= 1 – model inputs of the training rows"""
        rows = np.asarray(rows, float)[:: max(1, len(rows) // MOST_ROWS)]
        spread = np.std(rows, axis=0)
        # A column that never varied says that a change in it is new ground, not that it is infinitely far away.
        self._unit = np.where(spread > 0, spread, np.maximum(0.1 * np.abs(rows).max(axis=0), 1e-6))
        self._count = min(NEIGHBOURS, len(rows))
        self._tree = KDTree(rows / self._unit)

    def distance(self, samples: Float2D) -> Float1D:
        """(n,), –: mean distance to the nearest training rows, per root of the number of columns.

        samples : (n, d), finite
        """
        if not len(samples):
            return np.zeros(0)
        found, _ = self._tree.query(np.asarray(samples, float) / self._unit, k=self._count)
        return np.mean(np.reshape(found, (len(samples), -1)), axis=1) / np.sqrt(len(self._unit))


@dataclass(frozen=True, eq=False)
class Growth:
    """Factor on the residual's spread by distance: 1 at the usual distance, proportional to it beyond the last knot."""

    knots: Float1D
    factors: Float1D

    def __call__(self, doubt: Float1D) -> Float1D:
        """(n,): the factor; NaN where the distance is so much larger than any seen that nothing is known."""
        if len(self.knots) == 0:
            return np.ones_like(doubt)
        last = self.knots[-1]
        beyond = np.maximum(doubt / max(last, 1e-9), 1.0)
        return np.where(beyond > FAR, np.nan, np.interp(doubt, self.knots, self.factors) * beyond)


FLAT = Growth(np.zeros(0), np.zeros(0))


def growth(doubt: Float1D, size: Float1D) -> Growth:
    """How the size of held-out residuals grows with distance: class means, made monotone.

    doubt, size : (n,), – and A – one per window; windows side by side, not overlapping
    """
    known = np.isfinite(doubt) & np.isfinite(size)
    doubt, size = doubt[known], size[known]
    classes = min(CLASSES, len(doubt) // PER_CLASS)
    if classes < 2 or np.ptp(doubt) <= 1e-9:
        return FLAT
    pieces = np.array_split(np.argsort(doubt, kind="stable"), classes)
    knots = np.array([float(np.mean(doubt[p])) for p in pieces])
    means = np.array([float(np.mean(size[p])) for p in pieces])
    factors = isotonic_regression(means, weights=np.array([len(p) for p in pieces], float)).x
    usual = float(np.interp(np.median(doubt), knots, factors))
    knots, first = np.unique(knots, return_index=True)
    return Growth(knots, np.maximum(factors[first] / max(usual, 1e-12), 1e-3))
