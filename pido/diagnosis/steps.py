"""Where in a part the recording jumps against the simulation: samples that were lost, or repeated, and nobody noticed.

In:  the `Likelihood` of delays, and a delay without the step.
Out: the delay with a step more, where that is likely enough; when a step was, and how well that is known.
Source: each step by sums of squared errors over all shifts that were tried, from each moment on; its moment then by the
likelihood of every row, with an interval of 95 % as for the change point of a random walk with drift (Siegmund 1988).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy import stats

from pido.core.arrays import Float1D
from pido.diagnosis.clocks import Clock, Form, Likelihood
from pido.diagnosis.confirm import SIGNIFICANT
from pido.diagnosis.lateness import Late

_MOST_STEPS = 4  # in all parts
_NEAREST_S = 1.0  # to another step or to an end of the part: what is nearer is another shift of all that is left
_LEAST_STEPS = 0.5  # of the recording, that are lost or repeated: less is what dynamics look like
_WORTH_TRYING = 24.0  # of the likelihood, 2 log, that a step gains before its size is refined
_EVEN_S = 0.5  # over which gains are summed: a step gains at every change of current that comes after it
_LIKELY = 7.35  # of the likelihood, 2 log, by which a moment in the interval may be worse: (1 - exp(-x / 2))² = 0.95
_SAME = 0.1  # of the largest change, that refining all numbers may make where the step makes none
_ROUNDS = 2  # of size and moment in turn

Span = tuple[float, float]


@dataclass(frozen=True)
class _Start:
    """Of a part: from `time` on, or up to it, the lateness is another one, `by` more; worth `gain`."""

    gain: float
    part: int
    time: float
    by: float
    after: bool


def with_steps(likelihood: Likelihood, clock: Clock, tries: Sequence[Sequence[Late]]) -> Clock:
    """The delay with as many steps as are worth their price; the same where none is.

    tries : per part, the delays without steps that are known to be near
    """
    for _ in range(_MOST_STEPS):
        start = _likeliest(likelihood, clock, tries)
        if start is None:
            return clock
        new = settled(likelihood, likelihood.refined(_with(clock, start))[0])
        new = without_idle(likelihood, new)
        if not (likelihood.value(new) > likelihood.value(clock) and _is_one(likelihood, new, clock, start.part)):
            return clock
        clock = new
    return clock


def without_idle(likelihood: Likelihood, clock: Clock) -> Clock:
    """The delay without the steps that are shorter than a sample, or no more worth their price beside the others."""
    finest = min(s.dt for m in likelihood.axes.values() for s in m.states)
    for s in range(len(clock.sizes) - 1, -1, -1):
        places = (*clock.form.places[:s], *clock.form.places[s + 1 :])
        numbers = np.delete(clock.numbers, clock.parts + 1 + s)
        less, _ = likelihood.refined(Clock(replace(clock.form, places=places), numbers))
        if abs(clock.sizes[s]) < _LEAST_STEPS * finest or likelihood.value(less) > likelihood.value(clock):
            clock = less
    return clock


def settled(likelihood: Likelihood, clock: Clock) -> Clock:
    """The delay with its steps when they are likeliest, and its numbers refined."""
    for _ in range(_ROUNDS if clock.form.places else 0):
        places = tuple((k, moment(likelihood, clock, s)[0]) for s, (k, _) in enumerate(clock.form.places))
        again, _ = likelihood.refined(replace(clock, form=replace(clock.form, places=places)))
        if likelihood.total(again) <= likelihood.total(clock):
            break
        clock = again
    return clock


def moment(likelihood: Likelihood, clock: Clock, step: int) -> tuple[float, Span]:
    """s – when a step was, the median of what its part says, and the interval of 95 %."""
    part, _ = clock.form.places[step]
    late = clock.late(part)
    mine = clock.steps_of(part)
    at = mine.index(step)
    first = late.steps[at - 1][0] if at else -np.inf
    last = late.steps[at + 1][0] if at + 1 < len(mine) else np.inf
    early, never = (
        replace(late, steps=(*late.steps[:at], *then, *late.steps[at + 1 :]))
        for then in (((first, late.steps[at][1]),), ())
    )
    scales = likelihood.scales(clock)
    time = next(iter(likelihood.strips.values()))[part].time
    excess, chance = np.zeros((2, len(time)))  # of a row that is not yet shifted, over one that is; of that, by chance
    for axis, strips in likelihood.strips.items():
        strip = strips[part]
        unmoved, moved = strip.white(never), strip.white(early)
        excess += scales[axis] * (unmoved**2 - moved**2)
        left = np.where(time < late.steps[at][0], unmoved, moved)
        chance += scales[axis] * left * (unmoved - moved)
    rows = np.flatnonzero((time >= first + _NEAREST_S) & (time <= last - _NEAREST_S))
    inner = rows[(time[rows] >= time[0] + _NEAREST_S) & (time[rows] <= time[-1] - _NEAREST_S)]
    if not len(inner):
        return late.steps[at][0], (late.steps[at][0], late.steps[at][0])
    # What is left is no white noise: rows that err together say as little as a few of them.
    together = np.bincount((time - time[0]).astype(int), chance)
    cost = np.cumsum(excess)[inner - 1] / max(1.0, float(together @ together / max(chance @ chance, 1e-300)))
    cost -= cost.min()
    weight = np.cumsum(np.exp(-cost / 2))
    likely = time[inner[cost < _LIKELY]]
    return float(time[inner[np.searchsorted(weight, weight[-1] / 2)]]), (float(likely[0]), float(likely[-1]))


def drifts_as_well(likelihood: Likelihood, clock: Clock, part: int) -> bool:
    """Whether a straight line explains as much, for its numbers, as the steps of a part do: its clock may run at
    another speed, which no form of a delay says of one part alone."""
    alone, late = likelihood.of_part(part), clock.late(part)
    time = next(iter(alone.strips.values()))[0].time
    drift, offset = np.polyfit(time, late.at(time), 1)
    line = alone.refined(Clock.of(Form(True, True), [offset], drift))[0]
    places = tuple((0, t) for t, _ in late.steps)
    form = Form(bool(late.offset), bool(late.drift), places=places)
    stepped = Clock(form, np.r_[late.offset, late.drift, [size for _, size in late.steps]])
    return alone.value(line) > alone.value(stepped)


def _likeliest(likelihood: Likelihood, clock: Clock, tries: Sequence[Sequence[Late]]) -> _Start | None:
    scales = likelihood.scales(clock)
    best = None
    for part in range(likelihood.parts):
        strip = next(iter(likelihood.strips.values()))[part]
        start = strip.time[strip.spans]
        now = clock.late(part)
        near = np.array([_by_span(likelihood, part, late, scales) for late in tries[part]])
        less = _by_span(likelihood, part, now, scales) - near
        borders = [float(start[0]), *(t for t, _ in now.steps), float(strip.time[-1])]
        for low, high in pairwise(borders):
            inside = np.flatnonzero((start >= low) & (start < high))
            may = inside[(start[inside] >= low + _NEAREST_S) & (start[inside] <= high - _NEAREST_S)]
            if not len(may):
                continue
            before = np.cumsum(less[:, inside], axis=1)
            upto = before[:, may - inside[0] - 1]
            for after, gain in ((True, before[:, -1:] - upto), (False, upto)):
                which, when = map(int, np.unravel_index(int(np.argmax(gain)), gain.shape))
                then = start[may[when], None]
                by = float(tries[part][which].at(then)[0] - now.at(then)[0])
                if gain[which, when] > (_WORTH_TRYING if best is None else best.gain) and by:
                    best = _Start(float(gain[which, when]), part, float(then[0]), by, after)
    return best


def _by_span(likelihood: Likelihood, part: int, late: Late, scales: dict[str, float]) -> Float1D:
    """(spans,) – errors of a part on all axes, 2 log likelihood."""
    return np.sum([scales[a] * strips[part].by_span(late) for a, strips in likelihood.strips.items()], axis=0)


def _with(clock: Clock, start: _Start) -> Clock:
    """The delay with this step more, and otherwise as it was after the next step, or before the last."""
    own, places = clock.form.own, [*clock.form.places, (start.part, start.time)]
    order = sorted(range(len(places)), key=places.__getitem__)
    sizes = np.r_[clock.sizes, start.by if start.after else -start.by][order]
    numbers = clock.numbers[: clock.parts + 1].copy()
    places = tuple(places[s] for s in order)
    at = places.index((start.part, start.time))
    same = [s for s, (k, _) in enumerate(places) if k == start.part]
    beside = same.index(at) + (1 if start.after else -1)
    if 0 <= beside < len(same):
        sizes[same[beside]] -= start.by if start.after else -start.by
    elif not start.after:
        numbers[start.part] += start.by
        if not (clock.form.common and clock.parts == 1):
            own = own | {start.part}
    form = Form(clock.form.common, clock.form.drift, own, places)
    return Clock(form, np.r_[numbers, sizes])


def _is_one(likelihood: Likelihood, new: Clock, former: Clock, part: int) -> bool:
    """Whether the delay with a step more gains throughout its part, as samples that are lost do, and not in one place
    that is odd anyhow (signed ranks of Wilcoxon 1945)."""
    strip = next(iter(likelihood.strips.values()))[part]
    scales = likelihood.scales(new)
    gain = np.subtract(*(_by_span(likelihood, part, clock.late(part), scales) for clock in (former, new)))
    time = strip.time[strip.spans]
    stretch = ((time - time[0]) // _EVEN_S).astype(int)
    by = np.abs(new.late(part).at(time) - former.late(part).at(time))
    gain = np.bincount(stretch, gain)[np.unique(stretch[by > _SAME * np.max(by)])]
    if len(gain) < 2:
        return False
    _, p = np.asarray(stats.wilcoxon(gain, alternative="greater"))
    return bool(p < SIGNIFICANT)
