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
