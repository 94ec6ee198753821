"""A model without a name of an axis that rings after a change.

In:  the residual of one axis, and the quantities that could drive it.
Out: `Ringing` and `RingingAlong` terms worth a closer look, their frequencies read from the residual itself.
What rings faster at one place than at another does so evenly on a clock that runs as fast as it rings there: on this
clock it is looked for, and filtered.
Source: transfer function estimate H1 = Sxy / Sxx (Welch); first-order hold of a linear oscillator (Franklin, Powell and
Workman, Digital Control of Dynamic Systems, ch. 6).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, cast

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import signal as dsp

from pido.core.arrays import Complex2D, Float1D, Float2D
from pido.core.axes import LINEAR_AXES
from pido.diagnosis.formulas import Unnamed
from pido.diagnosis.mechanisms.base import Parameter
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.signals import Known, signals
from pido.diagnosis.state import AxisState
from pido.diagnosis.terms import Term

_WINDOW_S = 20.0  # of a spectrum
_SLOWEST_HZ = 0.2
_FASTEST = 0.4  # of the sampling rate
_MODES = 5  # peaks of a spectrum that are looked at
_DAMPING = (0.015, 0.06, 0.2)
_PER_REACH = (0.08, 0.16, 0.24, 0.35, 0.5)  # powers of e by which a frequency changes over half a travel
_MOST_FASTER = 1.0  # powers of e
_FINER = 4  # steps of the clock in one of the recording, or more
_STANDS_OUT = 30.0  # times the usual coherent power, from which a peak is worth other clocks
_MOST_DAMPED = 0.4  # beyond it nothing rings: that is `late.Lagged`


@dataclass(frozen=True)
class Ringing(Unnamed):
    """What a lightly damped oscillator adds to the quasi-static answer to a quantity u:

    dI = k_s * (w² / D - 1) u + k_v * (w s / D) u,  D = s² + 2 zeta w s + w²,  w = 2 pi f
    """

    signal: str
    unit: str

    passes_loop: ClassVar[bool] = False
    shape: ClassVar[tuple[Parameter, ...]] = (
        Parameter("f", "Hz", low=0.0, scale="log"),
        Parameter("zeta", "–", low=0.0, scale="log"),
    )

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.signal})

    @property
    def equation(self) -> str:  # type: ignore[override]
        u = self.signal
        return f"dI = k_s * (w²/D - 1) {u} + k_v * (w s/D) {u}, D = s² + 2 zeta w s + w², w = 2 pi f"

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return Parameter("k_s", f"A/({self.unit})"), Parameter("k_v", f"A/({self.unit})")

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        u = signals(state, [self.signal])[self.signal][0]
        dt = _step(state)
        if dt <= 0 or shape["f"] * dt > 0.5:
            return np.zeros((len(u), 2))
        return _answer(u, 2 * np.pi * shape["f"], shape["zeta"], dt)

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        return f"ringing at {shape['f']:.3g} Hz after changes of {self.signal}", ()

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        far = 2 * min(shape["zeta"], 1.0) if name == "f" else 0.7
        most = np.inf if name == "f" else max(1.0, shape["zeta"])  # what is damped more does not ring
        return shape[name] * float(np.exp(-far)), min(shape[name] * float(np.exp(far)), most)

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """The shape a step away; `by` is in widths of the resonance and in powers of e."""
        zeta = float(np.clip(shape["zeta"] * np.exp(np.clip(by[1], -3, 3)), 1e-3, _MOST_DAMPED))
        return {"f": max(_SLOWEST_HZ, float(shape["f"] * np.exp(2 * shape["zeta"] * by[0]))), "zeta": zeta}


@dataclass(frozen=True)
class RingingAlong(Ringing):
    """The same, of what rings at another frequency at another place s, as a column does that is drawn out:
    w = 2 pi f exp(g (s - middle)).

    place, length : s and its unit; middle, reach : of its travel, and half of that
    Source: position-dependent dynamics of machine tools (Altintas et al. 2005, CIRP Annals 54, 115).
    """

    place: str = ""
    length: str = "mm"
    middle: float = 0.0
    reach: float = 1.0

    @property
    def shape(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return (*Ringing.shape, Parameter("g", f"1/{self.length}", scale="linear"))

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.signal, self.place})

    @property
    def equation(self) -> str:  # type: ignore[override]
        return f"{super().equation} exp(g ({self.place} - {self.middle:.4g} {self.length}))"

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        known = signals(state, self.reads)
        clock = _clock(known[self.place][0] - self.middle, shape["g"], _step(state))
        if clock is None:
            return np.zeros((len(state.time), 2))
        u = clock.evenly(known[self.signal][0])
        w, zeta = 2 * np.pi * shape["f"], shape["zeta"]
        return np.column_stack([clock.back(column) for column in _answer(u, w, zeta, clock.step).T])

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        said, conditions = super().conditions(axis, shape)
        return f"{said}, {'faster' if shape['g'] > 0 else 'slower'} the further {self.place} is", conditions

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        if name != "g":
            return super().around(name, shape, states)
        far = 2 * min(shape["zeta"], 1.0) / self.reach
        return shape["g"] - far, shape["g"] + far

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """As of `Ringing`; `by` of the change along the way is in widths of the resonance over half the travel."""
        return {**super().moved(shape, by), "g": float(shape["g"] + 2 * shape["zeta"] * by[2] / self.reach)}


@dataclass(frozen=True)
class _Clock:
    """A clock that runs faster here and slower there. at : (n,) – its time in every row, s; step : of its own rows."""

    at: Float1D
    step: float

    @property
    def _own(self) -> Float1D:
        return np.arange(0.0, self.at[-1] + self.step, self.step)

    def evenly(self, u: Float1D) -> Float1D:
        """A signal in rows of the clock, drawn straight between those of the recording."""
        return np.interp(self._own, self.at, u)

    def back(self, rows: Float1D) -> Float1D:
        """What rows of the clock are in rows of the recording, (n,)."""
        return np.interp(self.at, self._own, rows)


def _clock(place: Float1D, g: float, step: float) -> _Clock | None:
    """Of a place less the middle of its travel, (n,); None where there are no two rows.

    A place beyond all that were seen may be far: it runs at most e times faster or slower.
    """
    rate = np.exp(np.clip(g * place, -_MOST_FASTER, _MOST_FASTER))
    if step <= 0:
        return None
    at = np.r_[0.0, np.cumsum((rate[1:] + rate[:-1]) / 2)] * step
    return _Clock(at, step * float(rate.min()) / _FINER)


def ringing_terms(mismatch: Mismatch, residual: Float1D, known: Known) -> list[Term]:
    """Ringing at the frequencies in which the residual answers to a quantity.

    known : `common_signals` of the mismatch
    """
    axis = mismatch.axis
    terms = []
    for name in (f"a_{axis}", f"f_{axis}", *(f"a_{other}" for other in LINEAR_AXES if other != axis)):
        if name in known:
            peaks = _answers(mismatch, residual, known[name][0])
            ringing = Ringing(name, known[name][1])
            terms += [Term(ringing, (("f", f), ("zeta", zeta))) for f, _ in peaks for zeta in _DAMPING]
            if peaks and peaks[0][1] > _STANDS_OUT:
                terms += _along(ringing, mismatch, residual, known)
    return terms


def _along(ringing: Ringing, mismatch: Mismatch, residual: Float1D, known: Known) -> list[Term]:
    """The same along each linear axis, on the clock on which its highest peak is the highest."""
    terms = []
    for name in (n for n in known if n in {f"pos_{a}" for a in LINEAR_AXES}):
        place, length = known[name]
        middle, reach = float(np.min(place) + np.max(place)) / 2, float(np.ptp(place)) / 2
        clocks = []
        for g in (sign * by / reach for by in _PER_REACH for sign in (1, -1)):
            if peaks := _answers(mismatch, residual, known[ringing.signal][0], (place - middle, g)):
                clocks.append((peaks[0][1], peaks[0][0], g))
        if clocks:
            _, f, g = max(clocks)
            law = RingingAlong(ringing.signal, ringing.unit, name, length, middle, reach)
            terms += [Term(law, (("f", f), ("zeta", zeta), ("g", g))) for zeta in _DAMPING]
    return terms


def _answers(
    mismatch: Mismatch, residual: Float1D, drive: Float1D, along: tuple[Float1D, float] | None = None
) -> list[tuple[float, float]]:
    """Where the residual's power that is coherent with `drive` has its highest peaks: Hz, and times what is usual.

    along : the clock's place and g
    """
    rate = 1.0 / mismatch.step
    shortest = min(len(s.time) for s in mismatch.states)
    length = int(min(shortest, _WINDOW_S * rate))
    if length < 64:
        return []
    f, cross, own = np.fft.rfftfreq(length, 1 / rate), 0.0, 0.0
    for i, j in zip(mismatch.edges[:-1], mismatch.edges[1:], strict=True):
        x, y = drive[i:j], np.where(mismatch.usable[i:j], residual[i:j], 0.0)
        if along is not None and (clock := _clock(along[0][i:j], along[1], mismatch.step)) is not None:
            clock = _Clock(clock.at, mismatch.step)
            x, y = clock.evenly(x), clock.evenly(y)
        if len(x) >= length:
            X, Y = _spectra(x, length), _spectra(y, length)
            cross = cross + np.mean(np.conj(X) * Y, axis=0)
            own = own + np.mean(np.abs(X) ** 2, axis=0)
    if not np.any(own):
        return []  # on this clock every part is shorter
    coherent = np.abs(cross) ** 2 / np.maximum(own, 1e-12 * np.max(own))
    met = (f > _SLOWEST_HZ) & (f < _FASTEST * rate)
    coherent = np.where(met, coherent, 0.0)
    at = dsp.find_peaks(coherent)[0]
    usual = float(np.median(coherent[met])) + 1e-300
    return [(float(f[k]), float(coherent[k]) / usual) for k in at[np.argsort(-coherent[at])][:_MODES]]


def _spectra(x: Float1D, length: int) -> Complex2D:
    """(m, f) – of windows that overlap by half, as Welch takes them (1967).

    scipy's own `csd` walks through them one by one, and would make each signal's anew for every other one.
    """
    frames = sliding_window_view(x, length)[:: length - length // 2]
    return np.fft.rfft(dsp.detrend(frames, type="constant") * dsp.get_window("hann", length))


def _step(state: AxisState) -> float:
    """s, between two samples; 0 with one sample."""
    return float(np.median(np.diff(state.time))) if len(state.time) > 1 else 0.0


def _answer(u: Float1D, w: float, zeta: float, dt: float) -> Float2D:
    """(n, 2) – what k_s and k_v of a `Ringing` count for."""
    above, below = _sampled(w, zeta, dt)
    return np.column_stack([dsp.lfilter(a, below, u) for a in above])


@lru_cache(maxsize=64)
def _sampled(w: float, zeta: float, dt: float) -> tuple[Float2D, Float1D]:
    """Coefficients of both answers, whose input is drawn straight between samples; every part has the same."""
    above, below = ((-1.0, -2 * zeta * w, 0.0), (0.0, w, 0.0)), (1.0, 2 * zeta * w, w * w)
    # scipy's answer has a type of its own for every sort of system.
    numerator, denominator, _ = cast(
        "tuple[Float2D, Float1D, float]", dsp.cont2discrete((above, below), dt, method="foh")
    )
    return numerator, denominator
