"""What an alarm looks like, in the words of the mismatch vocabulary: a first guess for the operator, not a diagnosis.

In:  the residual around an alarm and the motion and process signals there.
Out: the identifier whose textbook signal follows the residual most closely, or `unknown`.

The guess compares one stretch with one signal at a time. `pido diagnose` on whole parts is what may be acted upon.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pido.core.arrays import Float1D
from pido.core.columns import ACCELERATION, FORCE_SIM, VELOCITY

AT_LEAST = 0.6
"""Correlation below which no signal is named."""


def looks_like(axis: str, residual: Float1D, signals: Mapping[str, Float1D]) -> str:
    """An identifier of the vocabulary.

    Parameters
    ----------
    axis : of the alarm
    residual : (n,), A – around the alarm, with a stretch before and after it, so that a constant shows as a step
    signals : columns of the recording over the same samples; those that are missing are not compared

    >>> t = np.linspace(0.0, 6.0, 300)
    >>> looks_like("x", 0.1 * np.sign(np.sin(t)), {"v_x": np.sin(t), "a_x": np.cos(t)})
    'coulomb_friction'
    """
    candidates = _candidates(axis, signals)
    scored = {name: abs(_correlation(residual, signal)) for name, signal in candidates.items()}
    best = max(scored, key=lambda name: scored[name], default=None)
    return best if best is not None and scored[best] >= AT_LEAST else "unknown"


def _candidates(axis: str, signals: Mapping[str, Float1D]) -> dict[str, Float1D]:
    found: dict[str, Float1D] = {}
    v, a = signals.get(VELOCITY[axis]), signals.get(ACCELERATION[axis])
    if axis == "sp":
        named = {"spindle_viscous_drag": v, "spindle_inertia": a, "spindle_torque_load": signals.get("m_sp_sim")}
    else:
        named = {
            "coulomb_friction": None if v is None else np.sign(v),
            "viscous_friction": v,
            "inertia": a,
            "cutting_force": signals.get(FORCE_SIM[axis]),
        }
    found |= {name: signal for name, signal in named.items() if signal is not None}
    if "coolant" in signals:
        found["coolant_load"] = signals["coolant"]
    return found


def _correlation(first: Float1D, second: Float1D) -> float:
    both = np.isfinite(first) & np.isfinite(second)
    if both.sum() < 3 or np.ptp(first[both]) == 0 or np.ptp(second[both]) == 0:
        return 0.0
    return float(np.corrcoef(first[both], second[both])[0, 1])
