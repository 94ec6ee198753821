"""Currents whose unit slipped show beside the other parts of the machine: on all axes a thousand times as large.

In:  an arriving recording, and how large the currents of the machine's stored parts are.
Out: `Beside`: by which factor it differs, and in words what to do; None where nothing is odd.

A current has no partner in its own recording that would give its unit away, as a speed has its position. The size of an
axis' current is the 99th percentile of its absolute value while anything moves; axes that stand throughout say nothing,
for what they hold is as large as it likes. Air or steel, a feed or a rapid change a size by a few times, and not all
axes alike: a factor beyond MOST on every one is no load.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Bool1D
from pido.core.axes import AXES
from pido.core.columns import CURRENT, VELOCITY
from pido.core.recording import Recording

Sizes = dict[str, float]
"""By axis, A."""
COLUMNS = (*CURRENT.values(), *VELOCITY.values())
"""What sizes are taken from."""
FEWEST = 50
"""Samples in motion, fewer of which say nothing: one second at 50 Hz."""
MOST = 20.0
"""Beyond this factor on all axes, up or down, somebody has to look."""
_UNIT, _NEAR = 1000.0, 5.0
_SLOWEST = {"x": 0.1, "y": 0.1, "z": 0.1, "sp": 6.0}  # mm/s, deg/s; noise of a standing axis lies below


@dataclass(frozen=True, slots=True)
class Beside:
    """factor : geometric mean over the axes; unit : whether it is that of A and mA, which no machine does by itself"""

    factor: float
    unit: bool
    words: str


def sizes(recording: Recording) -> Sizes:
    """Of each axis that moves and whose current was recorded and is not zero throughout.

    >>> from pido.core.part import PartInfo
    >>> n = np.arange(400)
    >>> x, y = {"v_x": 5.0 + 0 * n, "curr_x": 2.0 * (-1.0) ** n}, {"v_y": 0.0 * n, "curr_y": 9.0 + 0 * n}
    >>> sizes(Recording(PartInfo(part="p01", machine="m"), {"time": n / 50, **x, **y}))
    {'x': 2.0}
    """
    moving = {axis: _moves(recording, axis) for axis in AXES}
    anything = np.any(list(moving.values()), axis=0)
    found = {}
    for axis in AXES:
        if CURRENT[axis] not in recording or moving[axis].sum() < FEWEST:
            continue
        current = np.abs(recording[CURRENT[axis]][anything])
        current = current[np.isfinite(current)]
        if len(current) >= FEWEST and (size := float(np.quantile(current, 0.99))) > 0.0:
            found[axis] = size
    return found


def beside(part: str, mine: Sizes, stored: Mapping[str, Sizes]) -> Beside | None:
    """Compare with the stored parts, by name; None where no axis can be, or nothing is odd."""
    logs: dict[str, float] = {}
    for axis, size in mine.items():
        others = [found[axis] for found in stored.values() if axis in found]
        if others:
            logs[axis] = float(np.log(size) - np.median(np.log(others)))
    if not logs:
        return None
    off = np.array(list(logs.values()))
    factor = float(np.exp(np.mean(off)))
    if not ((off > np.log(MOST)).all() or (off < -np.log(MOST)).all()):
        return None
    unit = bool(np.abs(np.abs(np.log(factor)) - np.log(_UNIT)) < np.log(_NEAR))
    each = ", ".join(f"{axis} {_times(float(np.exp(value)))}" for axis, value in logs.items())
    words = (
        f"part '{part}': its currents are {_times(factor)} those of {_named(stored)} of this machine "
        f"({each}; 99th percentile of |I| while anything moves)."
    )
    return Beside(factor, unit, f"{words} {_advice(factor, unit)}")


def _advice(factor: float, unit: bool) -> str:
    if not unit:
        return "No load does that on all axes: look at the export, the scale of its currents, and the machine named."
    if factor > 1.0:
        return (
            "It looks like mA, and must be in A: divide curr_x, curr_y, curr_z and curr_sp by 1000 and bring it again. "
            "If it is right and those are wrong, take those out first (`pido withdraw`)."
        )
    return (
        "Either it was divided by 1000 once too often, and must be in A: multiply its currents by 1000 and bring it "
        "again; or those are in mA: take them out first (`pido withdraw`)."
    )


def _times(factor: float) -> str:
    return f"{_number(factor)} times" if factor >= 1.0 else f"1/{_number(1 / factor)} times"


def _number(factor: float) -> str:
    return f"{factor:.0f}" if factor >= 100.0 else f"{factor:.3g}"


def _named(stored: Mapping[str, Sizes]) -> str:
    return f"part(s) {', '.join(stored)}"


def _moves(recording: Recording, axis: str) -> Bool1D:
    """(n,); where no speed is known, an axis may be moving."""
    if VELOCITY[axis] not in recording:
        return np.full(len(recording), axis != "sp" and CURRENT[axis] in recording)
    with np.errstate(invalid="ignore"):
        return np.abs(recording[VELOCITY[axis]]) > _SLOWEST[axis]
