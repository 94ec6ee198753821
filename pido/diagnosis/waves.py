"""Loads and frictions that are periodic along a travel, of this axis or of another, over its speed, with the way
of all axes, the volume removed, in time or since an event: a model without a name.

In:  the residual of one axis as averages, and the quantities that could carry a wave.
Out: `Wave` terms worth a closer look, their periods read from the residual itself.
Source: least-squares spectral analysis (Lomb 1976; Scargle 1982), over a place in place of time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.diagnosis.flexible import Coarse
from pido.diagnosis.formulas import FORMS, Unnamed, ampere_per, unit_of, written
from pido.diagnosis.mechanisms.base import Parameter
from pido.diagnosis.signals import CLOCKS, LONG_S, Known, signals
from pido.diagnosis.state import AxisState
from pido.diagnosis.terms import Term

_SHORTEST_MM = 2.0  # pitch of the finest ball screws
_SHORTEST_S = 0.2
_SHORTEST_PULSE_S = 0.5
_LEAST_PULSES = 3.0  # in the longest part: fewer are a drift
_SPEEDS = 200  # classes of the speed
_SPEEDS_PER_WAVE = 8.0  # classes that are met, at least
_PLACES_PER_WAVE = 8.0
_LEAST_PLACES = 12.0  # at which what carries a wave is, counted by its power: one wave and a half
_LOOKED_AT = 40  # wave numbers of one travel, best first
_LEAST_OVER_SPEED = 3.0  # waves over all speeds: fewer are some friction
_TURN = 360.0  # deg
_SOME_REST = 0.02  # share of the rows in which an axis stands: with fewer, its last direction is the sign of its speed
_OF_A_TURN = (1, 2, 3, 4, 5, 6)  # waves in one turn of the spindle: its own, and of as many teeth or poles
_HARMONICS = (1, 3, 6)  # what repeats itself need not be a sine
_PER_WAVE = 4  # wave numbers tried per independent one
_MOST = 1_200  # wave numbers of one travel
_AT_ONCE = 64  # wave numbers that are compared in one product
_MOST_NEAR = 200  # wave numbers to either side of one that a single part has shown
_CARRIERS_IN_TIME = 2  # for which the phases of the parts are compared


@dataclass(frozen=True)
class Wave(Unnamed):
    """dI = sum over n of (k_sn sin(2 pi n s / L) + k_cn cos(2 pi n s / L)) * p(u) over a place s; without a signal 1.

    harmonics : n from 1 to this; form : p
    """

    place: str
    length: str  # unit of the place
    signal: str
    unit: str
    harmonics: int = 1
    form: str = "u"

    @property
    def shape(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return (Parameter("L", self.length, low=0.0, scale="log"),)

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.place, self.signal} - {""})

    @property
    def equation(self) -> str:  # type: ignore[override]
        s, u = self.place, f" * {self._carrier}" * bool(self.signal)
        if self.harmonics == 1:
            wave = f"k_s sin(2 pi {s} / L) + k_c cos(2 pi {s} / L)"
            return f"dI = ({wave}){u}" if u else f"dI = {wave}"
        wave = f"k_sn sin(2 pi n {s} / L) + k_cn cos(2 pi n {s} / L)"
        return f"dI = sum of {wave} for n = 1 .. {self.harmonics}" + f", all{u}" * bool(u)

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        per = ampere_per(unit_of([(self.unit, self.form)]))
        count = [""] if self.harmonics == 1 else [str(n + 1) for n in range(self.harmonics)]
        return tuple(Parameter(f"k_{side}{n}", per) for n in count for side in "sc")

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        return self.over(signals(state, self.reads), shape["L"])

    def over(self, known: Known, period: float) -> Float2D:
        """(n, amplitudes) – what each counts for, at values of the quantities."""
        s = known[self.place][0]
        angle = 2 * np.pi * s / period
        rows = np.column_stack([f(n * angle) for n in range(1, self.harmonics + 1) for f in (np.sin, np.cos)])
        return rows * _there(self.place, s, _carried(known, self.signal, self.form))[:, None]

    @property
    def _carrier(self) -> str:
        return written(self.signal, self.form)

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        own = f", with {self._carrier}" if self.signal else ""
        return f"repeating every {shape['L']:.3g} {self.length} of {self.place}{own}", ()

    def variants(self) -> tuple[Unnamed, ...]:
        return tuple(replace(self, harmonics=n) for n in _HARMONICS if n > self.harmonics == 1)

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        far = 0.5 / max(self._waves(shape["L"], states), 1.0)
        return shape["L"] * (1 - far), shape["L"] / (1 - far)

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """The period a step away, in hundredths of itself."""
        return {"L": float(shape["L"] * np.exp(0.01 * by[0]))}

    def _waves(self, period: float, states: Sequence[AxisState]) -> float:
        places = [signals(s, [self.place])[self.place][0] for s in states]
        return (max(p.max() for p in places) - min(p.min() for p in places)) / period


def waves(axis: str, known: Known, few: Coarse) -> list[tuple[float, Term]]:
    """The best period of every place and carrier, each with what it would take away by itself.

    known : signals in the rows of `few`
    """
    found = []
    found += _in_time(axis, known, few)
    travels = [n for n in known if n.startswith("pos_") or n in (f"d_{axis}", f"way_{axis}", "way_all", "removed")]
    for place in (*travels, *(n for n in (f"v_{axis}", *_times(axis)) if n in known)):
        s = known[place][0]
        numbers = _wave_numbers(place, s)
        carriers = _carriers(axis, known, place)
        if not len(numbers) or not carriers:
            continue
        rows = _rows(known, place, carriers)
        gain = _gains(rows, s, numbers, few).T
        for (name, form), row, own in zip(carriers, rows, gain, strict=True):
            best = _best_that_is_met(place, s, row**2, numbers, own)
            if best is None:
                continue
            found.append((float(own[best]), _term(known, place, name, form, numbers[best])))
    return found


def _in_time(axis: str, known: Known, few: Coarse) -> list[tuple[float, Term]]:
    """The best period of every carrier on either clock: what comes again by itself, as a pulse of oil does.

    Each part has a phase of its own where periods are looked for, since a clock of days has more of them than can be
    tried; the period is moved to where all parts agree afterwards.
    """
    clocks = [n for n in CLOCKS if n in known]
    if not clocks:
        return []
    parts = [few.part == p for p in np.unique(few.part)]
    longest = max(float(np.ptp(known[clocks[0]][0][part])) for part in parts)
    most = min(longest / _SHORTEST_PULSE_S, _LEAST_PULSES + _MOST / _PER_WAVE)
    numbers = np.arange(_LEAST_PULSES, most, 1 / _PER_WAVE) / longest if longest > 0 else np.zeros(0)
    if not len(numbers):
        return []
    s, carriers = known[clocks[0]][0], _carriers(axis, known, clocks[0])
    rows = _rows(known, clocks[0], carriers)
    apart = np.sum([_gains(rows[:, p], s[p], numbers, few.of(p)) for p in parts], axis=0)
    found = []
    for i in np.argsort(-apart.max(axis=0))[:_CARRIERS_IN_TIME]:
        name, form = carriers[i]
        for clock in clocks:
            s = known[clock][0]
            near = _near(float(numbers[np.argmax(apart[:, i])]), longest, float(np.ptp(s)))
            gain = _gains(rows[i : i + 1], s, near, few)[:, 0]
            found.append((float(gain.max()), _term(known, clock, name, form, near[np.argmax(gain)])))
    return found


def _rows(known: Known, place: str, carriers: Sequence[tuple[str, str]]) -> Float2D:
    """(k, m) – the carriers where the place is one, each at its own scale."""
    rows = np.array([_there(place, known[place][0], _carried(known, name, form)) for name, form in carriers])
    return rows / np.maximum(np.max(np.abs(rows), axis=1, keepdims=True), 1e-300)


def _term(known: Known, place: str, name: str, form: str, number: float) -> Term:
    """The wave of `number` per unit of the place on one carrier."""
    wave = Wave(place, known[place][1], name, known[name][1] if name else "–", form=form)
    return Term(wave, (("L", float(1 / number)),))


def _near(number: float, longest: float, span: float) -> Float1D:
    """Wave numbers that one part of length `longest` does not tell from `number`, a quarter of a wave apart over the
    whole span."""
    count = int(np.clip(_PER_WAVE * span / longest, _PER_WAVE, _MOST_NEAR))
    near = number + np.linspace(-0.5, 0.5, 2 * count + 1) / longest
    return near[near > 0]


def _best_that_is_met(place: str, s: Float1D, power: Float1D, numbers: Float1D, gain: Float1D) -> int | None:
    """The wave number that takes most away of those whose waves are met at many places, (n,) – of what carries them:
    a few places are met by some wave whatever happens at each of them."""
    ranked = np.argsort(-gain)[:_LOOKED_AT]
    if place == "pos_sp" or place.startswith("v_"):
        return int(ranked[0])
    for k in ranked:
        at = np.floor((s - s.min()) * numbers[k] * _PLACES_PER_WAVE).astype(int)
        there = np.bincount(at, power)
        if there.sum() ** 2 >= _LEAST_PLACES * (there @ there) > 0:
            return int(k)
    return None


def _times(axis: str) -> tuple[str, ...]:
    """Signals that count the time since an event."""
    return f"t_go_{axis}", f"stood_{axis}", "t_block", "t_cut"


def _there(place: str, s: Float1D, carrier: Float1D | float) -> Float1D:
    """(n,) – the carrier where the place is one: a time is none before its event, nor once it counts no more."""
    event = place.startswith(("t_", "stood_")) and place not in CLOCKS
    return np.where((s > 0) & (s < LONG_S) if event else np.ones(len(s), bool), carrier, 0.0)


def _wave_numbers(place: str, s: Float1D) -> Float1D:
    """Of the waves that are tried, per unit of the place."""
    travel = float(np.ptp(s))
    if travel == 0:
        return np.zeros(0)
    if place == "pos_sp":
        return np.array(_OF_A_TURN) / _TURN
    if place.startswith("v_"):
        # A few speeds are met by some wave whatever happens at each of them.
        met = len(np.unique(np.round((s - s.min()) / travel * _SPEEDS)))
        return np.arange(_LEAST_OVER_SPEED, met / _SPEEDS_PER_WAVE, 1 / _PER_WAVE) / travel
    most = travel / (_SHORTEST_S if place.startswith(("t_", "stood_")) else _SHORTEST_MM)
    return np.arange(1.0, most, 1 / _PER_WAVE)[:_MOST] / travel


def _carriers(axis: str, known: Known, place: str) -> list[tuple[str, str]]:
    """Signals and forms: none, for a wave by itself; a friction along the axis, held at rest or none there; the loads
    on it. Over the axis' own place the catalogue has a wave by itself and that of Coulomb's friction. Over its speed a
    wave goes by itself."""
    speed = f"v_{axis}"
    if place == speed:
        return [("", "u")]
    stands = speed in known and np.mean(known[speed][0] == 0) > _SOME_REST
    friction = ((f"held_{axis}", "u"), *([(speed, "sgn u")] if stands else []))
    own = (("", "u"), *friction) if place != f"pos_{axis}" else ()
    loads = [(name, "u") for name in (speed, f"f_{axis}", f"I_{axis}", "M_sp")]
    # Along its own travel also by how large its load is, whichever way.
    loads += [(f"I_{axis}", form) for form in ("|u|", "u²")] if place == f"pos_{axis}" else []
    return [(name, form) for name, form in (*own, *loads) if not name or name in known]


def _carried(known: Known, name: str, form: str) -> Float1D | float:
    """What carries a wave, (n,): one where that is nothing."""
    carried: Float1D | float = FORMS[form](known[name][0]) if name else 1.0
    return carried


def _gains(rows: Float2D, place: Float1D, numbers: Float1D, few: Coarse) -> Float2D:
    """(wave numbers, k) – what sine and cosine of each of `numbers`, evenly spaced, times each of `rows` (k, m) take
    away together."""
    by_value, by_power = rows * (few.weights * few.values), rows**2 * few.weights
    apart = float(numbers[1] - numbers[0]) if len(numbers) > 1 else 0.0
    on = np.exp(2j * np.pi * apart * np.outer(place, np.arange(min(_AT_ONCE, len(numbers)))))
    on_twice = on**2
    inner, twice = np.zeros((2, 0, len(rows)), complex)
    for first in numbers[::_AT_ONCE]:
        turning = np.exp(2j * np.pi * first * place)
        inner = np.concatenate([inner, ((by_value * turning) @ on).T])
        twice = np.concatenate([twice, ((by_power * turning**2) @ on_twice).T])
    inner, twice = inner[: len(numbers)], twice[: len(numbers)]
    whole = by_power.sum(axis=1)
    # Normal equations of cosine and sine: half of (whole + Re, Im; Im, whole - Re).
    det = np.maximum(whole**2 - np.abs(twice) ** 2, 1e-9 * whole**2 + 1e-300)
    b, c = np.real(inner), np.imag(inner)
    return 2 * ((whole - np.real(twice)) * b**2 - 2 * np.imag(twice) * b * c + (whole + np.real(twice)) * c**2) / det
