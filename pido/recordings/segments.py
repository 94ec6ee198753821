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


def unwrap_deg(angle: Float1D) -> Float1D:
    """A spindle angle that restarts at a full turn, made continuous; any other is returned as it is.

    Only where the values stay within one turn and the jumps are larger than half of one: a spindle that turns more
    than half a turn per sample cannot be unwrapped, and its speed has to be recorded.
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
