"""Cases in which not physics is missing but the data are wrong: clocks, clipping, signals.

In:  a task, a world, the simulation's terms, the noise. Out: the `Case`, or UnfairError.
Gain and offset of a sensor are scaled like any other effect, in `cases`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.sealed_truth import Case, Effect, Task, require_fair
from benchmarks.stranger.fairness import LEAST_T, t_ratio
from benchmarks.stranger.law import Columns, World
from benchmarks.stranger.parts import Part
from benchmarks.stranger.sealed import Noise, assemble, simulated
from pido.core.arrays import Bool1D, Float1D
from pido.core.axes import AXES, LINEAR_AXES

Terms = Mapping[str, Mapping[str, float]]


def draw(
    task: Task, world: World, terms: Terms, noise: Mapping[str, Noise], axis: str, rng: np.random.Generator
) -> Case:
    """A case of one of the three faults."""
    case = assemble(task, world, (), noise, rng)
    if task.what == "time_misalignment":
        return _late(case, noise, rng)
    if task.what == "sensor_clipping":
        return _clipped(case, axis, noise[axis], rng)
    return _wrong_input(case, terms, axis, noise[axis], rng)


def _effect(case: Case, axis: str, parameters: Mapping[str, tuple[float, str]], shape: Mapping[str, Any]) -> Effect:
    return Effect(axis, case.task.what, "data_fault", [], parameters, shape, case.task.strength)


def _late(case: Case, noise: Mapping[str, Noise], rng: np.random.Generator) -> Case:
    """The currents come late, or the simulation's columns do; by a constant, or more and more over each part."""
    plant, drift, side = case.parts[0].plant, bool(rng.random() < 0.3), str(rng.choice(["currents", "simulation"]))
    delay = float(rng.choice([-1, 1]) * rng.uniform(max(0.015, 0.8 / plant.rate), max(0.15, 3 / plant.rate)))

    def shifted(values: Float1D, t: Float1D) -> Float1D:
        return np.interp(t - delay * (t / t[-1] if drift else 1.0), t, values)

    true = {a: [shifted(s, p.t) for s, p in zip(case.sim[a], case.parts, strict=True)] for a in AXES}
    parts = case.parts
    if side == "simulation":
        sim, late = true, case.sim
        parts = [_process_of(p, shifted) for p in parts]
    else:
        sim, late = case.sim, true
    effect = {a: [x - s for x, s in zip(late[a], sim[a], strict=True)] for a in AXES}
    recorded = {a: [_rounded(x + n, noise[a]) for x, n in zip(late[a], noise[a].rows, strict=True)] for a in AXES}
    ratio = {a: _ratio(effect[a], noise[a]) for a in AXES}
    first = max(ratio, key=lambda a: ratio[a])
    n = sum(len(p.t) for p in parts[:-1])
    require_fair(t_ratio(ratio[first], n, noise[first].length) > LEAST_T, "too weak")
    shape = {"drift": drift, "late": side}
    order = [first, *(a for a in AXES if a != first)]
    effects = [replace(_effect(case, a, {"delay": (delay, "s")}, shape), strength=ratio[a]) for a in order]
    return replace(case, parts=parts, sim=sim, recorded=recorded, effect=effect, effects=effects)


def _process_of(part: Part, shifted: Any) -> Part:
    """The part with the simulation's process moved in time."""
    late = {name: shifted(getattr(part, name), part.t) for name in ("f_t", "m", "mrr")}
    return replace(part, f=np.column_stack([shifted(part.f[:, k], part.t) for k in range(3)]), **late)


def _rounded(values: Float1D, noise: Noise) -> Float1D:
    return np.round(values / noise.step) * noise.step


def _ratio(effect: Columns, noise: Noise) -> float:
    """rms over noise in the shown parts."""
    flat = np.concatenate(effect[:-1])
    return float(np.sqrt(np.mean(flat**2))) / noise.rms([slice(None)] * (len(effect) - 1))


