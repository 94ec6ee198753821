"""What can be wrong with a recording, as a value."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pido.core.arrays import Bool1D, Float1D, Int1D

ERROR, WARNING = "error", "warning"


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault.

    kind : short name, e.g. 'counter_reset'
    column : where; several are joined by ', '
    t_start, t_end : s, first and last sample concerned
    rows : number of samples concerned
    what, advice : what is wrong and what to do, one sentence each
    severity : 'error' – the recording is unusable; 'warning' – usable, the samples in `mask` are left out
    mask : (n,) samples to leave out, or None where the fault concerns the channel and not single samples
    """

    kind: str
    column: str
    t_start: float
    t_end: float
    rows: int
    what: str
    advice: str
    severity: str
    mask: Bool1D | None = field(default=None, repr=False, compare=False)

    def __str__(self) -> str:
        place = ", ".join(filter(None, (self.column, self.samples)))
        return f"{self.severity} {self.kind} ({place}): {self.what} {self.advice}"

    @property
    def samples(self) -> str:
        """How many samples are concerned, and when; nothing where it is the whole column."""
        if self.rows == 0:
            return ""
        if self.rows == 1:
            return f"1 sample at t = {self.t_start:.2f} s"
        return f"{self.rows} samples from t = {self.t_start:.2f} to {self.t_end:.2f} s"

    def as_dict(self) -> dict[str, object]:
        """For machines: everything but the mask."""
        names = ("kind", "column", "t_start", "t_end", "rows", "what", "advice", "severity")
        return {name: getattr(self, name) for name in names}


def at(
    kind: str, column: str, rows: Bool1D | Int1D, time: Float1D, what: str, advice: str, severity: str, *, mask: bool
) -> Fault:
    """A fault of certain samples (mask or indices); `mask` says whether they are to be left out."""
    which = np.zeros(len(time), bool)
    which[rows] = True
    index = np.flatnonzero(which)
    first, last = (float(time[index[0]]), float(time[index[-1]])) if len(index) else (0.0, 0.0)
    return Fault(kind, column, first, last, len(index), what, advice, severity, which if mask else None)


def whole(kind: str, column: str, what: str, advice: str, severity: str) -> Fault:
    """A fault of a whole column or recording."""
    return Fault(kind, column, 0.0, 0.0, 0, what, advice, severity)
