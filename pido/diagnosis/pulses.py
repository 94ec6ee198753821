"""A force that comes on again and again for the same while: a pump, a conveyor, a valve on a timer.

In:  terms that hold forces over intervals of time.
Out: one law of the clock in their place, which says when it comes again, also in parts that were not diagnosed.
Source: the box least squares of Kovács, Zucker and Mazeh (2002, Astronomy and Astrophysics 391, 369), on the machine's
clock where every part has a place on it, and on each part's own time; its ends are then moved between the samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy import optimize

from pido.core.arrays import Float1D, Float2D
from pido.diagnosis.events import ExternalForce
from pido.diagnosis.mechanisms.advice import recording_that_names
from pido.diagnosis.mechanisms.base import Mechanism, Parameter, Told, column, nothing
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.state import AxisState, coolant_recorded
from pido.diagnosis.terms import Term, fit, without
from pido.diagnosis.whiten import Noise

_FEWEST = 3  # pulses that tell how often a force comes again
_PHASES = 64  # of a period, in which ends are searched
_LONGEST_ON = 0.5  # of a period
_PER_WAVE = 8  # frequencies tried for each that the whole time could tell apart
_MOST_TRIED = 60_000  # frequencies
_BINS_PER_PULSE = 8


@dataclass(frozen=True)
class Pulses(Mechanism):
    """One force for w seconds, every T seconds.

    clock : on the machine's clock; otherwise on each part's own time; origin : s, where that clock is called 0
    cycles : how many periods the parts spanned in which it was found
    """

    clock: bool
    origin: float = 0.0
    cycles: float = 1.0

    id: ClassVar[str] = "external_force"
    passes_loop: ClassVar[bool] = False
    looked_at: ClassVar[int] = _MOST_TRIED
    amplitudes: ClassVar[tuple[Parameter, ...]] = (Parameter("F", "A"),)
    shape: ClassVar[tuple[Parameter, ...]] = (
        Parameter("T", "s", low=1e-3, high=1e7, scale="log"),
        Parameter("t_0", "s"),
        Parameter("w", "s", low=1e-3, high=1e7, scale="log"),
    )

    @property
    def equation(self) -> str:  # type: ignore[override]
        since = f"s on the machine's clock since {self.origin:.6g}" if self.clock else "s since the start of each part"
        return f"dI = F while (t - t_0) mod T < w; t in {since}"

    @property
    def follows_from(self) -> tuple[str, ...]:  # type: ignore[override]
        return ("clock",) if self.clock else ()

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        """(n, 1) – the share of each row's time in which it is on."""
        time = state.clock if self.clock else state.time - state.time[0]
        if time is None:
            return nothing(state)
        period, on = shape["T"], min(shape["w"], shape["T"])

        def on_until(t: Float1D) -> Float1D:
            cycle, within = np.divmod(t, period)
            return cycle * on + np.minimum(within, on)

        t, half = np.asarray(time, float) - self.origin - shape["t_0"], state.dt / 2
        return column((on_until(t + half) - on_until(t - half)) / state.dt)

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        here, quarter = shape[name], shape["w"] / 4
        by = quarter / max(1.0, self.cycles) if name == "T" else quarter
        return here - by, here + by

    def conditions(self, axis: str, shape: dict[str, float]) -> tuple[str, tuple[str, ...]]:
        by = "on the machine's clock" if self.clock else "from the start of each part"
        return f"{axis} axis, for {shape['w']:.3g} s every {shape['T']:.4g} s {by}, whatever the machine does then", ()

    def told(self, states: Sequence[AxisState], shape: Mapping[str, float], sizes: Mapping[str, float]) -> Told:
        where, conditions = self.conditions(states[0].axis, dict(shape))
        name = f"a force that comes on every {shape['T']:.4g} s for {shape['w']:.3g} s"
        return Told(where, conditions, name, recording_that_names(shape["T"], coolant_recorded(states)))


def repeating(mismatch: Mismatch, noise: Noise, terms: Sequence[Term]) -> list[Term]:
    """`terms` with one law of the clock in place of a force over intervals, where one can be fitted to it; whether it
    says as much is for proof to say."""
    for i, term in enumerate(terms):
        if isinstance(term.mechanism, ExternalForce) and len(term.mechanism.intervals) >= _FEWEST:
            rest = without(terms, i)
            left = fit(mismatch, noise, rest).residual
            found = _pulses(mismatch, noise, left, term.mechanism)
            return list(terms) if found is None else [*rest, found]
    return list(terms)


