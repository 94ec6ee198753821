"""Laws outside the vocabulary with a shape of their own: resonances, waves, thresholds.

In:  a world, an axis. Out: a `Law` of size one; `SHAPED` says on which axes. i is the axis, j the other one of the work
plane.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.newcomer.foreign import other_of
from benchmarks.newcomer.second.plain import forward, from_clamp, rubbing, times
from benchmarks.newcomer.world import Concealed, Law, World, number, per_part
from benchmarks.sealed_truth import require_fair
from pido.core.arrays import Float1D


def amplified(r: Float1D, zeta: float) -> Float1D:
    """(n,), 0 to 1: amplitude of an oscillator at r times its natural frequency, in that of its resonance.

    >>> amplified(np.array([0.0, 1.0, 3.0]), 0.1).round(3).tolist()
    [0.2, 1.0, 0.025]
    """
    return 2 * zeta / np.sqrt((1 - r**2) ** 2 + (2 * zeta * r) ** 2)


def singing_spindle(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Resonance of v_sp: at one speed of the spindle the whole table shakes, and the axis holds it."""
    turns = np.concatenate([p.v_sp for p in world.parts])
    turns = turns[turns > 0.02 * turns.max()]
    v_r, zeta = float(np.quantile(turns, rng.uniform(0.2, 0.8))), float(rng.uniform(0.02, 0.06))
    return Law(per_part(world, lambda p: amplified(p.v_sp / v_r, zeta) ** 2))


def humming_screw(world: World, axis: str, rng: np.random.Generator) -> Law:
    """sgn(v_i) · resonance of v_i: at one speed the balls or the teeth pass in time with the frame."""
    k = number(axis)
    speed = np.abs(np.concatenate([p.v[:, k] for p in world.parts]))
    moving = speed[speed > 0.02 * speed.max()]
    require_fair(len(moving) > 100, "hardly moves")
    v_r, zeta = float(np.quantile(moving, rng.uniform(0.3, 0.9))), float(rng.uniform(0.03, 0.08))
    return times(
        per_part(world, lambda p: forward(world, axis, p)),
        per_part(world, lambda p: amplified(np.abs(p.v[:, k]) / v_r, zeta) ** 2),
    )


def crossed_belt(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A wave of x_i + x_j or of their difference: one belt around both axes, whose pulley does not run true."""
    k, j, sense = number(axis), other_of(world, axis), float(rng.choice([-1.0, 1.0]))
    way = per_part(world, lambda p: p.pos[:, k] + sense * p.pos[:, j])
    fast = np.abs(np.concatenate([p.v[:, k] + sense * p.v[:, j] for p in world.parts]))
    wave = max(float(np.std(np.concatenate(way)) * rng.uniform(0.25, 0.7)),
               10 * float(np.quantile(fast, 0.95)) / world.machine.rate)  # fmt: skip
    phase = float(rng.uniform(0, 2 * np.pi))
    return Law([np.sin(2 * np.pi * s / wave + phase) for s in way])


def taut_cable(world: World, axis: str, rng: np.random.Generator) -> Law:
    """max(r − r_0, 0) · x_i / r: a cable that hangs slack over the fixture, and further out is a spring."""
    x, y = from_clamp(world, number(axis)), from_clamp(world, other_of(world, axis))
    far = [np.hypot(a, b) for a, b in zip(x, y, strict=True)]
    r_0 = float(np.quantile(np.concatenate(far), rng.uniform(0.5, 0.75)))
    return times([np.maximum(r - r_0, 0) / np.maximum(r, 1e-9) for r in far], x)


def lifting_film(world: World, axis: str, rng: np.random.Generator) -> Law:
    """sgn(v_i) / (1 + (v_j / v_0)²), none on average: the other axis drags oil into a guide that both share."""
    j = other_of(world, axis)
    speed = np.abs(np.concatenate([p.v[:, j] for p in world.parts]))
    require_fair(bool((speed > 1e-3).any()), "the other axis does not move")
    v_0 = float(np.quantile(speed[speed > 1e-3], rng.uniform(0.2, 0.5)))
    return rubbing(world, axis, per_part(world, lambda p: 1 / (1 + (p.v[:, j] / v_0) ** 2)))


SHAPED: Mapping[str, Concealed] = {
    f.__name__: Concealed(f, "plane", both_ways=True)
    for f in (singing_spindle, humming_screw, crossed_belt, taut_cable, lifting_film)
}
