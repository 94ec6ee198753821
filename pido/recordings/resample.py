"""A recording at a lower rate: low-pass filter with zero phase, then samples at even times.

In:  a Recording at any higher rate. Out: one at `rate_hz`; a gap stays a gap, a missing value stays missing.

The filter is a linear-phase FIR (Kaiser, 60 dB) whose delay is taken out: up to 0.36 of the new rate the amplitude is
within 0.1 %, from 0.64 of it on 60 dB down, so that what folds back lies above 0.36 of the new rate. At 500 -> 50 Hz:
18 Hz and 32 Hz. Beyond the ends of a stretch the signal is continued by odd reflection.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import firwin, kaiserord, oaconvolve

from pido.core.arrays import Bool1D, Float1D, Int1D
from pido.core.columns import TIME
from pido.core.errors import RecordingError
from pido.core.recording import Recording
from pido.recordings.segments import counter_resets, starts, stretches, turns_known, unwrap_deg

HELD = ("nc_line", "tool_id", "coolant")
"""Columns that are states: the nearest sample's is taken."""


def to_50_hz(recording: Recording) -> Recording:
    """The recording at the 50 Hz of the paper."""
    return resample(recording, 50.0)


def resample(recording: Recording, rate_hz: float) -> Recording:
    """The recording at `rate_hz`; returned as it is where its rate is that already, within 1 %.

    Raises RecordingError for a rate above the recording's: samples that were not taken cannot be made; and where time
    does not advance from each row to the next.
    """
    step = np.diff(recording.time)
    if len(stands := np.flatnonzero(~(step > 0))):
        raise RecordingError(
            f"part {recording.part.part}: time does not advance in {len(stands)} row(s), first in row {stands[0] + 2}; "
            "between such rows nothing can be resampled. Export the recording again with every sample's own time, in s."
        )
    source = recording.sample_rate_hz
    if abs(source - rate_hz) <= 0.01 * rate_hz:
        return recording
    if rate_hz > source:
        raise RecordingError(
            f"part {recording.part.part}: recorded at {source:g} Hz; {rate_hz:g} Hz would need samples that were never "
            f"taken. Ask for {source:g} Hz or less."
        )
    time = recording.time
    begin = starts(time)
    taps = _low_pass(source, rate_hz)
    grid = [time[s.start] + np.arange(int((time[s.stop - 1] - time[s.start]) * rate_hz + 1e-6) + 1) / rate_hz
            for s in stretches(begin)]  # fmt: skip
    new_time = np.concatenate(grid)
    nearest = _nearest(time, new_time)
    columns = {}
    for name, values in recording.columns.items():
        if name == TIME:
            columns[name] = new_time
        elif name in HELD or values.dtype == object:
            columns[name] = values[nearest]
        else:
            columns[name] = _filtered(name, values, time, begin, new_time, nearest, taps)
    note = f"resampled from {source:g} to {rate_hz:g} Hz, zero-phase low-pass at {0.5 * rate_hz:g} Hz"
    part = recording.part.model_copy(update={"sample_rate_hz": rate_hz})
    return Recording(part, columns, (*recording.notes, note))


def _low_pass(source_hz: float, rate_hz: float) -> Float1D:
    edges = 0.36 * rate_hz, min(0.64 * rate_hz, 0.5 * source_hz)
    count, beta = kaiserord(60.0, (edges[1] - edges[0]) / (0.5 * source_hz))
    return np.asarray(firwin(count | 1, sum(edges) / 2, window=("kaiser", beta), fs=source_hz), dtype=float)  # pyright: ignore[reportArgumentType]


def _filtered(
    name: str, values: Float1D, time: Float1D, begin: Bool1D, new_time: Float1D, nearest: Int1D, taps: Float1D
) -> Float1D:
    """One column at the new times; a new sample whose nearest old one is missing is missing.

    An angle of the spindle whose turns are not known is the nearest sample's: what lies between is not known either.
    """
    if name == "pos_sp":
        if not turns_known(values, time):
            return values[nearest]
        values = unwrap_deg(values)
        begin = begin | counter_resets(values, time)
    out = np.full(len(new_time), np.nan)
    half = len(taps) // 2
    for s in stretches(begin, np.isfinite(values)):
        inside = (nearest >= s.start) & (nearest < s.stop)
        padded = np.pad(values[s], half, mode="reflect", reflect_type="odd") if s.stop - s.start > 1 else None
        smooth = values[s] if padded is None else oaconvolve(padded, taps, mode="valid")
        out[inside] = np.interp(new_time[inside], time[s], smooth)
    return out


def _nearest(time: Float1D, new_time: Float1D) -> Int1D:
    right = np.clip(np.searchsorted(time, new_time), 1, len(time) - 1)
    return np.where(new_time - time[right - 1] <= time[right] - new_time, right - 1, right)
