"""How late a drive answers: an effect passes the loop of its drive before a current shows it.

In:  one axis on every row, the terms of its joint model with their shapes settled.
Out: the same terms, all behind one first order lag where that leaves clearly less; what is quick (friction at low
     speed, a reversal) is blunted by the loop, and would be taken for weaker and longer than it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pido.diagnosis.confirm import less_error
from pido.diagnosis.estimate import settle_shapes
from pido.diagnosis.identify import LEAST_GAIN
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.terms import Term, fit
from pido.diagnosis.whiten import Noise

_SHORTEST = 0.25  # steps: what is shorter is not seen
_LONGEST_S = 0.1  # what answers later has causes of its own
_FEWEST_STEPS = 2.0  # that are tried where a step is longer than that
_TIMES = 6
_LESS = 0.002  # of the error on unseen folds


def answered(mismatch: Mismatch, noise: Noise, terms: Sequence[Term]) -> list[Term]:
    """`terms`, those that a drive answers with one lag where it makes them clearly better."""
    if not any(_passes(t) for t in terms):
        return list(terms)
    time = mismatch.states[0].time
    step = float(np.median(np.diff(time)))
    taus = np.geomspace(_SHORTEST * step, max(_LONGEST_S, _FEWEST_STEPS * step), _TIMES)
    trials = [[replace(t, lag=float(tau)) if _passes(t) else t for t in terms] for tau in taus]
    late = settle_shapes(mismatch, noise, min(trials, key=lambda t: fit(mismatch, noise, t).rss))
    gain = fit(mismatch, noise, terms).bic - fit(mismatch, noise, late).bic - np.log(mismatch.n)
    return late if gain > LEAST_GAIN and less_error(mismatch, late, terms, _LESS) else list(terms)


def _passes(term: Term) -> bool:
    """Whether the drive makes up for it, by a law that has no lag of its own."""
    own = bool(dict(term.shape).get("late"))
    return term.mechanism.kind == "missing_physics" and term.name not in ("unknown", "external_force") and not own
