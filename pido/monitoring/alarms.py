"""Alarms of a part: when, where, how large; the same over a whole part and sample by sample.

In:  residuals and a Band.
Out: alarms and a verdict. An alarm lasts from the start of the first window that leaves the band to the end of the
     last one; two that are closer than a window are one.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pido.core.arrays import Bool1D, Float1D
from pido.core.axes import AXES
from pido.monitoring.band import Band, expected_in, standardise
from pido.monitoring.difficulty import features_of
from pido.monitoring.residuals import LEAST_THERE, PartResiduals, window_samples, window_share


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


LEAST_JUDGED = 0.5
"""Share of a part's windows that has to be judged before a part without an alarm is called good."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What can be said of a part. `unwatched` axes have no band or no recording. Of the `windows` that the others would
    have if no value were missing, added up, the share `judged` could be judged. For the share `lost` the recording
    lacks too many values. For the share `too_wide` the band reaches as far as all that the axis draws, on the axes
    `blind` more than half of it. What then remains, `unlike`, is unlike anything that was seen before.

    lacking : axis to the share of its values that the recording lacks, where it lacks any
    """

    part: str
    alarms: tuple[Alarm, ...]
    unwatched: tuple[str, ...]
    windows: int
    judged: float
    lost: float = 0.0
    lacking: Mapping[str, float] = field(default_factory=dict)
    too_wide: float = 0.0
    blind: tuple[str, ...] = ()

    @property
    def unlike(self) -> float:
        """Share of the windows that are unlike anything that was seen before."""
        return 1.0 - self.judged - self.lost - self.too_wide

    @property
    def enough(self) -> bool:
        """Whether so much of the part was judged that silence says something."""
        return self.judged >= LEAST_JUDGED

    @property
    def familiar(self) -> bool:
        """Whether so much of the part is like what was seen that a band may learn from it: a wide one narrows only by
        parts that it could not judge."""
        return self.judged + self.too_wide >= LEAST_JUDGED

    @property
    def good(self) -> bool:
        """No alarm, and enough was judged."""
        return not self.alarms and self.enough


def judge(part: PartResiduals, band: Band) -> Verdict:
    """All alarms of a part, in order of time."""
    alarms: list[Alarm] = []
    watched = [a for a in band.axes if np.isfinite(part.residual[:, AXES.index(a)]).any()]
    width = window_samples(part.rate_hz, band.window_s)
    counts: dict[str, _Count] = {}
    for axis in watched:
        (z, spread), threshold = standardise(part, axis, band), band.axes[axis].threshold
        residual = part.residual[:, AXES.index(axis)]
        there, share = np.isfinite(residual), window_share(residual, width, part.due)
        due = there if part.due is None else part.due
        with np.errstate(invalid="ignore"):
            outside = np.abs(z) > threshold
        known = np.isfinite(z)
        counts[axis] = _Count(
            windows=int(np.isfinite(share).sum()),
            judged=int((known & (outside | band.says(axis, threshold * spread))).sum()),
            known=int(known.sum()),
            lost=int((share < LEAST_THERE).sum()),
            due=int(due.sum()),
            there=int(there.sum()),
        )
        alarms += [_alarm(part, axis, run, z, spread, width) for run in _runs(outside, width)]
    alarms.sort(key=lambda a: a.t_start)
    return _verdict(part.part, alarms, counts)


class Watch:
    """One part, sample by sample: constant work and memory per sample."""

    def __init__(self, band: Band, rate_hz: float, program: str = "") -> None:
        self._band = band
        self._program = program
        self._width = window_samples(rate_hz, band.window_s)
        self._rate_hz = rate_hz
        self._last = {axis: deque[tuple[float, Float1D | None]](maxlen=self._width) for axis in band.axes}
        self._engaged = dict.fromkeys(band.axes, 0)
        self._counts = {axis: _Count() for axis in band.axes}

    def verdict(self, part: str, alarms: Sequence[Alarm]) -> Verdict:
        """What can be said of the part so far, `alarms` being those that were raised."""
        return _verdict(part, alarms, {axis: count for axis, count in self._counts.items() if count.there})

    def push(
        self,
        residual: dict[str, float],
        tool: str,
        block: int,
        states: dict[str, Float1D] | None = None,
        due: bool = False,
    ) -> dict[str, tuple[float, float]]:
        """Axes that are outside the band at this sample, each with its window mean beyond the centre: in spreads, in A.

        residual : per axis, A; NaN (or an axis left out) starts its window afresh, unless it is due
        states : per axis (d + 2,), the sample's row of `difficulty.state`; None: every state counts as the usual one
        due : whether a residual is to be expected here: where there is none, the recording lacks a value
        """
        outside = {}
        for axis, last in self._last.items():
            value = residual.get(axis, np.nan)
            count, there = self._counts[axis], math.isfinite(value)
            if not (there or due):
                last.clear()
                self._engaged[axis] = 0
                continue
            self._engaged[axis] += 1
            count.due += 1
            count.there += there
            last.append((value, None if states is None else states[axis]))
            if len(last) < self._width:
                continue
            # Summed anew: a running sum drifts over a shift, and a window is a few dozen numbers.
            known = [v for v, _ in last if math.isfinite(v)]
            share = len(known) / self._width
            count.windows += 1
            if share < LEAST_THERE:
                count.lost += 1
                continue
            mean = math.fsum(known) / len(known)
            low, high = self._band.limits(axis, tool, block, self._program, *self._expected(axis))
            middle, reach = 0.5 * (low + high), 0.5 * (high - low) / math.sqrt(share)
            low, high = middle - reach, middle + reach
            is_known = math.isfinite(low)
            passed = low <= mean <= high or not is_known
            count.known += is_known
            count.judged += not passed or bool(self._band.says(axis, np.array([reach]))[0])
            if not passed:
                beyond = mean - 0.5 * (low + high)
                outside[axis] = (2 * self._band.axes[axis].threshold * beyond / (high - low), beyond)
        return outside

    def _expected(self, axis: str) -> tuple[float, float]:
        """Factor and lean of the window that ends now."""
        band = self._band.axes[axis]
        states = [state for _, state in self._last[axis] if state is not None]
        if len(states) < self._width or (band.difficulty is None and band.lean is None):
            return 1.0, 0.0
        states = [state for state in states if np.isfinite(state).all()]
        if len(states) / self._width < LEAST_THERE:
            return math.nan, math.nan
        features = features_of(np.array(states), self._engaged[axis] / self._rate_hz)
        lean, factor = expected_in(features, band.difficulty, band.lean)
        return float(factor[0]), float(lean[0])


@dataclass(slots=True)
class _Count:
    """Of one axis: windows; those that were judged, those that are like something that was seen, and those lost for
    want of values; values due, and there."""

    windows: int = 0
    judged: int = 0
    known: int = 0
    lost: int = 0
    due: int = 0
    there: int = 0


def _verdict(part: str, alarms: Sequence[Alarm], counts: Mapping[str, _Count]) -> Verdict:
    windows = sum(c.windows for c in counts.values())
    judged, lost, known = (sum(getattr(c, name) for c in counts.values()) for name in ("judged", "lost", "known"))
    of = max(windows, 1)
    return Verdict(
        part,
        tuple(alarms),
        tuple(axis for axis in AXES if axis not in counts),
        windows,
        judged / of,
        lost / of,
        {axis: 1.0 - c.there / c.due for axis, c in counts.items() if c.there < c.due},
        (known - judged) / of,
        tuple(a for a in AXES if a in counts and counts[a].known - counts[a].judged > 0.5 * counts[a].windows),
    )


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


def _alarm(part: PartResiduals, axis: str, run: slice, z: Float1D, spread: Float1D, width: int) -> Alarm:
    worst = run.start + int(np.nanargmax(np.abs(z[run])))
    tool, block = str(part.tool[worst]), int(part.block[worst])
    first = max(0, run.start - width + 1)
    return Alarm(
        part=part.part,
        axis=axis,
        t_start=float(part.time[first]),
        t_end=float(part.time[run.stop - 1]),
        tool=tool,
        block=block,
        size_a=float(z[worst] * spread[worst]),
        spreads=float(z[worst]),
    )
