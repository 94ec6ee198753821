"""Give the virtual mill effects of a chosen strength.

In:  mill, courses of the parts it will make, effects as asked.
Out: effects with their numbers (`Effective`), the same for all parts: one machine, one truth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pido.core.arrays import Float1D
from pido.core.axes import AXES
from pido.core.errors import SettingsError
from pido.synthetic.drive import CYCLE_S
from pido.synthetic.effects import MISCALIBRATED, Effect, Effective, amplitude_for, fault_told, strength_of
from pido.synthetic.faults import CURRENT_FAULTS, INPUT_KINDS
from pido.synthetic.laws import BY_ID, Law
from pido.synthetic.machine import VirtualMill, at_50, effect_current, simulated
from pido.synthetic.parts import Course
from pido.synthetic.unknown import UNKNOWN

FIRST_A = 0.02
"""Amplitude that the search for a strength begins with."""
EITHER_SIGN = {
    "friction_asymmetry", "gravity_load", "axis_coupling", "material_hard_zone", "coolant_load", "thermal_drift",
    "unknown", "time_misalignment", "sensor_gain", "sensor_offset",
}  # fmt: skip
"""Effects that may as well be negative: a softer zone, a load that falls, a gain below 1."""


def equip(
    mill: VirtualMill,
    courses: Sequence[Course],
    effects: Sequence[Effect],
    rng: np.random.Generator,
    rate_hz: float = 50.0,
) -> tuple[Effective, ...]:
    """Raises SettingsError for an unknown id, an axis it cannot act on, or an effect too weak in these parts."""
    return tuple(_equip(mill, list(courses), e, rng, rate_hz) for e in effects)


def on_all_axes(
    mill: VirtualMill, courses: Sequence[Course], fault: Effective, rate_hz: float
) -> tuple[Effective, ...]:
    """A fault of the file, the same on every axis; the one given stays first, the others are as strong as they are."""
    out = [fault]
    for axis in AXES:
        if axis != fault.effect.axis:
            e = replace(fault, effect=replace(fault.effect, axis=axis))
            noise = noise_rms(mill, courses, axis, rate_hz)
            achieved = strength_of([_recorded(effect_current(mill, c, e), rate_hz) for c in courses], noise)
            out.append(replace(e, achieved=achieved))
    return tuple(out)


def noise_rms(mill: VirtualMill, courses: Sequence[Course], axis: str, rate_hz: float) -> float:
    """Rms of the sensor's noise as recorded, A, over these parts; always the same number for the same parts."""
    rng = np.random.default_rng(0)
    force = (c.spindle_force if axis == "sp" else c.force[axis] for c in courses)
    noise = [_recorded(mill.sensors.current[axis].noise(f, rng), rate_hz) for f in force]
    return float(np.sqrt(np.mean(np.concatenate(noise) ** 2)))


def _equip(
    mill: VirtualMill, courses: list[Course], effect: Effect, rng: np.random.Generator, rate_hz: float
) -> Effective:
    if effect.axis not in AXES:
        raise SettingsError(f"effect {effect.id}: there is no axis '{effect.axis}'; axes are {', '.join(AXES)}.")
    if not effect.strength > 0:
        raise SettingsError(f"effect {effect.id} on {effect.axis}: strength {effect.strength:g} must be above 0.")
    noise = noise_rms(mill, courses, effect.axis, rate_hz)
    if effect.id == "input_fault":
        return _input_fault(mill, courses, effect, rng)
    if effect.id in CURRENT_FAULTS:
        law, start = None, Effective(effect, None, FIRST_A, 0.0, _fault_shape(mill, courses, effect))
        largest = (
            start.shape["peak_a"]
            if effect.id == "sensor_clipping"
            else 0.5
            if effect.id == "time_misalignment"
            else np.inf
        )
    else:
        law = _law(effect, rng)
        shape = law.shape(effect.axis, courses, rng) | effect.shape
        setup = mill.setup(effect.axis, courses[0])
        base = law.natural(setup) if effect.id.startswith(MISCALIBRATED) else 0.0
        if effect.id.startswith(MISCALIBRATED) and not base > 0:
            raise SettingsError(
                f"{effect.id} on {effect.axis}: this machine's simulation has no such term to be wrong in."
            )
        largest = law.largest(setup) - base
        start = Effective(effect, law, base + FIRST_A, base, shape)

    either = effect.id in EITHER_SIGN or effect.id.startswith(MISCALIBRATED)
    sign = float(rng.choice([-1.0, 1.0])) if either else 1.0
    if sign < 0 and start.simulated > 0:
        largest = min(largest, 0.9 * start.simulated)
    elif sign < 0 and effect.id == "sensor_gain":
        largest = 0.9

    # A wrong coefficient: the machine's is the natural one plus the change, the simulation keeps the natural one.
    def with_change(change: float) -> Effective:
        return replace(start, amplitude=start.simulated + sign * change)

    def reached(change: float) -> float:
        e = with_change(change)
        return strength_of([_recorded(effect_current(mill, c, e), rate_hz) for c in courses], noise)

    name = f"{effect.id} on {effect.axis}"
    change = amplitude_for(effect.strength, reached, _first(law, start, largest), largest, name)
    done = with_change(change)
    told = (
        law.parameters(mill.setup(effect.axis, courses[0]), done.amplitude, done.shape)
        if law
        else fault_told(effect, done.amplitude, done.shape)
    )
    return replace(done, achieved=reached(change), parameters=told)


