"""What cutting adds: force, edges, wear, coolant; hard places are in `hard_zone`.

In:  `AxisState`. Out: mechanisms of the catalogue. All need a simulated process load, and say so where there is none.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pido.core.arrays import Float1D
from pido.core.axes import LINEAR_AXES
from pido.diagnosis.mechanisms.base import Mechanism, Parameter, choice, column, nothing, which
from pido.diagnosis.mechanisms.sliding import at_rest, direction
from pido.diagnosis.state import AxisState, speed_along_path


def load(state: AxisState) -> Float1D | None:
    """(n,) – what the process does to this axis: N along a linear axis, N·m at the spindle."""
    return state.m_sp if state.axis == "sp" else state.force


def load_in(axis: str) -> str:
    """`load` as an equation names it."""
    return "M_sp" if axis == "sp" else "f_i"


def engages(states: Sequence[AxisState]) -> str | None:
    """Why an effect of cutting cannot be seen."""
    if any(s.engaged is None for s in states):
        return "no simulated process load (mrr_sim, m_sp_sim or f_*_sim)"
    return None if any(np.any(s.engaged) for s in states) else "the tool never cuts in these parts"


def loaded(states: Sequence[AxisState]) -> str | None:
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
    follows_from = ("force", "m_sp", "mrr")

    def regressors(self, state, **shape):
        return nothing(state) if state.force is None else column(state.force)

    def needs(self, states):
        return loaded(states)


class EdgeForce(Mechanism):
    """Ploughing by every engaged millimetre of edge.

    along : 0 constant, 1 sign of the motion, 2 share of the feed, 3 direction of the process force; at the spindle 0
        constant, 1 sign of its motion, 2 that at the lever of the tool's radius
    length : 0 as often as the tool is engaged, 1 axial depth of cut, 2 that times the mean number of teeth in cut,
        3 the same with the tool's radius for the depth of a plunge, which cuts with the end of the tool, 4 that of the
        whole operation, by the share of its area that is removed
    """

    id = "edge_force"
    equation = (
        "dI = K_e * b while engaged, along the feed or the process force, at the spindle times the tool's radius; "
        "b = 1, a_p, or a_p * teeth in cut, in a plunge with that radius for a_p, as far as the tool is in the material"
    )
    amplitudes = (Parameter("K_e", "A, per mm or mm²"),)
    shape = (choice("along", 4), choice("length", 5))
    summary = "{axis} axis, whenever the tool is engaged, however thin the chip"
    follows_from = ("engaged", "force", "edge_length", "edge_in_cut", "tool_radius", "ar")

    def regressors(self, state, *, along, length):
        edge, side = _edge(state, round(length)), _side(state, round(along))
        if state.engaged is None or edge is None or side is None:
            return nothing(state)
        return column(edge * state.engaged * side)

    def equation_in(self, axis, shape):
        along, length = round(shape["along"]), round(shape["length"])
        share = ("", "sgn(v)", "tool radius * sgn(v)" if axis == "sp" else "v / feed", "f_i / |F|")[along]
        edge = ("", "a_p", "a_p * teeth in cut", "a_p * teeth in cut", "AR / a_e * teeth in cut")[length]
        product = " * ".join(part for part in ("K_e", edge, share) if part)
        more = ("", f", {at_rest()}", f", {at_rest()}", "; F = whole process force")[along]
        plunge = ("; in plunges the tool radius stands for a_p", "; in plunges AR / (pi * tool radius) * teeth")
        return f"dI = {product} while engaged{more}{plunge[length - 3] if length >= 3 else ''}"

    def starts(self, states):
        ends = any(
            s.end_length is not None
            and s.edge_length is not None
            and not np.array_equal(s.end_length, s.edge_length, equal_nan=True)
            for s in states
        )
        by_area = all(s.edge_in_cut is not None for s in states)
        known = {0.0, 1.0, 2.0, *((3.0,) if ends else ()), *((4.0,) if by_area else ())}
        return tuple(shape for shape in super().starts(states) if shape["length"] in known)

    def needs(self, states):
        return engages(states)


def _edge(state: AxisState, length: int) -> Float1D | None:
    """(n,), mm or 1 – edge in the material."""
    if length == 0:
        return np.ones(len(state.time))
    if length == 4:
        return state.edge_in_cut
    length_in_cut = state.edge_length if length < 3 or state.end_length is None else state.end_length
    if length_in_cut is None or (length > 1 and state.teeth_in_cut is None):
        return None
    edge = np.nan_to_num(length_in_cut)
    return edge if length == 1 or state.teeth_in_cut is None else edge * np.nan_to_num(state.teeth_in_cut)


def _side(state: AxisState, along: int) -> Float1D | None:
    """(n,) in -1..1 – share of a force of the cut that acts along this axis; or its lever at the spindle, mm."""
    if along == 0:
        return np.ones(len(state.time))
    if along == 1:
        return direction(state)
    if state.axis == "sp":
        lever = state.tool_radius if along == 2 else None
        return None if lever is None else np.nan_to_num(lever) * direction(state)
    if along == 2:
        speed = speed_along_path(state.speeds)
        return np.where(speed > 0, state.v * state.moving / np.maximum(speed, 1e-9), 0.0)
    if state.force is None:
        return None
    size = np.sqrt(np.sum([f**2 for f in state.forces.values()], axis=0))
    return np.where(size > 0, state.force / np.maximum(size, 1e-300), 0.0)


class ToolWear(Mechanism):
    """Cutting load that grows with use; `by`: 0 volume (cm³), 1 time in cut (min); `of`: 0 load, 1 edge, 2 along v.

    `grows`: 0 evenly, 1 with a power of the use: below 1 it runs in, above 1 it wears ever faster.
    """

    id = "tool_wear"
    equation = "dI = W * V^power * F, or W * V^power while engaged; V = volume or time that the edge has cut"
    amplitudes = (Parameter("W", "A per cm³ or min, per N, N·m or 1"),)
    shape = (
        choice("by", 2),
        choice("of", 4),
        choice("grows", 2, first=1),
        Parameter("power", "–", low=0.5, high=2.5, scale="log", values=(1.0,)),
    )
    summary = "{axis} axis, while cutting, growing with what the tool has cut"
    follows_from = ("cut_volume", "cut_time", "force", "m_sp")

    def regressors(self, state, *, by, of, grows=0.0, power=1.0):
        used = state.cut_volume if round(by) == 0 else state.cut_time
        if used is None or state.engaged is None:
            return nothing(state)
        used = used / (1000.0 if round(by) == 0 else 60.0)
        factor = (load(state), state.engaged.astype(float), state.engaged * direction(state), state.m_sp)[which(of, 4)]
        worn = used if round(grows) == 0 else np.maximum(used, 0.0) ** power
        return nothing(state) if factor is None else column(worn * factor)

    def starts(self, states):
        """What wears evenly, and on the load and on the edge also what does not."""
        every = super().starts(states)
        powers = [{**s, "grows": 1.0, "power": power} for s in every if s["of"] < 2 for power in (0.7, 1.5)]
        return *every, *powers

    def around(self, name, shape, states):
        if name != "power":
            return super().around(name, shape, states)
        power = shape.get(name, 1.0)
        return (power, power) if not _by_power(shape) else ((0.5, 0.95) if power < 1.0 else (1.05, 2.5))

    def free(self, shape):
        return int(_by_power(shape))

    def idle(self, shape):
        return frozenset() if _by_power(shape) else frozenset({"power"})

    def equation_in(self, axis, shape):
        used = ("volume that the edge has cut, cm³", "time that the edge has cut, min")[round(shape["by"])]
        wear = "V^power" if _by_power(shape) else "V"
        of = (
            f"{wear} * {load_in(axis)}",
            f"{wear} while engaged",
            f"{wear} * sgn(v) while engaged, {at_rest()}",
            f"{wear} * M_sp",
        )[which(shape["of"], 4)]
        return f"dI = W * {of}; V = {used}"

    def needs(self, states):
        return engages(states)


def _by_power(shape):
    return round(shape.get("grows", 0.0)) == 1


class CoolantLoad(Mechanism):
    """A load while coolant is on; `along`: 0 constant, 1 against the motion."""

    id = "coolant_load"
    equation = "dI = C * coolant"
    amplitudes = (Parameter("C", "A"),)
    shape = (choice("along", 2),)
    summary = "{axis} axis, while coolant is on"
    follows_from = ("coolant",)

    def regressors(self, state, *, along):
        if state.coolant is None:
            return nothing(state)
        return column(np.nan_to_num(state.coolant) * (direction(state) if round(along) == 1 else 1.0))

    def equation_in(self, axis, shape):
        return f"{self.equation} * sgn(v), {at_rest()}" if round(shape["along"]) == 1 else self.equation

    def needs(self, states):
        if any(s.coolant is None for s in states):
            return "it is not known when coolant is on"
        values = np.concatenate([s.coolant for s in states if s.coolant is not None])
        return None if np.nanmin(values) < np.nanmax(values) else "coolant never changes"

    def conditions(self, axis, shape):
        return self.summary.format(axis=axis), ("coolant = 1",)
