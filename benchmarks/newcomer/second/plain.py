"""Laws outside the vocabulary that one line says: products and squares of what a recording holds.

In:  a world, an axis. Out: a `Law` of size one; `PLAIN` says on which axes. i is the axis, j the other one of the work
plane; x mm, v mm/s, a mm/s², F N, M N·m, MRR mm³/s, v_sp deg/s, c 0/1.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.newcomer.foreign import other_of
from benchmarks.newcomer.parts import Part
from benchmarks.newcomer.process import load
from benchmarks.newcomer.world import Columns, Concealed, Law, World, direction, number, per_part
from benchmarks.sealed_truth import require_fair
from pido.core.arrays import Float1D


def forward(world: World, axis: str, part: Part) -> Float1D:
    """(n,), –1 to 1: which way an axis moves."""
    k = number(axis)
    return direction(part.v[:, k], float(world.machine.sign_width[k]))


def around_mean(columns: Columns, where: Columns) -> list[Float1D]:
    """Less the mean of where something is not 0: a simulation that was fitted has that already."""
    here = np.concatenate(list(where)) != 0
    require_fair(bool(here.any()), "never there")
    mean = float(np.concatenate(list(columns))[here].mean())
    return [c - mean for c in columns]


def from_middle(world: World, k: int) -> list[Float1D]:
    """Per part (n,), mm: position of a linear axis from where it is on average."""
    columns = per_part(world, lambda p: p.pos[:, k])
    return around_mean(columns, [np.ones(len(c)) for c in columns])


def from_clamp(world: World, k: int) -> list[Float1D]:
    """Per part (n,), mm: position of a linear axis from where the workpiece is clamped."""
    return per_part(world, lambda p: p.pos[:, k] - p.centre[k])


def rubbing(world: World, axis: str, level: Columns) -> Law:
    """level · sgn(v_i), none on average over what is moved."""
    signs = per_part(world, lambda p: forward(world, axis, p))
    return Law([c * s for c, s in zip(around_mean(level, signs), signs, strict=True)])


def times(one: Columns, two: Columns) -> Law:
    return Law([a * b for a, b in zip(one, two, strict=True)])


def pumped_bellows(world: World, axis: str, rng: np.random.Generator) -> Law:
    """v_j²: air that leaves a cover when the other axis is fast, whichever way."""
    j = other_of(world, axis)
    return Law(per_part(world, lambda p: p.v[:, j] ** 2))


def kinetic_power(world: World, axis: str, rng: np.random.Generator) -> Law:
    """a_i · v_i: a bus that is full when an axis brakes and empty when it speeds up."""
    k = number(axis)
    return Law(per_part(world, lambda p: p.a[:, k] * p.v[:, k]))


def cutting_power(world: World, axis: str, rng: np.random.Generator) -> Law:
    """F_i · v_i."""
    k = number(axis)
    return Law(per_part(world, lambda p: load(p, axis) * p.v[:, k]))


def cross_slide(world: World, axis: str, rng: np.random.Generator) -> Law:
    """a_i · x_j: a beam whose mass, as one of its two drives feels it, depends on where the slide on it stands."""
    k = number(axis)
    return times(per_part(world, lambda p: p.a[:, k]), from_middle(world, other_of(world, axis)))


def racked_gantry(world: World, axis: str, rng: np.random.Generator) -> Law:
    """x_j · sgn(v_i): the further out the slide, the more the beam jams in its guides."""
    return rubbing(world, axis, per_part(world, lambda p: p.pos[:, other_of(world, axis)]))


def washed_guide(world: World, axis: str, rng: np.random.Generator) -> Law:
    """c · sgn(v_i): coolant washes oil off the guide, or chips."""
    return rubbing(world, axis, per_part(world, lambda p: p.coolant))


def tilting_table(world: World, axis: str, rng: np.random.Generator) -> Law:
    """F_j · x_i: a force of the cut with its lever."""
    j = "xyz"[other_of(world, axis)]
    return times(per_part(world, lambda p: load(p, j)), from_clamp(world, number(axis)))


def jerked_frame(world: World, axis: str, rng: np.random.Generator) -> Law:
    """da_j/dt."""
    j, machine = other_of(world, axis), world.machine
    require_fair(machine.jerk_s * machine.rate >= 3, "the log is too coarse for a jerk")
    return Law(per_part(world, lambda p: np.gradient(p.a[:, j], machine.dt)))


def tool_on_board(world: World, axis: str, rng: np.random.Generator) -> Law:
    """m_tool · a_i: the simulation has the mass of a mean tool."""
    k, cutters = number(axis), world.machine.cutters
    mass = {n: c.mass_kg for n, c in cutters.items()}
    a = per_part(world, lambda p: p.a[:, k])
    return times(around_mean(per_part(world, lambda p: np.array([mass[int(n)] for n in p.tool])), a), a)


def screw_that_brakes(world: World, axis: str, rng: np.random.Generator) -> Law:
    """|v_i| · tanh(a_i / a_0): a viscous loss that helps to brake and does not help to speed up."""
    k = number(axis)
    a = np.abs(np.concatenate([p.a[:, k] for p in world.parts]))
    a_0 = float(np.quantile(a[a > 1e-3], rng.uniform(0.3, 0.6))) if (a > 1e-3).any() else 1.0
    return Law(per_part(world, lambda p: np.abs(p.v[:, k]) * np.tanh(p.a[:, k] / a_0)))


def crossed_directions(world: World, axis: str, rng: np.random.Generator) -> Law:
    """sgn(v_i) · sgn(v_j): a guide that is worn along one diagonal."""
    j = "xyz"[other_of(world, axis)]
    return Law(per_part(world, lambda p: forward(world, axis, p) * forward(world, j, p)))


def long_quill(world: World, axis: str, rng: np.random.Generator) -> Law:
    """v_sp · x of the infeed: bearings that a quill loads the more the further it is out; set up for each workpiece."""
    return times(per_part(world, lambda p: p.v_sp), from_clamp(world, world.machine.kind.plane[2]))


def churned_coolant(world: World, axis: str, rng: np.random.Generator) -> Law:
    """c · (v_sp − mean): coolant through the spindle, beyond what it takes at the mean speed."""
    wet = per_part(world, lambda p: p.coolant)
    return times(around_mean(per_part(world, lambda p: p.v_sp), wet), wet)


def dry_cut(world: World, axis: str, rng: np.random.Generator) -> Law:
    """M · (mean − c): a cut that is not cooled sticks."""
    torque = per_part(world, lambda p: p.m)
    return times(around_mean(per_part(world, lambda p: -p.coolant), torque), torque)


PLAIN: Mapping[str, Concealed] = {
    **{
        f.__name__: Concealed(f, "plane", both_ways=True)
        for f in (
            pumped_bellows, kinetic_power, cutting_power, cross_slide, racked_gantry, tilting_table, jerked_frame,
            screw_that_brakes, crossed_directions,
        )
    },
    **{f.__name__: Concealed(f, "plane", facts=True, both_ways=True) for f in (washed_guide, tool_on_board)},
    long_quill.__name__: Concealed(long_quill, "sp", both_ways=True),
    **{f.__name__: Concealed(f, "sp", facts=True, both_ways=True) for f in (churned_coolant, dry_cut)},
}  # fmt: skip
