"""A friction or a load that gets less and less with how large a cause has been lately: a film of oil that motion
carries in, and rest lets go.

In:  the residual of one axis as averages, and the quantities that could drive it.
Out: `EasedLately` terms worth a closer look.
Source: friction that remembers (Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, section 2.1.4: frictional memory).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.diagnosis.flexible import Coarse, price
from pido.diagnosis.formulas import FORMS, Unnamed, ampere_per, unit_of, written
from pido.diagnosis.late import HEAT_S, SHORTEST_S, Behind, Lately, Modulated, causes
from pido.diagnosis.mechanisms.base import Parameter
from pido.diagnosis.signals import Known, signals
from pido.diagnosis.state import AxisState
from pido.diagnosis.terms import Term
from pido.physics.drive import answered_late

_SIZES = np.array([0.3, 1.0, 3.0])  # of what a cause usually has been
_BEST = 6


@dataclass(frozen=True)
class EasedLately(Behind):
    """dI = (k_0 + k_1 * exp(-w_late / c)) * p(u), w_late = |w| / (1 + tau s).

    unit, of : those of u and w
    """

    cause: str  # w
    signal: str  # u
    form: str  # p
    unit: str
    of: str

    passes_loop: ClassVar[bool] = True

    @property
    def shape(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return Parameter("tau", "s", low=0.0, scale="log"), Parameter("c", self.of, low=0.0, scale="log")

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.cause, self.signal})

    @property
    def equation(self) -> str:  # type: ignore[override]
        return f"dI = (k_0 + k_1 * exp(-(|{self.cause}| / (1 + tau s)) / c)) * {written(self.signal, self.form)}"

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        per = ampere_per(unit_of([(self.unit, self.form)]))
        return Parameter("k_0", per), Parameter("k_1", per)

    def variants(self) -> tuple[Unnamed, ...]:
        """What changes in proportion to how the cause has been."""
        both = unit_of([(self.unit, self.form), (self.of, "|u|")])
        own = unit_of([(self.unit, self.form)])
        return (Modulated(self.signal, self.form, self.cause, "|u|", both, level=own),)

    def over(self, u: Float1D, late: Float1D, c: float) -> Float2D:
        """(n, 2) – what each amplitude counts for."""
        carrier = FORMS[self.form](u)
        return np.column_stack([carrier, carrier * np.exp(-late / c)])

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        known = signals(state, self.reads)
        size = np.abs(known[self.cause][0])
        late = answered_late(size[None], state.time, shape["tau"])[0]
        return self.over(known[self.signal][0], late, shape["c"])

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        return shape[name] / 3, 3 * shape[name]

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """The shape a step away; `by` is in powers of e."""
        tau, c = (shape[n] * np.exp(np.clip(b, -3, 3)) for n, b in zip(("tau", "c"), by, strict=True))
        return {"tau": max(float(tau), SHORTEST_S), "c": float(c)}

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        u, lately = written(self.signal, self.form), f"what {self.cause} was in the last {shape['tau']:.3g} s"
        return f"with {u}, changing with {lately} up to some {shape['c']:.3g} {self.of}", ()


def eased_lately(lately: Lately, few: Coarse) -> list[Term]:
    """The best of all laws of this kind, each with its best shape of those tried.

    few : what is left, as averages
    """
    axis, known, values = lately.mismatch.axis, lately.known, lately.values
    tried = []
    for law in _offered(axis, known):
        best = (np.inf, Term(law))
        for tau in HEAT_S:
            late = lately.of(law.cause, "|u|", tau)
            usual = float(np.median(late[late > 0])) if np.any(late > 0) else 0.0
            for c in map(float, usual * _SIZES if usual else ()):
                cost = price(law.over(values[law.signal], late, c), few)
                best = min(best, (cost, Term(law, (("tau", tau), ("c", c)))), key=lambda each: each[0])
        tried.append(best)
    return [term for cost, term in sorted(tried, key=lambda each: each[0])[:_BEST] if np.isfinite(cost)]


def _offered(axis: str, known: Known) -> Iterator[EasedLately]:
    own, load = f"v_{axis}", f"f_{axis}"
    for name, form in ((own, "sgn u"), (own, "u"), (load, "u")):
        for cause in dict.fromkeys(c for c, _ in causes(known, axis)):
            if name in known and cause != f"I_{axis}":
                yield EasedLately(cause, name, form, known[name][1], known[cause][1])
