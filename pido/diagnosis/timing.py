"""Whether the recording lags the simulation: one delay, possibly drifting, that all axes agree on.

In:  the axes of all parts, with simulated currents, and the noise of each.
Out: `Delay`, or None. It competes with the best mechanism of every axis, because an inertia, too, looks like a shifted
     friction: a real shift is the same on all axes, so what it explains there adds up.
Source: maximum likelihood over the delay, whitened; drift by Gauss-Newton on the slope of the simulated current.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from pido.core.arrays import Float1D
from pido.diagnosis.confirm import SIGNIFICANT, even
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.models import shifted
from pido.diagnosis.state import AxisState
from pido.diagnosis.whiten import Noise

_LONGEST_S = 0.5
_LEAST_STEPS = 0.05  # steps of the recording, from which a shift is one
_LEAST_GAIN = 40.0  # of the likelihood, 2 log, over all axes

Pair = tuple[float, float]  # offset in s and drift in s/s, or their standard deviations


@dataclass(frozen=True, eq=False)
class Delay:
    """The recording shows at t what the simulation has at t - offset - drift * t.

    gain : 2 log likelihood over all axes; by_axis : its parts
    """

    offset: float  # s
    drift: float  # s/s
    sd: tuple[float, float]
    gain: float
    by_axis: Mapping[str, float]

    @property
    def axes(self) -> tuple[str, ...]:
        """Those that show it by themselves, the clearest first."""
        clear = sorted(self.by_axis, key=lambda a: -self.by_axis[a])
        return tuple(a for a in clear if stats.chi2.sf(self.by_axis[a], 2) < SIGNIFICANT)


def find_delay(
    axes: Mapping[str, Mismatch], noises: Mapping[str, Noise], rivals: Callable[[], Mapping[str, float]] = dict
) -> Delay | None:
    """The common delay, if it explains more than the best mechanism of each axis does.

    rivals : () -> per axis, 2 log likelihood that the best single mechanism gains; asked of a delay that all else
        speaks for
    """
    with_sim = {a: m for a, m in axes.items() if m.sim is not None and np.ptp(m.sim[m.usable]) > 0}
    if not with_sim:
        return None
    finest = min(s.dt for m in with_sim.values() for s in m.states)
    step = finest * max(m.stride for m in with_sim.values())
    before = {a: _rss(m, noises[a], (0.0, 0.0)) for a, m in with_sim.items()}
    reach = int(np.ceil(_LONGEST_S / step))
    tries = np.unique(np.round(np.r_[np.arange(-4, 5), np.linspace(-reach, reach, min(41, 2 * reach + 1))])) * step
    best = max(((float(d), 0.0) for d in tries), key=lambda d: sum(_gains(with_sim, noises, before, d).values()))
    sd = (0.0, 0.0)
    for drifting in (False, True):
        for _ in range(4):
            best, sd = _step(with_sim, noises, best, drifting, before)
    steady, _ = _steady(with_sim, noises, best, before)
    gains, gains_steady = _gains(with_sim, noises, before, best), _gains(with_sim, noises, before, steady)
    if sum(gains.values()) < sum(gains_steady.values()) + 12.0:
        best, gains, sd = steady, gains_steady, (sd[0], 0.0)
    total = sum(gains.values())
    if total < _LEAST_GAIN:
        return None
    # A shift is the same on all axes: what one gains, and the others lose as clearly, is its own.
    against = -sum(min(g, 0.0) for g in gains.values())
    if sum(g > 0 for g in gains.values()) < 2 and against > _LEAST_GAIN:
        return None
    # So small a part of a sample is what any dynamics beside the simulation's look like, and no clock.
    longest = max(float(s.time[-1]) for m in with_sim.values() for s in m.states)
    if max(abs(best[0]), abs(best[0] + best[1] * longest)) < _LEAST_STEPS * finest:
        return None
    beside = rivals()
    if total < 1.1 * sum(max(0.0, beside.get(a, 0.0)) for a in with_sim):
        return None
    return Delay(best[0], best[1], _as_wide(with_sim, noises, best, sd), total, gains)


def _as_wide(axes: Mapping[str, Mismatch], noises: Mapping[str, Noise], best: Pair, sd: Pair) -> Pair:
    """`sd`, or what makes a 95 % interval reach the delay that even weights find: were the two signals the same but for
    the delay, the weights would not matter (in the spirit of Hausman 1978).
    """
    flat = {a: replace(even(m), level=np.full(m.n, float(np.median(noises[a].level)))) for a, m in axes.items()}
    before = {a: _rss(m, flat[a], (0.0, 0.0)) for a, m in axes.items()}
    other = best
    for _ in range(4):
        other, _ = _step(axes, flat, other, best[1] != 0.0, before)
    offset, drift = (max(s, abs(o - b) / 1.96) for s, o, b in zip(sd, other, best, strict=True))
    return offset, drift


def shift_target(mismatch: Mismatch, delay: Delay) -> Mismatch:
    """The same axis compared with the simulation at the right time."""
    moved = _compared(mismatch, _shifted(mismatch, (delay.offset, delay.drift)))
    return replace(mismatch, target=moved, before_moving=mismatch.target)


def _steady(
    axes: Mapping[str, Mismatch], noises: Mapping[str, Noise], start: Pair, before: Mapping[str, float]
) -> tuple[Pair, Pair]:
    """The best delay that does not drift, and its standard deviation."""
    best, sd = (start[0], 0.0), (0.0, 0.0)
    span = max(float(s.time[-1]) for m in axes.values() for s in m.states)
    best = max(
        ((start[0] + start[1] * span / 2, 0.0), best), key=lambda d: sum(_gains(axes, noises, before, d).values())
    )
    for _ in range(4):
        best, sd = _step(axes, noises, best, False, before)
    return best, sd


def _step(
    axes: Mapping[str, Mismatch], noises: Mapping[str, Noise], at: Pair, drifting: bool, before: Mapping[str, float]
) -> tuple[Pair, Pair]:
    """One Gauss-Newton step, halved until it helps."""
    gram, inner = np.zeros((2, 2)), np.zeros(2)
    for a, m in axes.items():
        moved = _shifted(m, at)
        slope = np.concatenate([np.gradient(moved[i:j], s.time) for s, i, j in _parts(m)])
        time = np.concatenate([s.time for s in m.states])
        rows = noises[a].whiten(np.where(m.usable, np.nan_to_num([slope, slope * time]), 0.0))
        y = noises[a].whiten(_compared(m, moved)[None])[0]
        gram += rows @ rows.T
        inner -= rows @ y
    if not drifting:
        gram, inner = gram[:1, :1], inner[:1]
    inverse = np.linalg.pinv(gram)
    move = inverse @ inner
    sd = np.sqrt(np.maximum(np.diag(inverse), 0.0))
    now = sum(_gains(axes, noises, before, at).values())
    for share in (1.0, 0.5, 0.25):
        new = (at[0] + share * float(move[0]), at[1] + (share * float(move[1]) if drifting else 0.0))
        if sum(_gains(axes, noises, before, new).values()) > now:
            return new, (float(sd[0]), float(sd[1]) if drifting else 0.0)
    return at, (float(sd[0]), float(sd[1]) if drifting else 0.0)


def _gains(
    axes: Mapping[str, Mismatch], noises: Mapping[str, Noise], before: Mapping[str, float], delay: Pair
) -> dict[str, float]:
    return {
        a: int(noises[a].valid.sum()) * float(np.log(before[a] / _rss(m, noises[a], delay))) for a, m in axes.items()
    }


def _rss(mismatch: Mismatch, noise: Noise, delay: Pair) -> float:
    white = noise.whiten(_compared(mismatch, _shifted(mismatch, delay))[None])[0]
    return max(float(white @ white), 1e-30)


def _compared(mismatch: Mismatch, moved: Float1D) -> Float1D:
    """(n,), A – the target as it is when the simulated current is `moved`."""
    return np.where(mismatch.usable, mismatch.target + mismatch.simulated - moved, 0.0)


def _shifted(mismatch: Mismatch, delay: Pair) -> Float1D:
    sim = mismatch.simulated
    if not any(delay):
        return sim
    return np.concatenate([shifted(s.time, sim[i:j], delay) for s, i, j in _parts(mismatch)])


def _parts(mismatch: Mismatch) -> Sequence[tuple[AxisState, int, int]]:
    edges = mismatch.edges
    return [(s, int(i), int(j)) for s, i, j in zip(mismatch.states, edges[:-1], edges[1:], strict=True)]
