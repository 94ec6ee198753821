"""Signals that are wrong, not physics: faulty inputs, a clipped current.

In:  a recording.
Out: `input_faults` as intervals per column, `clipping` as the limits that a current never leaves.
Position, speed and acceleration of an axis must belong together (`pido.diagnosis.consistency`, with thresholds from the
data's own noise); the only fixed numbers are speeds and accelerations that no mill reaches. A fault is never fitted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pido.core.arrays import Bool1D, Float1D
from pido.core.axes import AXES, LINEAR_AXES
from pido.core.columns import ACCELERATION, CURRENT, FORCE_SIM, POSITION, VELOCITY
from pido.core.recording import Recording
from pido.diagnosis.consistency import FROZEN, JUMP, contradictions, runs
from pido.diagnosis.hung import hung
from pido.diagnosis.long_faults import long_faults

# Beyond any machine tool: 5 m/s and 20 g along an axis; 150 000 1/min, reached within 10 ms, at the spindle.
_V_MOST = {"lin": 5000.0, "sp": 9.0e5}
_A_MOST = {"lin": 2.0e5, "sp": 9.0e7}
DISPLACED = "displaced since a jump: a counter reset"
"""Of a position: its rows are used without it, as its differences are right; those of any other fault are not used."""
HUNG = "the encoder hangs: all its signals repeat themselves, and then the axis is elsewhere"
_BEYOND_LOAD = 8.0  # times the load that one in a hundred loaded samples exceeds
_FEW_LOADED = 200  # samples with a load, below which none is called extreme
_FLAT_SHARE = 2e-3  # of the samples must lie exactly at a current's extreme to call it a limit


Faults = dict[str, dict[str, Bool1D]]


class Fault(NamedTuple):
    """Samples of one column, first to last in s, that are wrong, and why."""

    t_start: float
    t_end: float
    reason: str


def input_faults(recording: Recording) -> dict[str, tuple[Fault, ...]]:
    """Intervals per column of position, speed and acceleration signals that cannot be true; only faulty columns."""
    out = {}
    for axis in AXES:
        for column, by_reason in _faults_of_axis(recording, axis).items():
            found = [f for reason, rows in by_reason.items() for f in _intervals(recording.time, rows, reason)]
            if found:
                out[column] = tuple(sorted(found))
    return out


@dataclass(frozen=True, slots=True)
class ExtremeLoad:
    """A simulated load that is far beyond that of the rest of the part: where, how large at most, and what is usual.

    rows : (n,); largest, usual : in the column's unit, `usual` is what one in a hundred loaded samples exceeds
    """

    rows: Bool1D
    largest: float
    usual: float


def extreme_loads(recording: Recording) -> dict[str, ExtremeLoad]:
    """Per column the simulated load that the rest of the part comes nowhere near, as of a rapid through material, or
    of a plunge with the whole end of the tool; only columns that have one.
    """
    out = {}
    for name in (*FORCE_SIM.values(), "m_sp_sim", "mrr_sim"):
        if name not in recording:
            continue
        size = np.abs(np.nan_to_num(np.asarray(recording[name], float)))
        loaded = size[size > 0]
        if len(loaded) < _FEW_LOADED:
            continue
        usual = float(np.quantile(loaded, 0.99))
        rows = size > _BEYOND_LOAD * usual
        if rows.any():
            out[name] = ExtremeLoad(rows, float(size[rows].max()), usual)
    return out


def beyond_load(recording: Recording) -> Bool1D:
    """(n,) – rows with an extreme load. The few of them would decide every fit of what depends on the load."""
    rows = np.zeros(len(recording), bool)
    for load in extreme_loads(recording).values():
        rows |= load.rows
    return rows


def faulty(recording: Recording, axis: str) -> Bool1D:
    """(n,) – rows in which an input of `axis` is wrong; a displaced position alone does not make a row unusable."""
    rows = np.zeros(len(recording), bool)
    for by_reason in _faults_of_axis(recording, axis).values():
        for reason, found in by_reason.items():
            if reason != DISPLACED:
                rows |= found
    return rows


def displaced(recording: Recording, axis: str) -> Bool1D:
    """(n,) – rows in which the position of `axis` cannot be told, after a jump or while it is frozen."""
    rows = np.zeros(len(recording), bool)
    for found in _faults_of_axis(recording, axis).get(POSITION[axis], {}).values():
        rows |= found
    return rows


def clipping(recording: Recording, axis: str) -> tuple[float, float] | None:
    """(lowest, highest) current that the record never leaves, -inf or inf on a side without a limit; None without any.

    A limited signal stays at its extreme exactly and in runs; a noisy one touches it once.
    """
    if CURRENT[axis] not in recording:
        return None
    current = recording[CURRENT[axis]]
    current = current[np.isfinite(current)]
    if len(current) < 100 or np.ptp(current) == 0:
        return None
    levels = len(np.unique(current))
    # Units and files leave the last digits of a limit uncertain: it is given such that every sample at it reaches it.
    low, high = (_at(current, float(v)) for v in (current.min(), current.max()))
    flat = [_flat(rows) and levels > 50 for rows in (low, high)]
    if not any(flat):
        return None
    return float(current[low].max()) if flat[0] else -np.inf, float(current[high].min()) if flat[1] else np.inf


def _faults_of_axis(recording: Recording, axis: str) -> Faults:
    """Per column and reason the rows concerned; each recording is judged once, as it never changes."""
    known: dict[str, Faults] = recording.judged.setdefault("faults", {})
    if axis not in known:
        found = _judge(recording, axis)
        known[axis] = {c: {k: rows for k, rows in by.items() if rows.any()} for c, by in found.items()}
    return known[axis]


def _judge(recording: Recording, axis: str) -> Faults:
    time = recording.time
    sort = "lin" if axis in LINEAR_AXES else "sp"
    names = {"pos": POSITION[axis], "v": VELOCITY[axis], "a": ACCELERATION[axis]}
    pos, v, a = (np.asarray(recording[n], float) if n in recording else None for n in names.values())
    out: Faults = {n: {} for n in names.values()}
    wrong = np.zeros(len(time), bool)
    if v is not None:
        wrong = np.abs(v) > _V_MOST[sort]
        if wrong.mean() > 0.5:
            wrong[:] = False  # not a fault over an interval: another unit
        out[names["v"]]["speed that no machine reaches"] = wrong
        if axis == "sp":
            reset = _short_reversal(time, v) & ~wrong
            out[names["v"]]["reversal that no spindle can make: a counter reset"] = reset
            wrong = wrong | reset
    apart = np.zeros(len(time), bool)
    if pos is not None and v is not None and axis in LINEAR_AXES:
        hangs = hung(time, pos, v, a)
        wrong = wrong | hangs
        for signal, values in (("pos", pos), ("v", v), ("a", a)):
            if values is not None:
                out[names[signal]][HUNG] = hangs
    if pos is not None and v is not None and a is not None and axis in LINEAR_AXES:
        for fault in long_faults(time, pos, v, a, wrong):
            rows = slice(fault.first, fault.last + 1)
            out[names["v"]].setdefault(fault.reason, np.zeros(len(time), bool))[rows] = True
            apart[rows] = True
    found = contradictions(time, pos, v, a, wrong | apart, None if axis in LINEAR_AXES else 360.0)
    for name in ("pos", "v", "a"):
        out[names[name]] |= getattr(found, name)
    if found.displaced.any():
        out[names["pos"]][DISPLACED] = found.displaced & ~found.pos[JUMP]
    if a is not None:
        reached = np.abs(a) <= _A_MOST[sort]
        out[names["a"]]["acceleration that no machine reaches"] = ~reached & np.isfinite(a)
        for rows in out[names["v"]].values():
            wrong = wrong | rows
        # A derivative beside a wrong speed is wrong as well, unless the speed stood still and the derivative did not,
        # or it was shown to be that of the position.
        if v is not None:
            for reason in (FROZEN, HUNG):
                wrong = wrong & ~out[names["v"]].get(reason, np.zeros(len(time), bool))
            follows = _grown(wrong) & ~_grown(apart)
            own = np.logical_or.reduce([r for k, r in out[names["a"]].items()])
            out[names["a"]]["derived from a wrong speed"] = follows & reached & ~own
    return out


def _short_reversal(time: Float1D, v: Float1D) -> Bool1D:
    """Turns against the direction before for less than 0.3 s, faster than a twentieth of the usual top speed."""
    top = float(np.nanquantile(np.abs(v), 0.95))
    side = np.where(np.abs(v) > 0.05 * top, np.sign(v), 0.0)
    out = np.zeros(len(v), bool)
    if top == 0:
        return out
    main = np.sign(np.nansum(side))
    for i, j in runs(side == -main):
        before = v[max(i - 8, 0) : i]
        if time[j] - time[i] < 0.3 and np.any(before * main > 0.05 * top):
            out[i : j + 1] = True
    return out


def _at(current: Float1D, level: float) -> Bool1D:
    return np.isclose(current, level, rtol=0, atol=1e-9 * float(np.ptp(current)))


def _flat(at: Bool1D) -> bool:
    longest = max((j - i + 1 for i, j in runs(at)), default=0)
    return at.mean() > _FLAT_SHARE and longest >= 3


def _grown(rows: Bool1D) -> Bool1D:
    return rows | np.r_[rows[1:], False] | np.r_[False, rows[:-1]]


def _intervals(time: Float1D, rows: Bool1D, reason: str) -> list[Fault]:
    return [Fault(float(time[i]), float(time[j]), reason) for i, j in runs(rows)]
