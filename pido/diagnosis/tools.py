"""A law without a name whose size each tool has for itself: what a simulation takes for all, or has wrong of one.

In:  recorded quantities, and which tool was in the spindle. Out: `ByTool`, and how much each would take away from a
coarse residual.
A tool table holds a mass, an overhang, a number of teeth or a coefficient that is another tool's; each makes one
quantity, or a product of some, count for more or less with that tool and not with others.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from pido.core.arrays import Array1D, Float2D
from pido.core.axes import LINEAR_AXES
from pido.core.errors import DiagnosisError
from pido.diagnosis.flexible import Coarse
from pido.diagnosis.formulas import Formula, Unnamed, ampere_per, unit_of, written
from pido.diagnosis.mechanisms.base import Parameter
from pido.diagnosis.signals import Known, signals
from pido.diagnosis.state import AxisState
from pido.diagnosis.terms import Term

_FEWEST_PARTS = 2  # in which a tool is used: what one part says of a tool no other can confirm
_FEWEST, _MOST = 2, 20  # tools


@dataclass(frozen=True)
class ByTool(Unnamed):
    """dI = k * `law`, with a k of its own for each of `tools`; nothing with any other."""

    tools: tuple[str, ...]
    law: Formula

    shape: ClassVar[tuple[Parameter, ...]] = ()

    @property
    def reads(self) -> frozenset[str]:
        return self.law.reads

    @property
    def equation(self) -> str:  # type: ignore[override]
        return self.law.equation.replace("dI = k", "dI = k(tool)", 1)

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return tuple(Parameter(f"k_{tool}", ampere_per(self.law.unit)) for tool in self.tools)

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        product = " times ".join(written(*factor) for factor in self.law.factors)
        if len(self.tools) == 1:
            return f"with {product}, while tool {self.tools[0]} is in the spindle", ()
        named = f"{', '.join(self.tools[:-1])} and {self.tools[-1]}"
        return f"with {product}, as much as each of the tools {named} has for itself", ()

    def of_fewer(self) -> Iterator[ByTool]:
        """The same law without one of its tools, each in turn."""
        for i in range(len(self.tools) if len(self.tools) > 1 else 0):
            yield replace(self, tools=self.tools[:i] + self.tools[i + 1 :])

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        if state.tool_id is None:
            raise DiagnosisError(
                f"part {state.part}: what axis {state.axis} follows without a name differs from tool to tool, and this "
                "part does not say which tool was used. Add the column tool_id, or tool_changes in part.json."
            )
        return self.over(signals(state, self.reads), state.tool_id)

    def over(self, known: Known, used: Array1D) -> Float2D:
        """(n, tools) – what each amplitude counts for, at values of the quantity with the tools `used` (n,)."""
        u = self.law.values(known)
        return np.column_stack([np.where(used == tool, u, 0.0) for tool in self.tools])


def by_tool(axis: str, known: Known, few: Coarse, states: Sequence[AxisState]) -> list[tuple[float, Term]]:
    """Laws of every load and motion of this axis, each with what it would take away by itself; none where it is not
    known which tools were used, or where fewer than two were used in two parts."""
    tools = tools_of(states)
    if not tools:
        return []
    at = np.concatenate([np.asarray(s.tool_id, dtype=object) for s in states])[few.rows]
    found = []
    for name, form in _carriers(axis):
        if name in known:
            law = ByTool(tools, Formula(((name, form),), unit_of([(known[name][1], form)])))
            found.append((_gain(law.over(known, at), few), Term(law)))
    return found


def tools_of(states: Sequence[AxisState]) -> tuple[str, ...]:
    """The tools that two parts have used; none where these are fewer than two, or a part does not say its tools."""
    used = [s.tool_id for s in states if s.tool_id is not None]
    if len(used) < len(states):
        return ()
    parts = Counter(str(tool) for each in used for tool in set(each) if tool != "")
    tools = tuple(sorted(tool for tool, count in parts.items() if count >= _FEWEST_PARTS))
    return tools if _FEWEST <= len(tools) <= _MOST else ()


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
