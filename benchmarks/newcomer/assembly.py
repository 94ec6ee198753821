"""How a case's currents come about: recorded = simulation + effects + noise, rounded to the converter's steps.

A servo's lag, where a machine has one, passes over simulation and effects alike. In: a world and laws at the fine step.
Out: effects of a wanted strength, and the `Case` at the logged samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.newcomer.catalogue import CONCEALED
from benchmarks.newcomer.editions import OUTSIDE
from benchmarks.newcomer.fair import acting, split
from benchmarks.newcomer.machines import Machine
from benchmarks.newcomer.noise import Noise, draw_noise
from benchmarks.newcomer.parts import Part
from benchmarks.newcomer.world import Columns, World, lagged
from benchmarks.sealed_truth import Case, Effect, Task, require_fair
from pido.core.arrays import Bool1D, Float1D
from pido.core.axes import AXES

LEAST_NOISE, MOST_NOISE = 0.003, 0.3
"""Of a simulated current, where a case has its noise fitted to its effect, –."""


def logged(machine: Machine, columns: Columns) -> list[Float1D]:
    """Per part, behind the lag, at the samples of the log."""
    return [lagged(machine, c)[:: machine.fine] for c in columns]


def draw_noises(world: World, parts: Sequence[Part], rng: np.random.Generator) -> dict[str, Noise]:
    """Per axis, in proportion to how much its simulated current varies. parts : at the logged samples"""
    noises = {}
    for a in AXES:
        varies = float(np.std(np.concatenate(list(world.sim[a]))))
        size = world.machine.noise_share * max(varies, 0.2 * world.machine.amps[a])
        noises[a] = draw_noise(parts, a, size, rng)
    return noises


def sizes(columns: Columns, noise: Noise) -> tuple[float, float]:
    """(rms of an effect where it acts, rms of the noise there), A, over the parts that are shown."""
    masks = split(acting(np.concatenate(list(columns))), columns)[:-1]
    shown = np.concatenate([c[m] for c, m in zip(columns, masks, strict=False)])
    require_fair(len(shown) > 0, "acts in no part that is shown")
    return float(np.sqrt(np.mean(shown**2))), noise.rms(masks)


def fitted(columns: Columns, noise: Noise, strength: float) -> Noise:
    """The noise beside which an effect of given size has the wanted strength. columns : at the logged samples"""
    effect, beside = sizes(columns, noise)
    return noise.times(effect / strength / beside)


def require_plausible(world: World, axis: str, noise: Noise) -> None:
    """UnfairError where a fitted noise is none that a machine has."""
    rms = noise.rms([np.ones(len(r), bool) for r in noise.rows])
    share = rms / max(float(np.std(np.concatenate(list(world.sim[axis])))), 1e-12)
    require_fair(LEAST_NOISE <= share <= MOST_NOISE, "noise of no machine")


def assemble(
    task: Task,
    world: World,
    parts: Sequence[Part],
    effects: Sequence[Effect],
    noises: Mapping[str, Noise],
    rng: np.random.Generator,
    limits: Mapping[str, float],
) -> Case:
    """parts : as they are shown, at the logged samples; limits : per axis, A, beyond which the sensor shows no more"""
    machine = world.machine
    sim = {a: logged(machine, world.sim[a]) for a in AXES}
    effect = {a: [np.zeros(len(i)) for i in sim[a]] for a in AXES}
    for e in effects:
        effect[e.axis] = [had + c for had, c in zip(effect[e.axis], logged(machine, e.columns), strict=True)]
    recorded = {}
    for a in AXES:
        step, most = noises[a].step, limits.get(a, np.inf)
        # what a limit takes away is the effect of that limit: it is in `effect` for the truth and is not taken twice
        beside = [np.zeros_like(x) for x in effect[a]] if a in limits else effect[a]
        recorded[a] = [
            np.clip(np.round((s + e + n) / step) * step, -most, most)
            for s, e, n in zip(sim[a], beside, noises[a].rows, strict=True)
        ]
    needs, known = {task.what, *(str(e.shape.get("law", e.mechanism)) for e in effects)}, {**CONCEALED, **OUTSIDE}
    facts, bare = any(known[n].facts for n in needs if n in known) or "sensor_offset" in needs, machine.kind.bare
    require_fair(not (facts and bare), "a log that does not say what is needed")
    rich = not bare and (facts or bool(rng.random() < 0.5))
    optional = ("nc_line", "tool_id", "coolant")
    columns = [name for name in optional if not bare and (rich or rng.random() < 0.5)]
    if machine.kind.sim_step:
        sim = {a: _told(sim[a], machine.kind.sim_step * machine.amps[a]) for a in AXES}
    return Case(task, parts, sim, recorded, effect, effects, rich, columns, int(rng.integers(2**31)))


def _told(columns: Columns, step: float) -> list[Float1D]:
    """As a simulation writes its currents down that counts in steps, A."""
    return [np.round(c / step) * step for c in columns]


def moving(parts: Sequence[Part]) -> Bool1D:
    return np.concatenate([p.speed > 1e-3 for p in parts])
