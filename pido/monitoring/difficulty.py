"""How large a residual is to be expected in a state: large where the model was seldom right on parts it had not seen.

In:  window means of held-out residuals, and what was going on in those windows.
Out: a factor on the spread, 1 where things are as usual.

A model is worse where it extrapolates and in transients. A band that does not know this is too wide in a steady cut and
too narrow at its beginning. Dividing a score by its expected size is normalised conformal prediction (Papadopoulos &
Haralambous 2011; Lei et al. 2018); it stays honest, because the threshold is found after the division, on parts that
had no say in it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Bool1D, Float1D, Float2D
from pido.models.estimators import extra_trees
from pido.monitoring.forest import quick
from pido.monitoring.residuals import PartResiduals, window_mean

TREES, PER_LEAF = 20, 8
MOST_WINDOWS = 2500
LEAST = 80
"""Windows from which sizes are learnt; with fewer, every state counts as the same."""
FLOOR = 0.5
"""No state is expected to be better than this share of the usual size."""
FAR = 4.0
"""Beyond this many times the largest distance that held-out parts have shown, nothing is said about the residual."""
SINCE_S = 3.0
"""The beginning of a cut is told apart for so long, s."""


@dataclass(frozen=True, eq=False)
class Difficulty:
    """Factor by state: (n, f) features to (n,); NaN beyond the distances that were ever tried."""

    predict: Callable[[Float2D], Float1D]
    usual: float  # A
    farthest: float

    def __call__(self, features: Float2D) -> Float1D:
        """(n,): the factor. features : (n, f) as of `window_features`, rows with NaN give NaN"""
        out = np.full(len(features), np.nan)
        known = np.isfinite(features).all(axis=1)
        known &= np.where(known, features[:, 0], np.inf) <= np.log(FAR * self.farthest)
        if known.any():
            out[known] = np.maximum(self.predict(features[known]) / self.usual, FLOOR)
        return out


def learn_difficulty(features: Float2D, size: Float1D, seed: int = 0) -> Difficulty | None:
    """From windows of held-out parts; None where there are too few, or nothing to tell states apart by.

    features : (m, f); size : (m,), A, magnitude of the window's mean residual
    """
    known = np.isfinite(features).all(axis=1) & np.isfinite(size)
    features, size = features[known], size[known]
    if len(size) < LEAST:
        return None
    step = -(-len(size) // MOST_WINDOWS)
    forest = extra_trees(seed).set_params(n_estimators=TREES, min_samples_leaf=PER_LEAF)
    forest.fit(features[::step], size[::step])
    usual = max(float(np.median(size)), 1e-12)
    return Difficulty(quick(forest), usual, float(np.exp(np.quantile(features[:, 0], 0.999))))


def window_features(part: PartResiduals, axis: int, width: int) -> Float2D | None:
    """(n, f): what was going on in the window that ends at each sample; None where the part does not say.

    Mean and spread of: log distance from the training rows, every model input, the predicted current; then for how long
    the tool has been engaged.
    """
    if part.inputs is None or part.doubt is None:
        return None
    columns = state(part.doubt, part.inputs, part.predicted[:, axis])
    known: Bool1D = np.asarray(np.isfinite(columns).all(axis=1))
    # Around their middle, or the squares of large numbers leave nothing of small spreads.
    middle = columns[known].mean(axis=0) if known.any() else np.zeros(columns.shape[1])
    means, spreads = [], []
    for column, offset in zip(columns.T, middle, strict=True):
        mean = window_mean(column - offset, width, part.due)
        square = window_mean((column - offset) ** 2, width, part.due)
        means.append(mean + offset)
        spreads.append(np.sqrt(np.maximum(square - mean**2, 0.0)))
    return np.column_stack([*means, *spreads, since(known if part.due is None else part.due, part.rate_hz)])


def means_of(features: Float2D) -> Float2D:
    """(n, d + 1): the windows' means of model inputs and prediction, out of their features."""
    return features[:, 1 : (features.shape[1] - 1) // 2]


def state(doubt: Float1D, inputs: Float2D, predicted: Float1D) -> Float2D:
    """(n, d + 2): one sample's part of the features."""
    return np.column_stack([np.log(doubt + 1e-3), inputs, predicted])


def since(engaged: Bool1D, rate_hz: float) -> Float1D:
    """(n,), s: for how long every sample up to this one was engaged, at most SINCE_S."""
    at = np.arange(len(engaged))
    last_off = np.maximum.accumulate(np.where(engaged, -1, at))
    return np.minimum((at - last_off) / rate_hz, SINCE_S)


def features_of(states: Float2D, engaged_s: float) -> Float2D:
    """(1, f): the features of one window from the states (width, d + 2) of its samples."""
    return np.concatenate([states.mean(axis=0), states.std(axis=0), [min(engaged_s, SINCE_S)]])[None]