def _clipped(case: Case, axis: str, noise: Noise, rng: np.random.Generator) -> Case:
    """A converter that ends at +-limit, on one of its steps."""
    sim = np.concatenate(case.sim[axis][:-1])
    require_fair(float(np.quantile(sim, 0.99)) > 0.5 * float(np.abs(sim).max()), "never near the upper limit")
    limit = float(np.floor(np.quantile(sim, rng.uniform(0.9, 0.98)) / noise.step) * noise.step)
    require_fair(limit > 10 * noise.step, "a limit within the noise")
    effect = [np.clip(s, -limit, limit) - s for s in case.sim[axis]]
    recorded = [np.clip(r, -limit, limit) for r in case.recorded[axis]]
    hit = [e != 0 for e in effect]
    n = int(np.concatenate(hit[:-1]).sum())
    require_fair(sum(h.mean() > 0.005 for h in hit[:-1]) >= 2 and n > 0.01 * len(sim), "clips too seldom")
    size = float(np.sqrt(np.mean(np.concatenate(effect[:-1])[np.concatenate(hit[:-1])] ** 2))) / noise.rms(hit[:-1])
    require_fair(size > 1 and t_ratio(size, n, noise.length) > LEAST_T, "too weak")
    found = replace(_effect(case, axis, {"limit": (limit, "A")}, {}), strength=size)
    return replace(
        case,
        recorded={**case.recorded, axis: recorded},
        effect={**case.effect, axis: effect},
        effects=[found],
    )


def _wrong_input(case: Case, terms: Terms, axis: str, noise: Noise, rng: np.random.Generator) -> Case:
    """A frozen speed, spikes of it, or a position counter that was set anew: the simulation has used it."""
    form, i = str(rng.choice(["frozen", "spikes", "counter"])), LINEAR_AXES.index(axis)
    parts, sim, effect = list(case.parts), list(case.sim[axis]), list(case.effect[axis])
    hit = rng.choice(len(parts) - 1, int(rng.integers(1, 3)), replace=False)
    for k in hit:
        part = parts[k]
        inside = _interval(part, i, rng)
        require_fair(bool(inside.any()), "never moves for long")
        parts[k] = _faulty(part, i, form, inside, rng)
        sim[k] = simulated(parts[k], axis, terms[axis])
        effect[k] = case.sim[axis][k] - sim[k]
        wrong = effect[k] != 0
        require_fair(bool(wrong.any()), "the simulation does not use it")
        here = [*(np.zeros(len(p.t), bool) for p in parts[:k]), wrong]
        far = float(np.sqrt(np.mean(effect[k][wrong] ** 2))) / noise.rms(here)
        require_fair(far > 2 and t_ratio(far, int(wrong.sum()), noise.length) > LEAST_T, "too weak")
    found = _effect(case, axis, {}, {"form": form, "parts": sorted(int(k) + 1 for k in hit)})
    return replace(
        case, parts=parts, sim={**case.sim, axis: sim}, effect={**case.effect, axis: effect}, effects=[found]
    )


def _interval(part: Part, i: int, rng: np.random.Generator) -> Bool1D:
    """One to four seconds in which the axis changes its speed, beginning in motion."""
    rate = part.plant.rate
    long = int(rng.uniform(1.0, 4.0) * rate)
    moving = np.flatnonzero(np.abs(part.v[: -long - 1, i]) > 0)
    inside = np.zeros(len(part.t), bool)
    if len(moving):
        start = int(rng.choice(moving))
        inside[start : start + long] = True
    return inside


def _faulty(part: Part, i: int, form: str, inside: Bool1D, rng: np.random.Generator) -> Part:
    pos, v = part.pos.copy(), part.v.copy()
    if form == "frozen":
        v[inside, i] = v[np.flatnonzero(inside)[0], i]
    elif form == "spikes":
        at = rng.choice(np.flatnonzero(inside), min(5, int(inside.sum())), replace=False)
        v[at, i] += rng.choice([-1, 1], len(at)) * rng.uniform(1.5, 4.0, len(at)) * np.abs(part.v[:, i]).max()
    else:
        first = int(np.flatnonzero(inside)[0])
        jump = float(rng.choice([-1, 1]) * rng.uniform(0.05, 0.3) * part.plant.travel[i])
        pos[first:, i] += jump
        v[first, i] += jump * part.plant.rate
    return replace(part, pos=pos, v=v)
