"""From a toolpath to motion over time, as a control does it: look-ahead, then a filter that limits the jerk.

In:  corners, feeds, rests, the machine's limits. Out: position, velocity, acceleration at equal steps, and for every
step the path step it belongs to. Speeds at corners are chosen so that the filter's change of velocity stays within
the acceleration (Biagiotti and Melchiorri, Trajectory Planning, chapter 4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from benchmarks.newcomer.machines import Machine
from pido.core.arrays import Float1D, Float2D, Int1D


@dataclass(frozen=True, eq=False)
class Motion:
    """pos, v, a : (n, 3), mm, mm/s, mm/s²; step : (n,), which step of the path"""

    pos: Float2D
    v: Float2D
    a: Float2D
    step: Int1D


def interpolate(points: Float2D, feeds: Float1D, rests: Float1D, machine: Machine, n: int) -> Motion:
    """n equal steps of the machine's; the path's end is held. points : (m + 1, 3), mm; feeds, rests : (m,), mm/s, s"""
    delta = np.diff(points, axis=0)
    length = np.linalg.norm(delta, axis=1)
    heading = delta / length[:, None]
    share = np.maximum(np.abs(heading), 1e-9)
    most = np.minimum(feeds, (machine.v_max / share).min(axis=1))
    rate = 0.8 * (machine.a_max / share).min(axis=1)
    corner = _corner_speeds(heading, length, most, rate, rests, machine.jerk_s)
    enter, leave = _look_ahead(corner, length, rate)
    t = machine.dt * (np.arange(n, dtype=float) - 1)
    along, step = _on_the_clock(t, enter, leave, most, rate, length, rests)
    at = np.r_[0.0, np.cumsum(length)]
    raw = np.column_stack([np.interp(along, at, points[:, k]) for k in range(3)])
    v = np.diff(raw, axis=0, prepend=raw[:1]) / machine.dt
    for window in (machine.jerk_s, machine.jerk_s / 3):
        v = uniform_filter1d(v, 2 * max(1, round(window / machine.dt / 2)) + 1, axis=0, mode="nearest")
    v[np.abs(v) < 1e-6] = 0.0
    a = np.gradient(v, machine.dt, axis=0)
    a[np.abs(a) < 1e-4] = 0.0
    return Motion(points[0] + np.cumsum(v, axis=0) * machine.dt, v, a, step)


def _corner_speeds(
    heading: Float2D, length: Float1D, most: Float1D, rate: Float1D, rests: Float1D, jerk_s: float
) -> Float1D:
    """(m + 1,), mm/s: what is allowed at each corner; none at both ends and before a rest."""
    turn = np.maximum(np.linalg.norm(np.diff(heading, axis=0), axis=1), 1e-9)
    a = np.minimum(rate[1:], rate[:-1])
    short = np.minimum(length[1:], length[:-1])
    allowed = np.minimum(0.5 * a * jerk_s / turn, np.sqrt(0.5 * a * short / turn))
    allowed = np.minimum(allowed, np.minimum(most[1:], most[:-1]))
    return np.r_[0.0, np.where(rests[1:] > 0, 0.0, allowed), 0.0]


def _look_ahead(corner: Float1D, length: Float1D, rate: Float1D) -> tuple[Float1D, Float1D]:
    """(m,), mm/s: speeds at which each step is entered and left."""
    v = corner.tolist()
    gain = (2 * rate * length).tolist()
    for k in range(len(gain) - 1, -1, -1):
        v[k] = min(v[k], (v[k + 1] ** 2 + gain[k]) ** 0.5)
    for k in range(len(gain)):
        v[k + 1] = min(v[k + 1], (v[k] ** 2 + gain[k]) ** 0.5)
    return np.array(v[:-1]), np.array(v[1:])


def _on_the_clock(
    t: Float1D, enter: Float1D, leave: Float1D, most: Float1D, rate: Float1D, length: Float1D, rests: Float1D
) -> tuple[Float1D, Int1D]:
    """(way along the path, mm; step), (n,): rest, speed up, hold, slow down, step after step."""
    top = np.minimum(most, np.sqrt((2 * rate * length + enter**2 + leave**2) / 2))
    top = np.maximum(top, np.maximum(enter, leave))
    up, down = (top - enter) / rate, (top - leave) / rate
    hold = np.maximum(length - (top**2 - enter**2) / (2 * rate) - (top**2 - leave**2) / (2 * rate), 0) / top
    spans = np.column_stack([rests, up, hold, down]).ravel()
    speed = np.column_stack([np.zeros_like(top), enter, top, top]).ravel()
    gain = np.column_stack([np.zeros_like(top), rate, np.zeros_like(top), -rate]).ravel()
    begin = np.r_[0.0, np.cumsum(spans)]
    way = np.r_[0.0, np.cumsum(speed * spans + gain * spans**2 / 2)]
    phase = np.clip(np.searchsorted(begin, t, side="right") - 1, 0, len(spans) - 1)
    into = np.clip(t - begin[phase], 0, spans[phase])
    along = way[phase] + speed[phase] * into + gain[phase] * into**2 / 2
    return along, phase // 4
