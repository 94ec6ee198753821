"""Laws outside the vocabulary that depend on what happened before, within the part.

In:  a world, an axis. Out: a `Law` of size one; `REMEMBERED` says on which axes. i is the axis, j the other one of the
work plane. Nothing is remembered from one part to the next.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.signal import lfilter

from benchmarks.newcomer.axes import typical
from benchmarks.newcomer.foreign import centred, other_of
from benchmarks.newcomer.second.plain import around_mean, rubbing, times
from benchmarks.newcomer.world import Concealed, Law, World, held, number, per_part
from benchmarks.sealed_truth import require_fair
from pido.core.arrays import Float1D


def lately(x: Float1D, tau: float, dt: float) -> Float1D:
    """(n,): mean of the last tau seconds, older ones counting less; 0 before the first sample. tau, dt : s

    >>> lately(np.ones(3), 1.0, 1.0).round(3).tolist()
    [0.632, 0.865, 0.95]
    """
    keep = float(np.exp(-dt / tau))
    return np.asarray(lfilter([1 - keep], [1, -keep], x))


def viscous_hose(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A spring behind a damper: it follows the axis and forgets within a second or two."""
    k, dt, tau = number(axis), world.machine.dt, float(rng.uniform(0.7, 2.5))
    return Law(per_part(world, lambda p: lately(p.v[:, k], tau, dt)))


def warm_oil(world: World, axis: str, rng: np.random.Generator) -> Law:
    """v_i, the less the more the axis has moved lately: as much as simulated on average."""
    k, dt, tau = number(axis), world.machine.dt, float(rng.uniform(4, 15))
    v = per_part(world, lambda p: p.v[:, k])
    return times(around_mean([-lately(x**2, tau, dt) for x in v], v), v)


def lubricator(world: World, axis: str, rng: np.random.Generator) -> Law:
    """sgn(v_i), least after each shot of oil, which the control gives every so many seconds from a part's start."""
    every, lasts = float(rng.uniform(9, 22)), float(rng.uniform(0.3, 1.0))
    return rubbing(world, axis, per_part(world, lambda p: -np.exp(-np.mod(p.t, every) / (lasts * every))))


def heap_of_chips(world: World, axis: str, rng: np.random.Generator) -> Law:
    """sgn(v_i), the more the more has been cut in this part; the cover is swept between parts."""
    dt = world.machine.dt
    return rubbing(world, axis, per_part(world, lambda p: np.cumsum(p.mrr) * dt))


def echo(world: World, axis: str, rng: np.random.Generator) -> Law:
    """a_j of some tenths of a second ago: a wave that has been to the end of the bed and back."""
    j, dt, late = other_of(world, axis), world.machine.dt, float(rng.uniform(0.3, 0.9))
    steps = max(1, round(max(late, 3 * world.machine.jerk_s) / dt))
    return Law(per_part(world, lambda p: np.r_[np.zeros(steps), p.a[:-steps, j]][: len(p.t)]))


def dragged_chain(world: World, axis: str, rng: np.random.Generator) -> Law:
    """An energy chain of the other axis: pulled along until it slips, and back as far the other way."""
    j, dt = other_of(world, axis), world.machine.dt
    span = float(np.mean([np.std(p.pos[:, j]) for p in world.parts])) * float(rng.uniform(0.5, 1.2))

    def stretched(v: Float1D) -> Float1D:
        now, out = 0.0, np.empty_like(v)
        for n, step in enumerate((v * dt).tolist()):
            now = min(max(now + step, -span), span)
            out[n] = now
        return out

    return Law(per_part(world, lambda p: stretched(p.v[:, j])))


def lame_ball(world: World, axis: str, rng: np.random.Generator) -> Law:
    """sgn(v_i) times a wave of the way that the axis has gone, to and fro alike: a ball that comes round again."""
    k, dt = number(axis), world.machine.dt
    speed = np.abs(np.concatenate([p.v[:, k] for p in world.parts]))
    wave = max(typical(world, axis, 0.6) * float(rng.uniform(1.0, 3.0)),
               10 * float(np.quantile(speed, 0.98)) / world.machine.rate)  # fmt: skip
    gone = per_part(world, lambda p: np.cumsum(np.abs(p.v[:, k])) * dt)
    return rubbing(world, axis, [np.sin(2 * np.pi * s / wave) for s in gone])


def bruised_guide(world: World, axis: str, rng: np.random.Generator) -> Law:
    """sgn(v_i), by the hardest pull of the cut that is not forgotten yet."""
    dt, tau = world.machine.dt, float(rng.uniform(4, 12))

    def hardest(force: Float1D) -> Float1D:
        keep, now, out = float(np.exp(-dt / tau)), 0.0, np.empty_like(force)
        for n, f in enumerate(force.tolist()):
            now = max(now * keep, f)
            out[n] = now
        return out

    return rubbing(world, axis, per_part(world, lambda p: hardest(np.linalg.norm(p.f, axis=1))))


def relaxing_frame(world: World, axis: str, rng: np.random.Generator) -> Law:
    """While the other axis stands: what its last motion has left in the frame, gone within a second."""
    j, dt, tau = other_of(world, axis), world.machine.dt, float(rng.uniform(0.3, 1.2))

    def left(v: Float1D) -> Float1D:
        index = np.arange(len(v))
        stood = (index - np.maximum.accumulate(np.where(v != 0, index, 0))) * dt
        return np.where(v == 0, held(v) * np.exp(-stood / tau), 0.0)

    return Law(per_part(world, lambda p: left(p.v[:, j])))


def warm_cut(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Torque of the last seconds, on the spindle: what it heats."""
    dt, tau = world.machine.dt, float(rng.uniform(3, 12))
    require_fair(any(p.engaged.any() for p in world.parts), "nothing is cut")
    return Law(centred(per_part(world, lambda p: lately(p.m, tau, dt))))


REMEMBERED: Mapping[str, Concealed] = {
    **{
        f.__name__: Concealed(f, "plane", both_ways=True)
        for f in (
            viscous_hose, warm_oil, lubricator, heap_of_chips, echo, dragged_chain, lame_ball, bruised_guide,
            relaxing_frame,
        )
    },
    warm_cut.__name__: Concealed(warm_cut, "sp", both_ways=True),
}  # fmt: skip
