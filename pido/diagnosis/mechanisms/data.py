"""Not physics: the recording is shifted, scaled, offset or limited.

In:  `AxisState` with the simulated current. Out: mechanisms of kind 'data_fault'; none reads the recorded current.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pido.diagnosis.mechanisms.base import Mechanism, Parameter, choice, column, nothing, which
from pido.diagnosis.state import AxisState
from pido.physics.drive import beyond


class _OfSimulation(Mechanism):
    """Needs the simulated current."""

    kind = "data_fault"

    def needs(self, states: Sequence[AxisState]) -> str | None:
        return "no simulated current of this axis" if any(s.sim is None for s in states) else None


class TimeMisalignment(_OfSimulation):
    """The recording lags the simulation by shift + drift * t; the difference over `step` is exact where they agree."""

    id = "time_misalignment"
    equation = "dI = -(shift + drift * t) * (I_sim(t) - I_sim(t - step)) / step"
    amplitudes = (Parameter("shift", "s", low=-2.0, high=2.0), Parameter("drift", "–", low=-0.05, high=0.05))
    shape = (
        Parameter(
            "step", "s", low=-2.0, high=2.0,
            values=(-1.0, -0.5, -0.25, -0.12, -0.06, -0.03, -0.01, 0.01, 0.03, 0.06, 0.12, 0.25, 0.5, 1.0),
        ),
    )  # fmt: skip
    summary = "{axis} axis, wherever the current changes quickly"

    def regressors(self, state, *, step):
        if state.sim is None:
            return nothing(state, 2)
        good = np.isfinite(state.sim)
        if not good.any():
            return nothing(state, 2)
        step = step if abs(step) > 1e-3 else 1e-3
        earlier = np.interp(state.time - step, state.time[good], state.sim[good])
        rate = (earlier - state.sim) / step
        return np.column_stack([rate, rate * state.time])


class SensorGain(_OfSimulation):
    """The measured current is scaled."""

    id = "sensor_gain"
    equation = "dI = (g - 1) * I_sim"
    amplitudes = (Parameter("g - 1", "–", low=-0.9),)
    summary = "{axis} axis, at all times, in proportion to the whole current"

    def regressors(self, state, **shape):
        return nothing(state) if state.sim is None else column(state.sim)

    def told(self, states, shape, sizes):
        plain = super().told(states, shape, sizes)
        lacks = sizes.get("g - 1")
        return plain if lacks is None else plain._replace(summary=f"{plain.summary}: × {1 + lacks:.3f}")


class SensorOffset(Mechanism):
    """The measured current is shifted by a constant."""

    id = "sensor_offset"
    equation = "dI = I_0"
    kind = "data_fault"
    amplitudes = (Parameter("I_0", "A"),)
    summary = "{axis} axis, at all times"

    def regressors(self, state, **shape):
        return column(np.ones(len(state.time)))


class SensorClipping(_OfSimulation):
    """The measured current is limited: all that the simulation has beyond is missing; `side`: 0 both, 1 upper, 2 lower.

    Exact limits of a recorded current are found by `pido.diagnosis.faults.clipping`; this is the limit as the
    simulation shows it, where noise or a filter after the limit hides the flat top.
    """

    id = "sensor_clipping"
    equation = "dI = -c * (|I_sim| - I_max)+ * sgn(I_sim) on both sides or one, c near 1"
    amplitudes = (Parameter("c", "–", low=0.7, high=1.3),)
    shape = (Parameter("I_max", "A", low=0.001, high=500.0, scale="log", points=16), choice("side", 3))

    def regressors(self, state, *, I_max, side):
        if state.sim is None:
            return nothing(state)
        over = -beyond(state.sim, I_max)
        sign = (0.0, 1.0, -1.0)[which(side, 3)]
        return column(over if sign == 0 else over * (sign * state.sim > 0))

    def equation_in(self, axis, shape):
        form = (
            "(|I_sim| - I_max) * sgn(I_sim) beyond |I_sim| = I_max",
            "(I_sim - I_max) above I_sim = I_max",
            "(I_sim + I_max) below I_sim = -I_max",
        )[which(shape["side"], 3)]
        return f"dI = -c * {form}, else 0; c near 1"

    def starts(self, states):
        """Limits at quantiles of the simulated current's size, on each side that it reaches."""
        sims = [s.sim[np.isfinite(s.sim)] for s in states if s.sim is not None]
        sim = np.concatenate(sims) if sims else np.zeros(0)
        out = []
        for side, part in ((0.0, np.abs(sim)), (1.0, sim[sim > 0]), (2.0, -sim[sim < 0])):
            limits = np.quantile(part, (0.6, 0.8, 0.9, 0.95, 0.98, 0.995)) if len(part) else ()
            out += [{"I_max": float(v), "side": side} for v in dict.fromkeys(limits) if v > 0]
        return tuple(out)

    def around(self, name, shape, states):
        return (shape[name] / 1.6, shape[name] * 1.6) if name == "I_max" else (shape[name], shape[name])

    def conditions(self, axis, shape):
        limit = f"{shape['I_max']:.3g}"
        sides = (f"|curr_{axis}_sim| > {limit}", f"curr_{axis}_sim > {limit}", f"curr_{axis}_sim < -{limit}")
        return f"{axis} axis, wherever the current would exceed {limit} A", (sides[round(shape["side"])],)
