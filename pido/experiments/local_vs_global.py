"""One equation for all samples, or one per bin (paper, section VII-B.1, algorithm 2, table 4, figure 22).

In:  a fleet. Out: errors of the global and the local equation as printed, of the equation that the data ask for, of
     three predictors without any method, and of trees; on the paper's split, with each set left out, and with the
     directions of motion left out; over all rows of the test set, those in bins that hold training rows, and the others.
"""  # noqa: E501

# pandas annotates what an index or a group gives as a table, a column or a number at once: pyright objects to each
# pyright: reportAttributeAccessIssue=false, reportArgumentType=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportIndexIssue=false, reportOperatorIssue=false, reportReturnType=false

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from pido.core.axes import AXES
from pido.equations.choose import choose, fit_chosen
from pido.equations.fit import fit_global, fit_local
from pido.experiments import paper
from pido.experiments.base import Experiment, Options, Outcome, Rows, Shown, Unit
from pido.experiments.data import Fleet
from pido.experiments.score import score
from pido.feature_space.density import relevant_bins
from pido.feature_space.grid import EQUATION_GRID
from pido.feature_space.regional import covered, sectors
from pido.models.axis_models import AxisModels
from pido.models.rivals import RIVALS

GLOBAL, LOCAL, CHOSEN = "global, as printed", "local, as printed", "equation chosen by the data"
TREES, TREES_HELD = "trees", "trees + direction"
FEW = 20


