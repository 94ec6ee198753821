"""Models without a name that answer through a first order lag: a current that follows late, what a change leaves and
time takes back, and what acts in proportion to how a quantity has been lately, as a motor that its losses warm.

In:  the residual of one axis as averages, and the quantities that could drive it.
Out: `Lagged`, `Fading` and `Modulated` terms worth a closer look.
"""

from __future__ import annotations

import itertools
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from pido.core.arrays import Float1D, Float2D, Int1D
from pido.core.axes import LINEAR_AXES
from pido.diagnosis.flexible import Coarse, price
from pido.diagnosis.formulas import FORMS, Unnamed, ampere_per, unit_of, written
from pido.diagnosis.mechanisms.base import Parameter
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.signals import Known, signals
from pido.diagnosis.state import AxisState
from pido.diagnosis.terms import Term
from pido.physics.drive import answered_late

SHORTEST_S = 1e-3  # of what acts late: what is sooner acts at once
TIMES_S = (0.1, 0.3, 1.0, 3.0, 10.0)
_SLOW_TIMES_S = (30.0, 100.0, 300.0)
HEAT_S = (1.0, 3.0, 10.0, *_SLOW_TIMES_S)
LONGEST_S = 30.0  # what comes later still is drift
_BEST_TIMES = 2  # of every law, by the averages
_ELSE_ZERO = {"": "", "moving": ", 0 at standstill", "cutting": ", 0 in the air"}
_MODULATED = 40  # of these, the best by the averages

Values = Mapping[str, Float1D]


class Behind(Unnamed):
    """What answers through a first order lag of tau."""

    longest: ClassVar[float] = np.inf  # s
    passes_loop: ClassVar[bool] = False
    shape: ClassVar[tuple[Parameter, ...]] = (Parameter("tau", "s", low=0.0, scale="log"),)

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        return shape[name] / 2, shape[name] * 2

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """The shape a step away; `by` is in powers of e."""
        return {"tau": float(np.clip(shape["tau"] * np.exp(np.clip(by[0], -3, 3)), SHORTEST_S, self.longest))}


class Late(Behind):
    """What one late quantity makes, at once, together with what else is there."""

    @property
    @abstractmethod
    def driver(self) -> tuple[str, str]:
        """Signal and form of what is late."""

    @property
    def reads(self) -> frozenset[str]:
        """The signals that it follows from."""
        return frozenset({self.driver[0]})

    @abstractmethod
    def over(self, known: Values, late: Float1D) -> Float2D:
        """(n, k), from the signals and what is late, (n,) each. Of the state: 'cutting' and 'moving', 0 or 1."""

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        known = {n: v for n, (v, _) in signals(state, self.reads).items()} | _what_it_does(state)
        name, form = self.driver
        return self.over(known, answered_late(FORMS[form](known[name])[None], state.time, shape["tau"])[0])


@dataclass(frozen=True)
class Lagged(Late):
    """A quantity that acts late: dI = k * p(u) / (1 + tau s). What acts at once has a name or is a formula.

    by_cut : with another coefficient while the tool cuts
    level : with a constant beside it, as what is counted from the usual level of the quantity has
    """

    signal: str
    form: str
    unit: str
    by_cut: bool = False
    level: bool = False

    longest: ClassVar[float] = LONGEST_S

    @property
    def driver(self) -> tuple[str, str]:
        return self.signal, self.form

    @property
    def equation(self) -> str:  # type: ignore[override]
        late = f"k * {written(self.signal, self.form)} / (1 + tau s)"
        return "dI = " + "k_0 + " * self.level + late + ", another k while cutting" * self.by_cut

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        names = ("k", "k_cut") if self.by_cut else ("k",)
        unit = ampere_per(unit_of([(self.unit, self.form)]))
        return (*(Parameter(name, unit) for name in names), *([Parameter("k_0", "A")] if self.level else []))

    def over(self, known: Values, late: Float1D) -> Float2D:
        columns = [late * (1 - known["cutting"]), late * known["cutting"]] if self.by_cut else [late]
        return np.column_stack([*columns, *([np.ones(len(late))] if self.level else [])])

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        return f"following {self.signal} {shape['tau']:.3g} s late", ()


