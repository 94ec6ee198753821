"""What friction and drive may add to the current of a linear axis, in forms of the textbooks.

In:  a `World`, an axis, a generator. Out: a `Law`.

Sources: Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30 (1994), friction; Dahl (1968); Canudas de Wit et al.,
IEEE TAC 40 (1995), LuGre; Lampaert, Swevers, Al-Bender, IEEE TAC 47 (2002), Maxwell slip; Tustin (1947).
"""

from __future__ import annotations

import numpy as np

from benchmarks.stranger.law import Law, World
from benchmarks.stranger.parts import Part
from pido.core.arrays import Float1D
from pido.core.axes import AXES, LINEAR_AXES


def coulomb(world: World, axis: str, rng: np.random.Generator) -> Law:
    return Law(world.each(lambda p: np.sign(p.speed(axis))), {"F_c": (1.0, "A")})


def viscous(world: World, axis: str, rng: np.random.Generator) -> Law:
    return Law(world.each(lambda p: p.speed(axis)), {"F_v": (1.0, "A·s/mm")})


def stribeck(world: World, axis: str, rng: np.random.Generator) -> Law:
    """exp(-(|v|/v_s)^delta): Gauss (2), Tustin (1), Bo and Pavelescu (1/2), or Hess and Soom 1/(1 + (v/v_s)²)."""
    slow = world.shown[0].plant.family.feed
    v_s, power = float(rng.uniform(0.15, 0.6) * slow[0] + 0.02 * slow[1]), float(rng.choice([0.5, 1.0, 2.0, -2.0]))

    def column(p: Part) -> Float1D:
        ratio = np.abs(p.speed(axis)) / v_s
        return (1 / (1 + ratio**2) if power < 0 else np.exp(-(ratio**power))) * np.sign(p.speed(axis))

    comparable = {"v_s": (v_s, "mm/s")} if power == 2 else {}
    return Law(world.each(column), {"F_s - F_c": (1.0, "A")}, comparable, {"delta": power, "v_s_mm_s": v_s})


def last_direction(v: Float1D) -> Float1D:
    """(n,): sign of the last motion; 0 before the first.

    >>> last_direction(np.array([0.0, 2.0, 0.0, -1.0, 0.0]))
    array([ 0.,  1.,  1., -1., -1.])
    """
    moving = np.where(v != 0, np.arange(len(v)), -1)
    last = np.maximum.accumulate(moving)
    return np.where(last >= 0, np.sign(v[last]), 0.0)


