"""A law without a name whose size each tool has for itself: what a simulation takes for all, or has wrong of one.

In:  recorded quantities, and which tool was in the spindle. Out: `ByTool`, and how much each would take away from a
coarse residual.
A tool table holds a mass, an overhang, a number of teeth or a coefficient that is another tool's; each makes one
quantity count for more or less with that tool and not with others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pido.core.arrays import Array1D, Float2D
from pido.core.axes import LINEAR_AXES
from pido.core.errors import DiagnosisError
from pido.diagnosis.flexible import Coarse
from pido.diagnosis.formulas import FORMS, Unnamed, ampere_per, unit_of, written
from pido.diagnosis.mechanisms.base import Parameter
from pido.diagnosis.signals import Known, signals
from pido.diagnosis.state import AxisState
from pido.diagnosis.terms import Term

_FEWEST_PARTS = 2  # in which a tool is used: what one part says of a tool no other can confirm
_FEWEST, _MOST = 2, 20  # tools


@dataclass(frozen=True)
class ByTool(Unnamed):
    """dI = k * p(u), with a k of its own for each of `tools`; nothing with any other.

    unit : that of u
    """

    tools: tuple[str, ...]
    signal: str
    unit: str
    form: str = "u"

    shape: ClassVar[tuple[Parameter, ...]] = ()

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.signal})

    @property
    def equation(self) -> str:  # type: ignore[override]
        return f"dI = k(tool) * {written(self.signal, self.form)}"

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        per = ampere_per(unit_of([(self.unit, self.form)]))
        return tuple(Parameter(f"k_{tool}", per) for tool in self.tools)

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        named = f"{', '.join(self.tools[:-1])} and {self.tools[-1]}"
        return f"with {written(self.signal, self.form)}, as much as each of the tools {named} has for itself", ()

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        if state.tool_id is None:
            raise DiagnosisError(
                f"part {state.part}: what axis {state.axis} follows without a name differs from tool to tool, and this "
                "part does not say which tool was used. Add the column tool_id, or tool_changes in part.json."
            )
        return self.over(signals(state, self.reads), state.tool_id)

    def over(self, known: Known, used: Array1D) -> Float2D:
        """(n, tools) – what each amplitude counts for, at values of the quantity with the tools `used` (n,)."""
        u = FORMS[self.form](known[self.signal][0])
        return np.column_stack([np.where(used == tool, u, 0.0) for tool in self.tools])


def by_tool(axis: str, known: Known, few: Coarse, states: Sequence[AxisState]) -> list[tuple[float, Term]]:
    """Laws of every load and motion of this axis, each with what it would take away by itself; none where it is not
    known which tools were used, or where fewer than two were used in two parts."""
    used = [s.tool_id for s in states]
    if any(tool is None for tool in used):
        return []
    at = np.concatenate([np.asarray(tool, dtype=object) for tool in used])[few.rows]
    tools = tuple(
        str(tool) for tool in sorted(set(at)) if len(np.unique(few.part[at == tool])) >= _FEWEST_PARTS and tool != ""
    )
    if not _FEWEST <= len(tools) <= _MOST:
        return []
    found = []
    for name, form in _carriers(axis):
        if name in known:
            law = ByTool(tools, name, known[name][1], form)
            found.append((_gain(law.over(known, at), few), Term(law)))
    return found


def _gain(columns: Float2D, few: Coarse) -> float:
    """What columns (m, k) that are never there at once take away together, less what numbers beyond the first cost."""
    size = few.weights @ columns**2
    inner = (few.weights * few.values) @ columns
    taken = float(np.sum(inner**2 / np.where(size > 0, size, np.inf)))
    return taken - (columns.shape[1] - 1) * float(np.log(len(few.rows)))


def _carriers(axis: str) -> Iterator[tuple[str, str]]:
    yield from ((f"v_{axis}", "u"), (f"v_{axis}", "sgn u"), (f"held_{axis}", "u"), (f"a_{axis}", "u"))
    yield from ((f"f_{a}", "u") for a in LINEAR_AXES)
    yield from ((f"I_{axis}", "u"), ("M_sp", "u"), ("MRR", "u"), ("AR", "u"), ("AR", "sgn u"), ("v_sp", "u"))
