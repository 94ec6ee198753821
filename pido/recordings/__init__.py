"""Files to `Recording`: one module per format, found by what a file holds, not by what it is called.

In:  a path: a file of a control or a published data set, or a part folder.
Out: a `Recording` in the contract's columns. What was converted or guessed on the way stands in its notes.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pido.core.errors import RecordingError
from pido.core.names import unusable
from pido.core.recording import Recording
from pido.recordings import emps, folder, hfdata, published, sinumerik, smart_mill
from pido.recordings.derive import with_motion
from pido.recordings.reader import Reader, reading, saved_otherwise
from pido.recordings.resample import resample

READERS: tuple[Reader, ...] = (
    folder.READER,
    sinumerik.READER,
    hfdata.READER,
    smart_mill.READER,
    published.READER,
    emps.READER,
)


def recognise(path: Path) -> Reader:
    """The reader of this file or folder.

    Raises RecordingError where there is nothing, or nothing known; UnavailableError where it may not be read.
    """
    path = Path(path)
    with reading(path):
        return _recognised(path)


def _recognised(path: Path) -> Reader:
    if not path.exists():
        raise RecordingError(f"{path}: no such file or folder.")
    if path.is_dir() and not any(path.iterdir()):
        raise RecordingError(f"{path}: the folder is empty. Put recording.parquet and part.json into it.")
    if path.is_file():
        if path.stat().st_size == 0:
            raise RecordingError(f"{path}: the file is empty. Export the recording again.")
        path.open("rb").close()  # readers that cannot open it would say that it is not theirs
    for reader in READERS:
        if reader.recognises(path):
            return reader
    known = "\n".join(f"  {reader.name}: {reader.layout}" for reader in READERS)
    raise RecordingError(f"{path}: not a recording that is known here. {_way_out(path)}Known are:\n{known}")


def _way_out(path: Path) -> str:
    """What to do with a folder of recordings, or where a program on the way has saved a table in its own manner."""
    if path.is_dir():
        held = sum(any(reader.recognises(each) for reader in READERS) for each in path.iterdir())
        return f"The folder holds recordings, {held} of them: give each, as in '{path}/*'. " if held else ""
    return saved_otherwise(path)


def read_recording(
    path: Path,
    *,
    machine: str | None = None,
    channels: Mapping[str, str] | None = None,
    rate_hz: float | None = None,
    spindle_max_deg_s: float | None = None,
) -> Recording:
    """One part's recording.

    machine : identifier for recordings that do not name theirs
    channels : axis of the contract -> axis name in the control's header, e.g. {"sp": "S1"}; defaults in `signals`
    rate_hz : resample to this lower rate (anti-aliased); None keeps every sample
    spindle_max_deg_s : highest speed of the machine's spindle, where it is known (`derive.with_motion`)

    Velocities and accelerations that were not recorded are derived (`derive.with_motion`), and a note says so.
    Raises RecordingError (damaged, incomplete), SettingsError (part.json), or UnavailableError: what the operating
    system refuses to read is no fault of the recording.
    """
    path = Path(path)
    with reading(path):
        recording = recognise(path).read(path, machine, channels or {})
    for what, name in (("part", recording.part.part), ("machine", recording.part.machine)):
        if fault := unusable(name):
            raise RecordingError(f"{path}: the name of its {what} {fault}. Give it another one.")
    recording = with_motion(recording, spindle_max_deg_s)
    return recording if rate_hz is None else resample(recording, rate_hz)
