"""What any model has to beat: three predictors that need no method at all.

In:  training samples. Out: functions from samples to currents (n, 4), A, by name.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from sklearn.neighbors import KNeighborsRegressor

from pido.core.arrays import Float2D
from pido.core.axes import AXES
from pido.core.columns import INPUTS
from pido.core.samples import Samples

Predictor = Callable[[Samples], Float2D]
_COMMANDS = [INPUTS.index(f"v_{axis}") for axis in AXES]


def constant(train: Samples) -> Predictor:
    """The mean current of each axis."""
    known = np.isfinite(train.currents)
    number = known.sum(axis=0)
    mean = np.where(number > 0, np.where(known, train.currents, 0.0).sum(axis=0) / np.maximum(number, 1), np.nan)
    return lambda samples: np.tile(mean, (len(samples), 1))


def friction_line(train: Samples) -> Predictor:
    """Each axis by itself: 1, the held direction, v and a of that axis; minimum-norm least squares."""
    found = np.full((4, 4), np.nan)
    for i in range(4):
        known = np.isfinite(train.currents[:, i])
        if known.any():
            found[i] = np.linalg.lstsq(_line(train, i)[known], train.currents[known, i], rcond=1e-10)[0]
    return lambda samples: np.column_stack([_line(samples, i) @ found[i] for i in range(4)])


def nearest_commands(train: Samples, neighbours: int = 5) -> Predictor:
    """Mean current of the training rows whose commanded speeds are nearest, each speed in units of its spread."""
    scale = np.maximum(np.std(train.inputs[:, _COMMANDS], axis=0), 1e-9)
    models = {}
    for i in range(4):
        known = np.isfinite(train.currents[:, i])
        if known.any():
            models[i] = KNeighborsRegressor(min(neighbours, int(known.sum()))).fit(
                train.inputs[known][:, _COMMANDS] / scale, train.currents[known, i]
            )

    def predict(samples: Samples) -> Float2D:
        out = np.full((len(samples), 4), np.nan)
        for i, model in models.items():
            out[:, i] = model.predict(samples.inputs[:, _COMMANDS] / scale)
        return out

    return predict


RIVALS: dict[str, Callable[[Samples], Predictor]] = {
    "constant": constant,
    "friction line": friction_line,
    "nearest commands": nearest_commands,
}


def _line(samples: Samples, axis: int) -> Float2D:
    name = AXES[axis]
    v, a = samples.inputs[:, INPUTS.index(f"v_{name}")], samples.inputs[:, INPUTS.index(f"a_{name}")]
    return np.column_stack([np.ones(len(samples)), samples.direction[:, axis], v, a])
