"""What is switched by a quantity and stays so: for a while, as a brake chopper, a lubrication or a clamp does, or until
the quantity is below another level, as windings, gains and gears that are changed by speed do. Models without a name.

In:  the residual of one axis with its noise, and the quantities that may switch something.
Out: `Latched` and `Switched` terms worth a closer look.
All levels of a quantity are compared at once: by the largest value that it had within the time that something stays on;
in pairs, over stretches within which it passes none.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.sparse import csr_array

from pido.core.arrays import Bool1D, Float1D, Float2D, Int1D
from pido.core.axes import AXES
from pido.diagnosis.formulas import FORMS, Unnamed, ampere_per, side_of, unit_of, written
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
_PAIRED = 8  # levels evenly over a quantity, compared in pairs with as many by how often it is there
_QUANTILES = np.linspace(0.08, 0.92, _PAIRED)
_FINER = 5  # levels around each of the best pair


@dataclass(frozen=True)
class _AtLevels(Unnamed):
    """Something that levels of a quantity switch. even : of |u| in place of u"""

    signal: str
    unit: str
    even: bool

    passes_loop: ClassVar[bool] = False

    @property
    def _written(self) -> str:
        return written(self.signal, side_of(self.even))

    def place(self, u: Float1D) -> Float1D:
        """(n,) – where values of the signal lie beside the levels."""
        return FORMS[side_of(self.even)](u)


@dataclass(frozen=True)
class Latched(_AtLevels):
    """dI = k_0 + k * h; h = 1 while a quantity is above c, and for T after that."""

    amplitudes: ClassVar[tuple[Parameter, ...]] = (Parameter("k", "A"), Parameter("k_0", "A"))

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.signal})

    @property
    def shape(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return Parameter("c", self.unit, scale="linear"), Parameter("T", "s", low=0.0, scale="log")

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

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        far = (0.1 if name == "c" else 0.3) * abs(shape[name])
        return shape[name] - far, shape[name] + far

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """The shape a step away; `by` is in tenths of the level, and of the time."""
        far = np.exp(0.1 * np.clip(by, -10, 10))
        return {"c": float(shape["c"] * far[0]), "T": float(shape["T"] * far[1])}


@dataclass(frozen=True)
class Switched(_AtLevels):
    """dI = (k_0 + k * h) * q; h = 1 once a quantity is above c_on, until it is below c_off (Schmitt's trigger).

    carried, carried_unit, form : q as a form of a quantity; none: q = 1
    """

    carried: str = ""
    carried_unit: str = "–"
    form: str = "u"

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.signal, self.carried} - {""})

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        unit = ampere_per(unit_of([(self.carried_unit, self.form)]))
        return Parameter("k", unit), Parameter("k_0", unit)

    @property
    def shape(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return Parameter("c_on", self.unit, scale="linear"), Parameter("c_off", self.unit, scale="linear")

    @property
    def equation(self) -> str:  # type: ignore[override]
        law = f"(k_0 + k * h) * {written(self.carried, self.form)}" if self.carried else "k_0 + k * h"
        return f"dI = {law}; h = 1 once {self._written} > c_on, until {self._written} < c_off, else 0"

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        with_it = f"with {written(self.carried, self.form)}, " if self.carried else ""
        on, off = (f"{shape[c]:.3g} {self.unit}" for c in ("c_on", "c_off"))
        return f"{with_it}once {self._written} > {on}, until {self._written} < {off}", ()

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        known = signals(state, self.reads)
        u = self.place(known[self.signal][0])
        on = _switched(u > shape["c_on"], u < shape["c_off"], np.zeros(1, int))
        return np.column_stack([on, np.ones(len(on))]) * self.carrier(known)[:, None]

    def carrier(self, known: Known) -> Float1D:
        """(n,) – q, at values of the quantities."""
        return FORMS[self.form](known[self.carried][0]) if self.carried else np.ones(len(known[self.signal][0]))

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        far = 0.1 * abs(shape[name])
        return shape[name] - far, shape[name] + far

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """The shape a step away; `by` is in tenths of the levels."""
        far = np.exp(0.1 * np.clip(by, -10, 10))
        return {name: float(shape[name] * step) for name, step in zip(("c_on", "c_off"), far, strict=True)}


def _switched(on: Bool1D, off: Bool1D, starts: Int1D) -> Float1D:
    """(n,) – 1 from where it is switched on to where it is switched off, 0 elsewhere and before either."""
    at = np.where(on | off, np.arange(len(on)), -1)
    at[starts] = np.maximum(at[starts], starts)
    return on[np.maximum.accumulate(at)].astype(float)


def switched_terms(judge: Judge, known: Known) -> list[Term]:
    """What takes away most of the whitened rows of a residual, the best of each quantity that switches.

    known : `common_signals` of the mismatch
    """
    axis, edges, felt = judge.mismatch.axis, judge.mismatch.edges, np.ascontiguousarray(judge.felt.T)
    own = [(name, form) for name, form in ((f"I_{axis}", "u"), (f"v_{axis}", "sgn u")) if name in known]
    found = []
    for law in _laws(axis, known):
        offered = []
        for name, form in (("", "u"), *own):
            unit = known[name][1] if name else "–"
            trial = Switched(law.signal, law.unit, law.even, name, unit, form)
            offered += _best_levels(trial, known, felt, edges)
        best = [term for gain, term in sorted(offered, key=lambda o: -o[0])[:_CLOSER] if gain > WORTH]
        found += [judge.best(best)] if best else []
    return judge.ranked(found)[:_BEST]


def _best_levels(law: Switched, known: Known, felt: Float2D, edges: Int1D) -> list[tuple[float, Term]]:
    """The pairs of levels that take away most beside a factor on all of q, each with about what it takes away.

    felt : (n, 1 + signs), as a `Judge` has them
    """
    u, q = law.place(known[law.signal][0]), law.carrier(known)
    low, high = np.quantile(u, [0.01, 0.99])
    levels = np.unique(np.r_[np.linspace(low, high, _PAIRED), np.quantile(u, _QUANTILES)])
    found = _paired(u, q, levels, felt, edges)
    if found:
        _, *best = max(found)
        finer = np.unique([np.linspace(*neighbours(levels, c), _FINER) for c in best])
        found += _paired(u, q, finer, felt, edges)
    return [(gain, Term(law, (("c_on", on), ("c_off", off)))) for gain, on, off in found]


def _paired(u: Float1D, q: Float1D, levels: Float1D, felt: Float2D, edges: Int1D) -> list[tuple[float, float, float]]:
    """(about what it takes away, level on, level off) of the best pairs of `levels`, (k,) rising; all at once over
    stretches within which `u` passes none."""
    place = np.searchsorted(levels, u)  # levels that are below
    first = np.union1d(np.flatnonzero(np.r_[True, np.diff(place) != 0]), edges[:-1])
    at, starts = place[first], np.searchsorted(first, edges[:-1])
    long = np.diff(np.r_[first, len(u)]) / len(u)
    power = np.add.reduceat(q**2, first) / max(float(q @ q), 1e-300)
    sums = np.add.reduceat(felt * q[:, None], first, axis=0)
    pairs = [(i, j) for i in range(len(levels)) for j in range(i)]
    h = np.array([_switched(at > i, at <= j, starts) for i, j in pairs]).reshape(len(pairs), len(first))
    gains = _gains(h @ sums, sums.sum(axis=0), h @ power, h @ long)
    best = [(k, *pairs[k]) for k in np.argsort(gains)[: -_CLOSER - 1 : -1]]
    return [(float(gains[k]), float(levels[i]), float(levels[j])) for k, i, j in best]


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
    gains = _gains(on, felt.sum(axis=0), rows, rows)
    best = int(np.argmax(gains))
    return float(gains[best]), float(levels[best]), float(stays)


def _gains(on: Float2D, always: Float1D, share: Float1D, rows: Float1D) -> Float1D:
    """(k,) – about what each of some columns takes away beside one that is always on; nothing where it is on, or off,
    in too small a share of the rows.

    on : (k, 1 + signs), always : (1 + signs,) – products with the rows of a `Judge`. share : (k,), of the power of what
    is always on: how large a column is, random signs tell by chance, and of many columns one far too small
    """
    size = np.mean(always[1:] ** 2) + 1e-300
    common = np.mean(on[:, 1:] * always[1:], axis=1) / size
    beside = on - common[:, None] * always
    left, alone = np.mean(beside[:, 1:] ** 2, axis=1), share * (1 - share)
    each = np.divide(left, alone, out=np.zeros(len(left)), where=alone > 0)
    left = np.maximum(left, alone * np.median(each[alone > 0])) if np.any(alone > 0) else left
    met = (rows > _LEAST_SHARE) & (rows < 1 - _LEAST_SHARE) & (left > 0)
    return np.where(met, beside[:, 0] ** 2 / np.where(met, left, 1.0), 0.0)