def _pulses(mismatch: Mismatch, noise: Noise, left: Float1D, events: ExternalForce) -> Term | None:
    """left : (n,), A"""
    weight = np.where(mismatch.usable, noise.level**-2.0, 0.0)
    on = float(np.median([end - start for _, start, end in events.intervals]))
    clocks: dict[bool, list[Float1D]] = {False: [s.time - s.time[0] for s in mismatch.states]}
    if all(s.clock is not None for s in mismatch.states):
        clocks[True] = [np.asarray(s.clock, float) for s in mismatch.states]
    best: tuple[float, Term | None] = (0.0, None)
    for clock, each in clocks.items():
        time = np.concatenate(each)
        origin = float(time.min()) if clock else 0.0
        found = _searched(time - origin, left, weight, on)
        if found is None:
            continue
        mechanism = Pulses(clock, origin, float(np.ptp(time) / found[0]))
        gain, shape = _tuned(mismatch, mechanism, dict(zip(("T", "t_0", "w"), found, strict=True)), left, weight)
        if gain > best[0]:
            best = gain, Term(mechanism, tuple(shape.items()))
    return best[1]


def _searched(time: Float1D, left: Float1D, weight: Float1D, on: float) -> tuple[float, float, float] | None:
    """(period, begin, length) of the boxes that explain most, s; on : how long one lasts, about."""
    span, width = float(np.ptp(time)), on / _BINS_PER_PULSE
    bins, where = np.unique((time / width).astype(np.int64), return_inverse=True)
    weights, products = np.bincount(where, weight), np.bincount(where, weight * left)
    middle = (bins + 0.5) * width
    slowest, fastest = (_FEWEST - 1) / span, _LONGEST_ON / on
    fastest = min(fastest, slowest + _MOST_TRIED / (_PER_WAVE * span))
    count = int(_PER_WAVE * span * (fastest - slowest))
    if count < 1:
        return None
    best, gain = None, 0.0
    for frequency in np.linspace(slowest, fastest, count):
        phase = np.floor(middle * frequency % 1.0 * _PHASES).astype(np.int64)
        inside, mass = (np.bincount(phase, v, _PHASES).astype(float) for v in (products, weights))
        first, length, explained = _best_box(inside, mass, on * frequency)
        if explained > gain:
            gain, best = explained, (1 / frequency, first / _PHASES / frequency, length / _PHASES / frequency)
    return best


def _best_box(products: Float1D, weights: Float1D, share: float) -> tuple[int, int, float]:
    """(first, length, what it explains) of the box of about a share of the period that explains most; it may reach
    over the end."""
    s, w = (np.r_[0.0, np.cumsum(np.tile(v, 2))] for v in (products, weights))
    lengths = np.unique(np.clip(np.round(np.array([0.5, 0.75, 1.0, 1.5, 2.0]) * share * _PHASES), 1, _PHASES // 2))
    best = (0, 1, 0.0)
    for length in lengths.astype(int):
        inside, mass = (v[length : length + _PHASES] - v[:_PHASES] for v in (s, w))
        explained = np.where(mass > 0, inside**2 / np.maximum(mass, 1e-300), 0.0)
        k = int(np.argmax(explained))
        if explained[k] > best[2]:
            best = k, int(length), float(explained[k])
    return best


def _tuned(
    mismatch: Mismatch, mechanism: Pulses, shape: dict[str, float], left: Float1D, weight: Float1D
) -> tuple[float, dict[str, float]]:
    """What the pulses explain at most, their ends moved between the bins; and the shape."""
    names, start = list(shape), np.array(list(shape.values()))

    def explained(values: Float1D) -> float:
        if values[2] <= 0 or values[0] <= values[2]:
            return 0.0
        at = dict(zip(names, values, strict=True))
        on = np.concatenate([mechanism.regressors(s, **at)[:, 0] for s in mismatch.states])
        mass = float(weight @ on**2)
        return float((weight * on) @ left) ** 2 / mass if mass > 0 else 0.0

    steps = [mechanism.around(name, shape, mismatch.states)[1] - shape[name] for name in names]
    simplex = start + np.vstack([np.zeros(3), np.diag(steps)])
    found = optimize.minimize(
        lambda v: -explained(v), start, method="Nelder-Mead", options={"initial_simplex": simplex, "maxiter": 200}
    )
    best = dict(zip(names, map(float, found.x), strict=True))
    best["t_0"] %= best["T"]
    return -float(found.fun), best
