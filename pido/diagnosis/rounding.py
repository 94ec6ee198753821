"""What the steps of a coarse converter leave of a current: the mean of a rounded signal is not that signal.

In:  recorded and simulated currents of one axis. Out: `Rounding`: what rounding adds to the mean of a recording, which
     is no physics.
A signal that rests between two steps is read as the nearer one; noise of more than a third of a step evens that out.
Source: Widrow and Kollár, Quantization Noise (2008), ch. 4: mean of a rounded sum of a signal and normal noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.core.columns import CURRENT, CURRENT_SIM
from pido.core.recording import Recording
from pido.diagnosis.consistency import rounded_to

_NOISES = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35)  # of a step
_HARMONICS = 4
_ROWS = 20_000  # that are compared
_MOMENT = 20  # rows in which a mismatch hardly changes
_EVENED_OUT = 0.55  # of a step: scatter of rounded noise of a third of one, and of the rounding of what moves beside it
_SMALL = 0.25  # of a step, rms of a mismatch beside which it is still known where between two steps a current rests
_WORTH = 50.0  # of 2 log likelihood: one number, on rows that are not quite independent


@dataclass(frozen=True)
class Rounding:
    """step : A, between two values of a converter that reads the nearest; noise : A, standard deviation before that;
    zero : A, one of its values."""

    step: float
    noise: float
    zero: float

    def bias(self, current: Float1D) -> Float1D:
        """(n,), A – mean of a rounded current less the current itself:

        sum over k of (-1)^k q / (pi k) exp(-2 (pi k sd / q)²) sin(2 pi k (i - zero) / q)

        >>> Rounding(0.2, 0.0, 0.0).bias(np.array([0.0, 0.05, 0.15])).round(2).tolist()
        [0.0, -0.04, 0.04]
        """
        q, out = self.step, np.zeros(len(current))
        for k in range(1, _HARMONICS + 1):
            size = (-1) ** k * q / (np.pi * k) * np.exp(-2 * (np.pi * k * self.noise / q) ** 2)
            out += size * np.sin(2 * np.pi * k * (current - self.zero) / q)
        return out

    def note(self, axis: str) -> str:
        """For the reader of a diagnosis."""
        most = float(np.max(np.abs(self.bias(self.zero + np.linspace(0.0, self.step, 101)))))
        return (
            f"axis {axis}: the recorded current is in steps of {self.step:.3g} A, coarser than its noise; what "
            f"rounding to them leaves of the mean, up to {most:.2g} A, is taken out before anything is compared."
        )


def rounding_of(parts: Sequence[Recording], axis: str) -> Rounding | None:
    """How the recorded current of an axis was rounded, where that shows in its difference from the simulated one."""
    recorded = np.concatenate([np.asarray(r[CURRENT[axis]], float) for r in parts])
    simulated = np.concatenate([np.asarray(r[CURRENT_SIM[axis]], float) for r in parts])
    known = np.flatnonzero(np.isfinite(recorded) & np.isfinite(simulated))
    rows = known[:: 1 + len(known) // _ROWS]
    step = rounded_to(recorded[rows])
    if step == 0.0 or len(rows) < _ROWS // 100:
        return None
    if _scatter(recorded[known] - simulated[known]) > _EVENED_OUT * step:
        return None
    difference, current = recorded[rows] - simulated[rows], simulated[rows]
    tried = [Rounding(step, noise * step, float(recorded[rows[0]])) for noise in _NOISES]
    left = [float(np.mean((difference - each.bias(current)) ** 2)) for each in tried]
    best = int(np.argmin(left))
    mismatch = _moments(recorded[known] - simulated[known] - tried[best].bias(simulated[known])).mean(axis=1)
    if np.sqrt(np.mean(mismatch**2)) > _SMALL * step:
        return None
    gain = len(rows) * np.log(float(np.mean(difference**2)) / max(left[best], 1e-300))
    return tried[best] if gain > _WORTH else None


def _scatter(difference: Float1D) -> float:
    """A, standard deviation within a moment: a mismatch, which may look like what rounding leaves, is not in it."""
    moments = _moments(difference)
    return float(np.median(np.std(moments, axis=1))) if len(moments) else 0.0


def _moments(rows: Float1D) -> Float2D:
    """(m, _MOMENT) – what is measured one moment after another."""
    return rows[: len(rows) // _MOMENT * _MOMENT].reshape(-1, _MOMENT)