def plan(fleet: Fleet, options: Options) -> list[Unit]:
    """The paper's split (three parts train, the last tests), every set left out once, one set alone, and directions of
    motion that no training row has: the diagonals, then each of eight."""
    names = list(fleet.sets)
    units = []
    if len(names) >= 4:
        units.append(Unit("published split", {"split": "published", "train": names[:3], "test": names[-1]}))
    left = names[:: max(1, len(names) // 3)] if options.quick else names
    units += [
        Unit(f"without {out}", {"split": "one left out", "train": [n for n in names if n != out], "test": out})
        for out in left
    ]
    if len(names) >= 3:
        units += [Unit(f"only {one}", {"split": "one part only", "train": [one], "test": names[(k + 1) % len(names)]})
                  for k, one in enumerate(names) if one in left]  # fmt: skip
    for k, hidden in enumerate([[1, 3, 5, 7], *([s] for s in range(8))][: 1 if options.quick else None]):
        out = names[k % len(names)]
        rest = [n for n in names if n != out]
        what = {"split": "directions left out", "train": rest, "test": out, "hidden": hidden}
        units.append(Unit(f"without directions {hidden}", what))
    return units


def measure(fleet: Fleet, params: Mapping[str, Any], rng: np.random.Generator) -> Rows:
    """Errors of every model on one split."""
    machine, train, test = fleet.machine, fleet.samples(params["train"]), fleet.sets[params["test"]]
    if hidden := params.get("hidden"):  # sectors of the direction of motion in the plane, of 45 degrees
        train = train.take(~np.isin(sectors(train), hidden))
        test = test.take(np.isin(sectors(test), hidden))
    if len(train) < FEW or len(test) < FEW:
        return []
    bins, near = relevant_bins(test.reduced, EQUATION_GRID), covered(test.reduced, train.reduced)
    seed = int(rng.integers(2**31))
    choice = choose(train, machine)
    said = {
        GLOBAL: fit_global(train, machine).predict(test),
        LOCAL: fit_local(train, bins, machine).predict(test),
        CHOSEN: fit_chosen(train, bins, machine, choice, blend=True).predict(test),
        **{name: make(train)(test) for name, make in RIVALS.items()},
        TREES: AxisModels.fit(train, inputs="paper", seed=seed).predict(test),
        TREES_HELD: AxisModels.fit(train, inputs="extended", seed=seed).predict(test),
    }
    rows: Rows = []
    for model, predicted in said.items():
        for where, keep in (("all", None), ("covered", near), ("beyond", ~near)):
            if keep is None or keep.sum() >= FEW:
                chosen = dict(zip(AXES, map(str, choice.near), strict=True))
                rows += [
                    {"model": model, "where": where, "terms": chosen[r["axis"]], **r}
                    for r in score(test, predicted, keep)
                ]
    return [row | {"train": ", ".join(params["train"]), "hidden": str(hidden or "")} for row in rows]


def summarise(table: pd.DataFrame) -> Outcome:
    """Table 4 beside ours; the same with each set left out; worst beside the constant; by coverage."""
    out = table[table.split == "one left out"]
    sets = {*table.test, *(name for names in table.train for name in names.split(", "))}
    left = f"{out.test.nunique()} of {len(sets)} sets left out, each once"
    mean = _wide(out[out["where"] == "all"])
    worst = _against(out[out["where"] == "all"], "constant")
    tables = [
        Shown("Table 4 beside ours", _table_4(table), ("Global and local equation as printed; RMSE in A and R².",)),
        Shown("Each set left out: RMSE", mean, ("Root mean square over the sets left out, A.",)),
        Shown(
            "Directions left out: RMSE",
            _wide(table[(table.split == "directions left out") & (table["where"] == "all")]),
            ("Rows that move in directions that no training row has, A.",),
        ),
        Shown("Worst set beside a constant current", worst, ("RMSE over that of the constant, in the worst set.",)),
    ]
    gain = []
    for where in ("covered", "beyond"):
        for split in ("one left out", "published", "one part only", "directions left out"):
            some = table[(table["where"] == where) & (table.split == split)]
            if not len(some):
                continue
            wide = _wide(some)
            tables.append(Shown(f"Rows {where}, {split}: RMSE", wide, (COVERAGE,)))
            for axis in AXES:
                if axis in wide:
                    base = float(wide.loc[wide.model == GLOBAL, axis].iloc[0])
                    gain += [
                        {"rows": where, "split": split, "axis": axis, "model": m,
                         "change of RMSE, %": 100 * (float(wide.loc[wide.model == m, axis].iloc[0]) / base - 1)}
                        for m in (LOCAL, CHOSEN)
                    ]  # fmt: skip
    changes = pd.DataFrame(gain, columns=["rows", "split", "axis", "model", "change of RMSE, %"])
    tables.insert(1, Shown("Against the global equation", changes, ("Negative is better than the global equation.",)))
    pick = changes[(changes.model == CHOSEN) & (changes.split == "one left out")]
    inside, outside = (pick[pick.rows == w]["change of RMSE, %"] for w in ("covered", "beyond"))
    bad = worst[worst.model == CHOSEN]
    highest = max((float(bad[a].iloc[0]) for a in AXES if a in bad), default=float("nan"))
    verdict = (
        f"With {left}, the chosen local equation changes RMSE against the global one by "
        f"{_span(inside)} where directions are covered"
        f"{f' and {_span(outside)} where they are not' if len(outside) else ''}; "
        f"on its worst set and axis it has {highest:.2f} times the error of a constant current."
    )
    here = f"The paper shows one split that does not cover all directions; here it is {left}."
    return Outcome(verdict, tuple(tables), (*DIFFERS, here))


COVERAGE = "Covered: rows whose bin (2 x 2 x 2) holds training rows; beyond: the others. A."
DIFFERS = (
    "Machines and parts are not the paper's; its impeller recordings are not in hand. Compare relative changes.",
    "The weights have peak 1. With the normalised Gaussian as printed, local and global are the same to three digits.",
)


def _table_4(table: pd.DataFrame) -> pd.DataFrame:
    split = "published" if (table.split == "published").any() else "one left out"
    some = table[(table.split == split) & (table["where"] == "all")]
    rows = []
    for name, ours in (("global", GLOBAL), ("local", LOCAL), ("chosen", CHOSEN)):
        for axis in [a for a in AXES if a in set(some.axis)]:
            mine = some[(some.model == ours) & (some.axis == axis)]
            published = paper.TABLE_4.get(name, {}).get(axis, (np.nan, np.nan))
            rows.append(
                {"equation": name, "axis": axis, "RMSE": float(np.sqrt((mine.rmse**2).mean())), "R²": mine.r2.mean(),
                 "published RMSE": published[0], "published R²": published[1]}
            )  # fmt: skip
    return pd.DataFrame(rows)


def _wide(some: pd.DataFrame) -> pd.DataFrame:
    grouped = some.assign(square=some.rmse**2).groupby(["model", "axis"], sort=False)["square"].mean()
    wide = np.sqrt(grouped).unstack("axis")
    return wide[[a for a in AXES if a in wide]].reset_index()


def _against(some: pd.DataFrame, rival: str) -> pd.DataFrame:
    base = some[some.model == rival].set_index(["test", "axis"]).rmse
    at = pd.MultiIndex.from_frame(some[["test", "axis"]])
    ratio = some.assign(ratio=some.rmse.to_numpy() / base.reindex(at).to_numpy())
    wide = ratio.groupby(["model", "axis"], sort=False).ratio.max().unstack("axis")
    return wide[[a for a in AXES if a in wide]].reset_index()


def _span(values: pd.Series) -> str:
    return f"{values.min():+.0f} to {values.max():+.0f} %" if len(values) else "– (there are none)"


EXPERIMENT = Experiment(
    "local-vs-global", "One equation for all samples, or one per bin", "section VII-B.1, table 4, figure 22",
    "impellers", plan, measure, summarise, quick_repeats=1,
)  # fmt: skip
