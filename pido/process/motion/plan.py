"""Toolpath -> positions, speeds and accelerations over time, with look-ahead, stops, dwells, spindle and servo lag.

In:  `Toolpath`, `Machine`, `Dynamics`.
Out: `Motion` at a fixed rate. Commanded: the set points of the control, inside the limits of each axis.
     Actual: the same behind a first-order servo lag (`Dynamics.kv_per_s`), equal to the commanded where there is none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.signal import lfilter

from pido.core.arrays import Array1D, Bool1D, Float1D, Float2D, Int1D
from pido.core.axes import AXES
from pido.core.columns import ACCELERATION, POSITION, TIME, VELOCITY
from pido.core.errors import ProgramError
from pido.core.machining import Machine
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.nc.toolpath import ARC, DWELL, FEED, Toolpath
from pido.process.motion.dynamics import Dynamics, check_machine, limits
from pido.process.motion.profile import Profile, plan_profile

LAG_RATE_HZ = 500.0
"""The servo lag is integrated at least this often per second."""


@dataclass(frozen=True, eq=False)
class Motion:
    """n samples.

    time (n,), s
    pos, v, a : (n, 4) – actual x, y, z (mm, mm/s, mm/s²) and spindle (deg, deg/s, deg/s²)
    pos_sp, v_sp, a_sp : (n, 3) – set points of x, y, z
    nc_line, block : (n,) – source line and executed block; segment : (n,) – index into the toolpath
    tool_id : (n,) of str; coolant, is_rapid : (n,)
    block_end : (b,), s – when the set point reaches the end of each executed block, in the order of `block_number` (b,)
    """

    time: Float1D
    pos: Float2D
    v: Float2D
    a: Float2D
    pos_sp: Float2D
    v_sp: Float2D
    a_sp: Float2D
    nc_line: Int1D
    block: Int1D
    segment: Int1D
    tool_id: Array1D
    coolant: Bool1D
    is_rapid: Bool1D
    block_end: Float1D
    block_number: Int1D

    def __len__(self) -> int:
        return len(self.time)

    def recording(self, part: PartInfo) -> Recording:
        """The motion in the contract's columns, to which forces and currents can be added."""
        columns: dict[str, Array1D] = {TIME: self.time}
        for names, values in ((POSITION, self.pos), (VELOCITY, self.v), (ACCELERATION, self.a)):
            columns |= {names[axis]: np.ascontiguousarray(values[:, i]) for i, axis in enumerate(AXES)}
        columns |= {
            "nc_line": self.nc_line.astype(float),
            "coolant": self.coolant.astype(float),
            "tool_id": self.tool_id,
        }
        return Recording(part, columns, notes=("planned from the NC program",))


def plan_motion(
    toolpath: Toolpath, machine: Machine, rate_hz: float = 50.0, dynamics: Dynamics | None = None
) -> Motion:
    """The motion that `machine` makes of `toolpath`, sampled `rate_hz` times a second.

    `dynamics`: None takes the machine's own settings.

    Raises SettingsError for an impossible machine, ProgramError for a path without moves.
    """
    check_machine(machine)
    dynamics = dynamics or Dynamics.of(machine)
    if not (np.isfinite(rate_hz) and rate_hz > 0):
        raise ValueError(f"rate_hz = {rate_hz} must be positive")
    if len(toolpath) == 0:
        raise ProgramError("the program moves nothing: there is no motion to plan.")
    path = _Path.of(toolpath, machine, dynamics)
    profile = plan_profile(path.length, path.speed, path.a, path.jerk, path.stop)
    begin, spindle = _schedule(path, profile, machine, dynamics)
    end = begin[-1]
    every = max(1, int(np.ceil(LAG_RATE_HZ / rate_hz))) if dynamics.kv_per_s else 1
    n = int(np.floor(end * rate_hz + 1e-9)) + 1
    fine = np.arange((n - 1) * every + 1) / (rate_hz * every)
    stretch = np.clip(np.searchsorted(begin, fine, side="right") - 1, 0, len(begin) - 2)
    way, speed, a = profile.at(stretch, fine - begin[stretch])
    at_way = path.way_before[profile.first[stretch]] + way
    pos_sp, v_sp, a_sp, segment = path.at(at_way, speed, a, stretch, profile)
    pos, v, acc = _lag(pos_sp, v_sp, rate_hz * every, dynamics.kv_per_s) if dynamics.kv_per_s else (pos_sp, v_sp, a_sp)
    keep = slice(None, None, every)
    time = fine[keep]
    turning = spindle.at(time)
    original = path.original[segment[keep]]
    ends = np.flatnonzero(np.r_[toolpath.block[1:] != toolpath.block[:-1], True])
    return Motion(
        time=time,
        pos=np.column_stack([pos[keep], turning[0]]),
        v=np.column_stack([v[keep], turning[1]]),
        a=np.column_stack([acc[keep], turning[2]]),
        pos_sp=pos_sp[keep],
        v_sp=v_sp[keep],
        a_sp=a_sp[keep],
        nc_line=toolpath.nc_line[original],
        block=toolpath.block[original],
        segment=original,
        tool_id=toolpath.tool_id[original],
        coolant=toolpath.coolant[original],
        is_rapid=toolpath.is_rapid[original],
        block_end=path.time_of_end(ends, profile, begin),
        block_number=toolpath.block[ends],
    )


