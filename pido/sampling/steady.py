"""Where a coming path leaves what was recorded, who wavers less: the model, or an equation?

In:  rows of the path, recorded rows, term sets, a way to train a model. Out: currents of an equation, where it is
     followed, and their expected errors.

No play of an arrival (`pido.sampling.trust`) shows what happens where nothing like the path was ever recorded. A spindle
that ran at one speed has drawn a lot of current while it ran up through all lower ones: whether that was for the
acceleration or for the speed is the same to a forest, and at another speed its trees contradict each other.

So both are asked again with one stretch left out in turn. Their variance on a row is that of the jackknife,
    s² = sum over stretches (what is said without it - what is said with all)²
and of an equation, which cannot bend to what it does not contain, its mean square residual is added. It is followed
where its standard error is a third of the model's at most, and only for an axis where on half of the stretches, left
out, it was no worse than the model: being steady is not being right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pido.core.arrays import Float2D
from pido.core.machining import Machine
from pido.core.samples import Samples, Train
from pido.equations.fit import fit_global
from pido.equations.terms import TermSet
from pido.feature_space.regional import folds

_STEADIER = 3.0  # times
_ASKED = 4_000  # recorded rows that are asked: an even share of them says as much
_LEAST = 20  # rows on either side of a stretch
_STRETCHES = 4  # fewer say nothing about how much an answer wavers


def steadier(
    rows: Samples, real: Samples, machine: Machine, tried: Sequence[TermSet], train: Train
) -> tuple[Float2D, Float2D]:
    """Currents and their expected errors, (n, 4) each, A; NaN where no equation is followed.

    An axis follows the equation that wavers least on these rows, of those in `tried` that were no worse than the model.
    """
    real = real.take(np.lexsort((real.row, real.part.astype(str))))
    said, error = np.full((len(rows), 4), np.nan), np.full((len(rows), 4), np.nan)
    if len(real) > _ASKED:
        real = real.take(np.linspace(0, len(real) - 1, _ASKED).astype(np.int64))
    fold = folds(real)
    outs = [out for k in np.unique(fold) if min((out := fold == k).sum(), (~out).sum()) >= _LEAST]
    if len(outs) < _STRETCHES or not len(rows):
        return said, error
    whole = [_model(real, train), *(fit_global(real, machine, terms).predict for terms in tried)]
    known = [_mean_square(real.currents - ask(real)) for ask in whole]
    answer = [ask(rows) for ask in whole]
    waver, missed = np.zeros((len(whole), len(rows), 4)), np.zeros((len(whole), len(outs), 4))
    for k, out in enumerate(outs):
        rest, left = real.take(~out), real.take(out)
        asks = [_model(rest, train), *(fit_global(rest, machine, terms).predict for terms in tried)]
        for c, ask in enumerate(asks):
            waver[c] += (ask(rows) - answer[c]) ** 2
            missed[c, k] = _mean_square(left.currents - ask(left))
    for i in range(4):
        best = np.inf
        for c in range(1, len(whole)):
            variance = waver[c, :, i] + known[c][i]
            fair = (missed[c, :, i] <= missed[0, :, i]).mean() >= 0.5
            if fair and variance.mean() < best:
                best = variance.mean()
                follow = _STEADIER**2 * variance <= waver[0, :, i]
                said[:, i] = np.where(follow, answer[c][:, i], np.nan)
                error[:, i] = np.where(follow, np.sqrt(variance), np.nan)
    return said, error


def _model(real: Samples, train: Train):
    return train(real, np.ones((len(real), 4)))


def _mean_square(miss: Float2D) -> np.ndarray:
    number = np.isfinite(miss).sum(axis=0)
    return np.where(number > 0, np.nansum(miss**2, axis=0) / np.maximum(number, 1), np.nan)
