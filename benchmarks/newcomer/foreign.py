"""Currents that no mechanism of `mechanisms.md` says in other words: what must be called unknown.

In:  a world, an axis. Out: a `Law` of size one. `fair` sees to it that no law of the vocabulary comes near.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.signal import lfilter

from benchmarks.newcomer.axes import typical
from benchmarks.newcomer.world import Concealed, Law, World, direction, held, number, per_part, since_reversal
from pido.core.arrays import Float1D
from pido.core.axes import AXES


def other_of(world: World, axis: str) -> int:
    """The other axis of the work plane; for an axis that is not in it, its first."""
    u, w, _ = world.machine.kind.plane
    return w if number(axis) == u else u


def centred(columns: list[Float1D]) -> list[Float1D]:
    mean = float(np.concatenate(columns).mean())
    return [c - mean for c in columns]


def product_of_speeds(world: World, axis: str, rng: np.random.Generator) -> Law:
    i, j = number(axis), other_of(world, axis)
    return Law(per_part(world, lambda p: p.v[:, i] * p.v[:, j]))


def ringing_frame(world: World, axis: str, rng: np.random.Generator) -> Law:
    """What is left of a weakly damped mass that another axis shakes, without its quasi-static share."""
    j, dt = other_of(world, axis), world.machine.dt
    w, zeta = 2 * np.pi * min(float(rng.uniform(1.5, 6)), world.machine.rate / 8), float(rng.uniform(0.03, 0.08))
    pole = np.exp((-zeta + 1j * np.sqrt(1 - zeta**2)) * w * dt)
    bottom = [1.0, -2 * pole.real, abs(pole) ** 2]
    return Law(per_part(world, lambda p: lfilter([sum(bottom)], bottom, p.a[:, j]) - p.a[:, j]))


def latched(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A clamp that another axis sets when it passes one place and releases when it passes a second one."""
    j = other_of(world, axis)
    where = np.concatenate([p.pos[:, j] - p.centre[j] for p in world.parts])
    low, high = np.quantile(where, [rng.uniform(0.15, 0.35), rng.uniform(0.65, 0.85)])

    def state(x: Float1D) -> Float1D:
        event = np.where(x > high, 1, np.where(x < low, -1, 0))
        return np.maximum(held(event.astype(float)), 0.0)

    return Law(per_part(world, lambda p: state(p.pos[:, j] - p.centre[j])))


def loss_of_the_gear(world: World, axis: str, rng: np.random.Generator) -> Law:
    i, w = number(axis), float(world.machine.sign_width[number(axis)])
    return Law(per_part(world, lambda p: np.abs(p.a[:, i]) * direction(p.v[:, i], w)))


def warm_winding(world: World, axis: str, rng: np.random.Generator) -> Law:
    """By the square of the axis' own current over the last seconds."""
    keep = float(np.exp(-world.machine.dt / rng.uniform(2.5, 9)))
    mean = float(np.mean(np.concatenate([i**2 for i in world.sim[axis]])))
    return Law(centred([lfilter([1 - keep], [1, -keep], i**2, zi=[keep * mean])[0] for i in world.sim[axis]]))


def lifted_ground(world: World, axis: str, rng: np.random.Generator) -> Law:
    """The size of another drive's current, whichever way it flows."""
    other = str(rng.choice([a for a in AXES if a not in (axis, "sp", world.machine.kind.vertical)]))
    return Law(centred([np.abs(i) for i in world.sim[other]]))


def sagging_supply(world: World, axis: str, rng: np.random.Generator) -> Law:
    """The more current all drives draw together beyond what the supply holds, the more this one needs."""
    own = [np.sqrt(np.mean(np.concatenate(list(world.sim[a])) ** 2)) + 1e-12 for a in AXES]
    total = [np.sum([np.abs(world.sim[a][k]) / s for a, s in zip(AXES, own, strict=True)], axis=0)
             for k in range(len(world.parts))]  # fmt: skip
    knee = float(np.quantile(np.concatenate(total), rng.uniform(0.6, 0.8)))
    size = float(own[AXES.index(axis)])
    return Law([np.maximum(t - knee, 0) * np.tanh(3 * i / size) for t, i in zip(total, world.sim[axis], strict=True)])


