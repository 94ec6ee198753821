"""Part programs that the first edition does not have, in the same frame.

In:  a path so far, the size of a workpiece, a machine, a random generator. Out: the path has the steps of one kind of
work more.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.newcomer.machines import Machine
from benchmarks.newcomer.toolpaths import SAFE, Job, Path, down, flat, go, turned
from pido.core.arrays import Float1D, Float2D


def _round(n: int, turns: float, sense: float) -> Float2D:
    """(n, 2): points of turns around the unit circle."""
    phi = 2 * np.pi * turns * np.linspace(0, 1, n)
    return np.column_stack([np.cos(phi), sense * np.sin(phi)])


def _spiral(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Round and round from the middle outwards: every direction, slowly changing."""
    op, turns = path.operations[-1], float(rng.uniform(2.5, 5))
    n = int(40 * turns)
    wide = np.linspace(0.06, 1.0, n)[:, None] * rng.uniform(0.25, 0.42, 2) * size
    points = wide * _round(n, turns, 1.0 if op.down else -1.0) + rng.uniform(-0.08, 0.08, 2) * size
    go(path, points[0], size, machine)
    down(path, -op.a_p, op.feed_mm_s)
    path.follow(flat(points, -op.a_p), op.feed_mm_s)


def _trochoid(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """A slot by loops that move on: cutting on the front of each loop, faster around its back."""
    op, loops = path.operations[-1], int(rng.integers(5, 10))
    radius, angle = float(rng.uniform(0.05, 0.1)) * float(size.min()), float(rng.uniform(0, np.pi))
    step, loop = 0.7 * float(size.min()) / loops, radius * _round(25, 1.0, 1.0)
    middles = np.column_stack([step * (np.arange(loops) - loops / 2), np.full(loops, rng.uniform(-0.2, 0.2) * size[1])])
    go(path, turned(middles[:1] + loop[:1], angle)[0], size, machine)
    down(path, -op.a_p, op.feed_mm_s)
    for middle in middles:
        points = flat(turned(middle + loop, angle), -op.a_p)
        path.follow(points[:13], 1.6 * op.feed_mm_s, cut=False)
        path.follow(points[12:], op.feed_mm_s)


def _helix(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Bores that a smaller cutter winds itself down into: all three axes at once."""
    op = path.operations[-1]
    for _ in range(int(rng.integers(2, 4))):
        turns, radius = int(rng.integers(2, 5)), float(rng.uniform(0.08, 0.2)) * float(size.min())
        points = radius * _round(32 * turns, turns, 1.0) + rng.uniform(-0.25, 0.25, 2) * size
        go(path, points[0], size, machine)
        down(path, 0.3, 3 * op.feed_mm_s)
        deep = np.linspace(0.3, -min(turns * op.a_p, 0.2 * float(size.min())), len(points))
        path.follow(np.column_stack([points, deep]), op.feed_mm_s)


def _ramp(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """To and fro along one flank, deeper and deeper on the way, then along the bottom."""
    op, angle = path.operations[-1], float(rng.choice([0.0, np.pi / 2, rng.uniform(0, np.pi)]))
    long, aside = float(rng.uniform(0.25, 0.4)) * float(size.min()), float(rng.uniform(-0.25, 0.25)) * float(size.min())
    ends = turned(np.array([[-long, aside], [long, aside]]), angle)
    go(path, ends[0], size, machine)
    down(path, 0.2, 3 * op.feed_mm_s)
    passes = int(rng.integers(3, 7))
    for k in range(passes):
        path.to([*ends[(k + 1) % 2], -op.a_p * (k + 1) / passes], op.feed_mm_s, cut=True)
    for k in (passes, passes + 1):
        path.to([*ends[(k + 1) % 2], -op.a_p], op.feed_mm_s, cut=True)


def _edges(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Around the workpiece along its four edges, one way and then the other."""
    op, half = path.operations[-1], float(rng.uniform(0.38, 0.46)) * size
    corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]], float)
    go(path, corners[0], size, machine)
    down(path, -op.a_p, op.feed_mm_s)
    for way in (corners, corners[::-1])[: int(rng.integers(1, 3))]:
        for corner in way:
            path.to([*corner, -op.a_p], op.feed_mm_s, cut=True, rest=float(rng.choice([0.0, 0.0, 0.25])))


def _probe(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """A touch probe: fast to the place, slowly to the wall, back in a hurry, once more slower."""
    op = path.operations[-1]
    for angle in rng.permutation(np.arange(0, 2 * np.pi, np.pi / 3))[: int(rng.integers(3, 6))]:
        heading, reach = np.array([np.cos(angle), np.sin(angle)]), op.feed_mm_s * float(rng.uniform(1.0, 2.5))
        go(path, 0.3 * size * heading, size, machine)
        down(path, 0.3 * SAFE * float(size.max()), 4 * op.feed_mm_s)
        here = path.points[-1].copy()
        wall = here + np.r_[min(reach, 0.15 * float(size.min())) * heading, 0.0]
        path.to(wall, op.feed_mm_s)
        path.to(here, 4 * op.feed_mm_s, rest=0.2)
        path.to(0.3 * here + 0.7 * wall, 4 * op.feed_mm_s)
        path.to(wall, 0.3 * op.feed_mm_s)
        path.to(here, 4 * op.feed_mm_s, rest=float(rng.choice([0.1, 0.5])))


def _terraces(path: Path, size: Float1D, machine: Machine, rng: np.random.Generator) -> None:
    """Short steps along x and y in turn, up a staircase and down again, at changing depths."""
    op, steps = path.operations[-1], int(rng.integers(5, 10))
    at = np.array([-0.35, -0.3]) * size
    go(path, at, size, machine)
    down(path, -op.a_p, op.feed_mm_s)
    for k in range(2 * steps):
        forth = 1.0 if k < steps else -1.0
        at = at + forth * np.array([0.7, 0.0] if k % 2 == 0 else [0.0, 0.6]) * size / steps * 1.6
        path.to([*np.clip(at, -0.45 * size, 0.45 * size), -op.a_p * (1 + k % 3) / 3], op.feed_mm_s, cut=True)


JOBS: Mapping[str, Job] = {
    "spiral": _spiral, "trochoid": _trochoid, "helix": _helix, "ramp": _ramp, "edges": _edges, "probe": _probe,
    "terraces": _terraces,
}  # fmt: skip