@dataclass(frozen=True, eq=False)
class _Path:
    """Segments with corners rounded, and what limits them; `original`: index into the toolpath."""

    start: Float2D
    end: Float2D
    sag: Float2D
    length: Float1D
    way_before: Float1D
    original: Int1D
    speed: Float1D
    a: Float1D
    jerk: Float1D
    stop: Bool1D
    wait: Float1D
    rpm: Float1D
    is_feed: Bool1D

    @classmethod
    def of(cls, toolpath: Toolpath, machine: Machine, dynamics: Dynamics) -> _Path:
        stop = _stops(toolpath, dynamics)
        start, end, sag, original, stop = _rounded(toolpath, stop, dynamics.smoothing_mm)
        chord = end - start
        chord_length = np.linalg.norm(chord, axis=1)
        length = parabola_length(chord_length, np.linalg.norm(sag, axis=1))
        # An axis' share of the path's speed is largest at one end of the segment.
        share = np.maximum(np.abs(chord + 4 * sag), np.abs(chord - 4 * sag)) / np.maximum(length, 1e-12)[:, None]
        share = np.minimum(share, 1.0)
        v_max, a_max, j_max = (limits(machine, name) for name in ("v_max", "a_max", "j_max"))
        kind = toolpath.kind[original]
        feed = np.isin(kind, (FEED, ARC))
        with np.errstate(divide="ignore"):
            speed = np.min(v_max / share, axis=1)
            a = np.min(a_max / share, axis=1)
            jerk = np.min(j_max / share, axis=1)
        speed = np.where(feed, np.fmin(speed, toolpath.feed[original]), speed)
        if dynamics.path_a_max is not None:
            a = np.where(feed, np.minimum(a, dynamics.path_a_max), a)
        if dynamics.path_j_max is not None:
            jerk = np.where(feed, np.minimum(jerk, dynamics.path_j_max), jerk)
        curvature = _over(8 * np.linalg.norm(sag, axis=1), chord_length**2)
        smallest = np.min(a_max)
        with np.errstate(divide="ignore"):
            speed = np.minimum(speed, np.sqrt(smallest / curvature))
        still = length <= 0
        speed, a, jerk = (np.where(still, 1.0, x) for x in (speed, a, jerk))
        wait = np.where(kind == DWELL, toolpath.dwell[original], 0.0)
        tool = toolpath.tool[original]
        changed = np.r_[False, tool[1:] != tool[:-1]]
        wait = wait + np.where(changed, dynamics.tool_change_s, 0.0)
        before = np.concatenate([[0.0], np.cumsum(length)])
        rpm = toolpath.spindle_rpm[original]
        return cls(start, end, sag, length, before, original, speed, a, jerk, stop, wait, rpm, feed)

    def at(
        self, way: Float1D, speed: Float1D, a: Float1D, stretch: Int1D, profile: Profile
    ) -> tuple[Float2D, Float2D, Float2D, Int1D]:
        """Position, velocity, acceleration (n, 3) and segment (n,) at a way along the path, mm."""
        return _on_path(
            way,
            speed,
            a,
            profile.first[stretch],
            profile.first[stretch + 1],
            self.way_before,
            self.start,
            self.end,
            self.sag,
        )

    def time_of_end(self, toolpath_index: Int1D, profile: Profile, begin: Float1D) -> Float1D:
        """When the set point passes the end of toolpath segments, s (to the sampling of a bisection, 1e-6 s)."""
        last = np.searchsorted(self.original, toolpath_index, side="right") - 1
        stretch = np.searchsorted(profile.first, last, side="right") - 1
        way = self.way_before[last + 1] - self.way_before[profile.first[stretch]]
        low, high = np.zeros(len(last)), profile.duration[stretch] + profile.average[stretch]
        for _ in range(40):
            middle = (low + high) / 2
            reached = profile.at(stretch, middle)[0] >= way - 1e-9
            low, high = np.where(reached, low, middle), np.where(reached, middle, high)
        return begin[stretch] + high


