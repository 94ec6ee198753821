"""Laws of a linear axis: friction, drive and mass, each from the sentence of `mechanisms.md`.

In:  a world, an axis. Out: a `Law` of size one. Sources: Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30
(1994); Iwan, J. Appl. Mech. 33 (1966); Altintas et al., CIRP Annals 60 (2011).
"""

from __future__ import annotations

import numpy as np

from benchmarks.newcomer.world import Law, World, direction, held, number, per_part, since_reversal
from pido.core.arrays import Float1D
from pido.core.axes import LINEAR_AXES


def _width(world: World, axis: str) -> float:
    """mm/s, within which a recorded friction turns; not the simulation's."""
    return 1.5 * float(world.machine.sign_width[number(axis)])


def typical(world: World, axis: str, share: float) -> float:
    """mm/s: quantile of an axis' speed where it moves."""
    k = number(axis)
    v = np.abs(np.concatenate([p.v[:, k] for p in world.parts]))
    return float(np.quantile(v[v > 1e-3], share)) if (v > 1e-3).any() else 1.0


def coulomb(world: World, axis: str, rng: np.random.Generator) -> Law:
    k, w = number(axis), _width(world, axis)
    return Law(per_part(world, lambda p: direction(p.v[:, k], w)), {"F_c": (1.0, "A")})


def viscous(world: World, axis: str, rng: np.random.Generator) -> Law:
    k = number(axis)
    return Law(per_part(world, lambda p: p.v[:, k]), {"F_v": (1.0, "A·s/mm")})


def stribeck(world: World, axis: str, rng: np.random.Generator) -> Law:
    k, w = number(axis), _width(world, axis)
    v_s, delta = typical(world, axis, float(rng.uniform(0.1, 0.3))), float(rng.choice([1.0, 1.4, 2.0]))
    columns = per_part(world, lambda p: np.exp(-((np.abs(p.v[:, k]) / v_s) ** delta)) * direction(p.v[:, k], w / 3))
    exact: dict[str, tuple[float, str]] = {"v_s": (v_s, "mm/s")} if delta == 2 else {}
    return Law(columns, {"F_s - F_c": (1.0, "A")}, exact, {"delta": delta})


