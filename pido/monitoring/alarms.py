"""Alarms of a part: when, where, how large; the same over a whole part and sample by sample.

In:  residuals and a Band.
Out: alarms and a verdict. An alarm lasts from the start of the first window that leaves the band to the end of the
     last one; two that are closer than a window are one.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Bool1D, Float1D
from pido.core.axes import AXES
from pido.monitoring.band import Band, standardise
from pido.monitoring.residuals import PartResiduals, window_samples


@dataclass(frozen=True, slots=True)
class Alarm:
    """Something on one axis that the band does not allow."""

    part: str
    axis: str
    t_start: float  # s
    t_end: float  # s
    tool: str
    block: int  # NC block at the worst sample, -1 where unknown
    size_a: float  # A, mean of the residual at the worst window, beyond its centre
    spreads: float  # the same in spreads of this tool and block


@dataclass(frozen=True, slots=True)
class Verdict:
    """A part is good where it has no alarm. `unwatched` axes have no band or no recording."""

    part: str
    good: bool
    alarms: tuple[Alarm, ...]
    unwatched: tuple[str, ...]


def judge(part: PartResiduals, band: Band) -> Verdict:
    """All alarms of a part, in order of time."""
    alarms: list[Alarm] = []
    watched = [a for a in band.levels if np.isfinite(part.residual[:, AXES.index(a)]).any()]
    for axis in watched:
        z = standardise(part, axis, band)
        with np.errstate(invalid="ignore"):
            outside = np.abs(z) > band.threshold
        alarms += [
            _alarm(part, axis, run, z, band) for run in _runs(outside, window_samples(part.rate_hz, band.window_s))
        ]
    alarms.sort(key=lambda a: a.t_start)
    return Verdict(part.part, not alarms, tuple(alarms), tuple(a for a in AXES if a not in watched))


class Watch:
    """One part, sample by sample: constant work and memory per sample."""

    def __init__(self, band: Band, rate_hz: float) -> None:
        self._band = band
        self._width = window_samples(rate_hz, band.window_s)
        self._last = {axis: deque[float](maxlen=self._width) for axis in band.levels}
        self._sum = dict.fromkeys(band.levels, 0.0)

    def push(self, residual: dict[str, float], tool: str, block: int) -> dict[str, float]:
        """Axes that are outside the band at this sample, each with its window mean beyond the centre in spreads.

        residual : per axis, A; NaN (or an axis left out) starts its window afresh
        """
        outside = {}
        for axis, last in self._last.items():
            value = residual.get(axis, np.nan)
            if not np.isfinite(value):
                last.clear()
                self._sum[axis] = 0.0
                continue
            if len(last) == self._width:
                self._sum[axis] -= last[0]
            last.append(value)
            self._sum[axis] += value
            if len(last) < self._width:
                continue
            level = self._band.level(axis, tool, block)
            z = (self._sum[axis] / self._width - level.centre) / level.spread
            if abs(z) > self._band.threshold:
                outside[axis] = z
        return outside


def _runs(outside: Bool1D, join: int) -> list[slice]:
    """Stretches of samples outside; gaps shorter than `join` are closed."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], outside.astype(np.int8), [0]])))
    runs: list[list[int]] = []
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        if runs and start - runs[-1][1] < join:
            runs[-1][1] = int(stop)
        else:
            runs.append([int(start), int(stop)])
    return [slice(*run) for run in runs]


def _alarm(part: PartResiduals, axis: str, run: slice, z: Float1D, band: Band) -> Alarm:
    worst = run.start + int(np.nanargmax(np.abs(z[run])))
    tool, block = str(part.tool[worst]), int(part.block[worst])
    first = max(0, run.start - window_samples(part.rate_hz, band.window_s) + 1)
    return Alarm(
        part=part.part,
        axis=axis,
        t_start=float(part.time[first]),
        t_end=float(part.time[run.stop - 1]),
        tool=tool,
        block=block,
        size_a=float(z[worst] * band.level(axis, tool, block).spread),
        spreads=float(z[worst]),
    )
