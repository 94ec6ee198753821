"""What the monitor looks at: recorded minus predicted current, averaged over a short window.

In:  recorded and predicted currents of one part, with tool and NC block of each sample, and how far each sample lies
     from what the model was trained on (`pido.monitoring.doubt`).
Out: PartResiduals; window means of them, whose noise is smaller by the root of the window and which see a load change
     as soon as it has lasted as long as the window.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Array1D, Bool1D, Float1D, Float2D, Int1D
from pido.core.axes import AXES
from pido.core.errors import RecordingError

WINDOW_S = 0.5
"""Shortest change that is to be seen, s."""
LEAST_THERE = 0.8
"""A window of which the recording lacks values is judged by the rest where at least this share is there. Its mean is
then less sure, by the root of the share at most (where the residual has no memory), and its band is wider by that."""


@dataclass(frozen=True, eq=False)
class PartResiduals:
    """One part. residual (n, 4), A – recorded minus predicted, NaN where an axis has no recording, the model says
    nothing (no tool engaged), or the sample is masked. Where it is `due` all the same, the recording lacks a value."""

    part: str
    time: Float1D
    residual: Float2D
    predicted: Float2D
    tool: Array1D  # (n,), identifier of the tool in the spindle, '' where unknown
    block: Int1D  # (n,), index of the NC block, -1 where unknown
    doubt: Float1D | None = None  # (n,), –, distance from the training rows; None: the same everywhere
    inputs: Float2D | None = None  # (n, d), what the model was given; None: the residual is as large in every state
    program: str = ""  # blocks of two parts are the same block only under the same program
    due: Bool1D | None = None  # (n,), where a residual was to be expected; None: only where there is one

    def __post_init__(self) -> None:
        n = len(self.time)
        if self.residual.shape != (n, len(AXES)) or self.predicted.shape != (n, len(AXES)):
            raise RecordingError(
                f"part {self.part}: residuals must be ({n}, {len(AXES)}), one row per sample and one column per axis."
            )

    @property
    def rate_hz(self) -> float:
        return float(1.0 / np.median(np.diff(self.time)))


def window_samples(rate_hz: float, window_s: float = WINDOW_S) -> int:
    """Number of samples in a window, at least one."""
    return max(1, round(rate_hz * window_s))


def window_mean(values: Float1D, width: int, due: Bool1D | None = None) -> Float1D:
    """(n,): mean of the last `width` values up to and including each one, of those that are there; NaN as of
    `window_share`, and where fewer than LEAST_THERE of them are.

    >>> window_mean(np.array([1.0, 2.0, 3.0, np.nan, 5.0, 7.0]), 2)
    array([nan, 1.5, 2.5, nan, nan, 6. ])
    """
    there = np.isfinite(values)
    share = window_share(values, width, due)
    count = np.rint(share * width)
    enough = share >= LEAST_THERE
    return np.where(enough, _last(np.where(there, values, 0.0), width) / np.where(enough, count, 1.0), np.nan)


def window_share(values: Float1D, width: int, due: Bool1D | None = None) -> Float1D:
    """(n,): how much of the last `width` values is there; NaN until there are that many, or if any was not due.

    due : (n,), values that belong there, missing or not; None: those that are there
    """
    there = np.isfinite(values)
    whole = _last(there if due is None else due, width) == width
    return np.where(whole, _last(there, width) / width, np.nan)


def _last(values: Float1D | Bool1D, width: int) -> Float1D:
    """(n,): sum of the last `width` values; NaN until there are that many."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    found = np.full(len(values), np.nan)
    if len(values) >= width:
        found[width - 1 :] = total[width:] - total[:-width]
    return found
