"""What a physical equation is linear in: the 17 terms of the paper, and sets that know which way an axis last moved.

In:  samples (the 13 inputs, the held direction) and the machine.
Out: the design matrix, each column divided by what the *machine* can reach. Never by what the data show: a column that
     only noise excites would be blown up to size one, and its coefficient with it (measured: 114 A instead of 0.3 A).
Source: paper, eq. 5 and 17; held direction and plain velocity terms: reference equation of the mismatch finder.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol, runtime_checkable

import numpy as np

from pido.core.arrays import Bool1D, Float1D, Float2D
from pido.core.axes import LINEAR_AXES
from pido.core.columns import INPUTS
from pido.core.errors import FitError
from pido.core.machining import Machine
from pido.core.samples import Samples

_AT = {name: k for k, name in enumerate(INPUTS)}


@runtime_checkable
class ExtraTerm(Protocol):
    """Accepted physics of one axis, whose equation it extends. `columns` is (n, k), each over what the machine can
    reach of it, as all columns are."""

    @property
    def name(self) -> str: ...

    @property
    def axis(self) -> str: ...

    @property
    def found(self) -> tuple[float, ...]:
        """(k,), A at full reach: the size at which it was found, which holds where samples say nothing of it."""
        ...

    def columns(self, samples: Samples) -> Float2D: ...


@dataclass(frozen=True)
class TermSet:
    """A named list of columns. `constant` is the column that is 1 everywhere; it is never penalised.

    floor : share of the machine's range below which a column's excitation counts as noise. It enters as a ridge of
        floor² on the scaled columns. Products of two signals reach a small part of their range while cutting
        (v² at 10 mm/s is 4e-4 of v² at rapid), so the paper's terms need a lower floor than plain signals.
    """

    id: str
    names: tuple[str, ...]
    constant: int
    floor: float
    _columns: Callable[[Samples], Float2D]
    _ranges: Callable[[Machine], list[float]]
    extras: tuple[ExtraTerm, ...] = ()
    extra_sizes: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.names)

    def design(self, samples: Samples, machine: Machine) -> Float2D:
        """(n, p): the terms of each sample over the machine's ranges, – ; coefficients are A at full range."""
        columns = self._columns(samples) / np.asarray(self._ranges(machine))
        if not self.extras:
            return np.ascontiguousarray(columns)
        more = [np.asarray(term.columns(samples), float).reshape(len(samples), -1) for term in self.extras]
        for term, size, values in zip(self.extras, self.extra_sizes, more, strict=True):
            if values.shape[1] != size:
                raise FitError(f"extra term '{term.name}' has {values.shape[1]} column(s); it was added with {size}.")
        return np.ascontiguousarray(np.column_stack([columns, *more]))

    def scale(self, machine: Machine) -> Float1D:
        """(p,): what each column is divided by; 1 for extra terms, which come so already."""
        return np.r_[self._ranges(machine), np.ones(sum(self.extra_sizes))]

    @property
    def prior(self) -> Float1D:
        """(p,), A at full range: what coefficients are where samples say nothing of them."""
        found = [np.asarray(term.found, float) for term in self.extras]
        return np.concatenate([np.zeros(len(self) - sum(self.extra_sizes)), *found])

    def own(self, axis: str) -> Bool1D:
        """(p,): columns of the equation of `axis`. What was found on one axis is no part of another's equation."""
        sizes = zip(self.extras, self.extra_sizes, strict=True)
        extras = [term.axis == axis for term, size in sizes for _ in range(size)]
        return np.array([True] * (len(self) - len(extras)) + extras)

    def concerns(self, axis: str) -> bool:
        """Whether it is anything of its own for `axis`, rather than the equation that it extends."""
        return not self.extras or any(term.axis == axis for term in self.extras)

    def extended(self, term: ExtraTerm, size: int = 1) -> TermSet:
        """This equation with one more piece of physics of one axis, whose `columns` are (n, size)."""
        more = (term.name,) if size == 1 else tuple(f"{term.name} [{k}]" for k in range(size))
        if set(more) & set(self.names):
            raise FitError(f"the equation already has a term named '{term.name}'.")
        return replace(
            self,
            id=f"{self.id}+{term.name}",
            names=self.names + more,
            extras=(*self.extras, term),
            extra_sizes=(*self.extra_sizes, size),
        )


def _paper_columns(samples: Samples, sign: Callable[[Samples, str], Float1D]) -> Float2D:
    get = {name: samples.inputs[:, k] for name, k in _AT.items()}
    mrr, out = get["mrr_sim"], []
    for axis in (*LINEAR_AXES, "sp"):
        v, a = get[f"v_{axis}"], get[f"a_{axis}"]
        load = get["m_sp_sim" if axis == "sp" else f"f_{axis}_sim"]
        # a v sgn(v) and v² sgn(v) vanish with v: only the sign that stands alone can be held at standstill
        out += [a * np.abs(v), v * np.abs(v), load * mrr, sign(samples, axis)]
        if axis == "x":
            out.append(np.ones(len(samples)))
    return np.column_stack(out)


def _paper_ranges(machine: Machine) -> list[float]:
    ranges: list[float] = []
    for axis in LINEAR_AXES:
        limits = machine.axes[axis]
        ranges += [limits.a_max * limits.v_max, limits.v_max**2, machine.force_max_n * machine.mrr_max_mm3_s, 1.0]
        if axis == "x":
            ranges.append(1.0)
    omega = machine.spindle_max_deg_s
    return [*ranges, machine.spindle_acc_deg_s2 * omega, omega**2, machine.torque_max_nm * machine.mrr_max_mm3_s, 1.0]


