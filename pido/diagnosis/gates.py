"""Limits between which a term acts: of speeds of the tool, of the area that it removes and of how fast it removes.

In:  the state of one axis in one part. Out: which rows lie within the limits; of rows that a search averaged, the share
of each that does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from pido.core.arrays import Float1D, Float2D
from pido.diagnosis.state import AxisState, speed_along_path

PATH_SPEED = "path speed"
VARIABLES = ("v_x", "v_y", "AR")
IN_PLACE = ("|v_x|", "|v_y|", PATH_SPEED, "MRR")  # what comes in the place of others; none of it is below zero


@dataclass(frozen=True, slots=True)
class Gate:
    """Acts only where low <= variable < high.

    variable : 'v_x', 'v_y', '|v_x|', '|v_y|', PATH_SPEED – of the tool, in mm/s –, 'AR' in mm² or 'MRR' in mm³/s
    """

    variable: str
    low: float = -np.inf
    high: float = np.inf

    @property
    def condition(self) -> str:
        """In the form of the contract, e.g. 'v_x > 4'.

        >>> Gate("MRR", low=2640.4).condition, Gate("v_x", high=-0.125).condition
        ('MRR > 2640', 'v_x < -0.125')
        """
        return " and ".join(self._sides())

    @property
    def words(self) -> str:
        """With its unit, e.g. 'v_x > 4 mm/s'."""
        unit = {"AR": "mm²", "MRR": "mm³/s"}.get(self.variable, "mm/s")
        return " and ".join(f"{side} {unit}" for side in self._sides())

    def _sides(self) -> list[str]:
        sides = []
        if np.isfinite(self.low):
            sides.append(f"{self.variable} > {_written(self.low)}")
        if np.isfinite(self.high):
            sides.append(f"{self.variable} < {_written(self.high)}")
        return sides


def _written(limit: float) -> str:
    return f"{limit:.0f}" if abs(limit) >= 1000 else f"{limit:.3g}"


def gate_variable(state: AxisState, variable: str) -> Float1D | None:
    """(n,) of what a `Gate` may limit, None where the recording does not have it."""
    if variable == "AR":
        return state.ar
    if variable == "MRR":
        return state.mrr
    if variable == PATH_SPEED:
        return speed_along_path(state.speeds) if len(state.speeds) > 1 else None
    if variable.startswith("|"):
        speed = gate_variable(state, variable.strip("|"))
        return None if speed is None else np.abs(speed)
    axis = variable.removeprefix("v_")
    if axis == state.axis:
        return state.v
    other = state.others.get(axis)
    return None if other is None else other.v


def inside(state: AxisState, gates: Sequence[Gate]) -> Float1D:
    """(n,), 0 to 1 – how much of each row is inside all gates; where a variable is not known, nothing is inside.

    Within a row that was averaged, a variable goes evenly from its least to its most.
    """
    result = np.ones(len(state.time))
    for gate in gates:
        values = gate_variable(state, gate.variable)
        if values is None:
            return np.zeros(len(state.time))
        within: Float1D = ((values >= gate.low) & (values < gate.high)).astype(float)
        if gate.variable in state.ranges:
            least, most = state.ranges[gate.variable].T
            passed = np.minimum(most, gate.high) - np.maximum(least, gate.low)
            within = np.divide(np.maximum(passed, 0.0), most - least, out=within, where=most > least)
        result *= within
    return result


def between(values: Float1D, ranges: Float2D | None, limits: Float1D) -> csr_array:
    """(classes, n), sparse – how much of each row lies between each limit and the next, as `inside` says of one gate.

    values : (n,); ranges : (n, 2) – least and most within rows that were averaged; limits : rising
    """
    least, most = (values, values) if ranges is None else ranges.T
    wide = most > least
    first, last = (np.searchsorted(limits, np.where(wide, end, values), side="right") for end in (least, most))
    count = last - first + 1
    row = np.repeat(np.arange(len(values)), count)
    which = np.arange(len(row)) - np.repeat(np.cumsum(count) - count - first, count)
    edges = np.r_[-np.inf, limits, np.inf]
    passed = np.minimum(most[row], edges[which + 1]) - np.maximum(least[row], edges[which])
    share = np.divide(passed, (most - least)[row], out=np.ones(len(row)), where=wide[row])
    return csr_array((share, (which, row)), shape=(len(limits) + 1, len(values)))