@dataclass(frozen=True)
class Fading(Late):
    """What a change of a quantity leaves and time takes back: dI = k * p(u) * tau s / (1 + tau s).

    only : 'moving': a drag, which is not there while the axis stands; 'cutting': a filter that is switched on for a cut
    """

    signal: str
    form: str
    unit: str
    only: str = ""

    longest: ClassVar[float] = LONGEST_S

    @property
    def driver(self) -> tuple[str, str]:
        return self.signal, self.form

    @property
    def equation(self) -> str:  # type: ignore[override]
        u = written(self.signal, self.form)
        return f"dI = k * {u} * tau s / (1 + tau s)" + _ELSE_ZERO[self.only]

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return (Parameter("k", f"A/({self.unit})"),)

    def over(self, known: Values, late: Float1D) -> Float2D:
        left = FORMS[self.form](known[self.signal]) - late
        return (left * known[self.only] if self.only else left)[:, None]

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        when = " while cutting" if self.only == "cutting" else ""
        return f"after changes of {self.signal}{when}, fading within some {shape['tau']:.3g} s", ()


@dataclass(frozen=True)
class Modulated(Late):
    """What acts in proportion to how a cause has been lately: dI = k * p(u) * (q(w) / (1 + tau s)).

    A motor's current with its losses (I and I²): its torque constant falls as the winding warms. A friction (v or its
    sign) with what it loses itself (|v|, v²) or another quantity has been: what lubricates it gets thinner.
    Source: first-order thermal model of the winding, of the guideway.

    beside : in proportion to the late cause by itself as well: dI = (k_0 + k * p(u)) * (q(w) / (1 + tau s))
    level : the cause counts from a level of its own, as what a simulation knows at its usual temperature does:
        dI = p(u) * (k_0 + k * q(w) / (1 + tau s))
    """

    signal: str  # u
    form: str  # p
    cause: str  # w
    loss: str  # q
    unit: str  # of p(u) * q(w)
    beside: str = ""  # unit of q(w)
    level: str = ""  # unit of p(u)

    @property
    def driver(self) -> tuple[str, str]:
        return self.cause, self.loss

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.signal, self.cause})

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        other = self.beside or self.level
        return Parameter("k", ampere_per(self.unit)), *([Parameter("k_0", ampere_per(other))] if other else [])

    @property
    def equation(self) -> str:  # type: ignore[override]
        own, late = written(self.signal, self.form), f"{written(self.cause, self.loss)} / (1 + tau s)"
        if self.level:
            return f"dI = {own} * (k_0 + k * {late})"
        return f"dI = {f'(k_0 + k * {own})' if self.beside else f'k * {own}'} * ({late})"

    def variants(self) -> tuple[Unnamed, ...]:
        """The late cause by itself, where it may be that alone."""
        return (Lagged(self.cause, self.loss, self.beside),) if self.beside else ()

    def over(self, known: Values, late: Float1D) -> Float2D:
        steady = FORMS[self.form](known[self.signal])
        other = [late] if self.beside else [steady] if self.level else []
        return np.column_stack([steady * late, *other])

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        u, tau = written(self.signal, self.form), f"{shape['tau']:.3g} s"
        if self.cause == self.signal:
            return f"in proportion to {u}, changing with what {self.signal} lost as heat in some {tau}", ()
        return f"in proportion to {u}, changing with what {self.cause} was in the last {tau}", ()


@dataclass(frozen=True, eq=False)
class Lately:
    """How quantities have been lately, in the rows of averages (`Coarse`), (m,); each is made once.

    known : `common_signals` of the mismatch
    """

    mismatch: Mismatch
    known: Known
    rows: Int1D
    _made: dict[tuple[str, str, float], Float1D] = field(default_factory=dict)

    @cached_property
    def values(self) -> dict[str, Float1D]:
        """The quantities as they are at once."""
        return {n: v[self.rows] for n, (v, _) in self.known.items()}

    def of(self, name: str, form: str, tau: float) -> Float1D:
        """(m,) – a form of a quantity, tau seconds late."""
        if (name, form, tau) not in self._made:
            self._made[name, form, tau] = self.late(FORMS[form](self.known[name][0]), tau)
        return self._made[name, form, tau]

    def late(self, rows: Float1D, tau: float) -> Float1D:
        """(m,) – anything, (n,), tau seconds late."""
        return _late_in_parts(rows, self.mismatch, tau)[self.rows]


