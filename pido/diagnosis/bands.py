"""Speeds of the axes, and the dead band at or below which an axis stands still.

In:  recordings of one machine. Out: per axis its speed, where it was recorded or follows from the position, and a band.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pido.core.arrays import Float1D
from pido.core.axes import AXES, LINEAR_AXES
from pido.core.columns import POSITION, VELOCITY
from pido.core.machining import Machine
from pido.core.recording import Recording, usual_step

LINEAR_DEAD_BAND = 0.02  # mm/s
_SPINDLE_DEAD_BAND = 6.0  # deg/s
_SPINDLE_MOST = 72_000.0  # deg/s, 12 000 1/min: of a spindle of which nothing else is known
_TURN_DEG = 360.0
_CREEPS = 0.002  # of all samples, at one steady speed below the usual band: it is a feed, and no trembling
_NOTHING = 0.05  # of the usual band
_NOISE_FACTOR = 5.0  # of a speed's noise at standstill: a larger speed is motion


def numbers(recording: Recording, name: str) -> Float1D | None:
    """A column; None where it is not there, or has no value: it says nothing of the part then."""
    values = np.asarray(recording[name], float) if name in recording else None
    return None if values is None or np.isnan(values).all() else values


def speed_of(recording: Recording, axis: str) -> Float1D | None:
    """(n,), mm/s (deg/s): as recorded, else by central differences of the position; None where neither is there, or
    where the position is an angle of the spindle within one turn, and a fast turn between samples looks like a slow
    one."""
    v, pos = numbers(recording, VELOCITY[axis]), numbers(recording, POSITION[axis])
    if v is not None or pos is None or len(recording) < 2:
        return v
    if axis == "sp" and np.nanmax(pos) - np.nanmin(pos) <= _TURN_DEG:
        if _SPINDLE_MOST * usual_step(recording.time) >= _TURN_DEG / 2:
            return None
        pos = np.unwrap(pos, period=_TURN_DEG)
    return np.gradient(pos, recording.time)


def dead_bands(
    recordings: Sequence[Recording], machine: Machine | None = None, known: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Speed at or below which each axis with a speed stands still: the machine's, or what all recordings together say.

    known : bands that were read before, from other parts of the same machine

    One recording says little of an axis that hardly moves in it, and that axis has one band wherever it moves.
    """
    known = known or {}
    speeds = {a: [v for r in recordings if (v := speed_of(r, a)) is not None] for a in AXES if a not in known}
    read = {a: _dead_band(v, a) if machine is None else machine.dead_band(a) for a, v in speeds.items() if v}
    return {**read, **known}


def _dead_band(speeds: Sequence[Float1D], axis: str) -> float:
    """Five times the signal's own noise at standstill, at least the usual band.

    Noise is read from second differences of slow samples beside slow ones: a smooth motion has none there, and a quick
    turn is no standstill. The band never exceeds a twentieth of the speeds that occur, so that a noisy signal cannot
    hide slow motion altogether. A signal without noise may say that an axis creeps steadily below the usual band, which
    is motion then.
    """
    least = LINEAR_DEAD_BAND if axis in LINEAR_AXES else _SPINDLE_DEAD_BAND
    known = [v[np.isfinite(v)] for v in speeds]
    every = np.abs(np.concatenate(known))
    if len(every) < 20:
        return least
    top = float(np.quantile(every, 0.95))
    bend = np.concatenate([_bends(v, 0.05 * top) for v in known])
    noise = 1.4826 * float(np.median(bend)) / np.sqrt(6.0) if len(bend) >= 20 else 0.0
    if noise == 0 and len(creeps := np.concatenate([_steady(v, least) for v in known])) >= _CREEPS * len(every):
        return float(np.quantile(creeps, 0.01)) / 2
    return float(max(least, min(_NOISE_FACTOR * noise, 0.05 * top)))


def _steady(v: Float1D, slow: float) -> Float1D:
    """Sizes of the speeds, at most `slow` and not next to nothing, that the samples before and after have too."""
    size = np.abs(v[1:-1])
    return size[(size > _NOTHING * slow) & (size <= slow) & (v[2:] == v[1:-1]) & (v[:-2] == v[1:-1])]


def _bends(v: Float1D, slow: float) -> Float1D:
    """Sizes of the second differences where all three samples are slower."""
    stands = np.abs(v) < slow
    return np.abs(np.diff(v, 2))[stands[2:] & stands[1:-1] & stands[:-2]]
