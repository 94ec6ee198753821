"""What is wrong with the data rather than with the physics: a clock, a sensor, an input.

In:  a world, the fault's name. Out: a `Fault`: what it adds to the currents, on which axes, and what is shown of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.newcomer.parts import Part
from benchmarks.newcomer.world import Columns, World, number, simulate
from pido.core.arrays import Float1D
from pido.core.axes import AXES, LINEAR_AXES


@dataclass(frozen=True, eq=False)
class Fault:
    """by : per axis the added columns, the axis that shows it best first; world : what is shown, if not the true one

    free : whether its size may be chosen to fit the noise, or is what it is; parameters : of a free one, at size one
    """

    by: Mapping[str, Columns]
    world: World
    parameters: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    shape: Mapping[str, Any] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)
    free: bool = False


def _late(world: World, rng: np.random.Generator) -> Fault:
    """The recording's clock is off by some samples, or gains as much in the course of each part."""
    machine, drifts = world.machine, bool(rng.random() < 0.35)
    delay = max(float(rng.uniform(2, 8)) / machine.rate, 0.01) * float(rng.choice([-1.0, 1.0]))

    def moved(t: Float1D, i: Float1D) -> Float1D:
        share = t / t[-1] if drifts else 1.0
        return np.interp(t - delay * share, t, i) - i

    by = {a: [moved(p.t, i) for p, i in zip(world.parts, world.sim[a], strict=True)] for a in AXES}
    parameters = {"delay": (delay, "s")}
    return Fault(_best_first(by, world), world, parameters, {"drift": drifts, "late": "recording"})


def _best_first(by: Mapping[str, Columns], world: World) -> dict[str, Columns]:
    def clear(a: str) -> float:
        varies = float(np.std(np.concatenate(list(world.sim[a]))))
        return float(np.std(np.concatenate(list(by[a])))) / max(varies, 1e-9)

    return {a: by[a] for a in sorted(by, key=clear, reverse=True)}


def _gain(world: World, rng: np.random.Generator) -> Fault:
    axis, sign = str(rng.choice(AXES)), float(rng.choice([-1.0, 1.0]))
    return Fault({axis: [sign * i for i in world.sim[axis]]}, world, {"gain": (sign, "–")}, free=True)


def _offset(world: World, rng: np.random.Generator) -> Fault:
    """Not on the axis that carries a weight, of which nobody could tell it."""
    axis = str(rng.choice([a for a in AXES if a != world.machine.kind.vertical]))
    sign = float(rng.choice([-1.0, 1.0]))
    return Fault({axis: [sign * np.ones(len(p.t)) for p in world.parts]}, world, {"offset": (sign, "A")}, free=True)


def _clipping(world: World, rng: np.random.Generator) -> Fault:
    axis = str(rng.choice(AXES))
    size = np.abs(np.concatenate(list(world.sim[axis])))
    limit = float(np.quantile(size[size > 0], rng.uniform(0.85, 0.96)))
    by = {axis: [np.clip(i, -limit, limit) - i for i in world.sim[axis]]}
    return Fault(by, world, {"limit": (limit, "A")}, limits={axis: limit})


def _input(world: World, rng: np.random.Generator) -> Fault:
    """Speed and acceleration of one axis freeze, vanish or spike now and then; the axis itself goes on."""
    axis, form = str(rng.choice(LINEAR_AXES)), str(rng.choice(["frozen", "spike", "dropout"]))
    k = number(axis)
    shown = [_spoiled(p, k, form, rng) for p in world.parts]
    wrong = simulate(shown, world.terms)
    by = {axis: [true - said for true, said in zip(world.sim[axis], wrong.sim[axis], strict=True)]}
    return Fault(by, wrong, shape={"form": form, "parts": list(range(len(shown)))})


def _spoiled(part: Part, k: int, form: str, rng: np.random.Generator) -> Part:
    """Intervals begin where the axis moves."""
    v, a = part.v.copy(), part.a.copy()
    moves = np.flatnonzero(np.abs(v[:, k]) > 0.2 * np.abs(v[:, k]).max())
    if not len(moves):
        return part
    fast, dt = float(np.abs(part.v[:, k]).max()), part.machine.dt
    for _ in range(int(rng.integers(2, 4)) * (5 if form == "spike" else 1)):
        begin = int(rng.choice(moves))
        long = max(float(rng.uniform(0.05, 0.3)), 3 / part.machine.rate) if form == "spike" else rng.uniform(2.0, 6.0)
        rows = slice(begin, begin + max(2, int(long / dt)))
        if form == "spike":
            v[rows, k] += fast * float(rng.uniform(0.8, 2.0)) * float(rng.choice([-1.0, 1.0]))
        else:
            v[rows, k] = part.v[begin, k] if form == "frozen" else 0.0
            a[rows, k] = 0.0
    return replace(part, v=v, a=a)


MAKERS: Mapping[str, Callable[[World, np.random.Generator], Fault]] = {
    "time_misalignment": _late,
    "sensor_gain": _gain,
    "sensor_offset": _offset,
    "sensor_clipping": _clipping,
    "input_fault": _input,
}


def thinned(parts: Sequence[Part]) -> list[Part]:
    return [p.thinned() for p in parts]
