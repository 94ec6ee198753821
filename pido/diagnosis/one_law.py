"""One law for two boxes in which two laws were found that cannot be told from it there.

In:  the terms of one axis, its library and noise.
Out: the same terms, two of them under one name where each says it as well in its own box, with one and the same size.
In a box an axis may go one way only, and be always in a cut: a friction, a coupling and an edge force are all a
constant there. One law that has the same number in both boxes is likelier than two laws that happen to be equal.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pido.diagnosis.forms import LIKELIER
from pido.diagnosis.library import Library, basis
from pido.diagnosis.regions import best_region
from pido.diagnosis.terms import Term, fit, without
from pido.diagnosis.whiten import Noise

_NEARLY = 60.0  # BIC by which one law for both may be worse than two, before its boxes have limits of their own
_SAME_SIZE, _SURE = 0.05, 3.0  # of their mean, and standard errors of the difference, by which two sizes may differ


def one_law(library: Library, noise: Noise, terms: Sequence[Term]) -> list[Term]:
    """`terms`, with every two in boxes that one law of the catalogue without a free shape explains as well as that
    law."""
    out = list(terms)
    for i, j in itertools.combinations(range(len(out)), 2):
        same = out[i].name == out[j].name and _of_one_size(library, noise, out, i, j)
        if out[i].gates and out[j].gates and not same and not _nameless([out[i], out[j]]):
            trials = [_in_both(out, i, j, law) for law in _laws(library, out, i, j)]
            equal = [t for t in trials if _of_one_size(library, noise, t, i, j)]
            best = min(equal, key=lambda t: basis(library, noise, t).bic, default=out)
            if best is not out and basis(library, noise, best).bic < basis(library, noise, out).bic + _NEARLY:
                best = _with_own_boxes(library, noise, best, i, j)
                if basis(library, noise, best).bic < basis(library, noise, out).bic + LIKELIER:
                    out = best
    return out


def _with_own_boxes(library: Library, noise: Noise, terms: list[Term], *which: int) -> list[Term]:
    """`terms`, some of which have boxes that were found for other laws, with those that fit them best."""
    others = {t.name for t in library.terms} | {"unknown"}
    for k in which:
        found = best_region(library, basis(library, noise, without(terms, k)), others - {terms[k].name})
        trial = terms if found is None else [*terms[:k], found.term, *terms[k + 1 :]]
        terms = min(terms, trial, key=lambda t: basis(library, noise, t).bic)
    return terms


def _laws(library: Library, terms: Sequence[Term], i: int, j: int) -> list[Term]:
    """Laws of one number, of each name the first form; and that of either term."""
    others = {t.name for k, t in enumerate(terms) if k not in (i, j)}
    by_name = {t.name: t for t in reversed(library.terms) if t.name not in others and not _nameless([t])}
    laws = [*by_name.values(), terms[i], terms[j]]
    return [t for t in laws if not t.mechanism.free(dict(t.shape)) and len(t.mechanism.amplitudes) == 1]


def _in_both(terms: Sequence[Term], i: int, j: int, law: Term) -> list[Term]:
    return [replace(law, gates=t.gates, loop=t.loop) if k in (i, j) else t for k, t in enumerate(terms)]


def _of_one_size(library: Library, noise: Noise, terms: Sequence[Term], i: int, j: int) -> bool:
    """Whether two terms have one number each, and these do not differ."""
    if not all(np.any(library.columns(terms[k])) for k in (i, j)):
        return False
    joint = fit(library.mismatch, noise, terms)
    place = len(joint.base) + np.cumsum([0, *(len(a) for a in joint.amplitudes)])
    if len(joint.amplitudes[i]) != 1 or len(joint.amplitudes[j]) != 1:
        return False
    (a,), (b,) = joint.amplitudes[i], joint.amplitudes[j]
    p, q = int(place[i]), int(place[j])
    cover = joint.covariance
    error = float(np.sqrt(max(cover[p, p] + cover[q, q] - 2 * cover[p, q], 0.0)))
    return a * b > 0 and abs(a - b) < max(_SAME_SIZE * abs(a + b) / 2, _SURE * error)


def _nameless(terms: Sequence[Term]) -> bool:
    return any(t.name in ("unknown", "external_force") for t in terms)
