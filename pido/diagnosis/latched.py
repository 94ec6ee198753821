"""What is switched by a quantity and stays so for a while, as a brake chopper, a lubrication or a clamp does: a model
without a name.

In:  the residual of one axis with its noise, and the quantities that may switch something.
Out: `Latched` terms worth a closer look.
All levels of a quantity are compared at once, by the largest value that it had within the time that something stays on.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.sparse import csr_array

from pido.core.arrays import Float1D, Float2D
from pido.core.axes import AXES
from pido.diagnosis.formulas import FORMS, Unnamed, side_of, written
from pido.diagnosis.judge import WORTH, Judge
from pido.diagnosis.levels import levels_of, neighbours
from pido.diagnosis.mechanisms.base import Parameter
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.signals import Known, signals
from pido.diagnosis.state import AxisState
from pido.diagnosis.terms import Term

_STAYS_S = (0.3, 1.0, 3.0, 10.0, 30.0)
_LEAST_SHARE = 0.01  # of the rows that it is on, and off
_CLOSER = 4  # of each quantity, that are looked at more closely
_BEST = 4
_FINE = 9  # levels, and times, that are compared around the best


@dataclass(frozen=True)
class Latched(Unnamed):
    """dI = k_0 + k * h; h = 1 while a quantity is above c, and for T after that.

    even : of |u| in place of u
    """

    signal: str
    unit: str
    even: bool

    passes_loop: ClassVar[bool] = False
    amplitudes: ClassVar[tuple[Parameter, ...]] = (Parameter("k", "A"), Parameter("k_0", "A"))

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.signal})

    @property
    def shape(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return Parameter("c", self.unit, scale="linear"), Parameter("T", "s", low=0.0, scale="log")

    @property
    def _written(self) -> str:
        return written(self.signal, side_of(self.even))

    @property
    def equation(self) -> str:  # type: ignore[override]
        return f"dI = k_0 + k * h; h = 1 while {self._written} > c and for T after that, else 0"

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        return f"while {self._written} > {shape['c']:.3g} {self.unit}, and for {shape['T']:.3g} s after that", ()

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        above = self.place(signals(state, [self.signal])[self.signal][0]) > shape["c"]
        last = np.maximum.accumulate(np.where(above, np.arange(len(above)), -1))
        on = (last >= 0) & (state.time - state.time[last] <= shape["T"])
        return np.column_stack([on.astype(float), np.ones(len(on))])

    def place(self, u: Float1D) -> Float1D:
        """(n,) – where values of the signal lie beside the level."""
        return FORMS[side_of(self.even)](u)

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        far = (0.1 if name == "c" else 0.3) * abs(shape[name])
        return shape[name] - far, shape[name] + far

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """The shape a step away; `by` is in tenths of the level, and of the time."""
        far = np.exp(0.1 * np.clip(by, -10, 10))
        return {"c": float(shape["c"] * far[0]), "T": float(shape["T"] * far[1])}


def latched_terms(judge: Judge, known: Known) -> list[Term]:
    """What takes away most of the whitened rows of a residual, the best of each quantity.

    known : `common_signals` of the mismatch
    """
    mismatch, felt = judge.mismatch, np.ascontiguousarray(judge.felt.T)
    found = []
    for law in _laws(mismatch.axis, known):
        u = law.place(known[law.signal][0])
        levels = levels_of(u)
        offered = [_best_level(u, levels, stays, felt, mismatch) for stays in _STAYS_S]
        most, level, stays = max(offered)
        if most < WORTH:
            continue
        finer = np.linspace(*neighbours(levels, level), _FINE)
        offered += [_best_level(u, finer, t, felt, mismatch) for t in stays * np.geomspace(0.5, 2.0, _FINE)]
        terms = [Term(law, (("c", c), ("T", t))) for gain, c, t in sorted(offered)[-_CLOSER:] if gain > WORTH]
        found += [judge.best(terms)] if terms else []
    return judge.ranked(found)[:_BEST]


def _laws(axis: str, known: Known) -> Iterator[Latched]:
    speeds = [f"v_{a}" for a in (axis, *AXES)]
    for name in dict.fromkeys([*speeds, "feed", f"a_{axis}", f"f_{axis}", f"I_{axis}", "M_sp", "MRR"]):
        if name in known:
            values, unit = known[name]
            yield Latched(name, unit, bool(values.min() < 0 < values.max()))


def _best_level(
    u: Float1D, levels: Float1D, stays: float, felt: Float2D, mismatch: Mismatch
) -> tuple[float, float, float]:
    """About what the best level takes away beside a constant, that level, and the time in s for which it stays on.

    felt : (n, 1 + signs), as a `Judge` has them
    """
    half = round(stays / mismatch.step / 2)
    most = [
        maximum_filter1d(u[i:j], 2 * half + 1, mode="constant", cval=-np.inf, origin=half)
        for i, j in itertools.pairwise(mismatch.edges)
    ]
    passed = np.searchsorted(levels, np.concatenate(most))  # levels that are below
    there = csr_array((np.ones(len(passed)), (passed, np.arange(len(passed)))), shape=(len(levels) + 1, len(passed)))
    on = np.cumsum((there @ felt)[::-1], axis=0)[::-1][1:]  # (levels, 1 + signs)
    rows = np.cumsum(np.bincount(passed, minlength=len(levels) + 1)[::-1])[::-1][1:] / len(passed)
    always = felt.sum(axis=0)
    size = np.mean(always[1:] ** 2) + 1e-300
    share = np.mean(on[:, 1:] * always[1:], axis=1) / size
    beside = on - share[:, None] * always
    left = np.mean(beside[:, 1:] ** 2, axis=1)
    met = (rows > _LEAST_SHARE) & (rows < 1 - _LEAST_SHARE) & (left > 0)
    gains = np.where(met, beside[:, 0] ** 2 / np.where(met, left, 1.0), 0.0)
    best = int(np.argmax(gains))
    return float(gains[best]), float(levels[best]), float(stays)
