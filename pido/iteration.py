"""One production iteration as plain calls: no files, no clocks, no servers. Command line, flow and tests share it.

In:  the samples of the parts made so far, which of them has just arrived, machine, method, seed.
Out: what the models of before said about the arriving part (beside trivial rivals), and the challenger: equations,
     generated rows and four models trained on all parts.

    relevant bins -> refit -> PiA and PiE -> retrain -> evaluate

Two fits with one purpose each. The *rehearsal* repeats what could be known before the arriving part was made: models of
the other parts alone, balanced for the path that was coming. It is what the part is compared with, so no number here
comes from rows that a model was trained on. The *challenger* is trained on all parts, balanced for the newest one in
production order, which the next one most resembles.

The challenger depends on the *set* of parts, settings and seed, never on the order of arrival. Source: paper, section
III-A (pipeline), III-F and IV-D.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from pido.core.arrays import Float2D, Int1D
from pido.core.axes import AXES
from pido.core.errors import FitError
from pido.core.machining import Machine
from pido.core.samples import PIA, PIE, REAL, Samples
from pido.equations.choose import PAPER_CHOICE, AxisEquations, Candidate, Choice, candidates, choose, fit_chosen
from pido.feature_space.density import balance as evenness
from pido.feature_space.density import occupancy, relevant_bins
from pido.feature_space.grid import EQUATION_GRID, SAMPLING_GRID, Grid
from pido.feature_space.regional import HeldOut
from pido.models.axis_models import AxisModels, held_out_errors
from pido.models.inputs import InputKind
from pido.models.metrics import AxisMetrics, metrics
from pido.models.rivals import RIVALS
from pido.sampling.gate import OPEN, Gate
from pido.sampling.optimise import Report, optimise
from pido.sampling.shares import ShareRule

log = logging.getLogger(__name__)
Progress = Callable[[int, int, str], None]

VARIANTS: dict[str, tuple[int, ...]] = {
    "real": (REAL,),
    "pia": (REAL, PIA),
    "pie": (REAL, PIE),
    "both": (REAL, PIA, PIE),
}
"""What a model is trained on: real rows alone, with PiA, with PiE, with both."""


@dataclass(frozen=True)
class Method:
    """How an iteration is done.

    adaptive : terms and weights of the equation chosen on held-out stretches; else table 2 of the paper
    gate : which generated rows are let through; share : how many are asked for
    """

    adaptive: bool = True
    tried: tuple[Candidate, ...] = field(default_factory=candidates)
    gate: Gate = field(default_factory=Gate)
    share: ShareRule = field(default_factory=ShareRule)
    nuisance: Literal["joint", "paper"] = "joint"
    sampling_grid: Grid = SAMPLING_GRID
    equation_grid: Grid = EQUATION_GRID
    estimators: str = "default"
    inputs: InputKind = "extended"


PAPER = Method(
    adaptive=False, tried=(), gate=OPEN, nuisance="paper", estimators="paper", inputs="paper",
)  # fmt: skip
"""As printed: table 2, every generated row kept, the paper's models on its 13 inputs."""


@dataclass(frozen=True, eq=False)
class Judgement:
    """What held-out rows say about a set of parts: which equation per axis, and how wrong a model is where."""

    choice: Choice
    model_error: HeldOut | None

    @property
    def words(self) -> dict[str, str]:
        """The chosen equation per axis."""
        return {axis: str(near) for axis, near in zip(AXES, self.choice.near, strict=True)}


@dataclass(frozen=True, eq=False)
class Refit:
    """Equations on the bins that generated rows can lie in, with the judgement that they rest on."""

    equations: AxisEquations
    judgement: Judgement