def standstill(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Held from the moment the axis stands; some of it creeps away within seconds."""
    k, dt, lost, tau = number(axis), world.machine.dt, float(rng.uniform(0, 0.35)), float(rng.uniform(1, 6))

    def rest(v: Float1D) -> Float1D:
        index = np.arange(len(v))
        stood = (index - np.maximum.accumulate(np.where(v != 0, index, 0))) * dt
        return np.where(v == 0, held(v) * (1 - lost * (1 - np.exp(-stood / tau))), 0.0)

    return Law(per_part(world, lambda p: rest(p.v[:, k])))


def asymmetry(world: World, axis: str, rng: np.random.Generator) -> Law:
    """More friction one way than the other: of the constant kind or of the kind that grows with speed."""
    k, w, kind = number(axis), _width(world, axis), str(rng.choice(["coulomb", "viscous"]))
    one_way, sign = bool(rng.random() < 0.4), float(rng.choice([-1.0, 1.0]))

    def of(v: Float1D) -> Float1D:
        size = direction(v, w) if kind == "coulomb" else v
        return np.where(sign * v > 0, size, 0.0 if one_way else -size)

    return Law(per_part(world, lambda p: of(p.v[:, k])), shape={"of": kind, "one way": one_way})


def load_dependent(world: World, axis: str, rng: np.random.Generator) -> Law:
    k, w = number(axis), _width(world, axis)
    across = [i for i in range(3) if i != k]
    columns = per_part(world, lambda p: np.linalg.norm(p.f[:, across], axis=1) * direction(p.v[:, k], w))
    return Law(columns, {"k": (1.0, "A/N")})


def position_dependent(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A friction level along the travel that is worn here and tight there, none on average over what is moved."""
    k, w = number(axis), _width(world, axis)
    where = np.concatenate([p.pos[p.v[:, k] != 0, k] for p in world.parts])
    low, high = np.quantile(where, [0.02, 0.98])
    middle, wide = float(rng.uniform(low + 0.25 * (high - low), high - 0.25 * (high - low))), 0.2 * (high - low)
    tilt = float(rng.uniform(-0.5, 0.5))

    def level(x: Float1D) -> Float1D:
        return 1 / (1 + ((x - middle) / wide) ** 4) + tilt * (x - middle) / (high - low)

    mean = float(level(where).mean())
    return Law(per_part(world, lambda p: (level(p.pos[:, k]) - mean) * direction(p.v[:, k], w)))


def presliding(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Slip elements in parallel that yield one after another; the simulation has their sum once all of them slide."""
    k, dt = number(axis), world.machine.dt
    reach = max(typical(world, axis, 0.3) * float(rng.uniform(0.08, 0.4)), 0.02)
    yields = reach * np.sort(rng.uniform(0.1, 1.0, 4))
    weights = rng.dirichlet(np.ones(4) * 3)

    def lacking(v: Float1D) -> Float1D:
        way, _ = since_reversal(v, dt)
        built = np.sum([m * np.clip(2 * way / y - 1, -1, 1) for m, y in zip(weights, yields, strict=True)], axis=0)
        return held(v) * (built - 1)

    return Law(per_part(world, lambda p: lacking(p.v[:, k])), shape={"reach_mm": float(yields[-1])})


def backlash(world: World, axis: str, rng: np.random.Generator) -> Law:
    """The motor runs without its load through the gap, then takes it up with a blow that fades."""
    k, dt = number(axis), world.machine.dt
    gap = max(typical(world, axis, 0.3) * float(rng.uniform(0.1, 0.4)), 0.01)
    tau, blow = max(float(rng.uniform(0.04, 0.12)), 1.5 / world.machine.rate), float(rng.uniform(0.6, 1.5))

    def pulse(v: Float1D) -> Float1D:
        way, _ = since_reversal(v, dt)
        index = np.arange(len(v))
        free = (way < gap) & (v != 0)
        met = np.r_[False, free[:-1] & (way[1:] >= gap)]
        last = np.maximum.accumulate(np.where(met, index, -1))
        after = np.where((last >= 0) & (way >= gap), (index - np.maximum(last, 0)) * dt, np.inf)
        return held(v) * (blow * np.exp(-after / tau) - np.where(free, np.sin(np.pi * np.clip(way / gap, 0, 1)), 0.0))

    return Law(per_part(world, lambda p: pulse(p.v[:, k])), shape={"gap_mm": gap})


def inertia(world: World, axis: str, rng: np.random.Generator) -> Law:
    k = number(axis)
    return Law(per_part(world, lambda p: p.a[:, k]), {"m": (1.0, "A·s²/mm")})


def gravity(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A weight of its own, or that of the tool in the spindle."""
    cutters = world.machine.cutters
    if rng.random() < 0.6:
        return Law(per_part(world, lambda p: np.ones(len(p.t))), {"k": (1.0, "A")}, shape={"of": "axis"})
    heavy = max(c.mass_kg for c in cutters.values())
    mass = {n: c.mass_kg / heavy for n, c in cutters.items()}
    return Law(per_part(world, lambda p: np.array([mass[int(n)] for n in p.tool])), shape={"of": "tool"})


def coupling(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Another axis' acceleration, speed or direction."""
    other = str(rng.choice([a for a in LINEAR_AXES if a != axis]))
    j, of = number(other), str(rng.choice(["a", "v", "sgn"]))
    unit = {"a": "A·s²/mm", "v": "A·s/mm", "sgn": "A"}[of]
    w = _width(world, other)
    columns = {
        "a": lambda: per_part(world, lambda p: p.a[:, j]),
        "v": lambda: per_part(world, lambda p: p.v[:, j]),
        "sgn": lambda: per_part(world, lambda p: direction(p.v[:, j], w)),
    }[of]()
    return Law(columns, {"k": (1.0, unit)}, shape={"other": other, "of": of})


def ripple(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Periodic in the position with the screw's lead, the rack's tooth or the magnets' pitch, and its double."""
    k, pitch = number(axis), world.machine.kind.pitch_mm
    if not world.machine.kind.screw:
        pitch *= float(rng.choice([1.0, 0.5]))
    phase, second = float(rng.uniform(0, 2 * np.pi)), float(rng.uniform(0, 0.3))

    def wave(x: Float1D) -> Float1D:
        angle = 2 * np.pi * x / pitch + phase
        return np.sin(angle) + second * np.cos(2 * angle)

    return Law(per_part(world, lambda p: wave(p.pos[:, k])), fixed={"period": (pitch, "mm")})
