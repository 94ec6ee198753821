"""Whether position, speed and acceleration of one axis belong together, sample by sample.

In:  time and the three signals, or those that a recording has.
Out: `Contradictions`: per signal, which samples cannot be true and why; and where a position is displaced after a jump.
How far the three usually disagree (noise, filters, rounding) is read from the data themselves, separately at each place
from how fast the calmer of two signals changes there; what stands far outside is a fault, laid to the rougher signal.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d

from pido.core.arrays import Bool1D, Float1D

_FACTOR = 12.0  # robust deviations that two signals never differ by
_TAIL = 6.0  # times the difference that one sample in ten exceeds
_ROUGH = 3.0  # the same while the axis speeds up or slows down
_EXACT = 1e-6  # of a speed: what rounding and filters make of one that is constant
_EDGE = 2  # steps at either end of a stretch
_NEGLIGIBLE = 1e-2  # of the largest values of a signal: a smaller contradiction does no harm
_SHORT = 0.1  # of the largest accelerations: a shorter pulse may be this far from the change of speed
_REACH = 3  # samples to either side that a filter in the control may delay or blur one signal against another
_LATE = 1.5  # steps that a clock may be wrong by
COARSE_S = 0.03  # speed comes and goes in less: a record with longer steps cannot contradict what it shows
_FAR_BEYOND = 10.0  # times what one speed in a thousand differs by from its neighbours
_QUARTER = 0.3186  # of a normal deviation, below which a quarter of all absolute values are
_SIDES = 0.3  # of what the speed differs from an acceleration, below which the position belongs to it
_UNEXPLAINED = 0.5  # of a difference: a cause that leaves more of it is none
_NO_DRIVE = 2.0  # times the largest acceleration and change of speed elsewhere: no drive does that for a sample or two
_FROZEN_S, _FROZEN_ROWS = 0.3, 8  # a signal that repeats itself to the last digit for so long may be frozen
_MORE = 3.0  # times what any stretch of the same length loses elsewhere
_SEVERAL = 10  # lengths of a stretch, fewer of which do not say what is usual
_MOSTLY = 0.5  # of what is lost in a stretch
_SOME_TIME = 0.4  # of a stretch, for which an axis moves whose position is frozen
_ROUNDED = 3.0  # steps of rounding that a change from sample to sample may be off by
_GRAINS = 20.0  # steps of a rounded position that a frozen signal must have missed
_ONE_FAULT_S = 0.1  # contradictions closer than this are one fault
_RETURNS = 0.2  # of a jump, by which one that takes it back may miss it
_SPIKE_S = 1.0  # a displacement that returns within this is a spike; a longer one leaves its differences right
_GOOD_PART = 0.25  # of what a spike of acceleration says, that a change of speed which is not there does not reach
_LITTLE = 0.1  # of the change of speed in a turn, by which an acceleration that a filter spread may miss it
_FEWEST = 50
_ENOUGH = 20_000  # values that a median is taken of

JUMP, SPIKE, FROZEN = (
    "jump that the speed does not explain",
    "spike against its neighbours",
    "frozen while the axis moves",
)


@dataclass
class Contradictions:
    """Rows (n,) per reason and signal: 'pos', 'v', 'a'. displaced : position off by a constant after a jump."""

    pos: dict[str, Bool1D] = field(default_factory=dict)
    v: dict[str, Bool1D] = field(default_factory=dict)
    a: dict[str, Bool1D] = field(default_factory=dict)
    displaced: Bool1D = field(default_factory=lambda: np.zeros(0, bool))


def contradictions(
    time: Float1D, pos: Float1D | None, v: Float1D | None, a: Float1D | None, known: Bool1D, turn: float | None = None
) -> Contradictions:
    """What cannot be true together.

    time, pos, v, a : (n,), s, mm, mm/s, mm/s² (or deg)
    known : (n,) – rows whose speed is already known to be wrong
    turn : deg after which a spindle's angle begins again; None for a linear axis
    """
    n = len(time)
    out = Contradictions(displaced=np.zeros(n, bool))
    if v is None or n < _FEWEST:
        return out
    step = np.diff(time)
    steady = step < 1.5 * np.median(step)
    suspect = known.copy()
    if pos is not None:
        _position_and_speed(out, time, step, steady, pos, v, a, suspect, turn)
        for rows in out.v.values():
            suspect |= rows
    if a is not None and np.median(step) <= COARSE_S:
        _speed_and_acceleration(out, time, steady, v, a, suspect, pos is not None)
    return out


def _position_and_speed(
    out: Contradictions,
    time: Float1D,
    step: Float1D,
    steady: Bool1D,
    pos: Float1D,
    v: Float1D,
    a: Float1D | None,
    suspect: Bool1D,
    turn: float | None,
) -> None:
    moved, expected = np.diff(pos), 0.5 * (v[1:] + v[:-1]) * step
    gap = _gap(moved, expected, turn)
    use = steady & np.isfinite(gap) & ~suspect[1:] & ~suspect[:-1]
    if use.sum() < _FEWEST:
        return
    expected = expected + _beside_middle(gap / step, np.diff(v), use) * np.diff(v) * step
    gap = _gap(moved, expected, turn)
    moved = moved if turn is None else expected + gap
    gap = np.where(np.isfinite(gap) & steady, gap, 0.0)
    if turn is not None and _deviation(gap[use]) > turn / 20:
        return  # the angle turns too far between two samples to say anything
    rate, speed = gap / step, moved / step
    held = [long_runs(time, np.diff(s) == 0) for s in (pos, v)]
    repeats = np.logical_or(*(_rows(h, len(time)) for h in held))
    # A stretch that repeats itself and contradicts the other signal says nothing about what is usual.
    doubtful = repeats[1:] & (np.abs(rate) > _FACTOR * _deviation(rate[use]))
    use = use & ~doubtful if (use & ~doubtful).sum() >= _FEWEST else use
    usual = _usual(rate[use], (expected / step)[use])
    grain = _grain(pos)
    rounding = _ROUNDED * rounded_to(pos) / float(np.median(step))
    # Both signals have to speed up or slow down: a spike in one of them is no hard motion.
    change = np.minimum(np.abs(np.diff(v) / step), _around(np.abs(np.diff(speed, prepend=0.0) / step)))
    hard = use & (change > _SHORT * float(np.quantile(_few(change[use]), 0.999)))
    usual = max(usual, _in_motion(rate, use & (moved != 0)), _while_hard(rate, hard), rounding)
    # Spread of each signal around a step; a step between the samples i and i + 1 belongs to i + 1.
    rough_pos, rough_v = _spread(speed), _spread(v)[1:]
    # A sample that was taken a step late, or left out, moves the position by what the speed says.
    late = np.where(rough_pos > rough_v, _LATE * np.abs(expected / step), 0.0)
    # Under an acceleration a, the mean speed of a step may be a * dt / 4 beside that of its ends.
    hardest = np.zeros(len(step)) if a is None else np.maximum(np.abs(a[1:]), np.abs(a[:-1]))
    limit = usual + np.minimum(rough_pos, rough_v) + late + np.nan_to_num(hardest) * step / 4
    bad = (np.abs(rate) > limit) & steady & ~suspect[1:] & ~suspect[:-1]
    let_go = _let_go(pos, gap, bad)
    # What a position that let go had lost is explained: a constant speed beside it is not frozen.
    rest, lost_elsewhere = np.where(let_go[:-1], 0.0, gap), _lost_elsewhere(gap, use)
    for name, stretches in zip(("pos", "v"), held, strict=True):
        frozen = np.zeros(len(time), bool)
        for i, j in stretches:
            # Without the steps in which one signal begins or ends a move before the other.
            inner = slice(i + _EDGE, max(j - _EDGE, i + _EDGE + 1))
            lost, way = float(np.ptp(np.cumsum(rest[inner]))), float(np.sum(np.abs(rest[inner])))
            size = float(np.sqrt(np.mean((rest[inner] / step[inner]) ** 2)))
            # A position that hung catches up; one that does not stood still, and a speed beside it is wrong a while.
            # Beside a speed that stayed as it was, a position that moved in a step or two jumped.
            if name == "v":
                hung = _of_two_steps(rest[inner]) < _MOSTLY * lost
            else:
                hung = _spread_out(rest[inner]) > _SOME_TIME or _catches_up(rest, j, lost)
            if (
                hung
                and lost > max(_GRAINS * grain, 0.5 * way)
                and (size > usual / 1.5 or lost > _MORE * lost_elsewhere(inner.stop - inner.start))
            ):
                frozen[i : j + 1] = True
        getattr(out, name)[FROZEN] = frozen
    out.pos[FROZEN] |= let_go
    frozen = out.pos[FROZEN] | out.v[FROZEN]
    bad &= ~(frozen[1:] & frozen[:-1])
    # Where a frozen position lets go it catches up: that jump belongs to the frozen stretch.
    near = np.convolve(frozen, np.ones(3), "same") > 0
    bad &= ~near[1:]
    jump, spike_v = np.zeros(len(time), bool), np.zeros(len(time), bool)
    jumps: list[tuple[int, int, float]] = []
    apart = max(2, int(_ONE_FAULT_S / float(np.median(step))))
    for i, j in runs(_closed(bad, apart)):
        if a is not None and _has_neighbours(i, j, bad) and _like_position(speed, v, a, step, i, j):
            spike_v[i : j + 2] |= np.abs(v[i : j + 2] - _middle(speed)[i : j + 2]) > 0.5 * usual
        elif np.max(rough_pos[i : j + 1]) >= np.max(rough_v[i : j + 1]):
            for way in (bad & (gap > 0), bad & (gap < 0)):
                jumps += [
                    (i + p + 1, i + q + 1, float(np.sum(gap[i + p : i + q + 1]))) for p, q in runs(way[i : j + 1])
                ]
        elif np.median(step) <= COARSE_S and _has_neighbours(i, j, bad):
            spike_v[i : j + 2] |= np.abs(v[i : j + 2] - _calm(v, i, j + 1)) > 0.5 * usual
    if np.median(step) > COARSE_S:
        spike_v |= _unlike_motion(speed, v, a, step, use, usual)
    jumps.sort()
    spike = np.zeros(len(time), bool)
    k = 0
    while k < len(jumps):
        first, last, size = jumps[k]
        back = jumps[k + 1] if k + 1 < len(jumps) else None
        jump[first : last + 1] = True
        if back is not None and abs(back[2] + size) < _RETURNS * abs(size):
            if time[back[0]] - time[first] <= _SPIKE_S:
                jump[first : last + 1] = False
                spike[first : back[1]] = True
            else:
                out.displaced[first : back[0]] = True
                jump[back[0] : back[1] + 1] = True
            k += 1
        elif abs(size) > usual * float(np.median(step)):
            out.displaced[first:] = True
        k += 1
    out.pos[JUMP], out.pos[SPIKE], out.v[SPIKE] = jump, spike, spike_v


def _gap(moved: Float1D, expected: Float1D, turn: float | None) -> Float1D:
    """What the position moved beside what was expected; of an angle, to the nearer side."""
    gap = moved - expected
    return gap if turn is None else (gap + turn / 2) % turn - turn / 2


def _beside_middle(rate: Float1D, change: Float1D, use: Bool1D) -> float:
    """Where between the speeds at its two ends the mean speed of a step is: 0 in the middle, -0.5 the first, 0.5 the
    last, as where a position is the sum of the speeds. It is the same in all steps, and 0 unless that explains most of
    the difference while the axis speeds up or slows down.

    rate, change : (n - 1,) - mean speed by the position beside that of the ends; last speed minus first
    """
    size = np.abs(change)
    hard = use & (size > _SHORT * float(np.quantile(_few(size[use]), 0.999)))
    if hard.sum() < _FEWEST:
        return 0.0
    share = float(np.clip(np.median(rate[hard] / change[hard]), -0.5, 0.5))
    left = np.abs(rate - share * change)[hard]
    explained = all(np.quantile(left, q) < _UNEXPLAINED * np.quantile(np.abs(rate[hard]), q) for q in (0.5, 0.9))
    return share if explained else 0.0


def _spread_out(values: Float1D) -> float:
    """Share of a stretch over which values are spread: 1 for equal ones, nearly 0 for a spike among zeros."""
    square = len(values) * float(np.sum(values**2))
    return float(np.sum(np.abs(values))) ** 2 / square if square > 0 else 0.0


def _of_two_steps(gap: Float1D) -> float:
    """The most that two steps of a stretch lose."""
    return float(np.sum(np.sort(np.abs(gap))[-2:]))


def _catches_up(gap: Float1D, last: int, lost: float) -> bool:
    """Whether the position makes up for most of what it lost in the steps after its sample `last`."""
    return abs(float(np.sum(gap[last : last + _REACH]))) > _MOSTLY * lost


def _let_go(pos: Float1D, gap: Float1D, bad: Bool1D) -> Bool1D:
    """(n,) - identical positions before a `bad` step that gives back what they lost: these are wrong, not the rest."""
    out = np.zeros(len(pos), bool)
    stood = np.diff(pos) == 0
    begins = np.flatnonzero(stood & ~np.r_[False, stood[:-1]])
    for k in np.flatnonzero(stood[:-1] & ~stood[1:] & bad[1:]) + 1:
        i = begins[np.searchsorted(begins, k) - 1]
        lost, given = float(np.sum(gap[i:k])), float(np.sum(gap[k : k + _REACH]))
        if abs(given + lost) < _RETURNS * abs(lost):
            out[i : k + 1] = True
    return out


def _like_position(rate: Float1D, v: Float1D, a: Float1D, step: Float1D, first: int, last: int) -> bool:
    """Whether in a stretch of steps, and beside it, the acceleration is that of the position and not of the speed."""
    around = slice(first - 1, last + 2)
    told = (_middle(np.diff(rate, prepend=rate[:1]) / step), _middle(np.diff(v) / step))
    by_pos, by_v = (float(np.sum(np.square((each - a)[around]))) for each in told)
    return by_pos < _SIDES**2 * by_v


def _middle(of_steps: Float1D) -> Float1D:
    """(n,) – at the samples what (n - 1,) values of the steps between them say."""
    return 0.5 * (np.r_[of_steps[:1], of_steps] + np.r_[of_steps, of_steps[-1:]])


def _around(values: Float1D) -> Float1D:
    """The largest within reach of each."""
    return maximum_filter1d(np.nan_to_num(values), 2 * _REACH + 1)


def _unlike_motion(rate: Float1D, v: Float1D, a: Float1D | None, step: Float1D, use: Bool1D, usual: float) -> Bool1D:
    """(n,) – samples of a coarse record whose speed no step around comes near.

    rate : (n - 1,) – mean speed of each step by the position. Between two samples a speed may come and go, by no more
    than the hardest acceleration makes of it; nor need the two signals be of the same moment.
    """
    # Of the steps that begin or end within reach of a sample, as far as each is known.
    known = np.isfinite(rate) & (step < 1.5 * np.median(step))
    low = minimum_filter1d(np.r_[0.0, np.where(known, rate, -np.inf)], 2 * _REACH, origin=-1)
    high = maximum_filter1d(np.r_[0.0, np.where(known, rate, np.inf)], 2 * _REACH, origin=-1)
    told = np.diff(rate, prepend=0.0) / step if a is None else a[1:]
    told = told[use & np.isfinite(told)]
    if len(told) < _FEWEST:
        return np.zeros(len(v), bool)
    hardest = float(np.quantile(np.abs(_few(told)), 0.999))
    beyond = np.nan_to_num(np.maximum(v - high, low - v))
    core = beyond > usual + hardest * float(np.median(step))
    core[:_REACH] = core[-_REACH:] = False
    out = core.copy()
    for i, j in runs(beyond > 0.5 * usual):
        out[i : j + 1] |= bool(core[i : j + 1].any())
    return out


def _speed_and_acceleration(
    out: Contradictions, time: Float1D, steady: Bool1D, v: Float1D, a: Float1D, suspect: Bool1D, seen: bool
) -> None:
    """Acceleration against the change of speed; seen : the speed was already compared with a position."""
    rate = np.gradient(v, time)  # of a sample beside a missing one there is none
    seen_both = np.isfinite(a) & np.isfinite(rate)
    off = np.where(seen_both, a - rate, 0.0)
    near = _grown(suspect, 2)
    use = np.r_[True, steady] & np.r_[steady, True] & ~near & seen_both
    # A difference at either end of the record is one-sided.
    use[:_EDGE] = use[-_EDGE:] = False
    held = long_runs(time, np.diff(a) == 0)
    if use.sum() < _FEWEST:
        return
    apart = use & ~(_rows(held, len(time)) & (np.abs(off) > _FACTOR * _deviation(off[use])))
    apart = apart if apart.sum() >= _FEWEST else use
    usual = max(_usual(off[apart], rate[apart]), _in_motion(off, apart & (rate != 0)))
    short = _SHORT * float(np.quantile(np.abs(_few(rate[apart])), 0.999))
    least = _EXACT * float(np.nanmax(np.abs(v))) / float(np.median(np.diff(time)))
    usual = max(usual, _while_hard(off, apart & (np.abs(rate) > short)), least)
    frozen = np.zeros(len(time), bool)
    for i, j in held:
        inner = slice(i + _EDGE, max(j + 1 - _EDGE, i + _EDGE + 1))
        if float(np.sqrt(np.mean(off[inner] ** 2 * use[inner]))) > usual / 1.5:
            frozen[i : j + 1] = True
    # Between two samples an acceleration may come and go; only what is large beside all others is a spike.
    usual = max(usual, short)
    # One-sided differences: a central one smooths the shortest moves away.
    v = _filled(v)
    sudden = np.diff(v, prepend=v[:1]) / np.median(np.diff(time))
    rough_a, rough_rate = _spread(a), _spread(sudden)
    bad = (np.abs(off) > usual + np.minimum(rough_a, rough_rate)) & use & ~frozen
    spike_a, spike_v = np.zeros(len(time), bool), np.zeros(len(time), bool)
    swing = np.abs(v - median_filter(v, 2 * _REACH + 1))
    calm = np.isfinite(swing) & ~_grown(bad, _REACH)
    beyond = _FAR_BEYOND * float(np.quantile(swing[calm], 0.999)) if bad.any() and calm.any() else np.inf
    # Beside the samples that contradict each other.
    hardest = max(float(np.nanmax(np.abs(each[calm]), initial=0.0)) for each in (a, sudden)) if calm.any() else np.inf
    for i, j in runs(_closed(bad, 2)):
        if not _has_neighbours(i, j, bad):
            continue
        if np.max(rough_a[i : j + 1]) >= np.max(rough_rate[i : j + 1]):
            if _between_samples(time, v, a, i, j):
                continue
            spike_a[i : j + 1] |= np.abs(off[i : j + 1]) > 0.5 * usual
        else:
            # A speed that follows from a wrong position agrees with it. No drive reaches in a sample or two, and leaves
            # again, what is far beyond every change elsewhere: there the acceleration is right.
            size = np.abs(v[i : j + 1] - _calm(v, i, j))
            no_drive = np.max(np.abs(sudden[i : j + 2])) > _NO_DRIVE * hardest
            if (not seen or size.max() > beyond or no_drive) and not _smoothed(time, v, a, i, j):
                spike_v[i : j + 1] |= size > 0.5 * size.max()
    out.a[FROZEN], out.a[SPIKE] = frozen, spike_a
    if spike_v.any():
        out.v[SPIKE] = out.v.get(SPIKE, np.zeros(len(time), bool)) | spike_v


def _lost_elsewhere(gap: Float1D, use: Bool1D) -> Callable[[int], float]:
    """Length -> the most that stretches of so many steps lose where nothing is amiss; infinite where there are few.

    Noise and rounding do not add up over a stretch: slow motion that a signal missed shows in it, and in no single
    step.
    """
    way, amiss = np.cumsum(np.r_[0.0, gap]), np.cumsum(np.r_[0, ~use])

    @cache
    def most(length: int) -> float:
        lost = np.abs(way[length:] - way[:-length])[amiss[length:] == amiss[:-length]]
        return float(lost.max()) if len(lost) >= _SEVERAL * length else np.inf

    def of(length: int) -> float:
        # Rounded up by a quarter at most: a record may hold thousands of stretches.
        unit = 1 << max(0, length.bit_length() - 3)
        return most(-(-length // unit) * unit)

    return of


def runs(rows: Bool1D) -> list[tuple[int, int]]:
    """First and last index of each uninterrupted stretch."""
    edges = np.flatnonzero(np.diff(np.r_[False, rows, False].astype(np.int8)))
    return [(int(i), int(j) - 1) for i, j in zip(edges[::2], edges[1::2], strict=True)]


def _has_neighbours(first: int, last: int, rows: Bool1D) -> bool:
    """Whether there are samples on both sides to judge a spike by; a record that was smoothed bends at its ends."""
    return first >= _REACH and last < len(rows) - _REACH


def _usual(difference: Float1D, signal: Float1D) -> float:
    """A size that the difference of two signals that belong together never reaches."""
    difference, signal = _few(difference), _few(signal)
    least = _NEGLIGIBLE * float(np.quantile(np.abs(signal), 0.999))
    return max(_FACTOR * _deviation(difference), _TAIL * float(np.quantile(np.abs(difference), 0.9)), least, 1e-9)


def _in_motion(difference: Float1D, rows: Bool1D) -> float:
    """The same while the axis moves: where it stands, a rounded signal does not differ at all."""
    return _FACTOR * _deviation(difference[rows]) if rows.sum() >= _FEWEST else 0.0


def _while_hard(difference: Float1D, rows: Bool1D) -> float:
    """The same in the `rows` in which the axis speeds up or slows down: a measured signal is as rough as its sensor
    there, or as late as its filter, and as it should be for the rest of the time. An axis that seldom moves may be
    faulty in half of these rows: the calmest quarter tells their deviation."""
    if rows.sum() < _FEWEST:
        return 0.0
    calm, most = (float(q) for q in np.quantile(np.abs(difference[rows]), [0.25, 0.9]))
    return min(_ROUGH * most, _FACTOR * calm / _QUARTER)


def rounded_to(values: Float1D) -> float:
    """The step that a signal is rounded to: all its changes are multiples of it, of several sizes; 0 where none is."""
    grain = _grain(values)
    if grain == 0.0:
        return 0.0
    steps = np.abs(np.diff(values[np.isfinite(values)])) / grain
    steps = steps[steps < 1e4]
    sizes = np.round(steps)
    return grain if np.mean(np.abs(steps - sizes) < 0.02) > 0.99 and len(np.unique(sizes)) >= 4 else 0.0


def _grain(values: Float1D) -> float:
    """The smallest change there is."""
    steps = np.abs(np.diff(values[np.isfinite(values)]))
    steps = steps[steps > 1e-7 * float(steps.max(initial=0.0))]
    return float(steps.min()) if len(steps) else 0.0


def _deviation(values: Float1D) -> float:
    few = _few(values)
    return 1.4826 * float(np.median(np.abs(few - np.median(few))))


def _few(values: Float1D) -> Float1D:
    """Evenly spaced values, enough for a quantile."""
    return values[:: 1 + len(values) // _ENOUGH]


def _spread(values: Float1D) -> Float1D:
    """Largest minus smallest value within reach."""
    size = 2 * _REACH + 1
    clean = _filled(values)
    return maximum_filter1d(clean, size) - minimum_filter1d(clean, size)


def _filled(values: Float1D) -> Float1D:
    """Missing samples drawn between their neighbours; zero where there is none."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.nan_to_num(values)
    at = np.arange(len(values))
    return np.interp(at, at[known], values[known])


