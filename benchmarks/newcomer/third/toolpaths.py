"""Part programs that neither of the other editions has, in the same frame.

In:  a path so far, the size of a workpiece, a machine, a random generator. Out: the path has the steps of one kind of
work more.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.newcomer.machines import Machine
from benchmarks.newcomer.toolpaths import SAFE, Job, Path, down, flat, forth_and_back, go, turned
from pido.core.arrays import Float1D, Float2D

STOP = 0.05
"""s: what an exact stop takes at a sharp corner."""


def _arc(n: int, begin: float, end: float) -> Float2D:
    """(n, 2): points of the unit circle. begin, end : rad"""
    phi = np.linspace(begin, end, n)
    return np.column_stack([np.cos(phi), np.sin(phi)])


def _peel(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """A slot by half moons: round the front while cutting, straight back in a hurry."""
    op, moons = path.operations[-1], int(rng.integers(4, 9))
    radius, angle = float(rng.uniform(0.07, 0.14)) * float(size.min()), float(rng.uniform(0, np.pi))
    aside, step = float(rng.uniform(-0.2, 0.2)) * float(size.min()), 0.6 * float(size.min()) / moons
    front = radius * _arc(16, -np.pi / 2, np.pi / 2)
    for k in range(moons):
        points = turned(front + np.array([step * (k - moons / 2), aside]), angle)
        if k == 0:
            go(path, points[0], size, machine)
            down(path, -op.a_p, op.feed_mm_s)
        path.to([*points[0], -op.a_p], 3 * op.feed_mm_s, rest=STOP)
        path.to([*points[1], -op.a_p], op.feed_mm_s, cut=True, rest=STOP)
        path.follow(flat(points[2:], -op.a_p), op.feed_mm_s)


def _thread(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Threads milled from the bottom up: half a turn in, a few turns of small pitch, half a turn out to the middle."""
    op, turns = path.operations[-1], float(rng.uniform(1.5, 3.5))
    radius, pitch = float(rng.uniform(0.06, 0.15)) * float(size.min()), float(rng.uniform(0.3, 1.0)) * op.a_p
    around = radius * _arc(int(36 * turns), 0, 2 * np.pi * turns)
    lead_in = 0.5 * radius * (_arc(12, np.pi, 2 * np.pi) + np.array([1, 0]))
    for _ in range(int(rng.integers(2, 4))):
        middle = rng.uniform(-0.3, 0.3, 2) * size
        go(path, middle, size, machine)
        deep = -(turns + 1) * pitch
        path.to([*middle, deep], 4 * op.feed_mm_s)
        path.follow(flat(middle + lead_in[1:], deep), 0.5 * op.feed_mm_s)
        path.follow(np.column_stack([middle + around, deep + pitch * np.linspace(0, turns, len(around))]), op.feed_mm_s)
        path.to([*middle, deep + pitch * turns], 2 * op.feed_mm_s)


