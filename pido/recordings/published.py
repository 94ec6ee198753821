"""The published 50 Hz milling files (KIT, doi 10.5445/IR/1000157789 and its follow-up): CSV, contract's names.

In:  a .csv with pos_ or v_ columns, with or without `time` and currents (a part may be simulated before it is made).
Out: a Recording. Without `time`, rows are 20 ms apart, as their publisher says; a file whose time has another name is
     refused. Columns that neither contract nor publisher knows are kept where they are numbers, and named in a note.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pido.core.columns import ACCELERATION, OPTIONAL, POSITION, PROCESS, TIME, UNITS, VELOCITY
from pido.core.errors import RecordingError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings.reader import UNKNOWN, Reader, contract_names, csv_header, of_machine
from pido.recordings.tables import read_csv

RATE_HZ = 50.0
_MOVES = (*POSITION.values(), *VELOCITY.values())
_SIMULATED = {f"{name}_sim" for name in (*VELOCITY.values(), *ACCELERATION.values())}
"""Published beside the contract's columns: the motion as it was simulated."""
_CLOCKS = {"t", "s", "ms", "us", "sec", "secs", "second", "seconds", "msec", "date"}


def _recognises(path: Path) -> bool:
    if not path.is_file() or path.suffix.lower() != ".csv":
        return False
    return not set(csv_header(path)).isdisjoint(_MOVES)


def _read(path: Path, machine: str | None, channels: Mapping[str, str]) -> Recording:
    present = [name for name in csv_header(path) if name and not name.startswith("Unnamed")]
    if garbled := [name for name in present if "\ufffd" in name]:
        raise RecordingError(f"{path}: column name(s) {', '.join(garbled)} are not UTF-8. Save the file as UTF-8.")
    named = dict(zip(present, contract_names(present, path), strict=True))
    known = [name for name in present if named[name] in UNITS]
    unknown = [name for name in present if named[name] not in UNITS and name not in _SIMULATED]
    text = [name for name in known if named[name] == "tool_id"]
    table = read_csv(path, [name for name in known if name not in text], text, unknown)
    columns = {named[name]: values for name, values in table.items()}
    machine, assumed = of_machine(machine, "dmc60h", "that of the published files")
    notes = list(assumed)
    if TIME not in columns:
        if clock := [name for name in unknown if _may_be_time(name)]:
            raise RecordingError(
                f"{path}: has no column 'time', but {', '.join(map(repr, clock))}. Name the one that is the time "
                "'time', in s from the first sample. (Without any, rows are 20 ms apart, as in the published files.)"
            )
        n = len(next(iter(columns.values())))
        columns = {TIME: np.arange(n) / RATE_HZ, **columns}
        notes.append(f"no time column: rows are {1000 / RATE_HZ:g} ms apart, as published")
    if unknown:
        notes.append(f"{UNKNOWN}{', '.join(unknown)}")
    if left := [name for name in present if name in _SIMULATED]:
        notes.append(f"published columns without a place in the contract were left out: {', '.join(left)}")
    simulated = [c for c in (*PROCESS, *OPTIONAL) if c in columns]
    if simulated:
        notes.append(f"simulated or optional columns in the file: {', '.join(simulated)}")
    return Recording(part=PartInfo(part=path.stem, machine=machine), columns=columns, notes=tuple(notes))


def _may_be_time(name: str) -> bool:
    """Whether a column may be the time under another name: timestamp, Time [s], Zeit, t_ms, T."""
    first = re.split(r"[^a-z]", name.lower(), maxsplit=1)[0]
    return any(word in name.lower() for word in ("time", "zeit", "stamp", "clock")) or first in _CLOCKS


READER = Reader(
    name="published 50 Hz CSV",
    layout="a .csv with columns such as pos_x, v_x, a_x, curr_x",
    recognises=_recognises,
    read=_read,
)