def _stops(toolpath: Toolpath, dynamics: Dynamics) -> Bool1D:
    """Where the axes come to rest: exact stops, dwells, changes of speed or tool, and turns that nothing can round."""
    stop = toolpath.exact_stop | (toolpath.kind == DWELL)
    following = slice(1, None)
    stop[:-1] |= toolpath.kind[following] == DWELL
    if dynamics.stop_at_speed_change:
        stop[:-1] |= toolpath.spindle_rpm[1:] != toolpath.spindle_rpm[:-1]
    stop[:-1] |= toolpath.tool[1:] != toolpath.tool[:-1]
    out, into = _tangents(toolpath.start, toolpath.end, toolpath.sag)
    cosine = np.sum(out[:-1] * into[1:], axis=1)
    stop[:-1] |= cosine < -0.996  # turns back by more than 175 degrees
    stop[-1] = True
    return stop


def _tangents(start: Float2D, end: Float2D, sag: Float2D) -> tuple[Float2D, Float2D]:
    """Unit directions at the end and at the start of each segment; zero where it has no length."""
    chord = end - start
    return _unit(chord - 4 * sag), _unit(chord + 4 * sag)


def _rounded(toolpath: Toolpath, stop: Bool1D, distance_mm: float) -> tuple[Float2D, Float2D, Float2D, Int1D, Bool1D]:
    """Corners that are passed without a stop become parabolas that begin `smoothing` before the corner."""
    n = len(toolpath)
    start, end, sag = toolpath.start.copy(), toolpath.end.copy(), toolpath.sag
    out, into = _tangents(start, end, sag)
    straight = ~np.any(sag != 0, axis=1)
    length = np.linalg.norm(end - start, axis=1)
    corner = np.zeros(n, bool)
    corner[:-1] = ~stop[:-1] & (np.sum(out[:-1] * into[1:], axis=1) < 1 - 1e-6)
    # Between a line and a circle, or two circles, nothing is cut: the corner is passed as slowly as a stop.
    simple = np.zeros(n, bool)
    simple[:-1] = straight[:-1] & straight[1:]
    stop = stop | (corner & ~simple)
    corner &= simple
    reach = np.where(np.isnan(toolpath.smoothing), distance_mm, toolpath.smoothing)
    following = np.r_[length[1:], 0.0]
    cut = np.where(corner, np.minimum(reach, 0.49 * np.minimum(length, following)), 0.0)
    stop = stop | (corner & (cut <= 0))
    corner &= cut > 0
    where = np.flatnonzero(corner)
    if not len(where):
        return start, end, sag, np.arange(n), stop
    point = end[where]
    first = point - cut[where, None] * out[where]
    last = point + cut[where, None] * into[where + 1]
    end[where], start[where + 1] = first, last
    order = np.argsort(np.concatenate([np.arange(n), where + 0.5]), kind="stable")
    original = np.concatenate([np.arange(n), where])[order]
    all_stop = np.concatenate([np.where(corner, False, stop), np.zeros(len(where), bool)])[order]
    arc_sag = point / 2 - (first + last) / 4
    return (
        np.vstack([start, first])[order],
        np.vstack([end, last])[order],
        np.vstack([sag, arc_sag])[order],
        original,
        all_stop,
    )


