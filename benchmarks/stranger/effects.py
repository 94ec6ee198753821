"""What a simulation may conceal: process, spindle, slow effects; and the list of all mechanisms.

In:  a `World`, an axis, a generator. Out: a `Law`. Friction and drive are in `friction`.

Sources: Altintas, Manufacturing Automation (2012), edge forces and drives; Archard (1953), wear.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.stranger import friction
from benchmarks.stranger.law import Draw, Law, World
from benchmarks.stranger.parts import Part
from pido.core.arrays import Float1D
from pido.core.axes import AXES, LINEAR_AXES


def _cutting(world: World, axis: str, rng: np.random.Generator) -> Law:
    return Law(world.each(lambda p: p.load(axis)), {"k": (1.0, "A/N")})


def along_feed(p: Part, axis: str) -> Float1D:
    """(n,): the feed's direction cosine; 1 for the spindle."""
    if axis == "sp":
        return np.ones(len(p.t))
    speed = np.linalg.norm(p.v, axis=1)
    return np.divide(p.speed(axis), speed, out=np.zeros(len(speed)), where=speed > 1e-6)


def _edge(world: World, axis: str, rng: np.random.Generator) -> Law:
    return Law(world.each(lambda p: p.edge * along_feed(p, axis)), shape={"unit": "A/mm of engaged edge"})


