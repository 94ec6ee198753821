"""Drive train of an axis: lost motion, ripple, saturation.

In:  ways, positions, currents. Out: the laws, as pure functions.
"""

from __future__ import annotations

import numpy as np

from pido.core.arrays import Float1D, Float2D


def lost_motion(since_reversal: Float1D, gap: float, edge: float = 1.0) -> Float1D:
    """Share of a reversal's transient that is left after some way (or time).

        u = exp(-(s / gap)^edge)

    since_reversal : (n,), mm or s, inf before the first reversal; gap : scalar > 0, same unit; edge : – (1 exponential,
    8 nearly a rectangle as long as the gap). Returns (n,), –, in 0..1.

    >>> lost_motion(np.array([0.0, 0.5, 2.0, np.inf]), gap=1.0, edge=8.0).round(2).tolist()
    [1.0, 1.0, 0.0, 0.0]
    """
    return np.exp(-((np.maximum(since_reversal, 0.0) / gap) ** edge))


def wave(pos: Float1D, period: float) -> Float2D:
    """(n, 2) – sine and cosine of a position: together, a wave of any phase.

    pos : (n,), mm; period : scalar > 0, mm.

    >>> wave(np.array([2.5]), period=10.0).round(6).tolist()
    [[1.0, 0.0]]
    """
    angle = 2 * np.pi * pos / period
    return np.column_stack([np.sin(angle), np.cos(angle)])


def beyond(current: Float1D, limit: float) -> Float1D:
    """What of a current lies beyond +-limit, with its sign.

    current : (n,), A; limit : scalar >= 0, A. Returns (n,), A.

    >>> beyond(np.array([-5.0, 1.0, 4.0]), 3.0).tolist()
    [-2.0, 0.0, 1.0]
    """
    return np.sign(current) * np.maximum(np.abs(current) - limit, 0.0)
