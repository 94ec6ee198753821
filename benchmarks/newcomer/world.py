"""What a simulation says of a series of parts, and what helps to write a law down.

In:  parts, per axis which terms the simulation has. Out: a `World` with the simulated currents, before any lag.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.signal import lfilter

from benchmarks.newcomer.machines import Machine
from benchmarks.newcomer.parts import Part
from pido.core.arrays import Float1D
from pido.core.axes import AXES, LINEAR_AXES

Columns = Sequence[Float1D]
"""Per part (n,)."""


@dataclass(frozen=True, eq=False)
class World:
    """terms : per axis the coefficient of each term, A per unit of its driver; sim : per axis and part (n,), A"""

    machine: Machine
    parts: Sequence[Part]
    terms: Mapping[str, Mapping[str, float]]
    sim: Mapping[str, Columns]


@dataclass(frozen=True, eq=False)
class Law:
    """A current of size one. sizes : parameters in proportion to the size: (value at one, unit); fixed : the others
    shape : what else a truth says of it
    """

    columns: Columns
    sizes: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    fixed: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    shape: Mapping[str, Any] = field(default_factory=dict)


Maker = Callable[[World, str, np.random.Generator], Law]
"""(world, axis) -> law."""


@dataclass(frozen=True)
class Concealed:
    """on : linear, vertical, plane, sp or any; facts : it needs part.json; both_ways : its sign may be either"""

    law: Maker
    on: str = "linear"
    facts: bool = False
    both_ways: bool = False

    def axes(self, machine: Machine) -> tuple[str, ...]:
        return {
            "linear": LINEAR_AXES, "vertical": (machine.kind.vertical,), "sp": ("sp",), "any": AXES,
            "plane": tuple(LINEAR_AXES[k] for k in machine.kind.plane[:2]),
        }[self.on]  # fmt: skip


def number(axis: str) -> int:
    return LINEAR_AXES.index(axis)


def per_part(world: World, of: Callable[[Part], Float1D]) -> list[Float1D]:
    return [np.asarray(of(p), float) for p in world.parts]


def direction(v: Float1D, width: float) -> Float1D:
    """(n,), –1 to 1: sign of a speed, v / sqrt(v² + width²).

    >>> direction(np.array([-2.0, 0.0, 3.0]), 4.0).round(3).tolist()
    [-0.447, 0.0, 0.6]
    """
    return np.sign(v) if width <= 0 else v / np.sqrt(v**2 + width**2)


def held(v: Float1D) -> Float1D:
    """(n,): sign of the last motion, 0 before the first.

    >>> held(np.array([0.0, 2.0, 0.0, -1.0, 0.0])).tolist()
    [0.0, 1.0, 1.0, -1.0, -1.0]
    """
    last = np.maximum.accumulate(np.where(v != 0, np.arange(len(v)), -1))
    return np.where(last >= 0, np.sign(v[np.maximum(last, 0)]), 0.0)


def since_reversal(v: Float1D, dt: float) -> tuple[Float1D, Float1D]:
    """(way, time), (n,), mm and s: since the sign of the motion changed; infinite before the first motion."""
    sign = held(v)
    changed = np.r_[False, np.diff(sign) != 0]
    last = np.maximum.accumulate(np.where(changed, np.arange(len(v)), -1))
    gone = np.cumsum(np.abs(v)) * dt
    start = np.maximum(last, 0)
    none = last < 0
    way = np.where(none, np.inf, gone - gone[start] + np.abs(v[start]) * dt)
    return way, np.where(none, np.inf, (np.arange(len(v)) - start) * dt)


def driver(part: Part, axis: str, term: str) -> Float1D:
    """(n,): what a coefficient of the simulation multiplies, from the columns that are shown."""
    if axis == "sp":
        return {
            "spindle_viscous_drag": part.v_sp,
            "spindle_windage": part.v_sp * np.abs(part.v_sp),
            "spindle_inertia": part.a_sp,
            "spindle_torque_load": part.m_sim,
        }[term]
    k = number(axis)
    v, machine = part.v[:, k], part.machine
    return {
        "coulomb_friction": lambda: direction(v, machine.sign_width[k]),
        "viscous_friction": lambda: v,
        "stribeck_friction": lambda: np.exp(-((v / machine.kind.v_s_mm_s) ** 2)) * direction(v, machine.sign_width[k]),
        "inertia": lambda: part.a[:, k],
        "cutting_force": lambda: machine.force_sign * part.f_sim[:, k],
        "gravity_load": lambda: np.ones_like(v),
    }[term]()


SHARES: Mapping[str, tuple[float, float]] = {
    "coulomb_friction": (0.6, 1.2), "viscous_friction": (0.3, 1.1), "inertia": (0.6, 2.5), "cutting_force": (0.4, 1.3),
    "gravity_load": (0.5, 2.0), "spindle_viscous_drag": (0.1, 0.4), "spindle_windage": (0.04, 0.25),
    "spindle_inertia": (0.4, 1.2), "spindle_torque_load": (0.3, 1.0), "stribeck_friction": (0.3, 1.2),
}  # fmt: skip
"""How large a term is where its driver is large, in an axis' friction, lowest and highest."""


def terms_of(axis: str, machine: Machine) -> tuple[str, ...]:
    """What a simulation of this axis has."""
    if axis == "sp":
        return tuple(t for t in SHARES if t.startswith("spindle"))
    weighs = ("gravity_load",) if axis == machine.kind.vertical else ()
    return ("coulomb_friction", "viscous_friction", "inertia", "cutting_force", *weighs, *machine.kind.also)


def draw_terms(parts: Sequence[Part], rng: np.random.Generator) -> dict[str, dict[str, float]]:
    """Coefficients of every term, from its size where its driver is large (95th percentile of where it is not 0)."""
    machine, terms = parts[0].machine, {}
    for axis in AXES:
        terms[axis] = {}
        for name in terms_of(axis, machine):
            size = np.abs(np.concatenate([driver(p, axis, name) for p in parts]))
            large = float(np.percentile(size[size > 0], 95)) if (size > 0).any() else 1.0
            sign = machine.force_sign if name == "cutting_force" else 1.0
            sign = float(rng.choice([-1.0, 1.0])) if name == "gravity_load" else sign
            part_of = machine.kind.slides if name == "coulomb_friction" else 1.0
            terms[axis][name] = (
                part_of
                * sign
                * machine.amps[axis]
                * float(rng.uniform(*machine.kind.shares.get(name, SHARES[name])))
                / large
            )
    return terms


def simulate(parts: Sequence[Part], terms: Mapping[str, Mapping[str, float]]) -> World:
    """The world with the terms that are left in its simulation."""
    sim = {
        a: [np.zeros(len(p.t)) + sum(k * driver(p, a, name) for name, k in terms[a].items()) for p in parts]
        for a in AXES
    }
    return World(parts[0].machine, parts, terms, sim)


def lagged(machine: Machine, values: Float1D, step: float | None = None) -> Float1D:
    """(n,): behind the servo, a second order of the machine's natural frequency and damping; from rest. step : s"""
    if machine.lag is None:
        return values
    w, zeta, dt = 2 * np.pi * machine.lag[0], machine.lag[1], step or machine.dt
    c = 2 / dt  # bilinear transform
    bottom = np.array([c**2 + 2 * zeta * w * c + w**2, 2 * w**2 - 2 * c**2, c**2 - 2 * zeta * w * c + w**2])
    b, a = w**2 * np.array([1.0, 2.0, 1.0]) / bottom[0], bottom / bottom[0]
    first = values[0]
    return lfilter(b, a, values - first) + first
