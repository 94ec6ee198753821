"""What the control writes down: encoders with a step, currents with coloured noise, at 500 Hz or smoothed to 50 Hz.

In:  noise-free signals at the control's cycle, a generator of random numbers.
Out: the columns of a recording.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from pido.core.arrays import Array1D, Float1D
from pido.core.columns import POSITION, UNITS
from pido.core.errors import SettingsError
from pido.synthetic.drive import CYCLE_S

BOX = 41
"""Samples of 500 Hz that one sample of 50 Hz is the mean of: 82 ms, as in the published recordings."""


@dataclass(frozen=True, slots=True)
class CurrentSensor:
    """Noise of a current at 500 Hz: rms in A of a slow part (first-order, slow_s), of white noise, and of what a cut
    of 100 N adds (first-order, 10 ms); resolution_a is the step of the converter."""

    slow_a: float = 0.02
    slow_s: float = 0.15
    white_a: float = 0.08
    cutting_a: float = 0.003
    resolution_a: float = 0.0005

    def noise(self, force_n: Float1D, rng: np.random.Generator) -> Float1D:
        """(n,), A, for a cut with the force force_n (n,), N."""
        n = len(force_n)
        slow = self.slow_a * _first_order(rng.standard_normal(n), self.slow_s)
        cut = self.cutting_a * np.abs(force_n) / 100.0 * _first_order(rng.standard_normal(n), 0.01)
        return slow + self.white_a * rng.standard_normal(n) + cut


@dataclass(frozen=True, slots=True)
class Sensors:
    """encoder_mm, encoder_deg: steps of the encoders; encoder_noise_mm: rms; current: per axis, also 'sp'."""

    current: dict[str, CurrentSensor]
    encoder_mm: float = 1.0e-6
    encoder_deg: float = 1.0e-3
    encoder_noise_mm: float = 5.0e-6

    def check(self) -> None:
        """Raises SettingsError where a step or a noise is negative."""
        values = [self.encoder_mm, self.encoder_deg, self.encoder_noise_mm]
        values += [
            v for s in self.current.values() for v in (s.slow_a, s.slow_s, s.white_a, s.cutting_a, s.resolution_a)
        ]
        if min(values) < 0:
            raise SettingsError("sensors: noise and resolution cannot be negative.")

    def position(self, pos: Float1D, rng: np.random.Generator, step: float | None = None) -> Float1D:
        """An encoder's reading of pos (mm); `step` in its unit for another encoder, which then has no noise."""
        if step is not None:
            return quantised(pos, step)
        return quantised(pos + self.encoder_noise_mm * rng.standard_normal(len(pos)), self.encoder_mm)


def quantised(values: Float1D, step: float) -> Float1D:
    """Rounded to whole steps; a step of 0 leaves them as they are."""
    return np.round(values / step) * step if step > 0 else values


def derivative(values: Float1D) -> Float1D:
    """Central difference at the control's cycle."""
    return np.gradient(values, CYCLE_S)


def smoothed(columns: Mapping[str, Array1D], every: int = 10) -> dict[str, Array1D]:
    """From 500 Hz to 500 / every: numbers of physical quantities are means over `BOX` samples, the rest is picked.

    >>> out = smoothed({"time": np.arange(100) * 0.002, "curr_x": np.ones(100), "nc_line": np.arange(100)})
    >>> len(out["time"]), out["curr_x"].tolist() == [1.0] * 6, out["nc_line"][:2].tolist()
    (6, True, [20, 30])
    """
    n = len(columns["time"])
    centres = np.arange(BOX // 2, n - BOX // 2, every)
    out: dict[str, Array1D] = {}
    for name, values in columns.items():
        physical = name in UNITS and UNITS[name] not in ("–", "s")
        out[name] = box(values)[centres] if physical else np.asarray(values)[centres]
    out["time"] = out["time"] - out["time"][0]
    return out


def box(values: Float1D) -> Float1D:
    """Mean over `BOX` samples around each; at the ends over those that exist."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    i = np.arange(len(values))
    low, high = np.maximum(i - BOX // 2, 0), np.minimum(i + BOX // 2 + 1, len(values))
    return (total[high] - total[low]) / (high - low)


def wrapped(columns: Mapping[str, Array1D]) -> dict[str, Array1D]:
    """The spindle's angle as its encoder counts it, 0 to 360 deg."""
    return {**columns, POSITION["sp"]: np.mod(columns[POSITION["sp"]], 360.0)}


def _first_order(white: Float1D, tau_s: float) -> Float1D:
    """Unit white noise through a first-order filter, scaled back to rms 1; it begins in its steady state."""
    keep = np.exp(-CYCLE_S / tau_s) if tau_s > 0 else 0.0
    drive = white * np.sqrt(1 - keep**2)
    if len(drive):
        drive[0] = white[0]
    return np.asarray(lfilter([1.0], [1.0, -keep], drive))
