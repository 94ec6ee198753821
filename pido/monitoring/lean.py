"""What a model is wrong by in proportion to what goes on: on a part unlike those before, forests stay where they were.

In:  window means of held-out residuals of several parts, and the means of model inputs and prediction over the windows.
Out: the residual to be expected in a state, A, linear in it, and how much less sure it is there than where it was
     learnt; nothing where that does not help on parts left out.

Trees cannot extrapolate: under a load that no part had so far they are wrong by about the missing load, which no width
of a band tells from a change of the load. A linear law found on the parts that were left out takes most of that away,
wherever the current is near to linear in load and speed, as the spindle's is. Bayesian ridge regression (MacKay 1992)
on standardised columns: the evidence sets its strength, and its posterior says where columns take values that the parts
hardly had. Whether it is used at all is decided by parts that were not in the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from sklearn.linear_model import BayesianRidge
from sklearn.model_selection import GroupKFold, cross_val_predict
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler

from pido.core.arrays import Float1D, Float2D, Int1D

LEAST_PARTS = 3
"""Fewer cannot say whether what was learnt on parts holds on another."""
FOLDS = 5
WORTH = 0.8
"""The mean size of what is left on a part that was not in the fit has to fall below this share of what was there."""

Parts = Sequence[tuple[Float2D, Float1D]]


@dataclass(frozen=True, eq=False)
class Lean:
    """Residual by state: `offset + (means - centre) @ slope`, A; `unsure` (d, d): covariance of the slope, in units of
    the residual's own variance."""

    centre: Float1D
    slope: Float1D
    offset: float
    unsure: Float2D

    def __call__(self, means: Float2D) -> tuple[Float1D, Float1D]:
        """(n,), A, and (n,), the factor by which the spread is larger, 1 where much was learnt.

        means : (n, d); rows with NaN give NaN
        """
        away = means - self.centre
        return self.offset + away @ self.slope, np.sqrt(1.0 + np.sum(away @ self.unsure * away, axis=1))


def worth_it(parts: Parts) -> bool:
    """Whether a law leaves less on parts that were not in the fit.

    parts : per part the windows' means (m, d) and mean residuals (m,)
    """
    means, residual, part = _rows(parts)
    count = len(np.unique(part))
    if count < LEAST_PARTS:
        return False
    said = cross_val_predict(_law(), means, residual, groups=part, cv=GroupKFold(min(FOLDS, count)))
    left, before = (np.bincount(part, np.abs(r)) / np.bincount(part) for r in (residual - said, residual))
    return bool(left.sum() < WORTH * before.sum())


def fit_lean(parts: Parts) -> Lean:
    """The law on these parts."""
    means, residual, _ = _rows(parts)
    law = _law().fit(means, residual)
    scale, ridge = law.named_steps["scale"], law.named_steps["ridge"]
    size = np.asarray(scale.scale_)
    unsure = ridge.alpha_ * ridge.sigma_ / np.outer(size, size)
    return Lean(np.asarray(scale.mean_), ridge.coef_ / size, float(ridge.intercept_), unsure)


def _law() -> Pipeline:
    return Pipeline([("scale", StandardScaler()), ("ridge", BayesianRidge())])


def _rows(parts: Parts) -> tuple[Float2D, Float1D, Int1D]:
    """Windows of which all is known: means, residual, number of the part."""
    whole = [(means, residual, np.isfinite(means).all(axis=1) & np.isfinite(residual)) for means, residual in parts]
    known = [(means[k], residual[k]) for means, residual, k in whole if k.any()]
    if not known:
        return np.zeros((0, 1)), np.zeros(0), np.zeros(0, np.int64)
    part = np.repeat(np.arange(len(known)), [len(residual) for _, residual in known])
    return np.vstack([means for means, _ in known]), np.concatenate([residual for _, residual in known]), part
