"""Laws outside the vocabulary of the cut and of the spindle.

In:  a world, an axis. Out: a `Law` of size one; `CUTS` says on which axes. M is the torque of the cut.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.newcomer.foreign import centred
from benchmarks.newcomer.second.plain import times
from benchmarks.newcomer.second.remembered import lately
from benchmarks.newcomer.third.memory import begins, less, relay, since
from benchmarks.newcomer.world import Concealed, Law, World, per_part
from benchmarks.sealed_truth import require_fair
from pido.core.arrays import Float1D


def built_up_edge(world: World, axis: str, rng: np.random.Generator) -> Law:
    """M, the more of it the more material sticks to the edge, until that breaks off after so much of it."""
    dt = world.machine.dt
    volume = per_part(world, lambda p: np.cumsum(p.mrr) * dt)
    every = float(np.median([s[-1] for s in volume])) / float(rng.uniform(3, 8))
    require_fair(every > 0, "nothing is cut")
    torque = per_part(world, lambda p: p.m)
    return Law(less(times([np.mod(s / every, 1.0) for s in volume], torque).columns, torque))


def shock_of_entry(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A load that is there for a moment whenever a tool meets material after air, and swings over as it fades."""
    dt, tau = world.machine.dt, max(float(rng.uniform(0.15, 0.6)), 3 / world.machine.rate)

    def fading(part_engaged: Float1D) -> Float1D:
        time = since(begins(part_engaged > 0), np.arange(len(part_engaged)) * dt)
        late = np.minimum(np.where(np.isfinite(time), time, 1e9) / tau, 50)
        return (1 - 0.6 * late) * np.exp(-late)

    return Law(per_part(world, lambda p: fading(p.engaged.astype(float))))


def tight_bearings(world: World, axis: str, rng: np.random.Generator) -> Law:
    """v_sp, the more the faster the spindle has been lately: bearings that their own heat preloads."""
    dt, tau = world.machine.dt, float(rng.uniform(5, 18))
    v = per_part(world, lambda p: p.v_sp)
    return Law(less(times([lately(x**2, tau, dt) for x in v], v).columns, v))


def cycling_chiller(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A cooler on the spindle's supply that starts when work has warmed it and stops when it has cooled down."""
    dt, tau = world.machine.dt, float(rng.uniform(2.5, 8))
    work = per_part(world, lambda p: lately(p.m * p.v_sp, tau, dt))
    low, high = (
        float(np.quantile(np.concatenate(work), q)) for q in (rng.uniform(0.35, 0.45), rng.uniform(0.55, 0.65))
    )
    return Law(centred([relay(w, low, high) for w in work]))


def grease_of_the_start(world: World, axis: str, rng: np.random.Generator) -> Law:
    """v_sp: grease that lies in the balls' way after each stop of the spindle, gone after so many turns."""
    dt = world.machine.dt
    fast = float(np.quantile(np.concatenate([p.v_sp for p in world.parts]), 0.7))
    turns = fast * float(rng.uniform(1.5, 5.0))

    def in_the_way(v: Float1D) -> Float1D:
        gone = np.cumsum(v) * dt
        way = since(np.r_[v[0] > 0, begins(v > 0)[1:]], gone)
        return v * np.exp(-np.where(np.isfinite(way), way, 0.0) / turns)

    return Law(per_part(world, lambda p: in_the_way(p.v_sp)))


def chips_in_the_flute(world: World, axis: str, rng: np.random.Generator) -> Law:
    """v_sp, more while chips of the last moments are still on the tool: they brake it after the cut as well."""
    dt, tau = world.machine.dt, float(rng.uniform(0.8, 3.0))
    fling = per_part(
        world, lambda p: lately(p.mrr, tau, dt) * (1 - np.minimum(p.mrr / max(float(p.mrr.max()), 1e-9), 1))
    )
    return times(fling, per_part(world, lambda p: p.v_sp))


CUTS: Mapping[str, Concealed] = {
    **{
        f.__name__: Concealed(f, "sp", both_ways=True)
        for f in (built_up_edge, shock_of_entry, tight_bearings, cycling_chiller, grease_of_the_start)
    },
    chips_in_the_flute.__name__: Concealed(chips_in_the_flute, "sp"),
}  # fmt: skip
