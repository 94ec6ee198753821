"""Friction of an axis: what it resists with, in motion, at standstill and after a reversal.

In:  `AxisState`. Out: mechanisms of the catalogue; the laws are in `pido.physics.friction`.
The sign of the motion has a dead band: below it the axis stands, and only what holds at standstill acts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pido.core.arrays import Float1D
from pido.core.axes import LINEAR_AXES
from pido.diagnosis.mechanisms.base import Mechanism, Parameter, choice, column, nothing
from pido.diagnosis.state import AxisState
from pido.physics.friction import dahl_state, stribeck_curve


def direction(state: AxisState) -> Float1D:
    """(n,) – sign of the motion, 0 at standstill."""
    return state.held * state.moving


def moves(states: Sequence[AxisState]) -> str | None:
    """Why friction cannot be seen: the axis never moves."""
    return None if any(np.any(s.moving) for s in states) else "the axis never moves in these parts"


def turns(states: Sequence[AxisState]) -> str | None:
    """Why an effect of reversals cannot be seen."""
    count = sum(float(s.segment[-1]) for s in states if len(s.segment))
    return None if count >= 2 else f"{count:.0f} reversal(s) of the axis; at least 2 are needed"


class CoulombFriction(Mechanism):
    """Friction of constant size against the motion (Coulomb 1785)."""

    id = "coulomb_friction"
    equation = "dI = F_c * sgn(v)"
    amplitudes = (Parameter("F_c", "A", low=0.0),)
    summary = "whenever the {axis} axis moves, against its direction"

    def regressors(self, state, **shape):
        return column(direction(state))

    def needs(self, states):
        return moves(states)


class ViscousFriction(Mechanism):
    """Friction that grows in proportion to speed."""

    id = "viscous_friction"
    equation = "dI = F_v * v"
    amplitudes = (Parameter("F_v", "A/(mm/s)", low=0.0),)
    axes = LINEAR_AXES
    summary = "in motion of the {axis} axis, more at higher feed"

    def regressors(self, state, **shape):
        return column(state.v * state.moving)

    def needs(self, states):
        return moves(states)


class StribeckFriction(Mechanism):
    """Friction that rises as the axis slows down (Stribeck 1902; Armstrong-Hélouvry 1994)."""

    id = "stribeck_friction"
    equation = "dI = (F_s - F_c) * exp(-(|v| / v_s)^delta) * sgn(v)"
    amplitudes = (Parameter("F_s - F_c", "A", low=0.0),)
    shape = (
        Parameter("v_s", "mm/s", low=0.05, high=40.0, scale="log", points=9),
        Parameter("delta", "–", low=0.5, high=2.0, values=(1.0, 2.0)),
    )
    axes = LINEAR_AXES

    def regressors(self, state, *, v_s, delta):
        return column(stribeck_curve(state.v, v_s, delta) * direction(state))

    def needs(self, states):
        return moves(states)

    def conditions(self, axis, shape):
        limit = 1.5 * shape["v_s"]
        return f"while the {axis} axis moves slowly, below {limit:.3g} mm/s", (f"|v_{axis}| < {limit:.3g}",)


class StandstillFriction(Mechanism):
    """Friction that holds at standstill with the sign of the last motion."""

    id = "standstill_friction"
    equation = "dI = F_h * sgn(v before the stop) at standstill"
    amplitudes = (Parameter("F_h", "A", low=0.0),)
    axes = LINEAR_AXES
    summary = "{axis} axis, at standstill, with the sign of its last motion"

    def regressors(self, state, **shape):
        return column(state.held * ~state.moving)

    def needs(self, states):
        still = any(np.any((s.held != 0) & ~s.moving) for s in states)
        return None if still else "the axis never stands still after a motion"

    def conditions(self, axis, shape):
        return self.summary.format(axis=axis), (f"v_{axis} = 0",)


class FrictionAsymmetry(Mechanism):
    """Different Coulomb and viscous friction in the two directions; `side`: 0 both halves, 1 only +, 2 only -."""

    id = "friction_asymmetry"
    equation = "dI = (dF_c + dF_v * |v|) on one side or in opposite halves"
    amplitudes = (Parameter("dF_c", "A"), Parameter("dF_v", "A/(mm/s)"))
    shape = (choice("side", 3),)
    axes = LINEAR_AXES
    summary = "{axis} axis, friction differs between + and - direction"

    def regressors(self, state, *, side):
        h = direction(state)
        weight = (np.abs(h) / 2, np.maximum(h, 0.0), np.minimum(h, 0.0))[int(np.clip(round(side), 0, 2))]
        return np.column_stack([weight, weight * np.abs(state.v)])

    def needs(self, states):
        both = any(np.any(direction(s) > 0) for s in states) and any(np.any(direction(s) < 0) for s in states)
        return None if both else "the axis moves in one direction only"


class LoadDependentFriction(Mechanism):
    """Coulomb friction that grows with the process load across the guideway."""

    id = "load_dependent_friction"
    equation = "dI = mu * |F_perp| * sgn(v)"
    amplitudes = (Parameter("mu", "A/N", low=0.0),)
    axes = LINEAR_AXES
    summary = "{axis} axis in motion under process load"

    def regressors(self, state, **shape):
        return nothing(state) if state.force_perp is None else column(state.force_perp * direction(state))

    def needs(self, states):
        if any(s.force_perp is None for s in states):
            return "no process forces across the axis (f_x_sim, f_y_sim, f_z_sim)"
        return None if any(np.any(s.force_perp) for s in states) else "no process load in these parts"


class PositionDependentFriction(Mechanism):
    """Friction that varies along the travel: one wave of any phase; a wave longer than the travel is a slope."""

    id = "position_dependent_friction"
    equation = "dI = (G_s * sin(2 pi pos / L) + G_c * cos(2 pi pos / L)) * sgn(v)"
    amplitudes = (Parameter("G_s", "A"), Parameter("G_c", "A"))
    shape = (Parameter("L", "mm", low=25.0, high=2000.0, scale="log", points=14),)
    axes = LINEAR_AXES
    summary = "{axis} axis in motion, friction varies along the travel with {L:.3g} mm"

    def regressors(self, state, *, L):
        if state.pos is None:
            return nothing(state, 2)
        angle, h = 2 * np.pi * state.pos / L, direction(state)
        return np.column_stack([np.sin(angle) * h, np.cos(angle) * h])

    def needs(self, states):
        return "no position of the axis" if any(s.pos is None for s in states) else moves(states)


class PreslidingHysteresis(Mechanism):
    """Friction that turns over a small way after a reversal (Dahl 1968).

    `full`: 0 what a held sign lacks of it; 1 all of it; 2 what sgn(v) lacks of it, which is zero at standstill.
    """

    id = "presliding_hysteresis"
    equation = "dI = F_p * (z - z_sim); dz/ds = (h - z) / x_0, h = direction of the last motion, z_sim = h, 0 or sgn(v)"
    amplitudes = (Parameter("F_p", "A", low=0.0),)
    shape = (Parameter("x_0", "mm", low=0.003, high=3.0, scale="log", points=7), choice("full", 3))
    axes = LINEAR_AXES

    def regressors(self, state, *, x_0, full):
        z = dahl_state(state.held, state.since_reversal, state.segment, x_0)
        simulated = (state.held, np.zeros(len(z)), direction(state))[round(full)]
        return column(z - simulated)

    def needs(self, states):
        return turns(states)

    def conditions(self, axis, shape):
        way = 3 * shape["x_0"]
        return f"within {way:.3g} mm after a reversal of the {axis} axis", (f"travel since reversal < {way:.3g}",)
