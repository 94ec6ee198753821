"""Laws of the cut, of the spindle and of what is slow or electrical, each from the sentence of `mechanisms.md`.

In:  a world, an axis. Out: a `Law` of size one. On the spindle a force is the cutting torque.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from benchmarks.newcomer.parts import Part
from benchmarks.newcomer.world import Law, World, number, per_part
from pido.core.arrays import Float1D


def load(part: Part, axis: str) -> Float1D:
    """(n,): true process force on an axis in N as the columns count it, or the spindle's torque in N·m."""
    return part.m if axis == "sp" else part.machine.force_sign * part.f[:, number(axis)]


def cutting(world: World, axis: str, rng: np.random.Generator) -> Law:
    return Law(per_part(world, lambda p: load(p, axis)), {"k": (1.0, "A/N")})


def edge(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Ploughing, against the feed: by the engaged length alone."""
    if axis == "sp":
        return Law(per_part(world, lambda p: p.edge))
    k = number(axis)
    return Law(per_part(world, lambda p: p.edge * p.v[:, k] / np.maximum(p.speed, 1e-6)))


def wear(world: World, axis: str, rng: np.random.Generator) -> Law:
    """The load once more for every so much that this edge has cut, from what it had cut before the part."""
    by, dt = int(rng.random() < 0.3), world.machine.dt
    unit = (2.0e4, 500.0)[by]

    def worn(part: Part) -> Float1D:
        rate = part.mrr if by == 0 else part.engaged.astype(float)
        cut = np.zeros(len(part.t))
        for n, before in part.worn.items():
            here = part.tool == n
            cut[here] = before[by] + np.cumsum(rate[here]) * dt
        return cut / unit

    return Law(per_part(world, lambda p: load(p, axis) * worn(p)), shape={"by": ("volume", "time")[by]})


def hard_zone(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A disc or a strip of the workpiece, the same in every part, with a soft rim."""
    plane = list(world.machine.kind.plane[:2])
    size = world.parts[0].size
    middle, radius = rng.uniform(-0.2, 0.2, 2) * size, float(rng.uniform(0.15, 0.3)) * float(size.min())
    strip, heading = bool(rng.random() < 0.4), float(rng.uniform(0, np.pi))

    def inside(part: Part) -> Float1D:
        at = part.pos[:, plane] - part.centre[plane] - middle
        far = np.abs(at @ [np.cos(heading), np.sin(heading)]) if strip else np.linalg.norm(at, axis=1)
        return np.clip((radius - far) / (0.1 * radius) + 0.5, 0, 1)

    return Law(per_part(world, lambda p: load(p, axis) * inside(p)), shape={"strip": strip})


def coolant(world: World, axis: str, rng: np.random.Generator) -> Law:
    """There while the coolant is on; the pump needs a moment."""
    keep = float(np.exp(-world.machine.dt / rng.uniform(0.02, 0.4)))
    columns = per_part(world, lambda p: np.asarray(lfilter([1 - keep], [1, -keep], p.coolant)))
    return Law(columns, {"k": (1.0, "A")})


def drag(world: World, axis: str, rng: np.random.Generator) -> Law:
    return Law(per_part(world, lambda p: p.v_sp), {"k": (1.0, "A·s/deg")})


def windage(world: World, axis: str, rng: np.random.Generator) -> Law:
    return Law(per_part(world, lambda p: p.v_sp * np.abs(p.v_sp)), {"k": (1.0, "A·s²/deg²")})


def rotor(world: World, axis: str, rng: np.random.Generator) -> Law:
    return Law(per_part(world, lambda p: p.a_sp), {"J": (1.0, "A·s²/deg")})


def torque(world: World, axis: str, rng: np.random.Generator) -> Law:
    return Law(per_part(world, lambda p: np.where(p.engaged, p.m, 0.0)), {"k": (1.0, "A/(N·m)")})


def warming(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A load that a cold machine has and a warm one has not, or the other way round; it cools in the pauses."""
    parts, dt = world.parts, world.machine.dt
    whole = parts[-1].start + len(parts[-1].t) * dt
    tau = float(np.clip(whole * rng.uniform(0.12, 0.5), 40.0, 900.0))
    fades = bool(rng.random() < 0.6)
    warm, end, columns = 0.0, 0.0, []
    for p in parts:
        warm *= np.exp(-(p.start - end) / tau)
        level = 1 - (1 - warm) * np.exp(-p.t / tau)
        columns.append(1 - level if fades else level)
        warm, end = float(level[-1]), p.start + float(p.t[-1])
    return Law(columns, fixed={"tau_s": (tau, "s")}, shape={"fades": fades})


def saturation(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Beyond a knee the torque constant falls, and the current for a torque rises faster than it."""
    size = np.abs(np.concatenate(list(world.sim[axis])))
    knee = float(np.quantile(size[size > 0.05 * size.max()], rng.uniform(0.6, 0.85)))
    power = float(rng.choice([1.5, 2.0]))
    excess = [np.maximum(np.abs(i) - knee, 0) / knee for i in world.sim[axis]]
    columns = [np.sign(i) * x**power for i, x in zip(world.sim[axis], excess, strict=True)]
    return Law(columns, shape={"knee": knee})


def external(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Something leans on the axis now and then, for some seconds, and lets go again."""
    dt, columns = world.machine.dt, []
    for p in world.parts:
        force, seconds = np.zeros(len(p.t)), len(p.t) * dt
        for slot in range(max(1, int(seconds / 30))):
            long = float(rng.uniform(3, 10))
            begin = slot * 30 + float(rng.uniform(1, max(2.0, min(28.0, seconds - 30 * slot) - long)))
            force[(p.t > begin) & (p.t < begin + long)] += rng.uniform(0.6, 1.3)
        columns.append(gaussian_filter1d(force, 0.15 / dt))
    return Law(columns)
