"""What the monitor looks at: recorded minus predicted current, averaged over a short window.

In:  recorded and predicted currents of one part, with tool and NC block of each sample, and how far each sample lies
     from what the model was trained on (`pido.monitoring.doubt`).
Out: PartResiduals; window means of them, whose noise is smaller by the root of the window and which see a load change
     as soon as it has lasted as long as the window.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Array1D, Float1D, Float2D, Int1D
from pido.core.axes import AXES
from pido.core.errors import RecordingError

WINDOW_S = 0.5
"""Shortest change that is to be seen, s."""


@dataclass(frozen=True, eq=False)
class PartResiduals:
    """One part. residual (n, 4), A – recorded minus predicted, NaN where an axis has no recording, the model says
    nothing (no tool engaged), or the sample is masked."""

    part: str
    time: Float1D
    residual: Float2D
    predicted: Float2D
    tool: Array1D  # (n,), identifier of the tool in the spindle, '' where unknown
    block: Int1D  # (n,), index of the NC block, -1 where unknown
    doubt: Float1D | None = None  # (n,), –, distance from the training rows; None: the same everywhere
    inputs: Float2D | None = None  # (n, d), what the model was given; None: the residual is as large in every state
    program: str = ""  # blocks of two parts are the same block only under the same program

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


def window_mean(values: Float1D, width: int) -> Float1D:
    """(n,): mean of the last `width` values up to and including each one; NaN until there are that many, or if any of
    them is NaN.

    >>> window_mean(np.array([1.0, 2.0, 3.0, np.nan, 5.0, 7.0]), 2)
    array([nan, 1.5, 2.5, nan, nan, 6. ])
    """
    bad = ~np.isfinite(values)
    total = np.concatenate([[0.0], np.cumsum(np.where(bad, 0.0, values))])
    faults = np.concatenate([[0], np.cumsum(bad)])
    mean = np.full(len(values), np.nan)
    if len(values) >= width:
        whole = faults[width:] == faults[:-width]
        mean[width - 1 :] = np.where(whole, (total[width:] - total[:-width]) / width, np.nan)
    return mean
