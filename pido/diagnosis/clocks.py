"""What a delay between recording and simulation may look like, and how likely one is: of all axes at once.

In:  the axes of all parts, with simulated currents, and the noise of each.
Out: `Clock`: the numbers of a delay of some `Form`; `Likelihood`: what it explains, and its numbers refined.
Source: maximum likelihood, whitened; numbers by Gauss-Newton on the slope of the simulated current, their variance over
blocks (White 1982).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from pido.core.arrays import Bool1D, Float1D, Float2D, Int1D
from pido.diagnosis.lateness import Late, Seen, curved
from pido.diagnosis.mismatch import Mismatch, averaged, take_rows
from pido.diagnosis.whiten import Noise

_OVERLAP = 0.5  # of the rows of a part, for which something is to be simulated when it is shifted
_HELD_S = 0.5  # beyond its ends, for which a simulation is taken to stay as it is there
_TURNS = 4  # of Gauss-Newton
_PRICE = 12.0  # of the likelihood, 2 log, that each number of a delay is to add
_SPAN_S = 0.25  # that errors are summed over to see in which stretch a shift explains something

Moved = Callable[[Float1D, Float1D], Seen]
"""(time, values) -> the signal as it is seen later."""


@dataclass(frozen=True)
class Form:
    """Which numbers a delay has.

    common : whether the parts without a shift of their own share one; else they are in time
    drift : whether all of them drift
    own : parts with a shift of their own
    places : (part, time in s) of each step, in this order; it holds to the end of its part
    """

    common: bool = False
    drift: bool = False
    own: frozenset[int] = frozenset()
    places: tuple[tuple[int, float], ...] = ()

    @property
    def price(self) -> float:
        """Of the likelihood, 2 log, that it is to gain. A step has three numbers: where, when and how much. The first
        two are chosen, not estimated: 2 log(160 000) = 24 pays for a choice among all rows that a search looks at."""
        return _PRICE * self.numbers

    @property
    def numbers(self) -> int:
        return self.common + self.drift + len(self.own) + 3 * len(self.places)

    def basis(self, parts: int) -> Float2D:
        """(parts + 1 + steps, q) – directions in which the numbers of a clock of this form may move."""
        unit = np.eye(parts + 1 + len(self.places))
        shared = np.sum([unit[k] for k in range(parts) if k not in self.own], axis=0)
        free = [shared] if self.common and len(self.own) < parts else []
        free += [unit[k] for k in sorted(self.own)]
        free += [unit[parts]] if self.drift else []
        free += list(unit[parts + 1 :])
        return np.transpose(free) if free else np.zeros((len(unit), 0))


@dataclass(frozen=True, eq=False)
class Clock:
    """A delay: numbers (parts + 1 + steps,) – the shift of each part, s; the drift of all, s/s; the size of each step,
    s."""

    form: Form
    numbers: Float1D

    @classmethod
    def of(cls, form: Form, offsets: Sequence[float] | Float1D, drift: float = 0.0) -> Clock:
        """Without steps."""
        return cls(form, np.r_[np.asarray(offsets, float), drift])

    @property
    def parts(self) -> int:
        return len(self.numbers) - 1 - len(self.form.places)

    @property
    def offsets(self) -> Float1D:
        return self.numbers[: self.parts]

    @property
    def drift(self) -> float:
        return float(self.numbers[self.parts])

    @property
    def sizes(self) -> Float1D:
        return self.numbers[self.parts + 1 :]

    def late(self, part: int) -> Late:
        steps = ((t, float(by)) for (k, t), by in zip(self.form.places, self.sizes, strict=True) if k == part)
        return Late(float(self.numbers[part]), self.drift, tuple(steps))

    def steps_of(self, part: int) -> list[int]:
        """Places, in `form.places`, of the steps of a part."""
        return [s for s, (k, _) in enumerate(self.form.places) if k == part]


@dataclass(eq=False)
class Strip:
    """One axis in one part, n rows."""

    mismatch: Mismatch
    noise: Noise
    part: int
    moved: Moved
    fine: bool

    def __post_init__(self):
        m = self.mismatch
        self.rows = slice(int(m.edges[self.part]), int(m.edges[self.part + 1]))
        self.time = m.states[self.part].time
        self.sim, self.usable = m.simulated[self.rows], m.usable[self.rows]
        self.recorded = m.target[self.rows] + self.sim
        self.weights = take_rows(self.noise, self.rows, m.n)
        self.counted = int(self.weights.valid.sum())
        width = max(1, round(_SPAN_S / m.step))
        self.spans = np.arange(0, len(self.time), width)
        self.seen = seen_late(m, self.part, self.moved, self.fine)
        self.known: dict[Late, tuple[float, Float1D]] = {}
        self.latest: tuple[Late, tuple[Float1D, Float1D, Bool1D]] | None = None
        self.still = self.white(Late()) ** 2

    def left(self, late: Late) -> tuple[Float1D, Float1D, Bool1D]:
        """(n,) each – the simulated current when moved, A; what the recording has more; which rows may be used."""
        if self.latest is None or self.latest[0] != late:
            moved = self.seen(late)
            use = self.usable & within(self.mismatch, self.part, late)
            self.latest = late, (moved, np.where(use, self.recorded - moved, 0.0), use)
        return self.latest[1]

    def white(self, late: Late) -> Float1D:
        """(n,) – what is left, whitened."""
        return self.weights.whiten(self.left(late)[1][None])[0]

    def error(self, late: Late) -> float:
        """Sum of squares, as if the rows for which nothing is simulated were like the others; no less than without a
        delay where these are most."""
        return self._errors(late)[0]

    def by_span(self, late: Late) -> Float1D:
        """(spans,) – sums of squares over stretches of `_SPAN_S`; as without a delay where nothing is simulated."""
        return self._errors(late)[1]

    def _errors(self, late: Late) -> tuple[float, Float1D]:
        if late not in self.known:
            _, left, use = self.left(late)
            white = self.weights.whiten(left[None])[0]
            share = float(np.sum(use)) / max(1, int(np.sum(self.usable)))
            error = max(float(white @ white), 1e-30) / max(share, _OVERLAP)
            if share < _OVERLAP and late:
                error = max(error, self.error(Late()))
            each = np.where(use, white**2, self.still)
            self.known[late] = error, np.add.reduceat(each, self.spans)
        return self.known[late]

    def slopes(self, late: Late) -> tuple[Float2D, Float1D]:
        """(2 + steps, n) slope of the moved simulation: as it is, times t, and from each step on; and (n,) what is
        left; whitened."""
        moved, left, use = self.left(late)
        starts = [start for start, _ in late.steps]
        # Across a step the current jumps, and that is no slope.
        pieces = np.split(np.arange(len(self.time)), np.searchsorted(self.time, starts))
        slope = [np.gradient(moved[p], self.time[p]) if len(p) > 1 else np.zeros(len(p)) for p in pieces]
        slope = np.where(use, np.nan_to_num(np.concatenate(slope)), 0.0)
        after = [self.time >= start for start in starts]
        return self.weights.whiten(slope * np.array([np.ones_like(slope), self.time, *after])), self.weights.whiten(
            left[None]
        )[0]


class Likelihood:
    """Of the delays of some axes under some weights.

    fine : moved before rows are averaged
    """

    def __init__(
        self, axes: Mapping[str, Mismatch], noises: Mapping[str, Noise], moved: Moved = curved, fine: bool = False
    ):
        self.axes, self.noises = axes, noises
        self.parts = len(next(iter(axes.values())).states)
        self.strips = {a: [Strip(m, noises[a], k, moved, fine) for k in range(self.parts)] for a, m in axes.items()}
        self.counted = {a: sum(s.counted for s in strips) for a, strips in self.strips.items()}
        self.before = {a: sum(s.error(Late()) for s in strips) for a, strips in self.strips.items()}

    def of_part(self, part: int) -> Likelihood:
        """That of one part alone."""
        out = copy(self)
        out.parts, out.strips = 1, {a: [strips[part]] for a, strips in self.strips.items()}
        out.counted = {a: strips[0].counted for a, strips in out.strips.items()}
        out.before = {a: strips[0].error(Late()) for a, strips in out.strips.items()}
        return out

    @property
    def zero(self) -> Clock:
        return Clock.of(Form(), np.zeros(self.parts))

    def gains(self, clock: Clock) -> dict[str, float]:
        """2 log likelihood over no delay, per axis."""
        return {a: self.counted[a] * float(np.log(self.before[a] / e)) for a, e in self._errors(clock).items()}

    def total(self, clock: Clock) -> float:
        return sum(self.gains(clock).values())

    def value(self, clock: Clock) -> float:
        """2 log likelihood over no delay, less what its numbers cost."""
        return self.total(clock) - clock.form.price

    def by_part(self, clock: Clock) -> Float1D:
        """(parts,) – what each part gains by itself."""
        return np.array(
            [
                sum(
                    s[k].counted * float(np.log(s[k].error(Late()) / s[k].error(clock.late(k))))
                    for s in self.strips.values()
                )
                for k in range(self.parts)
            ]
        )

    def scales(self, clock: Clock) -> dict[str, float]:
        """Per axis, what one unit of squared error is worth, 2 log likelihood, beside this delay."""
        return {a: self.counted[a] / e for a, e in self._errors(clock).items()}

    def _errors(self, clock: Clock) -> dict[str, float]:
        lates = [clock.late(k) for k in range(self.parts)]
        return {a: sum(s.error(late) for s, late in zip(each, lates, strict=True)) for a, each in self.strips.items()}

    def refined(self, clock: Clock) -> tuple[Clock, Float2D]:
        """Gauss-Newton from `clock` within its form, each step halved until it helps; the covariance, (parts + 1 +
        steps,) squared, is that of the last step, were all else as the noise says."""
        basis = clock.form.basis(self.parts)
        at = replace(clock, numbers=clock.numbers * basis.any(axis=1))
        covariance = np.zeros((len(basis), len(basis)))
        for _ in range(_TURNS if basis.shape[1] else 0):
            gram, inner = self._normal(at)
            inverse = np.linalg.pinv(basis.T @ gram @ basis)
            move = basis @ (inverse @ (basis.T @ inner))
            covariance = basis @ inverse @ basis.T
            now = self.total(at)
            better = (replace(at, numbers=at.numbers + share * move) for share in (1.0, 0.5, 0.25))
            new = next((b for b in better if self.total(b) > now), None)
            if new is None:
                break
            at = new
        return at, covariance

    def spread(self, clock: Clock, form: Form | None = None) -> Float2D:
        """(parts + 1 + steps,) squared – covariance over blocks, whatever the noise forgets or not.

        form : whose numbers may move; that of the clock where None
        """
        basis = (form or clock.form).basis(self.parts)
        gram, _ = self._normal(clock)
        inverse = basis @ np.linalg.pinv(basis.T @ gram @ basis) @ basis.T
        scores = np.sum([self._scores(a, clock) for a in self.axes], axis=0)
        free = max(1, len(scores) - basis.shape[1])
        return len(scores) / free * inverse @ (scores.T @ scores) @ inverse

    def _normal(self, clock: Clock) -> tuple[Float2D, Float1D]:
        """Gram matrix and inner products of one step, over all axes."""
        n = len(clock.numbers)
        gram, inner = np.zeros((n, n)), np.zeros(n)
        for strips in self.strips.values():
            for k, strip in enumerate(strips):
                slopes, left = strip.slopes(clock.late(k))
                of = self._numbers_of(clock, k)
                gram[np.ix_(of, of)] += slopes @ slopes.T
                inner[of] -= slopes @ left
        return gram, inner

    def _scores(self, axis: str, clock: Clock) -> Float2D:
        """(blocks, parts + 1 + steps)"""
        block = self.axes[axis].block
        out = np.zeros((int(block.max()) + 1, len(clock.numbers)))
        for k, strip in enumerate(self.strips[axis]):
            slopes, left = strip.slopes(clock.late(k))
            for number, slope in zip(self._numbers_of(clock, k), slopes, strict=True):
                out[:, number] += np.bincount(block[strip.rows], slope * left, len(out))
        return out

    def _numbers_of(self, clock: Clock, part: int) -> Int1D:
        """Of a clock, those that the rows of `Strip.slopes` belong to."""
        return np.array([part, self.parts, *(self.parts + 1 + s for s in clock.steps_of(part))])


def seen_late(mismatch: Mismatch, part: int, moved: Moved = curved, fine: bool = False) -> Seen:
    """The simulated current of a part, A, as it is seen later.

    fine : moved before rows are averaged, not after: what means lose between them looks like a part of a shift
    """
    simulated = mismatch.simulated[int(mismatch.edges[part]) : int(mismatch.edges[part + 1])]
    if fine and mismatch.fine:
        each = moved(*mismatch.fine[part])
        return lambda late: averaged(each(late), mismatch.stride) if late else simulated
    seen = moved(mismatch.states[part].time, simulated)
    return lambda late: seen(late) if late else simulated


def within(mismatch: Mismatch, part: int, late: Late) -> Bool1D:
    """(n,) – rows of a part that fall, when the simulation is moved, within what is simulated; a shift held at the ends
    of a part for less than a second counts as within."""
    time = mismatch.states[part].time
    known = time[np.isfinite(mismatch.simulated[int(mismatch.edges[part]) : int(mismatch.edges[part + 1])])]
    if not len(known):
        return np.ones(len(time), bool)
    source = time - late.at(time)
    return (source >= known[0] - _HELD_S) & (source <= known[-1] + _HELD_S)
