"""Models without a name that remember: an axis that rings after a change, a current that follows late, what a change
leaves and time takes back, a motor that its own losses warm.

In:  the residual of one axis, and the quantities that could drive it.
Out: `Ringing`, `Lagged`, `Fading` and `Heated` terms worth a closer look, frequencies read from the residual itself.
Source: transfer function estimate H1 = Sxy / Sxx (Welch); first-order hold of a linear oscillator (Franklin, Powell and
Workman, Digital Control of Dynamic Systems, ch. 6).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, cast

import numpy as np
from scipy import signal as dsp

from pido.core.arrays import Float1D, Float2D
from pido.core.axes import LINEAR_AXES
from pido.diagnosis.formulas import FORMS, Unnamed, unit_of, written
from pido.diagnosis.mechanisms.base import Parameter
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.signals import signals
from pido.diagnosis.state import AxisState
from pido.diagnosis.terms import Term
from pido.physics.drive import answered_late

_WINDOW_S = 20.0  # of a spectrum
_SLOWEST_HZ = 0.2
_FASTEST = 0.4  # of the sampling rate
_MODES = 5  # peaks of a spectrum that are looked at
_DAMPING = (0.015, 0.06, 0.2)
_MOST_DAMPED = 0.4  # beyond it nothing rings: that is `Lagged`
_TIMES_S = (0.1, 0.3, 1.0, 3.0, 10.0)
_WARMING_S = (3.0, 10.0, 30.0, 100.0, 300.0)
_LONGEST_S = 30.0  # what comes later still is drift


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


class _Late(Unnamed):
    """What answers through a first order lag of tau."""

    longest: ClassVar[float] = np.inf  # s
    passes_loop: ClassVar[bool] = False
    shape: ClassVar[tuple[Parameter, ...]] = (Parameter("tau", "s", low=0.0, scale="log"),)

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        return shape[name] / 2, shape[name] * 2

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """The shape a step away; `by` is in powers of e."""
        return {"tau": min(self.longest, float(shape["tau"] * np.exp(np.clip(by[0], -3, 3))))}


@dataclass(frozen=True)
class Lagged(_Late):
    """A quantity that acts late: dI = k * p(u) / (1 + tau s). What acts at once has a name or is a formula.

    by_cut : with another coefficient while the tool cuts
    level : with a constant beside it, as what is counted from the usual level of the quantity has
    """

    signal: str
    form: str
    unit: str
    by_cut: bool = False
    level: bool = False

    longest: ClassVar[float] = _LONGEST_S

    @property
    def equation(self) -> str:  # type: ignore[override]
        late = f"k * {written(self.signal, self.form)} / (1 + tau s)"
        return "dI = " + "k_0 + " * self.level + late + ", another k while cutting" * self.by_cut

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        names = ("k", "k_cut") if self.by_cut else ("k",)
        unit = f"A/{unit_of([(self.unit, self.form)])}"
        return (*(Parameter(name, unit) for name in names), *([Parameter("k_0", "A")] if self.level else []))

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        u = FORMS[self.form](signals(state, [self.signal])[self.signal][0])
        late = answered_late(u[None], state.time, shape["tau"])[0]
        columns = [late]
        if self.by_cut:
            cut = np.zeros(len(u), bool) if state.engaged is None else state.engaged
            columns = [late * ~cut, late * cut]
        return np.column_stack([*columns, *([np.ones(len(u))] if self.level else [])])

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        return f"following {self.signal} {shape['tau']:.3g} s late", ()


@dataclass(frozen=True)
class Fading(_Late):
    """What a change of a quantity leaves and time takes back: dI = k * p(u) * tau s / (1 + tau s).

    in_motion : a drag, which is not there while the axis stands
    """

    signal: str
    form: str
    unit: str
    in_motion: bool = False

    longest: ClassVar[float] = _LONGEST_S

    @property
    def equation(self) -> str:  # type: ignore[override]
        u = written(self.signal, self.form)
        return f"dI = k * {u} * tau s / (1 + tau s)" + ", 0 at standstill" * self.in_motion

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return (Parameter("k", f"A/({self.unit})"),)

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        u = FORMS[self.form](signals(state, [self.signal])[self.signal][0])
        left = u - answered_late(u[None], state.time, shape["tau"])[0]
        return (left * state.moving if self.in_motion else left)[:, None]

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        return f"after changes of {self.signal}, fading within some {shape['tau']:.3g} s", ()


@dataclass(frozen=True)
class Heated(_Late):
    """What changes with the heat that it has made itself: dI = k * p(u) * (q(u) / (1 + tau s)).

    A motor's current with its losses (I and I²): its torque constant falls as the winding warms. A friction (v or its
    sign, with |v| or v²): what lubricates gets thinner.
    Source: first-order thermal model of the winding, of the guideway.
    """

    signal: str
    form: str  # p
    loss: str  # q
    unit: str  # of p(u) * q(u)

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return (Parameter("k", f"A/({self.unit})"),)

    @property
    def equation(self) -> str:  # type: ignore[override]
        return f"dI = k * {written(self.signal, self.form)} * ({written(self.signal, self.loss)} / (1 + tau s))"

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        u = signals(state, [self.signal])[self.signal][0]
        heat = answered_late(FORMS[self.loss](u)[None], state.time, shape["tau"])[0]
        return (FORMS[self.form](u) * heat)[:, None]

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        u = written(self.signal, self.form)
        return f"in proportion to {u}, changing with what {self.signal} lost as heat in some {shape['tau']:.3g} s", ()


def remembering(mismatch: Mismatch, residual: Float1D, known: Mapping[str, tuple[Float1D, str]]) -> list[Term]:
    """Ringing at the frequencies in which the residual answers to a quantity, and what time changes in steps of three.

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
    engaged = [s.engaged for s in mismatch.states]
    cuts = all(e is not None and e.any() and not e.all() for e in engaged)
    for name, form in _late(known, axis):
        unit = known[name][1]
        ways = [(False, False), (False, True), *([(True, False)] if cuts else [])]
        laws = [Lagged(name, form, unit, by_cut, level) for by_cut, level in ways]
        laws += [Fading(name, form, unit, drag) for drag in ((False, True) if name == f"v_{axis}" else (False,))]
        terms += [Term(law, (("tau", tau),)) for law in laws for tau in _TIMES_S]
    for name, form, loss in _warming(axis):
        if name in known:
            unit = unit_of([(known[name][1], form), (known[name][1], loss)])
            terms += [Term(Heated(name, form, loss, unit), (("tau", tau),)) for tau in _WARMING_S]
    return terms


def _warming(axis: str) -> Iterator[tuple[str, str, str]]:
    """(signal, form, form of its losses)"""
    yield f"I_{axis}", "u", "u²"
    for form in ("u", "sgn u"):
        for loss in ("|u|", "u²"):
            yield f"v_{axis}", form, loss


def _late(known: Mapping[str, tuple[Float1D, str]], axis: str) -> Iterator[tuple[str, str]]:
    for name in dict.fromkeys((f"v_{axis}", f"f_{axis}", f"I_{axis}", "feed", "MRR", "M_sp", "v_sp", "a_sp")):
        if name in known:
            yield name, "u"
            if known[name][0].min() < 0 < known[name][0].max():
                yield name, "|u|"
            if name == f"I_{axis}":
                yield name, "u²"  # its losses


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
