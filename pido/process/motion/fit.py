"""A recorded run of a known program -> its distance from the path, its block times, and the machine's dynamics.

In:  `Toolpath`; recorded time and positions of one run of it.
Out: `FollowedPath` (way along the path per sample, distance from it), block times, fitted `Dynamics`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from scipy.optimize import least_squares

from pido.core.arrays import Float1D, Float2D, Int1D
from pido.core.errors import RecordingError
from pido.core.machining import Machine
from pido.nc.toolpath import ARC, FEED, Toolpath
from pido.process.motion.dynamics import Dynamics
from pido.process.motion.plan import plan_motion

MARGIN_MM = 0.3
"""Block borders are timed this far before and after them, where the axes move at a steady speed."""


@dataclass(frozen=True, eq=False)
class FollowedPath:
    """A run laid along its path.

    shift_mm (3,): programmed = recorded + shift; samples (n,): rows of the recording that lie on the path
    way (n,), mm – along the path; distance (n,), mm – from it; segment (n,) – index into the toolpath
    """

    shift_mm: Float1D
    samples: Int1D
    way: Float1D
    distance: Float1D
    segment: Int1D


def follow(toolpath: Toolpath, positions: Float2D, shift_mm: Float1D | None = None, rounds: int = 5) -> FollowedPath:
    """Lay recorded positions (n, 3) mm along the feed moves of a program.

    `shift_mm`: programmed minus recorded, where it is known; else the middle of the feed path's box is laid on that of
    the recording's slow part and refined by least squares. Samples off the path (approach, retract) are left out.

    Raises RecordingError where fewer than half of the feed path is found.
    """
    cutting = np.isin(toolpath.kind, (FEED, ARC))
    rows = np.flatnonzero(cutting)
    if not len(rows):
        raise RecordingError("the program has no feed moves to compare a recording with.")
    path = toolpath.take(rows)
    shift = _first_shift(path, positions) if shift_mm is None else np.asarray(shift_mm, float)
    ways = np.concatenate([[0.0], np.cumsum(path.length)])
    found = None
    for near in (2.0, *[0.5] * (rounds - 1)):
        place = positions + shift
        inside = _first_touch(path, place, near)
        segment, u, distance = _project(path.start, path.end, path.sag, path.length, place[inside:], near)
        first, last = (segment == 0) & (u <= 0), (segment == len(ways) - 2) & (u >= 1)
        ok = (segment >= 0) & ~first & ~last  # waiting at an end, or already leaving it
        if not ok.any():
            break
        samples = inside + np.flatnonzero(ok)
        segment, u, distance = segment[ok], u[ok], distance[ok]
        found = FollowedPath(shift, samples, ways[segment] + u * path.length[segment], distance, rows[segment])
        if shift_mm is not None:
            break
        on = _point(path, segment, u)
        step = np.mean(on - place[samples], axis=0)
        shift = shift + _solve_shift(path, segment, u, place[samples], step)
    covered = 0.0 if found is None else float(np.ptp(found.way)) / ways[-1]
    if found is None or covered < 0.5:
        raise RecordingError(
            f"only {covered:.0%} of the program's feed path was found in the recording: "
            "another program, or another scale?"
        )
    return found


def block_times(
    toolpath: Toolpath, time: Float1D, positions: Float2D, shift_mm: Float1D | None = None
) -> tuple[Int1D, Float1D]:
    """Executed feed blocks that follow each other, and when each border between them was passed.

    Returns block numbers (b,) and times (b + 1,) s; a border that was not passed is NaN. A border's time is the mean
    of the times 0.3 mm before and behind it, so that a slow creep through a stop counts half to each side; the first
    block counts from 0.3 mm behind its start and the last to 0.3 mm before its end.
    """
    run = follow(toolpath, positions, shift_mm)
    cutting = np.isin(toolpath.kind, (FEED, ARC))
    path = toolpath.take(np.flatnonzero(cutting))
    ways = np.cumsum(path.length)
    last = np.flatnonzero(np.r_[path.block[1:] != path.block[:-1], True])
    borders = np.concatenate([[0.0], ways[last]])
    t = time[run.samples]
    way, index = np.unique(np.maximum.accumulate(run.way), return_index=True)
    t = t[index]

    def passed(at: Float1D) -> Float1D:
        return np.interp(at, way, t, left=np.nan, right=np.nan)

    margin = np.minimum(MARGIN_MM, 0.25 * np.min(np.diff(borders)))
    before, behind = passed(borders - margin), passed(borders + margin)
    times = (before + behind) / 2
    times[0], times[-1] = behind[0], before[-1]
    return path.block[last], times


def fit_dynamics(
    toolpath: Toolpath,
    machine: Machine,
    time: Float1D,
    positions: Float2D,
    *,
    start: Dynamics | None = None,
    box_s: float = 0.0,
    blocks: slice = slice(None),
    on_progress: Callable[[str], None] = lambda message: None,
) -> Dynamics:
    """Servo gain, exact-stop window and spindle acceleration that make the planned run take the recorded time.

    The overhead per stop stays that of `start`: block times alone cannot tell it from the window.

    time (n,) s, positions (n, 3) mm of one run; `box_s`: the recording is a moving mean over this time (s);
    `blocks`: which borders between feed blocks are used. Fitted are the block times and the speed along the path
    around each border, both to their scatter (10 ms and 3 % of the feed).
    """
    start = start or Dynamics(kv_per_s=30.0, stop_window_mm=0.02)
    rate = 1.0 / float(np.median(np.diff(time)))
    run = follow(toolpath, positions)
    recorded = _borders(toolpath, time, positions + run.shift_mm, blocks)
    keep = np.isfinite(recorded.times)

    def residual(x: Float1D) -> Float1D:
        model = _planned(toolpath, machine, _with(start, x), rate, box_s, blocks)
        both = keep & np.isfinite(model.times)
        duration = np.diff(model.times[both]) - np.diff(recorded.times[both])
        dips = (model.speed - recorded.speed)[both[1:-1]] if len(both) > 2 else model.speed[:0]
        return np.concatenate([duration / 0.01, np.nan_to_num(dips.ravel()) / 0.03 / 5.0])

    x0 = np.log([start.kv_per_s or 30.0, start.stop_window_mm, start.spindle_acc_deg_s2 or machine.spindle_acc_deg_s2])
    bounds = (np.log([3.0, 1e-4, 1e3]), np.log([300.0, 1.0, 1e6]))
    result = least_squares(residual, np.clip(x0, *bounds), bounds=bounds, diff_step=0.02, max_nfev=25)
    on_progress(f"{result.nfev} plans, cost {result.cost:.1f}")
    return _with(start, result.x)


def _with(dynamics: Dynamics, x: Float1D) -> Dynamics:
    kv, window, spindle = (float(v) for v in np.exp(x))
    return replace(dynamics, kv_per_s=kv, stop_window_mm=window, spindle_acc_deg_s2=spindle)


@dataclass(frozen=True, eq=False)
class _Borders:
    """Times of block borders (b + 1,), and speed over feed around each inner one (b - 1, 31) from -0.3 to 0.3 s."""

    times: Float1D
    speed: Float2D


def _borders(toolpath: Toolpath, time: Float1D, place: Float2D, blocks: slice) -> _Borders:
    _, times = block_times(toolpath, time, place, np.zeros(3))
    times = times[blocks]
    speed = np.linalg.norm(np.gradient(place, time, axis=0), axis=1)
    around = times[1:-1, None] + np.linspace(-0.3, 0.3, 31)
    near = np.interp(around, time, speed)
    return _Borders(times, near / np.maximum(np.median(near, axis=1, keepdims=True), 1e-9))


def _planned(
    toolpath: Toolpath, machine: Machine, dynamics: Dynamics, rate: float, box_s: float, blocks: slice
) -> _Borders:
    motion = plan_motion(toolpath, machine, rate_hz=500.0 if box_s else rate, dynamics=dynamics)
    place = box_mean(motion.pos[:, :3], box_s * 500.0) if box_s else motion.pos[:, :3]
    return _borders(toolpath, motion.time, place, blocks)


def box_mean(values: Float2D, width: float) -> Float2D:
    """Centred moving mean over `width` samples (rounded to an odd number), the ends held."""
    half = int(width) // 2
    if half == 0:
        return values
    padded = np.concatenate([np.repeat(values[:1], half + 1, axis=0), values, np.repeat(values[-1:], half, axis=0)])
    total = np.cumsum(padded - values[0], axis=0)
    return (total[2 * half + 1 :] - total[: -2 * half - 1]) / (2 * half + 1) + values[0]


def _first_shift(path: Toolpath, positions: Float2D) -> Float1D:
    """Programmed minus recorded from the boxes of the feed path and of the recording's long stretches at feed speed."""
    step = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    moving = step > 1e-3 * step.max(initial=0.0)
    if not moving.any():
        raise RecordingError("the recording does not move: it cannot be laid along a program.")
    typical = np.median(step[moving])
    order = np.argsort(path.feed)
    middle = order[np.searchsorted(np.cumsum((path.length / path.feed)[order]), 0.5 * np.sum(path.length / path.feed))]
    fastest = 1.3 * typical * float(np.max(path.feed) / path.feed[middle])
    feeding = np.concatenate([[False], (step > 0.01 * typical) & (step < fastest), [False]])
    edges = np.flatnonzero(np.diff(feeding.astype(np.int8)))
    first, last = edges[::2], edges[1::2]
    long = last - first >= 0.1 * np.max(last - first, initial=1)
    rows = np.concatenate([np.arange(a, b + 1) for a, b in zip(first[long], last[long], strict=True)])
    low, high = positions[rows].min(axis=0), positions[rows].max(axis=0)
    points = np.vstack([path.start, path.end])
    return (points.min(axis=0) + points.max(axis=0)) / 2 - (low + high) / 2


