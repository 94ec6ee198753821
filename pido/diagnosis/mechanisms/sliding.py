"""What friction knows of the direction of the motion: at standstill, after a reversal, at a creep.

In:  `AxisState`. Out: the sign that every law of friction is in proportion to, and what such laws have in common.
The sign of the motion has a dead band: below it the axis stands, and only what holds at standstill acts. `rest` says
for a law of any friction whether it is zero there (0), as a simulation with sgn(v) has it, or held, or whether its sign
itself rises with the speed, or is what the simulation has at rest (see `direction`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pido.core.arrays import Float1D
from pido.diagnosis.mechanisms.base import Mechanism, Parameter, choice
from pido.diagnosis.state import AxisState
from pido.physics.friction import dahl_state

_TURNS_MM = (0.0, 0.03, 0.3)  # ways over which friction turns, as far as a law cares: from ball to slideway
# What turns over the longest of them, in motion, is presliding by its own name.
_SMOOTH = len(_TURNS_MM)  # of `rest`: the sign itself rises with the speed
HELD = 1  # of `rest`: with the sign of the last motion, turned at once
SIMULATED = _SMOOTH + 1  # of `rest`: at standstill as the simulation has it
STEEP = tuple(float(form) for form in range(SIMULATED + 1) if form != _SMOOTH)  # forms of `rest` without a speed
RISES_MM_S = (0.1, 0.5, 2.5)  # speeds over which it may do so, that are asked first
REST = choice("rest", SIMULATED + 1, first=_SMOOTH)
_SLOWEST, _FASTEST = 0.02, 5.0  # mm/s
V_0 = Parameter("v_0", "mm/s", low=_SLOWEST, high=_FASTEST, scale="log", values=RISES_MM_S[:1])


def direction(state: AxisState, rest: float = 0.0, v_0: float = RISES_MM_S[0]) -> Float1D:
    """(n,) – sign of the motion, 0 at standstill; or, with `rest`, what friction itself knows of it.

    Friction does not end where the axis stops: it goes on holding (1), and turns over a small way after a reversal (2;
    Dahl 1968). An axis that stands is moved by micrometres all the time, and those do not turn it. Or friction is small
    at a creep and rises over a speed v_0 (3), as where the sign is made smooth (Andersson, Söderberg and Björklund
    2007). Or a simulation has a friction of its own, with what its controller leaves of it at rest (4): there another
    law of the same friction acts on that, and on what is held (1) where no simulated current says what it is.
    """
    form = round(rest)
    if form == _SMOOTH:
        return np.tanh(np.nan_to_num(state.v) / v_0)
    return turned(state, form) if form else state.along


def turned(state: AxisState, form: int) -> Float1D:
    """(n,) – the direction of the last motion, turned at once (1), over a way, or as the simulation has it at rest."""
    if form == SIMULATED:
        return state.held if state.sim_held is None else state.sim_held
    way = _TURNS_MM[form - 1]
    return dahl_state(state.held, state.since_reversal, state.segment, way) if way else state.held


def at_rest(rest: float = 0.0) -> str:
    """What `direction` is at standstill, or how smooth it is, as an equation says it."""
    form = round(rest)
    if form == _SMOOTH:
        return "with tanh(v / v_0) for sgn(v)"
    return f"held at rest, {turning(form)}" if form else "at rest 0"


def turning(form: int) -> str:
    if form == SIMULATED:
        return "as far as the simulation holds there"
    way = _TURNS_MM[form - 1]
    return f"turning over {way:g} mm after reversals" if way else "turning at once"


def moves(states: Sequence[AxisState]) -> str | None:
    """Why friction cannot be seen: the axis never moves."""
    return None if any(np.any(s.moving) for s in states) else "the axis never moves in these parts"


def turns(states: Sequence[AxisState]) -> str | None:
    """Why an effect of reversals cannot be seen."""
    count = sum(float(s.segment[-1]) for s in states if len(s.segment))
    return None if count >= 2 else f"{count:.0f} reversal(s) of the axis; at least 2 are needed"


class Sliding(Mechanism):
    """A law in proportion to the sign of the motion, with what this is at rest."""

    def forms_at_rest(self, shape):
        forms = super().forms_at_rest(shape)
        smooth = ({**forms[_SMOOTH], "v_0": v_0} for v_0 in RISES_MM_S)
        return *forms[:_SMOOTH], *forms[SIMULATED:], *smooth

    def around(self, name, shape, states):
        if name != "v_0":
            return super().around(name, shape, states)
        v_0 = shape.get(name, RISES_MM_S[0])
        return (max(v_0 / 3, _SLOWEST), min(3 * v_0, _FASTEST)) if is_smooth(shape) else (v_0, v_0)

    def free(self, shape):
        return super().free(shape) - (not is_smooth(shape))

    def idle(self, shape):
        return frozenset() if is_smooth(shape) else frozenset({"v_0"})


def is_smooth(shape: Mapping[str, float]) -> bool:
    """Whether a shape takes a sign that rises with the speed."""
    return round(shape.get("rest", 0.0)) == _SMOOTH