@dataclass(frozen=True, eq=False)
class _Spindle:
    """Speed ramps: from `time` on, `speed` deg/s changes by `a` deg/s² until the next entry; `angle` deg."""

    time: Float1D
    speed: Float1D
    a: Float1D
    angle: Float1D

    def at(self, time: Float1D) -> tuple[Float1D, Float1D, Float1D]:
        i = np.maximum(np.searchsorted(self.time, time, side="right") - 1, 0)
        t = time - self.time[i]
        return self.angle[i] + t * (self.speed[i] + 0.5 * self.a[i] * t), self.speed[i] + self.a[i] * t, self.a[i]


def _schedule(path: _Path, profile: Profile, machine: Machine, dynamics: Dynamics) -> tuple[Float1D, _Spindle]:
    """When each stretch begins ((m + 1,), s, the last entry is the end), and what the spindle does.

    A stop waits until the lag is inside the window; feed waits until the spindle has its speed.
    """
    m = len(profile.duration)
    moving = profile.duration + profile.average
    wait = np.zeros(m)
    has_way = profile.way > 0
    np.add.at(wait, np.repeat(np.arange(m), np.diff(profile.first)), path.wait)
    if dynamics.kv_per_s:
        lag = stop_lag(profile, 1.0 / dynamics.kv_per_s)
        settle = np.maximum(np.log(np.maximum(lag / dynamics.stop_window_mm, 1e-300)) / dynamics.kv_per_s, 0.0)
        wait += np.where(has_way, settle, 0.0)
    wait += np.where(has_way, dynamics.block_overhead_s, 0.0)
    begins_with = profile.first[:-1]
    rpm = path.rpm[begins_with]
    feeds = path.is_feed[begins_with]
    changes = np.flatnonzero(np.r_[rpm[0] != 0, rpm[1:] != rpm[:-1]])
    begin = np.concatenate([[0.0], np.cumsum(moving + wait)])
    delay = np.zeros(m + 1)
    times, speeds, slopes = [0.0], [0.0], [0.0]
    speed, since, acc = 0.0, 0.0, dynamics.spindle_acc_deg_s2 or machine.spindle_acc_deg_s2
    shift = 0.0
    for number, i in enumerate(changes):
        now = begin[i] + shift
        old_target, running = speed, now - since
        actual = speeds[-1] + slopes[-1] * running if slopes[-1] and now < since else old_target
        if times[-1] > now:  # the last ramp has not finished: go on from where it is
            k = int(np.searchsorted(times, now, side="right")) - 1
            actual = speeds[k] + slopes[k] * (now - times[k])
            del times[k + 1 :], speeds[k + 1 :], slopes[k + 1 :]
        speed = 6.0 * rpm[i]
        duration = abs(speed - actual) / acc
        times += [now, now + duration]
        speeds += [actual, speed]
        slopes += [float(np.sign(speed - actual)) * acc, 0.0]
        since = now + duration
        upto = changes[number + 1] if number + 1 < len(changes) else m
        first_feed = i + int(np.argmax(feeds[i:upto])) if np.any(feeds[i:upto]) else -1
        if first_feed >= 0:
            ready = since - dynamics.spindle_tolerance * abs(speed) / acc
            late = ready - (begin[first_feed] + shift)
            if late > 0:
                delay[first_feed] = late
                shift += late
    begin = begin + np.cumsum(delay)
    t, s, a = np.array(times), np.array(speeds), np.array(slopes)
    dt = np.diff(t)
    angle = np.concatenate([[0.0], np.cumsum(dt * (s[:-1] + 0.5 * a[:-1] * dt))])
    return begin, _Spindle(t, s, a, angle)


def stop_lag(profile: Profile, tau: float) -> Float1D:
    """(m,), mm: lag at the moment when the set point of each stretch comes to rest.

    Braking with a from v, out of a steady cruise, behind a first-order lag tau: a tau^2 (1 - exp(-v / (a tau))). The
    moving average over T after it averages the lag as well, while it fades: times tau / T (1 - exp(-T / tau)).
    """
    a = np.maximum(-profile.piece_a[profile.piece_first[1:] - 1], 1e-12)
    at_rest = a * tau**2 * -np.expm1(-profile.last_speed / (a * tau))
    share = np.maximum(profile.average / tau, 1e-12)
    return at_rest * -np.expm1(-share) / share


