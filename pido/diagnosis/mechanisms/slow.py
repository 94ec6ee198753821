"""Slow and electrical: heat and saturation.

In:  `AxisState`. Out: mechanisms of the catalogue; warming is in `pido.physics.thermal`.
"""

from __future__ import annotations

import numpy as np

from pido.diagnosis.mechanisms.base import Mechanism, Parameter, choice, column, nothing
from pido.diagnosis.mechanisms.friction import direction
from pido.physics.drive import beyond
from pido.physics.thermal import coldness, coldness_after


class ThermalDrift(Mechanism):
    """A load that goes to a steady value, first order.

    clock : 0 every part starts cold, 1 cold at the first part only, 2 cooling in the pauses between parts
    along : 0 a constant load, 1 against the motion; rises : 0 fades from cold, 1 grows towards the steady value
    """

    id = "thermal_drift"
    equation = "dI = T * exp(-t / tau) or T * (1 - exp(-t / tau)), constant or along sgn(v)"
    amplitudes = (Parameter("T", "A"),)
    shape = (
        Parameter("tau", "s", low=10.0, high=20000.0, scale="log", points=8),
        choice("clock", 3),
        choice("along", 2),
        choice("rises", 2),
    )
    summary = "{axis} axis, changing over the time since start with a time constant of {tau:.3g} s"

    def regressors(self, state, *, tau, clock, along, rises):
        if round(clock) == 0:
            cold = coldness(state.time, tau)
        elif state.clock is None or state.earlier is None:
            return nothing(state)
        elif round(clock) == 1:
            first = state.earlier[0][0] if state.earlier else float(state.clock[0])
            cold = coldness(state.clock - first, tau)
        else:
            cold = coldness(state.time, tau, coldness_after(state.earlier, float(state.clock[0]), tau))
        level = 1.0 - cold if round(rises) == 1 else cold
        return column(level * (direction(state) if round(along) == 1 else 1.0))

    def needs(self, states):
        longest = max(float(s.time[-1] - s.time[0]) for s in states)
        return None if longest >= 20.0 else f"the longest part lasts {longest:.0f} s; at least 20 s are needed"


class CurrentSaturation(Mechanism):
    """More current than torque once iron saturates; `form`: 0 beyond a knee, 1 with the square, 2 with the cube."""

    id = "current_saturation"
    equation = "dI = s * (|I_sim| - I_k)+ * sgn(I_sim), or s * I_sim * (|I_sim| / I_k)^1, ^2"
    amplitudes = (Parameter("s", "–", low=-0.6),)
    shape = (Parameter("I_k", "A", low=0.3, high=40.0, scale="log", points=9), choice("form", 3))
    summary = "{axis} axis, at high torque, beyond {I_k:.3g} A"

    def regressors(self, state, *, I_k, form):
        if state.sim is None:
            return nothing(state)
        k = int(np.clip(round(form), 0, 2))
        return column(beyond(state.sim, I_k) if k == 0 else state.sim * (np.abs(state.sim) / I_k) ** k)

    def needs(self, states):
        return "no simulated current of this axis" if any(s.sim is None for s in states) else None
