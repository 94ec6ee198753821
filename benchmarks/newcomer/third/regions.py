"""Where a law is confined to: regions of other shapes than a box of (v_x, v_y, AR).

In:  parts at the fine step, a random generator. Out: per part which samples lie inside, and what a truth says of it.
Limits are quantiles of where there is motion. mm, mm/s, mm², deg/s, rad.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.newcomer.boxes import Inside
from benchmarks.newcomer.parts import Part
from benchmarks.sealed_truth import require_fair
from pido.core.arrays import Bool1D, Float1D


def draw_region(parts: Sequence[Part], rng: np.random.Generator) -> Inside:
    """One of `SHAPES`."""
    name = str(rng.choice(list(SHAPES)))
    inside, said = SHAPES[name](parts, rng)
    return inside, {"region": name, "limits": said}


def _between(columns: Sequence[Float1D], share: tuple[float, float], rng: np.random.Generator) -> Inside:
    """An interval of a quantity, closed to both sides or open to one. share : of what is not 0, least and most"""
    x = np.concatenate(list(columns))
    x = x[np.abs(x) > 1e-3]
    require_fair(len(x) > 100, "hardly driven")
    wide, way = float(rng.uniform(*share)), str(rng.choice(["below", "above", "between"]))
    first = {"below": 0.0, "above": 1 - wide, "between": float(rng.uniform(0.1, 0.9 - wide))}[way]
    low = -np.inf if way == "below" else float(np.quantile(x, first))
    high = np.inf if way == "above" else float(np.quantile(x, first + wide))
    said = {n: q for n, q in (("low", low), ("high", high)) if np.isfinite(q)}
    # a law that is confined to slow motion does not hold at rest
    return [(c >= low) & (c < high) & (np.abs(c) > 1e-3) for c in columns], said


def _both_ways(parts: Sequence[Part], rng: np.random.Generator) -> Inside:
    """An interval of |v| of x or y: two strips, one for each way."""
    k = int(rng.integers(2))
    inside, said = _between([np.abs(p.v[:, k]) for p in parts], (0.15, 0.4), rng)
    return inside, {f"|v_{'xy'[k]}|": said}


def _path_speed(parts: Sequence[Part], rng: np.random.Generator) -> Inside:
    """A ring of (v_x, v_y, v_z)."""
    inside, said = _between([p.speed for p in parts], (0.12, 0.35), rng)
    return inside, {"speed": said}


def _area(parts: Sequence[Part], rng: np.random.Generator) -> Inside:
    """A layer of AR, often open upwards."""
    inside, said = _between([p.area for p in parts], (0.2, 0.6), rng)
    return inside, {"AR": said}


def _heading(parts: Sequence[Part], rng: np.random.Generator) -> Inside:
    """A wedge of directions in the plane of v_x and v_y."""
    middle, half = float(rng.uniform(-np.pi, np.pi)), float(rng.uniform(0.2, 0.8))

    def of(p: Part) -> Bool1D:
        turn = np.angle(np.exp(1j * (np.arctan2(p.v[:, 1], p.v[:, 0]) - middle)))
        return (np.abs(turn) < half) & (np.hypot(p.v[:, 0], p.v[:, 1]) > 1e-3)

    return [of(p) for p in parts], {"heading": {"low": middle - half, "high": middle + half}}


def _ellipse(parts: Sequence[Part], rng: np.random.Generator) -> Inside:
    """An ellipse of (v_x, v_y) about a motion that occurs."""
    v = np.concatenate([p.v[:, :2] for p in parts])
    v = v[np.linalg.norm(v, axis=1) > 1e-3]
    require_fair(len(v) > 100, "hardly driven")
    middle, half = v[int(rng.integers(len(v)))], np.std(v, axis=0) * rng.uniform(0.3, 1.0, 2) + 1e-6
    inside = [(((p.v[:, :2] - middle) / half) ** 2).sum(axis=1) < 1 for p in parts]
    return [i & (p.speed > 1e-3) for i, p in zip(inside, parts, strict=True)], {
        "middle": middle.tolist(), "half": half.tolist(),
    }  # fmt: skip


def _two_boxes(parts: Sequence[Part], rng: np.random.Generator) -> Inside:
    """Two boxes of (v_x, v_y) that share a law, as where two tables were joined."""
    v = [np.concatenate([p.v[:, k] for p in parts]) for k in range(2)]
    v = [x[np.abs(x) > 1e-3] for x in v]
    require_fair(min(map(len, v)) > 100, "hardly driven")
    inside, said = [np.zeros(len(p.t), bool) for p in parts], []
    for low in (float(rng.uniform(0, 0.3)), float(rng.uniform(0.5, 0.7))):
        sides = [
            [float(q) for q in np.quantile(x, [a, a + 0.3])] for x, a in zip(v, (low, rng.uniform(0, 0.7)), strict=True)
        ]
        said.append({"v_x": sides[0], "v_y": sides[1]})
        inside = [
            i | np.all([(p.v[:, k] >= lo) & (p.v[:, k] < hi) for k, (lo, hi) in enumerate(sides)], axis=0)
            for i, p in zip(inside, parts, strict=True)
        ]
    return inside, {"boxes": said}


def _corner(parts: Sequence[Part], rng: np.random.Generator) -> Inside:
    """One-sided in two of the quantities at once: beyond a speed of x or y and beyond an AR."""
    k, sign = int(rng.integers(2)), float(rng.choice([-1.0, 1.0]))
    v, area = (np.concatenate(c) for c in ([sign * p.v[:, k] for p in parts], [p.area for p in parts]))
    require_fair(bool((v > 1e-3).sum() > 100 and (area > 0).sum() > 100), "hardly driven")
    v_0, a_0 = (
        float(np.quantile(v[v > 1e-3], rng.uniform(0.1, 0.5))),
        float(np.quantile(area[area > 0], rng.uniform(0.1, 0.5))),
    )
    inside = [(sign * p.v[:, k] >= v_0) & (p.area >= a_0) for p in parts]
    return inside, {f"{'' if sign > 0 else '-'}v_{'xy'[k]}": {"low": v_0}, "AR": {"low": a_0}}


SHAPES: Mapping[str, Callable[[Sequence[Part], np.random.Generator], Inside]] = {
    "both ways": _both_ways, "path speed": _path_speed, "area": _area, "heading": _heading, "ellipse": _ellipse,
    "two boxes": _two_boxes, "corner": _corner,
}  # fmt: skip
