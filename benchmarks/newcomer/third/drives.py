"""Laws outside the vocabulary of motors, amplifiers and controls.

In:  a world, an axis. Out: a `Law` of size one; `DRIVES` says on which axes. I is the simulated current of the axis.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.newcomer.foreign import centred
from benchmarks.newcomer.second.plain import from_middle, times
from benchmarks.newcomer.second.remembered import lately
from benchmarks.newcomer.third.memory import leaking, less, relay, since
from benchmarks.newcomer.world import Columns, Concealed, Law, World, held, number, per_part
from benchmarks.sealed_truth import require_fair
from pido.core.arrays import Float1D


def _levels(columns: Columns, low: float, high: float) -> tuple[float, float]:
    x = np.concatenate(list(columns))
    return float(np.quantile(x, low)), float(np.quantile(x, high))


def loaded_ripple(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A wave of the position that only comes above a load, and grows with it."""
    k, machine = number(axis), world.machine
    speed = np.abs(np.concatenate([p.v[:, k] for p in world.parts]))
    wave = max(
        machine.kind.pitch_mm * float(rng.choice([0.5, 1.0])), 8 * float(np.quantile(speed, 0.95)) / machine.rate
    )
    size = np.abs(np.concatenate(list(world.sim[axis])))
    knee, phase = float(np.quantile(size, rng.uniform(0.6, 0.8))), float(rng.uniform(0, 2 * np.pi))
    return Law([np.maximum(np.abs(i) - knee, 0) * np.sin(2 * np.pi * p.pos[:, k] / wave + phase)
                for i, p in zip(world.sim[axis], world.parts, strict=True)])  # fmt: skip


def swinging_bus(world: World, axis: str, rng: np.random.Generator) -> Law:
    """I times what all axes together took from the intermediate circuit, or gave to it, in the last second or so."""
    dt, tau = world.machine.dt, float(rng.uniform(0.5, 2.0))
    power = per_part(world, lambda p: lately((p.a * p.v).sum(axis=1), tau, dt))
    return Law(less(times(power, world.sim[axis]).columns, world.sim[axis]))


def wound_up(world: World, axis: str, rng: np.random.Generator) -> Law:
    """An integrator that gathers what the amplifier refuses above a current, and empties when the motion turns."""
    k, dt, tau = number(axis), world.machine.dt, float(rng.uniform(1.5, 5.0))
    most = _levels([np.abs(i) for i in world.sim[axis]], 0.0, float(rng.uniform(0.85, 0.94)))[1]

    def wound(i: Float1D, v: Float1D) -> Float1D:
        sign, keep, now, out = held(v).tolist(), 1 - dt / tau, 0.0, np.empty_like(i)
        for n, refused in enumerate(((i - np.clip(i, -most, most)) * dt).tolist()):
            now = 0.0 if n and sign[n] != sign[n - 1] else now * keep + refused
            out[n] = now
        return out

    gathered = [wound(i, p.v[:, k]) for i, p in zip(world.sim[axis], world.parts, strict=True)]
    return Law(less(gathered, world.sim[axis]))


def switched_filter(world: World, axis: str, rng: np.random.Generator) -> Law:
    """While the tool cuts, a slower filter passes the current; what that keeps back of it."""
    dt, tau = world.machine.dt, max(float(rng.uniform(0.15, 0.5)), 4 / world.machine.rate)
    require_fair(any(p.engaged.any() for p in world.parts), "nothing is cut")
    return Law([(lately(i - i[0], tau, dt) + i[0] - i) * p.engaged
                for i, p in zip(world.sim[axis], world.parts, strict=True)])  # fmt: skip


def stepping_compensation(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A table for the growth of a screw: in proportion to the way from its bearing, in steps of what it has moved."""
    k, dt, tau = number(axis), world.machine.dt, float(rng.uniform(5, 15))
    heat = per_part(world, lambda p: lately(p.v[:, k] ** 2, tau, dt))
    step = _levels(heat, 0.0, 0.95)[1] / float(rng.uniform(2.5, 5.5))
    require_fair(step > 0, "does not move")
    return times(centred([np.round(h / step) for h in heat]), from_middle(world, k))


def hot_magnets(world: World, axis: str, rng: np.random.Generator) -> Law:
    """I, the more of it the more has flown in the last seconds: warm magnets are weaker."""
    dt, tau = world.machine.dt, float(rng.uniform(3, 12))
    warmth = [lately(i**2, tau, dt) for i in world.sim[axis]]
    return Law(less(times(warmth, world.sim[axis]).columns, world.sim[axis]))


def chopped_brake(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A resistor that is switched in when braking axes have filled the circuit, and out when it is empty again."""
    dt, tau = world.machine.dt, float(rng.uniform(1.0, 3.0))
    filled = per_part(world, lambda p: leaking(np.maximum(-(p.a * p.v).sum(axis=1), 0), tau, dt))
    low, high = _levels(filled, float(rng.uniform(0.25, 0.4)), float(rng.uniform(0.65, 0.8)))
    return Law(centred([relay(f, low, high) for f in filled]))


def doubled_gain(world: World, axis: str, rng: np.random.Generator) -> Law:
    """I in gear two, which a control takes above a speed of the path and leaves well below it."""
    speed = per_part(world, lambda p: p.speed)
    low, high = _levels([s[s > 1e-3] for s in speed], float(rng.uniform(0.2, 0.35)), float(rng.uniform(0.65, 0.8)))
    gear = [relay(s, low, high) for s in speed]
    return Law(less(times(gear, world.sim[axis]).columns, world.sim[axis]))


def weak_field(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Above a speed of the spindle a run-up takes more current, and so does a stop, the more the faster it turns."""
    v, a = (np.concatenate([getattr(p, n) for p in world.parts]) for n in ("v_sp", "a_sp"))
    require_fair(bool((a != 0).sum() > 100), "the spindle never changes its speed")
    v_b, ramps = float(np.quantile(v[a != 0], rng.uniform(0.3, 0.6))), per_part(world, lambda p: p.a_sp)
    return Law(less(times(per_part(world, lambda p: np.maximum(p.v_sp / v_b - 1, 0)), ramps).columns, ramps))


def second_gear(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A gear that is changed up above one speed of the spindle and down below another: it swings in after each."""
    turns, dt = np.concatenate([p.v_sp for p in world.parts]), world.machine.dt
    turns = turns[turns > 0.02 * turns.max()]
    low, high = (float(np.quantile(turns, q)) for q in (rng.uniform(0.3, 0.45), rng.uniform(0.5, 0.65)))
    hertz, tau = min(float(rng.uniform(0.7, 2.0)), world.machine.rate / 10), float(rng.uniform(0.7, 1.8))

    def swinging(v: Float1D) -> Float1D:
        gear = relay(v, low, high)
        time = since(np.r_[False, np.diff(gear) != 0], np.arange(len(v)) * dt)
        late = np.where(np.isfinite(time), time, 1e3)
        return (2 * gear - 1) * np.cos(2 * np.pi * hertz * late) * np.exp(-late / tau)

    return Law(per_part(world, lambda p: swinging(p.v_sp)))


DRIVES: Mapping[str, Concealed] = {
    **{
        f.__name__: Concealed(f, "plane", both_ways=True)
        for f in (
            loaded_ripple, swinging_bus, stepping_compensation, chopped_brake, doubled_gain, hot_magnets,
        )
    },
    **{f.__name__: Concealed(f, "plane") for f in (wound_up, switched_filter)},
    **{f.__name__: Concealed(f, "sp", both_ways=True) for f in (weak_field, second_gear)},
}  # fmt: skip
