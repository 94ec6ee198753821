"""Samples that a recording lacks, by what they are lacking in.

In:  a Recording. Out: faults of the columns with missing values.
"""

from __future__ import annotations

import numpy as np

from pido.core.columns import CURRENT, OPTIONAL, TIME
from pido.core.machining import Machine
from pido.core.recording import Recording
from pido.recordings.faults import ERROR, WARNING, Fault, at


def missing_values(recording: Recording, machine: Machine | None) -> list[Fault]:
    """One fault for all columns that lack the same samples, as an empty row does; each current has its own: without it
    its axis alone is lost."""
    lacking: dict[bytes, list[str]] = {}
    for name, values in recording.columns.items():
        if name == TIME or values.dtype == object or name in OPTIONAL or np.isfinite(values).all():
            continue
        same = name.encode() if name in CURRENT.values() else (~np.isfinite(values)).tobytes()
        lacking.setdefault(same, []).append(name)
    return [_fault(recording, columns) for columns in lacking.values()]


def _fault(recording: Recording, columns: list[str]) -> Fault:
    bad = ~np.isfinite(recording[columns[0]])
    most = bool(bad.mean() > 0.5)
    them = f"'{columns[0]}' is" if len(columns) == 1 else f"{len(columns)} columns are"
    what = f"{them} missing in {bad.mean():.1%} of the samples."
    advice = "Missing samples are never filled in: " + ("export it again." if most else "they are left out.")
    severity = ERROR if most else WARNING
    return at("missing_value", ", ".join(columns), bad, recording.time, what, advice, severity, mask=True)
