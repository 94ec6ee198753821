"""Limits of regions, as every row has them.

In:  one axis on every row, the terms of its joint model as a search has found them.
Out: the same terms, the limits of each between the two rows between which they fit best; and laws that only looked bent
     between limits too far out, straight.
A search averages rows. Where an axis passes a box within one of these, what acts inside it is no mean of what acts in
the row: a force in proportion to an acceleration is there at one end of it alone, and the limits found for the averages
lie too far out.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.diagnosis.confirm import plain_error
from pido.diagnosis.estimate import settle_shapes
from pido.diagnosis.gates import Gate, gate_variable, inside
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mechanisms.sliding import is_smooth
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.terms import Term, behind, fit, solve_normal, without
from pido.diagnosis.whiten import Noise

_AROUND = (-0.16, -0.08, -0.03, -0.01, 0.0, 0.01, 0.03, 0.08, 0.16)  # of all values, where limits are tried together
_SHARES = (0.08, 0.02, 0.005, 0.001)  # of all values, by which a limit is moved at a time
_MOVES = 12  # of one size
_ROUNDS = 3
_NO_WORSE = 1.005  # of the error on folds that were not fitted
_LESS = 4.0  # of 2 log likelihood, that a round is to bring

_VISCOUS = next(m for m in CATALOGUE if m.id == "viscous_friction")

Error = Callable[[tuple[Gate, ...]], float]
"""gates -> the sum of squares that a term between them leaves"""


def on_every_row(mismatch: Mismatch, noise: Noise, terms: Sequence[Term]) -> list[Term]:
    """`terms` with their limits moved, and their shapes settled between; as they are where none has limits, or where
    that leaves more error on folds that were not fitted."""
    former, terms = list(terms), list(terms)
    for _ in range(_ROUNDS if any(t.gates for t in terms) else 0):
        gain = 0.0
        for i, term in enumerate(terms):
            if term.gates:
                terms[i], more = _moved(mismatch, noise, term, without(terms, i))
                gain += more
        if gain < _LESS:
            break
        terms = settle_shapes(mismatch, noise, terms)
    if terms == former or plain_error(mismatch, terms) < _NO_WORSE * plain_error(mismatch, former):
        return terms
    return former


def straight_within(mismatch: Mismatch, noise: Noise, terms: Sequence[Term]) -> list[Term]:
    """`terms`, with a friction whose sign rises with the speed in all of its box as viscous, where that fits better:
    between limits a little too far out, what rises straight looks bent."""
    out = list(terms)
    for i, term in enumerate(terms):
        bent = term.name == "coulomb_friction" and bool(term.gates) and is_smooth(dict(term.shape))
        if bent and _VISCOUS.id not in {t.name for t in out}:
            straight = replace(term, mechanism=_VISCOUS, shape=(), name=_VISCOUS.id)
            trial = [*out[:i], straight, *out[i + 1 :]]
            if fit(mismatch, noise, trial).bic < fit(mismatch, noise, out).bic:
                out = trial
    return out


def _moved(mismatch: Mismatch, noise: Noise, term: Term, rest: Sequence[Term]) -> tuple[Term, float]:
    """The term with each limit in turn where it fits best beside `rest`, and what that gains, 2 log likelihood."""
    left = _left_beside(mismatch, noise, rest)
    own = replace(term, gates=()).at_once().columns(mismatch.states)

    def error(gates: tuple[Gate, ...]) -> float:
        within = own * np.concatenate([inside(s, gates) for s in mismatch.states])
        return left(behind(within, mismatch.states, term.loop))

    gates, first = term.gates, error(term.gates)
    best = first
    values = {variable: _values(mismatch, variable) for variable in dict.fromkeys(g.variable for g in gates)}
    for variable, own_values in values.items():
        gates, best = _together(own_values, gates, variable, best, error)
    for share in _SHARES:
        for k, gate in enumerate(gates):
            gates, best = _one_limit(values[gate.variable], gates, k, share, best, error)
    return replace(term, gates=gates), int(noise.valid.sum()) * float(np.log(first / best))


def _together(
    values: Float1D, gates: tuple[Gate, ...], variable: str, best: float, error: Error
) -> tuple[tuple[Gate, ...], float]:
    """The gates with all limits of one variable where they leave least error, of some near those there are: one alone
    may have to get worse before both are better. values : all that the variable is, rising"""
    own = [(k, side) for k, g in enumerate(gates) if g.variable == variable for side in _finite(g)]
    near = []
    for k, side in own:
        at = np.searchsorted(values, getattr(gates[k], side)) + np.round(np.array(_AROUND) * len(values)).astype(int)
        near.append([_before(values, int(i)) for i in np.unique(at) if 0 < i < len(values)])
    found = gates
    for limits in itertools.product(*near):
        trial = list(gates)
        for (k, side), limit in zip(own, limits, strict=True):
            trial[k] = replace(trial[k], **{side: limit})
        if _is_wide(trial, variable) and (now := error(tuple(trial))) < best:
            found, best = tuple(trial), now
    return found, best


def _one_limit(
    values: Float1D,
    gates: tuple[Gate, ...],
    k: int,
    share: float,
    best: float,
    error: Error,
) -> tuple[tuple[Gate, ...], float]:
    """The gates with the finite limit of the one in place k moved up or down as long as that leaves less error.

    values : all that its variable is, rising
    """
    step = max(1, int(share * len(values)))
    for side in _finite(gates[k]):
        for way in (step, -step):
            for _ in range(_MOVES):
                at = int(np.searchsorted(values, getattr(gates[k], side))) + way
                if not 0 < at < len(values):
                    break
                trial = (*gates[:k], replace(gates[k], **{side: _before(values, at)}), *gates[k + 1 :])
                if not _is_wide(trial, gates[k].variable) or (now := error(trial)) >= best:
                    break
                gates, best = trial, now
    return gates, best


def _finite(gate: Gate) -> list[str]:
    return [side for side in ("low", "high") if np.isfinite(getattr(gate, side))]


def _before(values: Float1D, at: int) -> float:
    """Between the value in this place and the one before it."""
    return float(values[at - 1] + values[at]) / 2


def _is_wide(gates: Sequence[Gate], variable: str) -> bool:
    own = [g for g in gates if g.variable == variable]
    return max(g.low for g in own) < min(g.high for g in own)


def _values(mismatch: Mismatch, variable: str) -> Float1D:
    """What a variable is where it is anything, each value once, rising."""
    every = [v for s in mismatch.states if (v := gate_variable(s, variable)) is not None]
    values = np.concatenate(every)
    return np.unique(values[np.isfinite(values) & (values != 0)])


def _left_beside(mismatch: Mismatch, noise: Noise, rest: Sequence[Term]) -> Callable[[Float2D], float]:
    """columns (k, n) of one more term -> the sum of squares that it leaves beside the base and `rest`."""
    others = [mismatch.base, *(t.columns(mismatch.states) for t in rest)]
    X = noise.whiten(np.concatenate(others)) if len(mismatch.base) or rest else np.zeros((0, mismatch.n))
    Q = np.linalg.qr(X.T)[0]
    y = noise.whiten(mismatch.target[None])[0]
    y = y - Q @ (Q.T @ y)
    whole = float(y @ y)

    def left(columns: Float2D) -> float:
        C = noise.whiten(columns)
        shared, inner = C @ Q, C @ y
        return whole - float(solve_normal(C @ C.T - shared @ shared.T, inner)[0] @ inner)

    return left
