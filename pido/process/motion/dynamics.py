"""How one machine executes a path: settings, fitted once (`pido.process.motion.fit`) or from its data sheet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from pido.core.arrays import Float1D
from pido.core.axes import LINEAR_AXES
from pido.core.errors import SettingsError
from pido.core.machining import Machine


@dataclass(frozen=True, slots=True)
class Dynamics:
    """What `Machine` does not say. The defaults are an ideal control: no lag, no waiting between blocks.

    kv_per_s : servo gain of the position control, 1/s (1 m/min/mm = 16.7 1/s); the actual position follows the set
        point as a first-order lag with time constant 1/kv. None: without lag
    stop_window_mm : at an exact stop the next block waits until the lag is below this (G601 fine, about 0.01)
    block_overhead_s : what each stop costs besides, e.g. output of S and M to the PLC
    path_a_max, path_j_max : limits along a feed path, mm/s², mm/s³; None: the axes' own
    smoothing_mm : G64 without ADIS rounds corners from this distance on
    stop_at_speed_change : a block that changes S begins from rest
    spindle_acc_deg_s2 : acceleration of the spindle, deg/s²; None: the machine's own
    spindle_tolerance : feed waits until the spindle is within this share of its set speed
    tool_change_s : time of a tool change (M6)
    """

    kv_per_s: float | None = None
    stop_window_mm: float = 0.01
    block_overhead_s: float = 0.0
    path_a_max: float | None = None
    path_j_max: float | None = None
    smoothing_mm: float = 0.05
    stop_at_speed_change: bool = True
    spindle_acc_deg_s2: float | None = None
    spindle_tolerance: float = 0.01
    tool_change_s: float = 0.0

    @classmethod
    def of(cls, machine: Machine, own: Mapping[str, float | bool] | None = None) -> Dynamics:
        """The settings of a machine, with one's own over them. Raises SettingsError for a name that is none."""
        given: dict[str, Any] = {**machine.dynamics, **(own or {})}
        known = {f.name for f in fields(cls)}
        if unknown := sorted(set(given) - known):
            raise SettingsError(f"dynamics: {', '.join(unknown)} not known. Known: {', '.join(sorted(known))}.")
        return cls(**given)

    def __post_init__(self) -> None:
        positive = ("kv_per_s", "stop_window_mm", "path_a_max", "path_j_max", "spindle_acc_deg_s2")
        wrong = [n for n in positive if (v := getattr(self, n)) is not None and not (np.isfinite(v) and v > 0)]
        not_negative = ("block_overhead_s", "smoothing_mm", "spindle_tolerance", "tool_change_s")
        wrong += [n for n in not_negative if not (np.isfinite(getattr(self, n)) and getattr(self, n) >= 0)]
        if wrong:
            raise SettingsError(f"dynamics: {', '.join(wrong)} must be positive numbers.")


def limits(machine: Machine, name: str) -> Float1D:
    """(3,): `v_max`, `a_max` or `j_max` of x, y, z."""
    return np.array([getattr(machine.axes[a], name) for a in LINEAR_AXES], float)


def check_machine(machine: Machine) -> None:
    """Raises SettingsError, with all faults, where a limit is zero, negative or no number: it cannot move."""
    faults = [
        f"{axis}.{name} = {value:g}"
        for axis in LINEAR_AXES
        for name in ("v_max", "a_max", "j_max")
        if not (np.isfinite(value := getattr(machine.axes[axis], name)) and value > 0)
    ]
    faults += [
        f"{name} = {value:g}"
        for name in ("spindle_max_deg_s", "spindle_acc_deg_s2")
        if not (np.isfinite(value := getattr(machine, name)) and value > 0)
    ]
    if faults:
        raise SettingsError(f"machine '{machine.id}' cannot move; these limits must be positive: {', '.join(faults)}.")
