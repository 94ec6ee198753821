"""Stock removal beside a height map in numpy and a voxel map, one core, alternately in one run, medians of five.

In:  nothing; a 10 mm end mill cuts 150 x 75 x 50 mm at 9.6 mm/s and 50 Hz, cell 0.1 mm: a slot along the rows
     of the grid; a pocket, lane beside lane at 30 degrees; rings, where no two steps have one direction.
Out: rows {work, peer, ratio, goal, error}: ratio is the peer's CPU time per step over ours; error the largest relative
     error of our removal rate in any step of the slot, against the closed form.

The peers do what is usual: at each step all cells under the tool's disc are lowered (numpy), or all voxels inside the
tool are cleared and counted (compiled). `python -m benchmarks.removal` prints the rows, and what a coarser grid costs.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

from pido.core.machining import Stock, Tool
from pido.process.height_map import block
from pido.process.removal import remove

STOCK = Stock((0.0, 0.0, -50.0), (150.0, 75.0, 0.0))
TOOL = Tool("end mill", 10.0, 4)
STEP_MM, DEPTH = 0.192, 6.0


QUICK = {"cell": 0.25, "repeats": 2}


def run(cell: float = 0.1, repeats: int = 5) -> list[dict[str, Any]]:
    """Every line of the table."""
    slot = _slot(60)
    peers: dict[str, tuple[Callable[[], float], float]] = {
        "numpy height map": (_numpy_map(cell, slot), 100.0),
        "voxels, compiled": (_voxels(cell, slot[:20]), 500.0),
    }
    paths = {"along the rows": _slot(700), "pocket at 30 degrees": _pocket(30.0), "rings": _rings()}
    ours = {name: _ours(cell, points) for name, points in paths.items()}
    ways = {**ours, **{name: peer for name, (peer, _) in peers.items()}}
    for way in ways.values():
        way()
    taken: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(repeats):
        for name, way in ways.items():
            taken[name].append(way())
    times = {name: statistics.median(values) for name, values in taken.items()}
    limits = {**{name: (times[name], goal) for name, (_, goal) in peers.items()}, "2 us per step": (2e-6, 1.0)}
    return [
        {
            "work": f"removal, {cell:g} mm, 20 ms steps, {path}, now {times[path] * 1e6:.2f} us per step",
            "peer": name,
            "ratio": seconds / times[path],
            "goal": goal,
            "error": _error(cell),
        }
        for path in ours
        for name, (seconds, goal) in limits.items()
    ]


def _slot(steps: int) -> np.ndarray:
    x = 8.0 + STEP_MM * np.arange(steps)
    return np.c_[x, np.full(steps, 37.03), np.full(steps, -DEPTH)]


def _pocket(degrees: float) -> np.ndarray:
    """40 x 40 mm to and fro, 8 mm from lane to lane, turned about the middle of the block."""
    lane, over = np.arange(-20.0, 20.0, STEP_MM), np.arange(0.0, 8.0, STEP_MM)
    ways = []
    for k in range(6):
        along = lane if k % 2 == 0 else -lane
        ways += [np.c_[along, np.full(len(along), 8.0 * k - 20.0)]]
        ways += [np.c_[np.full(len(over), along[-1]), 8.0 * k - 20.0 + over]] if k < 5 else []
    x, y = np.concatenate(ways).T
    a = np.radians(degrees)
    return _placed(np.c_[x * np.cos(a) - y * np.sin(a), x * np.sin(a) + y * np.cos(a)])


def _rings() -> np.ndarray:
    """From the middle outward, 8 mm from turn to turn, with steps of one length."""
    angle = np.linspace(0.0, 5.0 * np.pi, 100_000)
    points = np.c_[np.cos(angle), np.sin(angle)] * (angle * 8.0 / (2.0 * np.pi))[:, None]
    way = np.r_[0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T))]
    return _placed(points[np.searchsorted(way, np.arange(0.0, way[-1], STEP_MM))])


def _placed(points: np.ndarray) -> np.ndarray:
    return np.c_[points + np.array([75.0, 37.03]), np.full(len(points), -DEPTH)]


def _ours(cell: float, points: np.ndarray) -> Callable[[], float]:
    fresh, index = block(STOCK, cell), np.zeros(len(points), np.int64)

    def once() -> float:
        part = fresh.copy()
        begin = time.process_time()
        remove(part, points, index, (TOOL,))
        return (time.process_time() - begin) / len(points)

    return once


def _error(cell: float) -> float:
    """Largest relative error of a single step's volume once the tool is in full cut."""
    points = _slot(300)
    volume = remove(block(STOCK, cell), points, np.zeros(300, np.int64), (TOOL,)).volume[100:]
    return float(np.abs(volume / (TOOL.diameter_mm * DEPTH * STEP_MM) - 1).max())


def _numpy_map(cell: float, points: np.ndarray) -> Callable[[], float]:
    radius = TOOL.diameter_mm / 2
    x, y = (np.arange(n) * cell + cell / 2 for n in (round(150 / cell), round(75 / cell)))

    def once() -> float:
        heights = np.zeros((len(x), len(y)))
        begin = time.process_time()
        for u, v, w in points:
            i, j = (slice(int((c - radius) / cell), int((c + radius) / cell) + 2) for c in (u, v))
            window = heights[i, j]
            under = (x[i, None] - u) ** 2 + (y[None, j] - v) ** 2 <= radius**2
            removed = np.where(under, np.maximum(window - w, 0.0), 0.0)
            removed.sum()
            window -= removed
        return (time.process_time() - begin) / len(points)

    return once


def _voxels(cell: float, points: np.ndarray) -> Callable[[], float]:
    shape = (round(60 / cell), round(75 / cell), round(10 / cell))  # the part of the block that these steps reach
    local = (points - (0.0, 0.0, -10.0)) / cell

    def once() -> float:
        solid = np.ones(shape, np.uint8)
        begin = time.process_time()
        _clear(solid, local, TOOL.diameter_mm / 2 / cell)
        return (time.process_time() - begin) / len(points)

    return once


@njit(cache=True)
def _clear(solid, points, radius):
    removed = 0
    for n in range(len(points)):
        u, v, w = points[n]
        for i in range(max(int(u - radius), 0), min(int(u + radius) + 2, solid.shape[0])):
            for j in range(max(int(v - radius), 0), min(int(v + radius) + 2, solid.shape[1])):
                if (i + 0.5 - u) ** 2 + (j + 0.5 - v) ** 2 <= radius * radius:
                    for k in range(max(int(np.ceil(w - 0.5)), 0), solid.shape[2]):
                        removed += solid[i, j, k]
                        solid[i, j, k] = 0
    return removed


if __name__ == "__main__":
    for grid in (0.1, 0.25, 0.5):
        for row in run(cell=grid):
            told = f"{row['ratio']:>9.1f}x  (goal {row['goal']:g})  error {row['error']:.1e}"
            print(f"{row['work']:<48}{row['peer']:<20}{told}")
