"""Velocities and accelerations where they were not recorded.

In:  a Recording with positions. Out: the same with v_<axis> and a_<axis>.

Central differences, second order on uneven steps; one-sided at the ends of a stretch:

    v_i = (p_{i+1} - p_{i-1}) / (2 T)                 amplitude sin(wT) / (wT), phase 0
    a_i = (p_{i+1} - 2 p_i + p_{i-1}) / T^2           amplitude (sin(wT/2) / (wT/2))^2, phase 0
    a from a recorded v: as v from p

with w in rad/s and T the step: at a tenth of the sample rate v is 6.5 % and a 3.2 % small, at a hundredth 0.07 and
0.03 %. Nothing is smoothed here; noise is the business of `resample`, whose filter is linear and so may follow.
"""

from __future__ import annotations

import numpy as np

from pido.core.arrays import Bool1D, Float1D
from pido.core.axes import AXES
from pido.core.columns import ACCELERATION, POSITION, VELOCITY
from pido.core.recording import Recording
from pido.recordings.segments import SPINDLE_USUAL, counter_resets, starts, stretches, turns_known, unwrap_deg

DERIVED = "derived by central differences: "
"""Begins the note that lists the columns."""


def derivative(values: Float1D, time: Float1D, begin: Bool1D) -> Float1D:
    """(n,) per second: central differences within each stretch; NaN in a stretch of one sample, or where missing."""
    out = np.full(len(values), np.nan)
    for s in stretches(begin, np.isfinite(values)):
        if s.stop - s.start >= 2:
            out[s] = np.gradient(values[s], time[s])
    return out


def second_derivative(values: Float1D, time: Float1D, begin: Bool1D) -> Float1D:
    """(n,) per second²: three-point differences within each stretch; the ends repeat their neighbour."""
    out = np.full(len(values), np.nan)
    for s in stretches(begin, np.isfinite(values)):
        if s.stop - s.start < 3:
            out[s] = 0.0 if s.stop - s.start == 2 else np.nan
            continue
        step = np.diff(time[s])
        slope = np.diff(values[s]) / step
        inner = 2.0 * np.diff(slope) / (step[1:] + step[:-1])
        out[s] = np.r_[inner[0], inner, inner[-1]]
    return out


def with_motion(recording: Recording, spindle_max_deg_s: float | None = None) -> Recording:
    """The recording with every velocity and acceleration that its positions allow; recorded ones stay.

    spindle_max_deg_s : the machine's, where known: it decides whether an angle of the spindle that restarts at every
        turn gives its speed (`segments.turns_known`). Where it does not, none is derived, and a note says so.
    """
    time = recording.time
    new: dict[str, Float1D] = {}
    notes: list[str] = []
    gaps = starts(time)
    for axis in AXES:
        v, a, p = VELOCITY[axis], ACCELERATION[axis], POSITION[axis]
        if p in recording and (v not in recording or a not in recording):
            if axis == "sp" and v not in recording and not turns_known(recording[p], time, spindle_max_deg_s):
                notes.append(_turns_unknown(recording, spindle_max_deg_s))
                continue
            position = unwrap_deg(recording[p]) if axis == "sp" else recording[p]
            begin = gaps | counter_resets(position, time) if axis == "sp" else gaps
            if v not in recording:
                new[v] = derivative(position, time, begin)
                if a not in recording:
                    new[a] = second_derivative(position, time, begin)
                if position is not recording[p]:
                    notes.append("pos_sp restarts at every turn; it was unwrapped to derive v_sp")
                if (count := int((begin & ~gaps).sum())) > 0:
                    notes.append(f"the counter behind pos_sp was set back {count} times; v_sp is not derived across")
        if a not in recording and a not in new and v in recording:
            new[a] = derivative(recording[v], time, gaps)
    if new:
        notes.insert(0, f"{DERIVED}{', '.join(new)}")
    return Recording(recording.part, {**recording.columns, **new}, (*recording.notes, *notes)) if notes else recording


def derived(recording: Recording) -> frozenset[str]:
    """The columns that `with_motion` derived: no evidence about those from which they come."""
    return frozenset(
        name for note in recording.notes if note.startswith(DERIVED) for name in note.removeprefix(DERIVED).split(", ")
    )


def _turns_unknown(recording: Recording, spindle_max_deg_s: float | None) -> str:
    rpm = (spindle_max_deg_s or SPINDLE_USUAL) / 6.0
    whose = "a spindle of" if spindle_max_deg_s is None else "this machine's spindle of"
    return (
        f"v_sp and a_sp are not derived: pos_sp is an angle within one turn, and between samples at "
        f"{recording.sample_rate_hz:.4g} Hz {whose} {rpm:.6g} 1/min makes half a turn or more, so that a fast turn "
        "looks like a slow one. Record v_sp, or a position that counts turns"
    )
