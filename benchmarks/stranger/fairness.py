"""Which cases can be decided at all: textbook columns of everything plausible on an axis, beside a concealed effect.

In:  a world, an axis, an effect's column on the shown parts. Out: shares of power (R², uncentred), and a verdict.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.stranger.effects import along_feed
from benchmarks.stranger.friction import across, bristles, last_direction, since_reversal, tool_mass
from benchmarks.stranger.law import Columns, World
from benchmarks.stranger.parts import Part, stribeck_speed
from pido.core.arrays import Bool1D, Float1D, Float2D
from pido.core.axes import AXES

MOST_EXPLAINED = 0.95
LEAST_T = 12.0
LEAST_T_BETWEEN = 6.0
"""t-ratio that is left of an effect when the best rival has taken its share: below, nobody could tell the two apart."""
LEAST_KEPT = 0.5
MOST_OUTSIDE = 0.7
LEAST_VARIED = 0.3

Rivals = Mapping[str, Sequence[Float2D]]
"""mechanism -> its forms, each (n, k): columns with an amplitude of their own"""


def sampled(world: World, columns: Columns) -> Float1D:
    """The recorded samples of the shown parts, one after the other."""
    return np.concatenate([c[:: p.plant.fine] for c, p in zip(columns, world.shown, strict=False)])


def rivals(world: World, axis: str) -> Rivals:
    """What could be claimed on an axis."""
    return _linear(world, axis) if axis != "sp" else _spindle(world)


def _matrix(world: World, *of: Columns) -> Float2D:
    return np.column_stack([sampled(world, c) for c in of])


def _common(world: World, axis: str) -> dict[str, list[Float2D]]:
    each, end = world.each, world.shown[-1].start + world.shown[-1].t[-1]
    sim = sampled(world, world.sim[axis])
    bounds = np.quantile(np.abs(sim), [0.6, 0.75, 0.9])
    return {
        "edge_force": [_matrix(world, each(lambda p: p.edge * along_feed(p, axis)))],
        "tool_wear": [_matrix(world, each(lambda p, w=w: p.load(axis) * getattr(p, w))) for w in ("volume", "cut_s")],
        "coolant_load": [_matrix(world, each(lambda p: p.coolant))],
        "thermal_drift": [
            _matrix(world, each(lambda p, s=share: np.exp(-(p.start + p.t) / (s * end)))) for share in (0.1, 0.3, 0.6)
        ],
        "current_saturation": [(np.maximum(np.abs(sim) - b, 0) * np.sign(sim))[:, None] for b in bounds],
        "sensor_gain": [sim[:, None]],
        "time_misalignment": [np.gradient(sim)[:, None]],
    }


def _spindle(world: World) -> Rivals:
    each, axis = world.each, "sp"
    return _common(world, axis) | {
        "coulomb_friction": [_matrix(world, each(lambda p: np.sign(p.v_sp)))],
        "spindle_viscous_drag": [_matrix(world, each(lambda p: p.v_sp))],
        "spindle_windage": [_matrix(world, each(lambda p: p.v_sp * np.abs(p.v_sp)))],
        "spindle_inertia": [_matrix(world, each(lambda p: p.a_sp))],
        "spindle_torque_load": [_matrix(world, each(lambda p: p.m))],
        "sensor_offset": [np.ones((len(sampled(world, world.sim[axis])), 1))],
    }


def _linear(world: World, axis: str) -> Rivals:
    i, plant, each = AXES.index(axis), world.shown[0].plant, world.each
    others = [k for k in range(3) if k != i]
    vertical = axis == plant.vertical
    one = np.ones((len(sampled(world, world.sim[axis])), 1))
    turning = 2 * np.pi / plant.lead[i]
    slow = stribeck_speed(plant)

    def held(p: Part) -> Float1D:
        return last_direction(p.v[:, i]) * (p.v[:, i] == 0)

    def freed(p: Part, gap: float) -> Float1D:
        return np.sign(p.v[:, i]) * np.exp(-since_reversal(p, axis)[0] / gap)

    return _common(world, axis) | {
        "coulomb_friction": [_matrix(world, each(lambda p: np.sign(p.v[:, i])))],
        "viscous_friction": [_matrix(world, each(lambda p: p.v[:, i]))],
        "stribeck_friction": [
            _matrix(world, each(lambda p, s=s: np.exp(-np.abs(p.v[:, i]) / (s * slow)) * np.sign(p.v[:, i])))
            for s in (0.2, 1.0, 4.0)
        ],
        "standstill_friction": [_matrix(world, each(held))],
        "friction_asymmetry": [
            _matrix(world, each(lambda p: np.abs(np.sign(p.v[:, i])))),
            _matrix(world, each(lambda p: np.abs(p.v[:, i]))),
        ],
        "load_dependent_friction": [_matrix(world, each(lambda p: across(p, axis) * np.sign(p.v[:, i])))],
        "position_dependent_friction": [_matrix(world, each(lambda p: _centred(p, i) * np.sign(p.v[:, i])))],
        "presliding_hysteresis": [
            _matrix(world, each(lambda p, s=s: bristles(p.v[:, i], plant.dt, s * plant.family.feed[0])))
            for s in (0.02, 0.1)
        ],
        "backlash": [_matrix(world, each(lambda p: freed(p, 0.04 * plant.family.feed[0])))],
        "inertia": [_matrix(world, each(lambda p: p.a[:, i]))],
        "axis_coupling": [
            _matrix(world, each(lambda p, j=j, f=f: f(p)[:, j]))
            for j in others
            for f in (lambda p: p.v, lambda p: p.a, lambda p: np.sign(p.v))
        ],
        "torque_ripple": [
            _matrix(
                world,
                each(lambda p, n=n: np.sin(n * turning * p.pos[:, i])),
                each(lambda p, n=n: np.cos(n * turning * p.pos[:, i])),
            )
            for n in (1, 2)
        ],
        "cutting_force": [_matrix(world, each(lambda p: p.f[:, i]))],
        "gravity_load" if vertical else "sensor_offset": [
            one,
            *([_matrix(world, each(tool_mass))] if vertical else []),
        ],
    }


def _centred(p: Part, i: int) -> Float1D:
    return (p.pos[:, i] - p.plant.travel[i] / 2) / p.plant.travel[i]


def explained(effect: Float1D, by: Float2D) -> float:
    """Share of the effect's power that columns explain, 0..1, without a constant.

    >>> round(explained(np.array([1.0, 1.0, 0.0]), np.array([[1.0], [0.0], [0.0]])), 6)
    0.5
    """
    scale = np.sqrt(np.mean(by**2, axis=0))
    used = by[:, scale > 0] / scale[scale > 0]
    power = float(effect @ effect)
    if power == 0 or not used.shape[1]:
        return 0.0
    fit = used @ np.linalg.lstsq(used, effect, rcond=None)[0]
    return float(1.0 - np.sum((effect - fit) ** 2) / power)


def best_rival(effect: Float1D, known: Rivals, own: Sequence[str]) -> tuple[float, str]:
    """(share, mechanism) of the single mechanism, not one of `own`, that explains most."""
    shares = [(explained(effect, form), name) for name, forms in known.items() if name not in own for form in forms]
    return max(shares)


def acting(effect: Float1D) -> Bool1D:
    """(n,): where an effect is more than a twentieth of its size (99.5 % quantile of what is not zero)."""
    size = np.abs(effect)
    if not size.any():
        return np.zeros(len(size), bool)
    return size > 0.05 * np.quantile(size[size > 0], 0.995)


def t_ratio(strength: float, n: int, correlation: float) -> float:
    """Effect over its standard error: strength sqrt(n / L), L the noise's autocorrelation length in samples."""
    return strength * np.sqrt(n / correlation)


