"""Sealed cases: a few parts of one machine, with something concealed in them or nothing, drawn from a seed.

In:  kind, strength, seed.
Out: `Case`: parts as recorded, each with a simulation, and the truth.

Kinds: every id of the diagnosis vocabulary; 'miscalibrated:<id>'; 'none'; 'pair' (two effects); 'region:<id>' (only in
a box of v_x, v_y); 'confounded:<id>' (its driver varies together with another one).
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pido.core.axes import LINEAR_AXES
from pido.core.errors import SettingsError
from pido.synthetic.effects import MISCALIBRATED, Effect, Effective
from pido.synthetic.equip import equip, on_all_axes
from pido.synthetic.families import gear, notch, plate, random_contours
from pido.synthetic.faults import CURRENT_FAULTS
from pido.synthetic.laws import BY_ID, Load
from pido.synthetic.machine import Produced, VirtualMill, produce
from pido.synthetic.mills import newer_vertical, worn_horizontal
from pido.synthetic.parts import Course, PartJob

MECHANISMS = tuple(BY_ID)
FAULTS = (*CURRENT_FAULTS, "input_fault")
CALIBRATED = (
    "coulomb_friction", "viscous_friction", "inertia", "cutting_force", "spindle_viscous_drag", "spindle_windage",
    "spindle_inertia", "spindle_torque_load",
)  # fmt: skip
"""Terms that a simulation usually has, and may have with a wrong coefficient."""
REGIONAL = (
    "coolant_load",
    "cutting_force",
    "edge_force",
    "axis_coupling",
    "position_dependent_friction",
    "external_force",
)
CONFOUNDED = {
    "coolant_load": ("edge_force",),
    "edge_force": ("coolant_load",),
    "thermal_drift": ("tool_wear",),
    "tool_wear": ("thermal_drift",),
}
"""Effect, and what imitates it where coolant runs in every cut, and wear and heat grow together without a pause."""
KINDS: tuple[str, ...] = (
    *MECHANISMS,
    *FAULTS,
    *(MISCALIBRATED + m for m in CALIBRATED),
    "unknown",
    "pair",
    *(f"region:{m}" for m in REGIONAL),
    *(f"confounded:{m}" for m in CONFOUNDED),
    "none",
)
DRAWS = 8
"""Attempts at an effect that acts in the parts at hand."""
_PAIRABLE = ("stribeck_friction", "presliding_hysteresis", "viscous_friction", "load_dependent_friction",
             "torque_ripple", "axis_coupling", "coolant_load", "thermal_drift", "position_dependent_friction",
             "edge_force", "external_force", "spindle_windage", "tool_wear")  # fmt: skip


@dataclass(frozen=True, eq=False)
class Case:
    """parts: as recorded, with `curr_*_sim`; effects: the truth; imitators: ids that these data cannot exclude."""

    kind: str
    strength: float
    seed: int
    machine: str
    parts: tuple[Produced, ...]
    effects: tuple[Effective, ...]
    imitators: tuple[str, ...] = ()

    def truth(self) -> dict[str, Any]:
        """For the sealed file."""
        return {
            "schema": "pido.truth/1",
            "kind": self.kind,
            "strength": self.strength,
            "seed": self.seed,
            "machine": self.machine,
            "parts": [p.job.name for p in self.parts],
            "effects": [e.told() for e in self.effects],
            "confounded_with": list(self.imitators),
            "faulty_intervals": {p.job.name: list(p.truth.faulty) for p in self.parts if p.truth.faulty},
        }


def draw_case(
    kind: str, strength: float = 2.0, seed: int = 0, *, rate_hz: float = 50.0, parts: int | None = None
) -> Case:
    """One case. Same arguments: same bytes.

    parts : number of parts, 3 to 6 where None. Raises SettingsError for an unknown kind.
    """
    if kind not in KINDS:
        raise SettingsError(f"kind '{kind}' is not known. Known: {', '.join(KINDS)}.")
    rng = np.random.default_rng(np.random.SeedSequence([seed, *kind.encode()]))
    mill = _some_mill(rng)
    n = parts or int(rng.integers(3, 7))
    form, _, what = kind.rpartition(":") if kind.startswith(("region:", "confounded:")) else ("", "", kind)
    jobs = _some_parts(mill, n, form, what, rng)
    courses = mill.plan(jobs)
    effects = _equipped(form, what, strength, mill, courses, rng, rate_hz)
    if what == "time_misalignment":  # the file's clock is wrong, so every current of it is
        effects = on_all_axes(mill, courses, effects[0], rate_hz)
    made = produce(mill, courses, effects, seed=int(rng.integers(2**31)), rate_hz=rate_hz)
    imitators = CONFOUNDED[what] if form == "confounded" else ()
    return Case(kind, strength, seed, mill.machine.id, tuple(made), effects, imitators)


def _equipped(
    form: str,
    what: str,
    strength: float,
    mill: VirtualMill,
    courses: Sequence[Course],
    rng: np.random.Generator,
    rate_hz: float,
) -> tuple[Effective, ...]:
    """Effects that act in these parts: an axis, region or second effect that does not is drawn again."""
    for _ in range(DRAWS - 1):
        with suppress(SettingsError):
            return equip(mill, courses, _effects(form, what, strength, mill, courses, rng), rng, rate_hz)
    return equip(mill, courses, _effects(form, what, strength, mill, courses, rng), rng, rate_hz)


def _some_mill(rng: np.random.Generator) -> VirtualMill:
    """One of the two machines, with every constant of its drives its own within a fifth."""
    mill = worn_horizontal() if rng.random() < 0.5 else newer_vertical()

    def own(value: float) -> float:
        return value * float(rng.uniform(0.8, 1.25))

    drives = {
        axis: replace(
            d, table_kg=own(d.table_kg), coulomb_n=own(d.coulomb_n), stribeck_n=own(d.stribeck_n),
            viscous=own(d.viscous), stribeck_mm_s=own(d.stribeck_mm_s), gravity_n=own(d.gravity_n),
            ripple_n=own(d.ripple_n), bristle_n_mm=own(d.bristle_n_mm), ripple_phase=float(rng.uniform(0, 2 * np.pi)),
        )
        for axis, d in mill.drives.items()
    }  # fmt: skip
    s = mill.spindle
    spindle = replace(s, coulomb_nm=own(s.coulomb_nm), viscous=own(s.viscous), windage=own(s.windage))
    return replace(mill, drives=drives, spindle=spindle)


def _some_parts(mill: VirtualMill, n: int, form: str, what: str, rng: np.random.Generator) -> list[PartJob]:
    material = str(rng.choice(["S235JR", "AL2007T4", "POM-C"]))
    if form != "confounded" and what != "gravity_load" and rng.random() < 0.2:
        shape = (gear, plate, notch)[int(rng.integers(3))]
        material = "AL2007T4" if material == "POM-C" else material
        return shape(mill.machine, material, vary=str(rng.choice(["a_p", "SF"])))
    jobs = random_contours(
        mill.machine,
        n,
        rng,
        material=material,
        seconds=float(rng.uniform(60, 100)),
        coolant_with_cut=form == "confounded",
    )
    if form == "confounded":  # no pause: heat and wear grow together
        clock = 0.0
        for i, job in enumerate(jobs):
            jobs[i] = replace(job, start_time_s=clock)
            clock += 400.0 if "tool" in what or "thermal" in what else 600.0
    return jobs


def _effects(
    form: str, what: str, strength: float, mill: VirtualMill, courses: Sequence[Course], rng: np.random.Generator
) -> list[Effect]:
    if what == "none":
        return []
    if what == "pair":
        first, second = (str(m) for m in rng.choice(_PAIRABLE, 2, replace=False))
        axis = _axis(first, mill, rng)
        same = rng.random() < 0.5 and axis in BY_ID[second].axes
        return [Effect(first, axis, strength), Effect(second, axis if same else _axis(second, mill, rng), strength)]
    if what == "time_misalignment":
        return [Effect(what, _axis(what, mill, rng), strength, {"drift": bool(rng.random() < 0.4)})]
    axis = _axis(what, mill, rng)
    shape: dict[str, Any] = {}
    if form == "region":
        shape["region"] = _region(courses, isinstance(BY_ID[what], Load) and what not in ("axis_coupling",), rng)
    return [Effect(what, axis, strength, shape)]


def _axis(what: str, mill: VirtualMill, rng: np.random.Generator) -> str:
    id = what.removeprefix(MISCALIBRATED)
    if id == "gravity_load":
        return mill.machine.vertical_axis
    axes = BY_ID[id].axes if id in BY_ID else LINEAR_AXES if id in ("unknown", "input_fault") else (*LINEAR_AXES, "sp")
    if id == "backlash":  # a weight keeps the screw pressed to one side
        axes = tuple(a for a in axes if a != mill.machine.vertical_axis)
    if id == "unknown" or len(axes) > 1:
        axes = tuple(a for a in axes if a != "z")  # z only plunges: there is little to find on it
    return str(rng.choice(axes))


def _region(courses: Sequence[Course], cutting: bool, rng: np.random.Generator) -> dict[str, tuple[float, float]]:
    """A box that holds roughly a quarter of the moving samples."""
    v_x = np.concatenate([c.v["x"][c.cutting] if cutting else c.v["x"] for c in courses])
    v_y = np.concatenate([c.v["y"][c.cutting] if cutting else c.v["y"] for c in courses])
    low, high = np.quantile(v_x, [0.02, 0.98])
    middle = 0.5 * (low + high)
    box = {"v_x": (middle, np.inf) if rng.random() < 0.5 else (-np.inf, middle)}
    low, high = np.quantile(v_y, [0.02, 0.98])
    cut = float(rng.uniform(low * 0.5, high * 0.5))
    box["v_y"] = (cut, np.inf) if rng.random() < 0.5 else (-np.inf, cut)
    return {name: (float(a), float(b)) for name, (a, b) in box.items()}