def shaken_guide(world: World, axis: str, rng: np.random.Generator) -> Law:
    """The guide slides more easily the faster the spindle shakes it; none on average."""
    i, w = number(axis), float(world.machine.sign_width[number(axis)])
    moving = np.concatenate([p.v_sp[p.v[:, i] != 0] for p in world.parts])
    mean = float(np.mean(moving**2))
    return Law(per_part(world, lambda p: (mean - p.v_sp**2) * direction(p.v[:, i], w)))


def settled_film(world: World, axis: str, rng: np.random.Generator) -> Law:
    """The longer an axis stood, the harder its film is to work up again, along a way that it then moves."""
    i, dt = number(axis), world.machine.dt
    reach = typical(world, axis, 0.6) * float(rng.uniform(0.8, 2.0))

    def film(v: Float1D) -> Float1D:
        index = np.arange(len(v))
        moved = np.maximum.accumulate(np.where(v != 0, index, 0))
        stood = (index - moved) * dt
        begins = np.r_[False, (v[1:] != 0) & (v[:-1] == 0)]
        last = np.maximum.accumulate(np.where(begins, index, -1))
        rested = np.log1p(stood[np.maximum(last - 1, 0)])
        gone = np.cumsum(np.abs(v)) * dt
        way = gone - gone[np.maximum(last, 0)]
        return np.where(last >= 0, rested * np.exp(-way / reach), 0.0) * np.sign(v)

    return Law(per_part(world, lambda p: film(p.v[:, i])))


def crossover(world: World, axis: str, rng: np.random.Generator) -> Law:
    """An amplifier that passes small currents badly."""
    size = np.abs(np.concatenate(list(world.sim[axis])))
    d = float(np.quantile(size[size > 0], rng.uniform(0.15, 0.35)))
    return Law([-(i / d) * np.exp(0.5 - 0.5 * (i / d) ** 2) for i in world.sim[axis]])


def curved_way(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Across the path: how sharply it bends, to the left or to the right."""
    u, w, _ = world.machine.kind.plane
    return Law(per_part(world, lambda p: (p.v[:, u] * p.a[:, w] - p.v[:, w] * p.a[:, u]) / np.maximum(p.speed, 1e-3)))


def twisted_bed(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A force by where two axes stand together."""
    i, j = number(axis), other_of(world, axis)
    middle = np.mean([p.pos.mean(axis=0) for p in world.parts], axis=0)
    return Law(centred(per_part(world, lambda p: (p.pos[:, i] - middle[i]) * (p.pos[:, j] - middle[j]))))


def slow_amplifier(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A current that cannot change faster than so much per second: what it lags behind by."""
    dt = world.machine.dt
    steep = np.abs(np.diff(np.concatenate(list(world.sim[axis])))) / dt
    most = float(np.quantile(steep[steep > 0], rng.uniform(0.9, 0.97))) * dt * float(rng.uniform(0.1, 0.3))

    def limited(i: Float1D) -> Float1D:
        now, out = float(i[0]), np.empty_like(i)
        for k, want in enumerate(i.tolist()):
            now += min(max(want - now, -most), most)
            out[k] = now
        return out - i

    return Law([limited(i) for i in world.sim[axis]])


def stray_turn(world: World, axis: str, rng: np.random.Generator) -> Law:
    """The way since the last reversal drives it, wave after wave: a cable that coils up and springs over."""
    i, dt = number(axis), world.machine.dt
    wave = typical(world, axis, 0.7) * float(rng.uniform(0.8, 2.0))

    def coil(v: Float1D) -> Float1D:
        way, _ = since_reversal(v, dt)
        way = np.where(np.isfinite(way), way, 0.0)
        return np.mod(way, wave) / wave - 0.5 * (way > 0)

    return Law(per_part(world, lambda p: coil(p.v[:, i])))


FOREIGN: Mapping[str, Concealed] = {
    f.__name__: Concealed(f, "plane")
    for f in (
        product_of_speeds, ringing_frame, latched, loss_of_the_gear, warm_winding, lifted_ground, sagging_supply,
        shaken_guide, settled_film, crossover, curved_way, twisted_bed, slow_amplifier, stray_turn,
    )
}  # fmt: skip
