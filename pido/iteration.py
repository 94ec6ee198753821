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
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pido.core.arrays import Float2D, Int1D
from pido.core.axes import AXES
from pido.core.errors import FitError
from pido.core.machining import Machine
from pido.core.samples import PIA, PIE, REAL, Samples, Train
from pido.equations.choose import AxisEquations, Choice
from pido.equations.terms import ExtraTerm, TermSet
from pido.feature_space.density import balance as evenness
from pido.feature_space.density import occupancy, relevant_bins
from pido.feature_space.grid import Grid
from pido.models.axis_models import AxisModels, Trained
from pido.models.inputs import InputKind
from pido.models.metrics import AxisMetrics, metrics
from pido.models.rivals import RIVALS
from pido.sampling.method import PAPER_METHOD, Adaptation, Method, adapt, balance_for
from pido.sampling.optimise import Report

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
class Recipe:
    """How an iteration is done: the method, and the models that it serves."""

    method: Method = field(default_factory=Method)
    estimators: str = "default"
    inputs: InputKind = "extended"
    extended: tuple[TermSet, ...] = ()  # equations with accepted physics


PAPER = Recipe(PAPER_METHOD, estimators="paper", inputs="paper")
"""As printed: table 2, every generated row kept, the paper's models on its 13 inputs."""


@dataclass(frozen=True, eq=False)
class Balanced:
    """Generated rows for the needed bins with their weights in the loss (n, 4), the equations that they come from, and
    how even the bins are before and after (standard deviation of samples per bin)."""

    needed: Int1D
    generated: Samples
    weights: Float2D
    equations: AxisEquations
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
    balanced: Balanced
    models: AxisModels
    rehearsal: Balanced | None
    evaluation: Evaluation | None


