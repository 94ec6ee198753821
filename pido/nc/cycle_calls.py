"""Calls of drilling patterns and cycles: CYCLE81(...), MCALL, HOLES1(...), and G81 to G89 of plain ISO.

In:  a call's arguments, or the words of an ISO block. Out: the cycle's moves, drawn by a `Pen` in the working plane.
"""

from __future__ import annotations

import math
from typing import Any

from pido.nc import words as known
from pido.nc.cycles import CYCLES, PATTERNS, Cycle, arguments
from pido.nc.geometry import arc_by_centre
from pido.nc.grammar import Coordinate
from pido.nc.moves import distance
from pido.nc.path import RAPID_FEED
from pido.nc.state import PLANES, Values
from pido.nc.work_frames import WorkFrames


class CycleCalls(WorkFrames):
    """Cycles at once, at every point that follows (MCALL), or at a pattern of holes."""

    def _call(self, name: str, values: tuple[Any, ...]) -> None:
        if name == "CYCLE800":
            if any(v not in (None, 0.0, "") for v in values[7:13]):
                raise ValueError("CYCLE800 turns the plane: only three axes are simulated; split the program per side")
            return
        if name == "MCALL":
            self.modal_cycle = None
            self.renew()
            return
        if name.startswith("MCALL "):
            self.modal_cycle = (name.removeprefix("MCALL "), values)
            if not CYCLES[self.modal_cycle[0]].at_point:
                raise ValueError(f"{self.modal_cycle[0]} does not work at points: it cannot follow MCALL")
            arguments(*self.modal_cycle)
            self.renew()
            return
        if name in PATTERNS:
            if self.modal_cycle is None:
                raise ValueError(f"{name} needs a drilling cycle before it: MCALL CYCLE81(...)")
            for u, v in PATTERNS[name](arguments(name, values)):
                self.pen_rapid(u=u, v=v)
                self._run_cycle(*self.modal_cycle)
            return
        self._run_cycle(name, values)

    def _run_cycle(self, name: str, values: tuple[Any, ...]) -> None:
        self._flush()
        cycle: Cycle = CYCLES[name]
        cycle.run(_Pen(self), arguments(name, values))

    def pen_rapid(self, u: float | None = None, v: float | None = None, w: float | None = None) -> None:
        self._to(self._pen_target(u, v, w), RAPID_FEED)

    def _pen_target(self, u: float | None, v: float | None, w: float | None) -> list[float]:
        target = list(self.position)
        for axis, value in zip(PLANES[self.plane], (u, v, w), strict=True):
            if value is not None:
                target[axis] = float(value)
        return target

    def _begin_iso(self, g: int, b: Values) -> None:
        """G73, G81-G89: hold R (safe plane), Z (depth), Q (step), P (dwell) until G80 or another motion."""
        w = known.LINEAR[PLANES[self.plane][2]]
        held = self.iso_cycle[1] if self.iso_cycle else {}
        if self.iso_cycle is None:
            self.iso_start = self.position[PLANES[self.plane][2]]
        for word in ("R", w, "Q", "P"):
            if word in b.at:
                held = {**held, ("Z" if word == w else word): b.at.pop(word)}
        for word in ("K", "L"):
            if word in b.at and b.take(word) != 1:
                raise ValueError("repeated holes (K or L) are not understood: write each position")
        if "Z" not in held or "R" not in held:
            raise ValueError(f"G{g} needs the depth {w} and the plane R")
        self.iso_cycle = (g, held)
        if not any(a in b.at for a in known.LINEAR):
            u = known.LINEAR[PLANES[self.plane][0]]
            b.at[u] = Coordinate(0.0, True)

    def _iso_hole(self, b: Values) -> None:
        assert self.iso_cycle is not None
        g, held = self.iso_cycle
        w = PLANES[self.plane][2]
        for word in ("R", known.LINEAR[w], "Q", "P"):
            if word in b.at:
                held["Z" if word == known.LINEAR[w] else word] = b.at.pop(word)
        target = self._target(b)
        self._to(target, RAPID_FEED)
        plane = held["R"] * self.scale if self.absolute else self.iso_start + held["R"] * self.scale
        depth = held["Z"] * self.scale if self.absolute else plane + held["Z"] * self.scale
        back = self.iso_start if self.iso_return_to_start and not math.isnan(self.iso_start) else plane
        wait = held.get("P", 0.0)
        values: dict[str, Any] = {"RTP": back, "RFP": plane, "SDIS": 0.0, "DP": depth, "DPR": None}
        values |= {"DTB": wait / 1000.0 if wait >= 100 else wait}
        values |= {"FDEP": None, "FDPR": (held.get("Q") or 0.0) * self.scale, "DAM": 0.0, "DTS": 0.0, "FRF": 1.0}
        values["VARI"] = 1 if g == 83 else 0
        name = {73: "CYCLE83", 83: "CYCLE83", 85: "CYCLE85", 86: "CYCLE88", 89: "CYCLE89"}.get(g, "CYCLE81")
        CYCLES[name].run(_Pen(self), values)


class _Pen:
    """What a cycle draws with (`pido.nc.cycles.Pen`): plane coordinates, feeds in mm/s."""

    def __init__(self, calls: CycleCalls) -> None:
        self._e = calls

    @property
    def feed_mm_s(self) -> float:
        return self._e.feed_for(1.0)

    @property
    def rpm(self) -> float:
        return self._e.rpm

    @property
    def tool_radius_mm(self) -> float | None:
        return self._e.radius

    @property
    def position(self) -> tuple[float, float, float]:
        u, v, w = PLANES[self._e.plane]
        p = self._e.position
        return p[u], p[v], p[w]

    def rapid(self, u: float | None = None, v: float | None = None, w: float | None = None) -> None:
        self._e.pen_rapid(u, v, w)

    def feed(
        self, u: float | None = None, v: float | None = None, w: float | None = None, rate: float | None = None
    ) -> None:
        e = self._e
        target = e._pen_target(u, v, w)
        e._to(target, rate if rate else e.feed_for(distance(e.position, target)))

    def arc(
        self, u: float, v: float, centre_u: float, centre_v: float, clockwise: bool, rate: float | None = None
    ) -> None:
        e = self._e
        target = e._pen_target(u, v, None)
        arc = arc_by_centre(e._plane(e.position), (u, v), (centre_u, centre_v), clockwise)
        e._arc(target, arc, rate if rate else e.feed_for(abs(arc.sweep) * arc.radius))

    def dwell(self, seconds: float) -> None:
        self._e.path.dwell(self._e._row(RAPID_FEED), seconds)

    def spindle(self, rpm: float) -> None:
        e = self._e
        e.direction = math.copysign(1.0, rpm) if rpm else 0.0
        if rpm:
            e.speed_word = abs(rpm)
        e.renew()
