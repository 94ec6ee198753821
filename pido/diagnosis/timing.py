"""Whether the recording lags the simulation: one delay, possibly drifting, one in each part or in some, or one from a
moment of a part on, that all axes agree on.

In:  the axes of all parts, with simulated currents, and the noise of each.
Out: `Delay`, or None. It competes with the best mechanism of every axis, because an inertia, too, looks like a shifted
     friction: a real shift is the same on all axes, so what it explains there adds up.
Source: maximum likelihood over the delay, whitened; where it may be, by the cross-correlation of the changes of both
currents. The final numbers by least squares on every row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import signal, stats

from pido.core.arrays import Float1D, Float2D
from pido.diagnosis.clocks import Clock, Form, Likelihood, seen_late, within
from pido.diagnosis.confirm import SIGNIFICANT, even
from pido.diagnosis.lateness import Late, straight
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.steps import Span, drifts_as_well, moment, settled, with_steps, without_idle
from pido.diagnosis.whiten import Noise

_NEAR_S = 0.5  # a shift within which each step is tried
_FARTHEST = 0.5  # of a part, by which it may be shifted
_STRETCHES, _FINER = 5, 15  # of a part, each with a shift of its own to begin with; where a step is looked for
_LEAST_STEPS = 0.05  # steps of the recording, from which a shift is one
_LEAST_GAIN = 40.0  # of the likelihood, 2 log, over all axes


@dataclass(frozen=True)
class Step:
    """From a moment on, one part comes later (or, with a negative size, earlier) than it did before.

    part : its index; time : s; size, sd : s; times : s, the 95 % interval of `time`
    doubtful : whether a clock that drifts, in this part alone, explains as much
    """

    part: int
    time: float
    size: float
    sd: float
    times: Span
    doubtful: bool = False


@dataclass(frozen=True, eq=False)
class Delay:
    """The recording shows at t what the simulation has at t - offset - drift * t, later by each step of its part.

    offsets : per part, s; sds : of each. One that cannot be told from what the other parts have is theirs
    sd : of the offset that most parts have (of the mean, where there is none) and of the drift
    gain : 2 log likelihood over all axes; by_axis : its parts
    form : which of these numbers were free
    """

    offsets: tuple[float, ...]
    drift: float  # s/s
    sd: tuple[float, float]
    gain: float
    by_axis: Mapping[str, float]
    sds: tuple[float, ...]
    form: Form
    steps: tuple[Step, ...] = ()

    @property
    def own(self) -> bool:
        """Whether parts have a shift of their own."""
        return bool(np.ptp(self.offsets))

    @property
    def in_most(self) -> bool:
        """Whether no shift is that of most parts."""
        return len(self.form.own) * 2 >= len(self.offsets) and self.own

    @property
    def offset(self) -> float:
        """s – of most parts; the mean where they differ."""
        return float(_usual(self.form, len(self.offsets)) @ self.offsets)

    @property
    def late(self) -> tuple[int, ...]:
        """The parts that are out of time anywhere."""
        stepped = {s.part for s in self.steps}
        return tuple(k for k, by in enumerate(self.offsets) if by or self.drift or k in stepped)

    @property
    def clock(self) -> Clock:
        return Clock(self.form, np.r_[self.offsets, self.drift, [s.size for s in self.steps]])

    @property
    def axes(self) -> tuple[str, ...]:
        """Those that show it by themselves, the clearest first."""
        clear = sorted(self.by_axis, key=lambda a: -self.by_axis[a])
        numbers = 2 + 3 * len(self.steps)
        return tuple(a for a in clear if stats.chi2.sf(self.by_axis[a], numbers) < SIGNIFICANT)

    def in_a_model(self, parts: Sequence[str]) -> dict[str, Any]:
        """What an `AxisModel` of these parts holds of it."""
        clock = self.clock
        steps = {parts[s.part]: clock.late(s.part).steps for s in self.steps}
        late = dict(zip(parts, self.offsets, strict=True)) if self.own else {}
        return {"delay": (self.offset, self.drift), "late": late, "steps": steps}

    def as_wide_as(self, other: Delay) -> Delay:
        """The same delay, its intervals wider by the way to another estimate of it."""
        offset, drift = self.sd[0] + abs(other.offset - self.offset) / 1.96, self.sd[1]
        sds = zip(self.sds, self.offsets, other.offsets, strict=True)
        return replace(
            self,
            sd=(offset, drift + abs(other.drift - self.drift) / 1.96),
            sds=tuple(sd + abs(b - a) / 1.96 for sd, a, b in sds),
            steps=tuple(_as_wide(a, b) for a, b in zip(self.steps, other.steps, strict=True)),
        )


def _as_wide(step: Step, other: Step) -> Step:
    low, high = (pick(step.times[i], other.times[i]) for i, pick in enumerate((min, max)))
    return replace(step, sd=step.sd + abs(other.size - step.size) / 1.96, times=(low, high))


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
    likelihood = Likelihood(with_sim, noises)
    best, covariance = _found(likelihood)
    gains = likelihood.gains(best)
    total = sum(gains.values())
    if total < _LEAST_GAIN:
        return None
    # A shift is the same on all axes: what one gains, and the others lose as clearly, is its own.
    against = -sum(min(g, 0.0) for g in gains.values())
    if sum(g > 0 for g in gains.values()) < 2 and against > _LEAST_GAIN:
        return None
    # So small a part of a sample is what any dynamics beside the simulation's look like, and no clock.
    finest = min(s.dt for m in with_sim.values() for s in m.states)
    ends = np.array([0.0, max(float(s.time[-1]) for m in with_sim.values() for s in m.states)])
    if not best.form.places and max(np.max(np.abs(late.at(ends))) for late in _lates(best)) < _LEAST_STEPS * finest:
        return None
    beside = rivals()
    if total < 1.1 * sum(max(0.0, beside.get(a, 0.0)) for a in with_sim):
        return None
    return _delay(likelihood, best, covariance, total, gains)


def sharpened(delay: Delay, axes: Mapping[str, Mismatch], noises: Mapping[str, Noise] | None = None) -> Delay:
    """The delay as every row of these axes has it, without what is known to be missing beside it.

    noises : as loud as each axis is, while something may be missing; None: even weights. Weights that listen to what is
        quick listen to what the simulation is between its samples. That nobody knows; by how much the delay is another
        one where it goes straight from one to the next widens the interval.
    """
    noises = {a: even(m) for a, m in axes.items()} if noises is None else noises
    likelihood, lines = Likelihood(axes, noises, fine=True), Likelihood(axes, noises, straight, fine=True)

    def settle(clock: Clock) -> tuple[Clock, Float1D, Float2D]:
        best = settled(likelihood, likelihood.refined(clock)[0])
        other, _ = lines.refined(best)
        spread = likelihood.spread(best)
        # What parts that share a shift would have by themselves is known as well as that of the others.
        each = likelihood.spread(best, replace(best.form, common=False, own=frozenset(range(best.parts))))
        sd = np.sqrt(np.maximum(np.diag(spread), 0.0))
        held = [k for k in range(best.parts) if k not in best.form.own]
        if best.form.own:
            sd[held] = np.sqrt(np.maximum(np.diag(each), 0.0))[held]
        return best, sd + np.abs(other.numbers - best.numbers) / 1.96, spread

    best, sd, spread = settle(delay.clock)
    usual = _others(best)
    told = frozenset(k for k in best.form.own if abs(best.numbers[k] - usual) > 1.96 * sd[k])
    if told != best.form.own and (told or best.form.common or best.form.drift or best.form.places):
        best, sd, spread = settle(_with_own(best, told, usual))
    return _delay(likelihood, best, spread, delay.gain, delay.by_axis, sd)


def shift_target(mismatch: Mismatch, delay: Delay) -> Mismatch:
    """The same axis compared with the simulation at the right time; rows for which nothing is simulated then are not
    used."""
    lates = list(enumerate(_lates(delay.clock)))
    usable = mismatch.usable & np.concatenate([within(mismatch, k, late) for k, late in lates])
    starts = mismatch.starts | ~usable
    starts[1:] |= ~usable[:-1]
    moved = np.concatenate([seen_late(mismatch, k, fine=True)(late) for k, late in lates])
    target = np.where(usable, mismatch.target + mismatch.simulated - moved, 0.0)
    return replace(mismatch, target=target, before_moving=mismatch.target, usable=usable, starts=starts)


def _delay(
    likelihood: Likelihood,
    best: Clock,
    covariance: Float2D,
    gain: float,
    gains: Mapping[str, float],
    sd: Float1D | None = None,
) -> Delay:
    """covariance : of the numbers of `best`; sd : of each of them, where it is more than that"""
    parts = best.parts
    usual = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sd = usual if sd is None else sd
    shares = _usual(best.form, parts)
    of_mean = float(np.sqrt(max(shares @ covariance[:parts, :parts] @ shares, 0.0)) + shares @ (sd - usual)[:parts])
    offsets, each = (tuple(float(v) for v in values[:parts]) for values in (best.numbers, sd))
    steps = tuple(
        Step(k, t, float(size), float(by), moment(likelihood, best, s)[1], drifts_as_well(likelihood, best, k))
        for s, ((k, t), size, by) in enumerate(zip(best.form.places, best.sizes, sd[parts + 1 :], strict=True))
    )
    return Delay(offsets, best.drift, (of_mean, float(sd[parts])), gain, gains, each, best.form, steps)


def _usual(form: Form, parts: int) -> Float1D:
    """(parts,) – shares of each part in the offset of a part that nobody has seen."""
    without = np.array([k not in form.own for k in range(parts)])
    return without / without.sum() if without.sum() * 2 > parts else np.full(parts, 1 / parts)


def _lates(clock: Clock) -> list[Late]:
    return [clock.late(k) for k in range(clock.parts)]


def _found(likelihood: Likelihood) -> tuple[Clock, Float2D]:
    """The delay that explains most for its numbers, and its covariance."""
    parts = likelihood.parts
    alike = [_most_alike(likelihood, k) for k in range(parts)]
    lines = _lines(alike)
    everyone = frozenset(range(parts))
    tries = [Clock.of(Form(common=True), np.full(parts, d)) for d in _tries(likelihood)]
    tries += [_in_common(at) for at in lines if not at.drift]
    steady = likelihood.refined(max(tries, key=likelihood.total))[0]
    lines = [at for at in lines if likelihood.total(at) > 0]

    def best(form: Form, starts: Iterable[Clock]) -> Clock:
        refined = (likelihood.refined(Clock.of(form, at.offsets, at.drift))[0] for at in starts)
        return max(refined, key=likelihood.total)

    drifting = best(Form(True, True), [steady, *map(_in_common, lines)])
    span = max(float(s.time[-1]) for m in likelihood.axes.values() for s in m.states)
    middle = best(Form(True), [Clock.of(Form(), drifting.offsets + drifting.drift * span / 2)])
    steady = max(steady, middle, key=likelihood.total)
    known, with_drift = [likelihood.zero, steady], [drifting]
    if parts > 1:
        without = [at for at in (*tries, *lines) if not at.drift]
        which = np.argmax([likelihood.by_part(at) for at in without], axis=0)
        offsets = np.array([at.offsets for at in without])[which, np.arange(parts)]
        own = best(Form(own=everyone), [Clock.of(Form(), offsets)])
        known += [own, *_told(likelihood, own)]
        both = best(Form(drift=True, own=everyone), [own, *lines])
        with_drift += [both, *_told(likelihood, both)]
    far = [np.unique(_most_alike(likelihood, k, _FINER)[1]) for k in range(parts)]
    near = [[*(at.late(k) for at in tries), *map(Late, far[k])] for k in range(parts)]
    plain = [likelihood.zero, max(known[1:], key=likelihood.value)]
    known += [_told_again(likelihood, with_steps(likelihood, at, near)) for at in plain]
    chosen = max(known, key=likelihood.value)
    with_more = replace(chosen.form, common=len(chosen.form.own) < parts, drift=True)
    more = without_idle(likelihood, likelihood.refined(replace(chosen, form=with_more))[0])
    drift = max([*with_drift, more], key=likelihood.value)
    if likelihood.value(drift) > likelihood.value(chosen):
        # What is near a line that drifts is so from it.
        near = [
            [Late(drift.numbers[k] + by.offset - at.offset, drift.drift) for by in near[k]]
            for k, at in enumerate(_lates(steady))
        ]
        stepped = _told_again(likelihood, with_steps(likelihood, drift, near))
        chosen = max(drift, stepped, key=likelihood.value)
    return likelihood.refined(_merged(likelihood, chosen))


def _merged(likelihood: Likelihood, clock: Clock) -> Clock:
    """The delay with one shift for the parts whose own are the same but for so small a part of a sample as the
    simulation is unknown by between its samples."""
    finest = min(s.dt for m in likelihood.axes.values() for s in m.states)
    longest = max(float(s.time[-1]) for m in likelihood.axes.values() for s in m.states)
    own, form = clock.form.own, clock.form
    if own or form.places:  # beside them, what all parts have has to be as much as it has to be alone
        drift = form.drift and abs(clock.drift) * longest >= _LEAST_STEPS * finest
        common = form.common and (drift or abs(_others(clock)) >= _LEAST_STEPS * finest)
        if (drift, common) != (form.drift, form.common):
            clock = likelihood.refined(replace(clock, form=replace(form, drift=drift, common=common)))[0]
    if not own:
        return clock
    if clock.form.common and len(own) == clock.parts - 1:  # a shift of one part alone is its own
        own = frozenset(range(clock.parts))
        clock = replace(clock, form=replace(clock.form, common=False, own=own))
    usual = float(np.median(clock.offsets)) if len(own) == clock.parts else _others(clock)
    told = frozenset(k for k in own if abs(clock.numbers[k] - usual) >= _LEAST_STEPS * finest)
    if told == own or clock.parts - len(told) < 2:
        return clock
    common = replace(clock, form=replace(clock.form, common=clock.form.common or len(own) == clock.parts))
    return likelihood.refined(_with_own(common, told, usual))[0]


def _told(likelihood: Likelihood, clock: Clock) -> list[Clock]:
    """The delay with shifts of their own only in the parts that are worth the price of one: the others are in time, or
    all as late as the middle one of them."""
    out, form = [], clock.form
    usually = [(_others(clock), True)] if form.common else [(0.0, False)]
    if len(form.own) == clock.parts:
        usually.append((float(np.median(clock.offsets)), True))
    for usual, common in usually:
        start = replace(clock, form=replace(clock.form, common=common))
        total, price = likelihood.total(clock), Form(own=frozenset([0])).price
        alone = {k: likelihood.total(_with_own(start, form.own - {k}, usual, {k})) for k in form.own}
        told = frozenset(k for k, without in alone.items() if total - without > price)
        if not common or len(told) < clock.parts - 1:
            out.append(likelihood.refined(_with_own(start, told, usual))[0])
    return out


def _told_again(likelihood: Likelihood, clock: Clock) -> Clock:
    """The same after a step was found, beside which the parts may need no shift of their own."""
    return max([clock, *(_told(likelihood, clock) if clock.form.own else ())], key=likelihood.value)


def _with_own(clock: Clock, own: frozenset[int], usual: float, which: Iterable[int] | None = None) -> Clock:
    """The delay with the parts not in `own` (those of `which`) at their usual shift."""
    numbers = clock.numbers.copy()
    numbers[[k for k in (range(clock.parts) if which is None else which) if k not in own]] = usual
    return Clock(replace(clock.form, own=own), numbers)


def _others(clock: Clock) -> float:
    """s – of the parts that have no shift of their own."""
    return next((float(clock.numbers[k]) for k in range(clock.parts) if k not in clock.form.own), 0.0)


def _in_common(clock: Clock) -> Clock:
    return Clock.of(Form(True, bool(clock.drift)), np.full(clock.parts, float(np.median(clock.offsets))), clock.drift)


def _tries(likelihood: Likelihood) -> Float1D:
    """s – shifts of all parts that are near."""
    axes = likelihood.axes.values()
    step = min(s.dt for m in axes for s in m.states) * max(m.stride for m in axes)
    reach = int(np.ceil(_NEAR_S / step))
    return np.unique(np.round(np.r_[np.arange(-4, 5), np.linspace(-reach, reach, min(41, 2 * reach + 1))])) * step


def _lines(alike: Sequence[Float2D]) -> list[Clock]:
    """Where the changes of both currents are most alike: in the middle of every stretch of a part, and along a line
    through these shifts (Theil and Sen).

    alike : per part, as `_most_alike` has it
    """
    seconds, shifts = np.transpose(alike, (1, 0, 2))
    own = frozenset(range(len(alike)))
    whole = Clock.of(Form(own=own), np.median(shifts, axis=1))
    drift = float(np.median([stats.theilslopes(y, t)[0] for y, t in zip(shifts, seconds, strict=True)]))
    if not drift:
        return [whole]
    return [whole, Clock.of(Form(drift=True, own=own), np.median(shifts - drift * seconds, axis=1), drift)]


def _most_alike(likelihood: Likelihood, part: int, stretches: int = _STRETCHES) -> Float2D:
    """(2, stretches), s – when, and at which shift the changes of both currents are most alike."""
    total: Float2D | None = None
    for axis, m in likelihood.axes.items():
        alike = _alike(m, part, stretches) / float(np.median(likelihood.noises[axis].level)) ** 2
        total = alike if total is None else total + alike
    assert total is not None
    m = next(iter(likelihood.axes.values()))
    n = (total.shape[1] + 1) // 2
    lags = np.arange(-n + 1, n)
    near = np.abs(lags) <= _FARTHEST * n
    time = m.states[part].time
    middle = time[0] + (np.arange(stretches) + 0.5) / stretches * (time[-1] - time[0])
    return np.array([middle, lags[near][np.argmax(total[:, near], axis=1)] * m.step])


def _alike(m: Mismatch, part: int, stretches: int) -> Float2D:
    """(stretches, 2 n - 1) – products of the changes of recorded and simulated current, summed, at every shift in rows,
    over each stretch of the recording."""
    rows = slice(int(m.edges[part]), int(m.edges[part + 1]))
    use = m.usable[rows]
    seen, sim = (np.diff(np.where(use, v[rows], 0.0)) for v in (m.target + np.nan_to_num(m.simulated), m.simulated))
    follows = use[1:] & use[:-1]
    stretch = stretches * np.arange(len(seen)) // len(seen)
    each = np.where(follows & (stretch == np.arange(stretches)[:, None]), seen, 0.0)
    return signal.correlate(each, np.where(follows, sim, 0.0)[None], method="fft")
