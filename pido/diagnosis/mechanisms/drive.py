"""What the drive train of an axis adds: inertia, weight, lost motion, ripple, other axes.

In:  `AxisState`. Out: mechanisms of the catalogue; the laws are in `pido.physics.drive`.
"""

from __future__ import annotations

import numpy as np

from pido.core.axes import LINEAR_AXES
from pido.diagnosis.mechanisms.base import Mechanism, Parameter, choice, column, nothing
from pido.diagnosis.mechanisms.friction import turns
from pido.physics.drive import lost_motion, wave

_KINDS = ("a", "v", "sgn(v)")
# Leads of ball screws, their fractions, and pitches of linear motors and gears that are usual.
_PERIODS = (
    1.0,
    1.25,
    1.5,
    2.0,
    2.5,
    3.0,
    3.175,
    4.0,
    5.0,
    6.0,
    6.35,
    7.5,
    8.0,
    10.0,
    12.0,
    12.7,
    15.0,
    16.0,
    18.0,
    20.0,
)


class Inertia(Mechanism):
    """Mass that is accelerated (Newton 1687)."""

    id = "inertia"
    equation = "dI = m * a"
    amplitudes = (Parameter("m", "A/(mm/s²)", low=0.0),)
    axes = LINEAR_AXES
    summary = "while the {axis} axis speeds up or slows down"

    def regressors(self, state, **shape):
        return column(state.a)

    def needs(self, states):
        return None if any(np.any(s.moving) for s in states) else "the axis never moves in these parts"


class GravityLoad(Mechanism):
    """Weight on a vertical axis; `by_tool`: 0 constant, 1 in proportion to the tool's mass."""

    id = "gravity_load"
    equation = "dI = G (constant) or g * m_tool"
    amplitudes = (Parameter("G", "A or A/kg"),)
    shape = (choice("by_tool", 2),)
    axes = LINEAR_AXES
    summary = "{axis} axis, at all times, also at standstill"

    def regressors(self, state, *, by_tool):
        if round(by_tool) == 0:
            return column(np.ones(len(state.time)))
        return nothing(state) if state.tool_mass is None else column(state.tool_mass)

    def needs(self, states):
        if any(s.vertical is None for s in states):
            return "it is not known which axis is vertical (vertical_axis in part.json)"
        return None if all(s.vertical for s in states) else "the axis is not vertical"


class Backlash(Mechanism):
    """A transient after each reversal; `per`: 0 over way (mm), 1 over time (s); `edge`: 1 fading, 8 a rectangle."""

    id = "backlash"
    equation = "dI = B * exp(-(s / gap)^edge) * sgn(v), s = way or time since the reversal"
    amplitudes = (Parameter("B", "A"),)
    shape = (
        Parameter("gap", "mm or s", low=0.005, high=2.0, scale="log", points=7),
        Parameter("edge", "–", low=1.0, high=8.0, scale="log", values=(1.0, 8.0)),
        choice("per", 2),
    )
    axes = LINEAR_AXES

    def regressors(self, state, *, gap, edge, per):
        s = state.since_reversal if round(per) == 0 else state.since_reversal_s
        return column(lost_motion(s, gap, edge) * state.held)

    def needs(self, states):
        return turns(states)

    def conditions(self, axis, shape):
        reach = shape["gap"] * (3.0 if shape["edge"] < 2 else 1.0)
        unit, what = ("mm", "travel") if round(shape["per"]) == 0 else ("s", "time")
        return f"within {reach:.3g} {unit} after a reversal of the {axis} axis", (
            f"{what} since reversal < {reach:.3g}",
        )


class AxisCoupling(Mechanism):
    """Another axis' motion felt by this one; `source`: 0-8 = a, v, sgn(v) of x, then y, then z."""

    id = "axis_coupling"
    equation = "dI = k * (a_j, v_j or sgn(v_j)), j another axis"
    amplitudes = (Parameter("k", "A per mm/s², mm/s or 1"),)
    shape = (choice("source", 9),)

    def regressors(self, state, *, source):
        j, kind = divmod(int(np.clip(round(source), 0, 8)), 3)
        other = state.others.get(LINEAR_AXES[j])
        if other is None or LINEAR_AXES[j] == state.axis:
            return nothing(state)
        return column((other.a, other.v * other.moving, other.held * other.moving)[kind])

    def needs(self, states):
        moved = any(np.any(o.moving) for s in states for n, o in s.others.items() if n in LINEAR_AXES)
        return None if moved else "no other axis moves"

    def conditions(self, axis, shape):
        j, kind = divmod(int(np.clip(round(shape["source"]), 0, 8)), 3)
        name = LINEAR_AXES[j]
        return f"{axis} axis, while the {name} axis moves ({_KINDS[kind]} of {name})", (f"v_{name} != 0",)


class TorqueRipple(Mechanism):
    """A current periodic in the axis position: cogging, ball screw (any phase)."""

    id = "torque_ripple"
    equation = "dI = R_s * sin(2 pi pos / L) + R_c * cos(2 pi pos / L)"
    amplitudes = (Parameter("R_s", "A"), Parameter("R_c", "A"))
    shape = (Parameter("L", "mm", low=0.5, high=50.0, scale="log", values=(*_PERIODS, 25.0, 30.0, 32.0, 40.0, 50.0)),)
    axes = LINEAR_AXES
    summary = "{axis} axis, repeating every {L:.4g} mm of travel"

    def regressors(self, state, *, L):
        return nothing(state, 2) if state.pos is None else wave(state.pos, L)

    def needs(self, states):
        if any(s.pos is None for s in states):
            return "no position of the axis"
        travel = max(float(np.nanmax(s.pos) - np.nanmin(s.pos)) for s in states if s.pos is not None)
        return None if travel > 2.0 else f"the axis travels {travel:.2g} mm only"
