"""Toolpaths in a workpiece's own frame: points in the work plane and along the infeed, each with a feed.

In:  a path so far, the size of a workpiece, a machine, a random generator. Out: the path has the steps of one kind of
work more. The frame: two directions of the work plane from the workpiece's middle, the third up from its top, mm.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.newcomer.machines import Machine
from pido.core.arrays import Float1D, Float2D

Job = Callable[["Path", Float1D, Machine, np.random.Generator], None]
"""Adds its steps to a path, on a workpiece of a size."""

SAFE = 0.06
"""Height of links above the workpiece, in its size."""


@dataclass(frozen=True)
class Operation:
    """cutter : number of the tool; a_p, a_e : mm; drill : whether the infeed cuts; down : down milling"""

    cutter: int
    feed_mm_s: float
    rpm: float
    a_p: float
    a_e: float
    coolant: bool
    drill: bool
    down: bool


@dataclass
class Path:
    """points : corners; per step to the next corner its feed (mm/s), whether it cuts (0 or 1), its operation and the
    rest before it (s)
    """

    points: list[Float1D]
    feeds: list[float] = field(default_factory=list)
    cuts: list[float] = field(default_factory=list)
    of: list[int] = field(default_factory=list)
    rests: list[float] = field(default_factory=list)
    operations: list[Operation] = field(default_factory=list)

    def to(self, point: object, feed: float, cut: bool = False, rest: float = 0.0) -> None:
        """A straight step."""
        target = np.asarray(point, float)
        if np.abs(target - self.points[-1]).max() < 1e-6:
            return
        self.points.append(target)
        self.feeds.append(feed)
        self.cuts.append(float(cut))
        self.of.append(len(self.operations) - 1)
        self.rests.append(rest)

    def follow(self, points: Float2D, feed: float, cut: bool = True) -> None:
        for p in points:
            self.to(p, feed, cut)

    def seconds(self) -> float:
        """About how long it takes, a little too short."""
        steps = np.linalg.norm(np.diff(np.array(self.points), axis=0), axis=1)
        return float(np.sum(steps / np.array(self.feeds)) + sum(self.rests))


def go(path: Path, plane: object, size: Float1D, machine: Machine) -> None:
    """Up to the safe height and over to a point of the plane, in rapid."""
    rapid, high = 0.9 * float(machine.v_max.min()), SAFE * float(size.max())
    here = path.points[-1]
    path.to([here[0], here[1], high], rapid)
    path.to([*np.asarray(plane, float)[:2], high], rapid)


def down(path: Path, w: float, feed: float) -> None:
    here = path.points[-1]
    path.to([here[0], here[1], w], max(feed * 0.5, 0.05))


def turned(points: Float2D, angle: float) -> Float2D:
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


def flat(points: Float2D, w: float) -> Float2D:
    return np.column_stack([points, np.full(len(points), w)])


def _face(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Passes side by side, there and back or always the same way."""
    op = path.operations[-1]
    angle = float(rng.choice([0.0, np.pi / 2, rng.uniform(0, np.pi)]))
    long, step = 0.9 * float(size.min()), max(op.a_e, 0.04 * float(size.min()))
    one_way = rng.random() < 0.4
    for k in range(int(rng.integers(4, 8))):
        ends = np.array([[-0.55 * long, (k - 3) * step], [0.55 * long, (k - 3) * step]])
        ends = turned(ends if one_way or k % 2 == 0 else ends[::-1], angle)
        if k == 0 or one_way:
            go(path, ends[0], size, machine)
            down(path, -op.a_p, op.feed_mm_s)
        path.to([*ends[0], -op.a_p], op.feed_mm_s)
        path.to([*ends[1], -op.a_p], op.feed_mm_s, cut=True)