def undecidable(
    world: World, effect: Float1D, strength: float, correlation: float, known: Rivals, own: Sequence[str]
) -> str:
    """Why an effect cannot be asked for; '' where it can.

    effect : (n,), samples of the shown parts, one after the other
    """
    acts = acting(effect)
    n = int(acts.sum())
    ends = np.cumsum([len(p.t[:: p.plant.fine]) for p in world.shown])[:-1]
    if sum(a.any() for a in np.split(acts, ends)) < 2 or n < 0.01 * len(acts):
        return "acts in too few parts or samples"
    t = t_ratio(strength, n, correlation)
    if t < LEAST_T:
        return "too weak"
    share, rival = best_rival(effect, known, own)
    if share > MOST_EXPLAINED or t * np.sqrt(1 - share) < LEAST_T_BETWEEN:
        return f"explained by {rival}"
    if "presliding_hysteresis" in own:
        pair = np.column_stack([known[name][0] for name in ("coulomb_friction", "standstill_friction")])
        if t * np.sqrt(1 - explained(effect, pair)) < LEAST_T_BETWEEN:
            return "no samples while the force builds up"
    return ""


def outside_enough(effect: Float1D, known: Rivals) -> bool:
    """Whether neither one mechanism nor all together (first form each) come near an effect."""
    together = np.column_stack([forms[0] for forms in known.values()])
    return best_rival(effect, known, ())[0] < MOST_OUTSIDE and explained(effect, together) < 0.9


def apart(one: Float1D, other: Float1D) -> bool:
    """Whether each of two effects keeps half of its power when the other is projected out."""
    return 1 - explained(one, other[:, None]) >= LEAST_KEPT


def varies(effect: Float1D, inside: Bool1D) -> bool:
    """Whether an effect is more than a constant where it acts."""
    held = effect[inside]
    return len(held) > 1 and float(np.std(held)) > LEAST_VARIED * float(np.sqrt(np.mean(held**2)))