def _adaptive(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Offsets of a blob from one side to the other, the feed up where there is little to cut and down in the bays."""
    op, lobes = path.operations[-1], int(rng.integers(2, 5))
    phi = np.linspace(-0.45 * np.pi, 0.45 * np.pi, 40) + float(rng.uniform(0, 2 * np.pi))
    bays = np.cos(lobes * phi)
    for k, share in enumerate(np.linspace(0.3, 1.0, int(rng.integers(4, 8)))):
        r = 0.42 * share * float(size.min()) * (1 + 0.2 * bays)
        line = np.column_stack([r * np.cos(phi), r * np.sin(phi)])
        if k == 0:
            go(path, line[0], size, machine)
            down(path, -op.a_p, op.feed_mm_s)
        path.to([*line[0], -op.a_p + 0.1 * op.a_p], 3 * op.feed_mm_s, rest=STOP)
        for n, (point, bay) in enumerate(zip(line, bays, strict=True)):
            feed = op.feed_mm_s * (1.0 + 0.6 * float(bay))
            path.to([*point, -op.a_p], feed, cut=True, rest=STOP if n == 0 else 0.0)


def _raster(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Point after point of a grid, with a stop at each of them; sometimes a long one."""
    op, columns = path.operations[-1], int(rng.integers(3, 6))
    span, long = rng.uniform(0.3, 0.6, 2) * size, float(rng.uniform(0.3, 1.5))
    go(path, -0.5 * span, size, machine)
    down(path, -op.a_p, op.feed_mm_s)
    for k, v in enumerate(np.linspace(-0.5, 0.5, 3)):
        for u in np.linspace(-0.5, 0.5, columns)[:: 1 if k % 2 == 0 else -1]:
            wait = long * float(rng.choice([1.0, 1.0, 1.0, 4.0]))
            path.to([u * span[0], v * span[1], -op.a_p], op.feed_mm_s, cut=True, rest=wait)


def _zigzag(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Pockets in lines side by side, from level to level down a slope."""
    op, lines = path.operations[-1], int(rng.integers(4, 8))
    angle, middle = float(rng.choice([0.0, np.pi / 2, rng.uniform(0, np.pi)])), rng.uniform(-0.15, 0.15, 2) * size
    half = rng.uniform(0.15, 0.3, 2) * float(size.min())
    ends = [turned(np.array([[(-1) ** k * half[0], v], [-((-1) ** k) * half[0], v]]), angle) + middle
            for k, v in enumerate(np.linspace(-half[1], half[1], lines))]  # fmt: skip
    go(path, ends[0][0], size, machine)
    down(path, 0.2, 3 * op.feed_mm_s)
    for level in range(int(rng.integers(1, 3))):
        path.to([*ends[0][1], -(level + 0.5) * op.a_p], 0.6 * op.feed_mm_s, cut=True)
        path.to([*ends[0][0], -(level + 1) * op.a_p], 0.6 * op.feed_mm_s, cut=True)
        for begin, end in ends:
            path.to([*begin, -(level + 1) * op.a_p], 0.7 * op.feed_mm_s, cut=True)
            path.to([*end, -(level + 1) * op.a_p], op.feed_mm_s, cut=True)
        path.to([*ends[-1][1], 0.2], 4 * op.feed_mm_s)
        path.to([*ends[0][0], 0.2], 4 * op.feed_mm_s)


def _dome(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Over a dome along its meridians, in blocks of a fraction of a millimetre, up one side and down the other."""
    op, r = path.operations[-1], float(rng.uniform(0.2, 0.36)) * float(size.min())
    high, n = min(0.5 * r, 0.5 * SAFE * float(size.max())), 120
    along, lines = np.linspace(-1, 1, n), []
    for angle in np.linspace(0, np.pi, int(rng.integers(4, 8)), endpoint=False):
        meridian = turned(np.column_stack([r * along, 0 * along]), angle)
        lines.append(np.column_stack([meridian, high * (-(along**2)) - op.a_p]))
    forth_and_back(path, lines, size, machine)


def _touch(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Measuring: the height at a few points, then a bore from its middle to its four walls, each touched twice."""
    op, high = path.operations[-1], 0.5 * SAFE * float(size.max())
    slow, wait = 0.3 * op.feed_mm_s, float(rng.choice([0.2, 0.6, 1.5]))
    for place in rng.uniform(-0.35, 0.35, (int(rng.integers(2, 4)), 2)) * size:
        go(path, place, size, machine)
        path.to([*place, min(0.3 * high, 2 * op.feed_mm_s)], 3 * op.feed_mm_s)
        path.to([*place, 0.0], slow, rest=0.1)
        path.to([*place, high], 4 * op.feed_mm_s, rest=wait)
    middle = rng.uniform(-0.2, 0.2, 2) * size
    reach = min(3 * op.feed_mm_s, 0.15 * float(size.min()))
    go(path, middle, size, machine)
    path.to([*middle, -0.2 * high], 2 * op.feed_mm_s)
    for heading in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        wall = middle + reach * np.array(heading)
        path.to([*wall, -0.2 * high], op.feed_mm_s)
        path.to([*(0.7 * wall + 0.3 * middle), -0.2 * high], 2 * op.feed_mm_s, rest=STOP)
        path.to([*wall, -0.2 * high], slow, rest=0.1)
        path.to([*middle, -0.2 * high], 3 * op.feed_mm_s, rest=wait)


def _peck(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Holes on a circle, the chips broken by short lifts, a rest at the bottom."""
    op, holes = path.operations[-1], int(rng.integers(4, 8))
    deep = float(np.clip(op.feed_mm_s * rng.uniform(2, 6), 1.0, 0.2 * size.min()))
    pecks, radius = int(rng.integers(2, 6)), float(rng.uniform(0.2, 0.4)) * float(size.min())
    for place in radius * _arc(holes + 1, 0, 2 * np.pi)[:-1]:
        go(path, place, size, machine)
        path.to([*place, 0.4], 0.5 * float(machine.v_max.min()))
        for k in range(pecks):
            path.to([*place, -deep * (k + 1) / pecks], op.feed_mm_s, cut=True)
            path.to([*place, -deep * (k + 0.6) / pecks], op.feed_mm_s * 4, rest=0.1)
        path.to([*place, -deep], op.feed_mm_s, cut=True)
        path.to([*place, 0.4], op.feed_mm_s * 6, rest=float(rng.choice([0.2, 0.8])))


def _bevel(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """The edge of a polygon of any angles, each side sloping up or down: all axes at changing shares of the feed."""
    op, corners = path.operations[-1], int(rng.integers(3, 8))
    angles = np.sort(rng.uniform(0, 2 * np.pi, corners)) + float(rng.uniform(0, 2 * np.pi))
    r = rng.uniform(0.2, 0.42, corners) * float(size.min())
    outline = np.column_stack([r * np.cos(angles), r * np.sin(angles)])
    deep = -op.a_p * rng.uniform(0.3, 3.0, corners)
    go(path, outline[0], size, machine)
    down(path, float(deep[0]), op.feed_mm_s)
    for _ in range(int(rng.integers(1, 3))):
        for k in [*range(1, corners), 0]:
            path.to([*outline[k], deep[k]], op.feed_mm_s * float(rng.choice([1.0, 0.5])), cut=True)


def _rosette(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """One line of many petals about a middle, as ornaments are cut."""
    op, petals = path.operations[-1], int(rng.integers(3, 8))
    phi = np.linspace(0, 2 * np.pi, 36 * petals)
    r = 0.4 * float(size.min()) * np.cos(petals * phi / 2) ** 2 + 0.04 * float(size.min())
    line = turned(np.column_stack([r * np.cos(phi), r * np.sin(phi)]), float(rng.uniform(0, np.pi)))
    go(path, line[0], size, machine)
    down(path, -op.a_p, op.feed_mm_s)
    path.follow(np.column_stack([line, -op.a_p * (1 + 0.4 * np.sin(petals * phi))]), op.feed_mm_s)


JOBS: Mapping[str, Job] = {
    "peel": _peel, "thread": _thread, "adaptive": _adaptive, "raster": _raster, "zigzag": _zigzag, "dome": _dome,
    "touch": _touch, "peck": _peck, "bevel": _bevel, "rosette": _rosette,
}  # fmt: skip
