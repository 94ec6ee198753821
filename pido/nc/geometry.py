"""Circles of a program: from their many notations to centre and sweep, and to chords within a sagitta bound.

In:  points in the working plane (u, v), mm, w along the plane's normal; G2 turns clockwise seen against the normal.
Out: `Arc` values; `chords` turns any number of them into chord ends and sagitta vectors at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Float1D, Float2D, Int1D

CENTRE_TOLERANCE_MM = 0.05
"""How far start and end radius may differ before the circle is refused (controls allow about this, MD21000/21010)."""


@dataclass(frozen=True, slots=True)
class Arc:
    """Circle or helix: centre (mm), start angle and signed sweep (rad, counter-clockwise positive), both radii (mm)."""

    u: float
    v: float
    start: float
    sweep: float
    radius: float
    radius_end: float


def arc_by_centre(start: tuple[float, float], end: tuple[float, float], centre: tuple[float, float],
                  clockwise: bool, turns: int = 0) -> Arc:  # fmt: skip
    """An arc about a given centre; equal start and end make a full circle.

    Raises ValueError where start and end do not lie on one circle about the centre.
    """
    r0 = math.hypot(start[0] - centre[0], start[1] - centre[1])
    r1 = math.hypot(end[0] - centre[0], end[1] - centre[1])
    if r0 < 1e-6 or r1 < 1e-6:
        raise ValueError("the centre of the circle is its start or end: the radius is zero")
    if abs(r0 - r1) > max(CENTRE_TOLERANCE_MM, 1e-3 * r0):
        raise ValueError(f"start lies {r0:.4f} mm, end {r1:.4f} mm from the centre: not on one circle")
    a0 = math.atan2(start[1] - centre[1], start[0] - centre[0])
    a1 = math.atan2(end[1] - centre[1], end[0] - centre[0])
    same = math.hypot(end[0] - start[0], end[1] - start[1]) < 1e-6
    sweep = 2 * math.pi if same else (a1 - a0) % (2 * math.pi)
    if clockwise:
        sweep = -2 * math.pi if same else sweep - 2 * math.pi
    sweep += math.copysign(2 * math.pi * turns, sweep)
    return Arc(centre[0], centre[1], a0, sweep, r0, r1)


def arc_by_radius(start: tuple[float, float], end: tuple[float, float], radius: float, clockwise: bool) -> Arc:
    """CR=: at most half a circle for a positive radius, more for a negative one.

    Raises ValueError where the end cannot be reached with that radius.
    """
    du, dv = end[0] - start[0], end[1] - start[1]
    chord = math.hypot(du, dv)
    if chord < 1e-9:
        raise ValueError("CR= with equal start and end does not say which circle: give I, J or K")
    if chord > 2 * abs(radius) + CENTRE_TOLERANCE_MM:
        raise ValueError(f"end is {chord:.4f} mm away: not reachable with radius {abs(radius):g} mm")
    height = math.sqrt(max(radius * radius - chord * chord / 4, 0.0))
    side = -1.0 if clockwise == (radius > 0) else 1.0  # of the centre, seen along the chord: +1 left
    centre = (start[0] + du / 2 - side * height * dv / chord, start[1] + dv / 2 + side * height * du / chord)
    return arc_by_centre(start, end, centre, clockwise)


def arc_by_angle(start: tuple[float, float], end: tuple[float, float], angle_deg: float, clockwise: bool) -> Arc:
    """AR= with an end point: opening angle in 0..360 deg."""
    chord = math.hypot(end[0] - start[0], end[1] - start[1])
    if not 0 < angle_deg < 360 or chord < 1e-9:
        raise ValueError("AR= needs an angle between 0 and 360 degrees and an end that is not the start")
    radius = chord / (2 * math.sin(math.radians(angle_deg) / 2))
    return arc_by_radius(start, end, math.copysign(radius, 180.0 - angle_deg + 1e-12), clockwise)


def arc_from_tangent(
    start: tuple[float, float], end: tuple[float, float], direction: tuple[float, float]
) -> Arc | None:
    """CT: the circle that leaves `start` in `direction` and ends in `end`; None where that is a straight line."""
    du, dv = end[0] - start[0], end[1] - start[1]
    norm = math.hypot(*direction)
    cross = (direction[0] * dv - direction[1] * du) / norm
    if abs(cross) < 1e-9:
        return None
    radius = (du * du + dv * dv) / (2 * cross)  # signed: centre on the left where positive
    centre = (start[0] - radius * direction[1] / norm, start[1] + radius * direction[0] / norm)
    return arc_by_centre(start, end, centre, clockwise=radius < 0)


def circle_through(a: Float1D, b: Float1D, c: Float1D) -> tuple[Float1D, Float1D]:
    """Centre and unit normal of the circle through three points in space (CIP); turning about the normal goes a, b, c.

    Raises ValueError where they lie on a line.
    """
    ab, ac = b - a, c - a
    normal = np.cross(ab, ac)
    size = float(normal @ normal)
    if size < 1e-18:
        raise ValueError("start, intermediate point and end lie on one line: no circle through them")
    centre = a + (float(ac @ ac) * np.cross(normal, ab) + float(ab @ ab) * np.cross(ac, normal)) / (2 * size)
    return centre, normal / math.sqrt(size)


def chords(centre: Float2D, e1: Float2D, e2: Float2D, normal: Float2D, sweep: Float1D, radius: Float1D,
           radius_end: Float1D, rise: Float1D, sagitta_mm: float) -> tuple[Int1D, Float2D, Float2D]:  # fmt: skip
    """m helices as chords whose sagitta is at most `sagitta_mm` (and which span at most 4 degrees).

    centre (m, 3); e1, e2, normal (m, 3): start direction, direction of turning, axis; sweep (m,) rad >= 0;
    radius, radius_end, rise (m,) mm.
    Returns how many chords each has (m,), their ends (k, 3) and sagitta vectors (k, 3), mm.
    """
    largest = np.sqrt(8 * sagitta_mm / np.maximum(np.maximum(radius, radius_end), 1e-9))
    count = np.maximum(1, np.ceil(sweep / np.minimum(largest, np.pi / 45))).astype(np.int64)
    owner = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count) + 1

    def at(part: Float1D) -> Float2D:
        angle = (part * sweep[owner])[:, None]
        r = (radius[owner] + part * (radius_end - radius)[owner])[:, None]
        along = (part * rise[owner])[:, None] * normal[owner]
        return centre[owner] + r * (np.cos(angle) * e1[owner] + np.sin(angle) * e2[owner]) + along

    share = 1.0 / count[owner]
    start, middle, end = at((number - 1) * share), at((number - 0.5) * share), at(number * share)
    return count, end, middle - (start + end) / 2
