"""Models without a name that are late, and grow along the way of an axis.

In:  the residual of one axis as averages, and the quantities that could drive it.
Out: `LaggedArm` and `Warped` terms worth a closer look.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.core.axes import LINEAR_AXES
from pido.diagnosis.arms import Arm
from pido.diagnosis.flexible import Coarse, price
from pido.diagnosis.formulas import Unnamed, ampere_per, unit_of, written
from pido.diagnosis.late import HEAT_S, LONGEST_S, TIMES_S, Behind, Lagged, Late, Lately, Values, causes
from pido.diagnosis.mechanisms.base import Parameter
from pido.diagnosis.signals import Known, signals
from pido.diagnosis.state import AxisState
from pido.diagnosis.terms import Term
from pido.physics.drive import answered_late

_BEST = 12


@dataclass(frozen=True)
class LaggedArm(Behind):
    """What acts late on an arm (`arms.Arm`): dI = ((k_0 + k_1 * s) * p(u)) / (1 + tau s).

    Two drives of one beam wind each other up as it moves, and give way again: the more, the further out the load is.
    place, length : s and its unit
    """

    signal: str
    form: str
    unit: str
    place: str
    length: str

    longest: ClassVar[float] = LONGEST_S

    @property
    def arm(self) -> Arm:
        """The same at once."""
        return Arm(self.place, self.signal, self.unit, self.length, form=self.form)

    @property
    def reads(self) -> frozenset[str]:
        return self.arm.reads

    @property
    def equation(self) -> str:  # type: ignore[override]
        return f"dI = ({self.arm.equation.removeprefix('dI = ')}) / (1 + tau s)"

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return self.arm.amplitudes

    def variants(self) -> tuple[Unnamed, ...]:
        """What is alike everywhere."""
        return (Lagged(self.signal, self.form, self.unit),)

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        return answered_late(self.arm.over(signals(state, self.reads)).T, state.time, shape["tau"]).T

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        of = f"in proportion to how far from somewhere {self.place} is"
        return f"following {self.signal} {shape['tau']:.3g} s late, {of}", ()


@dataclass(frozen=True)
class Warped(Late):
    """What is in proportion to a place, and more or less of it with how a cause has been lately:
    dI = k_0 + k_1 * s + (k_2 + k_3 * s) * q(w) / (1 + tau s).

    A screw that warms by its own motion grows from its fixed end; what makes up for that does the same.
    length, unit : those of s and q(w)
    """

    place: str  # s
    length: str
    cause: str  # w
    loss: str  # q
    unit: str

    @property
    def driver(self) -> tuple[str, str]:
        return self.cause, self.loss

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.place, self.cause})

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        units = ("A", f"A/{self.length}", ampere_per(self.unit), f"A/({self.unit})/{self.length}")
        return tuple(Parameter(f"k_{i}", unit) for i, unit in enumerate(units))

    @property
    def equation(self) -> str:  # type: ignore[override]
        late = f"{written(self.cause, self.loss)} / (1 + tau s)"
        return f"dI = k_0 + k_1 * {self.place} + (k_2 + k_3 * {self.place}) * ({late})"

    def variants(self) -> tuple[Unnamed, ...]:
        """What is alike everywhere."""
        return (Lagged(self.cause, self.loss, self.unit, level=True),)

    def over(self, known: Values, late: Float1D) -> Float2D:
        place, one = known[self.place], np.ones(len(late))
        return np.column_stack([one, place, late, place * late])

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        lately = f"changing with what {self.cause} was in the last {shape['tau']:.3g} s"
        return f"in proportion to how far from somewhere {self.place} is, {lately}", ()


def late_arms(lately: Lately, few: Coarse) -> list[Term]:
    """The best of all laws that are late and grow along a way, each with its best time of those tried.

    few : what is left, as averages
    """
    axis, known = lately.mismatch.axis, lately.known

    def columns(law: LaggedArm | Warped, tau: float) -> Float2D:
        if isinstance(law, Warped):
            return law.over(lately.values, lately.of(*law.driver, tau))
        further = law.arm.over(known)[:, 1]
        return np.column_stack([lately.of(law.signal, law.form, tau), lately.late(further, tau)])

    tried = [
        min(((price(columns(law, tau), few), Term(law, (("tau", tau),))) for tau in times), key=lambda each: each[0])
        for laws, times in ((_lagged(axis, known), TIMES_S), (_warped(axis, known), HEAT_S))
        for law in laws
    ]
    return [term for _, term in sorted(tried, key=lambda each: each[0])[:_BEST]]


def _lagged(axis: str, known: Known) -> Iterator[LaggedArm]:
    places = [p for p in (f"pos_{a}" for a in LINEAR_AXES) if p in known]
    for name in (n for n in (f"v_{axis}", f"a_{axis}", f"f_{axis}", f"I_{axis}") if n in known):
        for place in places:
            yield LaggedArm(name, "u", known[name][1], place, known[place][1])


def _warped(axis: str, known: Known) -> Iterator[Warped]:
    place = f"pos_{axis}"
    if place in known and axis != "sp":
        for cause, loss in causes(known, axis):
            if loss != "u" or known[cause][0].min() >= 0:
                yield Warped(place, known[place][1], cause, loss, unit_of([(known[cause][1], loss)]))
