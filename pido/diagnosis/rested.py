"""A friction that grows while an axis stands and fades as it moves: a model without a name.

In:  the residual of one axis as averages, and its motion.
Out: `Rested` terms worth a closer look.
Source: rate- and state-dependent friction (Dieterich 1979): a contact strengthens while it stands, and is renewed over
a way.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pido.core.arrays import Float1D, Float2D, Int1D
from pido.core.axes import LINEAR_AXES
from pido.diagnosis.flexible import Coarse, price
from pido.diagnosis.formulas import Unnamed
from pido.diagnosis.mechanisms.base import Parameter
from pido.diagnosis.mechanisms.sliding import direction
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.state import AxisState
from pido.diagnosis.terms import Term

_BEST = 6  # by the averages
_GROWS_S = (0.5, 2.0, 8.0, 30.0)
_FADES = {"mm": (0.3, 1.0, 3.0, 10.0, 30.0), "s": (0.1, 0.3, 1.0, 3.0)}


@dataclass(frozen=True)
class Rested(Unnamed):
    """dI = k * z * sgn(v) in motion; z grows at rest as dz/dt = (1 - z) / tau, and fades in motion as dz/ds = -z / L.

    s : the way, or the time, that the axis moves, in `unit`; every part begins with z = 0
    """

    axis: str
    unit: str

    amplitudes: ClassVar[tuple[Parameter, ...]] = (Parameter("k", "A"),)

    @property
    def shape(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return Parameter("tau", "s", low=0.0, scale="log"), Parameter("L", self.unit, low=0.0, scale="log")

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({f"v_{self.axis}"})

    @property
    def equation(self) -> str:  # type: ignore[override]
        along = {"mm": "way", "s": "time"}[self.unit]
        grows = "dz/dt = (1 - z) / tau while the axis stands"
        return f"dI = k * z * sgn(v_{self.axis}), at rest 0; {grows}, dz/ds = -z / L in motion, s = {along}"

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        return _Motions.of(state, self.unit).strength(np.arange(len(state.time)), shape["tau"], shape["L"])[:, None]

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        within = f"within {3 * shape['L']:.3g} {self.unit} after it begins to move"
        return f"{axis} axis, {within}, more after a longer rest", (f"v_{axis} != 0",)

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        return shape[name] / 2, shape[name] * 2

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """The shape a step away; `by` is in powers of e."""
        far = np.exp(np.clip(by, -3, 3))
        return {"tau": float(shape["tau"] * far[0]), "L": float(shape["L"] * far[1])}


@dataclass(frozen=True)
class _Motions:
    """When an axis of one part moves, from `starts` to before `stops` (k,), after how long a rest (k,) in s.

    gone : (n,), how far or how long it has moved so far; direction : (n,), 0 at rest
    """

    starts: Int1D
    stops: Int1D
    rests: Float1D
    gone: Float1D
    direction: Float1D

    @classmethod
    def of(cls, state: AxisState, unit: str) -> _Motions:
        """unit : mm of way or s of time, in which `gone` counts"""
        moving = np.r_[False, state.moving, False]
        starts, stops = np.flatnonzero(moving[1:] & ~moving[:-1]), np.flatnonzero(~moving[1:] & moving[:-1])
        steps = np.diff(state.time, prepend=state.time[:1]) * (np.abs(state.v) if unit == "mm" else 1.0)
        rests = state.time[starts] - state.time[np.r_[0, stops - 1][: len(starts)]]
        return cls(starts, stops, rests, np.cumsum(np.where(state.moving, steps, 0.0)), direction(state))

    def strength(self, rows: Int1D, tau: float, length: float) -> Float1D:
        """z * sgn(v) in some rows."""
        if not len(self.starts):
            return np.zeros(len(rows))
        left = np.exp(-(self.gone[self.stops - 1] - self.gone[self.starts]) / length)
        missing = np.exp(-self.rests / tau)
        first, z = np.zeros(len(self.starts)), 0.0
        for i, (m, end) in enumerate(zip(missing, left, strict=True)):
            first[i] = 1.0 - (1.0 - z) * m
            z = first[i] * end
        at = np.maximum(np.searchsorted(self.starts, rows, side="right") - 1, 0)
        return first[at] * np.exp(-(self.gone[rows] - self.gone[self.starts[at]]) / length) * self.direction[rows]


def rested_terms(mismatch: Mismatch, few: Coarse) -> list[Term]:
    """The best of these laws, by what is left, as averages."""
    starts = any(np.any(s.moving[1:] & ~s.moving[:-1]) for s in mismatch.states)
    if mismatch.axis not in LINEAR_AXES or not starts:
        return []
    spans = list(itertools.pairwise(mismatch.edges))
    rows = [few.rows[(few.rows >= i) & (few.rows < j)] - i for i, j in spans]
    found = []
    for unit, lengths in _FADES.items():
        law, motions = Rested(mismatch.axis, unit), [_Motions.of(s, unit) for s in mismatch.states]
        for tau, length in itertools.product(_GROWS_S, lengths):
            z = np.concatenate([m.strength(r, tau, length) for m, r in zip(motions, rows, strict=True)])
            found.append((price(z[:, None], few), Term(law, (("tau", tau), ("L", length)))))
    return [term for _, term in sorted(found, key=lambda each: each[0])[:_BEST]]
