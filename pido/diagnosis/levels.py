"""Levels of a quantity, at which something may begin: which are compared, and what lies between two of them."""

from __future__ import annotations

import numpy as np

from pido.core.arrays import Float1D

_LEVELS = 60  # evenly over a quantity, and as many by how often it is there


def levels_of(u: Float1D) -> Float1D:
    """Levels of a quantity, evenly between its ends and by how often it is there."""
    low, high = np.quantile(u, [0.005, 0.995])
    return np.unique(np.r_[np.linspace(low, high, _LEVELS), np.quantile(u, np.linspace(0.02, 0.98, _LEVELS))])


def neighbours(levels: Float1D, level: float) -> tuple[float, float]:
    """The levels before and after one of them."""
    at = int(np.searchsorted(levels, level))
    return float(levels[max(at - 1, 0)]), float(levels[min(at + 1, len(levels) - 1)])
