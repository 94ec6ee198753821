"""Which of the 13 inputs a current depends on (paper, section III-D, figure 4).

In:  a fleet. Out: per group of sets, axis and input the impurity importance of a random forest, and the permutation
     importance on a stretch that the forest had not seen.
"""
# pandas annotates groupby and pivots wider than they are
# pyright: reportAttributeAccessIssue=false, reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportOperatorIssue=false, reportReturnType=false, reportGeneralTypeIssues=false, reportAssignmentType=false

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from sklearn.ensemble import RandomForestRegressor
from sklearn.inspection import permutation_importance

from pido.core.axes import AXES
from pido.core.columns import INPUTS
from pido.experiments import paper
from pido.experiments.base import Experiment, Options, Outcome, Rows, Shown, Unit
from pido.experiments.data import Fleet
from pido.feature_space.regional import interleaved


def groups(fleet: Fleet) -> dict[str, list[str]]:
    """Sets that belong together; all of them where nothing says so."""
    found: dict[str, list[str]] = {}
    for name in fleet.sets:
        found.setdefault(fleet.group.get(name, "all"), []).append(name)
    return found if len(found) < len(fleet.sets) else {"all": list(fleet.sets)}


def plan(fleet: Fleet, options: Options) -> list[Unit]:
    """One unit per group of sets and repeat."""
    most = 3000 if options.quick else 20_000
    return [
        Unit(f"{group}, repeat {repeat}", {"group": group, "repeat": repeat, "names": names, "rows": most})
        for group, names in groups(fleet).items()
        for repeat in range(options.repeats)
    ]


def measure(fleet: Fleet, params: Mapping[str, Any], rng: np.random.Generator) -> Rows:
    """Both importances of every input for every axis; impurity sums to 1, permutation is a share of R²."""
    samples = fleet.samples(params["names"])
    samples = samples.take(slice(None, None, max(1, -(-len(samples) // int(params["rows"])))))
    out = interleaved(samples, 4) == int(rng.integers(4))
    rows: Rows = []
    for i, axis in enumerate(AXES):
        known = np.isfinite(samples.currents[:, i])
        fit, held = known & ~out, known & out
        if fit.sum() < 50 or held.sum() < 20 or not np.std(samples.currents[fit, i]) > 0:
            continue
        forest = RandomForestRegressor(50, min_samples_leaf=5, random_state=int(rng.integers(2**31)))
        forest.fit(samples.inputs[fit], samples.currents[fit, i])
        moved = permutation_importance(
            forest, samples.inputs[held], samples.currents[held, i], n_repeats=3, random_state=int(rng.integers(2**31))
        )
        loss = np.asarray(moved["importances_mean"])
        rows += [
            {"axis": axis, "input": name, "impurity": float(a), "permutation": float(b)}
            for name, a, b in zip(INPUTS, forest.feature_importances_, loss, strict=True)
        ]
    return [row | {"names": ", ".join(params["names"])} for row in rows]


def summarise(table: pd.DataFrame) -> Outcome:
    """The most important input per axis beside the published one, and both importances of all."""
    mean = table.groupby(["group", "axis", "input"], sort=False)[["impurity", "permutation"]].mean().reset_index()
    first, agree = [], 0
    for (group, axis), some in mean.groupby(["group", "axis"], sort=False):
        by = {kind: str(some.loc[some[kind].idxmax(), "input"]) for kind in ("impurity", "permutation")}
        published = paper.IMPORTANT_INPUT[str(axis)]
        agree += by["impurity"] in published
        first.append({"group": group, "axis": axis, **by, "published": ", ".join(published)})
    top = pd.DataFrame(first)
    shown = [Shown("Most important input per axis (figure 4) beside ours", top)]
    for kind in ("impurity", "permutation"):
        wide = mean.pivot_table(index=["group", "axis"], columns="input", values=kind, sort=False)
        words = {"impurity": "Shares that sum to 1.", "permutation": "R² that is lost when the input is shuffled."}[
            kind
        ]
        shown.append(Shown(f"By {kind}", wide[list(INPUTS)].reset_index(), (words,)))
    return Outcome(
        f"The most important input is the published one in {agree} of {len(top)} cases (axes and groups of sets).",
        tuple(shown),
        (
            "The paper shows figure 4 as bars without numbers; what it says about them in words is compared.",
            "Inputs that follow from each other (MRR, forces, torque of one chip) share their impurity by chance.",
            "A speed that is programmed constant cannot be important in data of one feed.",
        ),
    )


EXPERIMENT = Experiment(
    "importance", "Which inputs a current depends on", "section III-D, figure 4", "design",
    plan, measure, summarise, quick_repeats=2,
)  # fmt: skip
