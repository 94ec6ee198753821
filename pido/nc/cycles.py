"""Drilling patterns, drilling and pocket cycles, as moves in the working plane.

In:  a cycle's arguments (None where one was left out) and a `Pen` that draws in plane coordinates: u, v in the plane,
     w along the tool.
Out: rapids, feeds and circles through the pen.
Source: SINUMERIK 840D sl "Cycles", classic parameter lists. Where the manual leaves the path of a pocket to the
control, it is rings from the middle outwards at the given infeeds: the removed volume is the pocket's, the order ours.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

Arguments = tuple[Any, ...]


class Pen(Protocol):
    """What a cycle may do. Positions in mm, feeds in mm/s (None: the feed that holds)."""

    @property
    def feed_mm_s(self) -> float: ...
    @property
    def rpm(self) -> float: ...
    @property
    def tool_radius_mm(self) -> float | None: ...
    @property
    def position(self) -> tuple[float, float, float]: ...
    def rapid(self, u: float | None = None, v: float | None = None, w: float | None = None) -> None: ...
    def feed(
        self, u: float | None = None, v: float | None = None, w: float | None = None, rate: float | None = None
    ) -> None: ...
    def arc(
        self, u: float, v: float, centre_u: float, centre_v: float, clockwise: bool, rate: float | None = None
    ) -> None: ...
    def dwell(self, seconds: float) -> None: ...
    def spindle(self, rpm: float) -> None: ...


@dataclass(frozen=True, slots=True)
class Cycle:
    """`run(pen, arguments)`; `at_point`: drills where the tool stands, so it may follow MCALL and hole patterns."""

    parameters: tuple[str, ...]
    run: Callable[[Pen, dict[str, Any]], None]
    at_point: bool = True


def _depth(a: dict[str, Any]) -> float:
    """Final depth: DP absolute, or DPR below the reference plane."""
    if a["DP"] is not None:
        return float(a["DP"])
    if a["DPR"] is not None:
        down = 1.0 if a["RTP"] is None or a["RTP"] >= a["RFP"] else -1.0
        return a["RFP"] - down * abs(a["DPR"])
    raise ValueError("neither DP (absolute) nor DPR (relative) says how deep")


def _levels(a: dict[str, Any]) -> tuple[float, float, float, float]:
    """Retract plane, plane of safe approach, reference plane and depth."""
    for name in ("RTP", "RFP"):
        if a[name] is None:
            raise ValueError(f"parameter {name} is missing")
    depth = _depth(a)
    down = math.copysign(1.0, a["RFP"] - depth) if depth != a["RFP"] else 1.0
    return float(a["RTP"]), a["RFP"] + down * abs(a["SDIS"] or 0.0), float(a["RFP"]), depth


def _drill(pen: Pen, a: dict[str, Any]) -> None:
    """CYCLE81, 82: down at feed, wait, up at rapid."""
    retract, safe, _, depth = _levels(a)
    pen.rapid(w=safe)
    pen.feed(w=depth)
    if a.get("DTB"):
        pen.dwell(_seconds(pen, a["DTB"]))
    pen.rapid(w=retract)


def _deep(pen: Pen, a: dict[str, Any]) -> None:
    """CYCLE83: in steps; VARI 0 breaks chips (1 mm back), 1 leaves the hole to clear them."""
    retract, safe, reference, depth = _levels(a)
    down = math.copysign(1.0, reference - depth)
    first = a["FDEP"] if a["FDEP"] is not None else None
    step = abs(reference - first) if first is not None else abs(a["FDPR"] or 0.0)
    step = step or abs(reference - depth)
    less, rate = a["DAM"] or 0.0, pen.feed_mm_s * (a["FRF"] or 1.0)
    pen.rapid(w=safe)
    reached = reference
    while (reached - depth) * down > 1e-9:
        reached = depth if (reached - depth) * down <= step else reached - down * step
        pen.feed(w=reached, rate=rate)
        rate = pen.feed_mm_s
        if a["DTB"]:
            pen.dwell(_seconds(pen, a["DTB"]))
        if reached == depth:
            break
        if a["VARI"]:
            pen.rapid(w=safe)
            if a["DTS"]:
                pen.dwell(_seconds(pen, a["DTS"]))
            pen.rapid(w=reached + down * min(a.get("DIS1") or abs(a["SDIS"] or 0.0), step / 2))
        else:
            pen.rapid(w=reached + down * min(a.get("VRT") or 1.0, step / 2))
        if less > 0:
            step = max(step - less, a.get("MDEP") or less)
        elif less < 0:
            step = max(step * abs(less), a.get("MDEP") or 0.1)
    pen.rapid(w=retract)


def _tap(pen: Pen, a: dict[str, Any]) -> None:
    """CYCLE84, 840: down and up at speed times pitch, the spindle reversed for the way up."""
    retract, safe, _, depth = _levels(a)
    pitch = abs(a["PIT"] or _coarse_pitch(a["MPIT"]))
    rpm = a.get("SST") or abs(pen.rpm)
    back = a.get("SST1") or rpm
    if not rpm:
        raise ValueError("tapping needs a spindle speed: SST in the cycle, or S before it")
    left = (a["PIT"] or a["MPIT"] or 1) < 0
    turning = pen.rpm
    pen.rapid(w=safe)
    pen.spindle(-rpm if left else rpm)
    pen.feed(w=depth, rate=rpm * pitch / 60)
    if a["DTB"]:
        pen.dwell(abs(a["DTB"]))
    pen.spindle(back if left else -back)
    pen.feed(w=safe, rate=back * pitch / 60)
    pen.spindle(turning)
    pen.rapid(w=retract)


def _coarse_pitch(size: float | None) -> float:
    """Metric coarse pitch (ISO 261) of M3..M48."""
    table = {3: 0.5, 4: 0.7, 5: 0.8, 6: 1.0, 8: 1.25, 10: 1.5, 12: 1.75, 14: 2.0, 16: 2.0, 18: 2.5, 20: 2.5, 22: 2.5}
    table |= {24: 3.0, 27: 3.0, 30: 3.5, 33: 3.5, 36: 4.0, 39: 4.0, 42: 4.5, 45: 4.5, 48: 5.0}
    pitch = table.get(abs(int(size or 0)))
    if pitch is None:
        raise ValueError("the pitch is missing: PIT in mm, or MPIT as a metric size from 3 to 48")
    return pitch


def _ream(pen: Pen, a: dict[str, Any]) -> None:
    """CYCLE85: down at FFR, up at RFF; CYCLE89: down, wait, up at feed."""
    retract, safe, _, depth = _levels(a)
    pen.rapid(w=safe)
    pen.feed(w=depth, rate=_per_second(a.get("FFR")))
    if a["DTB"]:
        pen.dwell(_seconds(pen, a["DTB"]))
    pen.feed(w=safe, rate=_per_second(a.get("RFF")))
    pen.rapid(w=retract)


def _bore(pen: Pen, a: dict[str, Any]) -> None:
    """CYCLE86: down at feed, spindle stopped, lifted off by RPA, RPO, RPAP, up at rapid."""
    retract, safe, _, depth = _levels(a)
    turning = pen.rpm
    pen.rapid(w=safe)
    pen.feed(w=depth)
    if a["DTB"]:
        pen.dwell(_seconds(pen, a["DTB"]))
    pen.spindle(0.0)
    u, v, w = pen.position
    pen.rapid(u=u + (a.get("RPA") or 0.0), v=v + (a.get("RPO") or 0.0), w=w + (a.get("RPAP") or 0.0))
    pen.rapid(w=retract)
    pen.rapid(u=u, v=v)
    pen.spindle(turning)


def _seconds(pen: Pen, dwell: float) -> float:
    """Dwell of a cycle: positive seconds, negative spindle revolutions."""
    return dwell if dwell >= 0 else -dwell * 60.0 / max(abs(pen.rpm), 1e-9)


def _per_second(mm_per_min: float | None) -> float | None:
    return mm_per_min / 60.0 if mm_per_min else None


def row_of_holes(a: dict[str, Any]) -> list[tuple[float, float]]:
    """HOLES1: NUM holes at distance DBH on a line at angle STA1, the first FDIS from the reference point."""
    angle = math.radians(a["STA1"] or 0.0)
    along = [(a["FDIS"] or 0.0) + i * a["DBH"] for i in range(int(a["NUM"]))]
    return [(a["SPCA"] + d * math.cos(angle), a["SPCO"] + d * math.sin(angle)) for d in along]


def circle_of_holes(a: dict[str, Any]) -> list[tuple[float, float]]:
    """HOLES2: NUM holes on a circle, from angle STA1 in steps of INDA (0: evenly around)."""
    step = a["INDA"] or 360.0 / a["NUM"]
    angles = [math.radians((a["STA1"] or 0.0) + i * step) for i in range(int(a["NUM"]))]
    return [(a["CPA"] + a["RAD"] * math.cos(t), a["CPO"] + a["RAD"] * math.sin(t)) for t in angles]


def _rectangle(pen: Pen, a: dict[str, Any]) -> None:
    """POCKET3: rectangle LENG x WID with corner radius CRAD, turned by STA about its middle (PA, PO)."""
    half_length, half_width = a["LENG"] / 2, a["WID"] / 2
    angle = math.radians(a["STA"] or 0.0)
    cos, sin = math.cos(angle), math.sin(angle)

    def place(u: float, v: float) -> tuple[float, float]:
        return a["PA"] + u * cos - v * sin, a["PO"] + u * sin + v * cos

    def ring(inset: float, rate: float | None, clockwise: bool) -> None:
        length, width = max(half_length - inset, 0.0), max(half_width - inset, 0.0)
        r = min(max((a["CRAD"] or 0.0) - inset, 0.0), length, width)
        corners = [(length, width), (-length, width), (-length, -width), (length, -width)]  # counter-clockwise
        if clockwise:
            corners = [(u, -v) for u, v in corners]
        turns = [
            ((0, -1), (-1, 0)),
            ((1, 0), (0, -1)),
            ((0, 1), (1, 0)),
            ((-1, 0), (0, 1)),
        ]  # back along in, on along out
        pen.feed(*place(length, 0.0), rate=rate)
        for (u, v), ((bu, bv), (fu, fv)) in zip(corners, turns, strict=True):
            if clockwise:
                bv, fv = -bv, -fv
            pen.feed(*place(u + r * bu, v + r * bv), rate=rate)
            if r > 1e-9:
                middle = place(u + r * (bu + fu), v + r * (bv + fv))
                pen.arc(*place(u + r * fu, v + r * fv), *middle, clockwise=clockwise, rate=rate)
        pen.feed(*place(length, 0.0), rate=rate)

    _pocket(pen, a, min(half_length, half_width), ring)


def _round(pen: Pen, a: dict[str, Any]) -> None:
    """POCKET4: circle of radius PRAD about (PA, PO)."""

    def ring(inset: float, rate: float | None, clockwise: bool) -> None:
        r = a["PRAD"] - inset
        if r > 1e-9:
            pen.feed(a["PA"] + r, a["PO"], rate=rate)
            pen.arc(a["PA"] + r, a["PO"], a["PA"], a["PO"], clockwise=clockwise, rate=rate)

    _pocket(pen, a, a["PRAD"], ring)


def _pocket(pen: Pen, a: dict[str, Any], half: float, ring: Callable[[float, float | None, bool], None]) -> None:
    """Rings from the middle outwards at each infeed, then the finishing cut on the wall (VARI 1 rough, 2 finish)."""
    radius = pen.tool_radius_mm
    if radius is None:
        raise ValueError("a pocket needs the tool's radius: give the tool in the list of tools")
    if radius > half:
        raise ValueError(f"the tool (radius {radius:g} mm) does not fit into the pocket (half width {half:g} mm)")
    variant = int(a["VARI"] or 1)
    if variant // 10 % 10:
        raise ValueError("only vertical insertion (VARI 1 or 2) is understood; helix and oscillation are not")
    retract, safe, reference, depth = _levels(a)
    down = math.copysign(1.0, reference - depth)
    wall, floor = a["FAL"] or 0.0, a["FALD"] or 0.0
    finish = variant % 10 == 2
    bottom = depth if finish else depth + down * floor
    deepest = a["MID"] or abs(reference - bottom)
    passes = max(1, math.ceil(abs(reference - bottom) / deepest - 1e-9))
    outer = radius if finish else radius + wall
    stepover = a["MIDA"] or 0.8 * 2 * radius
    if stepover > 2 * radius:
        raise ValueError(f"infeed in the plane MIDA = {stepover:g} mm is wider than the tool")
    clockwise = int(a["CDIR"] or 0) in ((1, 2) if (pen.rpm >= 0) else (0, 2))
    if int(a["CDIR"] or 0) == 3:
        clockwise = False
    rings = max(1, math.ceil((half - outer) / stepover - 1e-9))
    insets = [half - (half - outer) * i / rings for i in range(rings + 1)]  # the first one is the line in the middle
    if finish and wall and not floor:
        insets = [outer]
    plane_rate, depth_rate = _per_second(a["FFP1"]), _per_second(a["FFD"])
    pen.rapid(w=max(retract, pen.position[2]) if down > 0 else min(retract, pen.position[2]))
    for i in range(passes):
        pen.rapid(u=a["PA"], v=a["PO"])
        pen.rapid(w=safe if i == 0 else reference + (bottom - reference) * i / passes)
        pen.feed(w=reference + (bottom - reference) * (i + 1) / passes, rate=depth_rate or plane_rate)
        for inset in insets:
            ring(inset, plane_rate, clockwise)
        pen.feed(a["PA"], a["PO"], rate=plane_rate)
        pen.rapid(w=safe)
    pen.rapid(w=retract)


_PLANES = ("RTP", "RFP", "SDIS", "DP")
_DRILL = (*_PLANES, "DPR", "DTB")
_MODES = ("GMODE", "DMODE", "AMODE")  # how the control shows the numbers; GMODE other than 0 means them differently
_POCKET_END = ("MID", "FAL", "FALD", "FFP1", "FFD", "CDIR", "VARI", "MIDA", "AP1", "AP2", "AD", "RAD1", "DP1")
_DEEP_END = ("AXN", "MDEP", "VRT", "DTD", "DIS1", *_MODES)
CYCLES: dict[str, Cycle] = {
    "CYCLE81": Cycle((*_DRILL, *_MODES), _drill),
    "CYCLE82": Cycle((*_DRILL, *_MODES), _drill),
    "CYCLE83": Cycle((*_PLANES, "DPR", "FDEP", "FDPR", "DAM", "DTB", "DTS", "FRF", "VARI", *_DEEP_END), _deep),
    "CYCLE84": Cycle((*_DRILL, "SDAC", "MPIT", "PIT", "POSS", "SST", "SST1"), _tap),
    "CYCLE840": Cycle((*_DRILL, "SDR", "SDAC", "ENC", "MPIT", "PIT"), _tap),
    "CYCLE85": Cycle((*_DRILL, "FFR", "RFF"), _ream),
    "CYCLE86": Cycle((*_DRILL, "SDIR", "RPA", "RPO", "RPAP", "POSS"), _bore),
    "CYCLE87": Cycle((*_PLANES, "DPR", "DTB"), _bore),
    "CYCLE88": Cycle((*_DRILL, "SDIR"), _bore),
    "CYCLE89": Cycle(_DRILL, _ream),
    "POCKET3": Cycle((*_PLANES, "LENG", "WID", "CRAD", "PA", "PO", "STA", *_POCKET_END), _rectangle, at_point=False),
    "POCKET4": Cycle((*_PLANES, "PRAD", "PA", "PO", *[p for p in _POCKET_END if p != "AP2"]), _round, at_point=False),
    "HOLES1": Cycle(("SPCA", "SPCO", "STA1", "FDIS", "DBH", "NUM"), lambda pen, a: None, at_point=False),
    "HOLES2": Cycle(("CPA", "CPO", "RAD", "STA1", "INDA", "NUM"), lambda pen, a: None, at_point=False),
}
PATTERNS: dict[str, Callable[[dict[str, Any]], list[tuple[float, float]]]] = {
    "HOLES1": row_of_holes,
    "HOLES2": circle_of_holes,
}


def arguments(name: str, values: Arguments) -> dict[str, Any]:
    """The values by parameter name; parameters left out are None.

    Raises ValueError where there are more values than parameters, or where a pocket or pattern lacks one.
    """
    cycle = CYCLES[name]
    if len(values) > len(cycle.parameters) and any(v is not None for v in values[len(cycle.parameters) :]):
        raise ValueError(f"{name} has {len(cycle.parameters)} parameters here, {len(values)} were given")
    named = dict.fromkeys(cycle.parameters) | dict(zip(cycle.parameters, values, strict=False))
    if "DP" in named:
        named.setdefault("DPR", None)
    needed = {
        "POCKET3": ("LENG", "WID", "PA", "PO"),
        "POCKET4": ("PRAD", "PA", "PO"),
        "HOLES1": ("SPCA", "SPCO", "DBH", "NUM"),
    }
    needed["HOLES2"] = ("CPA", "CPO", "RAD", "NUM")
    if named.get("GMODE"):
        raise ValueError(f"{name}: only depth at the tool's tip (GMODE 0) is understood")
    missing = [p for p in needed.get(name, ()) if named[p] is None]
    if missing:
        raise ValueError(f"{name}: {', '.join(missing)} missing")
    return named
