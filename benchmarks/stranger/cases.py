"""One sealed case: a plant, its parts, the simulation, what it conceals, and the recorded currents.

In:  a `Task`. Out: a `Case`, drawn again until it is fair (`fairness`); the same task gives the same case.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from benchmarks.sealed_truth import Case, Effect, Task, UnfairError, require_fair
from benchmarks.stranger import faults
from benchmarks.stranger.effects import SINGLES, axes_of, concealed_by
from benchmarks.stranger.fairness import (
    MOST_EXPLAINED,
    Rivals,
    acting,
    apart,
    best_rival,
    explained,
    outside_enough,
    rivals,
    sampled,
    undecidable,
    varies,
)
from benchmarks.stranger.law import Law, World
from benchmarks.stranger.machine import Plant, draw_plant
from benchmarks.stranger.outside import OUTSIDE
from benchmarks.stranger.parts import TERMS, Part, draw_terms, make_parts
from benchmarks.stranger.sealed import Noise, assemble, lagged, simulated
from pido.core.arrays import Float1D
from pido.core.axes import AXES, LINEAR_AXES
from pido.core.errors import PidoError

STRENGTHS = (0.5, 1.0, 2.0, 4.0)
SHARES = {
    "single": 20,
    "pair": 6,
    "clean": 6,
    "wrong coefficient": 5,
    "data fault": 4,
    "confined to a region": 4,
    "outside the vocabulary": 3,
    "confounded": 2,
}
"""Of 50 cases."""
ATTEMPTS = 80
CONFINED = (
    "viscous_friction", "inertia", "cutting_force", "load_dependent_friction", "coulomb_friction", "axis_coupling",
    "spindle_viscous_drag", "spindle_windage", "spindle_torque_load",
)  # fmt: skip
NO_PAIR = ("presliding_hysteresis", "standstill_friction", "coulomb_friction")
"""Of these no two in a pair: what the first adds is the other two together."""
EITHER_SIGN = (
    "axis_coupling", "friction_asymmetry", "position_dependent_friction", "thermal_drift", "external_force",
    "material_hard_zone", "gravity_load", "sensor_offset", "sensor_gain",
)  # fmt: skip
MENU: Mapping[str, Sequence[str]] = {
    "single": tuple(SINGLES),
    "pair": ("",),
    "clean": ("",),
    "wrong coefficient": tuple(TERMS),
    "data fault": ("time_misalignment", "sensor_gain", "sensor_offset", "sensor_clipping", "input_fault"),
    "confined to a region": CONFINED,
    "outside the vocabulary": tuple(OUTSIDE),
    "confounded": ("viscous_friction", "inertia", "axis_coupling", "coulomb_friction"),
}


@dataclass(frozen=True)
class Size:
    """How much is recorded. parts, seconds : ranges (low, high) of the shown parts"""

    parts: tuple[int, int] = (4, 8)
    seconds: tuple[float, float] = (40.0, 120.0)


def plan(cases: int, seed: int) -> list[Task]:
    """`cases` tasks: SHARES in drawn order, in each group through its MENU and the strengths in turn."""
    rng = np.random.default_rng(seed)
    menu = {group: list(rng.permutation(what)) for group, what in MENU.items()}
    met = dict.fromkeys(SHARES, 0)
    tasks: list[Task] = []
    while len(tasks) < cases:
        for group in rng.permutation([g for g, n in SHARES.items() for _ in range(n)]):
            turn = met[group]
            met[group] += 1
            again, at = divmod(turn, len(menu[group]))
            what, strength = str(menu[group][at]), STRENGTHS[(at + again) % len(STRENGTHS)]
            tasks.append(Task(str(group), what, strength, int(rng.integers(2**31))))
    return tasks[:cases]


def draw_case(task: Task, size: Size | None = None) -> Case:
    """The first fair draw of a task. PidoError where there is none."""
    why = []
    for attempt in range(ATTEMPTS):
        try:
            return _draw(task, size or Size(), np.random.default_rng([task.seed, attempt]))
        except UnfairError as unfair:
            why.append(str(unfair))
    raise PidoError(f"{task.group}, case {task.key}: no fair draw in {ATTEMPTS}: {', '.join(sorted(set(why)))}.")


def _draw(task: Task, size: Size, rng: np.random.Generator) -> Case:
    plant = draw_plant(rng)
    if task.what == "input_fault":
        plant = replace(plant, lag_s=())
    axis, mechanisms = _chosen(task, plant, rng)
    lengths = rng.uniform(*size.seconds, int(rng.integers(size.parts[0], size.parts[1] + 1)) + 1)
    parts = make_parts(plant, lengths.tolist(), task.group == "confounded", rng)
    concealed = () if task.group == "wrong coefficient" else [c for m in mechanisms for c in concealed_by(m)]
    terms = {
        a: draw_terms(parts, a, concealed if a == axis else (), (*mechanisms, "coulomb_friction"), rng) for a in AXES
    }
    world = World(parts, {a: [simulated(p, a, terms[a]) for p in parts] for a in AXES})
    noise = {a: _noises(world, a, rng) for a in AXES}
    if task.what in ("time_misalignment", "sensor_clipping", "input_fault"):
        return faults.draw(task, world, terms, noise, axis, rng)
    effects = _effects(task, world, axis, mechanisms, terms[axis], noise, rng) if mechanisms else []
    return assemble(task, world, effects, noise, rng)


def _chosen(task: Task, plant: Plant, rng: np.random.Generator) -> tuple[str, tuple[str, ...]]:
    """(axis, mechanisms) that a task is about."""
    if task.group == "clean":
        return "", ()
    if task.group == "pair":
        axis = str(rng.choice(AXES, p=[0.3, 0.3, 0.15, 0.25]))
        able = [m for m in SINGLES if axis in axes_of(m, plant.vertical)]
        both = tuple(str(m) for m in rng.choice(able, 2, replace=False))
        if sum(m in NO_PAIR for m in both) == 2:
            raise UnfairError("a pair that is a third")
        return axis, both
    if task.group == "outside the vocabulary":
        return str(rng.choice(OUTSIDE[task.what][1])), (task.what,)
    if task.group == "confounded":
        return str(rng.choice(["x", "y"])), (task.what,)
    if task.group == "wrong coefficient":
        where = {"gravity_load": (plant.vertical,)}.get(task.what, LINEAR_AXES)
        return str(rng.choice(("sp",) if task.what.startswith("spindle") else where)), (task.what,)
    if task.what == "input_fault":
        return str(rng.choice(LINEAR_AXES)), (task.what,)
    if task.group == "data fault":
        return str(rng.choice([a for a in AXES if a != plant.vertical or task.what != "sensor_offset"])), (task.what,)
    return str(rng.choice(axes_of(task.what, plant.vertical))), (task.what,)


def _noises(world: World, axis: str, rng: np.random.Generator) -> Noise:
    """White, a little of it coloured, at least the converter's step; louder in the cut or at speed in some plants."""
    plant, i = world.parts[0].plant, AXES.index(axis)
    sim = sampled(world, world.sim[axis])
    step = 1.6 * 2 * float(np.abs(sim).max()) / 2**plant.bits
    level = max(plant.noise[i] * float(np.sqrt(np.mean(sim**2))), 0.7 * step)
    share, keep = plant.colour
    (what, more), rows = plant.restless, []
    for p in world.parts:
        n = len(p.t[:: plant.fine])
        slow = lfilter([np.sqrt(1 - keep**2)], [1, -keep], rng.normal(size=n))
        unit = np.sqrt(1 - share) * rng.normal(size=n) + np.sqrt(share) * slow
        speed = np.abs(p.speed(axis)[:: plant.fine])
        drive = {"cut": p.engaged[:: plant.fine] * 1.0, "speed": speed / max(speed.max(), 1e-9)}.get(what, 0.0)
        rows.append(level * unit * (1 + more * drive))
    return Noise(rows, step, 1 + 2 * share * keep / (1 - keep))


