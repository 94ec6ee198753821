"""All that `mechanisms.md` could say of an axis' current, as a textbook writes it: what a law must lie outside of.

In:  parts at the logged samples, the simulated current, an axis. Out: per identifier the columns that it could be made
of; UnfairError where they explain an effect. More of them than `fair.rivals`, which tells two mechanisms apart.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.newcomer import fair
from benchmarks.newcomer.parts import Part
from benchmarks.newcomer.world import Columns, held, lagged, number, since_reversal
from benchmarks.sealed_truth import require_fair
from pido.core.arrays import Float1D, Float2D

ONE, ALL = 0.75, 0.9
"""Most of an effect's power that a single identifier may explain, and all of them together, –."""


def require_beyond(effect: Float1D, laws: Mapping[str, Float2D]) -> None:
    """No identifier explains an effect, nor do all of them together."""
    for name, columns in laws.items():
        require_fair(fair.explained(effect, columns) <= ONE, f"{name} explains it")
    together = np.column_stack(list(laws.values()))
    require_fair(fair.explained(effect, together) <= ALL, "the vocabulary as a whole explains it")


def textbook(parts: Sequence[Part], sim: Mapping[str, Columns], axis: str) -> dict[str, Float2D]:
    """Per identifier (n, m), behind the lag. sim : at the logged samples, A"""
    laws = {n: [*x.T] for n, x in fair.rivals(parts, sim, axis).items()}
    laws["axis_coupling"] = [x for n in list(laws) if n.startswith("axis_coupling ") for x in laws.pop(n)]
    more = _everywhere(parts, sim[axis], axis) | (_on_a_spindle(parts) if axis == "sp" else _on_a_slide(parts, axis))
    for name, columns in more.items():
        laws[name] = [*laws.get(name, []), *columns]
    return {name: np.column_stack(x) for name, x in laws.items()}


def _stacked(parts: Sequence[Part], of: Callable[[Part], Float1D]) -> Float1D:
    return np.concatenate([lagged(p.machine, np.asarray(of(p), float), 1 / p.machine.rate) for p in parts])


def _load(part: Part, axis: str) -> Float1D:
    return part.m_sim if axis == "sp" else part.f_sim[:, number(axis)]


def _everywhere(parts: Sequence[Part], current: Columns, axis: str) -> dict[str, list[Float1D]]:
    """What any axis may have."""
    rate, plane = parts[0].machine.rate, list(parts[0].machine.kind.plane[:2])
    heavy = {n: c.mass_kg for n, c in parts[0].machine.cutters.items()}

    def worn(part: Part, by: Float1D) -> Float1D:
        cut = np.zeros(len(part.t))
        for n in part.worn:
            cut[part.tool == n] = np.cumsum(by[part.tool == n]) / rate
        return cut * _load(part, axis)

    def tile(part: Part, u: int, w: int) -> Float1D:
        at = 4 * (part.pos[:, plane] - part.centre[plane]) / part.size  # -2 to 2 over the workpiece
        return np.prod(np.clip(1 - np.abs(at - [u, w]), 0, 1), axis=1) * _load(part, axis)

    return {
        "gravity_load": [_stacked(parts, lambda p: np.array([heavy[int(n)] for n in p.tool]))],
        "thermal_drift": [_stacked(parts, lambda p, s=s: np.exp(-p.t / s)) for s in (5.0, 20.0, 60.0)],
        "tool_wear": [
            _stacked(parts, lambda p: worn(p, p.mrr_sim)), _stacked(parts, lambda p: worn(p, p.engaged.astype(float))),
        ],
        "material_hard_zone": [_stacked(parts, lambda p, u=u, w=w: tile(p, u, w)) for u in range(-2, 3)
                               for w in range(-2, 3)],
        "time_misalignment": [np.concatenate([np.gradient(i) for i in current])],
    }  # fmt: skip


def _on_a_spindle(parts: Sequence[Part]) -> dict[str, list[Float1D]]:
    of = [(name, k) for name in ("v", "a") for k in range(3)]
    return {"axis_coupling": [_stacked(parts, lambda p, n=n, k=k: getattr(p, n)[:, k]) for n, k in of]}


def _on_a_slide(parts: Sequence[Part], axis: str) -> dict[str, list[Float1D]]:
    """Friction of more shapes, lost motion, what the spindle may do to an axis."""
    k, rate = number(axis), parts[0].machine.rate
    speeds = np.abs(np.concatenate([p.v[:, k] for p in parts]))
    slow = np.quantile(speeds[speeds > 1e-3], [0.05, 0.2, 0.5, 0.8]) if (speeds > 1e-3).any() else np.ones(4)
    pos = np.concatenate([p.pos[:, k] for p in parts])
    low, high = (float(q) for q in np.quantile(pos, [0.01, 0.99]))
    knots = np.linspace(low, high, 13)

    def turned(part: Part, of: Callable[[Float1D, Float1D], Float1D]) -> Float1D:
        way, time = since_reversal(part.v[:, k], 1 / rate)
        return held(part.v[:, k]) * of(way, time)

    def along(part: Part, x: Float1D) -> Float1D:
        return x * part.v[:, k] / np.maximum(part.speed, 1e-6)

    return {
        "stribeck_friction": [
            _stacked(parts, lambda p, s=s, d=d: np.exp(-((np.abs(p.v[:, k]) / s) ** d)) * np.sign(p.v[:, k]))
            for s in slow for d in (1.0, 2.0)
        ],
        "presliding_hysteresis": [
            _stacked(parts, lambda p, s=s: turned(p, lambda way, _: np.exp(-way / s))) for s in (*0.3 * slow, slow[3])
        ],
        "backlash": [
            *(_stacked(parts, lambda p, s=s: turned(p, lambda way, _: 1.0 * (way < s))) for s in 0.3 * slow),
            *(_stacked(parts, lambda p, s=s: turned(p, lambda _, time: np.exp(-time / s))) for s in (0.05, 0.2)),
        ],
        "position_dependent_friction": [
            np.clip(1 - np.abs(pos - q) / max(knots[1] - knots[0], 1e-9), 0, 1)
            * _stacked(parts, lambda p: np.sign(p.v[:, k])) for q in knots
        ],
        "load_dependent_friction": [
            _stacked(parts, lambda p: np.linalg.norm(p.f_sim, axis=1) * np.sign(p.v[:, k])),
            *(_stacked(parts, lambda p, j=j: np.abs(p.f_sim[:, j]) * np.sign(p.v[:, k])) for j in range(3)),
        ],
        "edge_force": [
            _stacked(parts, lambda p: along(p, p.edge)), _stacked(parts, lambda p: along(p, p.engaged.astype(float))),
        ],
        "axis_coupling": [
            _stacked(parts, lambda p: p.v_sp), _stacked(parts, lambda p: p.a_sp),
            *(_stacked(parts, lambda p, j=j: held(p.v[:, j])) for j in range(3) if j != k),
        ],
    }  # fmt: skip
