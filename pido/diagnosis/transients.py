"""What an event sets off and time takes back: a model without a name.

In:  the residual of one axis with its noise, and the quantities whose crossing of a level may be an event.
Out: `Transient` terms worth a closer look.
All levels of a quantity are compared at once: what a transient would take away is a sum, over its events, of what one
event would, and the size of whitened columns that are never formed comes from random signs (Hutchinson 1989).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.sparse import csr_array

from pido.core.arrays import Bool1D, Float1D, Float2D
from pido.core.axes import AXES, LINEAR_AXES
from pido.diagnosis.formulas import FORMS, Unnamed, side_of, written
from pido.diagnosis.judge import WORTH, Judge
from pido.diagnosis.levels import levels_of, neighbours
from pido.diagnosis.mechanisms.base import Parameter
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.signals import Known, signals
from pido.diagnosis.state import AxisState
from pido.diagnosis.terms import Term

SIDES = {"up": (1.0, 0.0), "down": (0.0, 1.0), "both": (1.0, -1.0)}
"""What an event counts whose quantity rises above the level, and one whose quantity falls below it."""
_EVENTS = {  # quantities that are zero while nothing is the matter; {} is the axis
    "t_cut": ("the tool enters the material", "the tool leaves the material"),
    "t_go_{}": ("axis {} begins to move", "axis {} stops"),
    "held_{}": ("axis {} turns to +", "axis {} turns to -"),
    "coolant": ("the coolant is switched on", "the coolant is switched off"),
}
_FADES_S = (0.03, 0.1, 0.3, 1.0, 3.0)
_SLOWEST_HZ, _FASTEST_HZ, _TONES = 0.3, 30.0, 18
_FASTEST = 0.2  # of the sampling rate
_DAMPING = 0.1  # of what is looked at first
_MOST_DAMPED = 0.4  # of what is searched
_RINGS_NO_MORE = 1.0  # damping of what is settled: beyond it a decay is left, which has no frequency
_FINE = 7  # levels between those, once one of them is the best
_FEWEST_EVENTS = 4  # at a level
_MOST_EVENTS = 0.01  # of the rows: what crosses a level more often stays at it
_LIKELY = 12  # laws, by random signs
_CLOSER = 6  # shapes of each that are looked at more closely
_PER_SHAPE = 3  # levels
_BEST = 6
_LEAST = 1e-9  # of a whitened column of one event: it is nothing

_Matrix = NDArray[np.inexact]


@dataclass(frozen=True)
class Transient(Unnamed):
    """What follows an event: the crossing of a level by a quantity, or its leaving zero.

    fading : dI = k * h * exp(-t / tau), t since the last event
    ringing : dI = sum over the events of h * exp(-zeta w t) * (k_c cos(w t) + k_s sin(w t)), w = 2 pi f
    h is the side of the event (`SIDES`).
    even : of |u| in place of u; level : of a level c in place of zero
    """

    signal: str
    unit: str
    side: str
    even: bool = False
    level: bool = False
    rings: bool = False

    passes_loop: ClassVar[bool] = False

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.signal})

    @property
    def shape(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        c = (Parameter("c", self.unit, scale="linear"),) if self.level else ()
        if not self.rings:
            return *c, Parameter("tau", "s", low=0.0, scale="log")
        return *c, Parameter("f", "Hz", low=0.0, scale="log"), Parameter("zeta", "–", 0.0, _RINGS_NO_MORE, scale="log")

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return tuple(Parameter(n, "A") for n in (("k_c", "k_s") if self.rings else ("k",)))

    @property
    def equation(self) -> str:  # type: ignore[override]
        up, down = self._events("c")
        h = {"up": "", "down": "", "both": f"h = 1 after {up}, -1 after {down}; "}[self.side]
        event = {"up": up, "down": down, "both": "that"}[self.side]
        times = " * h" * bool(h)
        if self.rings:
            return f"dI = sum of exp(-zeta w t) * (k_c cos(w t) + k_s sin(w t)){times}, w = 2 pi f; {h}t since {event}"
        return f"dI = k{times} * exp(-t / tau); {h}t since {event}"

    def _events(self, level: str) -> tuple[str, str]:
        """What happens on either side."""
        for name, said in _EVENTS.items():
            head, _, _ = name.partition("{}")
            if not self.level and self.signal.startswith(head):
                up, down = (s.replace("{}", self.signal.removeprefix(head)) for s in said)
                return up, down
        u = written(self.signal, side_of(self.even))
        return f"{u} rises above {level}", f"{u} falls below {level}"

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        up, down = self._events(f"{shape['c']:.3g} {self.unit}" if self.level else "0")
        event = {"up": up, "down": down, "both": f"{up} or {down}"}[self.side]
        if self.rings:
            return f"ringing at {shape['f']:.3g} Hz after {event}", ()
        return f"after {event}, fading within some {shape['tau']:.3g} s", ()

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        u = self.place(signals(state, [self.signal])[self.signal][0])
        up, down = _crossings(u > shape.get("c", 0.0))
        h = SIDES[self.side][0] * up + SIDES[self.side][1] * down
        if self.rings:
            dt = float(np.median(np.diff(state.time))) if len(u) > 1 else 0.0
            if not 0 < shape["f"] * dt < 0.5:
                return np.zeros((len(u), 2))
            rung = _summed(h[None].astype(complex), np.exp(_pole(shape["f"], shape["zeta"]) * dt))[0]
            return np.column_stack([rung.real, rung.imag])
        last = np.maximum.accumulate(np.where(h != 0, np.arange(len(u)), 0))
        return (h[last] * np.exp(-(state.time - state.time[last]) / shape["tau"]))[:, None]

    def place(self, u: Float1D) -> Float1D:
        """(n,) – where values of the signal lie beside the level."""
        if not self.level and self.signal.startswith("t_"):
            return np.maximum(u, np.r_[u[1:], u[-1:]])  # a time since an event is zero in the first row of it
        return FORMS[side_of(self.even)](u)

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        if name == "c":
            far = 0.05 * abs(shape["c"])
            return shape["c"] - far, shape["c"] + far
        far = float(np.exp(2 * min(shape["zeta"], 0.3))) if name == "f" else 2.0
        return shape[name] / far, shape[name] * far

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """The shape a step away; `by` is in powers of e, or widths of the resonance, last in tenths of the level."""
        far = np.clip(by, -3, 3)
        new = {**shape, **({"c": float(shape["c"] + 0.1 * far[-1] * abs(shape["c"]))} if self.level else {})}
        if not self.rings:
            return {**new, "tau": float(shape["tau"] * np.exp(far[0]))}
        zeta = float(np.clip(shape["zeta"] * np.exp(far[1]), 1e-3, _MOST_DAMPED))
        return {**new, "f": float(shape["f"] * np.exp(2 * shape["zeta"] * far[0])), "zeta": zeta}


def transient_terms(judge: Judge, known: Known) -> list[Term]:
    """The transients that take away most of the whitened rows of a residual.

    known : `common_signals` and `occasions` of the mismatch
    """
    mismatch = judge.mismatch
    sources = [_Source.of(law, known[law.signal][0], mismatch) for law in _laws(mismatch.axis, known)]
    offered: dict[Transient, list[tuple[float, Term]]] = {}
    for shape, pole in _kernels(mismatch.step):
        answers = _answers(judge.felt, pole, mismatch)
        for source in sources:
            for side, best in source.best(answers).items():
                law = replace(source.law, side=side, rings="f" in shape)
                offered.setdefault(law, []).extend((gain, _term(law, level, shape)) for gain, level in best)
    most = {law: max(gain for gain, _ in each) for law, each in offered.items()}
    likely = sorted((law for law in most if most[law] > WORTH), key=lambda law: -most[law])[:_LIKELY]
    # Random signs tell sizes roughly: the best of many is one whose size they have told too small.
    best = [judge.best([t for _, t in sorted(offered[law], key=lambda e: -e[0])[:_CLOSER]]) for law in likely]
    grids = {source.law.signal: source.levels for source in sources}
    return [judge.best(_around(term, grids)) for term in judge.ranked(best)[:_BEST]]


def _around(term: Term, grids: Mapping[str, Float1D]) -> list[Term]:
    """The term, and the same at levels between the neighbours of its own."""
    law, shape = term.mechanism, dict(term.shape)
    if not isinstance(law, Transient) or not law.level:
        return [term]
    return [
        term,
        *(term.with_shape(c=float(c)) for c in np.linspace(*neighbours(grids[law.signal], shape["c"]), _FINE)),
    ]


def _laws(axis: str, known: Known) -> Iterator[Transient]:
    """Of both sides; zero of what is an event by itself, and any level of what is none."""
    for name in dict.fromkeys(n.replace("{}", a) for n in _EVENTS for a in (axis, *LINEAR_AXES)):
        if name in known and np.ptp(known[name][0]) > 0:
            yield Transient(name, known[name][1], "both")
    speeds = [f"v_{a}" for a in (axis, *AXES) if a == axis or a != "sp"]
    for name in dict.fromkeys([*speeds, "v_sp", "feed", f"pos_{axis}", f"f_{axis}", "M_sp", "MRR", "AR"]):
        if name in known and name != "pos_sp":
            values = known[name][0]
            even = not name.startswith("pos_") and bool(values.min() < 0 < values.max())
            yield Transient(name, known[name][1], "both", even, level=True)


def _term(law: Transient, level: float, shape: Mapping[str, float]) -> Term:
    return Term(law, tuple({**({"c": level} if law.level else {}), **shape}.items()))


def _kernels(step: float) -> Iterator[tuple[dict[str, float], complex]]:
    """Shapes that are looked at first, each with its pole in 1/s."""
    for tau in _FADES_S:
        if tau > 2 * step:
            yield {"tau": tau}, -1 / tau
    for f in np.geomspace(_SLOWEST_HZ, _FASTEST_HZ, _TONES):
        if f < _FASTEST / step:
            yield {"f": float(f), "zeta": _DAMPING}, _pole(float(f), _DAMPING)


def _pole(f: float, zeta: float) -> complex:
    return 2 * np.pi * f * (-zeta + 1j)


def _crossings(above: Bool1D) -> tuple[Bool1D, Bool1D]:
    """Rows in which a part is above for the first time again, and below."""
    up, down = np.zeros((2, len(above)), bool)
    up[1:], down[1:] = above[1:] & ~above[:-1], ~above[1:] & above[:-1]
    return up, down


def _summed(rows: _Matrix, left: complex) -> _Matrix:
    """(k, n) – what has come so far, of which `left` stays from one row to the next."""
    return np.asarray(lfilter([1.0], [1.0, -left], rows, axis=1))


def _answers(felt: Float2D, pole: complex, mismatch: Mismatch) -> _Matrix:
    """(n, k) – inner product of every row of `felt` with what one event in a row would set off, part by part."""
    left = np.exp(pole * mismatch.step)
    out = []
    for i, j in itertools.pairwise(mismatch.edges):
        back = felt[:, i:j][:, ::-1]
        out.append(_summed(back if np.isreal(left) else back.astype(complex), left)[:, ::-1].T)
    return np.ascontiguousarray(np.concatenate(out))


@dataclass(frozen=True)
class _Source:
    """Where a quantity crosses levels, (l,): matrices (l, n) of events, and how many there are of each."""

    law: Transient
    levels: Float1D
    up: csr_array
    down: csr_array
    ups: Float1D
    downs: Float1D

    @classmethod
    def of(cls, law: Transient, values: Float1D, mismatch: Mismatch) -> _Source:
        u = law.place(values)
        levels = levels_of(u) if law.level else np.zeros(1)
        first = np.zeros(len(u), bool)
        first[np.asarray(mismatch.edges[:-1])] = True
        now, before = u[1:], u[:-1]
        up = _met(levels, before, now, ~first[1:], len(u))
        down = _met(levels, now, before, ~first[1:], len(u))
        ups, downs = up.sum(axis=1), down.sum(axis=1)
        kept = (ups + downs >= _FEWEST_EVENTS) & (ups + downs <= _MOST_EVENTS * len(u))
        return cls(law, levels[kept], up[kept], down[kept], ups[kept], downs[kept])

    def best(self, answers: _Matrix) -> dict[str, list[tuple[float, float]]]:
        """Per side, about what the best levels would take away, and these levels; none where no level is crossed."""
        if not len(self.levels):
            return {}
        rising, falling = self.up @ answers, self.down @ answers  # (l, 1 + signs)
        found = {}
        for side, (up, down) in SIDES.items():
            inner = up * rising + down * falling
            columns = np.stack([np.real(inner), np.imag(inner)] if np.iscomplexobj(inner) else [inner])
            count = np.maximum(up**2 * self.ups + down**2 * self.downs, 1)
            # Of one event, which random signs tell well for all levels together, and badly for each.
            towards, felt = columns[:, :, 0], columns[:, :, 1:] / np.sqrt(count)[:, None]
            size = np.einsum("ils,jls->ij", felt, felt) / felt[0].size + _LEAST * np.eye(len(columns))
            gains = np.einsum("il,ij,jl->l", towards, np.linalg.inv(size), towards) / count
            found[side] = [(float(gains[k]), float(self.levels[k])) for k in np.argsort(-gains)[:_PER_SHAPE]]
        return found


def _met(levels: Float1D, below: Float1D, above: Float1D, together: Bool1D, n: int) -> csr_array:
    """(l, n) – one where a quantity that goes from `below` to `above` in one row, (n - 1,), passes a level."""
    low, high = np.searchsorted(levels, below), np.searchsorted(levels, above)
    rows = np.flatnonzero((high > low) & together)
    count = high[rows] - low[rows]
    at = np.repeat(low[rows] - np.r_[0, np.cumsum(count)[:-1]], count) + np.arange(count.sum())
    return csr_array((np.ones(len(at)), (at, np.repeat(rows + 1, count))), shape=(len(levels), n))