def _effects(
    task: Task,
    world: World,
    axis: str,
    mechanisms: Sequence[str],
    terms: Mapping[str, float],
    noise: Mapping[str, Noise],
    rng: np.random.Generator,
) -> list[Effect]:
    """Scaled to their strength, and fair."""
    known = rivals(world, axis)
    drawn = [_law(task, world, axis, m, terms, rng) for m in mechanisms]
    effects = [_scaled(task, world, axis, m, law, noise[axis], rng) for m, law in zip(mechanisms, drawn, strict=True)]
    own = () if task.group == "outside the vocabulary" else mechanisms
    flat = [sampled(world, e.columns) for e in effects]
    if task.group == "confounded":
        require_fair(_confounded(flat[0], known, mechanisms[0]), "not confounded")
        return effects
    for e, column in zip(effects, flat, strict=True):
        reason = undecidable(world, column, e.strength, noise[axis].length, known, own)
        require_fair(not reason, reason)
        require_fair(e.mechanism == "external_force" or acting(e.columns[-1]).mean() > 0.005, "not in the unseen part")
    if len(flat) == 2:
        require_fair(apart(*flat), "the two are alike")
    if task.group == "outside the vocabulary":
        require_fair(outside_enough(flat[0], known), "near the vocabulary")
    if task.group == "confined to a region":
        require_fair(_confined(flat[0], known, mechanisms[0]), "not confined")
    if task.group == "wrong coefficient":
        require_fair(abs(effects[0].parameters["error"][0]) < 0.8, "a coefficient that is absurd")
    return effects


