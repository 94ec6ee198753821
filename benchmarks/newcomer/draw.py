"""One case: a plant, its parts, what its simulation conceals, drawn until it is fair.

In:  a `Task`, whose seed decides everything. Out: a `Case`.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.newcomer import fair
from benchmarks.newcomer.assembly import (
    Case,
    assemble,
    draw_noises,
    fitted,
    logged,
    moving,
    require_plausible,
    sizes,
)  # fmt: skip
from benchmarks.newcomer.catalogue import CONCEALED
from benchmarks.newcomer.editions import EDITIONS, OUTSIDE
from benchmarks.newcomer.faults import MAKERS, thinned
from benchmarks.newcomer.machines import draw_machine
from benchmarks.newcomer.noise import Noise
from benchmarks.newcomer.parts import Length, Part, draw_parts
from benchmarks.newcomer.second.textbook import require_beyond, textbook
from benchmarks.newcomer.world import Columns, Concealed, Law, World, draw_terms, driver, simulate, terms_of
from benchmarks.sealed_truth import Effect, Task, UnfairError, require_fair
from pido.core.arrays import Float1D, Float2D
from pido.core.axes import AXES

_log = logging.getLogger(__name__)

MOST_DRAWS = 200
MOST_BOXES = 40


def draw_case(task: Task, length: Length | None = None) -> Case:
    """UnfairError where no draw of the task's seed is fair. length : if not that of the machine's kind"""
    for attempt in range(MOST_DRAWS):
        rng = np.random.default_rng([task.seed, attempt, sum(map(ord, task.group + task.what))])
        try:
            return _draw(task, length, rng)
        except UnfairError as why:
            _log.debug("%s, %s: %s", task.group, task.what, why)
    raise UnfairError(f"{task.group}, {task.what}, seed {task.seed}: none of {MOST_DRAWS} draws is fair.")


@dataclass(frozen=True, eq=False)
class _Scene:
    """A plant whose simulation has every term. parts : at the logged samples"""

    task: Task
    world: World
    parts: Sequence[Part]
    noises: dict[str, Noise]
    rng: np.random.Generator

    @property
    def concealed(self) -> Mapping[str, Concealed]:
        return EDITIONS[self.task.edition].concealed

    def without(self, axis: str, term: str) -> _Scene:
        """The simulation leaves a term of one axis out, if it has it."""
        terms = {a: {n: k for n, k in of.items() if (a, n) != (axis, term)} for a, of in self.world.terms.items()}
        return _Scene(self.task, simulate(self.world.parts, terms), self.parts, self.noises, self.rng)

    def rivals(self, axis: str) -> dict[str, Float2D]:
        return fair.rivals(self.parts, {axis: logged(self.world.machine, self.world.sim[axis])}, axis)

    def case(self, effects: Sequence[Effect], noises: dict[str, Noise] | None = None) -> Case:
        return assemble(self.task, self.world, self.parts, effects, noises or self.noises, self.rng, {})


def _draw(task: Task, length: Length | None, rng: np.random.Generator) -> Case:
    kinds = EDITIONS[task.edition].kinds
    machine = draw_machine(kinds[int(rng.integers(len(kinds)))], rng)
    straight = task.group == "confounded"
    parts = draw_parts(machine, length or Length(machine.kind.parts, machine.kind.seconds), straight, rng)
    require_fair(sum(float(np.abs(p.v).sum()) > 0 for p in parts) == len(parts), "a part stands still")
    world = simulate(parts, draw_terms(parts, rng))
    shown = thinned(parts)
    scene = _Scene(task, world, shown, draw_noises(world, shown, rng), rng)
    return {
        "single": _single, "pair": _pair, "wrong coefficient": _wrong, "data fault": _fault,
        "confined to a region": _region, "outside the vocabulary": _outside, "confounded": _confounded,
        "clean": lambda s: s.case([]),
    }[task.group](scene)  # fmt: skip


def _an_axis(scene: _Scene, name: str) -> str:
    return str(scene.rng.choice(scene.concealed[name].axes(scene.world.machine)))


def _scaled(
    scene: _Scene,
    axis: str,
    name: str,
    law: Law,
    laws: Mapping[str, Float2D] | None = None,
    as_kind: tuple[str, str] | None = None,
) -> Effect:
    """An effect of the task's strength, if it can be seen and told from every plain rival, if there are any."""
    at_log = logged(scene.world.machine, law.columns)
    fair.require_seen(at_log)
    size, beside = sizes(at_log, scene.noises[axis])
    scale = scene.task.strength * beside / size
    if (CONCEALED.get(name) or OUTSIDE[name]).both_ways:
        scale *= float(scene.rng.choice([-1.0, 1.0]))
    if laws:
        effect = scale * np.concatenate(at_log)
        fair.require_told(name, effect, beside, scene.noises[axis].independent, laws)
    parameters = {n: (scale * v, unit) for n, (v, unit) in law.sizes.items()} | dict(law.fixed)
    mechanism, kind = as_kind or (name, "missing_physics")
    columns: list[Float1D] = [scale * c for c in law.columns]
    shape = {"law": name, **law.shape} if mechanism != "unknown" else dict(law.shape)
    return Effect(axis, mechanism, kind, columns, parameters, shape, scene.task.strength)


