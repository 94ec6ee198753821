"""How wrong predicted currents are, per axis.

In:  recorded and predicted currents (n, 4), A. Out: RMSE, R², MAE, the error that 99 % of the samples stay below, and
     the RMSE where the load is highest. A missing current counts nowhere.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.core.axes import AXES


@dataclass(frozen=True)
class AxisMetrics:
    """Of one axis; NaN throughout where it has no current."""

    n: int
    rmse: float  # A
    r2: float  # –, 1 - residual sum of squares over that of the mean; NaN for a constant current
    mae: float  # A
    error_99: float  # A, 99 % quantile of the absolute error
    peak: float  # A, RMSE over the 1 % of the samples whose current is furthest from the median

    def as_dict(self) -> dict[str, float]:
        return asdict(self)


def axis_metrics(recorded: Float1D, predicted: Float1D) -> AxisMetrics:
    """Metrics of one axis over the samples where both are known."""
    known = np.isfinite(recorded) & np.isfinite(predicted)
    y, error = recorded[known], (predicted - recorded)[known]
    if not len(y):
        return AxisMetrics(0, *[float("nan")] * 5)
    spread = float(np.sum((y - y.mean()) ** 2))
    load = np.abs(y - np.median(y))
    peak = error[load >= np.quantile(load, 0.99)]
    return AxisMetrics(
        n=len(y),
        rmse=float(np.sqrt(np.mean(error**2))),
        r2=1.0 - float(np.sum(error**2)) / spread if spread > 0 else float("nan"),
        mae=float(np.mean(np.abs(error))),
        error_99=float(np.quantile(np.abs(error), 0.99)),
        peak=float(np.sqrt(np.mean(peak**2))),
    )


def metrics(recorded: Float2D, predicted: Float2D) -> dict[str, AxisMetrics]:
    """Metrics of each axis, by its name."""
    return {axis: axis_metrics(recorded[:, i], predicted[:, i]) for i, axis in enumerate(AXES)}
