"""What the spindle adds to its own current.

In:  `AxisState` of the spindle. Out: mechanisms of the catalogue.
"""

from __future__ import annotations

import numpy as np

from pido.diagnosis.mechanisms.base import Mechanism, Parameter, column, nothing
from pido.diagnosis.mechanisms.process import engages


class _Spindle(Mechanism):
    """Acts on the spindle where it turns at more than one speed."""

    axes = ("sp",)

    def needs(self, states):
        speeds = np.concatenate([s.v[np.isfinite(s.v)] for s in states])
        return None if len(speeds) and np.ptp(speeds) > 6.0 else "the spindle never changes its speed"


class SpindleViscousDrag(_Spindle):
    """Bearing drag in proportion to speed."""

    id = "spindle_viscous_drag"
    equation = "dI = k * v_sp"
    amplitudes = (Parameter("k", "A/(deg/s)", low=0.0),)
    summary = "while the spindle turns, in proportion to its speed"

    def regressors(self, state, **shape):
        return column(state.v)


class SpindleWindage(_Spindle):
    """Air drag with the square of speed."""

    id = "spindle_windage"
    equation = "dI = k * v_sp^2 * sgn(v_sp)"
    amplitudes = (Parameter("k", "A/(deg/s)²", low=0.0),)
    summary = "while the spindle turns, with the square of its speed"

    def regressors(self, state, **shape):
        return column(state.v * np.abs(state.v))


class SpindleInertia(_Spindle):
    """Moment of inertia that is accelerated."""

    id = "spindle_inertia"
    equation = "dI = J * a_sp"
    amplitudes = (Parameter("J", "A/(deg/s²)", low=0.0),)
    summary = "while the spindle runs up or down"

    def regressors(self, state, **shape):
        return column(state.a)


class SpindleTorqueLoad(Mechanism):
    """The cutting torque itself."""

    id = "spindle_torque_load"
    equation = "dI = k * M_sp"
    amplitudes = (Parameter("k", "A/(N·m)"),)
    axes = ("sp",)
    summary = "spindle, while cutting, in proportion to the cutting torque"
    follows_from = ("m_sp",)

    def regressors(self, state, **shape):
        return nothing(state) if state.m_sp is None else column(state.m_sp)

    def needs(self, states):
        if any(s.m_sp is None for s in states):
            return "no simulated cutting torque (m_sp_sim)"
        return engages(states)
