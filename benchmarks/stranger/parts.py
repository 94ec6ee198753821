"""What axes, spindle and process of one part really do, and the currents that a simulation knows of.

In:  a plant, a program's set points. Out: a `Part` at the simulation's fine step; columns of the simulation's terms.

Forces are those of Kienzle over the mean chip thickness; directions by ratios (Altintas 2012, chapter 2).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d

from benchmarks.stranger.machine import Plant
from benchmarks.stranger.motion import ride
from pido.core.arrays import Array1D, Bool1D, Float1D, Float2D
from pido.core.axes import AXES

TERMS = {
    "coulomb_friction": (0.15, 0.5),
    "viscous_friction": (0.1, 0.4),
    "inertia": (0.3, 1.0),
    "cutting_force": (0.15, 0.6),
    "gravity_load": (0.2, 0.6),
    "stribeck_friction": (0.05, 0.2),
    "spindle_viscous_drag": (0.1, 0.4),
    "spindle_windage": (0.05, 0.3),
    "spindle_inertia": (0.4, 1.2),
    "spindle_torque_load": (0.2, 1.0),
}
"""Terms of a simulation, and the share of the axis' current that each has at the high end of its driver."""
ALWAYS = ("coulomb_friction", "inertia", "cutting_force", "gravity_load", "spindle_inertia", "spindle_torque_load")


@dataclass(frozen=True, eq=False)
class Part:
    """One part at the fine step, n steps.

    t (n,) s, pos, v, a (n, 3) mm, mm/s, mm/s²; angle, v_sp, a_sp (n,) deg, deg/s, deg/s²
    f (n, 3) N – the drives' load by the process; f_t N, m N·m, mrr mm³/s, edge mm (engaged edge length) (n,)
    tool, coolant, nc_line (n,); operations as in part.json; start s – the machine's clock at t = 0
    center (3,) mm – of the workpiece; worn {tool: (mm³, s)} – cut before this part; volume, cut_s (n,) – by this edge
    """

    plant: Plant
    t: Float1D
    pos: Float2D
    v: Float2D
    a: Float2D
    angle: Float1D
    v_sp: Float1D
    a_sp: Float1D
    f: Float2D
    f_t: Float1D
    m: Float1D
    mrr: Float1D
    edge: Float1D
    tool: Array1D
    coolant: Float1D
    nc_line: Float1D
    operations: Sequence[Mapping[str, Any]]
    start: float
    center: Float1D
    worn: Mapping[int, tuple[float, float]]
    volume: Float1D
    cut_s: Float1D

    @property
    def engaged(self) -> Bool1D:
        return self.edge > 0

    @property
    def area(self) -> Float1D:
        """(n,), mm²: area removal, removal rate over speed."""
        speed = np.linalg.norm(self.v, axis=1)
        return np.divide(self.mrr, speed, out=np.zeros(len(speed)), where=speed > 1e-6)

    def speed(self, axis: str) -> Float1D:
        """(n,): mm/s, spindle deg/s."""
        return self.v_sp if axis == "sp" else self.v[:, AXES.index(axis)]

    def load(self, axis: str) -> Float1D:
        """(n,): N, spindle N·m."""
        return self.m if axis == "sp" else self.f[:, AXES.index(axis)]


def make_parts(plant: Plant, seconds: Sequence[float], diagonal: bool, rng: np.random.Generator) -> list[Part]:
    """Parts one after the other: edges wear on, pauses lie between."""
    clock = float(rng.uniform(0, 60))
    worn = {n: (float(rng.uniform(0, 3e3)), float(rng.uniform(0, 100))) for n in plant.tools}
    parts = []
    for length in seconds:
        center = 0.5 * plant.travel + rng.uniform(-0.04, 0.04, 3) * plant.travel
        part = _part(plant, ride(plant, length, diagonal, center, rng), clock, center, dict(worn), rng)
        for n in plant.tools:
            mine = part.tool == n
            if mine.any():
                worn[n] = (float(part.volume[mine][-1]), float(part.cut_s[mine][-1]))
        clock += length + float(rng.uniform(5, 90))
        parts.append(part)
    return parts


def thinned(part: Part) -> Part:
    """The same part at the recorded samples (its plant then has one step per sample)."""
    n, arrays = len(part.t), {f.name: getattr(part, f.name) for f in fields(part)}
    shorter = {k: a[:: part.plant.fine] for k, a in arrays.items() if isinstance(a, np.ndarray) and len(a) == n}
    return replace(part, plant=replace(part.plant, fine=1), **shorter)


def _part(
    plant: Plant,
    track: Mapping[str, Any],
    clock: float,
    center: Float1D,
    worn: dict[int, tuple[float, float]],
    rng: np.random.Generator,
) -> Part:
    dt, pos = plant.dt, track["rows"]
    v = _still(np.gradient(pos, dt, axis=0), 1e-5)
    a = _still(np.gradient(v, dt, axis=0), 1e-3) * (np.abs(v) + np.abs(np.gradient(v, axis=0)) > 0)
    turning = uniform_filter1d(track["rpm"], max(3, int(0.15 / dt) | 1), mode="nearest")
    v_sp = _still(6.0 * turning, 1e-3)
    t = np.arange(float(len(pos))) * dt
    process = _process(plant, track, v, v_sp / 6.0, rng)
    volume, cut_s = np.zeros(len(t)), np.zeros(len(t))
    for n in plant.tools:
        mine = track["tool"] == n
        volume[mine] = worn[n][0] + np.cumsum(process["mrr"] * mine)[mine] * dt
        cut_s[mine] = worn[n][1] + np.cumsum((process["edge"] > 0) & mine)[mine] * dt
    return Part(
        plant=plant, t=t, pos=pos, v=v, a=a, angle=np.cumsum(v_sp) * dt, v_sp=v_sp,
        a_sp=_still(np.gradient(v_sp, dt), 1e-2), tool=track["tool"].astype(int), coolant=track["coolant"],
        nc_line=track["nc_line"], operations=track["operations"], start=clock, center=center, worn=worn,
        volume=volume, cut_s=cut_s, **process,
    )  # fmt: skip


