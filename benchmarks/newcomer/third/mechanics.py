"""Laws outside the vocabulary of what hangs on an axis: frames, covers, clamps, brakes, masses.

In:  a world, an axis. Out: a `Law` of size one; `MECHANICS` says on which axes. i is the axis, j the other one of the
work plane.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.newcomer.foreign import centred, other_of
from benchmarks.newcomer.second.plain import around_mean, from_middle, times
from benchmarks.newcomer.second.remembered import lately
from benchmarks.newcomer.third.memory import begins, since, stood, swung
from benchmarks.newcomer.world import Concealed, Law, World, held, number, per_part, since_reversal
from benchmarks.sealed_truth import require_fair
from pido.core.arrays import Float1D


def late_brake(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A brake that closes at rest drags for seconds after release, the more the warmer it gets, and then lets go."""
    k, dt = number(axis), world.machine.dt
    rests, drags = float(rng.uniform(0.3, 0.8)), float(rng.uniform(1.5, 5.0))

    def dragging(v: Float1D) -> Float1D:
        still = np.r_[0.0, stood(v, dt)[:-1]]
        released = (v != 0) & (still > rests)
        time = since(released, np.arange(len(v)) * dt)
        return np.where(time < drags, 0.3 + 0.7 * np.minimum(time, drags) / drags, 0.0) * np.sign(v)

    return Law(per_part(world, lambda p: dragging(p.v[:, k])))


def packed_bellows(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A cover that is a spring, soft in the middle and hard where its folds meet; more so on one side."""
    x = from_middle(world, number(axis))
    reach = float(np.quantile(np.abs(np.concatenate(x)), 0.95))
    require_fair(reach > 0, "does not move")
    aside = float(rng.uniform(-0.3, 0.3))
    return Law(centred([((s / reach) - aside) ** 3 for s in x]))


def whipping_column(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A column that rings after its own axis, the slower the further out the other slide stands on it."""
    k, j, dt = number(axis), other_of(world, axis), world.machine.dt
    low = min(float(rng.uniform(1.2, 3.5)), world.machine.rate / 12)
    zeta, more = float(rng.uniform(0.02, 0.05)), float(rng.uniform(0.4, 1.0))
    x = from_middle(world, j)
    reach = float(np.quantile(np.abs(np.concatenate(x)), 0.95)) or 1.0
    w = [2 * np.pi * low * (1 + more * (0.5 + 0.5 * np.tanh(s / reach))) for s in x]
    return Law([swung(p.a[:, k], turn, zeta, dt) for p, turn in zip(world.parts, w, strict=True)])


def arguing_twins(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Two drives of one beam: the further out its slide, the further one of them is left behind, and comes back."""
    k, dt, tau = number(axis), world.machine.dt, float(rng.uniform(0.5, 2.0))
    skewing = times(per_part(world, lambda p: p.v[:, k]), from_middle(world, other_of(world, axis))).columns
    return Law([lately(s, tau, dt) for s in skewing])


def clamped_at_rest(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Some tenths of a second after a stop a clamp pushes an axis aside; it gives way, and is back at a start."""
    k, dt, waits = number(axis), world.machine.dt, float(rng.uniform(0.2, 0.6))
    gives, back = float(rng.uniform(0.5, 1.5)), float(rng.uniform(0.2, 0.5))

    def pushed(v: Float1D) -> Float1D:
        still = stood(v, dt)
        released = (v != 0) & np.r_[False, still[:-1] > waits]
        time = np.minimum(since(released, np.arange(len(v)) * dt), 1e6)
        return np.where(still > waits, np.exp(-(still - waits) / gives), np.where(v != 0, -np.exp(-time / back), 0.0))

    return Law(per_part(world, lambda p: pushed(p.v[:, k])))


def lighter_workpiece(world: World, axis: str, rng: np.random.Generator) -> Law:
    """a_i times what has been cut off in this part, less the mean of it."""
    k, dt = number(axis), world.machine.dt
    a = per_part(world, lambda p: p.a[:, k])
    return times(around_mean(per_part(world, lambda p: -np.cumsum(p.mrr) * dt), a), a)


def kicked_by_the_other(world: World, axis: str, rng: np.random.Generator) -> Law:
    """After each reversal of the other axis a kick that swings over to the other side and fades."""
    j, dt, tau = other_of(world, axis), world.machine.dt, max(float(rng.uniform(0.12, 0.4)), 3 / world.machine.rate)

    def kick(v: Float1D) -> Float1D:
        _, time = since_reversal(v, dt)
        late = np.where(np.isfinite(time), time, 1e9) / tau
        return held(v) * (1 - 0.7 * late) * np.exp(-np.minimum(late, 50))

    return Law(per_part(world, lambda p: kick(p.v[:, j])))


def slack_chain(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A counterweight whose chain comes off when its axis falls away from it, and bounces for a while after."""
    k, dt = number(axis), world.machine.dt
    a = np.abs(np.concatenate([p.a[:, k] for p in world.parts]))
    require_fair(bool((a > 1e-3).any()), "never speeds up")
    a_0, sense = float(np.quantile(a[a > 1e-3], rng.uniform(0.4, 0.7))), float(rng.choice([-1.0, 1.0]))
    hertz, tau = min(float(rng.uniform(1.5, 4.0)), world.machine.rate / 8), float(rng.uniform(0.4, 1.0))

    def bounced(a: Float1D) -> Float1D:
        time = since(begins(sense * a > a_0), np.arange(len(a)) * dt)
        late = np.where(np.isfinite(time), time, 1e3)
        return np.abs(np.cos(np.pi * hertz * late)) * np.exp(-late / tau)

    return Law(per_part(world, lambda p: bounced(p.a[:, k])))


def pressed_by_the_turn(world: World, axis: str, rng: np.random.Generator) -> Law:
    """|a_j| where the other axis speeds up, none where it slows down: a beam that leans on one of its two guides."""
    j = other_of(world, axis)
    return Law(per_part(world, lambda p: np.where(p.a[:, j] * p.v[:, j] > 0, np.abs(p.a[:, j]), 0.0)))


MECHANICS: Mapping[str, Concealed] = {
    **{
        f.__name__: Concealed(f, "plane", both_ways=True)
        for f in (
            packed_bellows, whipping_column, arguing_twins, clamped_at_rest, lighter_workpiece, kicked_by_the_other,
            pressed_by_the_turn,
        )
    },
    late_brake.__name__: Concealed(late_brake, "plane"),
    slack_chain.__name__: Concealed(slack_chain, "vertical", both_ways=True),
}  # fmt: skip
