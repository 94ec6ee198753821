"""Stretches of a recording across which nothing may be differentiated or filtered.

In:  time and, for the spindle, its position. Out: where a new stretch begins.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from pido.core.arrays import Bool1D, Float1D
from pido.core.recording import usual_step

GAP = 2.5
"""A step of more than this many median steps is a gap: one lost sample may be interpolated over, two may not."""


def starts(time: Float1D, *more: Bool1D) -> Bool1D:
    """(n,) – whether a stretch begins at this sample: the first one, after a gap, after time that does not advance,
    and where any of `more` says so."""
    begin = np.zeros(len(time), bool)
    if len(time) == 0:
        return begin
    begin[0] = True
    if len(time) > 1:
        step = np.diff(time)
        begin[1:] = ~((step > 0) & (step <= GAP * usual_step(time)))
    for other in more:
        begin |= other
    return begin


def stretches(begin: Bool1D, valid: Bool1D | None = None) -> Iterator[slice]:
    """Slices of consecutive samples without a beginning inside, of valid samples only."""
    if valid is None:
        edges = np.r_[np.flatnonzero(begin), len(begin)]
        yield from (slice(int(a), int(b)) for a, b in pairwise(edges))
        return
    first = valid & (begin | ~np.r_[False, valid[:-1]])
    last = valid & (np.r_[begin[1:], True] | ~np.r_[valid[1:], False])
    for a, b in zip(np.flatnonzero(first), np.flatnonzero(last), strict=True):
        yield slice(int(a), int(b) + 1)


SPINDLE_USUAL = 72_000.0
"""deg/s (12 000 1/min) – the highest speed that a spindle is taken to have where its machine is not known."""


def is_angle(position: Float1D) -> bool:
    """Whether a spindle's position stays within one turn, as an angle that restarts does: the turns are not in it."""
    known = position[np.isfinite(position)]
    if not len(known):
        return False
    low, high = float(known.min()), float(known.max())
    return high - low <= 360.0 + 1e-6 and low >= -180.0 - 1e-6 and high <= 360.0 + 1e-6


def turns_known(position: Float1D, time: Float1D, v_max: float | None = None) -> bool:
    """Whether the spindle's turns between samples follow from its position.

    Those of a counter do. Those of an angle do where no speed up to v_max (deg/s; None: `SPINDLE_USUAL`) makes half a
    turn from sample to sample, and the angle itself never goes faster: one that does has been through the half turn, as
    a spindle that runs up has, and above it a fast turn looks like a slow one.

    >>> time = np.arange(500) / 50.0  # 3000 1/min are one turn per sample at 50 Hz: the angle stands still
    >>> turns_known(18_000.0 * time % 360.0, time), turns_known(18_000.0 * time, time)
    (False, True)
    >>> turns_known(18_000.0 * time % 360.0, time / 10), turns_known(600.0 * time % 360.0, time, v_max=6000.0)
    (True, True)
    """
    if not is_angle(position):
        return True
    v_max = SPINDLE_USUAL if v_max is None else v_max
    step = usual_step(time)
    if v_max * step >= 180.0:
        return False
    turn = np.abs((np.diff(position) + 180.0) % 360.0 - 180.0)
    beyond = (turn > 1.05 * v_max * step) & ~starts(time)[1:]
    return int(beyond.sum()) < 5


def unwrap_deg(angle: Float1D) -> Float1D:
    """A spindle angle that restarts at a full turn, made continuous; any other is returned as it is.

    Only where the values stay within one turn and the jumps are larger than half of one. What turned more than half a
    turn per sample comes out wrong: `turns_known` says whether it may have.
    """
    known = angle[np.isfinite(angle)]
    if len(known) < 2 or np.ptp(known) > 360.0 + 1e-6 or not (np.abs(np.diff(known)) > 180.0).any():
        return angle
    turned = angle.copy()
    turned[np.isfinite(angle)] = np.unwrap(known, period=360.0)
    return turned


def counter_resets(position: Float1D, time: Float1D) -> Bool1D:
    """(n,) – samples at which a turning counter was set to another value: the step to them is more than 50 times the
    usual largest step, which no spindle does in one sample."""
    step = np.abs(np.diff(position))
    usual = np.quantile(step[np.isfinite(step)], 0.99) if np.isfinite(step).any() else 0.0
    reset = np.zeros(len(position), bool)
    reset[1:] = step > np.maximum(50.0 * usual, 720.0)
    return reset
