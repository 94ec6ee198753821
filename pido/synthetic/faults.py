"""Faults of the data, not of the machine: a recorded current or a signal that is not what the machine did.

In:  what the sensors would write, at the control's cycle, and an amplitude.
Out: what the file says.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pido.core.arrays import Float1D

CURRENT_FAULTS = ("time_misalignment", "sensor_gain", "sensor_offset", "sensor_clipping")
INPUT_KINDS = ("reset", "spike", "frozen")


def faulty_current(id: str, current: Float1D, time: Float1D, amplitude: float, shape: Mapping[str, Any]) -> Float1D:
    """The current with one of `CURRENT_FAULTS`.

    amplitude : gain - 1; offset in A; what is cut off the highest current, A; delay in s (a drifting clock
    reaches it at the end of the recording)
    """
    if id == "sensor_gain":
        return current * (1 + amplitude)
    if id == "sensor_offset":
        return current + amplitude
    if id == "sensor_clipping":
        limit = max(shape["peak_a"] - amplitude, 0.0)
        return np.clip(current, -limit, limit)
    delay = amplitude * (time / time[-1]) if shape.get("drift") else amplitude
    return np.interp(time - delay, time, current)


def fault_parameters(id: str, amplitude: float, shape: Mapping[str, Any]) -> dict[str, tuple[float, str]]:
    """Its numbers with their units."""
    if id == "sensor_gain":
        return {"gain": (1 + amplitude, "–")}
    if id == "sensor_offset":
        return {"offset": (amplitude, "A")}
    if id == "sensor_clipping":
        return {"limit": (shape["peak_a"] - amplitude, "A")}
    return {"delay": (amplitude, "s")}


def faulty_signal(kind: str, pos: Float1D, start: int, stop: int, size: float) -> Float1D:
    """A position with a counter that was reset by `size` mm, a spike of that height, or a value that stands still."""
    wrong = pos.copy()
    if kind == "reset":
        wrong[start:stop] -= size
    elif kind == "frozen":
        wrong[start:stop] = pos[start]
    else:
        middle = (start + stop) // 2
        wrong[middle : middle + 10] += size
    return wrong
