"""Friction of a moving axis.

In:  speeds of one axis, in time order.
Out: what friction depends on, and the laws.
"""

from __future__ import annotations

import numpy as np

from pido.core.arrays import Float1D


def held_direction(v: Float1D, dead_band: float, start: float = 0.0) -> Float1D:
    """Sign of the last real motion: -1, +1, or 0 while it is not known yet.

    A measured speed is never exactly zero at standstill, so its sign is noise there; friction keeps the sign that it
    had when the axis stopped. A sample moves the state when |v| > dead_band. A missing speed (NaN) makes the state
    unknown until the next real motion, because nobody saw what the axis did.

    Parameters
    ----------
    v : (n,), mm/s or deg/s – speed of one axis in time order
    dead_band : scalar >= 0, unit of v – at or below it the axis stands still
    start : -1, 0 or +1 – state before the first sample

    Returns
    -------
    (n,), –

    Raises ValueError for a negative dead band or another `start`.
    Source: reference sign convention of static friction (Armstrong-Hélouvry et al., Automatica 30, 1994).

    >>> held_direction(np.array([0.0, 2.0, 0.01, -0.01, -3.0, 0.0]), dead_band=0.02).tolist()
    [0.0, 1.0, 1.0, 1.0, -1.0, -1.0]
    """
    if not dead_band >= 0:
        raise ValueError(f"dead_band is {dead_band}, and it must be >= 0")
    if start not in (-1, 0, 1):
        raise ValueError(f"start is {start}, and a direction is -1, 0 or +1")
    v = np.asarray(v, float)
    state = np.concatenate([[float(start)], np.where(np.abs(v) > dead_band, np.sign(v), 0.0)])
    decided = np.concatenate([[True], (np.abs(v) > dead_band) | np.isnan(v)])
    last = np.maximum.accumulate(np.where(decided, np.arange(len(state)), 0))
    return state[last][1:]


def stribeck_curve(v: Float1D, v_s: float, delta: float = 2.0) -> Float1D:
    """Share of the extra friction at low speed that is left at speed v.

        s = exp(-(|v| / v_s)^delta)

    v : (n,), v_s : scalar > 0, same unit; delta : scalar > 0, – (1 Tustin, 2 Gauss). Returns (n,), –, in 0..1.
    Source: Armstrong-Hélouvry et al., Automatica 30 (1994).

    >>> round(float(stribeck_curve(np.array([2.0]), v_s=2.0)[0]), 6)
    0.367879
    """
    return np.exp(-((np.abs(v) / v_s) ** delta))


def dahl_state(held: Float1D, since_reversal: Float1D, segment: Float1D, x_0: float) -> Float1D:
    """Share of the friction that has built up, -1..1, over the way travelled since each reversal (Dahl, exponent 1).

        dz/ds = (h - z) / x_0   =>   z(s) = h + (z_r - h) * exp(-s / x_0)

    z_r is what was built up when the axis turned, so a move shorter than x_0 turns it only in part. Before the first
    reversal the friction is taken as fully built up.

    Parameters
    ----------
    held : (n,), – direction of the last real motion, -1, 0 or +1
    since_reversal : (n,), mm – way since the last reversal, inf before the first
    segment : (n,), – number of reversals so far, not decreasing
    x_0 : scalar > 0, mm – way over which 63 % turns

    Returns (n,), –. Source: Dahl, A solid friction model (1968).

    >>> dahl_state(np.ones(2), np.array([np.inf, 0.0]), np.zeros(2), 0.1).tolist()
    [1.0, -1.0]
    """
    decay = np.exp(-np.maximum(since_reversal, 0.0) / x_0)
    new = np.r_[True, segment[1:] != segment[:-1]]
    first = np.flatnonzero(new)
    last = np.r_[first[1:], len(held)] - 1
    begin = np.empty(len(first))
    z = -held[0]
    for k, (i, j) in enumerate(zip(first, last, strict=True)):
        begin[k] = z
        z = held[j] + (z - held[j]) * decay[j] if held[i] * held[j] >= 0 else held[j]
    return held + (begin[np.cumsum(new) - 1] - held) * decay
