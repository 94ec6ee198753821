"""Laws outside the vocabulary of guides and their oil: frictions whose level something else decides.

In:  a world, an axis. Out: a `Law` of size one; `GUIDES` says on which axes. i is the axis, j the other one of the
work plane.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.newcomer.axes import typical
from benchmarks.newcomer.foreign import other_of
from benchmarks.newcomer.second.plain import forward, rubbing, times
from benchmarks.newcomer.second.remembered import lately
from benchmarks.newcomer.third.memory import begins, leaking, less, since
from benchmarks.newcomer.world import Concealed, Law, World, number, per_part
from benchmarks.sealed_truth import require_fair
from pido.core.arrays import Float1D


def metered_oil(world: World, axis: str, rng: np.random.Generator) -> Law:
    """sgn(v_i), least after a shot of oil, which comes after so much way of all axes together."""
    dt = world.machine.dt
    gone = per_part(world, lambda p: np.cumsum(np.abs(p.v).sum(axis=1)) * dt)
    every = float(np.median([s[-1] for s in gone])) / float(rng.uniform(3, 7))
    lasts = float(rng.uniform(0.25, 0.8))
    return rubbing(world, axis, [1 - np.exp(-np.mod(s, every) / (lasts * every)) for s in gone])


def chattering_guide(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Below a speed it jerks along: load builds up in even times and drops, the harder the slower it goes."""
    k, dt = number(axis), world.machine.dt
    v_c, long = typical(world, axis, float(rng.uniform(0.5, 0.75))), max(float(rng.uniform(0.15, 0.6)), 8 * dt)
    long = max(long, 8 / world.machine.rate)

    def jerked(v: Float1D) -> Float1D:
        time = since(begins(v != 0), np.arange(len(v)) * dt)
        phase = np.mod(np.where(np.isfinite(time), time, 0.0) / long, 1.0) - 0.5
        return np.sign(v) * np.maximum(1 - np.abs(v) / v_c, 0) * phase

    return Law(per_part(world, lambda p: jerked(p.v[:, k])))


def rinsed_chips(world: World, axis: str, rng: np.random.Generator) -> Law:
    """sgn(v_i): chips that a dry cut leaves on the cover, and that coolant washes off within seconds."""
    dt, tau = world.machine.dt, float(rng.uniform(2.0, 6.0))

    def lying(mrr: Float1D, wet: Float1D) -> Float1D:
        now, out = 0.0, np.empty_like(mrr)
        for n, (more, on) in enumerate(zip((mrr * dt).tolist(), (wet * dt / tau).tolist(), strict=True)):
            now += more - on * now if on else more
            out[n] = now
        return out

    return rubbing(world, axis, per_part(world, lambda p: lying(p.mrr, p.coolant)))


def thinned_film(world: World, axis: str, rng: np.random.Generator) -> Law:
    """sgn(v_i) by a film that the axis' speed of the last seconds has built up."""
    k, dt, tau = number(axis), world.machine.dt, float(rng.uniform(1.5, 6.0))
    v_0 = typical(world, axis, 0.5) * float(rng.uniform(0.3, 1.0))
    return rubbing(world, axis, per_part(world, lambda p: 1 / (1 + (lately(np.abs(p.v[:, k]), tau, dt) / v_0) ** 2)))


def unvisited_way(world: World, axis: str, rng: np.random.Generator) -> Law:
    """sgn(v_i), the more the longer ago it was that the axis had been at this very place."""
    k, dt, tau = number(axis), world.machine.dt, float(rng.uniform(3, 12))
    x = np.concatenate([p.pos[:, k] for p in world.parts])
    low, high = (float(q) for q in np.quantile(x, [0.01, 0.99]))
    require_fair(high > low, "does not move")
    cell = (high - low) / 40

    def settled(x: Float1D) -> Float1D:
        last: dict[int, float] = {}
        at, out, before, now = np.floor(x / cell).astype(int).tolist(), np.empty_like(x), None, 0.0
        for n, place in enumerate(at):
            if place != before:
                now = 1.0 - float(np.exp(-(n * dt - last.get(place, -1e9)) / tau))
                before = place
            last[place] = n * dt
            out[n] = now
        return out

    return rubbing(world, axis, per_part(world, lambda p: settled(p.pos[:, k])))


def leaning_slide(world: World, axis: str, rng: np.random.Generator) -> Law:
    """sgn(v_i), more where the other axis pushes to one side, less where it pushes to the other."""
    j = other_of(world, axis)
    a = np.abs(np.concatenate([p.a[:, j] for p in world.parts]))
    require_fair(bool((a > 1e-3).any()), "the other axis does not speed up")
    a_0 = float(np.quantile(a[a > 1e-3], rng.uniform(0.5, 0.8)))
    return rubbing(world, axis, per_part(world, lambda p: np.tanh(p.a[:, j] / a_0)))


def pressed_film(world: World, axis: str, rng: np.random.Generator) -> Law:
    """v_i times what the cut pressed along the tool in the last seconds, beyond what it is at the mean of that."""
    k, infeed, dt, tau = number(axis), world.machine.kind.plane[2], world.machine.dt, float(rng.uniform(1.5, 6.0))
    v = per_part(world, lambda p: p.v[:, k])
    return Law(less(times(v, per_part(world, lambda p: lately(np.abs(p.f[:, infeed]), tau, dt))).columns, v))


def dirty_scraper(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A scraper that gathers dirt over the way in one direction and drops all of it when a stop was long enough."""
    k, dt, waits = number(axis), world.machine.dt, float(rng.uniform(0.25, 0.7))
    way = typical(world, axis, 0.6) * float(rng.uniform(4.0, 10.0))

    def gathered(v: Float1D) -> Float1D:
        still = leaking((v == 0).astype(float) - 1e6 * (v != 0), 1e9, dt)
        drops = still > waits
        gone = np.cumsum(np.maximum(v, 0.0)) * dt
        since_drop = since(drops, gone)
        full = np.where(np.isfinite(since_drop), since_drop, gone)
        return np.minimum(full / way, 1.0) * (v > 0)

    moved = per_part(world, lambda p: np.maximum(forward(world, axis, p), 0.0))
    return Law(less(per_part(world, lambda p: gathered(p.v[:, k])), moved))


GUIDES: Mapping[str, Concealed] = {
    **{
        f.__name__: Concealed(f, "plane", both_ways=True)
        for f in (
            metered_oil, chattering_guide, thinned_film, unvisited_way, leaning_slide, pressed_film, dirty_scraper,
        )
    },
    rinsed_chips.__name__: Concealed(rinsed_chips, "plane", facts=True),
}  # fmt: skip
