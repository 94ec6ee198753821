"""The region that a law is confined to: a box of (v_x, v_y, AR).

In:  parts at the fine step, a random generator. Out: per part which samples lie inside, and what a truth says of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.newcomer.parts import Part
from benchmarks.sealed_truth import require_fair
from pido.core.arrays import Bool1D

Inside = tuple[list[Bool1D], Mapping[str, object]]
"""(per part (n,), whether a sample is inside; what a truth says of it)."""

Region = Callable[[Sequence[Part], np.random.Generator], Inside]
"""(parts, rng) -> what is inside."""


def draw_box(parts: Sequence[Part], rng: np.random.Generator) -> Inside:
    """One to three sides, each an interval between quantiles of where there is motion, or removal."""
    space = {"v_x": [p.v[:, 0] for p in parts], "v_y": [p.v[:, 1] for p in parts], "AR": [p.area for p in parts]}
    sides = list(rng.permutation(list(space)))[: int(rng.choice([1, 2, 2, 3]))]
    box = {}
    for name in sides:
        x = np.concatenate(space[name])
        x = x[x > 0] if name == "AR" else x[np.abs(x) > 1e-3]
        require_fair(len(x) > 100, f"{name} is hardly driven")
        wide = float(rng.uniform(0.25, 0.6))
        low = float(rng.uniform(0.0, 1 - wide))
        box[name] = (float(np.quantile(x, low)), float(np.quantile(x, low + wide)))
    inside = [
        np.all([(space[n][k] >= low) & (space[n][k] < high) for n, (low, high) in box.items()], axis=0)
        for k in range(len(parts))
    ]
    return inside, {"box": box}
