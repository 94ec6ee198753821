"""Speed along a path: the fastest profile under speed, acceleration and jerk limits, from stop to stop.

In:  segments (length, speed limit, acceleration, jerk) and where the path stops.
Out: per stretch between two stops, pieces of constant acceleration and the length of a moving average over them.

Jerk: a profile of constant accelerations a, averaged over a time T, is the S-curve with jerk a / T; its way is the same and it
takes T longer. Per stretch a is at most sqrt(v j), v its highest speed, and T = a / j: exactly the fastest S-curve between
rest and v, also where v is too low to reach full acceleration. Position stays on the path. The average of a
piecewise quadratic way is a difference of piecewise cubics, so it is evaluated in closed form at any time.
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

    first : (m + 1,) – first segment of each stretch; duration, average : (m,), s – of the pieces, of the moving average
    way : (m,), mm – length; last_speed : (m,), mm/s – speed from which the stretch brakes to its stop
    piece_stretch : (k,); piece_time (s, within the stretch), piece_way (mm), piece_speed, piece_a, piece_integral (mm s) : (k,)
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
        """Way (mm), speed (mm/s) and acceleration (mm/s²) `time` seconds after the beginning of a stretch; (n,) each."""
        average = self.average[stretch]
        late = self._pieces(stretch, time)
        early = self._pieces(stretch, time - average)
        safe = np.where(average > 0, average, 1.0)
        plain = average <= 0
        way, speed, a = ((new - old) / safe for new, old in zip(late[:3], early[:3], strict=True))
        if np.any(plain):
            way, speed, a = (
                np.where(plain, raw, smooth) for raw, smooth in zip(late[1:], (way, speed, a), strict=True)
            )
        return np.clip(way, 0.0, self.way[stretch]), np.maximum(speed, 0.0), a

    def _pieces(self, stretch: Int1D, time: Float1D) -> tuple[Float1D, Float1D, Float1D, Float1D]:
        """Integral of way, way, speed, acceleration of the profile before averaging; before and after it stands still."""
        inside = np.clip(time, 0.0, self.duration[stretch])
        begin = np.concatenate([[0.0], np.cumsum(self.duration + 1.0)])[:-1]  # apart, so that one search serves all
        owner = np.repeat(np.arange(len(self.duration)), np.diff(self.piece_first))
        key = begin[owner] + self.piece_time
        i = np.searchsorted(key, begin[stretch] + inside, side="right") - 1
        i = np.clip(i, self.piece_first[stretch], self.piece_first[stretch + 1] - 1)
        t = inside - self.piece_time[i]
        s0, v0, a = self.piece_way[i], self.piece_speed[i], self.piece_a[i]
        way = s0 + t * (v0 + 0.5 * a * t)
        integral = self.piece_integral[i] + t * (s0 + t * (v0 / 2 + a * t / 6))
        after = time - self.duration[stretch]
        total = self.way[stretch]
        done, still = after > 0, time < 0
        integral = np.where(done, integral + after * total, np.where(still, 0.0, integral))
        moving = ~(done | still)
        return integral, np.where(done, total, way), np.where(moving, v0 + a * t, 0.0), np.where(moving, a, 0.0)


def plan_profile(length: Float1D, speed: Float1D, a: Float1D, jerk: Float1D, stop: Bool1D) -> Profile:
    """The profile of n segments; `stop[i]`: at rest at the end of segment i. The last one always ends at rest.

    length mm, > 0 or 0; speed mm/s, a mm/s², jerk mm/s³, all > 0, (n,) each.
    """
    stop = stop.copy()
    if len(stop):
        stop[-1] = True
    first = np.concatenate([[0], np.flatnonzero(stop) + 1]).astype(np.int64)
    outputs = _plan(length, speed, a, jerk, first)
    duration, average, way, last, count, time, ways, speeds, accelerations, integral = outputs
    piece_first = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    return Profile(
        first, duration, average, way, last, piece_first, time, ways, speeds, accelerations, integral
    )  # fmt: skip


@njit(cache=True)
def _plan(length, speed, a_limit, jerk, first):
    m = len(first) - 1
    n = len(length)
    duration, average, way, last = np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m)
    count = np.zeros(m, np.int64)
    time, ways, speeds = np.zeros(3 * n + m), np.zeros(3 * n + m), np.zeros(3 * n + m)
    accelerations, integral = np.zeros(3 * n + m), np.zeros(3 * n + m)
    leave = np.zeros(n)
    k = 0
    for i in range(m):
        lo, hi = first[i], first[i + 1]
        # The highest speed that the stretch can reach at all, so that T suits short moves as well.
        total, top, j, a_top = 0.0, 0.0, 1e300, 0.0
        for q in range(lo, hi):
            total += length[q]
            top, j, a_top = max(top, speed[q]), min(j, jerk[q]), max(a_top, a_limit[q])
        if total > 0.0:
            reach = min(
                top, (total * total * j / 4.0) ** (1.0 / 3.0)
            )  # way of two full S-curves from rest: 2 v sqrt(v/j)
            a_curve = np.sqrt(reach * j)
        else:
            a_curve = a_top
        a_used = min(a_top, a_curve)
        average[i] = a_used / j if total > 0.0 else 0.0
        # Backwards: no segment is left faster than the next ones can be braked from.
        v = 0.0
        for q in range(hi - 1, lo - 1, -1):
            leave[q] = v
            a = min(a_limit[q], a_curve)
            v = min(speed[q], np.sqrt(v * v + 2.0 * a * length[q]))
            if q > lo:
                v = min(v, speed[q - 1])
        # Forwards, and the pieces of each segment: speed up, cruise, brake.
        v, t, s, area = 0.0, 0.0, 0.0, 0.0
        start = k
        for q in range(lo, hi):
            if length[q] <= 0.0:
                continue
            a = min(a_limit[q], a_curve)
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
    return duration, average, way, last, count, time[:k], ways[:k], speeds[:k], accelerations[:k], integral[:k]
