"""Signals of a SINUMERIK control (`SIGNAL|n`, n the control's axis number) to the contract's columns.

In:  the signal list (signal -> axis name) and a wish for other axis names.
Out: which signal becomes which column; then columns from a table of signals.

`ENC_POS|n` is the motor encoder's position, `ENC2_POS|n` the direct measuring system's, `DES_POS|n` the commanded one,
all in mm and deg; `CURRENT|n` is the motor current in A. Encoders first: the simulation is compared with what happened.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from pido.core.arrays import Array1D, Float1D
from pido.core.axes import AXES
from pido.core.columns import CURRENT, POSITION
from pido.core.errors import RecordingError

CHANNELS: dict[str, tuple[str, ...]] = {
    "x": ("X1", "X", "MX1", "1"),
    "y": ("Y1", "Y", "MY1", "2"),
    "z": ("Z1", "Z", "MZ1", "3"),
    "sp": ("SP1", "S1", "SP", "SPINDLE", "MSP1", "6"),
}
"""Names that the axes have in a control's header, the usual ones first; the number is the published layout's."""

_POSITIONS = ("ENC_POS", "ENC2_POS", "DES_POS")


def wanted_signals(
    axis_of: Mapping[str, str], wishes: Mapping[str, str], where: Path
) -> tuple[dict[str, str], tuple[str, ...]]:
    """(column -> signal, notes) for every axis of the contract that the list of signals holds.

    axis_of : signal name -> axis name, as the header says
    wishes : axis of the contract -> axis name, before the defaults
    Raises RecordingError where a wished axis is not in the list, or no axis is.
    """
    names = {name.upper() for name in axis_of.values()}
    columns: dict[str, str] = {}
    notes: list[str] = []
    for axis in AXES:
        if (wish := wishes.get(axis)) and wish.upper() not in names:
            raise RecordingError(
                f"{where}: axis {axis} should be channel '{wish}', but the recording has {', '.join(sorted(names))}. "
                f"Name the right channel in the machine's settings."
            )
        candidates = (wish,) if wish else CHANNELS[axis]
        channel = next((c for c in candidates if c.upper() in names), None)
        if channel is None:
            notes.append(f"axis {axis} was not recorded: no channel {' or '.join(CHANNELS[axis])}")
            continue
        own = {s.split("|")[0]: s for s, a in axis_of.items() if a.upper() == channel.upper()}
        kind = next((k for k in _POSITIONS if k in own), None)
        if kind is not None:
            columns[POSITION[axis]] = own[kind]
            if kind != _POSITIONS[0]:
                notes.append(f"pos_{axis} is {kind} ({own[kind]}): {_POSITIONS[0]} was not recorded")
        if "CURRENT" in own:
            columns[CURRENT[axis]] = own["CURRENT"]
        else:
            notes.append(f"curr_{axis} was not recorded: there is no signal CURRENT of axis {channel}")
    if not any(c in columns for c in CURRENT.values()):
        raise RecordingError(
            f"{where}: no motor current (signal CURRENT) of any of the axes x, y, z and spindle. Its axes are "
            f"{', '.join(sorted(names)) or 'not named'}; name the channels in the machine's settings."
        )
    return columns, tuple(notes)


def block_index(keys: Iterable[object]) -> list[int]:
    """A number for each NC block, from 1 in order of first appearance; a block that comes again keeps its number.

    >>> block_index(["N1", "N2", "N1", "N3"])
    [1, 2, 1, 3]
    """
    seen: dict[object, int] = {}
    return [seen.setdefault(key, len(seen) + 1) for key in keys]


def hold(event_counter: list[float], values: list[float], counter: Float1D) -> Float1D:
    """(n,) – the value of the last event at or before each sample's counter; NaN before the first event."""
    order = np.argsort(np.asarray(event_counter, float), kind="stable")
    at = np.asarray(event_counter, float)[order]
    last = np.searchsorted(at, counter, side="right") - 1
    held = np.asarray(values, float)[order][np.maximum(last, 0)] if len(at) else np.full(len(counter), np.nan)
    return np.where(last >= 0, held, np.nan)


def hold_names(event_counter: list[float], names: list[float | str], counter: Float1D) -> Array1D:
    """(n,) – as `hold`: numbers where every name is one; otherwise text, None before the first event.

    >>> hold_names([0.0, 2.0], ["6", 7], np.arange(3.0)).tolist()
    [6.0, 6.0, 7.0]
    >>> hold_names([1.0, 2.0], ["DRILL", 7], np.arange(3.0)).tolist()
    [None, 'DRILL', '7']
    """
    try:
        return hold(event_counter, [float(name) for name in names], counter)
    except ValueError:
        which = hold(event_counter, [float(k) for k in range(len(names))], counter)
        return np.array([None if np.isnan(k) else str(names[int(k)]) for k in which], dtype=object)
