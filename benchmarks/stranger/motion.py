"""Programs and what a control makes of them: operations, NC blocks, set points.

In:  a plant, a generator, a duration. Out: a `Track`: per fine step position, spindle speed, programmed cut, NC block.

The control interpolates blocks at constant feed and rapids as trapezoids, and smooths the set points with two moving
averages: acceleration and jerk stay bounded and corners are rounded (FIR interpolation; Sencer, Ishizaki and Shamoto,
CIRP Annals 64 (2015)).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d

from benchmarks.stranger.machine import Plant
from pido.core.arrays import Array1D, Float1D, Float2D


@dataclass
class Track:
    """Set points, block by block.

    rows : per block (k, 3) mm; others per block: (k,) rpm, and scalars a_p mm, a_e mm, tool, coolant, drilling, number
    """

    plant: Plant
    at: Float1D
    rows: list[Float2D] = field(default_factory=list)
    rpm: list[Float1D] = field(default_factory=list)
    said: list[dict[str, float]] = field(default_factory=list)
    now: dict[str, float] = field(default_factory=dict)
    block: int = 10

    @property
    def seconds(self) -> float:
        return sum(map(len, self.rows)) * self.plant.dt

    def _put(self, rows: Float2D, rpm: Float1D, cutting: bool) -> None:
        self.rows.append(rows)
        self.rpm.append(rpm)
        cut = {name: self.now[name] * cutting for name in ("a_p", "a_e", "drill")}
        self.said.append({**cut, **{name: self.now[name] for name in ("tool", "coolant")}, "nc_line": self.block})
        self.block += 1
        self.at = rows[-1]

    def rapid(self, to: Float1D) -> None:
        """A trapezoid of speed along a straight line, from rest to rest."""
        plant, far = self.plant, float(np.linalg.norm(to - self.at))
        if far < 1e-6:
            return
        v = min(plant.rapid, np.sqrt(far * plant.a_max))
        ramp, whole = v / plant.a_max, far / v + v / plant.a_max
        t = np.arange(0.0, whole, plant.dt)
        s = np.where(t < ramp, 0.5 * plant.a_max * t**2, v * (t - ramp / 2))
        s = np.where(t > whole - ramp, far - 0.5 * plant.a_max * (whole - t) ** 2, s)
        rows = np.vstack([self.at + np.clip(s / far, 0, 1)[:, None] * (to - self.at), to])
        self._put(rows, np.full(len(rows), self.now["rpm"]), False)

    def feed(self, points: Float2D, cutting: bool = True) -> None:
        """Constant feed along a polyline."""
        path = np.vstack([self.at, points])
        s = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))]
        if s[-1] < 1e-6:
            return
        when = np.r_[np.arange(0.0, s[-1], self.now["feed"] * self.plant.dt), s[-1]]
        rows = np.column_stack([np.interp(when, s, path[:, k]) for k in range(3)])
        self._put(rows, np.full(len(rows), self.now["rpm"]), cutting)

    def dwell(self, seconds: float) -> None:
        n = max(1, int(seconds / self.plant.dt))
        self._put(np.tile(self.at, (n, 1)), np.full(n, self.now["rpm"]), False)

    def spin(self, rpm: float) -> None:
        """Ramp of the spindle while the axes wait."""
        n = int(abs(rpm - self.now["rpm"]) / self.plant.spindle_acc / self.plant.dt) + 2
        self._put(np.tile(self.at, (n, 1)), np.linspace(self.now["rpm"], rpm, n), False)
        self.now["rpm"] = rpm


def ride(plant: Plant, seconds: float, diagonal: bool, center: Float1D, rng: np.random.Generator) -> dict[str, Any]:
    """A program of operations, cut off after `seconds`.

    diagonal : all moves in the plane go along one diagonal, there and back: speeds of x and y are nearly collinear
    Returns rows (n, 3) mm as the control smooths them, rpm (n,), nc_line, tool, coolant, a_p, a_e, drill (n,), and
    `operations` (list of dicts).
    """
    away = np.array([0.1, 0.1, 0.0]) * (min(plant.travel[:2]) if diagonal else plant.travel)
    track = Track(plant, center + np.array([0.0, 0.0, 0.08 * plant.travel[2]]) - away)
    first = int(rng.choice(list(plant.tools)))
    track.now = {"rpm": 0.0, "feed": 1.0, "a_p": 0.0, "a_e": 0.0, "drill": 0.0, "tool": first, "coolant": 0.0}
    operations: list[dict[str, Any]] = []
    track.dwell(rng.uniform(0.5, 2.0))
    while track.seconds < seconds:
        name = "diagonal" if diagonal else str(rng.choice(list(PATTERNS)))
        operations.append(_prepare(track, name, rng))
        _cut(track, name, center, rng)
        if rng.random() < 0.3:
            track.dwell(rng.uniform(0.3, 1.5))
    n = int(seconds / plant.dt) // plant.fine * plant.fine
    lengths = [len(r) for r in track.rows]
    out = {name: np.repeat([s[name] for s in track.said], lengths)[:n] for name in track.said[0]}
    line = int(out["nc_line"][-1])
    return {
        "rows": _smoothed(plant, np.vstack(track.rows))[:n],  # first smoothed: the cut is no stop
        "rpm": np.concatenate(track.rpm)[:n],
        "operations": [o for o in operations if o["nc_line"] <= line],
        **out,
    }


def _smoothed(plant: Plant, rows: Float2D) -> Float2D:
    """(n, 3), mm: set points after the two moving averages."""
    for seconds in plant.box_s:
        size = max(1, int(seconds / plant.dt)) | 1
        rows = uniform_filter1d(rows, size, axis=0, mode="nearest")
    return rows


def _prepare(track: Track, name: str, rng: np.random.Generator) -> dict[str, Any]:
    """Tool, speed, feed and depths of the next operation; the spindle is stopped to change the tool."""
    plant, now = track.plant, track.now
    tool = int(rng.choice(list(plant.tools))) if rng.random() < 0.5 else int(now["tool"])
    if name == "drilling":
        tool = min(plant.tools, key=lambda n: plant.tools[n].diameter_mm)
    if tool != now["tool"] and now["rpm"] > 0:
        track.spin(0.0)
        track.dwell(rng.uniform(0.5, 1.5))
    cutter, D = plant.tools[tool], plant.tools[tool].diameter_mm
    rpm = float(rng.uniform(*plant.family.rpm))
    f_z = 0.02 * D**0.6 * rng.uniform(0.4, 1.4)  # mm per tooth, of catalogues
    feed = float(np.clip(f_z * cutter.teeth * rpm / 60.0, *plant.family.feed))
    now |= {"tool": tool, "feed": feed, "drill": float(name == "drilling"), "coolant": float(rng.random() < 0.55)}
    now |= {"a_p": min(np.sqrt(D) * rng.uniform(0.2, 0.9), 0.6 * D), "a_e": D * rng.uniform(0.12, 0.95)}
    if name == "drilling":
        now |= {"a_p": 0.5 * D, "a_e": D, "feed": min(feed, 0.01 * D * cutter.teeth * rpm / 60.0)}
    said = {"nc_line": track.block, "tool_id": tool, "feed_mm_s": now["feed"], "rpm": rpm}
    track.spin(rpm)
    return said | {"a_p": now["a_p"], "a_e": now["a_e"], "coolant": int(now["coolant"])}


def _cut(track: Track, name: str, center: Float1D, rng: np.random.Generator) -> None:
    """A pattern somewhere on the workpiece; a fifth of them in air."""
    plant, safe = track.plant, center[2] + 0.08 * track.plant.travel[2]
    length = track.now["feed"] * rng.uniform(4.0, 12.0)
    path = PATTERNS.get(name, _diagonal)(length, float(min(plant.travel[:2])) * 0.3, rng)
    away = rng.uniform(-0.12, 0.12, 2) * plant.travel[:2]
    place = center + np.r_[away[:1].repeat(2) if name == "diagonal" else away, 0.0]
    if name == "drilling":
        _drill(track, place + path, safe)
    else:
        _mill(track, place + path, safe, rng.random() < 0.8, rng)


def _mill(track: Track, points: Float2D, safe: float, cutting: bool, rng: np.random.Generator) -> None:
    over = points[0].copy()
    over[2] = safe
    track.rapid(np.r_[track.at[:2], safe])
    track.rapid(over)
    track.rapid(points[0] + np.array([0.0, 0.0, 0.02 * track.plant.travel[2]]))
    track.feed(points[:1], cutting=False)
    for block in np.array_split(points[1:], min(len(points) - 1, int(rng.integers(2, 7)))):
        track.feed(block, cutting)
    track.rapid(np.r_[track.at[:2], safe])


def _drill(track: Track, holes: Float2D, safe: float) -> None:
    for hole in holes:
        track.rapid(np.r_[hole[:2], safe])
        track.rapid(hole + np.array([0.0, 0.0, 1.0]))
        track.feed(hole[None] - [0.0, 0.0, 1.5 * track.plant.tools[int(track.now["tool"])].diameter_mm])
        track.rapid(np.r_[hole[:2], safe])


def _turned(x: Array1D, y: Array1D, angle: float, z: Float1D | float = 0.0) -> Float2D:
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([c * x - s * y, s * x + c * y, np.broadcast_to(z, len(x))])


def _zigzag(length: float, most: float, rng: np.random.Generator) -> Float2D:
    lines = int(rng.integers(3, 9))
    side = min(length / lines, most)
    x = np.tile([0.0, side, side, 0.0], lines)[: 2 * lines]
    y = np.repeat(np.arange(float(lines)), 2) * side * 0.06
    return _turned(x, y, rng.uniform(0, 2 * np.pi))


def _wave(length: float, most: float, rng: np.random.Generator) -> Float2D:
    """Lines over a surface: the tool axis goes up and down."""
    flat = _zigzag(length, most, rng)
    s = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(flat, axis=0), axis=1))]
    fine = np.linspace(0, s[-1], 240)
    x, y = (np.interp(fine, s, flat[:, k]) for k in (0, 1))
    cycles = float(rng.integers(3, 9))
    return np.column_stack([x, y, 0.12 * s[-1] / cycles * np.sin(2 * np.pi * cycles * fine / s[-1])])


def _contour(length: float, most: float, rng: np.random.Generator) -> Float2D:
    """A rounded rectangle (superellipse), once or twice around."""
    a, b = (min(length / 6, most) * rng.uniform(0.5, 1.0) for _ in range(2))
    t = np.linspace(0, 2 * np.pi * rng.integers(1, 3), 240) * rng.choice([-1, 1])
    power = rng.uniform(0.3, 0.9)
    x, y = (np.sign(f(t)) * np.abs(f(t)) ** power for f in (np.cos, np.sin))
    return _turned(a * x, b * y, rng.uniform(0, 2 * np.pi))


def _pocket(length: float, most: float, rng: np.random.Generator) -> Float2D:
    """A square spiral from inside out."""
    turns = int(rng.integers(2, 5))
    k = np.arange(1, 4 * turns + 1)
    steps = np.column_stack([np.cos(k * np.pi / 2), np.sin(k * np.pi / 2)]).round() * ((k + 1) // 2)[:, None]
    corners = np.cumsum(steps, axis=0) * min(length / (2 * k.sum() / 2), most / turns)
    return _turned(corners[:, 0], corners[:, 1], rng.uniform(0, 2 * np.pi))


def _trochoid(length: float, most: float, rng: np.random.Generator) -> Float2D:
    loops = int(rng.integers(5, 12))
    r = min(length / loops / 2 / np.pi, most / 4)
    t = np.linspace(0, 2 * np.pi * loops, 40 * loops)
    return _turned(r * np.cos(t) + 0.06 * r * t, r * np.sin(t), rng.uniform(0, 2 * np.pi))


def _circle(length: float, most: float, rng: np.random.Generator) -> Float2D:
    """There and back again: G2, then G3."""
    turns = rng.uniform(0.8, 2.5)
    r = min(length / (4 * np.pi * turns), most / 2)
    t = np.linspace(0, 2 * np.pi * turns, 120)
    t = np.r_[t, t[::-1]] + rng.uniform(0, 2 * np.pi)
    return np.column_stack([r * np.cos(t), r * np.sin(t), np.zeros(len(t))])


def _helix(length: float, most: float, rng: np.random.Generator) -> Float2D:
    r = min(length / 25, most / 3)
    t = np.linspace(0, 8 * np.pi, 200)
    return np.column_stack([r * np.cos(t), r * np.sin(t), -0.2 * r * t / np.pi])


def _drilling(length: float, most: float, rng: np.random.Generator) -> Float2D:
    n = int(rng.integers(3, 7))
    return np.column_stack([rng.uniform(-0.4, 0.4, (n, 2)) * min(length, most), np.zeros(n)])


def _diagonal(length: float, most: float, rng: np.random.Generator) -> Float2D:
    lines = int(rng.integers(3, 9))
    side = min(length / lines, most)
    angle = np.pi / 4 + rng.uniform(-0.05, 0.05, lines)
    ends = side * rng.uniform(0.6, 1.0, lines)
    points = np.column_stack([ends * np.cos(angle), ends * np.sin(angle), np.zeros(lines)])
    points[::2] *= -0.3
    return points


PATTERNS: dict[str, Callable[[float, float, np.random.Generator], Float2D]] = {
    "zigzag": _zigzag,
    "wave": _wave,
    "contour": _contour,
    "pocket": _pocket,
    "trochoid": _trochoid,
    "circle": _circle,
    "helix": _helix,
    "drilling": _drilling,
}
