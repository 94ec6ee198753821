"""Straight moves and arcs as they are written down, with tool radius compensation (G40, G41, G42) in between.

In:  moves of the programmed contour. Out: rows in the path; a compensated contour is collected until it ends, because
     how far a corner is cut or rounded depends on the element that follows.
"""

from __future__ import annotations

import math

from pido.nc.geometry import Arc
from pido.nc.offset import Element, offset_contour
from pido.nc.path import Circle
from pido.nc.state import PLANES, State


class Compensation(State):
    """Writes moves, beside the contour where G41 or G42 holds."""

    def _to(self, target: list[float], feed: float) -> None:
        if self.side in (41, 42) or self.closing:
            self._collect(target, feed, None)
            return
        self.position = target
        self.path.rows.append(self._row(feed))

    def _arc(self, target: list[float], arc: Arc, feed: float) -> None:
        if self.side in (41, 42) or self.closing:
            self._collect(target, feed, arc)
            return
        w = PLANES[self.plane][2]
        circle = self._in_space(arc, self.position[w], target[w])
        self.position = target
        self.path.circle(self._row(feed), circle)

    def _in_space(self, arc: Arc, low: float, high: float) -> Circle:
        u, v, w = PLANES[self.plane]
        sign = math.copysign(1.0, arc.sweep)
        cos, sin = math.cos(arc.start), math.sin(arc.start)

        def vector(a: float, b: float, c: float) -> tuple[float, float, float]:
            out = [0.0, 0.0, 0.0]
            out[u], out[v], out[w] = a, b, c
            return out[0], out[1], out[2]

        return Circle(
            centre=vector(arc.u, arc.v, low),
            e1=vector(cos, sin, 0.0),
            e2=vector(-sign * sin, sign * cos, 0.0),
            normal=vector(0.0, 0.0, 1.0),
            sweep=abs(arc.sweep),
            radius=arc.radius,
            radius_end=arc.radius_end,
            rise=high - low,
        )

    def _plane(self, p: list[float]) -> tuple[float, float]:
        u, v, _ = PLANES[self.plane]
        return p[u], p[v]

    def _compensation(self, g: int) -> None:
        if g == 40:
            self.closing = bool(self.contour) and self.side in (41, 42)
            if not self.closing:
                self.side = 40
            return
        if self.contour and self.side != g:
            raise ValueError("change of side without G40 in between")
        self.side = g
        if self.cutting_edge and self.radius is None:
            raise ValueError("G41/G42 needs the tool's radius: give the tool in the list of tools")

    def _collect(self, target: list[float], feed: float, arc: Arc | None) -> None:
        _u, _v, w = PLANES[self.plane]
        what = (feed, self.line, self.modal, self.step)
        self.contour.append(Element(self._plane(self.position), self._plane(target), target[w], what, arc))
        self.position = target
        if self.closing and not self.contour[-1].is_upright:
            self._flush()

    def _flush(self) -> None:
        """Write the compensated contour down."""
        if not self.contour:
            return
        elements, closes, left = self.contour, self.closing, self.side == 41
        self.contour, self.closing = [], False
        if closes:
            self.side = 40
        radius = (self.radius or 0.0) if self.cutting_edge else 0.0
        if any(math.isnan(c) for e in elements for c in (*e.start, *e.end, e.w)):
            raise ValueError(
                "tool radius compensation begins where the axes stand, and that is not known: give `start`"
            )
        if radius > 0:
            elements = offset_contour(elements, radius, left, closes)
        u, v, w = PLANES[self.plane]
        height = elements[0].w
        if self.path.rows:
            height = self.path.rows[-1][w]
        height = elements[0].w if math.isnan(height) else height
        for e in elements:
            feed, line, modal, step = e.what
            place = [0.0, 0.0, 0.0]
            place[u], place[v], place[w] = e.end[0], e.end[1], e.w
            row = (place[0], place[1], place[2], feed, line, modal, step)
            if e.arc is None:
                self.path.rows.append(row)
            else:
                self.path.circle(row, self._in_space(e.arc, height, e.w))
            height = e.w