def _still(values: Array1D, below: float) -> Array1D:
    """Rounding of the moving averages is no motion."""
    return np.where(np.abs(values) < below, 0.0, values)


def _process(
    plant: Plant, track: Mapping[str, Any], v: Float2D, rpm: Float1D, rng: np.random.Generator
) -> dict[str, Array1D]:
    """Forces of the cut: Kienzle over the mean chip thickness h_m = (2 / phi) f_z a_e / D.

    The tool enters and leaves over a tenth of a second or more; a_e waves about what was programmed.
    """
    D = np.array([plant.tools[int(n)].diameter_mm for n in track["tool"]])
    z = np.array([plant.tools[int(n)].teeth for n in track["tool"]])
    t = np.arange(len(D)) * plant.dt
    soft = max(3, int(rng.uniform(0.1, 0.3) / plant.dt) | 1)
    a_p = _still(uniform_filter1d(track["a_p"], soft, mode="constant"), 1e-9)
    wave = 1.0 - 0.3 * np.sin(2 * np.pi * t / rng.uniform(1.5, 8.0)) ** 2
    a_e = np.minimum(uniform_filter1d(track["a_e"], soft, mode="constant") * wave, D)
    drill = track["drill"] > 0
    speed = np.linalg.norm(v, axis=1)
    phi = np.arccos(np.clip(1 - 2 * a_e / D, -1, 1))
    cuts = (a_p > 0) & (a_e > 1e-3 * D) & (rpm > 1) & ~(drill & (v[:, 2] >= 0))
    f_z = np.divide(60.0 * speed, rpm * z, out=np.zeros(len(t)), where=cuts)
    h = np.where(cuts, 2 / np.maximum(phi, 1e-3) * f_z * a_e / D, 0.0)
    edge = np.where(cuts, a_p * z * phi / (2 * np.pi), 0.0)
    f_t = plant.k_c11 * edge * h ** (1.0 - plant.m_c)
    along = np.divide(v, speed[:, None], out=np.zeros_like(v), where=speed[:, None] > 1e-6)
    across = np.column_stack([-along[:, 1], along[:, 0], np.zeros(len(t))])
    feed, normal, axial = plant.ratios
    mill = feed * along + normal * across + np.array([0.0, 0.0, axial]) * (speed > 1e-6)[:, None]
    f = f_t[:, None] * np.where(drill[:, None], 1.2 * along, mill)
    removed = np.where(drill, np.pi / 4 * D**2, a_p * a_e) * speed
    return {"f": f, "f_t": f_t, "m": f_t * D / 2000.0, "mrr": np.where(cuts, removed, 0.0), "edge": edge}


def sign(v: Float1D, width: float) -> Float1D:
    """sgn(v), or tanh(v / width) where the simulation has a smooth one."""
    return np.sign(v) if width == 0 else np.tanh(v / width)


def term(part: Part, axis: str, name: str, width: float) -> Float1D:
    """(n,): what the coefficient of one of TERMS multiplies."""
    v = part.speed(axis)
    match name:
        case "coulomb_friction":
            return sign(v, width)
        case "stribeck_friction":
            return np.exp(-((np.abs(v) / stribeck_speed(part.plant)) ** 2)) * sign(v, width)
        case "viscous_friction" | "spindle_viscous_drag":
            return v
        case "spindle_windage":
            return v * np.abs(v)
        case "inertia":
            return part.a[:, AXES.index(axis)]
        case "spindle_inertia":
            return part.a_sp
        case "gravity_load":
            return np.ones(len(v))
        case _:
            return part.load(axis)


def stribeck_speed(plant: Plant) -> float:
    """mm/s: the speed below which friction rises, a quarter of the slowest feeds."""
    return 0.25 * plant.family.feed[0] + 1.0


def draw_terms(
    parts: Sequence[Part], axis: str, without: Sequence[str], needs: Sequence[str], rng: np.random.Generator
) -> dict[str, float]:
    """Coefficient of each term that the simulation has on an axis, in A per unit of `term`.

    without : mechanisms that are concealed; needs : terms that a case wants to get wrong
    """
    plant, chosen = parts[0].plant, {}
    for name, (low, high) in TERMS.items():
        ours = name.startswith("spindle") == (axis == "sp") or (axis == "sp" and name == "coulomb_friction")
        here = ours and (name != "gravity_load" or axis == plant.vertical)
        share = rng.uniform(low, high) * plant.current[AXES.index(axis)]
        if here and name not in without and (name in needs or name in ALWAYS or rng.random() < 0.5):
            size = np.abs(np.concatenate([term(p, axis, name, 0.0)[:: p.plant.fine] for p in parts]))
            top = float(np.quantile(size[size > 0], 0.995 if "inertia" in name else 0.95)) if (size > 0).any() else 0.0
            if top > 0:
                chosen[name] = share / top
    return chosen
