"""Amplitudes and shapes with intervals that hold: one Gauss-Newton step around the chosen model, blocks resampled.

In:  one axis on every row, the terms, the noise.
Out: amplitudes of the joint fit and, per term, a value with its 95 % interval for every parameter.
A shape parameter enters as the derivative of its term's effect, so that an amplitude's interval knows that the shape is
not known exactly either; and that of a law behind a drive's loop, that the form of this loop is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.diagnosis.confirm import Whitened, half_widths
from pido.diagnosis.finding import Estimate
from pido.diagnosis.mechanisms.base import Parameter
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.terms import Fit, Term, fit, held_back, solve
from pido.diagnosis.whiten import Noise

FORM = 0.02
"""Of an amplitude, to either side: no textbook form is a machine's to better than that, however many samples say so."""
_FORM_OF_LOOP = 0.5  # of what an amplitude differs between a first order lag and a delay of the same time
_STEP = 0.02  # relative, of a shape parameter
LAG = "lag"
_NORMAL_95 = 1.96
LONGEST_LAG_S, _LONGEST_LAG_STEPS = 0.5, 5.0  # what comes later is answered by no loop of a drive
_STEPS = 8  # Gauss-Newton


@dataclass(frozen=True)
class Estimated:
    """The joint fit, and per term its parameters by name."""

    fit: Fit
    parameters: tuple[dict[str, Estimate], ...]


def settle_shapes(mismatch: Mismatch, noise: Noise, terms: Sequence[Term]) -> list[Term]:
    """All shapes moved together to the least sum of squares on every row, inside their ranges."""
    terms = list(terms)
    columns = [t.columns(mismatch.states) for t in terms]
    best = fit(mismatch, noise, terms, columns)
    for _ in range(_STEPS):
        moves = _gauss_newton(mismatch, noise, terms, columns, best)
        for share in (1.0, 0.3) if any(moves) else ():
            trial = [_moved(mismatch, t, m, share) for t, m in zip(terms, moves, strict=True)]
            tried = [t.columns(mismatch.states) for t in trial]
            found = fit(mismatch, noise, trial, tried)
            if found.rss < best.rss * (1 - 1e-6):
                terms, columns, best = trial, tried, found
                break
        else:
            break
    return terms


def estimate(
    mismatch: Mismatch, noise: Noise, terms: Sequence[Term], rng: np.random.Generator, other: Noise | None = None
) -> Estimated:
    """Amplitudes, and intervals of everything that was fitted.

    other : weights under which the same would come out were the model exact; how far it does not is a bias that the
        form of a term may have, and the interval is as much wider (in the spirit of Hausman 1978)
    """
    columns = [t.columns(mismatch.states) for t in terms]
    joint = fit(mismatch, noise, terms, columns)
    slopes, of_lag = _around_it(mismatch, terms, joint)
    design = np.concatenate([mismatch.base, *columns, *[s for group in slopes for s in group.values()], of_lag])
    model = Whitened(noise.whiten(design), noise.whiten(mismatch.target[None])[0], ())
    beta, _ = solve(model.X, model.y)
    half = list(half_widths(model, mismatch, rng))
    if other is not None:
        again, _ = solve(other.whiten(design), other.whiten(mismatch.target[None])[0])
        half = [h + abs(float(b - a)) for h, b, a in zip(half, beta, again, strict=True)]
    of_amplitudes = slice(len(mismatch.base), len(mismatch.base) + sum(len(c) for c in columns))
    if any(t.loop for t in terms):
        # How a drive's loop answers is known by its time only: first order and a pure delay are the ends of what it is.
        other_loop = fit(mismatch, noise, terms, [t.columns_delayed(mismatch.states) for t in terms])
        differ = np.abs(np.concatenate(other_loop.amplitudes) - np.concatenate(joint.amplitudes))
        half[of_amplitudes] = [h + _FORM_OF_LOOP * d for h, d in zip(half[of_amplitudes], differ, strict=True)]
    half[of_amplitudes] = [
        max(h, FORM * abs(float(b))) for h, b in zip(half[of_amplitudes], beta[of_amplitudes], strict=True)
    ]
    drawn = held_back(model.X, len(mismatch.base), terms, columns)
    for i in np.flatnonzero(drawn):
        # What hardly any row reaches is known as well as what draws it to zero says.
        half[i] = min(half[i], _NORMAL_95 * np.sqrt(joint.rss / max(1, joint.n) / drawn[i]))
    out: list[dict[str, Estimate]] = []
    at, slope_at = len(mismatch.base), len(mismatch.base) + sum(len(c) for c in columns)
    for term, amplitudes, group in zip(terms, joint.amplitudes, slopes, strict=True):
        names = amplitude_names(term, len(amplitudes))
        found = {}
        for (name, unit), value in zip(names, amplitudes, strict=True):
            found[name] = Estimate(float(value), unit, (float(value) - half[at], float(value) + half[at]))
            at += 1
        for p in term.mechanism.shape:
            value = dict(term.shape).get(p.name)
            if p.is_choice or value is None:
                continue
            if p.name in group:
                around = _around(value, half[slope_at], p.scale == "log")
                found[p.name] = Estimate(value, p.unit, _within(p, value, around))
                slope_at += 1
            else:
                found[p.name] = Estimate(value, p.unit, (value, value))
        if term.loop:
            found[LAG] = Estimate(term.lag, "s", _around(term.lag, half[-1], log=True))
        out.append(found)
    return Estimated(joint, tuple(out))