def late_terms(lately: Lately, few: Coarse) -> list[Term]:
    """Every law that acts late, and the best of those that are modulated, each with its best times of those tried.

    few : what is left, as averages
    """
    mismatch, known = lately.mismatch, lately.known
    does = [_what_it_does(s) for s in mismatch.states]
    states = {n: np.concatenate([d[n] for d in does])[few.rows] for n in ("cutting", "moving")}
    values = lately.values | states

    def best(law: Late, times: Sequence[float]) -> list[tuple[float, Term]]:
        prices = {tau: price(law.over(values, lately.of(*law.driver, tau)), few) for tau in times}
        return [
            (prices[tau], Term(law, (("tau", tau),))) for tau in sorted(times, key=prices.__getitem__)[:_BEST_TIMES]
        ]

    plain = [term for law in _laws(mismatch, known) for _, term in best(law, TIMES_S)]
    usual = (*TIMES_S, *_SLOW_TIMES_S)
    every = [e for law in _modulated(mismatch.axis, known) for e in best(law, HEAT_S if law.level else usual)]
    return [*plain, *(term for _, term in sorted(every, key=lambda each: each[0])[:_MODULATED])]


def _laws(mismatch: Mismatch, known: Known) -> Iterator[Late]:
    axis = mismatch.axis
    engaged = [s.engaged for s in mismatch.states]
    cuts = all(e is not None and e.any() and not e.all() for e in engaged)
    for name, form in causes(known, axis):
        unit = known[name][1]
        yield Lagged(name, form, unit)
        yield Lagged(name, form, unit, level=True)
        if cuts:
            yield Lagged(name, form, unit, by_cut=True)
        yield Fading(name, form, unit)
        if name == f"v_{axis}":
            yield Fading(name, form, unit, only="moving")
        if cuts and (name, form) == (f"I_{axis}", "u"):
            yield Fading(name, form, unit, only="cutting")


def _modulated(axis: str, known: Known) -> Iterator[Modulated]:
    every = [*causes(known, axis), *([(f"v_{axis}", "u²")] if f"v_{axis}" in known else [])]
    carriers = [(f"v_{axis}", "u"), (f"v_{axis}", "sgn u"), (f"v_{axis}", "|u|"), (f"I_{axis}", "u")]
    for (name, form), (cause, loss) in itertools.product([c for c in carriers if c[0] in known], every):
        of_own, of_cause = (known[name][1], form), (known[cause][1], loss)
        both = unit_of([of_own, of_cause])
        yield Modulated(name, form, cause, loss, both)
        yield Modulated(name, form, cause, loss, both, beside=unit_of([of_cause]))
        # A friction or a torque constant, which heat changes: heat knows no sign.
        if form != "|u|" and (loss != "u" or known[cause][0].min() >= 0):
            yield Modulated(name, form, cause, loss, both, level=unit_of([of_own]))


def causes(known: Known, axis: str) -> Iterator[tuple[str, str]]:
    """Signals, each with its form, that something late may follow from."""
    forces = (f"f_{a}" for a in (axis, *LINEAR_AXES))
    for name in dict.fromkeys((f"v_{axis}", *forces, f"I_{axis}", "feed", "MRR", "M_sp", "v_sp", "a_sp")):
        if name in known:
            yield name, "u"
            if known[name][0].min() < 0 < known[name][0].max():
                yield name, "|u|"
            if name == f"I_{axis}":
                yield name, "u²"  # its losses


def _what_it_does(state: AxisState) -> dict[str, Float1D]:
    cutting = np.zeros(len(state.time)) if state.engaged is None else np.asarray(state.engaged, float)
    return {"cutting": cutting, "moving": np.asarray(state.moving, float)}


def _late_in_parts(values: Float1D, mismatch: Mismatch, tau: float) -> Float1D:
    """`answered_late` of every part by itself, (n,)."""
    parts = np.split(values, mismatch.edges[1:-1])
    return np.concatenate([answered_late(u[None], s.time, tau)[0] for u, s in zip(parts, mismatch.states, strict=True)])
