"""Moves of one block: ends, polar coordinates, circles in every notation, tangential circles, threads.

In:  a block's values and the modal state. Out: straight moves and arcs for the layer below. Positions in mm.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from pido.nc import words as known
from pido.nc.compensation import Compensation
from pido.nc.geometry import arc_by_angle, arc_by_centre, arc_by_radius, arc_from_tangent, circle_through
from pido.nc.grammar import Coordinate
from pido.nc.path import Circle
from pido.nc.state import PLANES, Values

CENTRE = ("I", "J", "K")


class Moves(Compensation):
    """Where a block goes, and along which curve."""

    def _target(self, b: Values) -> list[float]:
        """Programmed end, mm; an axis that is not named stays."""
        target = list(self.position)
        for i, a in enumerate(known.LINEAR):
            if a not in b.at:
                continue
            value = b.at.pop(a)
            incremental = not self.absolute
            if isinstance(value, Coordinate):
                value, incremental = value.value, value.incremental
            if not isinstance(value, (int, float)):
                raise ValueError(f"{a} is no number: {value!r}")
            value = float(value) * self.scale
            if incremental and math.isnan(self.position[i]):
                raise ValueError(f"{a} moves by a distance, but where it stands is not known: give `start`")
            target[i] = self.position[i] + value if incremental else value
        if "RP" in b.at or "AP" in b.at:
            self._polar(b, target)
        return target

    def _polar(self, b: Values, target: list[float]) -> None:
        u, v, _ = PLANES[self.plane]
        for word, name in (("AP", "polar_angle"), ("RP", "polar_radius")):
            if word not in b.at:
                continue
            value = b.at.pop(word)
            incremental = isinstance(value, Coordinate) and value.incremental
            number = value.value if isinstance(value, Coordinate) else value
            number *= self.scale if word == "RP" else 1.0
            setattr(self, name, getattr(self, name) + number if incremental else number)
        angle = math.radians(self.polar_angle)
        target[u] = self.pole[0] + self.polar_radius * math.cos(angle)
        target[v] = self.pole[1] + self.polar_radius * math.sin(angle)

    def _circle(self, target: list[float], b: Values) -> None:
        if any(math.isnan(c) for c in self.position):
            raise ValueError("a circle begins where the axes stand, and that is not known: give `start`")
        if self.motion == "CIP":
            self._through(target, b)
            return
        u, v, w = PLANES[self.plane]
        start, end = self._plane(self.position), self._plane(target)
        clockwise = self.motion == 2
        turns = int(b.take("TURN", 0.0) or 0)
        centre_words = [c for c in (CENTRE[u], CENTRE[v]) if c in b.at]
        if "CR" in b.at:
            arc = arc_by_radius(start, end, b.take("CR") * self.scale, clockwise)
        elif "R" in b.at:
            arc = arc_by_radius(start, end, b.take("R") * self.scale, clockwise)
        elif "AR" in b.at and not centre_words:
            arc = arc_by_angle(start, end, b.take("AR"), clockwise)
        elif centre_words or "AR" in b.at:
            centre = []
            for axis, word in ((u, CENTRE[u]), (v, CENTRE[v])):
                value = b.at.pop(word, 0.0)
                if isinstance(value, Coordinate) and not value.incremental:
                    centre.append(value.value * self.scale)
                else:
                    value = value.value if isinstance(value, Coordinate) else value
                    centre.append(self.position[axis] + value * self.scale)
            if "AR" in b.at:
                angle = math.radians(b.take("AR")) * (-1.0 if clockwise else 1.0)
                du, dv = start[0] - centre[0], start[1] - centre[1]
                end = (
                    centre[0] + du * math.cos(angle) - dv * math.sin(angle),
                    centre[1] + du * math.sin(angle) + dv * math.cos(angle),
                )
                target[u], target[v] = end
            arc = arc_by_centre(start, end, (centre[0], centre[1]), clockwise, turns)
        else:
            raise ValueError("a circle without its centre (I, J, K), radius (CR=) or angle (AR=)")
        if turns and not centre_words:
            arc = replace(arc, sweep=arc.sweep + math.copysign(2 * math.pi * turns, arc.sweep))
        b.at.pop(CENTRE[w], None)
        length = math.hypot(abs(arc.sweep) * (arc.radius + arc.radius_end) / 2, target[w] - self.position[w])
        self._arc(target, arc, self.feed_for(length))

    def _through(self, target: list[float], b: Values) -> None:
        """CIP: the circle through an intermediate point I1, J1, K1, anywhere in space."""
        a, c = np.array(self.position), np.array(target)
        middle = a.copy()
        for i, word in enumerate(("I1", "J1", "K1")):
            if word in b.at:
                value = b.at.pop(word)
                incremental = value.incremental if isinstance(value, Coordinate) else not self.absolute
                number = (value.value if isinstance(value, Coordinate) else value) * self.scale
                middle[i] = a[i] + number if incremental else number
        if self.side in (41, 42):
            raise ValueError("CIP with tool radius compensation is not understood; use G2 or G3")
        centre, normal = circle_through(a, middle, c)
        radius = float(np.linalg.norm(a - centre))
        e1 = (a - centre) / radius
        e2 = np.cross(normal, e1)
        sweep = math.atan2(float((c - centre) @ e2), float((c - centre) @ e1)) % (2 * math.pi)
        feed = self.feed_for(radius * sweep)
        self.position = target
        circle = Circle(_three(centre), _three(e1), _three(e2), _three(normal), sweep, radius, radius, 0.0)
        self.path.circle(self._row(feed), circle)

    def _tangential(self, target: list[float]) -> None:
        """CT: the circle that goes on in the direction in which the last move ended."""
        arc = arc_from_tangent(self._plane(self.position), self._plane(target), self._last_direction())
        feed_length = distance(self.position, target)
        if arc is None:
            self._to(target, self.feed_for(feed_length))
        else:
            self._arc(target, arc, self.feed_for(abs(arc.sweep) * arc.radius))

    def _last_direction(self) -> tuple[float, float]:
        u, v, _ = PLANES[self.plane]
        rows = self.path.rows
        if not rows or self.side in (41, 42):
            raise ValueError("CT needs a move before it, without tool radius compensation")
        if (circle := self.path.circles.get(len(rows) - 1)) is not None:
            tangent = [
                math.cos(circle.sweep) * q - math.sin(circle.sweep) * p
                for p, q in zip(circle.e1, circle.e2, strict=True)
            ]
        else:
            tangent = [b - a for a, b in zip(rows[-2][:3] if len(rows) > 1 else self.first, rows[-1][:3], strict=True)]
        if math.hypot(tangent[u], tangent[v]) < 1e-12 or math.isnan(tangent[u] + tangent[v]):
            raise ValueError("CT needs a move in the working plane before it")
        return tangent[u], tangent[v]

    def _thread(self, target: list[float], b: Values) -> None:
        """G33, G331, G332: the pitch I, J or K per revolution."""
        pitch = next((abs(b.take(c)) for c in CENTRE if c in b.at), 0.0) * self.scale
        if not pitch or not self.speed_word:
            raise ValueError("a thread needs its pitch (I, J or K) and a spindle speed")
        self._to(target, pitch * abs(self.speed_word) / 60.0)


def distance(a: list[float], b: list[float]) -> float:
    d = math.dist(a, b)
    return 0.0 if math.isnan(d) else d


def _three(v: Any) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])
