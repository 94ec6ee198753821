"""Tool radius compensation (G41, G42): the programmed contour -> the path of the tool's middle, in the working plane.

In:  lines and circles of the contour, mm, with the tool's radius and side.
Out: lines and circles at that distance: outer corners with a circle about the corner (G450), inner ones shortened to
     the intersection. A contour that the tool cannot follow is an error, as on the control.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from pido.nc.geometry import Arc

TANGENT_RAD = 1e-6
Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Element:
    """A piece of the contour; `arc` is None on a line. w: height at its end; what: whatever belongs to it."""

    start: Point
    end: Point
    w: float
    what: Any
    arc: Arc | None = None

    @property
    def is_upright(self) -> bool:
        """Moves along the tool only."""
        return self.arc is None and math.dist(self.start, self.end) < 1e-9

    def direction(self, at_end: bool) -> Point:
        """Unit tangent at its start or end."""
        if self.arc is None:
            length = math.dist(self.start, self.end)
            return (self.end[0] - self.start[0]) / length, (self.end[1] - self.start[1]) / length
        angle = self.arc.start + (self.arc.sweep if at_end else 0.0)
        sign = math.copysign(1.0, self.arc.sweep)
        return -sign * math.sin(angle), sign * math.cos(angle)


def offset_contour(elements: list[Element], radius: float, left: bool, closes: bool) -> list[Element]:
    """The tool's path: the first element approaches the contour, the last one leaves it where `closes`.

    Raises ValueError, with the element's `what` as second argument, where the tool is too large for the contour.
    """
    side = radius if left else -radius
    upright = [e for e in elements if e.is_upright]
    flat = [e for e in elements if not e.is_upright]
    if len(flat) < 2:
        return elements
    if flat[0].arc is not None or (closes and flat[-1].arc is not None):
        raise ValueError("tool radius compensation begins and ends on a straight line, not on a circle", flat[0].what)
    contour = flat[1:-1] if closes else flat[1:]
    after = _followers(elements, upright)
    if not contour:
        return elements
    shifted = [_shift(e, side) for e in contour]
    out: list[Element] = [replace(flat[0], end=shifted[0].start)]
    out += _at(after.get(id(flat[0]), []), out[-1].end)
    joined = _join(contour, shifted, side)
    for original, pieces in zip(contour, joined, strict=True):
        out += pieces
        out += _at(after.get(id(original), []), out[-1].end)
    if closes:
        out.append(replace(flat[-1], start=out[-1].end))
        out += after.get(id(flat[-1]), [])
    return out


def _followers(elements: list[Element], upright: list[Element]) -> dict[int, list[Element]]:
    """Moves along the tool, by the element of the contour after which they come."""
    after: dict[int, list[Element]] = {}
    previous = None
    for e in elements:
        if e.is_upright and previous is not None:
            after.setdefault(id(previous), []).append(e)
        elif not e.is_upright:
            previous = e
    return after


def _at(elements: list[Element], place: Point) -> list[Element]:
    return [replace(e, start=place, end=place) for e in elements]


def _shift(e: Element, side: float) -> Element:
    """The element at distance `side` to its left."""
    if e.arc is None:
        u, v = e.direction(False)
        return replace(
            e, start=(e.start[0] - side * v, e.start[1] + side * u), end=(e.end[0] - side * v, e.end[1] + side * u)
        )
    inwards = side * math.copysign(1.0, e.arc.sweep)
    arc = replace(e.arc, radius=e.arc.radius - inwards, radius_end=e.arc.radius_end - inwards)
    if min(arc.radius, arc.radius_end) <= 1e-9:
        raise ValueError(
            f"inner circle of radius {e.arc.radius:g} mm is too small for the tool's radius {abs(side):g} mm", e.what
        )
    return replace(e, arc=arc, start=_on(arc, 0.0), end=_on(arc, 1.0))


def _on(arc: Arc, part: float) -> Point:
    angle, r = arc.start + part * arc.sweep, arc.radius + part * (arc.radius_end - arc.radius)
    return arc.u + r * math.cos(angle), arc.v + r * math.sin(angle)


def _join(contour: list[Element], shifted: list[Element], side: float) -> list[list[Element]]:
    """Per element of the contour its shifted form, trimmed or followed by a corner circle."""
    pieces = [[e] for e in shifted]
    for i in range(len(contour) - 1):
        t1, t2 = contour[i].direction(True), contour[i + 1].direction(False)
        turn = math.atan2(t1[0] * t2[1] - t1[1] * t2[0], t1[0] * t2[0] + t1[1] * t2[1])
        a, b = pieces[i][0], pieces[i + 1][0]
        if abs(turn) < TANGENT_RAD:
            continue
        corner = contour[i].end
        if turn * side < 0:  # outer corner: a circle about it
            start = math.atan2(a.end[1] - corner[1], a.end[0] - corner[0])
            arc = Arc(corner[0], corner[1], start, turn, abs(side), abs(side))
            pieces[i].append(Element(a.end, b.start, a.w, a.what, arc))
            continue
        places = [p for p in _intersections(a, b) if _holds(a, p) and _holds(b, p)]
        if not places:
            raise ValueError(
                f"the tool (radius {abs(side):g} mm) does not fit into this inner corner", contour[i + 1].what
            )
        place = min(places, key=lambda p: math.dist(p, corner))
        pieces[i][0], pieces[i + 1][0] = _trim(a, place, at_end=True), _trim(b, place, at_end=False)
    return pieces


def _holds(e: Element, p: Point) -> bool:
    """`p`, known to lie on the element's line or circle, lies between its ends."""
    if e.arc is None:
        u, v = e.end[0] - e.start[0], e.end[1] - e.start[1]
        along = ((p[0] - e.start[0]) * u + (p[1] - e.start[1]) * v) / (u * u + v * v)
        return -1e-9 <= along <= 1 + 1e-9
    return _part(e.arc, p) <= 1 + 1e-9