def _wear(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Archard: load times what the edge has cut, by volume or by time."""
    if rng.random() < 0.65:
        columns = world.each(lambda p: p.load(axis) * p.volume / 1e4)
        return Law(columns, {"k": (1.0, "A per N (spindle: N·m) and 10 cm³")}, shape={"form": "volume"})
    return Law(world.each(lambda p: p.load(axis) * p.cut_s), shape={"form": "time"})


def _hard_zone(world: World, axis: str, rng: np.random.Generator) -> Law:
    """A disc, a strip or a soft-edged inclusion around a place of the workpiece."""
    form, turn = str(rng.choice(["disc", "strip", "soft"])), rng.uniform(0, np.pi)
    places = np.concatenate([(p.pos - p.center)[p.engaged][:, :2] for p in world.shown])
    if not len(places):
        return Law(world.each(lambda p: np.zeros(len(p.t))))
    middle = places[rng.integers(len(places))]
    R = float(np.quantile(np.linalg.norm(places - middle, axis=1), rng.uniform(0.2, 0.4)))

    def inside(p: Part) -> Float1D:
        xy = (p.pos - p.center)[:, :2] - middle
        if form == "strip":
            return 1.0 * (np.abs(xy @ [np.cos(turn), np.sin(turn)]) < 0.6 * R)
        r = np.linalg.norm(xy, axis=1)
        return 1.0 * (r < R) if form == "disc" else np.exp(-((r / R) ** 2))

    return Law(world.each(lambda p: p.load(axis) * inside(p)), shape={"form": form, "middle_mm": middle.tolist()})


def _coolant(world: World, axis: str, rng: np.random.Generator) -> Law:
    return Law(world.each(lambda p: p.coolant), {"k": (1.0, "A")})


def _drag(world: World, axis: str, rng: np.random.Generator) -> Law:
    return Law(world.each(lambda p: p.v_sp), {"k": (1.0, "A·s/deg")})


def _windage(world: World, axis: str, rng: np.random.Generator) -> Law:
    return Law(world.each(lambda p: p.v_sp * np.abs(p.v_sp)), {"k": (1.0, "A·s²/deg²")})


def _spindle_inertia(world: World, axis: str, rng: np.random.Generator) -> Law:
    return Law(world.each(lambda p: p.a_sp), {"J": (1.0, "A·s²/deg")})


def _torque(world: World, axis: str, rng: np.random.Generator) -> Law:
    return Law(world.each(lambda p: p.m), {"k": (1.0, "A/(N·m)")})


def _thermal(world: World, axis: str, rng: np.random.Generator) -> Law:
    """First order since the machine was switched on: a load that fades or grows, or a friction that fades."""
    end = world.shown[-1].start + world.shown[-1].t[-1]
    tau, form = float(end * rng.uniform(0.15, 0.5)), str(rng.choice(["fades", "grows", "friction"]))

    def column(p: Part) -> Float1D:
        left = np.exp(-(p.start + p.t) / tau)
        return {"fades": left, "grows": 1 - left, "friction": left * np.sign(p.speed(axis))}[form]

    fixed = {} if form == "friction" else {"tau_s": (tau, "s")}
    return Law(world.each(column), fixed=fixed, shape={"form": form})


def _saturation(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Above a bound the motor needs more current for its torque: linear from there, or quadratic."""
    power = int(rng.integers(1, 3))
    size = np.abs(np.concatenate([i[:: p.plant.fine] for i, p in zip(world.sim[axis], world.parts, strict=True)]))
    bound = float(np.quantile(size[size > 0], rng.uniform(0.7, 0.88))) if (size > 0).any() else 0.0
    columns = [np.maximum(np.abs(i) - bound, 0.0) ** power * np.sign(i) for i in world.sim[axis]]
    return Law(columns, shape={"power": power, "bound_A": bound})


def _external(world: World, axis: str, rng: np.random.Generator) -> Law:
    """Pulls over some seconds, in at least two of the shown parts and never in the unseen one."""
    columns = world.each(lambda p: np.zeros(len(p.t)))
    hit = rng.choice(len(world.shown), max(2, len(world.shown) // 2), replace=False)
    for k in hit:
        t = world.parts[k].t
        for _ in range(int(rng.integers(1, 3))):
            long = float(rng.uniform(0.04, 0.15) * t[-1])
            x = (t - rng.uniform(0, t[-1] - long)) / long
            columns[k] += ((x > 0) & (x < 1)) * (np.sin(np.pi * x) if rng.random() < 0.5 else 1.0)
    return Law(columns)


LINEAR, VERTICAL, BOTH, SPINDLE = "linear", "vertical", "both", "spindle"
SINGLES: Mapping[str, tuple[Draw, str]] = {
    "coulomb_friction": (friction.coulomb, LINEAR),
    "viscous_friction": (friction.viscous, LINEAR),
    "stribeck_friction": (friction.stribeck, LINEAR),
    "standstill_friction": (friction.standstill, LINEAR),
    "friction_asymmetry": (friction.asymmetry, LINEAR),
    "load_dependent_friction": (friction.load_dependent, LINEAR),
    "position_dependent_friction": (friction.position_dependent, LINEAR),
    "presliding_hysteresis": (friction.presliding, LINEAR),
    "backlash": (friction.backlash, LINEAR),
    "inertia": (friction.inertia, LINEAR),
    "gravity_load": (friction.gravity, VERTICAL),
    "axis_coupling": (friction.coupling, LINEAR),
    "torque_ripple": (friction.ripple, LINEAR),
    "cutting_force": (_cutting, LINEAR),
    "edge_force": (_edge, BOTH),
    "tool_wear": (_wear, BOTH),
    "material_hard_zone": (_hard_zone, BOTH),
    "coolant_load": (_coolant, BOTH),
    "spindle_viscous_drag": (_drag, SPINDLE),
    "spindle_windage": (_windage, SPINDLE),
    "spindle_inertia": (_spindle_inertia, SPINDLE),
    "spindle_torque_load": (_torque, SPINDLE),
    "thermal_drift": (_thermal, BOTH),
    "current_saturation": (_saturation, BOTH),
    "external_force": (_external, BOTH),
}
"""Mechanism -> its law, and the axes that it acts on."""


def axes_of(mechanism: str, vertical: str) -> tuple[str, ...]:
    """Axes that a mechanism of SINGLES may act on."""
    by = {LINEAR: LINEAR_AXES, VERTICAL: (vertical,), BOTH: AXES, SPINDLE: ("sp",)}
    return by[SINGLES[mechanism][1]]


CONCEALS: Mapping[str, tuple[str, ...]] = {
    "presliding_hysteresis": ("coulomb_friction", "stribeck_friction"),
}
"""Terms that a simulation must not have for a mechanism to be what is missing; else the mechanism itself."""


def concealed_by(mechanism: str) -> tuple[str, ...]:
    return CONCEALS.get(mechanism, (mechanism,))
