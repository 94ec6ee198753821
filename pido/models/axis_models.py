"""Four current models, one per axis (paper, eq. 3), trained on real and generated rows.

In:  samples, weights, which estimators, a seed. Out: currents (n, 4), and a digest that is equal for equal models.
"""

from __future__ import annotations

import hashlib
import logging
import warnings
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from joblib import parallel_config
from threadpoolctl import threadpool_limits

from pido.core.arrays import Float1D, Float2D
from pido.core.axes import AXES
from pido.core.errors import FitError
from pido.core.samples import Samples
from pido.feature_space.grid import SAMPLING_GRID, Grid
from pido.feature_space.regional import HeldOut, covered, folds, join, sectors
from pido.models.estimators import EstimatorFactory, estimators, extra_trees
from pido.models.inputs import NAMES, InputKind, model_inputs

log = logging.getLogger(__name__)
_WORTH_THREADS = 20_000  # rows; for fewer, threads cost more than they bring
_PLAYED = 64  # small models that are kept while an arrival is played: of the first plays until all are done


class Trained:
    """The models of the last trainings, by all that decides them: the same training is not done twice.

    Variants of a training set often differ on some axes only, or not at all: it may be that no generated row was let
    through.
    """

    def __init__(self, most: int = 12) -> None:
        """most : models kept; a forest takes some megabytes"""
        self._models: OrderedDict[str, Any] = OrderedDict()
        self._most = most

    def fit(self, model: Any, columns: Float2D, current: Float1D, weight: Float1D) -> Any:
        """`model` fitted, or the one that was fitted on the same rows before."""
        what = hashlib.sha256(f"{type(model).__qualname__} {sorted(model.get_params().items())}".encode())
        for values in (columns, current, weight):
            what.update(repr(values.shape).encode() + np.ascontiguousarray(values).tobytes())
        key = what.hexdigest()
        if key not in self._models:
            # weights of one are no weights: the same model, without a look at each of them in every node
            self._models[key] = model.fit(columns, current, sample_weight=None if (weight == 1).all() else weight)
        self._models.move_to_end(key)
        while len(self._models) > self._most:
            self._models.popitem(last=False)
        return self._models[key]


@dataclass(frozen=True, eq=False)
class AxisModels:
    """Fitted models by axis; an axis without any recorded current has none."""

    models: Mapping[str, Any]
    inputs: InputKind
    seed: int

    @classmethod
    def fit(
        cls,
        samples: Samples,
        weights: Float1D | Float2D | None = None,
        *,
        choice: str | Mapping[str, EstimatorFactory] = "default",
        inputs: InputKind = "extended",
        seed: int = 0,
        n_jobs: int = -1,
        trained: Trained | None = None,
    ) -> AxisModels:
        """Train on the rows whose current is known, axis by axis.

        weights : (n,) or (n, 4) – how much a row counts in the loss (`pido.sampling.loss`), real and generated
        n_jobs : trees trained at once, by default one per core (as `joblib` counts them: LOKY_MAX_CPU_COUNT says
            otherwise); it does not change the models
        Rows are put in canonical order first: parts may arrive in any order. FitError where no axis has a current.
        """
        order = np.lexsort((samples.row, samples.part.astype(str), samples.origin))
        samples = samples.take(order)
        weight = np.ones((len(order), 4)) if weights is None else np.asarray(weights, float)[order]
        weight = np.broadcast_to(weight[:, None] if weight.ndim == 1 else weight, (len(order), 4))
        trained = trained or Trained(most=1)
        columns, models = model_inputs(samples, inputs), {}
        for i, axis in enumerate(AXES):
            rows = np.isfinite(samples.currents[:, i]) & (weight[:, i] > 0)
            if not rows.any():
                continue
            model = estimators(choice)[axis](seed)
            if n_jobs != 1 and rows.sum() >= _WORTH_THREADS and "n_jobs" in model.get_params():
                model.set_params(n_jobs=n_jobs)
            # threads of scikit-learn empty the list of warning filters under each other; it is put back here
            with warnings.catch_warnings():
                model = trained.fit(model, columns[rows], samples.currents[rows, i], weight[rows, i])
            if "n_jobs" in model.get_params():
                # threads add trees in the order in which they finish: one thread, or the last bit of a sum wavers
                model.set_params(n_jobs=None)
            models[axis] = model
        if not models:
            raise FitError("no sample has a current on any axis: nothing to learn from. Check the recordings.")
        log.debug("trained %s on %d rows", ", ".join(models), len(order))
        return cls(models, inputs, seed)

    def predict(self, samples: Samples) -> Float2D:
        """(n, 4), A; NaN on an axis that has no model."""
        return self.predict_inputs(model_inputs(samples, self.inputs))

    def predict_inputs(self, columns: Float2D) -> Float2D:
        """(n, 4), A, from (n, 13) or (n, 17) columns in the order of `input_names`."""
        out = np.full((len(columns), 4), np.nan)
        for i, axis in enumerate(AXES):
            if axis in self.models and len(columns):
                out[:, i] = self.models[axis].predict(columns)
        return out

    @property
    def by_axis(self) -> dict[str, Callable[[Float2D], Float1D]]:
        """Per axis that has a model: from the columns of `predict_inputs` to its current (n,), A."""
        return {axis: model.predict for axis, model in self.models.items()}

    @property
    def input_names(self) -> tuple[str, ...]:
        """Columns that the models take, in order."""
        return NAMES[self.inputs]

    def digests(self) -> dict[str, str]:
        """sha256 of each axis' model: of what it has learned, not of how it is stored."""
        return {axis: digest(model) for axis, model in self.models.items()}

    def digest(self) -> str:
        """One sha256 for all four."""
        text = f"{self.inputs} " + " ".join(f"{axis}:{d}" for axis, d in sorted(self.digests().items()))
        return hashlib.sha256(text.encode()).hexdigest()


