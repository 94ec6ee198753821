"""What a model is made of in the comparisons: rows as printed, as delivered, and what others do with the same rows.

In:  a cell (training and test set), machine, seed, what was adapted before. Out: predictions (n, 4) by variant, counts
     of generated rows, and how even the bins of the test set are.

All variants of a family have the same rows, model, inputs and model seed, so that only what is named differs:
  as printed    13 inputs, at most 40 real rows per bin; PiA and PiE of `Method.paper`
  as delivered  13 inputs and held directions, all real rows; `Method()`, and each rival in the same bins with the counts
                that eq. 16 asks for
`real, other seed` and `real + direction, other seed` are the nulls: nothing but the model's seed differs.
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pido.core.arrays import Float2D
from pido.core.axes import AXES
from pido.core.machining import Machine
from pido.core.samples import PIA, PIE, Samples
from pido.equations.choose import PAPER_CHOICE, fit_chosen
from pido.experiments.cells import Cell, reduced
from pido.feature_space.density import balance, occupancy, relevant_bins
from pido.models.axis_models import AxisModels, Trained, quick_trainer
from pido.models.estimators import EstimatorFactory, extra_trees
from pido.models.inputs import InputKind, model_inputs
from pido.sampling.method import PAPER_METHOD, Adaptation, Method, adapt, balance_for
from pido.sampling.rivals import ROW_RIVALS, dense_weights
from pido.sampling.shares import ShareRule

PRINTED = ("real", "real, other seed", "PiA", "PiE", "PiA+PiE")
DELIVERED = ("real + direction", "real + direction, other seed", "PiDO")
OTHERS = (*ROW_RIVALS, "DenseWeight", "finer trees", "equation alone", "forest on residual", "GP on residual")
BASELINE = dict.fromkeys(PRINTED, "real") | dict.fromkeys((*DELIVERED, *OTHERS), "real + direction")
GENERATING = tuple(ROW_RIVALS)
_GP_ROWS, _GP_STEPS = 250, 15


@dataclass
class Memory:
    """What was adapted at an earlier step of the same repeat; it stands until the data have grown by half."""

    adaptation: Adaptation | None = None


@dataclass(frozen=True, eq=False)
class Told:
    """predicted : variant -> (n, 4), A; rows : variant -> generated rows; even : variant -> standard deviation of rows
    per bin of the test set."""

    predicted: dict[str, Float2D] = field(default_factory=dict)
    rows: dict[str, int] = field(default_factory=dict)
    even: dict[str, float] = field(default_factory=dict)


def tell(
    cell: Cell, machine: Machine, wanted: Sequence[str], memory: Memory, seed: int, *, trees: int = 30,
    estimators: str = "default",
) -> Told:  # fmt: skip
    """Train every wanted variant on the cell and let it predict the test set."""
    told, trained = Told(), Trained(len(AXES) * len(PRINTED))
    choice: Any = estimators if trees == 30 else dict.fromkeys(AXES, _small(trees))
    if set(wanted) & set(PRINTED):
        _printed(cell, machine, wanted, seed, choice, told, trained)
    if set(wanted) & {*DELIVERED, *OTHERS}:
        _delivered(cell, machine, wanted, memory, seed, choice, told, trained, trees)
    return told


def adaptation_for(real: Samples, machine: Machine, memory: Memory, seed: int, equations: bool = True) -> Adaptation:
    """What these rows ask for, or the last answer while it holds.

    equations : whether local equations are chosen too; PiDO's own rows do not depend on them
    """
    if memory.adaptation is None or memory.adaptation.outdated(len(real)):
        choice = None if equations else PAPER_CHOICE
        memory.adaptation = adapt(real, machine, Method(), train=quick_trainer(seed=seed), choice=choice)
    return memory.adaptation


def _small(trees: int, **settings: int) -> EstimatorFactory:
    return lambda seed: extra_trees(seed).set_params(n_estimators=trees, **settings)


def _model(
    real: Samples, extra: Samples, weights: Float2D, test: Samples, choice: Any, inputs: InputKind, seed: int,
    trained: Trained,
) -> Float2D:  # fmt: skip
    """Predictions of models with the extra rows; an axis for which none was let through is not trained again."""
    rows = Samples.concat([real, extra]) if len(extra) else real
    omega = np.vstack([np.ones((len(real), 4)), weights]) if len(extra) else None
    return AxisModels.fit(rows, omega, choice=choice, inputs=inputs, seed=seed, trained=trained).predict(test)


def _printed(
    cell: Cell, machine: Machine, wanted: Sequence[str], seed: int, choice: Any, told: Told, trained: Trained
) -> None:
    method, rng = PAPER_METHOD, np.random.default_rng(seed)
    real = reduced(cell.train, method.share.density, rng, method.grid)
    made = balance_for(_path(cell.test), real, machine, method, rng=rng)
    needed = relevant_bins(cell.test.reduced, method.grid)
    for name, origins in (
        ("real", ()), ("real, other seed", ()), ("PiA", (PIA,)), ("PiE", (PIE,)), ("PiA+PiE", (PIA, PIE)),
    ):  # fmt: skip
        if name not in wanted:
            continue
        keep = np.isin(made.generated.origin, origins)
        extra = made.generated.take(keep)
        model_seed = seed + 1 if name.endswith("other seed") else seed
        weights = made.weights[keep]
        told.predicted[name] = _model(real, extra, weights, cell.test, choice, "paper", model_seed, trained)
        told.rows[name] = len(extra)
        both = np.vstack([real.reduced, extra.reduced])
        told.even[name] = balance(both, needed, method.grid)


def _delivered(
    cell: Cell, machine: Machine, wanted: Sequence[str], memory: Memory, seed: int, choice: Any, told: Told,
    trained: Trained, trees: int,
) -> None:  # fmt: skip
    method, real, test = Method(), cell.train, cell.test
    needed = relevant_bins(test.reduced, method.grid)
    nothing, none = real.take(slice(0, 0)), np.zeros((0, 4))

    def note(name: str, predicted: Float2D, extra: Samples = nothing) -> None:
        told.predicted[name], told.rows[name] = predicted, len(extra)
        told.even[name] = balance(np.vstack([real.reduced, extra.reduced]), needed, method.grid)

    models = AxisModels.fit(real, choice=choice, inputs="extended", seed=seed, trained=trained)
    plain = models.predict(test)
    note("real + direction", plain)
    if "real + direction, other seed" in wanted:
        other = _model(real, nothing, none, test, choice, "extended", seed + 1, trained)
        note("real + direction, other seed", other)
    adapted: Adaptation | None = None
    by_equation = bool(set(wanted) & {"equation alone", "forest on residual", "GP on residual"})
    if by_equation or "PiDO" in wanted:
        adapted = adaptation_for(real, machine, memory, seed, by_equation)
    if adapted is not None and "PiDO" in wanted:
        made = balance_for(
            _path(test), real, machine, method, adapted, rng=np.random.default_rng(seed),
            train=lambda rows, omega: AxisModels.fit(rows, omega, choice=choice, seed=seed, trained=trained).predict,
        )  # fmt: skip
        extra = made.generated
        note("PiDO", _model(real, extra, made.weights, test, choice, "extended", seed, trained), extra)
    n_real = occupancy(real.reduced, method.grid).count_in(needed)
    number = ShareRule().wanted(n_real, np.random.default_rng(seed))[1]
    for name, make in ROW_RIVALS.items():
        if name in wanted:
            extra = make(real, needed, number, method.grid, np.random.default_rng(seed))
            note(name, _model(real, extra, np.ones((len(extra), 4)), test, choice, "extended", seed, trained), extra)
    if "DenseWeight" in wanted:
        weights = dense_weights(real.currents)
        note("DenseWeight", AxisModels.fit(real, weights, choice=choice, seed=seed).predict(test))
    if "finer trees" in wanted:  # rows of their own around few rows may do no more than a row per leaf does
        finer: dict[str, EstimatorFactory] = dict.fromkeys(AXES, _small(trees, min_samples_leaf=1))
        note("finer trees", AxisModels.fit(real, choice=finer, seed=seed).predict(test))
    if adapted is not None and by_equation:
        bins = relevant_bins(np.vstack([test.reduced, real.reduced]), method.equation_grid)
        equation = fit_chosen(real, bins, machine, adapted.choice, grid=method.equation_grid, blend=True)
        said = equation.predict(test)
        left = replace(real, currents=real.currents - equation.predict(real))
        if "equation alone" in wanted:
            note("equation alone", said)
        if "forest on residual" in wanted:
            note("forest on residual", said + _model(left, nothing, none, test, choice, "extended", seed, trained))
        if "GP on residual" in wanted:
            gp_rows = _GP_ROWS if trees >= 30 else _GP_ROWS // 3
            note("GP on residual", said + _gaussian_process(left, test, gp_rows, np.random.default_rng(seed)))


def _path(test: Samples) -> Samples:
    """The coming part without its currents: what is known before it is made."""
    return replace(test, currents=np.full((len(test), 4), np.nan))


def _gaussian_process(left: Samples, test: Samples, most: int, rng: np.random.Generator) -> Float2D:
    """Gaussian process with one length per input, on at most `most` rows; what it says far from them goes to zero.
    Lengths are searched in a few steps: to the end it takes as long as all other variants together."""
    import warnings

    from scipy.optimize import minimize
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    def search(target: Any, start: Any, bounds: Any) -> tuple[Any, float]:
        found = minimize(target, start, method="L-BFGS-B", jac=True, bounds=bounds, options={"maxiter": _GP_STEPS})
        return found.x, found.fun

    x, new = model_inputs(left, "extended"), model_inputs(test, "extended")
    spread = np.std(x, axis=0)
    live = spread > 1e-9
    out = np.zeros((len(test), 4))
    for i in range(4):
        rows = np.flatnonzero(np.isfinite(left.currents[:, i]))
        rows = rng.choice(rows, min(most, len(rows)), replace=False)
        y = left.currents[rows, i]
        if len(rows) < 10 or not np.std(y) > 0 or not live.any():
            continue
        # one length per input, and a search of its own: both documented, and narrower in what pyright infers
        lengths: Any = np.full(int(live.sum()), 3.0)
        own_search: Any = search
        kernel = ConstantKernel(1.0) * RBF(lengths, (0.1, 1e3)) + WhiteKernel(0.3, (1e-4, 10.0))
        model = GaussianProcessRegressor(kernel, optimizer=own_search, normalize_y=True, random_state=0)
        with warnings.catch_warnings():
            # a length at its bound means that the input does not matter, which is an answer
            warnings.simplefilter("ignore", ConvergenceWarning)
            model.fit(x[rows][:, live] / spread[live], y)
        out[:, i] = model.predict(new[:, live] / spread[live])
    return out
