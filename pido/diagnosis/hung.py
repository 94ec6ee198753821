"""An encoder that hangs: position, speed and acceleration of an axis stand still together while the axis goes on.

In:  time, position, speed and acceleration of one axis.
Out: the rows in which it hangs.
The three do not contradict one another there. That an axis which stands does not look so is known where an encoder is
noisy at every standstill; that it did not stand, where the position is another when the encoder comes back.
"""

from __future__ import annotations

import numpy as np

from pido.core.arrays import Bool1D, Float1D
from pido.diagnosis.consistency import COARSE_S, long_runs, rounded_to, runs

_STANDS_S = 1.0  # of standstill with noise, that say how an axis that stands looks
_TURNS = 0.2  # of the steps in which noise changes its sign, at least; a slow motion hardly ever does
_REPEATS = 0.1  # of the steps at rest, in which noise may repeat itself: eight in a row never do
_AT_REST = 0.01  # of the largest speeds, below which an axis may be at rest
_JUMP = 10.0  # times the way of a step, and steps of rounding, by which the position is another


def hung(time: Float1D, pos: Float1D, v: Float1D, a: Float1D | None) -> Bool1D:
    """(n,) – rows in which the encoder hangs; time, pos, v, a : (n,), s, mm, mm/s, mm/s²."""
    out = np.zeros(len(time), bool)
    if len(time) < 2:
        return out
    signals = [pos, v] if a is None else [pos, v, a]
    still = np.logical_and.reduce([np.diff(s) == 0 for s in signals])
    step = float(np.median(np.diff(time)))
    found = long_runs(time, still) if step <= COARSE_S else []
    if not found:
        return out
    for i, j in found:
        out[i : j + 1] = True
    if _seconds_of_noise(time, v, np.r_[False, still], ~out) < _STANDS_S:
        return np.zeros(len(time), bool)
    usual = max(step * float(np.nanmedian(np.abs(v[~out]))), rounded_to(pos))
    for i, j in found:
        before, behind = (max(i - 1, 0), i), (j, min(j + 1, len(time) - 1))
        jumps = [abs(pos[k] - pos[m]) - step * max(abs(v[m]), abs(v[k])) for m, k in (before, behind)]
        if not max(jumps) > _JUMP * usual:
            out[i : j + 1] = False
    return out


def _seconds_of_noise(time: Float1D, v: Float1D, repeats: Bool1D, rows: Bool1D) -> float:
    """s – for which an axis stands in these rows, and its speed says noise that hardly ever repeats itself."""
    slow = rows & (np.abs(v) < _AT_REST * float(np.nanquantile(np.abs(v), 0.999)))
    seconds = 0.0
    for i, j in runs(slow):
        some = v[i : j + 1]
        if j > i and np.mean(some[1:] * some[:-1] < 0) > _TURNS and np.mean(repeats[i + 1 : j + 1]) < _REPEATS:
            seconds += float(time[j] - time[i])
    return seconds
