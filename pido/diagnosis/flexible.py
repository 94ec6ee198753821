"""What a flexible model of the state predicts of a residual on blocks that it has not seen.

In:  what is left of one axis' mismatch, and everything that the recording knows about the state.
Out: the share that is predicted; the residual without it; the residual as averages over the memory of its noise.
A flexible model has no say in naming. It only tells when a name would be dressing up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.ensemble import HistGradientBoostingRegressor

from pido.core.arrays import Bool1D, Float1D, Float2D, Int1D
from pido.diagnosis.confirm import p_of_mean
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.signals import Known, common_signals
from pido.diagnosis.terms import bic
from pido.diagnosis.whiten import Noise

_TREES: dict[str, Any] = dict(
    max_iter=30,
    learning_rate=0.25,
    max_leaf_nodes=10,
    min_samples_leaf=30,
    l2_regularization=5.0,
    early_stopping=False,
)
_OF_OTHERS = ("kappa",)  # speeds and accelerations say it too, and on straight lines it is the noise of both
_MOST_ROWS = 8_000
_FEWEST_ROWS = 200
_FLAT = 1e-9  # of a column's power: nothing of it is left beside another


@dataclass(frozen=True, slots=True)
class Structure:
    """What a flexible model predicts of a residual on folds that it has not seen.

    explained : A² – mean square that it takes away (may be negative)
    share : of the residual's mean square
    p_value : one-sided, blocks as observations
    """

    explained: float
    share: float
    p_value: float


def _features(mismatch: Mismatch, rows: Int1D) -> Known:
    """The signals in some rows, without what follows from others of them and is mostly noise; none of too few rows."""
    if len(rows) < _FEWEST_ROWS:
        return {}
    return {name: v for name, v in common_signals(mismatch.states, rows).items() if name not in _OF_OTHERS}


def structure(mismatch: Mismatch, residual: Float1D, noise: Noise, seed: int) -> Structure:
    """How much of `residual` a flexible model of the state predicts on unseen folds."""
    few = coarse(mismatch, residual, noise)
    known = _features(mismatch, few.rows)
    if not known:
        return Structure(0.0, 0.0, 1.0)
    features = np.column_stack([v for v, _ in known.values()])
    fold = _three_folds(mismatch, few.rows)
    y, prediction = few.values, np.zeros(len(few.rows))
    top = 8 * float(np.median(np.abs(y)) / 0.6745 + 1e-12)
    for k in np.unique(fold):
        learn = fold != k
        trees = HistGradientBoostingRegressor(random_state=seed, **_TREES)
        trees.fit(features[learn], np.clip(y[learn], -top, top))
        prediction[~learn] = trees.predict(features[~learn])
    gain = y**2 - (y - prediction) ** 2
    block = mismatch.block[few.rows]
    count = np.bincount(block)
    p = p_of_mean(np.bincount(block, gain * few.weights)[count > 0])
    total = float(np.mean(y**2)) or 1.0
    return Structure(float(np.mean(gain)), float(np.mean(gain)) / total, p)


def flexible_rest(
    mismatch: Mismatch,
    residual: Float1D,
    seed: int = 0,
    without: frozenset[str] = frozenset(),
    by_part: bool = False,
) -> Float1D:
    """(n,), A – `residual` without what a flexible model of the state predicts of it on blocks that it has not seen.

    without : signals that the model is not told
    by_part : parts that it has not seen, in place of blocks: places and loads tell the time, within one part

    What is left is the nearest thing to noise that can be had before anything has a name. The prediction is made on
    few rows and drawn between them; it is scaled back where it does not hold.
    """
    width = max(1, int(np.ceil(mismatch.n / _MOST_ROWS)))
    rows = np.arange(width // 2, mismatch.n, width)
    rows = rows[mismatch.usable[rows]]
    every = _features(mismatch, rows)
    known = {name: v for name, v in every.items() if name not in without}
    if not known:
        return residual
    features = np.column_stack([v for v, _ in known.values()])
    padded = np.where(mismatch.usable, residual, 0.0)
    y = (
        np.convolve(padded, np.ones(width), "same")
        / np.maximum(np.convolve(mismatch.usable, np.ones(width), "same"), 1)
    )[rows]
    top = 8 * float(np.median(np.abs(y)) / 0.6745 + 1e-12)
    fold = mismatch.fold[rows] if by_part else mismatch.block[rows] % 3
    prediction = np.zeros(len(rows))
    for k in np.unique(fold):
        trees = HistGradientBoostingRegressor(random_state=seed, **_TREES)
        trees.fit(features[fold != k], np.clip(y[fold != k], -top, top))
        prediction[fold == k] = trees.predict(features[fold == k])
    power = float(prediction @ prediction)
    holds = float(np.clip(prediction @ y / power, 0.0, 1.0)) if power > 0 else 0.0
    return residual - holds * np.interp(np.arange(mismatch.n), rows, prediction)


@dataclass(frozen=True, slots=True)
class Coarse:
    """A residual averaged over the memory of its noise: few rows that hold nearly all that the many do.

    rows : (m,) – row in the middle of each average; part : (m,) – number of its part; values : (m,), A;
    weights : (m,), 1/A²
    """

    rows: Int1D
    part: Int1D
    values: Float1D
    weights: Float1D

    def of(self, rows: Bool1D) -> Coarse:
        """Those of the averages."""
        return Coarse(self.rows[rows], self.part[rows], self.values[rows], self.weights[rows])


def coarse(mismatch: Mismatch, residual: Float1D, noise: Noise, most: int = _MOST_ROWS) -> Coarse:
    """Averages over half the memory of the noise, or longer where there would be more than `most`."""
    memory = min(noise.memory / 2, mismatch.n / 1000)
    width = max(1, round(memory), int(np.ceil(mismatch.n / most)))
    n = mismatch.n // width * width
    usable = mismatch.usable[:n].reshape(-1, width)
    count = usable.sum(axis=1)
    sums = (residual[:n].reshape(-1, width) * usable).sum(axis=1)
    rows = np.arange(width // 2, n, width)
    same = mismatch.part[np.arange(0, n, width)] == mismatch.part[np.arange(width - 1, n, width)]
    keep = (count > width / 2) & same
    level = noise.level[rows]
    return Coarse(rows[keep], mismatch.part[rows[keep]], sums[keep] / count[keep], level[keep] ** -2.0)


def price(columns: Float2D, few: Coarse) -> float:
    """BIC of what columns (m, k) leave of the averages."""
    root = np.sqrt(few.weights)
    rows, values = columns * root[:, None], few.values * root
    size = np.sqrt(np.einsum("ij,ij->j", rows, rows))
    whole = float(values @ values)
    if not size.all():
        return bic(whole, len(values), 0)
    gram, inner = (rows.T @ rows) / np.outer(size, size), rows.T @ values / size
    beta = np.linalg.lstsq(gram, inner, rcond=_FLAT)[0]
    return bic(whole - float(beta @ inner), len(values), len(size))


def _three_folds(mismatch: Mismatch, rows: Any) -> Any:
    fold = np.unique(mismatch.fold[rows], return_inverse=True)[1]
    # One fold alone cannot be predicted from others: thirds of the time in its place.
    return fold % 3 if fold.max() > 0 else 3 * np.arange(len(rows)) // len(rows)