def digest(model: Any) -> str:
    """sha256 of a fitted model. Trees are read node by node; for anything else, what it predicts on a fixed set of
    points spread over eight decades decides."""
    result = hashlib.sha256(type(model).__name__.encode())
    trees = getattr(model, "estimators_", None)
    if trees is not None and all(hasattr(tree, "tree_") for tree in np.ravel(np.asarray(trees, dtype=object))):
        if hasattr(model, "init_") and hasattr(model.init_, "constant_"):
            result.update(np.asarray(model.init_.constant_).tobytes())
        result.update(repr(getattr(model, "learning_rate", None)).encode())
        for tree in np.ravel(np.asarray(trees, dtype=object)):
            inner = tree.tree_
            for values in (inner.feature, inner.threshold, inner.children_left, inner.children_right, inner.value):
                result.update(np.ascontiguousarray(values).tobytes())
    else:
        rng = np.random.default_rng(0)
        probe = rng.normal(size=(4096, model.n_features_in_)) * 10.0 ** rng.uniform(-3, 5, size=(4096, 1))
        result.update(np.ascontiguousarray(model.predict(probe)).tobytes())
    return result.hexdigest()


def quick_trainer(inputs: InputKind = "extended", seed: int = 0, trees: int = 10) -> Callable[..., Any]:
    """A way to train a small model from samples and weights (n, 4), for `pido.sampling.method.adapt`.

    Plays of an arrival train some of their models twice: what was trained of late is kept.
    """
    small: dict[str, EstimatorFactory] = {a: lambda s: extra_trees(s).set_params(n_estimators=trees) for a in AXES}
    trained = Trained(_PLAYED)

    def train(samples: Samples, weights: Float2D) -> Callable[[Samples], Float2D]:
        return AxisModels.fit(samples, weights, choice=small, inputs=inputs, seed=seed, trained=trained).predict

    return train


def held_out_errors(
    samples: Samples,
    *,
    inputs: InputKind = "extended",
    choice: str | Mapping[str, EstimatorFactory] | None = None,
    grid: Grid = SAMPLING_GRID,
    count: int = 6,
    seed: int = 0,
) -> HeldOut:
    """What a model is off by on rows that it had not seen: stretches (or parts) left out for bins that hold samples,
    directions of motion for bins that hold none. The same rows judge the equations (`pido.equations.choose`).

    choice : estimators as in `AxisModels.fit`; by default one small forest for all axes, a fifth of the cost of the
        models themselves
    """
    near = _errors(samples, folds(samples, count), inputs, choice, grid, seed)
    return join(near, _errors(samples, sectors(samples), inputs, choice, grid, seed))


def _errors(samples: Samples, fold: Any, inputs: InputKind, choice: Any, grid: Grid, seed: int) -> HeldOut:
    residual, near = np.full((len(samples), 4), np.nan), np.zeros(len(samples), bool)
    for k in np.unique(fold[fold >= 0]):
        out = fold == k
        if out.all():
            continue
        rest, left = samples.take(~out), samples.take(out)
        if choice is None:
            residual[out] = left.currents - _small_forest(rest, left, inputs, seed)
        else:
            residual[out] = left.currents - AxisModels.fit(rest, choice=choice, inputs=inputs, seed=seed).predict(left)
        near[out] = covered(left.reduced, rest.reduced, grid)
    scored = (fold >= 0) & np.isfinite(residual).any(axis=1)
    return HeldOut(samples.reduced[scored], residual[scored], near[scored], fold[scored])


def _small_forest(rest: Samples, left: Samples, inputs: InputKind, seed: int) -> Float2D:
    """Predictions of one forest per set of axes that were recorded together."""
    out = np.full((len(left), 4), np.nan)
    known = np.isfinite(rest.currents)
    x_fit, x_new = model_inputs(rest, inputs), model_inputs(left, inputs)
    for pattern in np.unique(known, axis=1).T if len(rest) else ():
        axes = np.flatnonzero((known == pattern[:, None]).all(axis=0))
        if not pattern.any():
            continue
        scale = np.maximum(np.std(rest.currents[pattern][:, axes], axis=0), 1e-12)
        forest = extra_trees(seed).set_params(n_estimators=10)
        with parallel_config(n_jobs=1), threadpool_limits(1):
            target = rest.currents[pattern][:, axes] / scale
            forest.fit(x_fit[pattern], target if len(axes) > 1 else target[:, 0])
            out[:, axes] = forest.predict(x_new).reshape(len(left), -1) * scale
    return out
