"""A law without a name that is stronger, or weaker, around one value of another quantity: a friction that vibrations
ease about one speed of the spindle, a load of one range of them.

In:  recorded quantities and a coarse residual. Out: `Resonant`, and the few that take away most.
A peak by itself is a current (`Peak`); here it is how much of a motion or a load is felt. All peaks of a quantity are
compared at once, from sums over its classes.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.diagnosis.flexible import Coarse
from pido.diagnosis.formulas import FORMS, Unnamed, ampere_per, in_classes, side_of, unit_of, written
from pido.diagnosis.mechanisms.base import Parameter, up_to_edge
from pido.diagnosis.signals import Known, signals
from pido.diagnosis.state import AxisState
from pido.diagnosis.terms import Term

_CENTRES, _CLASSES = 24, 200
_WIDTHS = (0.02, 0.06, 0.2)  # of the range of a quantity
_ENDS = (0.01, 0.99)  # of its values, between which a peak is looked for
_BEST = 2  # so many numbers say a little of anything: more of them would leave no place for others
_FLAT = 1e-6  # share of the power of the peak that is left beside the law itself


@dataclass(frozen=True)
class Resonant(Unnamed):
    """dI = (k_0 + k * exp(-((w - c) / b)^2)) * p(u) around the value c of w, of |w| where that goes either way.

    unit, of : those of u and w; ends : within which c lies; flat : k counts from c - b to c + b, and not beyond
    """

    by: str
    signal: str
    form: str
    unit: str
    of: str
    even: bool
    ends: tuple[float, float]
    flat: bool = False

    @property
    def shape(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        low, high = self.ends
        return Parameter("c", self.of, low, high, scale="linear"), Parameter("b", self.of, low=0.0, scale="log")

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.by, self.signal})

    @property
    def _around(self) -> str:
        return written(self.by, side_of(self.even))

    @property
    def equation(self) -> str:  # type: ignore[override]
        law = written(self.signal, self.form)
        if self.flat:
            return f"dI = (k_0 + k * h) * {law}; h = 1 where c - b < {self._around} < c + b, else 0"
        return f"dI = (k_0 + k * exp(-(({self._around} - c) / b)^2)) * {law}"

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        per = ampere_per(unit_of([(self.unit, self.form)]))
        return Parameter("k_0", per), Parameter("k", per)

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        law, c, b = written(self.signal, self.form), shape["c"], shape["b"]
        if self.flat:
            return f"with {law}, more or less of it for {self._around} from {c - b:.4g} to {c + b:.4g} {self.of}", ()
        return f"with {law}, more or less of it around {self._around} = {c:.3g} {self.of}", ()

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        return self.over(signals(state, self.reads), shape)

    def over(self, known: Known, shape: Mapping[str, float]) -> Float2D:
        """(n, 2) – what each amplitude counts for, at values of the quantities."""
        u, w = FORMS[self.form](known[self.signal][0]), FORMS[side_of(self.even)](known[self.by][0])
        far = np.abs(w - shape["c"]) / shape["b"]
        peak = up_to_edge(far) if self.flat else np.exp(-(far**2))
        return np.column_stack([u, u * peak])

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        c, b, (low, high) = shape["c"], shape["b"], self.ends
        return (max(low, c - b), min(high, c + b)) if name == "c" else (b / 2, 2 * b)

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """The shape a step away; `by` is in widths of the peak and in powers of e."""
        c = np.clip(shape["c"] + by[0] * shape["b"], *self.ends)
        return {"c": float(c), "b": shape["b"] * float(np.exp(np.clip(by[1], -3, 3)))}

    def variants(self) -> tuple[Unnamed, ...]:
        return () if self.flat else (replace(self, flat=True),)


def resonant(axis: str, known: Known, few: Coarse) -> list[tuple[float, Term]]:
    """Motions and loads of this axis that are felt otherwise around one value of another quantity: those that take away
    most, each at the best of the places and widths tried."""
    found = []
    for by, even in _places(known):
        w = FORMS[side_of(even)](known[by][0])
        low, high = np.quantile(w, _ENDS)
        if not low < high:
            continue
        ends = (float(w.min()), float(w.max()))
        at, middle = in_classes(w, _CLASSES)
        centres = np.unique(np.r_[np.quantile(w, np.linspace(*_ENDS, _CENTRES)), np.linspace(low, high, _CENTRES)])
        shapes = [(float(c), float(share * (high - low))) for share in _WIDTHS for c in centres]
        peaks = np.array([np.exp(-(((middle - c) / b) ** 2)) for c, b in shapes])
        for name, form in _carriers(axis, known):
            if name != by:
                u = FORMS[form](known[name][0])
                sums = (few.weights * u * of for of in (u, few.values))
                gains = _gains(peaks, *(np.bincount(at, each, _CLASSES).astype(float) for each in sums))
                best = int(np.argmax(gains))
                law = Resonant(by, name, form, known[name][1], known[by][1], even, ends)
                found.append((float(gains[best]), Term(law, tuple(zip("cb", shapes[best], strict=True)))))
    return heapq.nlargest(_BEST, found, key=lambda each: each[0])


def _gains(peaks: Float2D, own: Float1D, towards: Float1D) -> Float1D:
    """(k,) – what a law and each of (k, classes) peaks of it take away together.

    own, towards : (classes,) – sums of the law with itself and with what is left
    """
    first, total = float(towards.sum()), float(own.sum())
    if not total > 0:
        return np.zeros(len(peaks))
    share = peaks @ own / total
    power = peaks**2 @ own
    left = power - share**2 * total
    seen = left > _FLAT * power
    gains: Float1D = first**2 / total + np.where(seen, (peaks @ towards - share * first) ** 2, 0.0) / np.where(
        seen, left, 1.0
    )
    return gains


def _places(known: Known) -> Iterator[tuple[str, bool]]:
    """What may have a peak, and whether its sign does not matter. Not what limits a box, for what is confined by that
    has a name there; nor a place, which differs from part to part as much else does."""
    for name in ("v_z", "v_sp", "feed_rev"):
        if name in known:
            yield name, name.startswith("v_")


def _carriers(axis: str, known: Known) -> list[tuple[str, str]]:
    """Motions of this axis, its load and current, and how fast the tool goes along its path."""
    own = [(f"v_{axis}", "sgn u"), (f"v_{axis}", "u"), (f"held_{axis}", "u"), (f"a_{axis}", "u"), (f"I_{axis}", "u")]
    others = [(f"f_{axis}", "u"), ("M_sp", "u"), ("feed", "u"), ("feed", "√|u|")]
    return [(name, form) for name, form in (*own, *others) if name in known]