def iterate(
    parts: Mapping[str, Samples],
    arriving: str,
    machine: Machine,
    recipe: Recipe | None = None,
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
    recipe = recipe or Recipe()
    if arriving not in parts:
        raise FitError(f"part {arriving[:12]} is not among the parts of this iteration.")
    names, first = list(parts), len(parts) == 1
    evaluation = rehearsal = None
    if not first:
        known = [name for name in names if name != arriving]
        before, path = training_rows(parts, known), parts[arriving]
        on_progress(0, 6, "equations and rows before the part")
        adaptation = refit(training_rows(parts, known[: rests_on(len(known))]), machine, recipe, seed)
        trained = Trained()
        rehearsal = balance(before, path, adaptation, machine, recipe, seed, trained)
        on_progress(1, 6, "models before the part")
        made = rehearsal.generated
        models = {v: retrain(before, made, rehearsal.weights, v, recipe, seed, trained) for v in variants}
        on_progress(2, 6, "comparison")
        evaluation = evaluate(path, before, models)
    on_progress(3, 6, "equations and rows")
    real = training_rows(parts)
    coming = planned if planned is not None else parts[names[-1]]
    adaptation = refit(training_rows(parts, names[: rests_on(len(names))]), machine, recipe, seed)
    trained = Trained()
    balanced = balance(real, coming, adaptation, machine, recipe, seed, trained)
    on_progress(4, 6, "models")
    models = retrain(real, balanced.generated, balanced.weights, "both", recipe, seed, trained)
    on_progress(6, 6, "done")
    return Result(real, balanced, models, rehearsal, evaluation)


def training_rows(parts: Mapping[str, Samples], names: Sequence[str] | None = None) -> Samples:
    """The real rows of the parts named (of all), in that order."""
    return Samples.concat([parts[name] for name in (parts if names is None else names)])


def rests_on(count: int) -> int:
    """On how many of `count` parts, in production order, the choice of equations and shares rests: 1, 2, 3, then each
    time half as many again. Choosing costs more than a model, and what was found holds until the data have grown by a
    good part; counted this way it is still a function of the set of parts, not of when they came.

    >>> [rests_on(n) for n in range(1, 13)]
    [1, 2, 3, 3, 5, 5, 5, 8, 8, 8, 8, 12]
    """
    step = 1
    while (after := max(step + 1, math.ceil(1.5 * step))) <= count:
        step = after
    return step


def relevant(path: Samples, recipe: Recipe) -> Int1D:
    """The bins that a planned or recorded path goes through (paper, section III-E)."""
    return relevant_bins(path.reduced, recipe.method.grid)


def refit(real: Samples, machine: Machine, recipe: Recipe, seed: int) -> Adaptation:
    """Which equation per axis, and which share rule, the real rows ask for: judged on rows left out."""
    return adapt(real, machine, recipe.method, train=_trainer(recipe, seed), extended=recipe.extended)


def _trainer(recipe: Recipe, seed: int, trained: Trained | None = None) -> Train:
    """The models of the recipe, as the method asks for them."""

    trained = trained or Trained()

    def train(rows: Samples, weights: Float2D) -> Callable[[Samples], Float2D]:
        return AxisModels.fit(
            rows, weights, choice=recipe.estimators, inputs=recipe.inputs, seed=seed, trained=trained
        ).predict

    return train


def balance(
    real: Samples, path: Samples, adaptation: Adaptation, machine: Machine, recipe: Recipe, seed: int,
    trained: Trained | None = None,
) -> Balanced:  # fmt: skip
    """PiA and PiE rows for the bins of a path. Same rows, same seed: same answer. The rows may rest on models of the
    real rows; `trained` keeps them for `retrain`, which needs the same ones on axes without generated rows."""
    found = balance_for(
        path, real, machine, recipe.method, adaptation,
        rng=np.random.default_rng(seed), train=_trainer(recipe, seed, trained),
    )  # fmt: skip
    both = Samples.concat([real, found.generated]) if len(found.generated) else real
    needed, grid = relevant(path, recipe), recipe.method.grid
    return Balanced(
        needed, found.generated, found.weights, found.equations, found.report,
        evenness(real.reduced, needed, grid), evenness(both.reduced, needed, grid),
    )  # fmt: skip


def retrain(
    real: Samples, generated: Samples, weights: Float2D, variant: str, recipe: Recipe, seed: int,
    trained: Trained | None = None,
) -> AxisModels:  # fmt: skip
    """Four models on the rows that the variant allows, each with its weight in the loss (eq. 7). `trained`: models of
    other variants, used where they rest on the same rows."""
    chosen = np.isin(generated.origin, VARIANTS[variant])
    rows = Samples.concat([real, generated.take(chosen)]) if chosen.any() else real
    omega = np.vstack([np.full((len(real), 4), recipe.method.omega_data), weights[chosen]])
    return AxisModels.fit(rows, omega, choice=recipe.estimators, inputs=recipe.inputs, seed=seed, trained=trained)


def evaluate(path: Samples, before: Samples, models: Mapping[str, AxisModels]) -> Evaluation:
    """What models and trivial rivals, all trained without it, said about the arriving part."""
    predicted = rivals(path, before) | {variant: model.predict(path) for variant, model in models.items()}
    return Evaluation(predicted, {name: metrics(path.currents, said) for name, said in predicted.items()})


def words(adaptation: Adaptation) -> dict[str, str]:
    """The chosen equation per axis, and by which one generated rows had helped there on held-out parts."""
    if adaptation.trust is None:
        rows = [f"{rule.pia.__name__}, {rule.pie.__name__}" for rule in adaptation.shares]
    else:
        trust = adaptation.trust
        rows = [
            (f"by '{terms.id}', {spacing}" if terms else "of the path where an equation is far steadier")
            + ", and anchored ones" * anchored
            for terms, spacing, anchored in zip(trust.terms, trust.spacing, trust.anchored, strict=True)
        ]
    return {axis: f"{near}; rows: {what}" for axis, near, what in zip(AXES, adaptation.choice.near, rows, strict=True)}


def physics(choice: Choice, accepted: Sequence[ExtraTerm]) -> dict[str, Any]:
    """Accepted physics in force, and what it did: its names, and those that are in the chosen equation; per axis that
    it is of, the held-out RMSE in A of the best equation without and with it; and the same in words, which say also
    that it made the equation worse."""
    held_out: dict[str, dict[str, float]] = {}
    said, used = [], []
    for i, axis in enumerate(AXES):
        own = [term.name for term in accepted if term.axis == axis]
        if not own:
            continue
        about = f"Accepted physics of {', '.join(own)}"
        in_it = [term.name for each in (choice.near[i], choice.beyond[i]) for term in each.terms.extras]
        chosen = [name for name in own if name in in_it]
        used += chosen
        with_it = np.array([any(f"+{name}" in tried for name in own) for tried in choice.tried], bool)
        near = choice.scores[0, :, i]
        if not (np.isfinite(near[with_it]).any() and np.isfinite(near[~with_it]).any()):
            said.append(f"{about}: it is in the equation; no rows were held out to see what it brings.")
            continue
        one = held_out[axis] = {"without": float(np.nanmin(near[~with_it])), "with": float(np.nanmin(near[with_it]))}
        change = one["with"] / max(one["without"], 1e-300) - 1
        does = "makes the equation worse" if change > 0.01 else "changes little" if change > -0.01 else "helps"
        said.append(
            f"{about}: on rows held out the equation is off by {one['with']:.3g} A with it and by "
            f"{one['without']:.3g} A without: it {does} ({change:+.1%})"
            f"{'' if chosen else ', and the equation chosen does without'}."
            + (" `pido accept-physics --revoke ID` takes it out." if change > 0.01 else "")
        )
    accepted_names = sorted(term.name for term in accepted)
    return {"accepted": accepted_names, "in_equation": sorted(used), "held_out": held_out, "words": said}


def rivals(path: Samples, before: Samples) -> dict[str, Float2D]:
    """What the trivial rivals say about the arriving part."""
    return {name: make(before)(path) for name, make in RIVALS.items()}


def bins_before_and_after(balanced: Balanced, real: Samples, grid: Grid) -> tuple[Float2D, Int1D, Int1D]:
    """Per needed bin: centre (m, 3), real samples, and real plus generated ones."""
    before = occupancy(real.reduced, grid).count_in(balanced.needed)
    made = balanced.generated
    extra = occupancy(made.reduced, grid).count_in(balanced.needed) if len(made) else np.zeros_like(before)
    return grid.centres(balanced.needed), before, before + extra