def _calm(values: Float1D, first: int, last: int) -> float:
    """What a signal is like on both sides of a stretch."""
    return float(np.nanmedian(np.r_[values[max(first - _REACH, 0) : first], values[last + 1 : last + 1 + _REACH]]))


def _smoothed(time: Float1D, v: Float1D, a: Float1D, first: int, last: int) -> bool:
    """Whether a stretch is a fast turn: its speed is between those before and after, and a filter only spread the
    acceleration, which says as much change of speed in all."""
    around = slice(first - _REACH, last + _REACH + 1)
    before, after = v[around][[0, -1]]
    inner, little = v[first : last + 1], _LITTLE * abs(after - before)
    between = inner.min() > min(before, after) - little and inner.max() < max(before, after) + little
    return bool(between and abs(after - before - np.trapezoid(a[around], time[around])) < little)


def _between_samples(time: Float1D, v: Float1D, a: Float1D, first: int, last: int) -> bool:
    """Whether an acceleration that stands out came and went between samples: the speed changes to its side as well, by
    a good part of what it says."""
    around = slice(first - 1, last + 2)
    usual = _calm(a, first, last)
    told = np.trapezoid(a[around] - usual, time[around])
    moved = v[around][-1] - v[around][0] - usual * np.ptp(time[around])
    return bool(moved * told > _GOOD_PART * told**2)


def long_runs(time: Float1D, repeats: Bool1D) -> list[tuple[int, int]]:
    """Stretches that repeat a value for long. repeats : (n - 1,) – steps from one sample to an equal one."""
    found = [(i, j + 1) for i, j in runs(repeats)]
    return [(i, j) for i, j in found if time[j] - time[i] >= _FROZEN_S and j - i + 1 >= _FROZEN_ROWS]


def _rows(stretches: list[tuple[int, int]], n: int) -> Bool1D:
    out = np.zeros(n, bool)
    for i, j in stretches:
        out[i : j + 1] = True
    return out


def _closed(bad: Bool1D, apart: int) -> Bool1D:
    """Gaps of a few samples inside a fault belong to it."""
    out = bad.copy()
    at = np.flatnonzero(bad)
    for i, j in itertools.pairwise(at):
        if j - i <= apart:
            out[i:j] = True
    return out


def _grown(rows: Bool1D, by: int) -> Bool1D:
    return np.convolve(rows, np.ones(2 * by + 1), "same") > 0 if rows.any() else rows
