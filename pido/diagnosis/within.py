"""Laws without a name in a box: in that of a law with a name, which is the textbook's nearest of many that are alike
where an axis goes one way only, or at hardly more than one speed; and in a box of their own, without which a law is
weak and another one, or a surface, comes nearer.

In:  the terms of one axis. Out: the same, with a law without a name in a box in the place of one where it says clearly
     more.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from pido.diagnosis.arms import arms
from pido.diagnosis.confirm import forces_among, no_more_error
from pido.diagnosis.flexible import coarse
from pido.diagnosis.formulas import LOOKED_AT
from pido.diagnosis.gates import Gate
from pido.diagnosis.library import Basis, Library, Score, basis
from pido.diagnosis.products import QuickLaws, gains_by_averages
from pido.diagnosis.regions import in_its_best_box, with_best_limits, with_own_limits
from pido.diagnosis.terms import Term, fit, without
from pido.diagnosis.unnamed import clearly_less, ground_of, is_known, laws_beside
from pido.diagnosis.whiten import Noise

_MARGIN = 25.0 + 2 * np.log(LOOKED_AT)  # BIC by which a law without a name must win
_SHARE = 0.1  # of what the former law gains, by which it must win as well: less is what its own form lacks
_BOXED = 24  # laws that are tried in boxes of their own


def nameless_within(library: Library, noise: Noise, terms: list[Term]) -> list[Term]:
    """`terms`, each that has a name and is confined as what says clearly more in its box, and each that has none and is
    not as what says clearly more in a box of its own; one such law alone where it says more than all of them."""
    library.whiten(noise)
    out = list(terms)
    for i, term in enumerate(terms):
        if term.gates and term.name != "unknown" and term.mechanism.kind != "data_fault":
            out = _instead(library, noise, out, i) or out
        elif term.name == "unknown" and not term.gates:
            out = _confined(library, noise, out, i) or out
    return _one_for_all(library, noise, out) or out


def _instead(library: Library, noise: Noise, terms: Sequence[Term], i: int) -> list[Term] | None:
    """`terms` with a law without a name in the box of one of them."""
    rest, gates = without(terms, i), terms[i].gates
    current = basis(library, noise, rest)
    tried = (replace(law, gates=gates) for law in laws_in(library, noise, rest, gates))
    scores = (s for t in tried if (s := library.score(t, current)) is not None)
    best = min((s for s in scores if not is_known(library, noise, s)), key=lambda s: s.bic, default=None)
    if best is None or not _likelier(library, noise, terms, best, current):
        return None
    return _clearly(library, [*terms[:i], with_own_limits(library, current, best.term), *terms[i + 1 :]], terms)


def _confined(library: Library, noise: Noise, terms: Sequence[Term], i: int) -> list[Term] | None:
    """`terms` with any law without a name, in a box, in the place of one that acts everywhere."""
    rest = without(terms, i)
    best, current = _best_confined(library, noise, rest), basis(library, noise, rest)
    if best is None or not _likelier(library, noise, terms, best, current):
        return None
    return _clearly(library, [*terms[:i], best.term, *terms[i + 1 :]], terms)


def _one_for_all(library: Library, noise: Noise, terms: Sequence[Term]) -> list[Term] | None:
    """One law without a name in a box, in the place of several that stand for it."""
    rest = [t for t in terms if t.mechanism.kind == "data_fault" or forces_among([t])]
    if len(terms) - len(rest) < 2:
        return None
    best = _best_confined(library, noise, rest)
    if best is None or best.bic > basis(library, noise, terms).bic - _MARGIN:
        return None
    trial = [best.term, *rest]
    return trial if no_more_error(library.mismatch, trial, terms) else None


def _best_confined(library: Library, noise: Noise, rest: list[Term]) -> Score | None:
    """The likeliest law without a name in a box, beside some terms."""
    current = basis(library, noise, rest)
    best = in_its_best_box(library, current, laws_beside(library, noise, rest)[:_BOXED])
    if best is None:
        return None
    # What fits best everywhere need not be likeliest in the box.
    gates = best.term.gates
    best = with_best_limits(library, current, laws_in(library, noise, rest, gates), gates) or best
    return None if is_known(library, noise, best) else best


def laws_in(library: Library, noise: Noise, start: Sequence[Term], gates: tuple[Gate, ...]) -> list[Term]:
    """Laws without a name that take most away in a box of what `start` leaves; without that box."""
    mismatch, ground = library.mismatch, ground_of(library, noise)
    within = np.prod([library.inside(g) for g in gates], axis=0)
    residual = fit(mismatch, noise, start).residual
    few = coarse(mismatch, residual, noise)
    there = within[few.rows] > 0
    known = {name: (values[there], unit) for name, (values, unit) in ground.thin.items()}
    averages = few.of(there)
    gains = [(gain, Term(law)) for law, gain in gains_by_averages(ground.formulas, known, averages)]
    gains += [(gain, Term(law)) for gain, law in arms(mismatch.axis, known, averages)]
    quick = QuickLaws(mismatch.axis, ground.whole, noise, within=within).best(residual)
    ranked = heapq.nlargest(_BOXED, gains, key=lambda g: g[0])
    return [t.behind(library.loop) for t in dict.fromkeys([*(t for _, t in ranked), *map(Term, quick)])]


def _likelier(library: Library, noise: Noise, terms: Iterable[Term], score: Score, current: Basis) -> bool:
    """Whether a law says clearly more than the one of `terms` that is not in `current`."""
    whole = basis(library, noise, list(terms)).bic
    return score.bic < whole - _MARGIN - _SHARE * (current.bic - whole)


def _clearly(library: Library, trial: list[Term], terms: Sequence[Term]) -> list[Term] | None:
    return trial if clearly_less(library.mismatch, trial, terms) else None
