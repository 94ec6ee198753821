"""Which mechanisms, and how many: steps forward, swaps and steps back over a whole catalogue at once.

In:  a library of every mechanism on one axis, its noise, and the terms chosen so far.
Out: the best addition, its shape refined; terms swapped for better ones; terms without the useless.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from pido.core.arrays import Float1D
from pido.diagnosis.library import Basis, Library, Score, basis
from pido.diagnosis.mechanisms.base import Mechanism, Parameter
from pido.diagnosis.state import AxisState
from pido.diagnosis.terms import Term, without
from pido.diagnosis.whiten import Noise

MOST_TERMS = 8  # on one axis; more named terms than this is a description, not a diagnosis
_SHORTLIST = 6  # mechanisms whose shape is refined in each step
_TIE = 4.0  # BIC: of mechanisms this close, the one with fewer free numbers is taken


def grid_terms(mechanism: Mechanism, states: Sequence[AxisState], name: str = "") -> list[Term]:
    """One term per shape that the mechanism's search starts from in these data."""
    return [Term(mechanism, tuple(shape.items()), (), name) for shape in mechanism.starts(states)]


def suggested(library: Library, current: Basis, residual: Float1D, taken: set[str]) -> list[Score]:
    """What the residual itself (A, (n,)) speaks for, by the mechanisms that can read it."""
    m = library.mismatch
    left = np.where(m.usable, residual, np.nan)
    parts = [left[i:j] for i, j in zip(m.edges[:-1], m.edges[1:], strict=True)]
    out = []
    for name, mechanism in {t.name: t.mechanism for t in library.terms}.items():
        if name in taken:
            continue
        for shape in mechanism.suggest(m.states, parts):
            term = Term(mechanism, tuple(shape.items()), (), name).behind(library.loop)
            found = library.score(term, current)
            if found is not None:
                out.append(replace(found, bic=found.bic + 2 * np.log(max(1, mechanism.looked_at))))
    return out


def best_addition(library: Library, current: Basis, taken: Collection[str], more: Sequence[Score] = ()) -> Score | None:
    """The mechanism that lowers the BIC most, its shape refined; among near ties the simplest."""
    shortlist = shortlist_of([*library.screen(current), *more], taken)
    if not shortlist:
        return None
    refined = [refine(library, current, s) for s in shortlist[:_SHORTLIST]]
    return simplest(refined)


def shortlist_of(scores: Sequence[Score], taken: Collection[str]) -> list[Score]:
    """The best shape of each mechanism that is not taken, best first."""
    best: dict[str, Score] = {}
    for s in scores:
        if s.term.name not in taken and (s.term.name not in best or s.bic < best[s.term.name].bic):
            best[s.term.name] = s
    return sorted(best.values(), key=lambda s: s.bic)


def simplest(scores: Sequence[Score]) -> Score:
    """The score of least BIC, or the simplest of those within a tie of it."""
    least = min(s.bic for s in scores)
    near = [s for s in scores if s.bic <= least + _TIE]
    # A constant on a vertical axis is rather a weight than a wrong sensor.
    return min(
        near, key=lambda s: (np.count_nonzero(s.amplitudes) + s.term.free, s.term.mechanism.kind == "data_fault", s.bic)
    )


def refine(library: Library, current: Basis, score: Score, rounds: int = 1) -> Score:
    """The same mechanism with its shape moved off the grid, one parameter after another."""
    best = score
    for _ in range(rounds):
        for parameter in score.term.mechanism.shape:
            best = _refine_one(library, current, best, parameter)
            if parameter.first:
                best = _other_forms(library, current, best, parameter)
    return best


def _other_forms(library: Library, current: Basis, score: Score, parameter: Parameter) -> Score:
    """The same law with the form of a choice that fits best; of what it does at rest where the library asks for that at
    all."""
    mechanism, shape, name = score.term.mechanism, dict(score.term.shape), parameter.name
    if name != "rest":
        shapes = [{**shape, name: value} for value in parameter.values]
    elif any(dict(t.shape).get(name) for t in library.terms if t.name == score.term.name):
        shapes = list(mechanism.forms_at_rest(shape))
    else:
        return score
    best = score
    for shape in shapes:
        found = library.score(score.term.with_shape(**shape), current)
        if found is not None and found.bic < best.bic:
            best = found
    return best


def _refine_one(library: Library, current: Basis, score: Score, parameter: Parameter) -> Score:
    shape = dict(score.term.shape)
    low, high = score.term.mechanism.around(parameter.name, shape, library.mismatch.states)
    if not low < high or (parameter.scale == "log" and low <= 0):
        return score
    to, back = (np.log, np.exp) if parameter.scale == "log" else (np.asarray, np.asarray)
    low, high = float(to(low)), float(to(high))
    best = score

    def loss(u: float) -> float:
        nonlocal best
        found = library.score(score.term.with_shape(**{parameter.name: float(back(u))}), current)
        if found is None:
            return current.rss
        if found.bic < best.bic:
            best = found
        return current.rss - found.gain

    minimize_scalar(loss, bounds=(low, high), method="bounded", options={"maxiter": 9, "xatol": 0.01 * (high - low)})
    return best


def swap(library: Library, noise: Noise, terms: list[Term], but: frozenset[str] = frozenset()) -> list[Term]:
    """Each term against every other mechanism but those in `but`, the rest kept."""
    if len(terms) < 2:
        return terms
    for _ in range(2):
        changed = False
        for i in range(len(terms)):
            rest = without(terms, i)
            current = basis(library, noise, rest)
            whole = basis(library, noise, terms).bic
            best = best_addition(library, current, but | {t.name for t in rest})
            if best is not None and best.bic < whole - 1.0:
                terms = [*terms[:i], best.term, *terms[i + 1 :]]
                changed = True
        if not changed:
            break
    return terms


def drop_useless(library: Library, noise: Noise, terms: list[Term], least_gain: float = 6.0) -> list[Term]:
    """Terms whose removal costs less than `least_gain` of BIC are removed, the least useful first."""
    while terms:
        whole = basis(library, noise, terms).bic
        left = [basis(library, noise, without(terms, i)).bic for i in range(len(terms))]
        i = int(np.argmin(left))
        if left[i] > whole + least_gain:
            break
        terms = without(terms, i)
    return terms
