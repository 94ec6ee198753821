"""Forces that come and go by themselves: intervals of time with a level that no state explains.

In:  what is left of the mismatch, whitened, per part.
Out: `ExternalForce`, one level per interval. It belongs to the parts it was seen in and is never carried to another.
Source: circular binary segmentation (Olshen et al. 2004): the interval with the largest likelihood gain is taken, removed,
and the search repeated while the gain pays for two ends and a level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.diagnosis.mechanisms.base import Mechanism, Parameter
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.state import AxisState
from pido.diagnosis.whiten import Noise

_BINS = 300  # per part, in which ends of intervals are searched
_MOST_PER_PART = 4
_LONGEST_SHARE = 0.6  # of a part: a longer stretch is a level of that part, not an event


@dataclass(frozen=True)
class ExternalForce(Mechanism):
    """One level per interval of time."""

    intervals: tuple[tuple[str, float, float], ...]  # (part, from s, to s)

    id: ClassVar[str] = "external_force"
    equation: ClassVar[str] = "dI = F(t), piecewise constant over separate intervals"
    kind: ClassVar[Any] = "missing_physics"
    shape: ClassVar[tuple[Parameter, ...]] = ()

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return tuple(Parameter(f"F_{i + 1}", "A") for i in range(len(self.intervals)))

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        return np.column_stack(
            [
                ((state.time >= start) & (state.time < end) if part == state.part else np.zeros(len(state.time)))
                for part, start, end in self.intervals
            ]
        ).astype(float)

    def applies(self, states: Sequence[AxisState]) -> str | None:
        return None


def find_events(mismatch: Mismatch, noise: Noise, residual: Float1D) -> ExternalForce | None:
    """Intervals whose level stands out of `residual` (whitened, (n,)), or None."""
    # A constant c becomes c * (1 - sum of ar) / (level * innovation) once whitened.
    unit = noise.valid * (1 - float(np.sum(noise.ar))) / (noise.level * noise.innovation)
    penalty = 3 * np.log(max(2, int(noise.valid.sum()))) + 10
    found: list[tuple[str, float, float]] = []
    for p, (i, j) in enumerate(zip(mismatch.edges[:-1], mismatch.edges[1:], strict=True)):
        time = mismatch.states[p].time
        width = max(1, (j - i) // _BINS)
        bins = np.arange(j - i) // width
        score = np.bincount(bins, residual[i:j] * unit[i:j])
        weight = np.bincount(bins, unit[i:j] ** 2)
        for _ in range(_MOST_PER_PART):
            best = _best_interval(score, weight)
            if best is None or best[2] < penalty:
                break
            first, last, _, level = best
            found.append((mismatch.parts[p], float(time[first * width]), float(time[min(last * width, j - i) - 1]) + 1e-9))
            score[first:last] -= level * weight[first:last]
    return ExternalForce(tuple(found)) if found else None


def _best_interval(score: Float1D, weight: Float1D) -> tuple[int, int, float, float] | None:
    s, w = np.r_[0.0, np.cumsum(score)], np.r_[0.0, np.cumsum(weight)]
    total = s[None, :] - s[:, None]
    mass = w[None, :] - w[:, None]
    first, last = np.triu_indices(len(s), k=2)
    short = last - first <= _LONGEST_SHARE * len(score)
    first, last = first[short], last[short]
    m = mass[first, last]
    gain = np.where(m > 0, total[first, last] ** 2 / np.maximum(m, 1e-12), 0.0)
    if len(gain) == 0:
        return None
    k = int(np.argmax(gain))
    return int(first[k]), int(last[k]), float(gain[k]), float(total[first[k], last[k]] / max(m[k], 1e-12))
