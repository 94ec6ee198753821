"""Recordings of the small CNC mill of the University of Michigan's SMART lab ("CNC Mill Tool Wear"), 10 Hz.

In:  experiment_NN.csv. Out: a Recording: actual positions (mm), velocities and accelerations of X1, Y1, Z1; spindle
     position and speed (recorded in turns and turns/s) in deg; current feedback in the control's own units.

The rows of most files are packets of about a second in shuffled order; `packets` puts them in order where continuity
decides it, and the notes say how far. There is no time column: rows are 0.1 s apart by the publisher's word, and really
by 0.05 to 0.24 s at the borders of packets.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pido.core.arrays import Float1D
from pido.core.errors import RecordingError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings.packets import Track, in_order
from pido.recordings.reader import Reader, csv_header, of_machine
from pido.recordings.tables import read_csv

RATE_HZ = 10.0
COUNTER_TURNS = 2.0**32 / 1e6  # the spindle's counter: 32 bits of millionths of a turn
_AXES = {"x": "X1", "y": "Y1", "z": "Z1", "sp": "S1"}
_LINE = "M1_sequence_number"


def _recognises(path: Path) -> bool:
    return path.is_file() and "X1_ActualPosition" in csv_header(path)


def _read(path: Path, machine: str | None, channels: Mapping[str, str]) -> Recording:
    present = set(csv_header(path))
    parts = ("ActualPosition", "ActualVelocity", "ActualAcceleration", "CurrentFeedback")
    wanted = {(axis, part): f"{channels.get(axis, name)}_{part}" for axis, name in _AXES.items() for part in parts}
    if missing := sorted(set(wanted.values()) - present):
        raise RecordingError(f"{path}: column(s) {', '.join(missing)} missing. Download the file again.")
    table = read_csv(path, [*wanted.values(), *([_LINE] if _LINE in present else [])])
    raw = {key: table[name] for key, name in wanted.items()}
    tracks = [
        Track(raw[axis, "ActualPosition"], raw[axis, "ActualVelocity"], COUNTER_TURNS if axis == "sp" else None)
        for axis in _AXES
    ]
    order, border, notes = in_order(tracks, np.column_stack(list(table.values())), 1.0 / RATE_HZ)
    columns: dict[str, Float1D] = {"time": np.arange(len(order)) / RATE_HZ}
    for axis in _AXES:
        turn = 360.0 if axis == "sp" else 1.0
        for part, prefix in zip(parts, ("pos", "v", "a", "curr"), strict=True):
            scale = 1.0 if part == "CurrentFeedback" else turn
            columns[f"{prefix}_{axis}"] = raw[axis, part][order] * scale
    if _LINE in table:
        columns["nc_line"] = table[_LINE][order]
    # Where the order is not known, nothing may be differenced: a step in time says so to everything downstream.
    columns["time"] = columns["time"] + np.cumsum(border) * 1.0
    machine, assumed = of_machine(machine, "smart_mill", "that of the published experiments")
    notes = (
        *assumed,
        "time is nominal, rows 0.1 s apart; positions are rounded to three digits",
        "currents are in the control's own units",
        *notes,
    )
    return Recording(part=PartInfo(part=path.stem, machine=machine), columns=columns, notes=notes)


READER = Reader(
    name="smart mill",
    layout="a .csv with X1_ActualPosition, X1_CurrentFeedback, ...",
    recognises=_recognises,
    read=_read,
)
