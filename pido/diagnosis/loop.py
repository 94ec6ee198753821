"""How late a drive answers: an effect passes the loop of its drive before a current shows it.

In:  one axis, the terms of its joint model.
Out: the same terms, all behind one loop of equal lags where that leaves clearly less; what is quick (friction at low
     speed, a reversal) is blunted by the loop, and would be taken for weaker and longer than it is. And the loop
     itself, where fewer terms behind it do what more do without: what a loop makes of one law, several can imitate.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from pido.diagnosis.confirm import even, less_error, no_more_error, plain_error
from pido.diagnosis.estimate import settle_shapes
from pido.diagnosis.forms import AS_GOOD
from pido.diagnosis.identify import LEAST_GAIN
from pido.diagnosis.late import Lagged
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.terms import Term, behind, fit
from pido.diagnosis.whiten import Noise
from pido.physics.drive import AT_ONCE, MOST_LAGS, Loop

_SHORTEST = 0.25  # steps: what is shorter is not seen
_LONGEST_S = 0.1  # what answers later has causes of its own
_FEWEST_STEPS = 2.0  # that are tried where a step is longer than that
_TIMES = 5
_LAGS = range(1, MOST_LAGS + 1)
_LESS = 0.002  # of the error on unseen folds
_CLEARLY_LESS = 0.01


def answered(mismatch: Mismatch, noise: Noise, terms: Sequence[Term]) -> list[Term]:
    """`terms` with their shapes settled, those that a drive answers behind one loop where it makes them clearly better.

    Where they are behind one already, they stay so, but for one that is too short to be seen, or of as many lags as
    say clearly more.
    """
    loop = longest(t.loop for t in terms)
    if 0 < loop.lag < _SHORTEST * mismatch.step:
        at_once = settle_shapes(mismatch, noise, [t.behind(AT_ONCE) for t in terms])
        return at_once if no_more_error(mismatch, at_once, terms, AS_GOOD) else list(terms)
    if not any(_passes(t) for t in terms):
        return list(terms)
    if loop:
        return _of_as_many_lags(mismatch, noise, list(terms))
    late, at_once = settle_shapes(mismatch, noise, _behind_one(mismatch, noise, terms)[1]), fit(mismatch, noise, terms)
    if fit(mismatch, noise, late).rss >= at_once.rss:
        return list(terms)  # where one lag takes nothing away, two do not
    late = _of_as_many_lags(mismatch, noise, late)
    gain = at_once.bic - fit(mismatch, noise, late).bic - np.log(mismatch.n)
    return late if gain > LEAST_GAIN and less_error(mismatch, late, terms, _LESS) else list(terms)


def longest(loops: Iterable[Loop]) -> Loop:
    """The one that answers latest; none where there is none."""
    return max(loops, key=lambda loop: loop.lag, default=AT_ONCE)


def loop_of(mismatch: Mismatch, terms: Sequence[Term]) -> Loop:
    """That behind which some of `terms` alone leave no more error than all of them do at once; none where none is
    needed.

    What has no name may have stood for the loop, and is not asked; where it answers late itself, that is the lag.
    """
    noise = even(mismatch)
    chosen = [t for t in terms if t.mechanism.kind == "data_fault" or t.name == "external_force"]
    left = [t for t in terms if _passes(t) and t.name != "unknown"]
    all_at_once = plain_error(mismatch, terms) if left else 0.0  # the same forces are among those that are chosen
    while left:
        trials = [_behind_one(mismatch, noise, [*chosen, form]) for t in left for form in _at_rest(t)]
        chosen = settle_shapes(mismatch, noise, min(trials, key=lambda trial: trial[0])[1])
        chosen = _of_as_many_lags(mismatch, noise, chosen)
        left = [t for t in left if t.name != chosen[-1].name]
        if plain_error(mismatch, chosen) <= AS_GOOD * all_at_once:
            loop = longest(t.loop for t in chosen)
            if loop.lag < _SHORTEST * mismatch.step:
                return AT_ONCE
            at_once = settle_shapes(mismatch, noise, [t.behind(AT_ONCE) for t in chosen])
            return loop if less_error(mismatch, chosen, at_once, _CLEARLY_LESS) else AT_ONCE
    late = [dict(t.shape)["tau"] for t in terms if isinstance(t.mechanism, Lagged)]
    return longest(Loop(tau) for tau in late if _SHORTEST * mismatch.step < tau < _LONGEST_S)


def _at_rest(term: Term) -> list[Term]:
    """A friction as it is, and as one that ends with the motion: what is held may have stood for the lag."""
    return [term, term.with_shape(rest=0.0)] if dict(term.shape).get("rest") else [term]


def _passes(term: Term) -> bool:
    return term.behind(Loop(1.0)) != term.behind(AT_ONCE)


def _behind_one(mismatch: Mismatch, noise: Noise, terms: Sequence[Term]) -> tuple[float, list[Term]]:
    """`terms` behind the lag that fits best with their shapes as they are, and the sum of squares that is left."""
    taus = np.geomspace(_SHORTEST * mismatch.step, max(_LONGEST_S, _FEWEST_STEPS * mismatch.step), _TIMES)
    late = [_passes(t) for t in terms]
    at_once = [t.behind(AT_ONCE).columns(mismatch.states) for t in terms]

    def left(loop: Loop) -> float:
        columns = [behind(c, mismatch.states, loop) if is_late else c for c, is_late in zip(at_once, late, strict=True)]
        return fit(mismatch, noise, terms, columns).rss

    rss, tau = min((left(Loop(float(tau))), float(tau)) for tau in taus)
    return rss, [t.behind(Loop(tau)) for t in terms]


def _of_as_many_lags(mismatch: Mismatch, noise: Noise, terms: list[Term]) -> list[Term]:
    """`terms`, settled behind one loop, with as many lags in it as say clearly more than any other number."""
    for lags in _LAGS:
        trial = [t.behind(replace(t.loop, lags=lags)) if t.loop else t for t in terms]
        if trial == terms:
            continue
        trial = settle_shapes(mismatch, noise, trial)
        if fit(mismatch, noise, trial).bic < fit(mismatch, noise, terms).bic - LEAST_GAIN:
            terms = trial
    return terms