def standstill(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Held friction, wholly or creeping back with a time constant of many seconds."""
    tau = float(rng.choice([np.inf, rng.uniform(15, 60)]))

    def column(p: Part) -> Float1D:
        v = p.speed(axis)
        since = p.t - p.t[np.maximum.accumulate(np.where(v != 0, np.arange(len(v)), 0))]
        return last_direction(v) * (v == 0) * np.exp(-since / tau)

    return Law(world.each(column), shape={"tau_s": None if np.isinf(tau) else tau})


def asymmetry(world: World, axis: str, rng: np.random.Generator) -> Law:
    form = str(rng.choice(["coulomb", "viscous", "one side"]))

    def column(p: Part) -> Float1D:
        v = p.speed(axis)
        return {"coulomb": np.abs(np.sign(v)), "viscous": np.abs(v), "one side": (v > 0) * 1.0}[form]

    return Law(world.each(column), shape={"form": form})


def across(p: Part, axis: str) -> Float1D:
    """(n,), N: size of the process force perpendicular to an axis."""
    return np.linalg.norm(np.delete(p.f, AXES.index(axis), axis=1), axis=1)


def load_dependent(world: World, axis: str, rng: np.random.Generator) -> Law:
    return Law(world.each(lambda p: across(p, axis) * np.sign(p.speed(axis))), {"k": (1.0, "A/N")})


def position_dependent(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A worn stretch, a slope along the travel, or the screw's long wave."""
    i, form = AXES.index(axis), str(rng.choice(["bump", "slope", "wave"]))
    pos = np.concatenate([p.pos[:, i][np.abs(p.v[:, i]) > 0] for p in world.shown])
    low, high = np.quantile(pos, [0.02, 0.98])
    middle, width = rng.uniform(low + 0.25 * (high - low), high - 0.25 * (high - low)), rng.uniform(0.1, 0.3)
    L, phase = float((high - low) * rng.uniform(0.35, 1.2)), rng.uniform(0, 2 * np.pi)

    def g(x: Float1D) -> Float1D:
        if form == "bump":
            return np.exp(-0.5 * ((x - middle) / (width * (high - low))) ** 2)
        if form == "slope":
            return (x - 0.5 * (low + high)) / (high - low)
        return np.sin(2 * np.pi * x / L + phase)

    return Law(
        world.each(lambda p: g(p.pos[:, i]) * np.sign(p.v[:, i])),
        fixed={"period_mm": (L, "mm")} if form == "wave" else {},
        shape={"form": form},
    )


def bristles(v: Float1D, dt: float, over_mm: float, rise: float = 0.0, v_s: float = 1.0) -> Float1D:
    """(n,): state of a Dahl (rise = 0) or LuGre bristle over its sliding value.

        dz/dt = v / over - |v| z / (over g(v)),    g(v) = 1 + rise exp(-(v/v_s)²)

    Solved exactly over each step of constant v. over_mm : mm, distance over which the force builds up.

    >>> z = bristles(np.full(400, 1.0), 0.01, over_mm=0.5)
    >>> round(float(z[49]), 6)  # after 0.5 mm: 1 - 1/e
    0.632121
    """
    g = 1.0 + rise * np.exp(-((v / v_s) ** 2))
    aim, keep = (np.sign(v) * g).tolist(), np.exp(-np.abs(v) * dt / (over_mm * g)).tolist()
    z, out = 0.0, []
    for to, kept in zip(aim, keep, strict=True):
        z = to + (z - to) * kept
        out.append(z)
    return np.array(out)


def _maxwell_slip(pos: Float1D, over_mm: float) -> Float1D:
    """(n,): four elastic elements in parallel that begin to slip one after the other."""
    limits, shares = over_mm * np.array([0.3, 0.8, 1.5, 3.0]), np.array([0.4, 0.3, 0.2, 0.1])
    z, out = np.zeros(4), np.empty((len(pos), 4))
    for k, step in enumerate(np.diff(pos, prepend=pos[0])):
        z = np.minimum(np.maximum(z + step, -limits), limits)
        out[k] = z
    return (out / limits) @ shares


def presliding(world: World, axis: str, rng: np.random.Generator) -> Law:
    i, form = AXES.index(axis), str(rng.choice(["Dahl", "LuGre", "Maxwell slip"]))
    plant = world.shown[0].plant
    over = float(plant.family.feed[0] * rng.uniform(0.01, 0.08))
    rise = float(rng.uniform(0.1, 0.4)) if form == "LuGre" else 0.0

    def column(p: Part) -> Float1D:
        if form == "Maxwell slip":
            return _maxwell_slip(p.pos[:, i], over)
        return bristles(p.v[:, i], plant.dt, over, rise, plant.family.feed[0])

    comparable = {} if form == "LuGre" else {"F_c": (1.0, "A")}
    return Law(world.each(column), comparable, shape={"form": form, "over_mm": over})


def since_reversal(p: Part, axis: str) -> tuple[Float1D, Float1D]:
    """(n,) mm and (n,) s since the direction of motion last changed; infinite before the first change."""
    i = AXES.index(axis)
    direction, path = last_direction(p.v[:, i]), np.cumsum(np.abs(p.v[:, i])) * p.plant.dt
    turned = np.r_[False, (direction[1:] != direction[:-1]) & (direction[:-1] != 0)]
    at = np.maximum.accumulate(np.where(turned, np.arange(len(path)), -1))
    known = at >= 0
    return np.where(known, path - path[at], np.inf), np.where(known, p.t - p.t[at], np.inf)


def backlash(world: World, axis: str, rng: np.random.Generator) -> Law:
    """The drive runs free over the gap, or takes it up in a pulse of some ten milliseconds."""
    plant, form = world.shown[0].plant, str(rng.choice(["gap", "soft gap", "pulse"]))
    gap = float(plant.family.feed[0] * rng.uniform(0.01, 0.08))
    tau = float(rng.uniform(0.02, 0.1) + 1.0 / plant.rate)

    def column(p: Part) -> Float1D:
        d, t = since_reversal(p, axis)
        way = last_direction(p.speed(axis))
        if form == "pulse":
            after = np.where(np.isfinite(t), t, 1e3 * tau) / tau
            return way * after * np.exp(1 - after)
        return -way * (p.speed(axis) != 0) * ((d < gap) if form == "gap" else np.exp(-d / gap))

    return Law(world.each(column), shape={"form": form, "gap_mm": gap, "tau_s": tau})


def inertia(world: World, axis: str, rng: np.random.Generator) -> Law:
    return Law(world.each(lambda p: p.a[:, AXES.index(axis)]), {"m": (1.0, "A·s²/mm")})


def gravity(world: World, axis: str, rng: np.random.Generator) -> Law:
    if rng.random() < 0.5:
        return Law(world.each(lambda p: np.ones(len(p.t))), {"k": (1.0, "A")})
    return Law(world.each(tool_mass), shape={"form": "tool mass"})


def tool_mass(p: Part) -> Float1D:
    """(n,), kg."""
    return np.array([p.plant.tools[int(n)].mass_kg for n in p.tool])


def coupling(world: World, axis: str, rng: np.random.Generator) -> Law:
    j = int(rng.choice([k for k, name in enumerate(LINEAR_AXES) if name != axis]))
    form, unit = [("a", "A·s²/mm"), ("v", "A·s/mm"), ("sgn v", "A")][rng.integers(3)]
    of = {"a": lambda p: p.a[:, j], "v": lambda p: p.v[:, j], "sgn v": lambda p: np.sign(p.v[:, j])}[form]
    return Law(world.each(of), {"k": (1.0, unit)}, shape={"form": form, "of": LINEAR_AXES[j]})


def ripple(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Once per lead or pole pitch, or a whole number of times, sometimes with the second harmonic."""
    i = AXES.index(axis)
    L = float(world.shown[0].plant.lead[i] / rng.choice([1, 1, 2]))
    second, at, at2 = float(rng.choice([0.0, 0.35])), *rng.uniform(0, 2 * np.pi, 2)

    def column(p: Part) -> Float1D:
        turn = 2 * np.pi * p.pos[:, i] / L
        return np.sin(turn + at) + second * np.sin(2 * turn + at2)

    return Law(world.each(column), {} if second else {"A": (1.0, "A")}, {"period": (L, "mm")})
