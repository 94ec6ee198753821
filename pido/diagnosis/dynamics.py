"""A model without a name of an axis that rings after a change.

In:  the residual of one axis, and the quantities that could drive it.
Out: `Ringing` terms worth a closer look, their frequencies read from the residual itself.
Source: transfer function estimate H1 = Sxy / Sxx (Welch); first-order hold of a linear oscillator (Franklin, Powell and
Workman, Digital Control of Dynamic Systems, ch. 6).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, cast

import numpy as np
from scipy import signal as dsp

from pido.core.arrays import Float1D, Float2D
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
        w, zeta = 2 * np.pi * shape["f"], shape["zeta"]
        below = (1.0, 2 * zeta * w, w * w)
        return np.column_stack([_filtered(above, below, u, dt) for above in ((-1.0, -2 * zeta * w, 0.0), (w, 0.0))])

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


def ringing_terms(mismatch: Mismatch, residual: Float1D, known: Known) -> list[Term]:
    """Ringing at the frequencies in which the residual answers to a quantity.

    known : `common_signals` of the mismatch
    """
    axis = mismatch.axis
    terms = []
    for name in (f"a_{axis}", f"f_{axis}", *(f"a_{other}" for other in LINEAR_AXES if other != axis)):
        if name in known:
            ringing = Ringing(name, known[name][1])
            terms += [
                Term(ringing, (("f", f), ("zeta", zeta)))
                for f in _answers(mismatch, residual, known[name][0])
                for zeta in _DAMPING
            ]
    return terms


def _answers(mismatch: Mismatch, residual: Float1D, drive: Float1D) -> list[float]:
    """Hz – where the residual's power that is coherent with `drive` has its highest peaks."""
    rate = 1.0 / mismatch.step
    shortest = min(len(s.time) for s in mismatch.states)
    length = int(min(shortest, _WINDOW_S * rate))
    if length < 64:
        return []
    cross, own = 0.0, 0.0
    for i, j in zip(mismatch.edges[:-1], mismatch.edges[1:], strict=True):
        x, y = drive[i:j], np.where(mismatch.usable[i:j], residual[i:j], 0.0)
        f, answer = dsp.csd(x, y, rate, nperseg=length)
        cross = cross + answer
        own = own + dsp.welch(x, rate, nperseg=length)[1]
    coherent = np.abs(cross) ** 2 / np.maximum(own, 1e-12 * np.max(own))
    coherent = np.where((f > _SLOWEST_HZ) & (f < _FASTEST * rate), coherent, 0.0)
    at = dsp.find_peaks(coherent)[0]
    return [float(f[k]) for k in at[np.argsort(-coherent[at])][:_MODES]]


def _step(state: AxisState) -> float:
    """s, between two samples; 0 with one sample."""
    return float(np.median(np.diff(state.time))) if len(state.time) > 1 else 0.0


def _filtered(above: tuple[float, ...], below: tuple[float, ...], u: Float1D, dt: float) -> Float1D:
    """The answer of a linear system to a sampled signal."""
    return np.asarray(dsp.lfilter(*_sampled(above, below, dt), u))


@lru_cache(maxsize=64)
def _sampled(above: tuple[float, ...], below: tuple[float, ...], dt: float) -> tuple[Float1D, Float1D]:
    """Coefficients of a linear system whose input is drawn straight between samples; every part has the same."""
    # scipy's answer has a type of its own for every sort of system.
    numerator, denominator, _ = cast(
        "tuple[Float2D, Float1D, float]", dsp.cont2discrete((above, below), dt, method="foh")
    )
    return np.ravel(numerator), denominator