def parabola_length(chord: Float1D, sag: Float1D) -> Float1D:
    """(n,), mm: arc length of a symmetric parabola over its chord.

    >>> parabola_length(np.array([2.0]), np.array([0.5])).round(6).item()  # y = (1 - x^2) / 2 from -1 to 1
    2.295587
    """
    steep = 4 * sag
    hypotenuse = np.hypot(chord, steep)
    bent = sag > 1e-9 * chord
    safe = np.where(bent, steep, 1.0)
    curve = hypotenuse / 2 + chord**2 / (2 * safe) * np.arcsinh(safe / np.maximum(chord, 1e-300))
    return np.where(bent, curve, chord)


@njit(cache=True)
def _on_path(way, speed, a, first, stop, before, start, end, sag):
    """Position, velocity, acceleration (n, 3) and segment (n,) at ways along segments that are parabolas."""
    n = len(way)
    position, velocity, acceleration = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    segment = np.empty(n, np.int64)
    i = 0
    for k in range(n):
        lo, hi = first[k], stop[k]
        if i < lo or i >= hi or before[i] > way[k]:  # time goes on, so the segment is the last one or one soon after
            i = min(max(lo + np.searchsorted(before[lo : hi + 1], way[k], side="right") - 1, lo), hi - 1)
        while i + 1 < hi and before[i + 1] <= way[k]:
            i += 1
        segment[k] = i
        length = max(before[i + 1] - before[i], 1e-12)
        u = min(max((way[k] - before[i]) / length, 0.0), 1.0)
        c2 = h2 = 0.0
        for d in range(3):
            c2 += (end[i, d] - start[i, d]) ** 2
            h2 += sag[i, d] ** 2
        if h2 > 1e-6 * c2:  # where the parabola is steep, its parameter is not its length: Newton on the exact length
            c, steep = np.sqrt(c2), 4.0 * np.sqrt(h2)
            goal = (u - 0.5) * length
            for _ in range(8):
                q = steep * (2.0 * u - 1.0)
                root = np.sqrt(c2 + q * q)
                u -= ((q * root + c2 * np.arcsinh(q / max(c, 1e-300))) / (4.0 * steep) - goal) / max(root, 1e-12)
                u = min(max(u, 0.0), 1.0)
        m2 = along = 0.0
        for d in range(3):
            chord = end[i, d] - start[i, d]
            position[k, d] = start[i, d] + u * chord + 4.0 * u * (1.0 - u) * sag[i, d]
            velocity[k, d] = chord + 4.0 * (1.0 - 2.0 * u) * sag[i, d]
            m2 += velocity[k, d] ** 2
            along += velocity[k, d] * -8.0 * sag[i, d]
        m = max(np.sqrt(m2), 1e-12)
        for d in range(3):
            t = velocity[k, d] / m
            bend = (-8.0 * sag[i, d] - along / m * t) / (m * m)
            acceleration[k, d] = t * a[k] + bend * speed[k] ** 2
            velocity[k, d] = t * speed[k]
    return position, velocity, acceleration, segment


def _lag(pos: Float2D, v: Float2D, rate_hz: float, kv: float) -> tuple[Float2D, Float2D, Float2D]:
    """First-order lag behind set points, exact for set points that are linear between samples."""
    dt = 1.0 / rate_hz
    x = kv * dt
    e = np.exp(-x)
    slope = -np.expm1(-x) / x
    b = [1 - slope, slope - e]
    actual = np.empty_like(pos)
    for axis in range(pos.shape[1]):
        origin = pos[0, axis]
        actual[:, axis] = lfilter(b, [1.0, -e], pos[:, axis] - origin) + origin
    velocity = kv * (pos - actual)
    return actual, velocity, kv * (v - velocity)


def _unit(vectors: Float2D) -> Float2D:
    norm = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, norm, out=np.zeros_like(vectors), where=norm > 0)


def _over(a: Float1D, b: Float1D) -> Float1D:
    return np.divide(a, b, out=np.zeros_like(a), where=b > 0)
