"""Which tool is in the spindle at each sample.

In:  a recording with the column `tool_id`, or with `tool_changes` in its part.json.
Out: the tools' names, by which `tools` of part.json and of a job know them.
"""

from __future__ import annotations

import numpy as np

from pido.core.arrays import Array1D
from pido.core.recording import Recording


def tool_in_spindle(recording: Recording) -> Array1D | None:
    """(n,) text – from the column, else from the changes; '' where there is no tool, or where none is known, as before
    the first change. None where neither was given."""
    if "tool_id" in recording:
        column = recording["tool_id"]
        if column.dtype == object:  # text and empty cells have no order
            names = {value: tool_name(value) for value in set(column)}
            return np.array([names[value] for value in column], dtype=object)
        values, which = np.unique(column, return_inverse=True)
        return np.array([tool_name(value) for value in values], dtype=object)[which]
    changes = sorted(recording.part.tool_changes, key=lambda change: change.t)
    if not changes:
        return None
    names = np.array(["", *(tool_name(change.tool_id) for change in changes)], dtype=object)
    return names[np.searchsorted([change.t for change in changes], recording.time, side="right")]


def tool_name(value: object) -> str:
    """A tool's id as text: 3, 3.0 and '3' are the same tool, a missing value is none.

    >>> tool_name(3.0), tool_name("T4"), tool_name(float("nan"))
    ('3', 'T4', '')
    """
    if value is None or (isinstance(value, float | np.floating) and not np.isfinite(value)):
        return ""
    return str(int(value)) if isinstance(value, float | np.floating) and float(value).is_integer() else str(value)
