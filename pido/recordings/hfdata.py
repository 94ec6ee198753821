"""The layout in which the paper's impeller recordings are published (doi 10.35097/hvvwn1kfwf7qt48z).

In:  a trial's folder with processed_data/<TRIAL>_hfdata.csv, _hfblockevent.csv and _header.csv, or that hfdata.csv.
Out: a Recording: positions and currents by the header's axis names (axis 1 = x, 2 = y, 3 = z, 6 = spindle without a
     header), `nc_line` and `tool_id` from the block events; time from CYCLE, which counts samples of 2 ms.

Trials without encoder positions have the commanded ones instead, with a note.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pido.core.arrays import Array1D, Float1D
from pido.core.errors import RecordingError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings.reader import Reader, csv_header, of_machine, saved_otherwise
from pido.recordings.signals import block_index, hold, hold_names, wanted_signals
from pido.recordings.tables import read_csv

CYCLE_S = 0.002  # 500 samples per second (paper, section IV-A)
_ENDING = "_hfdata.csv"


def _data_file(path: Path) -> Path | None:
    if path.is_file():
        return path if path.name.lower().endswith("hfdata.csv") or "CYCLE" in csv_header(path) else None
    found = [p for folder in (path / "processed_data", path) if folder.is_dir() for p in folder.glob("*hfdata.csv")]
    return sorted(found)[0] if found else None


def _recognises(path: Path) -> bool:
    file = _data_file(path)
    return file is not None and any("|" in name for name in csv_header(file))


def _read(path: Path, machine: str | None, channels: Mapping[str, str]) -> Recording:
    file = _data_file(path)
    if file is None:
        raise RecordingError(f"{path}: no *_hfdata.csv in it or in its processed_data.")
    if path.is_dir() and len(trials := sorted(file.parent.glob("*hfdata.csv"))) > 1:
        names = ", ".join(t.name for t in trials)
        raise RecordingError(f"{path}: holds several trials ({names}). A part is one trial: name its hfdata.csv.")
    present = csv_header(file)
    if "CYCLE" not in present:
        way_out = saved_otherwise(file) or "Without the sample counter there is no time base: export it with CYCLE."
        raise RecordingError(f"{file}: column 'CYCLE' is missing. {way_out}")
    trial = file.name[: -len(_ENDING)] if file.name.lower().endswith(_ENDING) else file.stem
    axis_of, notes = _axes(file.with_name(f"{trial}_header.csv"), present)
    columns, more = wanted_signals(axis_of, channels, file)
    table = read_csv(file, ["CYCLE", *columns.values()])
    counter = table["CYCLE"]
    counted = counter[np.isfinite(counter)]
    if not len(counted):
        raise RecordingError(f"{file}: 'CYCLE' is empty; without the sample counter there is no time base.")
    data: dict[str, Any] = {"time": (counter - counted[0]) * CYCLE_S}
    data |= {name: table[signal] for name, signal in columns.items()}
    data |= _program(file.with_name(f"{trial}_hfblockevent.csv"), counter)
    machine, assumed = of_machine(machine, "cmx600v", "that of the published trials")
    notes = (*assumed, *notes, *more)
    if "nc_line" not in data:
        notes = (
            *notes,
            f"no {trial}_hfblockevent.csv with HFProbeCounter and GCode: the NC block of a sample is unknown",
        )
    part = PartInfo(part=trial, machine=machine)
    return Recording(part=part, columns=data, notes=notes)


def _axes(header: Path, present: list[str]) -> tuple[dict[str, str], tuple[str, ...]]:
    """Signal -> axis name, for the signals that the data file has; by number where the header does not say."""
    signals = {name: name.rsplit("|", 1)[1] for name in present if "|" in name}
    if not header.is_file():
        return signals, (f"no {header.name}: axis 1 = x, 2 = y, 3 = z, 6 = spindle",)
    columns = csv_header(header)
    if not {"SignalName", "Axis"} <= set(columns):
        has = ", ".join(columns)
        raise RecordingError(f"{header}: needs the columns SignalName and Axis, has {has}. {saved_otherwise(header)}")
    table = read_csv(header, [], ["SignalName", "Axis"])
    named = {str(s): str(a) for s, a in zip(table["SignalName"], table["Axis"], strict=True) if s is not None}
    return {name: named.get(name) or number for name, number in signals.items()}, ()


def _program(events: Path, counter: Float1D) -> dict[str, Array1D]:
    """`nc_line` and `tool_id` of each sample, from the block events at or before it; a tool may be a name."""
    if not events.is_file():
        return {}
    present = csv_header(events)
    if not {"HFProbeCounter", "GCode"} <= set(present):
        return {}
    offset, tool = ([name] if name in present else [] for name in ("SeekOffset", "ActiveTool"))
    table = read_csv(events, ["HFProbeCounter", *offset], ["GCode", *tool])
    at = table["HFProbeCounter"]
    known = np.flatnonzero(np.isfinite(at))
    known = known[np.argsort(at[known], kind="stable")]
    offsets = table.get("SeekOffset", np.zeros(len(at)))
    numbers = block_index((repr(offsets[i]), table["GCode"][i]) for i in known)
    columns: dict[str, Array1D] = {"nc_line": hold(list(at[known]), [float(n) for n in numbers], counter)}
    named = [i for i in known if tool and table["ActiveTool"][i] is not None]
    if named:
        names: list[float | str] = [str(table["ActiveTool"][i]) for i in named]
        columns["tool_id"] = hold_names([float(at[i]) for i in named], names, counter)
    return columns


READER = Reader(
    name="hfdata",
    layout="a trial's folder with processed_data/<TRIAL>_hfdata.csv (SIGNAL|n columns, CYCLE), or that file",
    recognises=_recognises,
    read=_read,
)
