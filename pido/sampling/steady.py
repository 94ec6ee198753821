"""Who wavers less where the coming path goes: the model, or an equation?

In:  rows of the path, recorded rows, term sets, a way to train a model. Out: currents of an equation where it is
     followed, their expected errors, and what the model's own word is off by.

No play of an arrival (`pido.sampling.trust`) shows a path unlike all that was recorded. A spindle that has run at one
speed drew a lot of current while it ran up through the lower ones. Whether that was for the acceleration or for the
speed is the same to a forest: at another speed its trees contradict each other, and more rows of the run-up make it
worse. An equation is not in doubt: a speed that changes little near the top cannot have drawn that much below.

So both are asked again with each of six stretches (or parts) left out. The variance of what is said of a row is
    s² = sum over stretches (said without it - said with all)²              (jackknife, (g - 1) / g taken as 1)
and that of an equation has its mean square residual added: what it does not contain does not waver. It is followed
where its standard error is a third of the model's at most, and for axes on which it was no worse than the model on half
of the stretches that were left out: to be steady is not to be right.

Rows where it is followed are no fair share of a path: mostly those of large currents. Where a path has a spindle speed
of its own, trees that learn of it from these rows alone take all of the path for such: on a virtual mill, right rows
made one axis four times as wrong elsewhere. So the other rows of the path go with them, with the model's own word.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.core.machining import Machine
from pido.core.samples import Samples, Train
from pido.equations.fit import fit_global
from pido.equations.terms import TermSet
from pido.feature_space.regional import folds

_STEADIER = 3.0  # times
_ASKED = 2_000  # recorded rows, evenly from all: it is asked seven times
_LEAST = 20  # rows left out, and rows left
_STRETCHES = 3  # fewer say little of how much an answer wavers


def steadier(
    rows: Samples, real: Samples, machine: Machine, tried: Sequence[TermSet], train: Train
) -> tuple[Float2D, Float2D, Float2D]:
    """Currents by an equation, their expected errors, and those of the model: (n, 4) each, A; the first two NaN where
    no equation is followed, the last where the model says nothing.

    Of the equations in `tried` that may be followed, an axis has the one that wavers least on the mean of these rows.
    """
    said, error, own = np.full((3, len(rows), 4), np.nan)
    real = real.take(np.lexsort((real.row, real.part.astype(str))))  # the order of arrival must not matter
    real = real.take(np.flatnonzero(np.isfinite(real.currents).any(axis=1)))
    if len(real) > _ASKED:
        real = real.take(np.linspace(0, len(real) - 1, _ASKED).astype(np.int64))
    fold = folds(real, 6)
    outs = [fold == k for k in np.unique(fold)]
    outs = [out for out in outs if min(out.sum(), (~out).sum()) >= _LEAST]
    if len(outs) < _STRETCHES or not len(rows):
        return said, error, own

    def asked(known: Samples) -> list[Callable[[Samples], Float2D]]:
        """The model first, then the equations."""
        return [train(known, np.ones((len(known), 4))), *(fit_global(known, machine, t).predict for t in tried)]

    answers = asked(real)
    with_all = [ask(rows) for ask in answers]
    variance = np.zeros((len(answers), len(rows), 4))
    missed = np.zeros((len(answers), len(outs), 4))
    for k, out in enumerate(outs):
        left = real.take(out)
        for c, ask in enumerate(asked(real.take(~out))):
            variance[c] += (ask(rows) - with_all[c]) ** 2
            missed[c, k] = _mean_square(ask(left) - left.currents)
    for c, ask in enumerate(answers[1:], start=1):
        variance[c] += _mean_square(ask(real) - real.currents)
    for i in range(4):
        fair = [c for c in range(1, len(answers)) if (missed[c, :, i] <= missed[0, :, i]).mean() >= 0.5]
        if fair:
            best = min(fair, key=lambda c: variance[c, :, i].mean())
            follow = _STEADIER**2 * variance[best, :, i] <= variance[0, :, i]
            said[follow, i] = with_all[best][follow, i]
            error[follow, i] = np.sqrt(variance[best, follow, i])
    own = np.sqrt(variance[0] + missed[0].mean(axis=0))
    return said, error, own


def _mean_square(miss: Float2D) -> Float1D:
    """(4,): over the rows where it is known; NaN where it never is."""
    number = np.isfinite(miss).sum(axis=0)
    return np.where(number > 0, np.nansum(miss**2, axis=0) / np.maximum(number, 1), np.nan)