def _confounded(effect: Float1D, known: Rivals, own: str) -> bool:
    """One rival cannot be told from it, and no other comes near."""
    share, rival = best_rival(effect, known, (own,))
    return share > MOST_EXPLAINED and best_rival(effect, known, (own, rival))[0] < MOST_EXPLAINED


def _confined(effect: Float1D, known: Rivals, own: str) -> bool:
    """Driven by more than a constant, not the law everywhere, and no difference between directions."""
    both = [np.column_stack([f, np.abs(f)]) for name in ("coulomb_friction", "viscous_friction")
            for f in known.get(name, ())]  # fmt: skip
    everywhere = max(explained(effect, form) for form in known[own])
    sided = max([explained(effect, b) for b in both], default=0.0)
    return varies(effect, acting(effect)) and everywhere < 0.9 and sided < MOST_EXPLAINED


def _law(
    task: Task, world: World, axis: str, mechanism: str, terms: Mapping[str, float], rng: np.random.Generator
) -> Law:
    if task.group == "wrong coefficient":
        if mechanism not in terms:
            raise UnfairError("the simulation has no such term")
        k = terms[mechanism]
        return Law(
            [simulated(p, axis, {mechanism: k}) for p in world.parts], {"error": (1.0, "–")}, shape={"coefficient": k}
        )
    if mechanism == "sensor_gain":
        return Law(world.sim[axis], {"gain": (1.0, "–")})
    if mechanism == "sensor_offset":
        return Law(world.each(lambda p: np.ones(len(p.t))), {"offset": (1.0, "A")})
    law = (OUTSIDE if task.group == "outside the vocabulary" else SINGLES)[mechanism][0](world, axis, rng)
    return _boxed(world, law, rng) if task.group == "confined to a region" else law


def _boxed(world: World, law: Law, rng: np.random.Generator) -> Law:
    """The law inside a box of (v_x, v_y, AR): one or two of the three are bounded, by quantiles of where it acts."""
    names = rng.choice(["v_x", "v_y", "AR"], int(rng.integers(1, 3)), replace=False).tolist()
    acts = acting(sampled(world, law.columns))
    box: dict[str, list[float]] = {}
    for name in names:
        seen = sampled(world, world.each(lambda p, name=name: _driver(p, name)))[acts]
        require_fair(len(seen) > 50, "acts nowhere")
        low = rng.uniform(0.05, 0.5)
        box[name] = np.quantile(seen, [low, low + rng.uniform(0.3, 0.5)]).tolist()

    def inside(p: Part) -> Any:
        return np.all([(_driver(p, n) >= b[0]) & (_driver(p, n) <= b[1]) for n, b in box.items()], axis=0)

    columns = [c * inside(p) for c, p in zip(law.columns, world.parts, strict=True)]
    return replace(law, columns=columns, shape={**law.shape, "box": box})


def _driver(p: Part, name: str) -> Float1D:
    return p.area if name == "AR" else p.v[:, int(name == "v_y")]


def _scaled(
    task: Task, world: World, axis: str, mechanism: str, law: Law, noise: Noise, rng: np.random.Generator
) -> Effect:
    """Amplitude by strength: rms of the lagged effect over that of the noise, where the effect acts."""
    plant, step = world.parts[0].plant, world.parts[0].plant.fine
    shown = [lagged(plant, c)[::step] for c in law.columns[:-1]]
    flat = np.concatenate(shown)
    acts = acting(flat)
    require_fair(bool(acts.any()), "acts nowhere")
    masks = np.split(acts, np.cumsum([len(s) for s in shown])[:-1])
    size = task.strength * noise.rms(masks) / float(np.sqrt(np.mean(flat[acts] ** 2)))
    either = mechanism in EITHER_SIGN or task.group in ("wrong coefficient", "outside the vocabulary")
    size *= float(rng.choice([-1, 1])) if either else 1.0
    parameters = {name: (size * per + (name == "gain"), unit) for name, (per, unit) in law.scaled.items()}
    name, kind = {
        "wrong coefficient": (f"miscalibrated:{mechanism}", "miscalibrated"),
        "outside the vocabulary": ("unknown", "unexplained"),
        "data fault": (mechanism, "data_fault"),
    }.get(task.group, (mechanism, "missing_physics"))
    shape = {**law.shape, "law": mechanism}
    return Effect(axis, name, kind, [size * c for c in law.columns], {**parameters, **law.fixed}, shape, task.strength)