def _pocket(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Rectangular rings from inside to outside, their corners rounded."""
    op = path.operations[-1]
    centre, half = rng.uniform(-0.2, 0.2, 2) * size, rng.uniform(0.15, 0.28, 2) * size
    angle = float(rng.choice([0.0, rng.uniform(0, np.pi)]))
    go(path, centre, size, machine)
    down(path, -op.a_p, op.feed_mm_s)
    phi = np.linspace(0, 2 * np.pi, 72)
    for share in np.linspace(0.25, 1.0, int(rng.integers(3, 6))):
        around = np.column_stack([np.cos(phi), np.sin(phi)])
        rounded = np.sign(around) * np.abs(around) ** 0.35
        path.follow(flat(centre + turned(share * half * rounded, angle), -op.a_p), op.feed_mm_s)


def _contour(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """A closed outline with lobes, at one or two depths; sometimes there is air before the cut."""
    op = path.operations[-1]
    lobes, depth = int(rng.integers(2, 6)), float(rng.uniform(0.05, 0.3))
    phi = np.linspace(0, 2 * np.pi, 160) * (1 if op.down else -1) + float(rng.uniform(0, 6))
    r = 0.4 * float(size.min()) * (1 + depth * np.cos(lobes * phi)) / (1 + depth)
    outline = np.column_stack([r * np.cos(phi), r * np.sin(phi) * size[1] / size.max()])
    go(path, outline[0], size, machine)
    for k in range(int(rng.integers(1, 3))):
        down(path, -(k + 1) * op.a_p, op.feed_mm_s)
        path.follow(flat(outline, -(k + 1) * op.a_p), op.feed_mm_s)


def _air(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """A polygon above the workpiece, with resting points."""
    op, high = path.operations[-1], SAFE * float(size.max())
    for corner in rng.uniform(-0.5, 0.5, (int(rng.integers(4, 9)), 2)) * size:
        path.to([*corner, high * rng.uniform(0.4, 1.0)], op.feed_mm_s * 1.5, rest=float(rng.choice([0.0, 0.4])))


def _drill(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Holes on a grid, with pecks."""
    op = path.operations[-1]
    deep = float(np.clip(op.feed_mm_s * rng.uniform(2, 5), 1.0, 0.2 * size.min()))
    n = int(rng.integers(2, 4))
    for u in np.linspace(-0.35, 0.35, n):
        for v in np.linspace(-0.3, 0.3, 2):
            go(path, [u * size[0], v * size[1]], size, machine)
            here = path.points[-1][:2]
            path.to([*here, 0.3], 0.5 * float(machine.v_max.min()))
            pecks = int(rng.integers(1, 4))
            for k in range(pecks):
                path.to([*here, -deep * k / pecks], op.feed_mm_s * 3)
                path.to([*here, -deep * (k + 1) / pecks], op.feed_mm_s, cut=True)
                path.to([*here, 0.3], op.feed_mm_s * 5, rest=float(rng.choice([0.0, 0.15])))


def _engrave(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Short slow strokes, curved at random."""
    op = path.operations[-1]
    long = float(np.clip(op.feed_mm_s * rng.uniform(1.5, 4), 1.0, 0.3 * size.min()))
    for _ in range(int(rng.integers(4, 8))):
        start, bend = rng.uniform(-0.35, 0.35, 2) * size, float(rng.uniform(-4, 4))
        heading = rng.uniform(0, 2 * np.pi) + bend * np.linspace(0, 1, 30)
        stroke = start + long / 30 * np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
        go(path, stroke[0], size, machine)
        down(path, -op.a_p, op.feed_mm_s)
        path.follow(flat(stroke, -op.a_p), op.feed_mm_s)


def _creep(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Axis after axis forth and back, slow and slower, with rests: what setting up and probing looks like."""
    op = path.operations[-1]
    go(path, rng.uniform(-0.3, 0.3, 2) * size, size, machine)
    here = path.points[-1].copy()
    for axis in rng.permutation(3):
        for _ in range(int(rng.integers(1, 4))):
            feed = op.feed_mm_s * float(rng.choice([1.0, 0.4, 2.5]))
            away = here.copy()
            away[axis] += feed * rng.uniform(0.8, 3.0) * rng.choice([-1.0, 1.0])
            path.to(away, feed, rest=float(rng.uniform(0.2, 1.2)))
            path.to(here, feed * float(rng.choice([1.0, 1.0, 2.0])), rest=float(rng.choice([0.0, 0.5])))


def _freeform(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Lines over a wavy surface."""
    op = path.operations[-1]
    high = float(min(0.05 * size.min(), 0.3 * SAFE * size.max()))
    waves, angle = rng.uniform(1, 3, 2), float(rng.choice([0.0, np.pi / 2, rng.uniform(0, np.pi)]))
    u, lines = np.linspace(-0.4, 0.4, 60), []
    for v in np.linspace(-0.25, 0.25, int(rng.integers(4, 7))):
        w = -op.a_p - high * (1 + np.sin(2 * np.pi * waves[0] * u) * np.cos(2 * np.pi * waves[1] * v))
        lines.append(np.column_stack([turned(np.column_stack([u, np.full(60, v)]) * size.min(), angle), w]))
    forth_and_back(path, lines, size, machine)


def forth_and_back(path: Path, lines: Sequence[Float2D], size: Float1D, machine: Machine) -> None:
    """Lines (n, 3), every other one backwards, fed one after the other without lifting."""
    op = path.operations[-1]
    for k, line in enumerate(lines):
        line = line if k % 2 == 0 else line[::-1]
        if k == 0:
            go(path, line[0], size, machine)
            down(path, float(line[0, 2]), op.feed_mm_s)
        path.follow(line, op.feed_mm_s)


def _lines(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Forth and back along one slanting line and no other."""
    op, high = path.operations[-1], SAFE * float(size.max())
    for k in range(int(rng.integers(3, 6))):
        along = rng.uniform(0.15, 0.45) * (1 if k % 2 == 0 else -1)
        path.to([along * size[0], along * size[1], high], op.feed_mm_s * 2, rest=float(rng.choice([0.0, 0.3])))
        down(path, -op.a_p, op.feed_mm_s)
        path.to([-0.8 * along * size[0], -0.8 * along * size[1], -op.a_p], op.feed_mm_s, cut=True)
        path.to([-0.8 * along * size[0], -0.8 * along * size[1], high], op.feed_mm_s * 3)


JOBS: Mapping[str, Job] = {
    "face": _face, "pocket": _pocket, "contour": _contour, "air": _air, "drill": _drill, "engrave": _engrave,
    "creep": _creep, "freeform": _freeform, "lines": _lines,
}  # fmt: skip
