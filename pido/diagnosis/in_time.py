"""Names for every axis, in the time in which its two currents belong together.

In:  a `Look` at every axis. Out: per axis the delay of its recording, where there is one, and its `Answer`.
A clock is one for all axes: a delay that they share is looked for first, then in what the terms leave. What is left may
be of one axis, whose channel comes late by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np

from pido.diagnosis.confirm import LESS_WHERE_WRONG, even, plain_error
from pido.diagnosis.datafaults import Limits
from pido.diagnosis.forms import AS_GOOD
from pido.diagnosis.identify import Answer, noise_of
from pido.diagnosis.misfit import acting
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.search import Look, best_gain, first_look, search
from pido.diagnosis.terms import fit
from pido.diagnosis.timing import Delay, find_delay, sharpened, shift_target
from pido.diagnosis.whiten import Noise, estimate_noise

_CLEARLY = 0.8  # of the error on unseen folds that is left at most where one axis is late by itself


class Each(Protocol):
    """What `work` makes of every axis: (work, its arguments per axis, what is being done) -> results."""

    def __call__(self, work: Callable[..., Any], given: Mapping[str, tuple[Any, ...]], what: str) -> dict[str, Any]: ...


Answers = tuple[dict[str, Look], dict[str, Answer]]
"""Per axis, in some time."""


def in_its_time(
    looks: Mapping[str, Look], limits: Mapping[str, Limits], each: Each
) -> tuple[dict[str, Delay], dict[str, Answer]]:
    """limits : at which each axis' current is clipped"""
    delay = _common({a: (k.mismatch, k.noise) for a, k in looks.items()}, looks, each)
    if delay is not None:
        of = {a: looks[a] for a in delay.by_axis}
        delay = sharpened(delay, {a: k.mismatch for a, k in of.items()}, {a: k.noise for a, k in of.items()})
        _, answers = _searched(_moved(looks, limits, delay, each), True, each)
        return dict.fromkeys(looks, delay), answers
    _, answers = now = _searched(dict(looks), False, each)
    left = each(_left_after, {a: (k, answers[a]) for a, k in looks.items()}, "what is left on")
    # A small shift shows only when what is larger is out.
    beside = _common(left, looks, each)
    if beside is not None:
        beside = exactly(beside, {a: looks[a].mismatch for a in beside.by_axis}, answers)
        again = _searched(_moved(looks, limits, beside, each), True, each)
        if no_worse(again, now):
            return dict.fromkeys(looks, beside), again[1]
    if len(looks) == 1:
        return {}, answers
    given = {a: (k, answers[a], left[a], len(looks), limits[a]) for a, k in looks.items()}
    own = {a: late for a, late in each(_by_itself, given, "in a time of its own:").items() if late is not None}
    return {a: late for a, (late, _) in own.items()}, answers | {a: answer for a, (_, answer) in own.items()}


def in_time(mismatch: Mismatch, delay: Delay) -> Mismatch:
    """The same axis without its delay; as it is where it is compared with the equation, whose inputs are as late."""
    return mismatch if mismatch.sim is None or mismatch.base_names else shift_target(mismatch, delay)


def exactly(delay: Delay, whole: Mapping[str, Mismatch], answers: Mapping[str, Answer]) -> Delay:
    """The delay as these rows have it, beside what was named on its axes. Its interval is as much wider as the delay is
    another one under the noise of what is left: were nothing missing, the weights would not matter (in the spirit of
    Hausman 1978).

    whole : each axis that it is of
    """
    beside, noises = {}, {}
    for axis, mismatch in whole.items():
        moved = in_time(mismatch, delay)
        left = fit(moved, even(moved), answers[axis].terms).residual
        beside[axis] = mismatch.with_target(mismatch.target - (moved.target - left))
        noises[axis] = estimate_noise(left, mismatch.starts, mismatch.noise_class, mismatch.usable)
    exact = sharpened(delay, beside)
    return exact.as_wide_as(sharpened(exact, beside, noises))


def no_worse(again: Answers, former: Answers) -> bool:
    """Whether what was found in time again leaves no more error on any axis than what was found before."""
    now, then = (
        {axis: plain_error(look.mismatch, answers[axis].terms) for axis, look in looks.items()}
        for looks, answers in (again, former)
    )
    return all(now[axis] < AS_GOOD * then[axis] for axis in then)


def _common(left: Mapping[str, tuple[Mismatch, Noise]], looks: Mapping[str, Look], each: Each) -> Delay | None:
    """Of what is left on every axis, and how loud it is, if it says more than one more mechanism on each would, and
    more than what a simulation lacks anyway."""

    def rivals() -> Mapping[str, float]:
        return each(_gain_of_one, {a: (*left[a], k) for a, k in looks.items()}, "beside a shift in time:")

    delay = find_delay({a: m for a, (m, _) in left.items()}, {a: n for a, (_, n) in left.items()}, rivals)
    if delay is None or not any(_shows(left[axis][0], delay) for axis in delay.by_axis):
        return None
    return delay


def _shows(mismatch: Mismatch, delay: Delay) -> bool:
    """Whether less error is left without a delay, in the rows in which it acts, than no simulation is exact by."""
    moved = in_time(mismatch, delay)
    rows = acting(mismatch, mismatch.target - moved.target) & moved.usable
    before, after = (float(np.sum(m.target[rows] ** 2)) for m in (mismatch, moved))
    return after < (1 - LESS_WHERE_WRONG) ** 2 * before


def _moved(looks: Mapping[str, Look], limits: Mapping[str, Limits], delay: Delay, each: Each) -> dict[str, Look]:
    return each(_look_in_time, {a: (k.mismatch, limits[a], delay) for a, k in looks.items()}, "in time again:")


def _searched(looks: dict[str, Look], timed: bool, each: Each) -> Answers:
    return looks, each(search, {a: (k, len(looks), timed) for a, k in looks.items()}, "")


def _by_itself(
    look: Look,
    answer: Answer,
    left: tuple[Mismatch, Noise],
    axes: int,
    limits: Limits,
    rng: np.random.Generator,
) -> tuple[Delay, Answer] | None:
    """The delay of one axis alone and its answer in time again, where that leaves far less error than without: what a
    drive does late is no clock, and has laws that say it better."""
    axis = look.mismatch.axis
    for mismatch, noise in ((look.mismatch, look.noise), left) if answer.terms else ():
        delay = find_delay({axis: mismatch}, {axis: noise}, lambda m=mismatch, n=noise: {axis: best_gain(m, n, look)})
        if delay is None:
            continue
        moved = _look_in_time(look.mismatch, limits, delay, rng)
        again = search(moved, axes, True, rng)
        if plain_error(moved.mismatch, again.terms) < _CLEARLY * plain_error(look.mismatch, answer.terms):
            return delay, again
    return None


def _look_in_time(mismatch: Mismatch, limits: Limits, delay: Delay, rng: np.random.Generator) -> Look:
    return first_look(in_time(mismatch, delay), rng, clipped=bool(limits))


def _left_after(look: Look, answer: Answer, rng: np.random.Generator) -> tuple[Mismatch, Noise]:
    """What the terms of an answer leave, and how loud it is."""
    assert answer.noise is not None
    left = look.mismatch.with_target(fit(look.mismatch, answer.noise, answer.terms).residual)
    return left, noise_of(look.mismatch, answer.noise, answer.terms)


def _gain_of_one(mismatch: Mismatch, noise: Noise, look: Look, rng: np.random.Generator) -> float:
    return best_gain(mismatch, noise, look)
