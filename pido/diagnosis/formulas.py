"""Models without a name, of what no mechanism of the catalogue explains.

In:  everything that the recording knows about the state. Out: formulas in the recorded quantities, peaks, and surfaces
     over one or two of them, with the units that make each an ampere.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from pido.core.arrays import Float1D, Float2D, Int1D
from pido.core.axes import LINEAR_AXES
from pido.diagnosis.mechanisms.base import Mechanism, Parameter
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.quantities import QUANTITIES
from pido.diagnosis.signals import CLOCKS, NO_PLACE, Known, common_signals, signals
from pido.diagnosis.state import AxisState

LOOKED_AT = 3_000  # formulas, peaks and surfaces that are compared before one is claimed
# A clock, an angle that starts again every turn, and a place that has its zero where a part began are in no product.
_NO_FACTOR = (*CLOCKS, "pos_sp", *(f"from_{a}" for a in LINEAR_AXES))
_NO_SURFACE = (*CLOCKS, "pos_sp")
_SIDES = ((False, False), (True, False), (False, True))  # of a peak: on one side of zero, even, odd
_MOST_POWER = 3  # of all factors of a product together
_WHEN = {"speeding": "speeds up", "braking": "slows down"}
_SIGNED = ("v", "a", "force", "force_perp")  # quantities with a side: a surface may jump where they change sign


class Unnamed(Mechanism):
    """A model of what no mechanism of the catalogue explains."""

    id: ClassVar[str] = "unknown"
    kind: ClassVar[Any] = "unexplained"
    looked_at: ClassVar[int] = LOOKED_AT

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """The shape a step away, `by` (2,) or (3,) in natural units of each member; as it is where there is none."""
        return dict(shape)

    def variants(self) -> tuple[Unnamed, ...]:
        """Laws of the same shape that are worth a look once this one is at its best."""
        return ()

    def without_limits(self, axis: str) -> str:
        """Identifier of the mechanism that this law of an axis would be if it acted everywhere; '' where none is."""
        return ""


@dataclass(frozen=True)
class Formula(Unnamed):
    """A product of recorded quantities, mostly one or two: dI = k * p(u) * q(w), k in A per their units; of none: k."""

    factors: tuple[tuple[str, str], ...]  # (signal, form)
    unit: str
    seen: tuple[tuple[float, float], ...] = ()  # per factor, range of the signal: a form without a reason ends there

    id: ClassVar[str] = "unknown"
    kind: ClassVar[Any] = "unexplained"
    shape: ClassVar[tuple[Parameter, ...]] = ()

    @property
    def looked_at(self) -> int:  # type: ignore[override]
        return LOOKED_AT if self.factors else 1

    @property
    def reads(self) -> frozenset[str]:
        return frozenset(name for name, _ in self.factors)

    @property
    def equation(self) -> str:  # type: ignore[override]
        return " * ".join(["dI = k", *(written(s, f) for s, f in self.factors)])

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return (Parameter("k", ampere_per(self.unit)),)

    def conditions(self, axis: str, shape: dict[str, float]) -> tuple[str, tuple[str, ...]]:
        if not self.factors:
            return "a level of its own", ()
        names = list(dict.fromkeys(s for s, _ in self.factors))
        when = [f"while the {axis} axis {said}" for name, said in _WHEN.items() if f"{name}_{axis}" in names]
        of = [n for n in names if n.split("_")[0] not in _WHEN]
        return ", ".join([*([f"depending on {' and '.join(of)}"] if of else []), *when]), ()

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        return np.broadcast_to(self.values(signals(state, [n for n, _ in self.factors])), len(state.time))[:, None]

    def may_have(self, factor: tuple[str, str]) -> bool:
        """Whether one more factor leaves it a plain product: of another quantity, and of no higher power than three."""
        power = _POWER[factor[1]] + sum(_POWER[form] for _, form in self.factors)
        return factor[0] not in self.reads and power <= _MOST_POWER

    def times(self, factor: tuple[str, str], seen: tuple[float, float]) -> Formula:
        """The product with one more factor. seen : range of its signal"""
        return _product((*self.factors, factor), (*self.seen, seen))

    def of_fewer(self) -> Iterator[Formula]:
        """The same product without one of its factors, each in turn."""
        for i in range(len(self.factors)):
            yield _product(self.factors[:i] + self.factors[i + 1 :], self.seen[:i] + self.seen[i + 1 :])

    def values(self, known: Known) -> Float1D:
        """The product itself, (n,)."""
        out = np.ones(1)
        for i, (name, form) in enumerate(self.factors):
            u = known[name][0]
            out = out * FORMS[form](np.clip(u, *self.seen[i]) if self.seen else u)
        return out


def _product(factors: tuple[tuple[str, str], ...], seen: tuple[tuple[float, float], ...]) -> Formula:
    return Formula(factors, unit_of([(QUANTITIES[name].unit, form) for name, form in factors]), seen)


LEVEL = Formula((), "–")
"""A constant, which is something only where it is confined."""


def factor_on_current(axis: str) -> Formula:
    """A share of the simulated current, which no name says where it is confined: a sensor's gain is the same
    everywhere."""
    return Formula(((f"I_{axis}", "u"),), "A")


@dataclass(frozen=True)
class Peak(Unnamed):
    """A current that is there only around one value of one quantity, as a resonance is.

    even : the same on both sides of zero; odd : on both sides, and turning with the sign, as a drag does
    wide : it fades as the answer of an oscillator does (Lorentz), not as a normal density (Gauss)
    """

    signal: str
    unit: str
    even: bool
    odd: bool = False
    wide: bool = False

    amplitudes: ClassVar[tuple[Parameter, ...]] = (Parameter("k", "A"),)

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.signal})

    @property
    def equation(self) -> str:  # type: ignore[override]
        apart = f"(({self._written} - c) / w)^2"
        return f"dI = k {f'/ (1 + {apart})' if self.wide else f'* exp(-{apart})'}" + f" * sgn({self.signal})" * self.odd

    @property
    def _written(self) -> str:
        return written(self.signal, side_of(self.even or self.odd))

    @property
    def shape(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return (Parameter("c", self.unit, scale="linear"), Parameter("w", self.unit, low=0.0, scale="log"))

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        return self.over(signals(state, [self.signal]), shape)

    def over(self, known: Known, shape: Mapping[str, float]) -> Float2D:
        """(n, 1) – what k counts for, at values of the signal."""
        u = known[self.signal][0]
        apart = ((self.place(u) - shape["c"]) / shape["w"]) ** 2
        size = 1 / (1 + apart) if self.wide else np.exp(-apart)
        return (size * self.side(u))[:, None]

    def place(self, u: Float1D) -> Float1D:
        """(n,) – where values of the signal lie beside its peak."""
        return FORMS[side_of(self.even or self.odd)](u)

    def side(self, u: Float1D) -> Float1D:
        """(n,) – the sign that the peak has there."""
        return np.sign(u) if self.odd else np.ones(len(u))

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        c, w = shape["c"], shape["w"]
        return (c - w, c + w) if name == "c" else (w / 2, 2 * w)

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """The shape a step away; `by` is in widths of the peak and in powers of e."""
        return {"c": shape["c"] + float(by[0]) * shape["w"], "w": shape["w"] * float(np.exp(np.clip(by[1], -3, 3)))}

    def variants(self) -> tuple[Unnamed, ...]:
        return () if self.wide else (replace(self, wide=True),)

    def conditions(self, axis: str, shape: dict[str, float]) -> tuple[str, tuple[str, ...]]:
        u = self._written
        low, high = shape["c"] - 1.2 * shape["w"], shape["c"] + 1.2 * shape["w"]
        return f"around {u} = {shape['c']:.3g} {self.unit}", (f"{u} > {low:.3g}", f"{u} < {high:.3g}")


@dataclass(frozen=True)
class Surface(Unnamed):
    """A piecewise linear curve or surface over one or two recorded quantities; its knots' heights are in A."""

    variables: tuple[str, ...]
    knots: tuple[tuple[float, ...], ...]
    split: tuple[bool, ...]  # the curve may jump where this quantity changes sign

    shape: ClassVar[tuple[Parameter, ...]] = ()
    held_back: ClassVar[float] = 1e-3

    @property
    def reads(self) -> frozenset[str]:
        return frozenset(self.variables)

    @property
    def equation(self) -> str:  # type: ignore[override]
        return f"dI = g({', '.join(self.variables)}), piecewise linear"

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        count = int(np.prod([_width(k, s) for k, s in zip(self.knots, self.split, strict=True)]))
        return tuple(Parameter(f"g_{i}", "A") for i in range(count))

    def conditions(self, axis: str, shape: dict[str, float]) -> tuple[str, tuple[str, ...]]:
        ranges = [
            f"{name} from {knots[0]:.3g} to {knots[-1]:.3g}"
            for name, knots in zip(self.variables, self.knots, strict=True)
        ]
        return f"depending on {' and '.join(ranges)}", ()

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        return self.over(signals(state, self.variables))

    def over(self, known: Known) -> Float2D:
        """(n, knots) – what each knot's height counts for, at values of the quantities."""
        out = np.ones((len(known[self.variables[0]][0]), 1))
        for name, knots, split in zip(self.variables, self.knots, self.split, strict=True):
            hats = _hats(known[name][0], np.asarray(knots), split)
            out = (out[:, :, None] * hats[:, None, :]).reshape(len(out), -1)
        return out


