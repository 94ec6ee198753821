"""Speed along a path: the fastest profile under speed, acceleration and jerk limits, from stop to stop.

In:  segments (length, speed limit, acceleration, jerk) and where the path stops.
Out: per stretch between two stops, pieces of constant acceleration and the length of a moving average over them.

Jerk: a profile of constant accelerations a, averaged over a time T, is the S-curve with jerk a / T; its way is the
same and it takes T longer. Per stretch a is at most sqrt(v j), v its highest speed, and T = a / j: the fastest S-curve
between rest and v, also where v is too low to reach full acceleration. Position stays on the path. The average
of a piecewise quadratic way is a difference of piecewise cubics, so it is evaluated in closed form at any time. The
jerk limit holds along the path; where a curve begins, the axes feel its centripetal acceleration at once.
Source: moving-average (FIR) trajectory generation, Biagiotti & Melchiorri (2012), IFAC ROBCON / Robotics and CIM.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from pido.core.arrays import Bool1D, Float1D, Int1D


@dataclass(frozen=True, eq=False)
class Profile:
    """m stretches, k pieces.

    first : (m + 1,) – first segment of each stretch
    duration, average : (m,), s – of the pieces, of the moving average
    way : (m,), mm – length; last_speed : (m,), mm/s – speed from which the stretch brakes to its stop
    piece_time (s, within the stretch), piece_way (mm), piece_speed, piece_a, piece_integral (mm s) : (k,)
    piece_first : (m + 1,) – first piece of each stretch
    """

    first: Int1D
    duration: Float1D
    average: Float1D
    way: Float1D
    last_speed: Float1D
    piece_first: Int1D
    piece_time: Float1D
    piece_way: Float1D
    piece_speed: Float1D
    piece_a: Float1D
    piece_integral: Float1D

    def at(self, stretch: Int1D, time: Float1D) -> tuple[Float1D, Float1D, Float1D]:
        """Way (mm), speed (mm/s) and acceleration (mm/s²), `time` seconds after a stretch began; (n,) each."""
        pieces = (self.piece_time, self.piece_way, self.piece_speed, self.piece_a, self.piece_integral)
        return _evaluate(stretch, time, self.duration, self.average, self.way, self.piece_first, *pieces)


def plan_profile(length: Float1D, speed: Float1D, a: Float1D, jerk: Float1D, stop: Bool1D) -> Profile:
    """The profile of n segments; `stop[i]`: at rest at the end of segment i. The last one always ends at rest.

    length mm, > 0 or 0; speed mm/s, a mm/s², jerk mm/s³, all > 0, (n,) each.
    """
    stop = stop.copy()
    if len(stop):
        stop[-1] = True
    first = np.concatenate([[0], np.flatnonzero(stop) + 1]).astype(np.int64)
    reach, a_curve, average = _stretches(length, speed, a, jerk, first)
    owner, part, top = _spread(length, speed, first, average)
    inner = np.searchsorted(owner, first).astype(np.int64)
    stretch = np.repeat(np.arange(len(first) - 1), np.diff(inner))
    limited = np.minimum(a[owner], a_curve[stretch])
    outputs = (*_plan(part, np.minimum(top, reach[stretch]), limited, inner),)
    duration, way, last, count, time, ways, speeds, accelerations, integral = outputs
    piece_first = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    return Profile(
        first, duration, average, way, last, piece_first, time, ways, speeds, accelerations, integral
    )  # fmt: skip


@njit(cache=True)
def _piece(k, t, i, duration, total, first, time, ways, speeds, accelerations, integral):
    """Integral of way, way, speed and acceleration before averaging, and the piece; `i`: the piece of the time before.

    Before and after the stretch the profile stands still.
    """
    if t <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, first[k]
    stop = first[k + 1]
    if t >= duration[k]:
        last = stop - 1
        dt = duration[k] - time[last]
        end = integral[last] + dt * (ways[last] + dt * (speeds[last] / 2.0 + accelerations[last] * dt / 6.0))
        return end + (t - duration[k]) * total[k], total[k], 0.0, 0.0, last
    if i < first[k] or i >= stop or time[i] > t:
        i = first[k] + np.searchsorted(time[first[k] : stop], t, side="right") - 1
    while i + 1 < stop and time[i + 1] <= t:
        i += 1
    dt = t - time[i]
    s, v, a = ways[i], speeds[i], accelerations[i]
    area = integral[i] + dt * (s + dt * (v / 2.0 + a * dt / 6.0))
    return area, s + dt * (v + 0.5 * a * dt), v + a * dt, a, i


@njit(cache=True)
def _evaluate(stretch, when, duration, average, total, first, time, ways, speeds, accelerations, integral):
    n = len(when)
    way, speed, a = np.empty(n), np.empty(n), np.empty(n)
    i_late, i_early = 0, 0
    for j in range(n):
        k, t, span = stretch[j], when[j], average[stretch[j]]
        late = _piece(k, t, i_late, duration, total, first, time, ways, speeds, accelerations, integral)
        i_late = late[4]
        if span > 0.0:
            early = _piece(k, t - span, i_early, duration, total, first, time, ways, speeds, accelerations, integral)
            i_early = early[4]
            way[j] = (late[0] - early[0]) / span
            speed[j] = (late[1] - early[1]) / span
            a[j] = (late[2] - early[2]) / span
        else:
            way[j], speed[j], a[j] = late[1], late[2], late[3]
        way[j] = min(max(way[j], 0.0), total[k])
        speed[j] = max(speed[j], 0.0)
    return way, speed, a


@njit(cache=True)
def _stretches(length, speed, a_limit, jerk, first):
    """Per stretch: the highest speed that it can reach at all, its acceleration, and the time of the moving average.

    v sqrt(v/j) is the way of an S-curve from rest where acceleration is not limited, v (v/a + a/j) / 2 where it is.
    """
    m = len(first) - 1
    reach, a_curve, average = np.ones(m), np.ones(m), np.zeros(m)
    for i in range(m):
        total, top, low, j, a = 0.0, 0.0, 1e300, 1e300, 0.0
        for q in range(first[i], first[i + 1]):
            total += length[q]
            top, low, j, a = max(top, speed[q]), min(low, speed[q]), min(j, jerk[q]), max(a, a_limit[q])
        reach[i], a_curve[i] = top, a
        if total <= 0.0:
            continue
        reach[i] = min(top, (total * total * j / 4.0) ** (1.0 / 3.0))
        a_curve[i] = np.sqrt(reach[i] * j)
        if a_curve[i] > a:
            a_curve[i] = a
            span = a / j
            reach[i] = min(reach[i], 0.5 * a * (np.sqrt(span * span + 4.0 * total / a) - span))
        # Where limits change on the way, speeding up may turn into braking at once: twice the step, so twice the time.
        average[i] = a_curve[i] / j if reach[i] <= low else 2.0 * a_curve[i] / j
    return reach, a_curve, average


@njit(cache=True)
def _spread(length, speed, first, average):
    """Slow places hold their speed half an averaging time before and after, so that the average is not faster there.

    Returns parts of the segments: owner (k,), length (k,) mm and speed (k,) mm/s.
    """
    owner = np.arange(len(length))
    for _ in range(2):  # forwards, then backwards
        n = len(length)
        new_owner, new_length, new_speed = np.empty(2 * n + 1, np.int64), np.empty(2 * n + 1), np.empty(2 * n + 1)
        held_speed, held_end = np.empty(n + 2), np.empty(n + 2)
        k, q = 0, 0
        for i in range(len(first) - 1):
            s, depth = 0.0, 0
            while q < n and owner[q] < first[i + 1] and owner[q] >= first[i]:
                end, limit = s + length[q], speed[q]
                while True:
                    while depth > 0 and (held_end[depth - 1] <= s + 1e-12 or held_speed[depth - 1] >= limit):
                        if held_end[depth - 1] > end and held_speed[depth - 1] >= limit:
                            break  # holds again behind this slower segment
                        depth -= 1
                    held = depth > 0 and held_speed[depth - 1] < limit
                    stop = min(end, held_end[depth - 1]) if held else end
                    new_owner[k], new_length[k] = owner[q], stop - s
                    new_speed[k] = held_speed[depth - 1] if held else limit
                    k += 1
                    s = stop
                    if s >= end - 1e-12:
                        break
                reach = end + 0.5 * limit * average[i]
                while depth > 0 and held_end[depth - 1] <= reach and held_speed[depth - 1] >= limit:
                    depth -= 1
                at = depth  # the lowest speed lies on top
                while at > 0 and held_speed[at - 1] < limit:
                    held_speed[at], held_end[at] = held_speed[at - 1], held_end[at - 1]
                    at -= 1
                held_speed[at], held_end[at] = limit, reach
                depth += 1
                s = end
                q += 1
        # Turn round: the second pass runs the reversed path, and turns it back.
        m = len(first) - 1
        owner, length, speed = new_owner[:k][::-1].copy(), new_length[:k][::-1].copy(), new_speed[:k][::-1].copy()
        last = first[m]
        owner = last - 1 - owner
        turned = np.empty_like(first)
        for i in range(m + 1):
            turned[i] = last - first[m - i]
        first, average = turned, average[::-1].copy()
    return owner, length, speed


@njit(cache=True)
def _plan(length, speed, a_limit, first):
    """Look-ahead: the fastest pieces of constant acceleration, stretch by stretch."""
    m = len(first) - 1
    n = len(length)
    duration, way, last = np.zeros(m), np.zeros(m), np.zeros(m)
    count = np.zeros(m, np.int64)
    time, ways, speeds = np.zeros(3 * n + m), np.zeros(3 * n + m), np.zeros(3 * n + m)
    accelerations, integral = np.zeros(3 * n + m), np.zeros(3 * n + m)
    leave = np.zeros(n)
    k = 0
    for i in range(m):
        lo, hi = first[i], first[i + 1]
        # Backwards: no segment is left faster than the next ones can be braked from.
        v = 0.0
        for q in range(hi - 1, lo - 1, -1):
            leave[q] = v
            v = min(speed[q], np.sqrt(v * v + 2.0 * a_limit[q] * length[q]))
            if q > lo:
                v = min(v, speed[q - 1])
        # Forwards, and the pieces of each segment: speed up, cruise, brake.
        v, t, s, area = 0.0, 0.0, 0.0, 0.0
        start = k
        for q in range(lo, hi):
            if length[q] <= 0.0:
                continue
            a = a_limit[q]
            v_end = min(leave[q], np.sqrt(v * v + 2.0 * a * length[q]))
            peak = min(speed[q], np.sqrt(a * length[q] + 0.5 * (v * v + v_end * v_end)))
            peak = max(peak, max(v, v_end))
            up, down = (peak * peak - v * v) / (2.0 * a), (peak * peak - v_end * v_end) / (2.0 * a)
            cruise = max(length[q] - up - down, 0.0)
            for part in range(3):
                if part == 0:
                    dt, acc, v0 = (peak - v) / a, a, v
                elif part == 1:
                    dt, acc, v0 = cruise / max(peak, 1e-300), 0.0, peak
                else:
                    dt, acc, v0 = (peak - v_end) / a, -a, peak
                if dt <= 0.0:
                    continue
                time[k], ways[k], speeds[k], accelerations[k], integral[k] = t, s, v0, acc, area
                k += 1
                area += dt * (s + dt * (v0 / 2.0 + acc * dt / 6.0))
                s += dt * (v0 + 0.5 * acc * dt)
                t += dt
            if down > 0.0 or v_end < peak:
                last[i] = peak
            v = v_end
        if k == start:  # a stretch without length: one piece at rest
            k += 1
        duration[i], way[i], count[i] = t, s, k - start
    return duration, way, last, count, time[:k], ways[:k], speeds[:k], accelerations[:k], integral[:k]
