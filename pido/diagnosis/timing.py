"""Whether the recording lags the simulation: one delay, possibly drifting, or one in each part, that all axes agree on.

In:  the axes of all parts, with simulated currents, and the noise of each.
Out: `Delay`, or None. It competes with the best mechanism of every axis, because an inertia, too, looks like a shifted
     friction: a real shift is the same on all axes, so what it explains there adds up.
Source: maximum likelihood over the delay, whitened; drift by Gauss-Newton on the slope of the simulated current; where
it may be, by the cross-correlation of the changes of both currents. The final numbers by least squares on every row,
with a variance over blocks (White 1982).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import signal, stats

from pido.core.arrays import Bool1D, Float1D, Float2D
from pido.diagnosis.confirm import SIGNIFICANT, even
from pido.diagnosis.mismatch import Mismatch, averaged
from pido.diagnosis.models import shifted
from pido.diagnosis.state import AxisState
from pido.diagnosis.whiten import Noise

_NEAR_S = 0.5  # a shift within which each step is tried
_FARTHEST = 0.5  # of a part, by which it may be shifted
_OVERLAP = 0.5  # of the rows of a part, for which something is to be simulated when it is shifted
_STRETCHES = 5  # of a part, each with a shift of its own to begin with
_HELD_S = 0.5  # beyond its ends, for which a simulation is taken to stay as it is there
_LEAST_STEPS = 0.05  # steps of the recording, from which a shift is one
_LEAST_GAIN = 40.0  # of the likelihood, 2 log, over all axes
_GAIN_PER_NUMBER = 12.0  # of the likelihood, 2 log, that a drift is to add, and each further part with its own shift
_TURNS = 4  # of Gauss-Newton

At = Float1D
"""(parts + 1,) – where a delay is looked for: the shift of each part in s, and the drift of all in s/s."""
Moved = Callable[[Float1D, Float1D, tuple[float, float]], Float1D]


@dataclass(frozen=True, eq=False)
class Delay:
    """The recording shows at t what the simulation has at t - offset - drift * t.

    offsets : per part, s; the same in all, or `own` in each
    sd : of the offset (of their mean) and of the drift; sds : of each part's own
    gain : 2 log likelihood over all axes; by_axis : its parts
    """

    offsets: tuple[float, ...]
    drift: float  # s/s
    sd: tuple[float, float]
    gain: float
    by_axis: Mapping[str, float]
    sds: tuple[float, ...] = ()

    @property
    def own(self) -> bool:
        """Whether each part has a shift of its own."""
        return bool(np.ptp(self.offsets))

    @property
    def offset(self) -> float:
        """s – the mean of the parts."""
        return float(np.mean(self.offsets))

    @property
    def at(self) -> At:
        return np.r_[self.offsets, self.drift]

    @property
    def axes(self) -> tuple[str, ...]:
        """Those that show it by themselves, the clearest first."""
        clear = sorted(self.by_axis, key=lambda a: -self.by_axis[a])
        return tuple(a for a in clear if stats.chi2.sf(self.by_axis[a], 2) < SIGNIFICANT)

    def as_wide_as(self, other: Delay) -> Delay:
        """The same delay, its standard deviations wider by the way to another estimate of it."""
        offset, drift = self.sd[0] + abs(other.offset - self.offset) / 1.96, self.sd[1]
        sds = zip(self.sds, self.offsets, other.offsets, strict=True)
        return replace(
            self,
            sd=(offset, drift + abs(other.drift - self.drift) / 1.96),
            sds=tuple(sd + abs(b - a) / 1.96 for sd, a, b in sds),
        )


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
    sought = _Sought(with_sim, noises)
    best, sd = sought.found()
    gains = sought.gains(best)
    total = sum(gains.values())
    if total < _LEAST_GAIN:
        return None
    # A shift is the same on all axes: what one gains, and the others lose as clearly, is its own.
    against = -sum(min(g, 0.0) for g in gains.values())
    if sum(g > 0 for g in gains.values()) < 2 and against > _LEAST_GAIN:
        return None
    # So small a part of a sample is what any dynamics beside the simulation's look like, and no clock.
    finest = min(s.dt for m in with_sim.values() for s in m.states)
    longest = max(float(s.time[-1]) for m in with_sim.values() for s in m.states)
    if max(np.max(np.abs(best[:-1])), np.max(np.abs(best[:-1] + best[-1] * longest))) < _LEAST_STEPS * finest:
        return None
    beside = rivals()
    if total < 1.1 * sum(max(0.0, beside.get(a, 0.0)) for a in with_sim):
        return None
    return _delay(best, sd, total, gains)


def sharpened(delay: Delay, axes: Mapping[str, Mismatch], noises: Mapping[str, Noise] | None = None) -> Delay:
    """The delay as every row of these axes has it, without what is known to be missing beside it.

    noises : as loud as each axis is, while something may be missing; None: even weights. Weights that listen to what is
        quick listen to what the simulation is between its samples. That nobody knows; by how much the delay is another
        one where it goes straight from one to the next widens the interval.
    """
    noises = {a: even(m) for a, m in axes.items()} if noises is None else noises
    sought, straight = _Sought(axes, noises, fine=True), _Sought(axes, noises, _straight, fine=True)
    basis = sought.own if delay.own else sought.drifting if delay.drift else sought.steady
    if delay.own and delay.drift:
        basis = sought.all
    best, _ = sought.refined(delay.at, basis)
    other, _ = straight.refined(best, basis)
    spread = sought.spread(best, basis)
    wider = np.sqrt(np.maximum(np.diag(spread), 0.0)) + np.abs(other - best) / 1.96
    return _delay(best, spread, delay.gain, delay.by_axis, wider)


def shift_target(mismatch: Mismatch, delay: Delay) -> Mismatch:
    """The same axis compared with the simulation at the right time; rows for which nothing is simulated then are not
    used."""
    usable = mismatch.usable & _inside(mismatch, delay.at)
    starts = mismatch.starts | ~usable
    starts[1:] |= ~usable[:-1]
    moved = np.where(usable, _compared(mismatch, _shifted(mismatch, delay.at, fine=True)), 0.0)
    return replace(mismatch, target=moved, before_moving=mismatch.target, usable=usable, starts=starts)


def _delay(best: At, covariance: Float2D, gain: float, gains: Mapping[str, float], sd: At | None = None) -> Delay:
    """covariance : (parts + 1, parts + 1), of `best`; sd : of each of its numbers, where it is more than that"""
    usual = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sd = usual if sd is None else sd
    of_mean = float(np.sqrt(max(np.mean(covariance[:-1, :-1]), 0.0)) + np.mean(sd[:-1] - usual[:-1]))
    offsets, each = (tuple(float(v) for v in values[:-1]) for values in (best, sd))
    return Delay(offsets, float(best[-1]), (of_mean, float(sd[-1])), gain, gains, each)


class _Sought:
    """The delay of some axes under some weights.

    moved : (time, values, delay) -> (n,), the signal as it is seen later; fine : before rows are averaged
    """

    def __init__(
        self, axes: Mapping[str, Mismatch], noises: Mapping[str, Noise], moved: Moved = shifted, fine: bool = False
    ):
        self.axes, self.noises, self.moved, self.fine = axes, noises, moved, fine
        self.parts = len(next(iter(axes.values())).states)
        self.known: dict[tuple[str, bytes], Float1D] = {}
        self.before: dict[str, Float1D] = {}
        self.before |= {a: self._errors(a, np.zeros(self.parts + 1)) for a in axes}
        one = np.r_[np.ones(self.parts), 0.0][:, None]
        self.steady = one
        self.drifting = np.hstack([one, 1.0 - one])
        self.all = np.eye(self.parts + 1)
        self.own = self.all[:, :-1]

    def found(self) -> tuple[At, Float2D]:
        """The delay that explains most for its numbers, and its covariance."""
        lines = self._lines()
        tries = [np.r_[np.full(self.parts, d), 0.0] for d in self._tries]
        tries += map(self._common, lines)
        common = max((at for at in tries if not at[-1]), key=self._total)
        lines = [at for at in lines if self._total(at) > 0]
        steady = self.refined(common, self.steady)
        drifting = self._best([self.refined(at, self.drifting) for at in (steady[0], *map(self._common, lines))])
        span = max(float(s.time[-1]) for m in self.axes.values() for s in m.states)
        middle = np.r_[drifting[0][:-1] + drifting[0][-1] * span / 2, 0.0]
        steady = self._best([steady, self.refined(middle, self.steady)])
        chosen = [(steady, 1), (drifting, 2)]
        if self.parts > 1:
            without = np.array([at for at in (*tries, *lines) if not at[-1]])
            best = np.argmax([self._by_part(at) for at in without], axis=0)
            own = self.refined(np.r_[without[best, np.arange(self.parts)], 0.0], self.own)
            both = self._best([self.refined(at, self.all) for at in (own[0], *lines)])
            chosen += [(own, self.parts), (both, self.parts + 1)]
        return max(chosen, key=lambda found: self._total(found[0][0]) - _GAIN_PER_NUMBER * found[1])[0]

    def _common(self, at: At) -> At:
        return np.r_[np.full(self.parts, float(np.median(at[:-1]))), at[-1]]

    def _best(self, found: Sequence[tuple[At, Float2D]]) -> tuple[At, Float2D]:
        return max(found, key=lambda each: self._total(each[0]))

    def refined(self, at: At, basis: Float2D) -> tuple[At, Float2D]:
        """Gauss-Newton from `at` along `basis`, (parts + 1, q), each step halved until it helps; the covariance is
        that of the last step, were all else as the noise says."""
        at = at * (basis.any(axis=1))
        covariance = np.zeros((len(at), len(at)))
        for _ in range(_TURNS):
            gram, inner = self._normal(at)
            inverse = np.linalg.pinv(basis.T @ gram @ basis)
            move = basis @ (inverse @ (basis.T @ inner))
            covariance = basis @ inverse @ basis.T
            now = self._total(at)
            better = (at + share * move for share in (1.0, 0.5, 0.25))
            new = next((b for b in better if self._total(b) > now), None)
            if new is None:
                break
            at = new
        return at, covariance

    def spread(self, at: At, basis: Float2D) -> Float2D:
        """(parts + 1, parts + 1) – covariance of `at` over blocks, whatever the noise forgets or not."""
        gram, _ = self._normal(at)
        inverse = basis @ np.linalg.pinv(basis.T @ gram @ basis) @ basis.T
        scores = np.sum([self._scores(a, m, at) for a, m in self.axes.items()], axis=0)
        free = max(1, len(scores) - basis.shape[1])
        return len(scores) / free * inverse @ (scores.T @ scores) @ inverse

    def gains(self, at: At) -> dict[str, float]:
        """2 log likelihood over no delay, per axis."""
        return {
            a: int(self.noises[a].valid.sum()) * float(np.log(b.sum() / self._errors(a, at).sum()))
            for a, b in self.before.items()
        }

    def _total(self, at: At) -> float:
        return sum(self.gains(at).values())

    def _by_part(self, at: At) -> Float1D:
        """(parts,) – what each part gains by itself."""
        gains = [
            np.array([self.noises[a].valid[i:j].sum() for _, i, j in _parts(m)])
            * np.log(self.before[a] / self._errors(a, at))
            for a, m in self.axes.items()
        ]
        return np.sum(gains, axis=0)

    def _errors(self, axis: str, at: At) -> Float1D:
        """(parts,) – sum of squares, as if the rows for which nothing is simulated were like the others; no less than
        without a delay where these are most."""
        if (axis, at.tobytes()) in self.known:
            return self.known[axis, at.tobytes()]
        m = self.axes[axis]
        inside = _inside(m, at)
        left = np.where(inside & m.usable, _compared(m, _shifted(m, at, self.moved, self.fine)), 0.0)
        white = self.noises[axis].whiten(left[None])[0]
        each = [slice(i, j) for _, i, j in _parts(m)]
        share = np.array([np.sum(inside[r] & m.usable[r]) / max(1, int(np.sum(m.usable[r]))) for r in each])
        error = np.array([max(float(white[r] @ white[r]), 1e-30) for r in each]) / np.maximum(share, _OVERLAP)
        if axis in self.before:
            error = np.where(share < _OVERLAP, np.maximum(error, self.before[axis]), error)
        self.known[axis, at.tobytes()] = error
        return error

    def _normal(self, at: At) -> tuple[Float2D, Float1D]:
        """Gram matrix and inner products of one step, over all axes."""
        gram, inner = np.zeros((len(at), len(at))), np.zeros(len(at))
        for axis, m in self.axes.items():
            rows, y = self._step_rows(axis, m, at)
            for k, (_, i, j) in enumerate(_parts(m)):
                slope, timed, left = rows[0, i:j], rows[1, i:j], y[i:j]
                gram[k, k] += slope @ slope
                gram[k, -1] += slope @ timed
                gram[-1, k] += slope @ timed
                gram[-1, -1] += timed @ timed
                inner[k] -= slope @ left
                inner[-1] -= timed @ left
        return gram, inner

    def _scores(self, axis: str, m: Mismatch, at: At) -> Float2D:
        """(blocks, parts + 1)"""
        rows, y = self._step_rows(axis, m, at)
        blocks = int(m.block.max()) + 1
        out = np.zeros((blocks, len(at)))
        for k, (_, i, j) in enumerate(_parts(m)):
            out[:, k] = np.bincount(m.block[i:j], rows[0, i:j] * y[i:j], blocks)
        out[:, -1] = np.bincount(m.block, rows[1] * y, blocks)
        return out

    def _step_rows(self, axis: str, m: Mismatch, at: At) -> tuple[Float2D, Float1D]:
        """(2, n) slope of the moved simulation, alone and times t, and (n,) what is left; whitened."""
        moved = _shifted(m, at, self.moved, self.fine)
        use = m.usable & _inside(m, at)
        slope = np.concatenate([np.gradient(moved[i:j], s.time) for s, i, j in _parts(m)])
        time = np.concatenate([s.time for s in m.states])
        rows = np.where(use, np.nan_to_num([slope, slope * time]), 0.0)
        y = np.where(use, _compared(m, moved), 0.0)
        return self.noises[axis].whiten(rows), self.noises[axis].whiten(y[None])[0]

    @cached_property
    def _tries(self) -> Float1D:
        """s – shifts of all parts that are near."""
        step = min(s.dt for m in self.axes.values() for s in m.states) * max(m.stride for m in self.axes.values())
        reach = int(np.ceil(_NEAR_S / step))
        return np.unique(np.round(np.r_[np.arange(-4, 5), np.linspace(-reach, reach, min(41, 2 * reach + 1))])) * step

    def _lines(self) -> list[At]:
        """Where the changes of both currents are most alike, on all axes together: in the middle of every stretch of a
        part, and along a line through these shifts (Theil and Sen).
        """
        seconds, shifts = np.transpose([self._most_alike(k) for k in range(self.parts)], (1, 0, 2))
        whole = np.r_[np.median(shifts, axis=1), 0.0]
        drift = float(np.median([stats.theilslopes(y, t)[0] for y, t in zip(shifts, seconds, strict=True)]))
        return [whole, np.r_[np.median(shifts - drift * seconds, axis=1), drift]] if drift else [whole]

    def _most_alike(self, part: int) -> Float2D:
        """(2, stretches), s – when, and at which shift the changes of both currents are most alike."""
        total: Float2D | None = None
        for axis, m in self.axes.items():
            alike = _alike(m, part) / float(np.median(self.noises[axis].level)) ** 2
            total = alike if total is None else total + alike
        assert total is not None
        m = next(iter(self.axes.values()))
        n = (total.shape[1] + 1) // 2
        lags = np.arange(-n + 1, n)
        near = np.abs(lags) <= _FARTHEST * n
        time = m.states[part].time
        middle = time[0] + (np.arange(_STRETCHES) + 0.5) / _STRETCHES * (time[-1] - time[0])
        return np.array([middle, lags[near][np.argmax(total[:, near], axis=1)] * m.step])


def _alike(m: Mismatch, part: int) -> Float2D:
    """(stretches, 2 n - 1) – products of the changes of recorded and simulated current, summed, at every shift in rows,
    over each stretch of the recording."""
    rows = slice(int(m.edges[part]), int(m.edges[part + 1]))
    use = m.usable[rows]
    seen, sim = (np.diff(np.where(use, v[rows], 0.0)) for v in (m.target + np.nan_to_num(m.simulated), m.simulated))
    follows = use[1:] & use[:-1]
    stretch = _STRETCHES * np.arange(len(seen)) // len(seen)
    each = np.where(follows & (stretch == np.arange(_STRETCHES)[:, None]), seen, 0.0)
    return signal.correlate(each, np.where(follows, sim, 0.0)[None], method="fft")


def _compared(mismatch: Mismatch, moved: Float1D) -> Float1D:
    """(n,), A – the target as it is when the simulated current is `moved`."""
    return np.where(mismatch.usable, mismatch.target + mismatch.simulated - moved, 0.0)


def _straight(time: Float1D, values: Float1D, delay: tuple[float, float]) -> Float1D:
    """As `shifted`, with straight lines between samples."""
    good = np.isfinite(values)
    return np.interp(time - delay[0] - delay[1] * time, time[good], values[good]) if good.any() else values


def _shifted(mismatch: Mismatch, at: At, moved: Moved = shifted, fine: bool = False) -> Float1D:
    """fine : moved before rows are averaged, not after: what means lose between them looks like a part of a shift"""
    sim = mismatch.simulated
    if not at.any():
        return sim
    if fine and mismatch.fine:
        own = zip(mismatch.fine, at[:-1], strict=True)
        late = [moved(time, values, (float(by), float(at[-1]))) for (time, values), by in own]
        return np.concatenate([averaged(values, mismatch.stride) for values in late])
    each = zip(_parts(mismatch), at[:-1], strict=True)
    return np.concatenate([moved(s.time, sim[i:j], (float(late), float(at[-1]))) for (s, i, j), late in each])


def _inside(mismatch: Mismatch, at: At) -> Bool1D:
    """(n,) – rows that fall, when the simulation is moved, within what is simulated; a shift held at the ends of a
    part for less than a second counts as within."""
    out = np.ones(mismatch.n, bool)
    sim = mismatch.simulated
    for (s, i, j), late in zip(_parts(mismatch), at[:-1], strict=True):
        known = s.time[np.isfinite(sim[i:j])]
        if not len(known):
            continue
        source = s.time - late - at[-1] * s.time
        out[i:j] = (source >= known[0] - _HELD_S) & (source <= known[-1] + _HELD_S)
    return out


def _parts(mismatch: Mismatch) -> Sequence[tuple[AxisState, int, int]]:
    edges = mismatch.edges
    return [(s, int(i), int(j)) for s, i, j in zip(mismatch.states, edges[:-1], edges[1:], strict=True)]
