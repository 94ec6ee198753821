"""One whole iteration beside the training of its models alone, as scikit-learn does it.

In:  nothing; parts that go where parts go. Out: rows {work, peer, ratio, goal, error}; ratio is the overhead: what all
     the rest costs, as a share of training.

An arrival ends with two sets of models (before it, to say what was expected; and on all parts), and balances rows for
each. Balancing asks a model of the real rows alone first, on each axis that gets generated rows: the first line counts
that as overhead, the second as training. Which equations and shares to use is chosen anew when the number of parts has
grown by half; its cost is told beside.
Times are CPU times of all threads.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from benchmarks.fits import MACHINE
from benchmarks.growth import part_rows
from benchmarks.table import Row, row
from pido.core.axes import AXES
from pido.core.samples import Samples
from pido.iteration import Balanced, Recipe, balance, evaluate, refit, retrain, training_rows
from pido.models.axis_models import Trained
from pido.models.estimators import ESTIMATORS
from pido.models.inputs import model_inputs

QUICK = {"parts": 3, "per_part": 1_000}


def run(parts: int = 10, per_part: int = 10_000) -> list[Row]:
    """Overhead of an arrival; and of a choice, spread over the arrivals that it holds for."""
    made = {f"part-{k:06d}": part_rows(k, per_part) for k in range(parts)}
    names, recipe = list(made), Recipe()
    before, everything = training_rows(made, names[:-1]), training_rows(made)
    path = made[names[-1]]
    chosen, adaptation = _cpu(lambda: refit(before.take(slice(0, 100_000)), MACHINE, recipe, 0))

    def arrival() -> tuple[Balanced, Balanced]:
        trained = Trained()
        rehearsal = balance(before, path, adaptation, MACHINE, recipe, 0, trained)
        said = retrain(before, rehearsal.generated, rehearsal.weights, "both", recipe, 0, trained)
        evaluate(path, before, {"both": said})
        trained = Trained()
        balanced = balance(everything, path, adaptation, MACHINE, recipe, 0, trained)
        retrain(everything, balanced.generated, balanced.weights, "both", recipe, 0, trained)
        return rehearsal, balanced

    asked = [i for i in range(4) if adaptation.trust is not None and adaptation.trust.terms[i] is not None]

    def last(pair: tuple[Balanced, Balanced]) -> None:
        for real, extra in zip((before, everything), pair, strict=True):
            fit(Samples.concat([real, extra.generated]) if len(extra.generated) else real, range(4))

    def first() -> None:
        for real in (before, everything):
            fit(real, asked)

    def fit(rows: Samples, axes: Iterable[int]) -> None:
        columns = model_inputs(rows, recipe.inputs)
        for i in axes:
            known = np.isfinite(rows.currents[:, i])
            ESTIMATORS["default"][AXES[i]](0).fit(columns[known], rows.currents[known, i])

    arrival()
    ours, final, before_rows = [], [], []
    for _ in range(3):
        seconds, pair = _cpu(arrival)
        ours.append(seconds)
        final.append(_cpu(lambda pair=pair: last(pair))[0])
        before_rows.append(_cpu(first)[0])
    whole, alone, more = (float(np.median(seconds)) for seconds in (ours, final, before_rows))
    work = f"an arrival: {parts} parts of {per_part} rows"
    return [
        row(f"{work}, overhead", "scikit-learn `fit` of the same models", whole / alone - 1.0, "<= 0.25",
            f"{whole:.1f} s beside {alone:.1f} s"),
        row(f"{work}, overhead", "`fit` of all models that it asks", whole / (alone + more) - 1.0, "<= 0.25",
            f"{whole:.1f} s beside {alone + more:.1f} s"),
        row("choice of equations and shares, once per half as many parts again", "one arrival", chosen / whole, "–",
            f"{chosen:.1f} s, trains some 40 models"),
    ]  # fmt: skip


def _cpu(call: Callable[[], Any]) -> tuple[float, Any]:
    start = time.process_time()
    result = call()
    return time.process_time() - start, result