def _exact_sign(samples: Samples, axis: str) -> Float1D:
    return np.sign(samples.inputs[:, _AT[f"v_{axis}"]])


def _held_sign(samples: Samples, axis: str) -> Float1D:
    return samples.direction[:, (*LINEAR_AXES, "sp").index(axis)]


_PAPER_NAMES = (
    "a_x v_x sgn(v_x)", "v_x² sgn(v_x)", "F_x MRR", "sgn(v_x)", "1",
    "a_y v_y sgn(v_y)", "v_y² sgn(v_y)", "F_y MRR", "sgn(v_y)",
    "a_z v_z sgn(v_z)", "v_z² sgn(v_z)", "F_z MRR", "sgn(v_z)",
    "a_sp v_sp sgn(v_sp)", "v_sp² sgn(v_sp)", "M_sp MRR", "sgn(v_sp)",
)  # fmt: skip

PAPER = TermSet("paper", _PAPER_NAMES, 4, 1e-5, partial(_paper_columns, sign=_exact_sign), _paper_ranges)
"""The 17 terms of eq. 17 as printed, with the sign of the velocity as recorded."""

PAPER_HELD = TermSet(
    "paper-held",
    tuple(n.replace("sgn(", "held(") if n.startswith("sgn(") else n for n in _PAPER_NAMES),
    4,
    1e-5,
    partial(_paper_columns, sign=_held_sign),
    _paper_ranges,
)
"""The same 17 terms; a sign that stands alone is that of the axis' last real motion."""


def _plain_ranges(machine: Machine) -> list[float]:
    axes = [machine.axes[axis] for axis in LINEAR_AXES]
    return [
        1.0, 1.0, 1.0, 1.0, *(a.v_max for a in axes), *(a.a_max for a in axes),
        machine.spindle_max_deg_s, machine.spindle_acc_deg_s2,
        *[machine.force_max_n] * 3, machine.torque_max_nm, machine.mrr_max_mm3_s,
    ]  # fmt: skip


def _plain_columns(samples: Samples) -> Float2D:
    return np.column_stack([np.ones(len(samples)), samples.direction[:, :3], samples.inputs])


def _some_columns(samples: Samples, which: tuple[int, ...]) -> Float2D:
    return _plain_columns(samples)[:, which]


def _some_ranges(machine: Machine, which: tuple[int, ...]) -> list[float]:
    ranges = _plain_ranges(machine)
    return [ranges[k] for k in which]


HELD = TermSet(
    "held",
    ("1", "held(v_x)", "held(v_y)", "held(v_z)", *INPUTS),
    0,
    1e-4,
    _plain_columns,
    _plain_ranges,
)
"""Held direction and the 13 inputs themselves: friction, viscous friction, inertia and load, each linear."""

_SMALL = (0, 1, 2, 3, *(4 + _AT[n] for n in ("v_x", "v_y", "v_z", "a_x", "a_y", "a_z", "v_sp", "m_sp_sim")))
HELD_SMALL = TermSet(
    "held-small",
    tuple(HELD.names[k] for k in _SMALL),
    0,
    1e-4,
    partial(_some_columns, which=_SMALL),
    partial(_some_ranges, which=_SMALL),
)
"""The least that a feed axis and an idle or loaded spindle need; carries furthest beyond the samples that it saw."""


_STRIBECK = (0.02, 0.2, 1.0)  # mm/s: holding at rest, two speeds at which friction falls


def _friction_columns(samples: Samples) -> Float2D:
    at_rest = [
        samples.direction[:, k] * np.exp(-((samples.inputs[:, k] / v_s) ** 2)) for k in range(3) for v_s in _STRIBECK
    ]
    return np.column_stack([_plain_columns(samples), *at_rest])


def _friction_ranges(machine: Machine) -> list[float]:
    return _plain_ranges(machine) + [1.0] * (3 * len(_STRIBECK))


FRICTION = TermSet(
    "friction",
    (*HELD.names, *(f"held(v_{a}) exp(-(v_{a}/{v_s})²)" for a in LINEAR_AXES for v_s in _STRIBECK)),
    0,
    1e-4,
    _friction_columns,
    _friction_ranges,
)
"""The same with friction that rises towards standstill (Stribeck; Armstrong-Hélouvry et al., Automatica 30, 1994), at
fixed speeds, so that it stays linear. It needs rows at rest and in motion."""


def _ones(samples: Samples) -> Float2D:
    return np.ones((len(samples), 1))


def _one(machine: Machine) -> list[float]:
    return [1.0]


CONSTANT = TermSet("constant", ("1",), 0, 1e-4, _ones, _one)
"""No physics at all: what every equation has to beat."""

ADAPTIVE = (HELD_SMALL, HELD, PAPER_HELD, FRICTION)
"""What an adaptive choice is between, from plain to rich. Accepted physics extends each of them: were one left out,
what is chosen would lack either that set's own physics or what was accepted."""

TERM_SETS = (PAPER, PAPER_HELD, HELD, HELD_SMALL, FRICTION, CONSTANT)


def term_set(name: str) -> TermSet:
    """A term set by its id; FitError lists the known ones."""
    for terms in TERM_SETS:
        if terms.id == name:
            return terms
    raise FitError(f"no term set '{name}'; there are {', '.join(t.id for t in TERM_SETS)}.")
