"""What can be in a machine and not in its simulation: laws that are switched on in the virtual mill's own dynamics.

In:  one axis as it is simulated (`Setup`), the course of the part, an amplitude.
Out: the axis with the law, and without it. Amplitudes are in A (a load's current per unit of its profile) where
     nothing else is said; what a law's numbers are in physical units stands in `parameters`.

Three kinds: a load on the axis, a change of its friction level, another constant of its drive. Identifiers are those
of the diagnosis contract; nothing else is shared with the code that looks for them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pido.core.arrays import Float1D
from pido.core.axes import LINEAR_AXES
from pido.synthetic.drive import Drive
from pido.synthetic.parts import Course

Shape = Mapping[str, Any]
Parameters = dict[str, tuple[float, str]]


@dataclass(frozen=True, eq=False)
class Setup:
    """One axis of one part, ready to be integrated.

    load, level : (n,), N (spindle: N·m) – what it overcomes in addition, and what its Coulomb friction has in addition
    reaction : share of the process force (torque) that `load` already holds
    """

    axis: str
    drive: Any  # Drive or Spindle; a law knows which of them its axes have
    load: Float1D
    level: Float1D
    reaction: float = 1.0

    @property
    def per_ampere(self) -> float:
        """N/A, spindle N·m/A."""
        return self.drive.force_per_ampere if isinstance(self.drive, Drive) else self.drive.torque_per_ampere

    def changed(self, **constants: float) -> Setup:
        return replace(self, drive=replace(self.drive, **constants))  # type: ignore[type-var]


class Law(ABC):
    """Something that a machine does and its simulation may not."""

    id: str
    axes: tuple[str, ...]

    def shape(self, axis: str, courses: list[Course], rng: np.random.Generator) -> dict[str, Any]:
        """What is drawn once per machine: distances, speeds, regions."""
        return {}

    @abstractmethod
    def put(self, setup: Setup, course: Course, amplitude: float, shape: Shape) -> Setup:
        """The axis with the law at this amplitude, whatever it had of it before; amplitude 0 is the axis without it."""

    def parameters(self, setup: Setup, amplitude: float, shape: Shape) -> Parameters:
        return {"amplitude": (amplitude, "A")}

    def natural(self, setup: Setup) -> float:
        """The amplitude at which a machine has it by nature; 0 for what only some machines have."""
        return 0.0

    def largest(self, setup: Setup) -> float:
        """The amplitude above which the machine would be another one."""
        return np.inf


Profile = Callable[[Course, str, Shape], Float1D]
DrawShape = Callable[[str, list[Course], np.random.Generator], dict[str, Any]]


@dataclass(frozen=True)
class Load(Law):
    """A load: its current is amplitude times the profile. `has` is the part of it that the machine has by nature."""

    id: str
    axes: tuple[str, ...]
    profile: Profile
    unit: str = "A"
    draw: DrawShape | None = None
    by_nature: bool = False
    on_friction: bool = False

    def shape(self, axis: str, courses: list[Course], rng: np.random.Generator) -> dict[str, Any]:
        return self.draw(axis, courses, rng) if self.draw else {}

    def put(self, setup: Setup, course: Course, amplitude: float, shape: Shape) -> Setup:
        profile = self.profile(course, setup.axis, shape)
        if "region" in shape:
            profile = profile * inside(course, shape["region"])
        gain = amplitude * setup.per_ampere - (setup.reaction if self.by_nature else 0.0)
        if self.on_friction:
            return replace(setup, level=setup.level + gain * profile)
        return replace(setup, load=setup.load + gain * profile)

    def parameters(self, setup: Setup, amplitude: float, shape: Shape) -> Parameters:
        numbers = {name: float(v) for name, v in shape.items() if isinstance(v, float)}
        return {"k": (amplitude, self.unit), **{name: (v, name.rpartition("_")[2]) for name, v in numbers.items()}}

    def natural(self, setup: Setup) -> float:
        return setup.reaction / setup.per_ampere if self.by_nature else 0.0


@dataclass(frozen=True)
class Constant(Law):
    """A constant of the drive: `of` makes them of amplitude and shape, `nature` reads the amplitude of a drive."""

    id: str
    axes: tuple[str, ...]
    of: Callable[[Setup, float, Shape], dict[str, float]]
    told: Callable[[Setup, float, Shape], Parameters]
    nature: Callable[[Any], float] = lambda setup: 0.0
    draw: DrawShape | None = None
    limit: Callable[[Any], float] = lambda setup: np.inf

    def shape(self, axis: str, courses: list[Course], rng: np.random.Generator) -> dict[str, Any]:
        return self.draw(axis, courses, rng) if self.draw else {}

    def put(self, setup: Setup, course: Course, amplitude: float, shape: Shape) -> Setup:
        return setup.changed(**self.of(setup, amplitude, shape))

    def parameters(self, setup: Setup, amplitude: float, shape: Shape) -> Parameters:
        return self.told(setup, amplitude, shape)

    def natural(self, setup: Setup) -> float:
        return self.nature(setup)

    def largest(self, setup: Setup) -> float:
        return self.limit(setup)


def inside(course: Course, region: Mapping[str, tuple[float, float]]) -> Float1D:
    """(n,) – 1 where every named state (v_x, v_y, ar) lies within its (low, high), else 0."""
    states = {"v_x": course.v["x"], "v_y": course.v["y"], "ar": course.area_removal}
    held = np.ones(len(course))
    for name, (low, high) in region.items():
        held = held * ((states[name] >= low) & (states[name] <= high))
    return held


def _sign(course: Course, axis: str) -> Float1D:
    v = course.v[axis]
    return np.tanh(v / 0.05)


def _windows(axis: str, courses: list[Course], rng: np.random.Generator) -> dict[str, Any]:
    """Three to six intervals of 2 to 8 s over all parts, apart from each other, each with its own sign and height."""
    out: dict[str, list[tuple[float, float, float]]] = {}
    for course in courses:
        end, windows, at = course.time[-1], [], rng.uniform(3, 15)
        while at + 9 < end:
            length = rng.uniform(2, 8)
            windows.append((at, at + length, rng.choice([-1.0, 1.0]) * rng.uniform(0.7, 1.3)))
            at += length + rng.uniform(8, 30)
        out[course.job.name] = windows[:4]
    return {"windows": out}


def _external(course: Course, axis: str, shape: Shape) -> Float1D:
    force = np.zeros(len(course))
    for start, end, height in shape["windows"].get(course.job.name, []):
        rise = 0.3
        force += height * np.clip((course.time - start) / rise, 0, 1) * np.clip((end - course.time) / rise, 0, 1)
    return force


def _zone(axis: str, courses: list[Course], rng: np.random.Generator) -> dict[str, Any]:
    """A disc around a place where much is cut, in coordinates of the workpiece."""
    c = courses[0]
    rows = np.flatnonzero(c.cutting)
    at = rows[rng.integers(len(rows))] if len(rows) else 0
    zero = c.job.zero_mm
    return {
        "x_mm": float(c.pos["x"][at] - zero[0]), "y_mm": float(c.pos["y"][at] - zero[1]),
        "radius_mm": float(rng.uniform(8, 18)),
    }  # fmt: skip


def _in_zone(course: Course, shape: Shape) -> Float1D:
    x, y = course.pos["x"] - course.job.zero_mm[0], course.pos["y"] - course.job.zero_mm[1]
    return 0.5 - 0.5 * np.tanh((np.hypot(x - shape["x_mm"], y - shape["y_mm"]) - shape["radius_mm"]) / 0.5)


def _coupled(axis: str, courses: list[Course], rng: np.random.Generator) -> dict[str, Any]:
    others = [a for a in LINEAR_AXES if a != axis and np.abs(courses[0].v[a]).max() > 1]
    return {"other": str(rng.choice(others or ["x"])), "term": str(rng.choice(["a", "v", "sgn"]))}


def _coupling(course: Course, axis: str, shape: Shape) -> Float1D:
    j = shape["other"]
    if shape["term"] == "a":
        return course.a[j] / 1000.0
    return course.v[j] / 10.0 if shape["term"] == "v" else _sign(course, j)


def _bumps(axis: str, courses: list[Course], rng: np.random.Generator) -> dict[str, Any]:
    return {"period_mm": float(rng.uniform(40, 90)), "phase_rad": float(rng.uniform(0, 2 * np.pi))}


def _level_along(course: Course, axis: str, shape: Shape) -> Float1D:
    """Between 0 and 1 along the travel: worn in some places, tight in others."""
    return 0.5 + 0.5 * np.sin(2 * np.pi * course.pos[axis] / shape["period_mm"] + shape["phase_rad"])


def _reaction(course: Course, axis: str, shape: Shape) -> Float1D:
    """What the motor has to hold against the force on the tool."""
    if axis == "sp":
        return course.torque * np.tanh(course.v_sp / 60.0)
    return -course.force[axis]


def _edge(course: Course, axis: str, shape: Shape) -> Float1D:
    if axis == "sp":
        return course.edge_mm * course.radius_mm / 10.0 * np.tanh(course.v_sp / 60.0)
    size = np.sqrt(sum(course.force[a] ** 2 for a in LINEAR_AXES))
    return -course.edge_mm * np.divide(course.force[axis], size, out=np.zeros(len(course)), where=size > 1e-9)


def _across(course: Course, axis: str, shape: Shape) -> Float1D:
    return np.sqrt(sum(course.force[a] ** 2 for a in LINEAR_AXES if a != axis))


def _tau(axis: str, courses: list[Course], rng: np.random.Generator) -> dict[str, Any]:
    return {"tau_s": float(rng.uniform(40, 200))}


def _newtons(name: str) -> Callable[[Setup, float, Shape], Parameters]:
    return lambda s, amplitude, shape: {name: (amplitude, "A")}


_ANY = (*LINEAR_AXES, "sp")


LAWS: tuple[Law, ...] = (
    Constant("coulomb_friction", LINEAR_AXES,
             lambda s, p, shape: {"coulomb_n": p * s.per_ampere}, _newtons("F_c"),
             nature=lambda s: s.drive.coulomb_n / s.per_ampere),
    Constant("viscous_friction", LINEAR_AXES,
             lambda s, p, shape: {"viscous": p * s.per_ampere / 10.0},
             lambda s, p, shape: {"F_v": (p / 10.0, "A·s/mm")},
             nature=lambda s: 10.0 * s.drive.viscous / s.per_ampere),
    Constant("stribeck_friction", LINEAR_AXES,
             lambda s, p, shape: {"stribeck_n": p * s.per_ampere, "stribeck_mm_s": shape["v_s"]},
             lambda s, p, shape: {"F_s - F_c": (p, "A"), "v_s": (shape["v_s"], "mm/s")},
             nature=lambda s: s.drive.stribeck_n / s.per_ampere,
             draw=lambda axis, courses, rng: {"v_s": float(rng.uniform(0.5, 6.0))}),
    Constant("standstill_friction", LINEAR_AXES,
             lambda s, p, shape: {"hold": p * s.per_ampere / s.drive.coulomb_n}, _newtons("F_h"),
             nature=lambda s: s.drive.hold * s.drive.coulomb_n / s.per_ampere,
             limit=lambda s: s.drive.coulomb_n / s.per_ampere),
    Constant("friction_asymmetry", LINEAR_AXES,
             lambda s, p, shape: {"asymmetry": p * s.per_ampere / s.drive.coulomb_n},
             lambda s, p, shape: {"(F_c+ - F_c-)/2": (p, "A")},
             limit=lambda s: 0.9 * s.drive.coulomb_n / s.per_ampere),
    Load("load_dependent_friction", LINEAR_AXES, _across, unit="A/N", on_friction=True),
    Load("position_dependent_friction", LINEAR_AXES, _level_along, draw=_bumps, on_friction=True),
    Constant("presliding_hysteresis", LINEAR_AXES,
             lambda s, p, shape: {"soft_share": p * s.per_ampere / s.drive.coulomb_n, "soft_mm": shape["distance_mm"]},
             lambda s, p, shape: {"F_c": (p, "A"), "distance": (shape["distance_mm"], "mm")},
             draw=lambda axis, courses, rng: {"distance_mm": float(np.exp(rng.uniform(np.log(0.03), np.log(0.4))))},
             limit=lambda s: s.drive.coulomb_n / s.per_ampere),
    Constant("backlash", LINEAR_AXES,
             lambda s, p, shape: {"lost_motion_mm": p},
             lambda s, p, shape: {"lost_motion": (p, "mm")},
             limit=lambda s: 0.3),
    Constant("inertia", LINEAR_AXES,
             lambda s, p, shape: {"inertia_share": p * s.per_ampere / (s.drive.motor_kg + s.drive.table_kg)},
             lambda s, p, shape: {"m": (p * 1e-3, "A·s²/mm")},
             nature=lambda s: s.drive.inertia_share * (s.drive.motor_kg + s.drive.table_kg) / s.per_ampere),
    Load("gravity_load", LINEAR_AXES, lambda c, axis, shape: c.tool_kg, unit="A/kg"),
    Load("axis_coupling", LINEAR_AXES, _coupling, draw=_coupled),
    Constant("torque_ripple", LINEAR_AXES,
             lambda s, p, shape: {"ripple_n": p * s.per_ampere, "ripple_mm": shape["period_mm"],
                              "ripple_phase": shape["phase_rad"]},
             lambda s, p, shape: {"amplitude": (p, "A"), "period": (shape["period_mm"], "mm"),
                              "phase": (shape["phase_rad"], "rad")},
             draw=lambda axis, courses, rng: {"period_mm": float(rng.choice([5.0, 10.0, 20.0])),
                                             "phase_rad": float(rng.uniform(0, 2 * np.pi))}),
    Load("cutting_force", LINEAR_AXES, _reaction, unit="A/N", by_nature=True),
    Load("edge_force", _ANY, _edge, unit="A/mm"),
    Load("tool_wear", _ANY, lambda c, axis, shape: _reaction(c, axis, shape) * c.cut_mm3 / 1e4,
         unit="A per N (spindle: N·m) and 10 cm³"),
    Load("material_hard_zone", _ANY, lambda c, axis, shape: _reaction(c, axis, shape) * _in_zone(c, shape), unit="A/N",
         draw=_zone),
    Load("coolant_load", _ANY, lambda c, axis, shape: c.coolant),
    Constant("spindle_viscous_drag", ("sp",),
             lambda s, p, shape: {"viscous": p * s.per_ampere / 300.0},
             lambda s, p, shape: {"k": (p / np.degrees(300.0), "A·s/deg")},
             nature=lambda s: 300.0 * s.drive.viscous / s.per_ampere),
    Constant("spindle_windage", ("sp",),
             lambda s, p, shape: {"windage": p * s.per_ampere / 9e4},
             lambda s, p, shape: {"k": (p / np.degrees(300.0) ** 2, "A·s²/deg²")},
             nature=lambda s: 9e4 * s.drive.windage / s.per_ampere),
    Constant("spindle_inertia", ("sp",),
             lambda s, p, shape: {"inertia_share": p * s.per_ampere / s.drive.inertia_kg_m2 * 1e-2},
             lambda s, p, shape: {"J": (p * 1e-2 * np.pi / 180, "A·s²/deg")},
             nature=lambda s: 1e2 * s.drive.inertia_share * s.drive.inertia_kg_m2 / s.per_ampere),
    Load("spindle_torque_load", ("sp",), _reaction, unit="A/(N·m)", by_nature=True),
    Load("thermal_drift", _ANY, lambda c, axis, shape: 1 - c.warmth(shape["tau_s"]), draw=_tau),
    Constant("current_saturation", _ANY,
             lambda s, p, shape: {"knee_a": shape["knee_a"], "bend": p},
             lambda s, p, shape: {"bend": (p, "1/A"), "knee": (shape["knee_a"], "A")},
             draw=lambda axis, courses, rng: {"knee_a": 1.0}),
    Load("external_force", _ANY, _external, draw=_windows),
)  # fmt: skip

BY_ID: dict[str, Law] = {law.id: law for law in LAWS}