def amplitude_names(term: Term, count: int) -> list[tuple[str, str]]:
    """Name and unit of each amplitude; numbered where a mechanism has as many as the data need."""
    own = term.mechanism.amplitudes
    if len(own) == count:
        return [(p.name, p.unit) for p in own]
    first = own[0]
    return [(f"{first.name}_{i + 1}", first.unit) for i in range(count)]


def _slopes(mismatch: Mismatch, term: Term, amplitudes: Float1D) -> dict[str, Float2D]:
    """Per shape parameter the derivative of the effect by it (by its logarithm on a log scale), (1, n)."""
    out = {}
    shape = dict(term.shape)
    for p in term.mechanism.shape:
        if p.is_choice:
            continue
        low, high = term.mechanism.around(p.name, shape, mismatch.states)
        if not low < high:
            continue  # settled
        value = shape[p.name]
        log = p.scale == "log"
        slope = _slope(mismatch, term, amplitudes, p.name, value, log)
        if np.any(slope):
            out[p.name] = slope[None]
    return out


def _slope(mismatch: Mismatch, term: Term, amplitudes: Float1D, name: str, value: float, log: bool) -> Float1D:
    """Central difference, with a step small enough that the effect changes little (a wave over hours
    needs a tiny one).
    """
    parameter = next(p for p in term.mechanism.shape if p.name == name)
    span = max(abs(value), 1e-3 * abs((parameter.high or 1.0) - (parameter.low or 0.0)))
    slope = np.zeros(mismatch.n)
    for step in (_STEP, _STEP / 10, _STEP / 100, _STEP / 1000):
        above, below = (
            (value * np.exp(step), value * np.exp(-step)) if log else (value + step * span, value - step * span)
        )
        up, down = (amplitudes @ term.with_shape(**{name: float(v)}).columns(mismatch.states) for v in (above, below))
        slope = (up - down) / (2 * step * (1.0 if log else span))
        if np.sum((up - down) ** 2) < 0.1 * np.sum((up + down) ** 2) / 4:
            break
    return slope


def _lag_slope(mismatch: Mismatch, terms: Sequence[Term], amplitudes: Sequence[Float1D]) -> Float2D:
    """(1, n) – derivative of all late effects by the logarithm of the lag that they share; (0, n) where none is."""
    slope, any_late = np.zeros((1, mismatch.n)), False
    for term, a in zip(terms, amplitudes, strict=True):
        if term.loop:
            later = (replace(term.loop, lag=term.lag * float(np.exp(s))) for s in (_STEP, -_STEP))
            up, down = (term.behind(loop).columns(mismatch.states) for loop in later)
            slope, any_late = slope + a @ (up - down) / (2 * _STEP), True
    return slope if any_late else slope[:0]


def _around_it(mismatch: Mismatch, terms: Sequence[Term], joint: Fit) -> tuple[list[dict[str, Float2D]], Float2D]:
    """Derivatives of the effects by their shapes, per term, and of all by the lag that they share: what a linear model
    has beside its amplitudes."""
    slopes = [_slopes(mismatch, t, a) for t, a in zip(terms, joint.amplitudes, strict=True)]
    return slopes, _lag_slope(mismatch, terms, joint.amplitudes)


def _gauss_newton(
    mismatch: Mismatch, noise: Noise, terms: Sequence[Term], columns: Sequence[Float2D], joint: Fit
) -> list[dict[str, float]]:
    slopes, of_lag = _around_it(mismatch, terms, joint)
    extra = [s for group in slopes for s in group.values()]
    if not extra and not len(of_lag):
        return [{} for _ in terms]
    design = noise.whiten(np.concatenate([mismatch.base, *columns, *extra, of_lag]))
    beta, _ = solve(design, noise.whiten(mismatch.target[None])[0])
    moves, at = [], len(design) - len(extra) - len(of_lag)
    for term, group in zip(terms, slopes, strict=True):
        moves.append({name: float(beta[at + i]) for i, name in enumerate(group)})
        if term.loop:
            moves[-1][LAG] = float(beta[-1])
        at += len(group)
    return moves


def _moved(mismatch: Mismatch, term: Term, moves: dict[str, float], share: float) -> Term:
    """`term` with its shape moved, no further than a search would; beyond a grid's end as far as is plausible."""
    shape = dict(term.shape)
    for p in term.mechanism.shape:
        if p.name in moves:
            value, move = shape[p.name], share * moves[p.name]
            new = value * np.exp(np.clip(move, -0.7, 0.7)) if p.scale == "log" else value + move
            low, high = term.mechanism.around(p.name, dict(term.shape), mismatch.states)
            low = (-np.inf if p.low is None else p.low) if low == value else low
            high = (np.inf if p.high is None else p.high) if high == value else high
            shape[p.name] = float(np.clip(new, min(low, value), max(high, value)))
    lag = term.lag * float(np.exp(np.clip(share * moves.get(LAG, 0.0), -0.7, 0.7)))
    lag = min(lag, max(LONGEST_LAG_S, _LONGEST_LAG_STEPS * mismatch.step, term.lag))
    return replace(term, shape=tuple(shape.items()), loop=replace(term.loop, lag=lag))


def _within(parameter: Parameter, value: float, interval: tuple[float, float]) -> tuple[float, float]:
    """The interval around a value as far as values are plausible at all; what a search may leave is no bound."""
    low = -np.inf if parameter.low is None else min(parameter.low, value)
    high = np.inf if parameter.high is None else max(parameter.high, value)
    return max(interval[0], low), min(interval[1], high)


def _around(value: float, half: float, log: bool) -> tuple[float, float]:
    if log:
        half = min(half, 20.0)
        return float(value * np.exp(-half)), float(value * np.exp(half))
    return float(value - half), float(value + half)
