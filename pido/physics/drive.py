"""Drive train of an axis: lost motion, ripple, saturation, and how late its loop answers.

In:  ways, positions, currents. Out: the laws, as pure functions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter
from scipy.sparse import csr_array

from pido.core.arrays import Float1D, Float2D, Int1D

MOST_LAGS = 3  # of a loop, equal and of first order
_DIED_AWAY = 0.01  # of an answer: what of it is still to come is left out of its matrix


def lost_motion(since_reversal: Float1D, gap: float, edge: float = 1.0) -> Float1D:
    """Share of a reversal's transient that is left after some way (or time).

        u = exp(-(s / gap)^edge)

    since_reversal : (n,), mm or s, inf before the first reversal; gap : scalar > 0, same unit; edge : – (1 exponential,
    8 nearly a rectangle as long as the gap). Returns (n,), –, in 0..1.

    >>> lost_motion(np.array([0.0, 0.5, 2.0, np.inf]), gap=1.0, edge=8.0).round(2).tolist()
    [1.0, 1.0, 0.0, 0.0]
    """
    return np.exp(-((np.maximum(since_reversal, 0.0) / gap) ** edge))


def wave(pos: Float1D, period: float) -> Float2D:
    """(n, 2) – sine and cosine of a position: together, a wave of any phase.

    pos : (n,), mm; period : scalar > 0, mm.

    >>> wave(np.array([2.5]), period=10.0).round(6).tolist()
    [[1.0, 0.0]]
    """
    angle = 2 * np.pi * pos / period
    return np.column_stack([np.sin(angle), np.cos(angle)])


def periods_of(pos: Float1D, value: Float1D, shortest: float, longest: float, count: int) -> list[float]:
    """Periods over position at which a signal repeats most, strongest first.

    The signal is averaged in bins of position, so that a place where the axis waits counts no more than one it passes;
    a parabola over the travel is taken out. Then follows a periodogram with four points per resolved frequency.

    pos, value : (n,), mm and any unit, finite; shortest, longest : mm, periods; count : how many at most.
    Returns periods in mm, fewer where there are fewer peaks, none where the travel is shorter than two of the shortest.
    Source: Lomb (1976), for evenly spaced bins with weights.

    >>> x = np.linspace(0.0, 40.0, 4000)
    >>> [round(p, 1) for p in periods_of(x, np.sin(2 * np.pi * x / 3.7), 1.0, 20.0, 1)]
    [3.7]
    """
    if len(pos) < 50 or np.ptp(pos) < 2 * shortest:
        return []
    width = shortest / 4
    at = ((pos - pos.min()) / width).astype(int)
    seen = np.bincount(at).astype(float)
    mean = np.bincount(at, value) / np.maximum(seen, 1.0)
    # A bin seen often is known better, but systematic effects do not average out beyond the usual number of passes.
    weight = np.minimum(seen, 4 * np.median(seen[seen > 0]))
    u = np.linspace(-1.0, 1.0, len(seen))
    smooth = np.vander(u, 3)
    root = np.sqrt(weight)
    trend, *_ = np.linalg.lstsq(root[:, None] * smooth, root * mean, rcond=None)
    size = 1 << int(np.ceil(np.log2(4 * len(seen))))
    power = np.abs(np.fft.rfft(weight * (mean - smooth @ trend), size)) ** 2
    frequency = np.fft.rfftfreq(size, width)
    inside = (frequency >= 1 / longest) & (frequency <= 1 / shortest)
    peak = np.zeros(len(power), bool)
    peak[1:-1] = (power[1:-1] >= power[:-2]) & (power[1:-1] > power[2:])
    found = np.flatnonzero(peak & inside)
    best = found[np.argsort(-power[found])][:count]
    return [float(1 / frequency[k]) for k in best]


def best_stretch(pos: Float1D, value: Float1D, low: float, high: float, bins: int = 60) -> tuple[float, float] | None:
    """The stretch of the travel whose mean stands out most from the rest: least squares over all pairs of bin edges.

    pos, value : (n,), mm and any unit, finite; low, high : mm. Returns (from, to) in mm, None without any difference.

    >>> x = np.linspace(0.0, 60.0, 6001)
    >>> best_stretch(x, ((x > 20) & (x < 30)) * 1.0, 0.0, 60.0)
    (20.0, 30.0)
    """
    edges = np.linspace(low, high, bins + 1)
    at = np.clip(np.searchsorted(edges, pos, side="right") - 1, 0, bins - 1)
    seen = np.r_[0.0, np.cumsum(np.bincount(at, minlength=bins))]
    total = np.r_[0.0, np.cumsum(np.bincount(at, value - value.mean(), minlength=bins))]
    first, last = np.triu_indices(bins + 1, k=1)
    n, s = seen[last] - seen[first], total[last] - total[first]
    rest = seen[-1] - n
    gain = np.where((n > 0) & (rest > 0), s**2 * (1 / np.maximum(n, 1) + 1 / np.maximum(rest, 1)), 0.0)
    k = int(np.argmax(gain))
    return None if gain[k] <= 0 else (float(edges[first[k]]), float(edges[last[k]]))


def beyond(current: Float1D, limit: float) -> Float1D:
    """What of a current lies beyond +-limit, with its sign.

    current : (n,), A; limit : scalar >= 0, A. Returns (n,), A.

    >>> beyond(np.array([-5.0, 1.0, 4.0]), 3.0).tolist()
    [-2.0, 0.0, 1.0]
    """
    return np.sign(current) * np.maximum(np.abs(current) - limit, 0.0)


def answered_late(values: Float2D, time: Float1D, tau: float) -> Float2D:
    """Signals behind a first order lag, drawn straight between samples; from rest in the first value after a gap.

        tau * dy/dt + y = u

    values : (k, n); time : (n,), s; tau : scalar > 0, s. Returns (k, n). Source: first-order hold (Franklin, Powell and
    Workman, Digital Control of Dynamic Systems, ch. 6).

    >>> answered_late(np.array([[0.0, 1.0, 1.0, 1.0]]), np.arange(4.0), 1.0).round(3).tolist()
    [[0.0, 0.368, 0.767, 0.914]]
    """
    if len(time) < 2:
        return values
    step, first = _stretches(time)
    left = float(np.exp(-step / tau))
    share = (1 - left) * tau / step
    pieces = np.split(values, first, axis=1)
    late = [lfilter([1 - share, share - left], [1, -left], p, axis=1, zi=share * p[:, :1])[0] for p in pieces]
    return np.concatenate(late, axis=1)


def delayed(values: Float2D, time: Float1D, by: float) -> Float2D:
    """Signals some time late, drawn straight between samples; as in the first value after a gap until then.

        y(t) = u(t - by)

    values : (k, n); time : (n,), s; by : scalar >= 0, s. Returns (k, n).

    >>> delayed(np.array([[0.0, 1.0, 3.0]]), np.arange(3.0), 0.5).tolist()
    [[0.0, 0.5, 2.0]]
    """
    if len(time) < 2:
        return values
    _, first = _stretches(time)
    stretches = np.split(np.arange(len(time)), first)
    pieces = [[np.interp(time[i] - by, time[i], row[i]) for row in values] for i in stretches]
    return np.concatenate([np.array(p).reshape(len(values), -1) for p in pieces], axis=1)


@dataclass(frozen=True)
class Loop:
    """The loop of a drive, by which a current answers late: as many equal lags of first order, one behind another.

    lag : s >= 0, of all together; 0 where it answers at once. lags : 1 and more, how many
    """

    lag: float = 0.0
    lags: int = 1

    def __bool__(self) -> bool:
        return bool(self.lag > 0)

    def answered(self, values: Float2D, time: Float1D) -> Float2D:
        """Signals behind it, as `answered_late` one after another. values : (k, n); time : (n,), s. Returns (k, n).

        >>> Loop(2.0, 2).answered(np.array([[0.0, 1.0, 1.0, 1.0]]), np.arange(4.0)).round(3).tolist()
        [[0.0, 0.135, 0.429, 0.697]]
        """
        for _ in range(self.lags if self else 0):
            values = answered_late(values, time, self.lag / self.lags)
        return values

    def matrix(self, time: Float1D) -> csr_array:
        """(n, n), sparse: `answered(values, time)` is `values @ matrix(time).T` but for a hundredth, for values that
        begin every stretch at zero. time : (n,), s.
        """
        n = len(time)
        if n < 2 or not self:
            return csr_array(np.eye(n))
        step, first = _stretches(time)
        # of equal lags one behind another, less is still to come after the same time
        reach = min(n, 2 + int(np.ceil(np.log(1 / _DIED_AWAY) * self.lag / step)))
        one = np.zeros((1, reach + 1))
        one[0, 1] = 1.0
        answer = self.answered(one, step * np.arange(reach + 1, dtype=float))[0, 1:]
        return _banded(answer, n, first)


AT_ONCE = Loop()


def _banded(answer: Float1D, n: int, first: Int1D) -> csr_array:
    """(n, n) – what an impulse leaves in the rows from its own on, within its own stretch."""
    reach = len(answer)
    since = np.arange(n) - np.repeat(np.r_[0, first], np.diff(np.r_[0, first, n]))
    to = since[:, None] >= np.arange(reach)  # what a row answers to, of those before it, lies in its own stretch
    rows = np.repeat(np.arange(n), to.sum(axis=1))
    lags = np.broadcast_to(np.arange(reach), to.shape)[to]
    return csr_array((answer[lags], (rows, rows - lags)), shape=(n, n))


def _stretches(time: Float1D) -> tuple[float, Int1D]:
    """Time between samples, s, and the first row of every stretch after a gap."""
    steps = np.diff(time)
    step = float(np.median(steps))
    return step, np.flatnonzero(steps > 1.5 * step) + 1
