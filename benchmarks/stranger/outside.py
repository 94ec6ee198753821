"""Effects that no mechanism of the vocabulary says.

In and out as in `effects`: a world, an axis, a generator; a `Law` without comparable parameters.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.stranger.law import Draw, Law, World
from benchmarks.stranger.parts import Part
from pido.core.arrays import Float1D
from pido.core.axes import AXES, LINEAR_AXES


def _hum(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Balls and guideway hum at one speed of the axis: drag around it, not below and not above."""
    size = np.abs(np.concatenate([p.speed(axis) for p in world.shown]))
    at = float(np.quantile(size[size > 0], rng.uniform(0.4, 0.7)))
    width = 0.35 * at
    return Law(
        world.each(lambda p: np.exp(-(((np.abs(p.speed(axis)) - at) / width) ** 2)) * np.sign(p.speed(axis))),
        shape={"at_mm_s": at},
    )


def _resonance(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Losses around one spindle speed: a Lorentz line."""
    turning = np.concatenate([p.v_sp[p.v_sp > 0] for p in world.shown])
    at, width = float(np.quantile(turning, rng.uniform(0.3, 0.7))), float(0.1 * np.ptp(turning))
    return Law(world.each(lambda p: 1 / (1 + ((p.v_sp - at) / width) ** 2)), shape={"at_deg_s": at})


def _spring(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A hose or a gas spring pulls back, the more the farther, whatever the direction of motion."""
    i = AXES.index(axis)
    pos = np.concatenate([p.pos[:, i] for p in world.shown])
    rest, reach, power = float(np.quantile(pos, rng.uniform(0.1, 0.9))), float(np.ptp(pos)), int(rng.integers(1, 3))

    def pull(p: Part) -> Float1D:
        x = (p.pos[:, i] - rest) / reach
        return x * np.abs(x) ** (power - 1)

    return Law(world.each(pull), shape={"power": power})


def _gyroscopic(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A load by the product of two other speeds."""
    j, k = (n for n, name in enumerate(LINEAR_AXES) if name != axis)
    return Law(world.each(lambda p: p.v[:, j] * p.v[:, k]))


def _field_weakening(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Beyond the base speed torque costs more current."""
    base = float(np.quantile(np.concatenate([p.v_sp[p.engaged] for p in world.shown]), rng.uniform(0.3, 0.6)))
    return Law(world.each(lambda p: p.m * np.maximum(p.v_sp / base - 1, 0.0)), shape={"base_deg_s": base})


def _motoring(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A screw that does not give back: losses only while the drive speeds the axis up."""
    i = AXES.index(axis)
    return Law(world.each(lambda p: p.a[:, i] * (p.a[:, i] * p.v[:, i] > 0)))


def _racking(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A bridge that twists: drag by where the carriage stands on the other axis."""
    i = AXES.index(axis)
    j = 1 - i if i < 2 else int(rng.integers(2))
    pos = np.concatenate([p.pos[:, j] for p in world.shown])
    middle, reach = float(np.median(pos)), float(np.ptp(pos))
    return Law(world.each(lambda p: (p.pos[:, j] - middle) / reach * p.v[:, i]), shape={"of": LINEAR_AXES[j]})


OUTSIDE: Mapping[str, tuple[Draw, tuple[str, ...]]] = {
    "hum": (_hum, LINEAR_AXES),
    "resonance": (_resonance, ("sp", "x", "y")),
    "spring": (_spring, ("x", "y")),
    "gyroscopic": (_gyroscopic, LINEAR_AXES),
    "field_weakening": (_field_weakening, ("sp",)),
    "motoring": (_motoring, LINEAR_AXES),
    "racking": (_racking, LINEAR_AXES),
}
"""Name (of the truth's shape only) -> law, and the axes that it may act on."""
