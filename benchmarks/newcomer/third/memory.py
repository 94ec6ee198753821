"""What the laws of this edition remember by: relays, leaks, oscillators, counters since an event.

In:  arrays of one part, in time. Out: an array of the same length. Nothing is remembered from one part to the next.
"""

from __future__ import annotations

import numpy as np

from benchmarks.newcomer.world import Columns
from pido.core.arrays import Bool1D, Float1D


def less(columns: Columns, by: Columns) -> list[Float1D]:
    """Without what is in proportion to something that a simulation has: that would have been fitted.

    >>> less([np.array([1.0, 3.0])], [np.array([1.0, 1.0])])[0].tolist()
    [-1.0, 1.0]
    """
    x, y = np.concatenate(list(by)), np.concatenate(list(columns))
    share = float(x @ y) / max(float(x @ x), 1e-300)
    return [c - share * b for c, b in zip(columns, by, strict=True)]


def relay(x: Float1D, low: float, high: float) -> Float1D:
    """(n,), 0 or 1: on from above high until below low, off at first.

    >>> relay(np.array([0.0, 2.0, 1.0, -1.0, 1.0]), 0.0, 1.5).tolist()
    [0.0, 1.0, 1.0, 0.0, 0.0]
    """
    event = np.where(x > high, 1, np.where(x < low, -1, 0))
    last = np.maximum.accumulate(np.where(event != 0, np.arange(len(x)), -1))
    return np.where((last >= 0) & (event[np.maximum(last, 0)] > 0), 1.0, 0.0)


def since(event: Bool1D, gone: Float1D) -> Float1D:
    """(n,): how much of something that only grows has gone since the last event; infinite before the first.

    >>> since(np.array([False, True, False, False]), np.arange(4.0)).tolist()
    [inf, 0.0, 1.0, 2.0]
    """
    last = np.maximum.accumulate(np.where(event, np.arange(len(gone)), -1))
    return np.where(last >= 0, gone - gone[np.maximum(last, 0)], np.inf)


def begins(state: Bool1D) -> Bool1D:
    """(n,): where a state is entered."""
    return np.r_[False, state[1:] & ~state[:-1]]


def stood(v: Float1D, dt: float) -> Float1D:
    """(n,), s: how long an axis has been standing; 0 where it moves."""
    index = np.arange(len(v))
    return (index - np.maximum.accumulate(np.where(v != 0, index, 0))) * dt


def leaking(gain: Float1D, tau: float, dt: float, most: float = np.inf) -> Float1D:
    """(n,): ds/dt = gain − s / tau, kept between 0 and most. tau, dt : s"""
    now, out = 0.0, np.empty_like(gain)
    for n, rate in enumerate((gain * dt).tolist()):
        now = min(max(now * (1 - dt / tau) + rate, 0.0), most)
        out[n] = now
    return out


def swung(a: Float1D, w: Float1D, zeta: float, dt: float) -> Float1D:
    """(n,), mm/s²: what a mass on a spring feels beyond its ground, whose stiffness changes. w : (n,), rad/s"""
    x, u, out = 0.0, 0.0, np.empty_like(a)
    for n, (push, turn) in enumerate(zip(a.tolist(), w.tolist(), strict=True)):
        u += dt * (-push - 2 * zeta * turn * u - turn**2 * x)  # semi-implicit: neither gains nor loses energy
        x += dt * u
        out[n] = -(turn**2) * x - push
    return out