def _first_touch(path: Toolpath, place: Float2D, near: float) -> int:
    """First sample at the beginning of the path."""
    close = np.flatnonzero(np.linalg.norm(place - path.start[0], axis=1) < near)
    return int(close[0]) if len(close) else 0


def _point(path: Toolpath, segment: Int1D, u: Float1D) -> Float2D:
    u = u[:, None]
    return path.start[segment] + u * (path.end - path.start)[segment] + 4 * u * (1 - u) * path.sag[segment]


def _solve_shift(path: Toolpath, segment: Int1D, u: Float1D, place: Float2D, mean: Float1D) -> Float1D:
    """Translation that brings the samples onto the path: least squares of the distances across the path only."""
    chord = (path.end - path.start)[segment] + 4 * (1 - 2 * u)[:, None] * path.sag[segment]
    t = chord / np.linalg.norm(chord, axis=1, keepdims=True)
    gap = _point(path, segment, u) - place
    across = gap - np.sum(gap * t, axis=1, keepdims=True) * t
    normal = len(t) * np.eye(3) - t.T @ t
    return np.linalg.lstsq(normal, across.sum(axis=0), rcond=1e-6)[0]


@njit(cache=True)
def _project(start, end, sag, length, points, near):
    """For each point the nearest place on the path, never going back: segment (-1: none), u, distance."""
    n = len(points)
    m = len(length)
    segment, place, distance = np.full(n, -1, np.int64), np.zeros(n), np.zeros(n)
    at, u_at = 0, 0.0
    for k in range(n):
        step = 0.0
        if k > 0:
            step = np.sqrt(np.sum((points[k] - points[k - 1]) ** 2))
        reach = 1.0 + 3.0 * step
        best, best_q, best_u, gone = 1e300, -1, 0.0, -u_at * length[at]
        q = at
        while q < m and gone < reach:
            low = u_at if q == at else 0.0
            c = end[q] - start[q]
            cc = np.sum(c * c)
            u = 0.0
            if cc > 0:
                u = np.sum((points[k] - start[q]) * c) / cc
            u = min(max(u, low), 1.0)
            p = start[q] + u * c + 4 * u * (1 - u) * sag[q]
            d = np.sqrt(np.sum((points[k] - p) ** 2))
            if d < best - 1e-12:
                best, best_q, best_u = d, q, u
            gone += length[q]
            q += 1
        if best < near:
            segment[k], place[k], distance[k] = best_q, best_u, best
            at, u_at = best_q, best_u
    return segment, place, distance
