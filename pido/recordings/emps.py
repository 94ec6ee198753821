"""EMPS, a servo axis with ball screw (Janot, Gautier, Brunot; nonlinearbenchmark.org): MATLAB file, 1 kHz.

In:  a .mat with qm (m), vir (V), gtau (N/V) and t (s).
Out: a Recording with the one axis x: pos_x in mm, and as its current the drive force vir * gtau in N. A force is
     proportional to the current behind it; the unit is the note's, and figures in "A" of this recording are newtons.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.io import loadmat, whosmat

from pido.core.errors import RecordingError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings.reader import Reader, head, of_machine

_NEEDED = ("qm", "vir", "gtau", "t")
_UNREADABLE = (ValueError, TypeError, OSError, NotImplementedError, KeyError)  # what scipy raises on damaged files


def _recognises(path: Path) -> bool:
    return path.is_file() and path.suffix.lower() == ".mat" and head(path, 6) == b"MATLAB"


def _read(path: Path, machine: str | None, channels: Mapping[str, str]) -> Recording:
    try:
        names = {name for name, _, _ in whosmat(path)}
        content = loadmat(path, variable_names=_NEEDED)
    except _UNREADABLE as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise  # the disk's, not the file's
        raise RecordingError(f"{path}: cannot be read as a MATLAB file: {error}. Copy it again.") from None
    if missing := [name for name in _NEEDED if name not in names]:
        raise RecordingError(f"{path}: {', '.join(missing)} missing; an EMPS recording has {', '.join(_NEEDED)}.")
    qm, vir, t = (np.asarray(content[name], float).ravel() for name in ("qm", "vir", "t"))
    gain = float(np.asarray(content["gtau"]).ravel()[0])
    machine, assumed = of_machine(machine, "emps", "as published")
    return Recording(
        part=PartInfo(part=path.stem, machine=machine),
        columns={"time": t - t[0], "pos_x": qm * 1000.0, "curr_x": vir * gain},
        notes=(*assumed, f"curr_x is the drive force, voltage x {gain:g} N/V, in N and not in A"),
    )


READER = Reader(name="EMPS", layout="a .mat with qm, vir, gtau and t", recognises=_recognises, read=_read)