def _single(scene: _Scene) -> Case:
    name = scene.task.what
    axis = _an_axis(scene, name)
    scene = scene.without(axis, name)
    law = scene.concealed[name].law(scene.world, axis, scene.rng)
    return scene.case([_scaled(scene, axis, name, law, scene.rivals(axis))])


def _pair(scene: _Scene) -> Case:
    """Two of them, on one axis or on two; on one axis they do not look alike."""
    names = scene.task.what.split(" and ")
    axes = [_an_axis(scene, n) for n in names]
    if axes[0] in scene.concealed[names[1]].axes(scene.world.machine) and scene.rng.random() < 0.5:
        axes[1] = axes[0]
    for axis, name in zip(axes, names, strict=True):
        scene = scene.without(axis, name)
    laws = [scene.concealed[n].law(scene.world, a, scene.rng) for n, a in zip(names, axes, strict=True)]
    effects = [_scaled(scene, a, n, law, scene.rivals(a)) for a, n, law in zip(axes, names, laws, strict=True)]
    if axes[0] == axes[1]:
        one, two = (np.concatenate(list(e.columns)) for e in effects)
        alike = abs(float(one @ two)) / max(float(np.sqrt((one @ one) * (two @ two))), 1e-300)
        require_fair(alike <= 0.7, "the two effects look alike")
    return scene.case(effects)


def _wrong(scene: _Scene) -> Case:
    """The simulation has the term with a coefficient that is off; what is missing is the difference."""
    name, rng, machine = scene.task.what, scene.rng, scene.world.machine
    having = [a for a in AXES if name in terms_of(a, machine)]
    require_fair(bool(having), "this simulation has no such term")
    axis = str(rng.choice(having))
    right = scene.world.terms[axis][name]
    error = float(np.exp(rng.uniform(np.log(0.03), np.log(0.6)))) * float(rng.choice([-1.0, 1.0]))
    terms = {a: dict(of) for a, of in scene.world.terms.items()}
    terms[axis][name] = right * (1 - error)
    world = simulate(scene.world.parts, terms)
    columns = [error * right * driver(p, axis, name) for p in world.parts]
    at_log = logged(machine, columns)
    fair.require_seen(at_log)
    noises = scene.noises | {axis: fitted(at_log, scene.noises[axis], scene.task.strength)}
    require_plausible(world, axis, noises[axis])
    beside = sizes(at_log, noises[axis])[1]
    laws = fair.rivals(scene.parts, {axis: logged(machine, world.sim[axis])}, axis)
    fair.require_told(name, np.concatenate(at_log), beside, noises[axis].independent, laws)
    effect = Effect(axis, f"miscalibrated:{name}", "miscalibrated", columns, {"error": (error, "–")},
                    {"law": name, "coefficient": right}, scene.task.strength)  # fmt: skip
    return assemble(scene.task, world, scene.parts, [effect], noises, rng, {})


