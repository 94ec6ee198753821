"""An effect that is asked for, and the same effect with its numbers: strong enough to stand out of the noise as asked.

In:  mechanism, axis, strength, courses.
Out: `Effective`: law, amplitude in the machine, amplitude in the simulation, shape.

Strength is the rms of the effect's current where it acts, over the rms of the sensor's noise, both as recorded. It acts
where its current exceeds a tenth of its own 99.5 % quantile.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pido.core.arrays import Bool1D, Float1D
from pido.core.errors import SettingsError
from pido.synthetic.faults import fault_parameters
from pido.synthetic.laws import Law, Parameters

MISCALIBRATED = "miscalibrated:"


@dataclass(frozen=True)
class Effect:
    """id from the diagnosis vocabulary, or 'miscalibrated:<id>'; strength as above; shape: what is not drawn."""

    id: str
    axis: str
    strength: float = 2.0
    shape: dict[str, Any] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """As a diagnosis calls it."""
        if self.id.startswith(MISCALIBRATED):
            return "miscalibrated"
        if self.id == "unknown":
            return "unexplained"
        faults = ("time_misalignment", "sensor_gain", "sensor_offset", "sensor_clipping", "input_fault")
        return "data_fault" if self.id in faults else "missing_physics"


@dataclass(frozen=True)
class Effective:
    """amplitude: of the machine, simulated: of its simulation; law None for a fault of the data; achieved: strength."""

    effect: Effect
    law: Law | None
    amplitude: float
    simulated: float
    shape: dict[str, Any]
    achieved: float = np.nan
    parameters: Parameters = field(default_factory=dict)

    def told(self) -> dict[str, Any]:
        """For the sealed file."""
        shape = {k: v for k, v in self.shape.items() if not callable(v)}
        return {
            "mechanism": self.effect.id,
            "axis": self.effect.axis,
            "kind": self.effect.kind,
            "strength_asked": self.effect.strength,
            "strength": self.achieved,
            "amplitude": self.amplitude,
            "amplitude_in_simulation": self.simulated,
            "parameters": {k: {"value": v, "unit": unit} for k, (v, unit) in self.parameters.items()},
            "shape": shape,
        }


def acts(current: Float1D) -> Bool1D:
    """Where an effect's current stands out of its own average: above a tenth of its 99.5 % quantile."""
    size = np.abs(current)
    top = np.quantile(size, 0.995)
    if top == 0.0:  # shorter than 1 in 200 samples
        top = float(size.max(initial=0.0))
    return size > 0.1 * top if top > 0 else np.zeros(len(size), bool)


def strength_of(currents: list[Float1D], noise_rms: float) -> float:
    """Of the effect's recorded currents in several parts, over the noise."""
    pooled = np.concatenate(currents)
    where = acts(pooled)
    return float(np.sqrt(np.mean(pooled[where] ** 2)) / noise_rms) if where.any() else 0.0


def amplitude_for(strength: float, reached: Callable[[float], float], first: float, largest: float, name: str) -> float:
    """The amplitude at which `reached` gives `strength` within 1 %, by false position; `largest` where that comes near.

    Raises SettingsError where the effect never acts (say, cutting force in an air cut) or stays below half of it.
    """
    low, at_low = 0.0, 0.0
    amplitude = min(first, largest)
    now = reached(amplitude)
    while now < strength and amplitude < largest:
        if now == 0.0 and amplitude >= 1e6 * first:
            break
        low, at_low = amplitude, now
        amplitude = min(
            largest, amplitude * float(np.clip(1.02 * strength / now, 1.5, 20.0)) if now > 0 else 10 * amplitude
        )
        now = reached(amplitude)
    if now == 0.0:
        raise SettingsError(f"{name} never acts in these parts (no cut, no reversal, no coolant?): choose others.")
    high, at_high = amplitude, now
    for step in range(20):
        if abs(now - strength) <= 0.01 * strength or (now < strength and amplitude >= largest):
            break
        if step % 3 == 2 or at_high <= at_low:
            amplitude = 0.5 * (low + high)
        else:
            amplitude = low + (high - low) * (strength - at_low) / (at_high - at_low)
        now = reached(amplitude)
        if now < strength:
            low, at_low = amplitude, now
        else:
            high, at_high = amplitude, now
    if now < 0.5 * strength:
        raise SettingsError(
            f"{name} reaches a strength of {now:.2g} in these parts, {strength:g} was asked for: choose others."
        )
    return amplitude


def fault_told(effect: Effect, amplitude: float, shape: dict[str, Any]) -> Parameters:
    if effect.id == "input_fault":
        return {"size": (amplitude, "mm")}
    return fault_parameters(effect.id, amplitude, shape)
