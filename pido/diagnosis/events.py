"""What comes and goes by itself: forces over intervals of time, and waves in time, that no state explains.

In:  what is left of the mismatch, whitened, per part.
Out: `ExternalForce`, one level per interval, which belongs to the parts it was seen in and is never carried to another;
     `Rhythm`, a wave.
Source: circular binary segmentation (Olshen et al. 2004): the interval with the largest likelihood gain is taken,
removed, and the search repeated while the gain pays for two ends and a level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.stats import chi2, norm
from scipy.stats import t as student

from pido.core.arrays import Bool1D, Float1D, Float2D, Int1D
from pido.diagnosis.mechanisms.base import Mechanism, Parameter
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.state import AxisState
from pido.diagnosis.whiten import HUBER, Noise

_BINS = 300  # per part, in which ends of intervals are searched
_MOST_PER_PART = 4
_LONGEST_SHARE = 0.6  # of a part: a longer stretch is a level of that part, not an event
_WHOLE = 0.8  # of an interval, and of a stand: they are the same
_AS_MODELLED = 1.5  # times what independent rows scatter by
_AS_KNOWN = 20  # degrees of freedom, with which the model of the noise says how much levels scatter
_AROUND_S = 2.0  # s, over which it is heard how loud noise is
_BESIDE = 4  # lengths of an interval on either side of it, in which noise is as loud and as slow as within
_FEWEST_LIKE = 8  # stretches in the same state, from which it is seen how much their levels scatter anyway


@dataclass(frozen=True)
class ExternalForce(Mechanism):
    """One level per interval of time."""

    intervals: tuple[tuple[str, float, float], ...]  # (part, from s, to s)

    id: ClassVar[str] = "external_force"
    equation: ClassVar[str] = "dI = F(t), piecewise constant: F_n over the n-th interval, added where two overlap"
    kind: ClassVar[Any] = "missing_physics"
    passes_loop: ClassVar[bool] = False
    summary: ClassVar[str] = "{axis} axis, over single intervals of time"
    shape: ClassVar[tuple[Parameter, ...]] = ()
    looked_at: ClassVar[int] = 3_000  # intervals that do not overlap much: ten lengths of each bin

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return tuple(Parameter(f"F_{i + 1}", "A") for i in range(len(self.intervals)))

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        return np.column_stack(
            [
                ((state.time >= start) & (state.time < end) if part == state.part else np.zeros(len(state.time)))
                for part, start, end in self.intervals
            ]
        ).astype(float)


@dataclass(frozen=True)
class Rhythm(Mechanism):
    """A wave in time, tied to no state; its phase runs on from part to part where the machine's clock is known."""

    clock: bool

    id: ClassVar[str] = "unknown"
    equation: ClassVar[str] = "dI = A * sin(2 pi t / T) + B * cos(2 pi t / T)"
    kind: ClassVar[Any] = "unexplained"
    looked_at: ClassVar[int] = 10_000  # frequencies
    amplitudes: ClassVar[tuple[Parameter, ...]] = (Parameter("A", "A"), Parameter("B", "A"))
    shape: ClassVar[tuple[Parameter, ...]] = (Parameter("T", "s", low=1e-3, high=1e5, scale="log"),)

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        time = state.clock if self.clock and state.clock is not None else state.time
        phase = 2 * np.pi * np.asarray(time, float) / shape["T"]
        return np.column_stack([np.sin(phase), np.cos(phase)])

    def conditions(self, axis: str, shape: dict[str, float]) -> tuple[str, tuple[str, ...]]:
        return f"all the time, repeating every {shape['T']:.3g} s whatever the axes do", ()