FORMS: Mapping[str, Any] = {
    "u": lambda u: u,
    "|u|": np.abs,
    "u²": lambda u: u**2,
    "u|u|": lambda u: u * np.abs(u),
    "sgn u": np.sign,
    "√|u|": lambda u: np.sqrt(np.abs(u)),
    "√|u| sgn u": lambda u: np.sqrt(np.abs(u)) * np.sign(u),
    "u³": lambda u: u**3,
}
_WRITTEN = {
    "u": "{u}",
    "|u|": "|{u}|",
    "u²": "{u}²",
    "u|u|": "{u}·|{u}|",
    "sgn u": "sgn({u})",
    "√|u|": "√|{u}|",
    "√|u| sgn u": "√|{u}|·sgn({u})",
    "u³": "{u}³",
}
_POWER = {"u": 1.0, "|u|": 1.0, "u²": 2.0, "u|u|": 2.0, "sgn u": 0.0, "√|u|": 0.5, "√|u| sgn u": 0.5, "u³": 3.0}


def formulas(known: Known) -> list[Formula]:
    """Products of one or two forms of the signals; the same signal is not multiplied with itself."""
    plain = []
    for name, (values, unit) in known.items():
        signed = bool(values.min() < 0 < values.max())
        forms = ("sgn u",) if name.startswith("held") else (tuple(FORMS) if signed else ("u", "u²", "√|u|", "u³"))
        if set(np.unique(values[:: max(1, len(values) // 2000)])) <= {0.0, 1.0}:
            forms = ("u",)
        plain += [(name, f, unit) for f in forms if name not in _NO_FACTOR]
    seen = {n: (float(v.min()), float(v.max())) for n, (v, _) in known.items()}
    out = [Formula(((n, f),), unit_of([(u, f)]), (seen[n],)) for n, f, u in plain]
    for (n1, f1, u1), (n2, f2, u2) in itertools.combinations(plain, 2):
        if n1 != n2 and _POWER[f1] + _POWER[f2] <= _MOST_POWER:
            out.append(Formula(((n1, f1), (n2, f2)), unit_of([(u1, f1), (u2, f2)]), (seen[n1], seen[n2])))
    return out


def peaks(known: Known, centres: int = 24) -> list[tuple[Peak, dict[str, float]]]:
    """Peaks around values that the quantities really take, in widths from a fiftieth to a quarter of their range."""
    out = []
    for name, (values, unit) in known.items():
        if name.startswith(NO_PLACE):
            continue
        both = values.min() < 0 < values.max()
        for peak in [Peak(name, unit, even, odd) for even, odd in _SIDES[: 3 if both else 1]]:
            u = peak.place(values)
            low, high = np.quantile(u, [0.01, 0.99])
            if high <= low:
                continue
            at = np.unique(np.r_[np.quantile(u, np.linspace(0.02, 0.98, centres)), np.linspace(low, high, centres)])
            at = at[np.r_[True, np.diff(at) > 0.005 * (high - low)]]
            for w in (0.006, 0.02, 0.06, 0.2):
                out += [(peak, {"c": float(c), "w": float(w * (high - low))}) for c in at]
    return out


def surfaces(mismatch: Mismatch, count: int = 6) -> list[Surface]:
    """Curves over each signal and surfaces over each pair, knots at quantiles.

    None over a simulated current: it is a law of everything at once, and a curve over it fits what any law lacks.
    """
    known = {n: v for n, (v, _) in common_signals(mismatch.states).items() if n not in _NO_SURFACE and n[:2] != "I_"}
    ready = {}
    for name, values in known.items():
        split = (name.split("_")[0] in _SIGNED and bool(values.min() < 0 < values.max())) or name.startswith("f_")
        knots = _knots(values[mismatch.usable], count)
        if len(knots) >= 2:
            ready[name] = (knots, split and bool(values.min() < 0 < values.max()))
    singles = [Surface((n,), (k,), (s,)) for n, (k, s) in ready.items()]
    pairs = [
        Surface((n, m), (ready[n][0], ready[m][0]), (ready[n][1], ready[m][1]))
        for n, m in itertools.combinations(ready, 2)
    ]
    return [*singles, *pairs]


def curve_over_current(mismatch: Mismatch, count: int) -> Surface | None:
    """A curve over the axis' own simulated current, which may jump at zero as the dead time of a drive makes it; only
    for the place of several laws, or of laws that do far less (see `surfaces`)."""
    if mismatch.sim is None:
        return None
    often = _knots(mismatch.sim[mismatch.usable], count)
    # Also where it is seldom, between what friction and what cutting takes.
    evenly = np.linspace(often[0], often[-1], count)
    seldom = evenly[np.min(np.abs(evenly[:, None] - np.array(often)), axis=1) > np.ptp(evenly) / (2 * count)]
    knots = tuple(sorted({*often, *map(float, seldom)}))
    both = bool(mismatch.sim.min() < 0 < mismatch.sim.max())
    return Surface((f"I_{mismatch.axis}",), (knots,), (both,)) if len(knots) >= 2 else None


def _knots(values: Float1D, count: int) -> tuple[float, ...]:
    low, high = np.quantile(values, [0.002, 0.998])
    inner = np.quantile(values, np.linspace(0.05, 0.95, count - 2))
    return tuple(float(k) for k in np.unique(np.round(np.r_[low, inner, high], 9)))


def _width(knots: Sequence[float], split: bool) -> int:
    return len(_sides(np.asarray(knots), split)[0]) + len(_sides(np.asarray(knots), split)[1])


def _sides(knots: Float1D, split: bool) -> tuple[Float1D, Float1D]:
    if not split:
        return np.zeros(0), knots
    scale = 0.02 * np.abs(knots).max()
    return np.r_[knots[knots < -scale], 0.0], np.r_[0.0, knots[knots > scale]]


def _hats(u: Float1D, knots: Float1D, split: bool) -> Float2D:
    left, right = _sides(knots, split)
    if not len(left):
        return _hat_rows(u, right)
    below = (u < 0)[:, None]
    return np.column_stack([_hat_rows(u, left) * below, _hat_rows(u, right) * ~below])


def _hat_rows(u: Float1D, knots: Float1D) -> Float2D:
    if len(knots) == 1:
        return np.ones((len(u), 1))
    u = np.clip(u, knots[0], knots[-1])
    at = np.clip(np.searchsorted(knots, u, side="right") - 1, 0, len(knots) - 2)
    share = (u - knots[at]) / (knots[at + 1] - knots[at])
    out = np.zeros((len(u), len(knots)))
    rows = np.arange(len(u))
    out[rows, at] = 1 - share
    out[rows, at + 1] = share
    return out


def unit_of(factors: Sequence[tuple[str, str]]) -> str:
    """Of a product of forms.

    >>> unit_of([("deg/s", "u"), ("mm²", "√|u|")])
    '(deg/s)·mm'
    """
    parts = []
    for unit, form in factors:
        power = _POWER[form]
        if unit == "–" or power == 0:
            continue
        if power == 0.5 and unit == "mm²":
            parts.append("mm")
        else:
            parts.append(f"({unit})" if power == 1 else f"({unit})^{power:g}")
    return "·".join(parts) or "–"


def ampere_per(unit: str) -> str:
    """Of what a law takes times a quantity in `unit`, as `unit_of` writes it.

    >>> ampere_per("(mm/s)"), ampere_per("(mm/s)·(N)"), ampere_per("–")
    ('A/(mm/s)', 'A/((mm/s)·(N))', 'A')
    """
    one = unit.startswith("(") and unit.index(")") == len(unit) - 1
    return "A" if unit == "–" else f"A/{unit}" if one else f"A/({unit})"


def in_classes(values: Float1D, count: int) -> tuple[Int1D, Float1D]:
    """In which of `count` classes, as wide as one another, each value lies; and their middles, (count,)."""
    edges = np.linspace(values.min(), values.max(), count + 1)
    at = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, count - 1)
    return at, (edges[1:] + edges[:-1]) / 2


def side_of(both: bool) -> str:
    """The form of a signal whose level counts on both sides of zero, or on one."""
    return "|u|" if both else "u"


def written(signal: str, form: str) -> str:
    """A form of a signal in words.

    >>> written("t_cut", "√|u|"), written("v_x", "√|u| sgn u"), written("v_x", "sgn u")
    ('√|t_cut|', '√|v_x|·sgn(v_x)', 'sgn(v_x)')
    """
    return _WRITTEN[form].format(u=signal)
