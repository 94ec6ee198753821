"""How far a sample lies from what a model was trained on.

In:  model inputs of the training rows and of samples. Out: distances, 0 where a sample is a training row.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from pido.core.arrays import Float1D, Float2D

MOST_ROWS = 6000
"""Training rows kept for distances: an even pick of all of them."""
NEIGHBOURS = 3


class Support:
    """Distances from training rows in units of their spread, column by column."""

    def __init__(self, rows: Float2D) -> None:
        """rows : (m, d), m >= 1 – model inputs of the training rows"""
        rows = np.asarray(rows, float)[:: max(1, len(rows) // MOST_ROWS)]
        # A column that hardly varied says that a change in it is new ground, not that it is infinitely far away.
        least = np.maximum(0.05 * np.abs(rows).max(axis=0), 1e-6)
        self._unit = np.maximum(np.std(rows, axis=0), least)
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