def find_rhythms(mismatch: Mismatch, noise: Noise, residual: Float1D, most: int = 2) -> list[tuple[Rhythm, float]]:
    """Waves that stand out of `residual` (whitened, (n,)): (wave, period in s), strongest first.

    The gains of the parts, each with a phase of its own, are added up per frequency; whether the phases agree is
    for the
    fit to say.
    """
    bounds = list(zip(mismatch.edges[:-1], mismatch.edges[1:], strict=True))
    longest = max(j - i for i, j in bounds)
    size = 2 * int(2 ** np.ceil(np.log2(longest)))
    gain = np.zeros(size // 2 + 1)
    for i, j in bounds:
        gain += 2 * np.abs(np.fft.rfft(residual[i:j], size)) ** 2 / max(1, j - i)
    frequency = np.fft.rfftfreq(size, mismatch.step)
    gain[frequency * mismatch.step * longest < 3] = 0.0  # fewer than three waves are a drift
    # Sum of chi-squares with two degrees of freedom per part; the largest of many frequencies.
    least = chi2.isf(1e-4 / len(gain), 2 * len(bounds))
    found: list[tuple[Rhythm, float]] = []
    clocked = all(s.clock is not None for s in mismatch.states)
    for _ in range(most):
        k = int(np.argmax(gain))
        if gain[k] < least:
            break
        found += [(Rhythm(clock), 1 / float(frequency[k])) for clock in ((True, False) if clocked else (False,))]
        gain[max(0, k - 4) : k + 5] = 0.0
    return found


def find_events(mismatch: Mismatch, noise: Noise, residual: Float1D) -> ExternalForce | None:
    """Intervals whose level stands out of `residual` (whitened, (n,)), or None."""
    # A constant c becomes c * (1 - sum of ar) / (level * innovation) once whitened.
    unit = noise.valid * (1 - float(np.sum(noise.ar))) / (noise.level * noise.innovation)
    loud = _loudness(mismatch, residual)
    unit, residual = unit / loud, residual / loud
    penalty = charge(mismatch)
    found: list[tuple[int, int, int]] = []
    for p, (i, j) in enumerate(zip(mismatch.edges[:-1], mismatch.edges[1:], strict=True)):
        width = max(1, (j - i) // _BINS)
        bins = np.arange(j - i) // width
        score = np.bincount(bins, residual[i:j] * unit[i:j]).astype(float)
        weight = np.bincount(bins, unit[i:j] ** 2).astype(float)
        for _ in range(_MOST_PER_PART):
            best = _best_interval(score, weight)
            if best is None or best[2] < penalty:
                break
            first, last, _, level = best
            found.append((p, int(i) + first * width, min(int(i) + last * width, int(j))))
            score[first:last] -= level * weight[first:last]
    stands, intervals = _stands(mismatch), []
    found = [f for f in found if not _is_one_stand(stands, *f[1:])]
    for p, first, last in _unlike_others(mismatch, noise, residual, found, float(np.sqrt(penalty))):
        time, i = mismatch.states[p].time, int(mismatch.edges[p])
        intervals.append((mismatch.parts[p], float(time[first - i]), float(time[last - 1 - i]) + 1e-9))
    return ExternalForce(tuple(intervals)) if intervals else None


def _loudness(mismatch: Mismatch, residual: Float1D) -> Float1D:
    """(n,) – what noise scatters by around a row about its mean there, where that is more than 1."""
    rows, out = max(3, round(_AROUND_S / mismatch.step)), np.ones(len(residual))
    for i, j in zip(mismatch.edges[:-1], mismatch.edges[1:], strict=True):
        here = np.clip(residual[i:j], -HUBER, HUBER)  # a force begins and ends with a peak
        mean, square = (uniform_filter1d(x, min(rows, j - i), mode="nearest") for x in (here, here**2))
        out[i:j] = np.sqrt(np.maximum(1.0, square - mean**2))
    return out


def _stands(mismatch: Mismatch) -> Int1D:
    """(n,) – number of the stand, from a stop of the axis to its next motion, that a row is in; 0 in none."""
    stands = np.concatenate([~s.moving for s in mismatch.states])
    begins = stands & np.r_[True, ~stands[:-1] | (mismatch.part[1:] != mismatch.part[:-1])]
    return np.cumsum(begins) * stands


def _is_one_stand(stands: Int1D, first: int, last: int) -> bool:
    """Whether an interval is one stand. While an axis stands, its friction holds any current up to its own size, and
    what was left when it stopped stays until it moves: that is no force that comes and goes.
    """
    inside = np.bincount(stands[first:last])[1:]
    longest = int(np.argmax(inside)) + 1 if len(inside) else 0
    if longest == 0:
        return False
    shared = int(inside[longest - 1])
    return shared >= _WHOLE * (last - first) and shared >= _WHOLE * int(np.sum(stands == longest))


def _unlike_others(
    mismatch: Mismatch, noise: Noise, residual: Float1D, found: Sequence[tuple[int, int, int]], times: float
) -> list[tuple[int, int, int]]:
    """The intervals (part, first row, end) whose level is so many times what levels scatter by in the same state.

    Noise may be slow where an axis stands or the tool is idle, and white elsewhere: one model of it does not see that.
    It may be louder, and swing more slowly, for some seconds of any state: a level has to stand out of what scatters
    within its own interval and on either side of it, too.
    Where the rows of no interval scatter as the model says, they are what levels are compared with; elsewhere the
    clearest interval is judged first, beside all others. A level that few others are there to compare with has to be
    the clearer (Student's t).
    """
    state = np.concatenate(
        [2 * s.moving + (np.zeros(len(s.time), int) if s.engaged is None else s.engaged) for s in mismatch.states]
    )
    free = noise.valid.astype(bool)
    outside = free.copy()
    for _, first, last in found:
        outside[first:last] = False

    def scatter(interval: tuple[int, int, int], among: Bool1D) -> tuple[float, int]:
        _, first, last = interval
        same = among & (state == np.bincount(state[first:last]).argmax())
        same[first:last] = False
        by_state = _scatter([residual[same]], min(last - first, int(same.sum()) // _FEWEST_LIKE))
        here = _scatter(around(interval), last - first, by_state[0])
        return here if here[0] > by_state[0] else by_state

    def around(interval: tuple[int, int, int]) -> list[Float1D]:
        p, first, last = interval
        reach = _BESIDE * (last - first)
        begin, end = max(int(mismatch.edges[p]), first - reach), min(int(mismatch.edges[p + 1]), last + reach)
        before, after = (residual[i:j][outside[i:j]] for i, j in ((begin, first), (last, end)))
        inside = residual[first:last]
        return [before[::-1], inside - inside.mean(), after]

    by_outside = {interval: scatter(interval, outside) for interval in found}
    left, kept = list(found), []
    while left:
        by = [s if (s := by_outside[each])[0] <= _AS_MODELLED else scatter(each, free) for each in left]
        ratio = [abs(residual[i:j].sum()) / np.sqrt(j - i) / s for (_, i, j), (s, _) in zip(left, by, strict=True)]
        best = int(np.argmax(ratio))
        if norm.isf(student.sf(ratio[best], by[best][1])) <= times:
            break
        kept.append(left.pop(best))
        free[kept[-1][1] : kept[-1][2]] = False
    return sorted(kept)


def _scatter(like: Sequence[Float1D], length: int, usual: float = 1.0) -> tuple[float, int]:
    """What sums over so many rows of stretches scatter by, for independent rows 1, and with how many degrees of freedom
    that is known: few sums say little beside what is `usual` (a variance beside a prior, as Smyth 2004), and beside
    sums over half as many rows: noise that is slower than its model scatters no less over more of them.
    """
    variance, known = usual**2, _AS_KNOWN
    length = max(1, int(length))
    for halvings in range(length.bit_length() - 1, -1, -1):
        sums = np.concatenate([_sums(stretch, length >> halvings) for stretch in like])
        known = _AS_KNOWN + len(sums)
        variance = max(variance, (_AS_KNOWN * variance + float(np.sum(sums**2))) / known)
    return float(np.sqrt(variance)), known


def _sums(values: Float1D, some: int) -> Float1D:
    """(n // some,) – sums over so many values each, of unit variance where the values are independent and have it."""
    return values[: len(values) // some * some].reshape(-1, some).sum(axis=1) / np.sqrt(some)


def charge(mismatch: Mismatch) -> float:
    """Gain that an interval must bring to be one: the largest of all intervals tried is this high by chance alone."""
    return 2 * np.log(0.5 * _BINS**2 * len(mismatch.parts)) + 2.0


def _best_interval(score: Float1D, weight: Float1D) -> tuple[int, int, float, float] | None:
    s, w = np.r_[0.0, np.cumsum(score)], np.r_[0.0, np.cumsum(weight)]
    total = s[None, :] - s[:, None]
    mass = w[None, :] - w[:, None]
    first, last = np.triu_indices(len(s), k=2)
    short = last - first <= _LONGEST_SHARE * len(score)
    first, last = first[short], last[short]
    m = mass[first, last]
    gain = np.where(m > 0, total[first, last] ** 2 / np.maximum(m, 1e-12), 0.0)
    if len(gain) == 0:
        return None
    k = int(np.argmax(gain))
    return int(first[k]), int(last[k]), float(gain[k]), float(total[first[k], last[k]] / max(m[k], 1e-12))
