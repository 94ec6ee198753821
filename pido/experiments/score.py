"""How wrong predicted currents are, in the words of the experiments: one row per axis.

In:  rows of the coming part with their recorded currents, predictions (n, 4).
Out: RMSE, R², MAE, 99 % and peak error (`pido.models.metrics`), and the RMSE where the load changes.
"""

from __future__ import annotations

import numpy as np

from pido.core.arrays import Bool1D, Float2D
from pido.core.axes import AXES
from pido.core.samples import Samples
from pido.experiments.base import Rows
from pido.experiments.data import varies
from pido.models.metrics import axis_metrics

WINDOW = 5
"""Rows before and after which a mean current is taken; 0.1 s at 50 Hz."""
SHARE = 0.05


def changes(samples: Samples) -> np.ndarray:
    """(n, 4): whether the load of an axis changes at a row: the 5 % of its rows where the mean current of the five rows
    before and of the five from it on differ most. Rows without such neighbours in their part never are."""
    n = len(samples)
    out = np.zeros((n, 4), bool)
    if n < 2 * WINDOW + 1:
        return out
    part = np.unique(samples.part.astype(str), return_inverse=True)[1]
    at = np.arange(WINDOW, n - WINDOW + 1)
    same = (part[at - WINDOW] == part[at + WINDOW - 1]) & (
        samples.row[at + WINDOW - 1] - samples.row[at - WINDOW] < 4 * WINDOW
    )
    total = np.vstack([np.zeros(4), np.cumsum(np.nan_to_num(samples.currents), axis=0)])
    step = np.abs((total[at + WINDOW] - total[at]) - (total[at] - total[at - WINDOW])) / WINDOW
    step[~same] = -1.0
    for i in range(4):
        if same.any():
            out[at, i] = step[:, i] >= max(float(np.quantile(step[same, i], 1.0 - SHARE)), 1e-12)
    return out


def score(samples: Samples, predicted: Float2D, where: Bool1D | None = None) -> Rows:
    """One row per recorded axis: axis, n, rmse, r2, mae, error_99, peak, at_changes (A); over the rows `where`."""
    rows: Rows = []
    keep = np.ones(len(samples), bool) if where is None else where
    moving, live = changes(samples), varies(samples.currents)
    for i, axis in enumerate(AXES):
        recorded, guess = samples.currents[keep, i], predicted[keep, i]
        found = axis_metrics(recorded, guess)
        if not found.n or not live[i]:
            continue
        error = (guess - recorded)[moving[keep, i]]
        error = error[np.isfinite(error)]
        rows.append(
            {"axis": axis, **found.as_dict(), "at_changes": float(np.sqrt(np.mean(error**2))) if len(error) else np.nan}
        )
    return rows
