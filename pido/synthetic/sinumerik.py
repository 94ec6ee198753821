"""What a control's Edge app writes: JSON with header, payload and footer, one message per line.

In:  a part made at 500 Hz. Out: one file. Signals, types and message groups are those of a SINUMERIK 840D sl.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from pido.core.arrays import Float1D, Int1D
from pido.core.axes import AXES
from pido.core.columns import CURRENT, POSITION, VELOCITY
from pido.core.errors import SettingsError
from pido.synthetic.drive import CYCLE_S
from pido.synthetic.machine import Produced

NUMBER = {"x": 1, "y": 2, "z": 3, "sp": 6}
NAME = {"x": "X1", "y": "Y1", "z": "Z1", "sp": "SP1"}
FIRST_CYCLE = 5_000_000
ROWS_PER_MESSAGE = 50
START = datetime(2024, 1, 8, 6, 0, tzinfo=UTC)


def signals(produced: Produced) -> dict[str, Float1D]:
    """`SIGNAL|n` in the control's units: mm, mm/s (spindle deg, 1/min), A, N·m, W, %; (n,) each at 500 Hz."""
    _needs_500(produced)
    r, course = produced.recording, produced.course
    out: dict[str, Float1D] = {}
    for axis in AXES:
        k, sp = NUMBER[axis], axis == "sp"
        current = r[CURRENT[axis]]
        command = course.v_sp / 6.0 if sp else course.v[axis] * 60.0
        desired = np.cumsum(course.v_sp) * CYCLE_S if sp else course.pos[axis]
        actual = r[POSITION[axis]]
        speed = r[VELOCITY[axis]]
        torque = current * 1.4
        out |= {
            f"CMD_SPEED|{k}": command,
            f"CURRENT|{k}": current,
            f"TORQUE|{k}": torque,
            f"LOAD|{k}": 100.0 * current / 60.0,
            f"POWER|{k}": torque * (np.radians(speed) if sp else speed * 2 * np.pi / 20.0),
            f"VEL_FFW|{k}": command,
            f"TORQUE_FFW|{k}": np.zeros(len(r)),
            f"ENC_POS|{k}": actual,
            f"DES_POS|{k}": np.mod(desired, 360.0) if sp else desired,
            f"CTRL_DIFF|{k}": np.zeros(len(r)) if sp else desired - actual,
            f"CONT_DEV|{k}": np.zeros(len(r)) if sp else desired - actual,
        }
    return out


def blocks(produced: Produced) -> tuple[Int1D, list[str], Int1D]:
    """(index of the first sample, G-code, tool number) of each executed NC block."""
    course = produced.course
    lines = produced.job.program.split("\n")
    starts = np.flatnonzero(np.diff(course.nc_line, prepend=-1))
    text = [lines[int(course.nc_line[i]) - 1].strip() for i in starts]
    return starts, text, course.tool[starts] + 1


def write_sinumerik(produced: Produced, path: Path) -> Path:
    """Raises SettingsError for a part that was not made at 500 Hz."""
    table = signals(produced)
    n = len(produced.recording)
    rows = np.round(np.column_stack(list(table.values())), 6)
    begin = START + timedelta(seconds=produced.job.start_time_s)
    events: list[tuple[int, dict[str, Any]]] = []
    for at, text, tool in zip(*blocks(produced), strict=True):
        counter = FIRST_CYCLE + int(at)
        events.append((int(at), {"HFBlockEvent": {
            "HFProbeCounter": counter, "Channel": 1, "SeekOffset": _offset(produced, int(at)),
            "SelectedTool": int(tool), "ActiveTool": int(tool), "GCode": text,
            "IpoGC": text.split(" ")[0] if text[:1] == "G" else "G1",
            "ipoReadError": None, "laBuf": 1,
        }}))  # fmt: skip
    for at in range(0, n, 500):
        events.append((at, {"HFTimestamp": {"Time": _iso(begin, at), "HFProbeCounter": FIRST_CYCLE + at}}))
    events.append((0, {"HFCallEvent": {
        "HFProbeCounter": FIRST_CYCLE, "Channel": 1, "SeekOffset": 0, "CallStackLevel": 1,
        "Path": "/_N_MPF_DIR/PROGRAM_MPF",
    }}))  # fmt: skip
    events.sort(key=lambda e: e[0])
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        file.write(b'{\n"Header":\n' + orjson.dumps(_header(produced, list(table), begin), option=orjson.OPT_INDENT_2))
        file.write(b'\n,"Payload":\n[')
        first = True
        e = 0
        for start in range(0, n, ROWS_PER_MESSAGE):
            stop = min(start + ROWS_PER_MESSAGE, n)
            messages = []
            while e < len(events) and events[e][0] < stop:
                messages.append(events[e][1])
                e += 1
            messages.append(
                {"HFData": [[FIRST_CYCLE + start + i, *row] for i, row in enumerate(rows[start:stop].tolist())]}
            )
            for message in messages:
                file.write((b"" if first else b",\n") + orjson.dumps(message))
                first = False
        file.write(b']\n,"Footer":\n' + orjson.dumps({"ErrorMessages": [], "FilePathChain": {
            "Previous": None, "Actual": path.name, "Next": None, "Index": 1, "StreamIndex": None,
        }}) + b"\n}\n")  # fmt: skip
    return path


def _header(produced: Produced, names: list[str], begin: datetime) -> dict[str, Any]:
    axis = {str(number): NAME[a] for a, number in NUMBER.items()}
    listed = [{"Name": "CYCLE", "Type": "INTEGER", "Axis": "Cycle", "Address": "CYCLE"}]
    listed += [{"Name": s, "Type": "DOUBLE", "Axis": axis[s.split("|")[1]], "Address": s} for s in names]
    return {
        "Version": {"outputFileFormatVersion": "1.0", "RecorderVersion": "3.1.0-36"},
        "Format": "DEFAULT",
        "Description": None,
        "MachineInfo": {"MachineName": produced.recording.part.machine, "CFCard": "virtual"},
        "JobDescription": [],
        "SignalListHFData": listed,
        "SignalListExternalData": [],
        "SignalListLFData": [],
        "TimeStamp": begin.isoformat().replace("+00:00", "Z"),
        "CycleTimeMs": CYCLE_S * 1e3,
        "Initial": {"Time": _iso(begin, 0), "HFProbeCounter": FIRST_CYCLE},
        "Metadata": [],
    }


def _iso(begin: datetime, sample: int) -> str:
    return (begin + timedelta(seconds=sample * CYCLE_S)).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _offset(produced: Produced, at: int) -> int:
    """Where the block begins in the program's text."""
    line = int(produced.course.nc_line[at])
    return sum(len(text) + 1 for text in produced.job.program.split("\n")[: line - 1])


def _needs_500(produced: Produced) -> None:
    rate = produced.recording.sample_rate_hz
    if not np.isclose(rate, 1 / CYCLE_S):
        raise SettingsError(
            f"part {produced.job.name} was made at {rate:g} Hz: a control writes 500 Hz. Produce it with rate_hz=500."
        )
