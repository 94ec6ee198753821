"""The published 50 Hz milling files (KIT, doi 10.5445/IR/1000157789 and its follow-up): CSV, contract's names.

In:  a .csv with curr_<axis> and pos_ or v_ columns, with or without `time`.
Out: a Recording. Without `time`, rows are 20 ms apart, as their publisher says.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pido.core.columns import ALIASES, CURRENT, OPTIONAL, POSITION, PROCESS, TIME, UNITS, VELOCITY
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings.reader import Reader, csv_header
from pido.recordings.tables import read_csv

RATE_HZ = 50.0
_MOVES = (*POSITION.values(), *VELOCITY.values())


def _recognises(path: Path) -> bool:
    if not path.is_file() or path.suffix.lower() != ".csv":
        return False
    names = set(csv_header(path))
    return any(c in names for c in CURRENT.values()) and any(c in names for c in _MOVES)


def _read(path: Path, machine: str | None, channels: Mapping[str, str]) -> Recording:
    present = csv_header(path)
    known = {name: ALIASES.get(name, name) for name in present if ALIASES.get(name, name) in UNITS}
    left = [name for name in present if name and name not in known and not name.startswith("Unnamed")]
    table = read_csv(path, [name for name in known if name != "tool_id"], ["tool_id"] if "tool_id" in known else [])
    columns = {known[name]: values for name, values in table.items()}
    notes: list[str] = []
    if TIME not in columns:
        n = len(next(iter(columns.values())))
        columns = {TIME: np.arange(n) / RATE_HZ, **columns}
        notes.append(f"no time column: rows are {1000 / RATE_HZ:g} ms apart, as published")
    if left:
        notes.append(f"columns without a place in the contract were left out: {', '.join(left)}")
    simulated = [c for c in (*PROCESS, *OPTIONAL) if c in columns]
    if simulated:
        notes.append(f"simulated or optional columns in the file: {', '.join(simulated)}")
    return Recording(part=PartInfo(part=path.stem, machine=machine or "dmc60h"), columns=columns, notes=tuple(notes))


READER = Reader(
    name="published 50 Hz CSV",
    layout="a .csv with columns such as pos_x, v_x, a_x, curr_x",
    recognises=_recognises,
    read=_read,
)
