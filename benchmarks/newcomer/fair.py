"""Which draws can be decided at all; the others are drawn again.

In:  an effect at the logged samples, and the parts. Out: nothing, or UnfairError with the reason.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.newcomer.parts import Part
from benchmarks.newcomer.world import Columns, held, lagged, number, since_reversal
from benchmarks.sealed_truth import require_fair
from pido.core.arrays import Bool1D, Float1D, Float2D
from pido.core.axes import LINEAR_AXES

ENOUGH = 80.0
"""What a law must save against its best rival: squared error over squared noise, summed over independent rows."""

CONTAINS = {
    "friction_asymmetry": ("coulomb_friction", "viscous_friction"),
    "position_dependent_friction": ("coulomb_friction",),
    "thermal_drift": ("gravity_load",),
}
"""Laws that hold a simpler one as a special case: no rivals of that one."""

FOREIGN_SHARE = 0.6
"""Most of an effect outside the vocabulary that a law in it may explain, – ."""

MOST_ROWS = 20_000


def acting(effect: Float1D) -> Bool1D:
    """(n,): where an effect is at least a tenth of what it is at its largest (99th percentile of where it is not 0).

    >>> acting(np.array([0.0, 0.05, -1.0, 2.0, 2.0])).tolist()
    [False, False, True, True, True]
    """
    size = np.abs(effect)
    there = size > 0
    if not there.any():
        return there
    return size > 0.1 * np.quantile(size[there], 0.99)


def split(mask: Bool1D, columns: Columns) -> list[Bool1D]:
    """Per part."""
    return np.split(mask, np.cumsum([len(c) for c in columns])[:-1])


def require_seen(columns: Columns) -> None:
    """It acts in enough rows, in three of the parts that are shown at least, and in the unseen one."""
    acts = [int(a.sum()) for a in split(acting(np.concatenate(list(columns))), columns)]
    require_fair(sum(acts[:-1]) >= 150, "acts in too few rows")
    require_fair(sum(n >= 20 for n in acts[:-1]) >= min(3, len(acts) - 1), "acts in too few parts")
    require_fair(acts[-1] >= 20, "does not act in the unseen part")


def rivals(parts: Sequence[Part], sim: Mapping[str, Columns], axis: str) -> dict[str, Float2D]:
    """Per plain law of the vocabulary on this axis the columns that it could be made of, (n, m), behind the lag."""
    machine = parts[0].machine

    def stack(of: Callable[[Part], Float1D]) -> Float1D:
        return np.concatenate([lagged(machine, np.asarray(of(p), float), 1 / machine.rate) for p in parts])

    one, clock = stack(lambda p: np.ones(len(p.t))), stack(lambda p: p.start + p.t)
    current = np.concatenate(list(sim[axis]))
    size = np.abs(current)
    knee = [np.maximum(size - np.quantile(size, q), 0) * np.sign(current) for q in (0.6, 0.75, 0.9)]
    laws: dict[str, list[Float1D]] = {
        "gravity_load": [one],
        "sensor_gain": [current],
        "current_saturation": [x**2 for x in knee],
        "coolant_load": [stack(lambda p: p.coolant)],
        "thermal_drift": [one, *(np.exp(-clock / (s * clock[-1])) for s in (0.1, 0.3, 0.8))],
        "edge_force": [stack(lambda p: p.edge), stack(lambda p: p.mrr_sim)],
    }
    if axis == "sp":
        laws |= {
            "spindle_viscous_drag": [stack(lambda p: p.v_sp)],
            "spindle_windage": [stack(lambda p: p.v_sp * np.abs(p.v_sp))],
            "spindle_inertia": [stack(lambda p: p.a_sp)],
            "spindle_torque_load": [stack(lambda p: p.m_sim)],
        }
        return {name: np.column_stack(x) for name, x in laws.items()}
    k = number(axis)
    pos = np.concatenate([p.pos[:, k] for p in parts])
    v, sign = stack(lambda p: p.v[:, k]), stack(lambda p: np.sign(p.v[:, k]))
    f, a = stack(lambda p: p.f_sim[:, k]), stack(lambda p: p.a[:, k])
    rest = stack(lambda p: held(p.v[:, k]) * (p.v[:, k] == 0))
    across = stack(lambda p: np.linalg.norm(np.delete(p.f_sim, k, axis=1), axis=1))
    speeds = np.abs(np.concatenate([p.v[:, k] for p in parts]))
    slow = np.quantile(speeds[speeds > 1e-3], [0.1, 0.3]) if (speeds > 1e-3).any() else np.ones(2)

    def fades(reach: float) -> Float1D:
        return stack(lambda p: held(p.v[:, k]) * np.exp(-since_reversal(p.v[:, k], 1 / machine.rate)[0] / reach))

    low, high = (float(q) for q in np.quantile(pos, [0.01, 0.99]))
    knots = np.linspace(low, high, 7)
    hats = [np.clip(1 - np.abs(pos - q) / max(knots[1] - knots[0], 1e-9), 0, 1) * sign for q in knots]
    angle = 2 * np.pi * pos / machine.kind.pitch_mm
    laws |= {
        "coulomb_friction": [sign],
        "viscous_friction": [v],
        "inertia": [a],
        "cutting_force": [f],
        "standstill_friction": [rest],
        "friction_asymmetry": [sign, np.abs(sign), v, np.abs(v)],
        "stribeck_friction": [np.exp(-((np.abs(v) / s) ** 2)) * sign for s in slow],
        "load_dependent_friction": [across * sign],
        "presliding_hysteresis": [fades(reach) for reach in 0.3 * slow],
        "position_dependent_friction": hats,
        "torque_ripple": [g(n * angle) for n in (1, 2) for g in (np.sin, np.cos)],
    }
    for other in LINEAR_AXES:
        if other != axis:
            j = number(other)
            laws[f"axis_coupling {other}"] = [
                stack(lambda p, j=j: p.a[:, j]),
                stack(lambda p, j=j: p.v[:, j]),
                stack(lambda p, j=j: np.sign(p.v[:, j])),
            ]
    return {name: np.column_stack(x) for name, x in laws.items()}


def explained(effect: Float1D, by: Float2D) -> float:
    """Share of the effect's power that columns explain at best, – ; on every so manieth row.

    >>> explained(np.array([1.0, 2.0, 3.0]), np.array([[1.0], [1.0], [1.0]])).__round__(3)
    0.857
    """
    step = max(1, len(effect) // MOST_ROWS)
    y, X = effect[::step], by[::step]
    scale = np.sqrt(np.mean(X**2, axis=0))
    X = X[:, scale > 0] / scale[scale > 0]
    if not X.shape[1] or not (power := float(y @ y)):
        return 0.0
    rest = y - X @ np.linalg.lstsq(X, y, rcond=None)[0]
    return 1 - float(rest @ rest) / power


def require_told(name: str, effect: Float1D, noise: float, independent: float, laws: Mapping[str, Float2D]) -> None:
    """No rival imitates the effect so well that noise hides the difference.

    noise : A, rms; independent : share of rows that are independent of the one before, –
    """
    power = float(effect @ effect) / noise**2 * independent
    for rival, columns in laws.items():
        if not rival.startswith(name) and name not in CONTAINS.get(rival, ()):
            save = power * (1 - explained(effect, columns))
            require_fair(save >= ENOUGH, f"{rival} says the same of these rows")


def require_foreign(effect: Float1D, laws: Mapping[str, Float2D]) -> None:
    """No law of the vocabulary explains most of it, nor do the steady ones together."""
    for rival, columns in laws.items():
        require_fair(explained(effect, columns) <= FOREIGN_SHARE, f"{rival} explains most of it")
    steady = (
        "gravity_load", "coulomb_friction", "viscous_friction", "inertia", "cutting_force", "standstill_friction",
        "edge_force", "spindle_viscous_drag", "spindle_windage", "spindle_inertia", "spindle_torque_load",
    )  # fmt: skip
    together = np.column_stack([laws[s] for s in steady if s in laws])
    require_fair(explained(effect, together) <= FOREIGN_SHARE, "the steady laws together explain most of it")


def require_confined(law: Float1D, inside: Bool1D, moving: Bool1D) -> None:
    """The box holds enough of what moves and not most of it, and outside of it the law would have been seen."""
    share = float(np.mean(inside[moving])) if moving.any() else 0.0
    require_fair(0.03 <= share <= 0.35, "the box is too small or too large")
    within, beyond = law[inside & moving], law[~inside & moving]
    rms = [float(np.sqrt(np.mean(x**2))) for x in (within, beyond)]
    require_fair(rms[0] > 0 and rms[1] >= 0.3 * rms[0], "the law is hardly driven outside the box")