def _fault(scene: _Scene) -> Case:
    fault = MAKERS[scene.task.what](scene.world, scene.rng)
    machine, strength, noises = scene.world.machine, scene.task.strength, scene.noises
    first = next(iter(fault.by))
    at_log = {a: logged(machine, c) for a, c in fault.by.items()}
    fair.require_seen(at_log[first])
    by, parameters = dict(fault.by), dict(fault.parameters)
    size, beside = sizes(at_log[first], noises[first])
    if fault.free:
        scale = strength * beside / size
        by = {a: [scale * x for x in c] for a, c in by.items()}
        more = 1.0 if "gain" in parameters else 0.0
        parameters = {n: (more + scale * value, unit) for n, (value, unit) in parameters.items()}
        require_fair("gain" not in parameters or 0.02 <= scale <= 0.6, "a gain that nobody would have")
    else:
        require_fair(size >= beside, "hidden in the noise")
    effects = [
        Effect(a, scene.task.what, "data_fault", c, parameters, {"law": scene.task.what, **fault.shape},
               _strength(logged(machine, c), noises[a]))
        for a, c in by.items()
    ]  # fmt: skip
    shown = thinned(fault.world.parts)
    return assemble(scene.task, fault.world, shown, effects, noises, scene.rng, fault.limits)


def _strength(columns: Columns, noise: Noise) -> float:
    """What it came to; 0 on an axis where it does nothing."""
    if not any(c.any() for c in columns[:-1]):
        return 0.0
    size, beside = sizes(columns, noise)
    return size / beside


def _region(scene: _Scene) -> Case:
    """A law that holds in a box of (v_x, v_y, AR) only, or another region; the simulation has none of it."""
    name, rng = scene.task.what, scene.rng
    axis = _an_axis(scene, name)
    scene = scene.without(axis, name)
    law = scene.concealed[name].law(scene.world, axis, rng)
    parts, machine = scene.world.parts, scene.world.machine
    free = np.concatenate(list(law.columns))
    moves, laws = moving(parts), scene.rivals(axis)
    region = EDITIONS[scene.task.edition].region
    for _ in range(MOST_BOXES):
        inside, said = region(parts, rng)
        columns = [c * i for c, i in zip(law.columns, inside, strict=True)]
        try:
            fair.require_confined(free, np.concatenate(inside), moves)
            boxed = Law(columns, law.sizes, law.fixed, {**law.shape, **said})
            here = np.concatenate([i[:: machine.fine] for i in inside])[:, None]
            # in such a box a plain rival may say the same (one direction only, say), though it does not outside
            effect = _scaled(scene, axis, name, boxed, {n: x * here for n, x in laws.items()})
            at_log = np.concatenate(logged(machine, effect.columns))
            whole = np.concatenate(logged(machine, law.columns))[:, None]
            require_fair(fair.explained(at_log, whole) <= 0.75, "much the same without its box")
            return scene.case([effect])
        except UnfairError as why:
            _log.debug("%s, box: %s", name, why)
    raise UnfairError("no box is fair")


def _outside(scene: _Scene) -> Case:
    machine, outside = scene.world.machine, EDITIONS[scene.task.edition].outside[scene.task.what]
    axis = str(scene.rng.choice(outside.axes(machine)))
    law = outside.law(scene.world, axis, scene.rng)
    effect = _scaled(scene, axis, scene.task.what, law, as_kind=("unknown", "unexplained"))
    at_log = np.concatenate(logged(machine, effect.columns))
    fair.require_foreign(at_log, scene.rivals(axis))
    if EDITIONS[scene.task.edition].textbook:
        require_beyond(at_log, textbook(scene.parts, {axis: logged(machine, scene.world.sim[axis])}, axis))
    return scene.case([effect])


def _confounded(scene: _Scene) -> Case:
    """On one line every motion of one axis is a motion of the other: the truth is one of two that nobody can tell."""
    name, machine, rng = scene.task.what, scene.world.machine, scene.rng
    axis = "xyz"[int(rng.choice(machine.kind.plane[:2]))]
    scene = scene.without(axis, name)
    law = scene.concealed[name].law(scene.world, axis, rng)
    effect = _scaled(scene, axis, name, law)
    laws = scene.rivals(axis)
    rivals = [n for n in ("axis_coupling", "viscous_friction", "coulomb_friction", "inertia") if n != name]
    there = {n: max(fair.explained(np.concatenate(logged(machine, effect.columns)), laws[m]) for m in laws
                    if m.startswith(n)) for n in rivals}  # fmt: skip
    twin = max(there, key=lambda n: there[n])
    require_fair(there[twin] >= 0.95, "the two can be told after all")
    shape = {**effect.shape, "goes_with": twin}
    return scene.case([Effect(axis, name, effect.kind, effect.columns, effect.parameters, shape, effect.strength)])
