"""A law without a name that acts on an arm: in proportion to one quantity, and to how far from somewhere another is.

In:  recorded quantities. Out: `Arm`, and how much each would take away from a coarse residual.
A force has a moment about a pivot, a table tilts the more the further out it carries a load, a column gives way as it
is drawn out. Where the arm is zero is not the machine's zero, so that no product of the two quantities says it. What
coolant or speed changes of a load or a friction is the same law, beside what the simulation takes for its mean; where
it changes less and less, as a film that another motion has lifted bears all there is to bear, it is `Eased`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.core.axes import LINEAR_AXES
from pido.diagnosis.flexible import Coarse
from pido.diagnosis.formulas import FORMS, Unnamed, ampere_per, unit_of, written
from pido.diagnosis.mechanisms.base import Parameter, Told
from pido.diagnosis.signals import Known, signals
from pido.diagnosis.state import AxisState
from pido.diagnosis.switches import eased_in, told_of_switch
from pido.diagnosis.terms import Term

_PLACES = ("pos_", "from_")
_CHANGES = ("coolant", "v_sp", "feed", "AR")  # what changes a load or a friction, beside places
_SIZES = np.array([0.03, 0.1, 0.3, 1.0])  # of what is usual of a quantity, within which it eases
_FLAT = 1e-9  # of a column's power that is left beside the other


@dataclass(frozen=True)
class Arm(Unnamed):
    """dI = (k_0 + k_1 * p(s)) * q(u) over a place s, or what else changes it.

    unit, length : those of u and s; by, form : p and q
    """

    place: str
    signal: str
    unit: str
    length: str = "mm"
    by: str = "u"
    form: str = "u"

    shape: ClassVar[tuple[Parameter, ...]] = ()

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.place, self.signal})

    @property
    def equation(self) -> str:  # type: ignore[override]
        return f"dI = (k_0 + k_1 * {written(self.place, self.by)}) * {written(self.signal, self.form)}"

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        of, by_place = (self.unit, self.form), (self.length, self.by)
        return Parameter("k_0", ampere_per(unit_of([of]))), Parameter("k_1", ampere_per(unit_of([by_place, of])))

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        u = written(self.signal, self.form)
        if not self.place.startswith(_PLACES):
            return f"with {u}, more or less of it with {self.place}", ()
        return f"with {u}, in proportion to how far from somewhere {self.place} is", ()

    def told(self, states: Sequence[AxisState], shape: Mapping[str, float], sizes: Mapping[str, float]) -> Told:
        axis, plain = states[0].axis, super().told(states, shape, sizes)
        if self.place != "coolant" or not {"k_0", "k_1"} <= sizes.keys():
            return plain
        off = sizes["k_0"]
        return told_of_switch(axis, (self.signal, self.form), self.place, off + sizes["k_1"], off) or plain

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        return self.over(signals(state, self.reads))

    def over(self, known: Known) -> Float2D:
        """(n, 2) – what each amplitude counts for, at values of the quantities."""
        u = FORMS[self.form](known[self.signal][0])
        return np.column_stack([u, u * FORMS[self.by](known[self.place][0])])


@dataclass(frozen=True)
class Eased(Unnamed):
    """dI = (k_0 + k_1 * exp(-|w| / c)) * p(u): a friction or a load that another quantity w changes less and less.

    unit, of : those of u and w
    """

    by: str
    signal: str
    form: str
    unit: str
    of: str

    @property
    def shape(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return (Parameter("c", self.of, low=0.0, scale="log"),)

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.by, self.signal})

    @property
    def equation(self) -> str:  # type: ignore[override]
        return f"dI = (k_0 + k_1 * exp(-|{self.by}| / c)) * {written(self.signal, self.form)}"

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        per = ampere_per(unit_of([(self.unit, self.form)]))
        return Parameter("k_0", per), Parameter("k_1", per)

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        up_to = f"{shape['c']:.3g} {self.of}"
        return f"with {written(self.signal, self.form)}, changing with {self.by} up to some {up_to}", ()

    def told(self, states: Sequence[AxisState], shape: Mapping[str, float], sizes: Mapping[str, float]) -> Told:
        """Where it is eased before the other quantity is at its least, that is a switch."""
        axis, plain = states[0].axis, super().told(states, shape, sizes)
        if not {"k_0", "k_1"} <= sizes.keys() or not eased_in(self.by, shape["c"], states):
            return plain
        on = sizes["k_0"]
        return told_of_switch(axis, (self.signal, self.form), self.by, on, on + sizes["k_1"]) or plain

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        return self.over(signals(state, self.reads), shape["c"])

    def over(self, known: Known, c: float) -> Float2D:
        """(n, 2) – what each amplitude counts for, at values of the quantities."""
        u = FORMS[self.form](known[self.signal][0])
        return np.column_stack([u, u * np.exp(-np.abs(known[self.by][0]) / c)])

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        return shape["c"] / 3, 3 * shape["c"]

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """The shape a step away, in powers of e."""
        return {"c": float(shape["c"] * np.exp(np.clip(by[0], -3, 3)))}


def eased(axis: str, known: Known, few: Coarse) -> list[tuple[float, Term]]:
    """Frictions and loads of this axis that another quantity eases, each with what it would take away by itself at the
    best of the sizes tried."""
    out = []
    for law in _eased_by(axis, known):
        size = np.abs(known[law.by][0])
        usual = float(np.median(size[size > 0])) if np.any(size > 0) else 0.0
        tried = [(_gain(law.over(known, c), few), c) for c in usual * _SIZES if c > 0]
        if tried:
            gain, c = max(tried)
            out.append((gain, Term(law, (("c", float(c)),))))
    return out


def _eased_by(axis: str, known: Known) -> Iterator[Eased]:
    others = (*(f"v_{a}" for a in (*LINEAR_AXES, "sp") if a != axis), "feed", "MRR", "AR")
    loads = (*(f"f_{a}" for a in LINEAR_AXES), "M_sp")
    carriers = ((f"v_{axis}", "sgn u"), (f"v_{axis}", "u"), (f"f_{axis}", "u"), ("M_sp", "u"))
    for by in (*others, *loads):
        for name, form in carriers:
            if by in known and name in known and name != by:
                yield Eased(by, name, form, known[name][1], known[by][1])


def arms(axis: str, known: Known, few: Coarse) -> list[tuple[float, Arm]]:
    """Arms of every load and motion of this axis along every axis, each with what it would take away by itself."""
    return [(_gain(arm.over(known), few), arm) for arm in _offered(axis, known)]


def _gain(rows: Float2D, few: Coarse) -> float:
    """What two columns (m, 2) take away together; nothing where they are one."""
    root = np.sqrt(few.weights)
    rows = rows * root[:, None]
    size = np.sqrt(np.sum(rows**2, axis=0))
    if not size.all():
        return 0.0
    Q, R = np.linalg.qr(rows / size)
    return float(np.sum((Q.T @ (root * few.values)) ** 2)) if R[1, 1] ** 2 > _FLAT else 0.0


def _offered(axis: str, known: Known) -> Iterator[Arm]:
    own = ((f"held_{axis}", "u"), *((f"{u}_{axis}", "u") for u in "vaI"), (f"v_{axis}", "sgn u"))
    loads = tuple((name, "u") for name in (*(f"f_{a}" for a in LINEAR_AXES), "M_sp", "coolant"))
    for place in (*(f"{place}{a}" for place in _PLACES for a in LINEAR_AXES), *_CHANGES):
        for name, form in (*own, *loads):
            if place in known and name in known and name != place and not _has_a_name(axis, place, name, form):
                for by in ("u", "u²") if place in _CHANGES else ("u",):
                    yield Arm(place, name, known[name][1], known[place][1], by, form)


def arm_of(axis: str, known: Known, signal: tuple[str, str], place: tuple[str, str]) -> Arm | None:
    """What one quantity changes of another, each with its form; None where the catalogue has a name for that."""
    (name, form), (where, by) = signal, place
    if _has_a_name(axis, where, name, form):
        return None
    return Arm(where, name, known[name][1], known[where][1], by, form)


def _has_a_name(axis: str, place: str, name: str, form: str) -> bool:
    """That Coulomb's friction changes along the axis' own travel has one."""
    return place == f"pos_{axis}" and (name == f"held_{axis}" or form == "sgn u")