@dataclass(frozen=True, eq=False)
class Balanced:
    """Generated rows for the needed bins, and how even the bins are before and after (standard deviation)."""

    needed: Int1D
    generated: Samples
    report: Report
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What was said about the arriving part. predicted : variant -> (n, 4), A; rivals among them."""

    predicted: dict[str, Float2D]
    metrics: dict[str, dict[str, AxisMetrics]]  # variant -> axis -> metrics


@dataclass(frozen=True, eq=False)
class Result:
    """An iteration. `evaluation` and `rehearsal` are None for the first part: nothing could be said about it before."""

    real: Samples
    refit: Refit
    balanced: Balanced
    models: AxisModels
    rehearsal: Balanced | None
    evaluation: Evaluation | None


def iterate(
    parts: Mapping[str, Samples],
    arriving: str,
    machine: Machine,
    method: Method | None = None,
    *,
    seed: int = 0,
    planned: Samples | None = None,
    variants: Sequence[str] = tuple(VARIANTS),
    on_progress: Progress = lambda done, total, what: None,
) -> Result:
    """All stages after one another.

    parts : part digest -> its samples, in production order, the arriving one among them
    planned : inputs along the path of the coming part, where its program is known; else the newest part's own path
    Raises FitError where there is nothing to learn from.
    """
    method = method or Method()
    if arriving not in parts:
        raise FitError(f"part {arriving[:12]} is not among the parts of this iteration.")
    steps = 7 if len(parts) > 1 else 3
    evaluation = rehearsal = None
    if len(parts) > 1:
        before = training_rows(parts, without=arriving)
        path = parts[arriving]
        on_progress(0, steps, "equations before the part")
        fitted = refit(before, relevant(path, method), judge(before, machine, method, seed), machine, method)
        on_progress(1, steps, "rows before the part")
        rehearsal = balance(before, relevant(path, method), fitted, method, seed)
        on_progress(2, steps, "models before the part")
        models = {v: retrain(before, rehearsal.generated, v, method, seed) for v in variants}
        on_progress(3, steps, "comparison")
        evaluation = evaluate(path, before, models)
    real = training_rows(parts)
    coming = planned if planned is not None else parts[list(parts)[-1]]
    on_progress(steps - 3, steps, "equations")
    fitted = refit(real, relevant(coming, method), judge(real, machine, method, seed), machine, method)
    on_progress(steps - 2, steps, "rows")
    balanced = balance(real, relevant(coming, method), fitted, method, seed, planned)
    on_progress(steps - 1, steps, "models")
    models = retrain(real, balanced.generated, "both", method, seed)
    on_progress(steps, steps, "done")
    return Result(real, fitted, balanced, models, rehearsal, evaluation)


def training_rows(parts: Mapping[str, Samples], without: str | None = None) -> Samples:
    """The real rows of all parts but one, in the order of `parts`."""
    return Samples.concat([samples for digest, samples in parts.items() if digest != without])


def relevant(path: Samples, method: Method) -> Int1D:
    """The bins that a planned or recorded path goes through (paper, section III-E)."""
    return relevant_bins(path.reduced, method.sampling_grid)


def judge(real: Samples, machine: Machine, method: Method, seed: int) -> Judgement:
    """The equation per axis that the real rows ask for, and errors on held-out rows. It does not depend on any path, so
    what was found for a set of parts holds when the next part is compared with it."""
    if not method.adaptive:
        return Judgement(PAPER_CHOICE, None)
    choice = choose(real, machine, method.tried, grid=method.equation_grid, coverage=method.sampling_grid)
    return Judgement(choice, held_out_errors(real, inputs=method.inputs, grid=method.sampling_grid, seed=seed))


def refit(real: Samples, needed: Int1D, judgement: Judgement, machine: Machine, method: Method) -> Refit:
    """Equations from the real rows on all equation bins that a needed bin touches."""
    equations = fit_chosen(
        real, touched(needed, method.sampling_grid, method.equation_grid), machine, judgement.choice,
        grid=method.equation_grid, coverage=method.sampling_grid, blend=method.adaptive,
    )  # fmt: skip
    return Refit(equations, judgement)


def touched(needed: Int1D, grid: Grid, finer: Grid) -> Int1D:
    """Bins of `finer` that share any volume with the bins `needed` of `grid`."""
    low, high = finer_index(grid.low(needed), finer), finer_index(np.nextafter(grid.high(needed), -np.inf), finer)
    spans = [np.arange(int((high - low)[:, d].max(initial=0)) + 1) for d in range(3)]
    steps = np.stack(np.meshgrid(*spans, indexing="ij"), axis=-1).reshape(-1, 3)
    index = low[:, None] + steps[None]
    inside = (index <= high[:, None]).all(axis=2)
    return np.unique(finer.id_of(index[inside]))


def finer_index(points: Float2D, grid: Grid) -> np.ndarray:
    """(n, 3) whole numbers of the bins that hold `points`."""
    return grid.index(grid.ids(points))


def balance(
    real: Samples, needed: Int1D, fitted: Refit, method: Method, seed: int, planned: Samples | None = None
) -> Balanced:
    """PiA and PiE rows for the needed bins. Same rows, same seed: same answer."""
    generated, report = optimise(
        real, needed, fitted.equations, method.share, method.sampling_grid,
        rng=np.random.default_rng(seed), gate=method.gate, equation_error=fitted.judgement.choice.held_out,
        model_error=fitted.judgement.model_error, planned=planned, nuisance=method.nuisance,
    )  # fmt: skip
    both = Samples.concat([real, generated]) if len(generated) else real
    grid = method.sampling_grid
    return Balanced(
        needed, generated, report, evenness(real.reduced, needed, grid), evenness(both.reduced, needed, grid)
    )


def retrain(real: Samples, generated: Samples, variant: str, method: Method, seed: int) -> AxisModels:
    """Four models on the rows that the variant allows."""
    chosen = generated.take(np.isin(generated.origin, VARIANTS[variant]))
    rows = Samples.concat([real, chosen]) if len(chosen) else real
    return AxisModels.fit(rows, choice=method.estimators, inputs=method.inputs, seed=seed)


def evaluate(path: Samples, before: Samples, models: Mapping[str, AxisModels]) -> Evaluation:
    """What models and trivial rivals, all trained without it, said about the arriving part."""
    predicted = rivals(path, before) | {variant: model.predict(path) for variant, model in models.items()}
    return Evaluation(predicted, {name: metrics(path.currents, said) for name, said in predicted.items()})


def rivals(path: Samples, before: Samples) -> dict[str, Float2D]:
    """What the trivial rivals say about the arriving part."""
    return {name: make(before)(path) for name, make in RIVALS.items()}


def bins_before_and_after(balanced: Balanced, real: Samples, grid: Grid) -> tuple[Float2D, Int1D, Int1D]:
    """Per needed bin: centre (m, 3), real samples, and real plus generated ones."""
    before = occupancy(real.reduced, grid).count_in(balanced.needed)
    made = balanced.generated
    extra = occupancy(made.reduced, grid).count_in(balanced.needed) if len(made) else np.zeros_like(before)
    return grid.centres(balanced.needed), before, before + extra
