"""What a case is, and how its currents come about.

    recorded = simulation + effects + noise, then rounded to the converter's steps

where a servo lag, if the plant has one, has passed over simulation and effects alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from benchmarks.sealed_truth import Case, Effect, NoiseRows, Task
from benchmarks.stranger.law import World
from benchmarks.stranger.machine import Plant
from benchmarks.stranger.parts import Part, term, thinned
from pido.core.arrays import Float1D
from pido.core.axes import AXES

NEEDS_FACTS = (
    "gravity_load", "edge_force", "tool_wear", "material_hard_zone", "thermal_drift", "sensor_offset", "coolant_load",
)  # fmt: skip
"""What cannot be told without part.json (tools, operations, workpiece, clock, vertical axis)."""


def simulated(part: Part, axis: str, terms: Mapping[str, float]) -> Float1D:
    """(n,), A: the simulation's current, before any lag."""
    width = 0.0 if axis == "sp" else float(part.plant.sign_width[AXES.index(axis)])
    return np.sum([k * term(part, axis, name, width) for name, k in terms.items()], axis=0) + np.zeros(len(part.t))


def lagged(plant: Plant, values: Float1D) -> Float1D:
    """(n,): behind the servo's first order lags, from rest in the first value."""
    for tau in plant.lag_s:
        keep = float(np.exp(-plant.dt / tau))
        values = lfilter([1 - keep], [1, -keep], values, zi=[keep * values[0]])[0]
    return values


@dataclass(frozen=True, eq=False)
class Noise(NoiseRows):
    """length : of autocorrelation, in samples"""

    length: float


def assemble(
    task: Task, world: World, effects: Sequence[Effect], noise: Mapping[str, Noise], rng: np.random.Generator
) -> Case:
    """Currents at the samples: behind the lag, with noise, rounded."""
    plant = world.parts[0].plant
    sim = {a: [lagged(plant, i)[:: plant.fine] for i in world.sim[a]] for a in AXES}
    effect = {a: [np.zeros(len(i)) for i in sim[a]] for a in AXES}
    for e in effects:
        effect[e.axis] = [
            had + lagged(plant, c)[:: plant.fine] for had, c in zip(effect[e.axis], e.columns, strict=True)
        ]
    recorded = {
        a: [np.round((s + e + n) / noise[a].step) * noise[a].step
            for s, e, n in zip(sim[a], effect[a], noise[a].rows, strict=True)]
        for a in AXES
    }  # fmt: skip
    rich, columns = facts(effects, rng)
    parts = [thinned(p) for p in world.parts]
    return Case(task, parts, sim, recorded, effect, effects, rich, columns, int(rng.integers(2**31)))


def facts(effects: Sequence[Effect], rng: np.random.Generator) -> tuple[bool, list[str]]:
    """(whether part.json is rich, optional columns): what an effect needs is there, the rest by chance."""
    needs = {str(e.shape.get("law", e.mechanism)) for e in effects}
    # a wrong weight, too, is told from an offset by knowing which axis is vertical
    rich = bool(needs & set(NEEDS_FACTS)) or rng.random() < 0.5
    by_chance = [name for name in ("nc_line", "tool_id", "coolant") if rng.random() < 0.5]
    return rich, ["nc_line", "tool_id", "coolant"] if rich else by_chance