def _first(law: Law | None, start: Effective, largest: float) -> float:
    if start.simulated > 0:
        return 0.1 * start.simulated
    return min(FIRST_A, 0.5 * largest) if law is not None or start.effect.id != "time_misalignment" else 0.01


def _recorded(current: Float1D, rate_hz: float) -> Float1D:
    return at_50(current) if rate_hz == 50.0 else current


def _law(effect: Effect, rng: np.random.Generator) -> Law:
    """The law behind an id; several unknown effects stand under one id, `shape["variant"]` picks one."""
    if effect.id == "unknown":
        possible = [law for law in UNKNOWN if effect.axis in law.axes]
        if "variant" in effect.shape:
            return possible[int(effect.shape["variant"]) % len(possible)] if possible else _refused(effect)
        return possible[int(rng.integers(len(possible)))] if possible else _refused(effect)
    law = BY_ID.get(effect.id.removeprefix(MISCALIBRATED))
    if law is None:
        raise SettingsError(
            f"effect '{effect.id}' is not known. Known: {', '.join(BY_ID)}, unknown, and faults of the data."
        )
    return law if effect.axis in law.axes else _refused(effect)


def _refused(effect: Effect) -> Law:
    raise SettingsError(f"effect {effect.id} cannot act on axis {effect.axis}.")


def _fault_shape(mill: VirtualMill, courses: list[Course], effect: Effect) -> dict[str, Any]:
    if effect.id != "sensor_clipping":
        return dict(effect.shape)
    plain = Effective(effect, None, 0.0, 0.0, {"peak_a": np.inf})
    peak = max(float(np.abs(simulated(mill, c, effect.axis, [plain]).current).max()) for c in _shown(courses))
    return {"peak_a": peak} | effect.shape


def _shown(courses: list[Course]) -> list[Course]:
    """All but the last, which a proof keeps unseen: what is there alone, nobody who is shown the others can find."""
    return courses[:-1] or courses


def _input_fault(mill: VirtualMill, courses: list[Course], effect: Effect, rng: np.random.Generator) -> Effective:
    """A few seconds in one part, while the axis moves; not tuned to a strength: a signal is wrong or it is not."""
    if effect.axis == "sp":
        _refused(effect)
    shown = _shown(courses)
    course = shown[int(rng.integers(len(shown)))]
    moving = np.flatnonzero(np.abs(course.v[effect.axis]) > 1.0)
    moving = moving[(moving * CYCLE_S > 2) & (moving * CYCLE_S < course.time[-1] - 8)]
    if not len(moving):
        raise SettingsError(f"input_fault on {effect.axis}: the axis does not move in part {course.job.name}.")
    start = float(moving[int(rng.integers(len(moving)))] * CYCLE_S)
    kind = str(rng.choice(INPUT_KINDS))
    shape = {"part": course.job.name, "fault": kind, "t_start": start, "t_end": start + float(rng.uniform(2, 5))}
    size = float(rng.uniform(5, 50))
    return Effective(effect, None, size, 0.0, shape | effect.shape, np.nan, {"size": (size, "mm")})
