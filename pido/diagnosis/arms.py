"""A law without a name that acts on an arm: in proportion to one quantity, and to how far from somewhere another is.

In:  recorded quantities. Out: `Arm`, and how much each would take away from a coarse residual.
A force has a moment about a pivot, a table tilts the more the further out it carries a load, a column gives way as it
is drawn out. Where the arm is zero is not the machine's zero, so that no product of the two quantities says it. What
coolant or speed changes of a load or a friction is the same law, beside what the simulation takes for its mean.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.core.axes import LINEAR_AXES
from pido.diagnosis.flexible import Coarse
from pido.diagnosis.formulas import Unnamed, ampere_per, unit_of
from pido.diagnosis.mechanisms.base import Parameter
from pido.diagnosis.signals import signals
from pido.diagnosis.state import AxisState

_CHANGES = ("coolant", "v_sp", "feed", "AR")  # what changes a load or a friction, beside places
_FLAT = 1e-9  # of a column's power that is left beside the other


@dataclass(frozen=True)
class Arm(Unnamed):
    """dI = (k_0 + k_1 * s) * u over a place s, or what else changes it; unit, length : those of u and s."""

    place: str
    signal: str
    unit: str
    length: str = "mm"

    shape: ClassVar[tuple[Parameter, ...]] = ()

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.place, self.signal})

    @property
    def equation(self) -> str:  # type: ignore[override]
        return f"dI = (k_0 + k_1 * {self.place}) * {self.signal}"

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        by_place = unit_of([(self.length, "u"), (self.unit, "u")])
        return Parameter("k_0", ampere_per(unit_of([(self.unit, "u")]))), Parameter("k_1", ampere_per(by_place))

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        if self.place in _CHANGES:
            return f"with {self.signal}, more or less of it with {self.place}", ()
        return f"with {self.signal}, in proportion to how far from somewhere {self.place} is", ()

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        return self.over(signals(state, self.reads))

    def over(self, known: Mapping[str, tuple[Float1D, str]]) -> Float2D:
        """(n, 2) – what each amplitude counts for, at values of the quantities."""
        u = known[self.signal][0]
        return np.column_stack([u, u * known[self.place][0]])


def arms(axis: str, known: Mapping[str, tuple[Float1D, str]], few: Coarse) -> list[tuple[float, Arm]]:
    """Arms of every load and motion of this axis along every axis, each with what it would take away by itself."""
    root = np.sqrt(few.weights)
    values = root * few.values
    out = []
    for arm in _offered(axis, known):
        rows = arm.over(known) * root[:, None]
        size = np.sqrt(np.sum(rows**2, axis=0))
        if size.all():
            Q, R = np.linalg.qr(rows / size)
            if R[1, 1] ** 2 > _FLAT:
                out.append((float(np.sum((Q.T @ values) ** 2)), arm))
    return out


def _offered(axis: str, known: Mapping[str, tuple[Float1D, str]]) -> Iterator[Arm]:
    for place in (*(f"pos_{a}" for a in LINEAR_AXES), *_CHANGES):
        # That Coulomb's friction changes along the axis' own travel has a name.
        own = (f"v_{axis}", f"a_{axis}", f"I_{axis}", *([f"held_{axis}"] if place != f"pos_{axis}" else []))
        for name in (*own, *(f"f_{a}" for a in LINEAR_AXES), "M_sp"):
            if place in known and name in known and name != place:
                yield Arm(place, name, known[name][1], known[place][1])
