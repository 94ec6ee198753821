"""What cutting adds: force, edges, wear, hard places, coolant.

In:  `AxisState`. Out: mechanisms of the catalogue. All need a simulated process load, and say so where there is none.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pido.core.arrays import Float1D
from pido.core.axes import LINEAR_AXES
from pido.diagnosis.mechanisms.base import Mechanism, Parameter, choice, column, nothing
from pido.diagnosis.mechanisms.friction import direction
from pido.diagnosis.state import AxisState


def load(state: AxisState) -> Float1D | None:
    """(n,) – what the process does to this axis: N along a linear axis, N·m at the spindle."""
    return state.m_sp if state.axis == "sp" else state.force


def engages(states: Sequence[AxisState]) -> str | None:
    """Why an effect of cutting cannot be seen."""
    if any(s.engaged is None for s in states):
        return "no simulated process load (mrr_sim, m_sp_sim or f_*_sim)"
    return None if any(np.any(s.engaged) for s in states) else "the tool never cuts in these parts"


def _loaded(states: Sequence[AxisState]) -> str | None:
    if any(load(s) is None for s in states):
        return "no simulated process load of this axis"
    return engages(states)


class CuttingForce(Mechanism):
    """The process force along the axis itself."""

    id = "cutting_force"
    equation = "dI = k * F"
    amplitudes = (Parameter("k", "A/N"),)
    axes = LINEAR_AXES
    summary = "{axis} axis, while cutting, in proportion to the process force"

    def regressors(self, state, **shape):
        return nothing(state) if state.force is None else column(state.force)

    def needs(self, states):
        return _loaded(states)


class EdgeForce(Mechanism):
    """Ploughing by every engaged millimetre of edge; `along`: 0 constant, 1 sign of the motion, 2 share of the feed."""

    id = "edge_force"
    equation = "dI = K_e * a_p (or K_e where a_p is not known) while engaged, along the feed"
    amplitudes = (Parameter("K_e", "A/mm or A"),)
    shape = (choice("along", 3), choice("per_length", 2))
    summary = "{axis} axis, whenever the tool is engaged, however thin the chip"

    def regressors(self, state, *, along, per_length):
        if state.engaged is None:
            return nothing(state)
        edge = np.ones(len(state.time))
        if round(per_length) == 1:
            if state.edge_length is None:
                return nothing(state)
            edge = np.nan_to_num(state.edge_length)
        if round(along) == 0:
            side = np.ones(len(edge))
        elif round(along) == 1 or state.axis == "sp":
            side = direction(state)
        else:
            speed = np.sqrt(state.v**2 + sum(o.v**2 for n, o in state.others.items() if n in LINEAR_AXES))
            side = np.where(speed > 0, state.v * state.moving / np.maximum(speed, 1e-9), 0.0)
        return column(edge * state.engaged * side)

    def needs(self, states):
        return engages(states)


class ToolWear(Mechanism):
    """Cutting load that grows with use; `by`: 0 volume (cm³), 1 time in cut (min); `of`: 0 load, 1 edge, 2 along v."""

    id = "tool_wear"
    equation = "dI = W * V * F, or W * V while engaged; V = volume or time that the edge has cut"
    amplitudes = (Parameter("W", "A per cm³ or min, per N, N·m or 1"),)
    shape = (choice("by", 2), choice("of", 4))
    summary = "{axis} axis, while cutting, growing with what the tool has cut"

    def regressors(self, state, *, by, of):
        used = state.cut_volume if round(by) == 0 else state.cut_time
        if used is None or state.engaged is None:
            return nothing(state)
        used = used / (1000.0 if round(by) == 0 else 60.0)
        factor = (load(state), state.engaged.astype(float), state.engaged * direction(state), state.m_sp)[
            int(np.clip(round(of), 0, 3))
        ]
        return nothing(state) if factor is None else column(used * factor)

    def needs(self, states):
        return engages(states)


class MaterialHardZone(Mechanism):
    """A place of the workpiece that cuts harder or softer: a disc, searched; x_c, y_c, r in halves of the workpiece."""

    id = "material_hard_zone"
    equation = "dI = H * F inside a disc of the workpiece"
    amplitudes = (Parameter("H", "A per N or N·m"),)
    shape = (
        Parameter("x_c", "half widths", low=-1.0, high=1.0, values=(-0.8, -0.4, 0.0, 0.4, 0.8)),
        Parameter("y_c", "half widths", low=-1.0, high=1.0, values=(-0.8, -0.4, 0.0, 0.4, 0.8)),
        Parameter("r", "half widths", low=0.1, high=1.0, scale="log", values=(0.25, 0.5)),
    )
    summary = "{axis} axis, while cutting around ({x_c:.2f}, {y_c:.2f}) half widths from the workpiece's centre"

    def regressors(self, state, *, x_c, y_c, r):
        force = load(state)
        if force is None or state.wx is None or state.wy is None or state.workpiece_size is None:
            return nothing(state)
        half = np.asarray(state.workpiece_size) / 2
        way = np.hypot(state.wx - x_c * half[0], state.wy - y_c * half[1]) / half.min()
        return column((way < r) * force)

    def needs(self, states):
        if any(s.wx is None or s.wy is None or s.workpiece_size is None for s in states):
            return "the place of the workpiece is not known (workpiece in part.json)"
        return _loaded(states)


class CoolantLoad(Mechanism):
    """A load while coolant is on; `along`: 0 constant, 1 against the motion."""

    id = "coolant_load"
    equation = "dI = C * coolant"
    amplitudes = (Parameter("C", "A"),)
    shape = (choice("along", 2),)
    summary = "{axis} axis, while coolant is on"

    def regressors(self, state, *, along):
        if state.coolant is None:
            return nothing(state)
        return column(np.nan_to_num(state.coolant) * (direction(state) if round(along) == 1 else 1.0))

    def needs(self, states):
        if any(s.coolant is None for s in states):
            return "it is not known when coolant is on"
        values = np.concatenate([s.coolant for s in states if s.coolant is not None])
        return None if np.nanmin(values) < np.nanmax(values) else "coolant never changes"

    def conditions(self, axis, shape):
        return self.summary.format(axis=axis), ("coolant = 1",)