def _part(arc: Arc, p: Point) -> float:
    angle = (math.atan2(p[1] - arc.v, p[0] - arc.u) - arc.start) * math.copysign(1.0, arc.sweep) % (2 * math.pi)
    if 2 * math.pi - angle < 1e-9:
        angle = 0.0
    return angle / abs(arc.sweep)


def _trim(e: Element, p: Point, at_end: bool) -> Element:
    if e.arc is None:
        return replace(e, end=p) if at_end else replace(e, start=p)
    part = _part(e.arc, p)
    if at_end:
        return replace(e, end=p, arc=replace(e.arc, sweep=part * e.arc.sweep))
    arc = replace(e.arc, start=e.arc.start + part * e.arc.sweep, sweep=(1 - part) * e.arc.sweep)
    return replace(e, start=p, arc=arc)


def _intersections(a: Element, b: Element) -> list[Point]:
    if a.arc is None and b.arc is None:
        (u1, v1), (u2, v2) = a.direction(True), b.direction(False)
        cross = u1 * v2 - v1 * u2
        if abs(cross) < 1e-12:
            return []
        t = ((b.start[0] - a.end[0]) * v2 - (b.start[1] - a.end[1]) * u2) / cross
        return [(a.end[0] + t * u1, a.end[1] + t * v1)]
    if a.arc is not None and b.arc is not None:
        return _circles(a.arc, b.arc)
    line, arc = (a, b.arc) if a.arc is None else (b, a.arc)
    assert arc is not None
    u, v = line.direction(False)
    du, dv = line.start[0] - arc.u, line.start[1] - arc.v
    half = du * u + dv * v
    rest = half * half - (du * du + dv * dv - arc.radius**2)
    if rest < 0:
        return []
    return [(line.start[0] + t * u, line.start[1] + t * v) for t in (-half - math.sqrt(rest), -half + math.sqrt(rest))]


def _circles(a: Arc, b: Arc) -> list[Point]:
    d = math.hypot(b.u - a.u, b.v - a.v)
    if d < 1e-12:
        return []
    along = (d * d + a.radius**2 - b.radius**2) / (2 * d)
    rest = a.radius**2 - along**2
    if rest < 0:
        return []
    u, v, h = (b.u - a.u) / d, (b.v - a.v) / d, math.sqrt(rest)
    return [(a.u + along * u - s * h * v, a.v + along * v + s * h * u) for s in (1.0, -1.0)]
