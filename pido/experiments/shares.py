"""How many PiA and PiE samples a bin should get (paper, section IV-C, algorithm 3, figures 8 to 19, table 3).

In:  a fleet. Out: the error of a model for every share of real rows, PiA and PiE; the best shares; what they depend on;
     polynomials through them beside eq. 15 and 16.

The next part's bins that hold 40 rows after a 70/30 split stand for 100 %; its training rows are reduced to a share of
that, and joined by the rows of another set. Eq. 15 and 16 came out of this.
"""
# pandas annotates groupby and pivots wider than they are
# pyright: reportAttributeAccessIssue=false, reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportOperatorIssue=false, reportReturnType=false, reportGeneralTypeIssues=false, reportAssignmentType=false

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from pido.core.arrays import Float1D
from pido.core.axes import AXES
from pido.core.samples import PIA, PIE, Samples
from pido.equations.choose import PAPER_CHOICE, fit_chosen
from pido.experiments import paper
from pido.experiments.base import Experiment, Options, Outcome, Rows, Shown, Unit
from pido.experiments.cells import reduced
from pido.experiments.data import Fleet, varies
from pido.feature_space.density import occupancy
from pido.feature_space.distance import wasserstein
from pido.feature_space.grid import EQUATION_GRID, SAMPLING_GRID, touched
from pido.models.axis_models import AxisModels
from pido.models.estimators import EstimatorFactory, extra_trees
from pido.sampling.inputs import draw_inputs
from pido.sampling.shares import paper_pia, paper_pie

REAL_SHARES = tuple(range(0, 101, 10))
PIA_SHARES = (0, 3, 5, 8, 10, 15, 25)
PIE_SHARES = (0, 3, 5, 10, 15, 20, 35, 50, 65, 80, 95, 110)
DENSITY = 40
MOST = 115
NEXT = "DAL_GSFl"
TRAINING_SETS = 9


def plan(fleet: Fleet, options: Options) -> list[Unit]:
    """One unit per training set, share of real rows and repeat. The next part is the paper's, if it is there, else the
    set with most rows per bin; training sets are nine, evenly spread over their distances to it."""
    following = NEXT if NEXT in fleet.sets else max(fleet.sets, key=lambda name: _fullness(fleet.sets[name]))
    target = fleet.sets[following].reduced
    distance = {n: wasserstein(s.reduced, target) for n, s in fleet.sets.items() if n != following}
    order = sorted(distance, key=lambda n: distance[n])
    count = min(2 if options.quick else TRAINING_SETS, len(order))
    chosen = [order[k] for k in np.unique(np.linspace(0, len(order) - 1, count).round().astype(int))]
    real = (0, 30, 60, 100) if options.quick else REAL_SHARES
    pia, pie = ((0, 8, 25), (0, 5, 20, 65)) if options.quick else (PIA_SHARES, PIE_SHARES)
    return [
        Unit(
            f"{name}, real {share} %, repeat {repeat}",
            {
                "next": following, "train": name, "distance": distance[name], "real": share, "repeat": repeat,
                "pia_shares": list(pia), "pie_shares": list(pie), "trees": 10 if options.quick else 30,
            },
        )
        for repeat in range(options.repeats)
        for name in chosen
        for share in real
    ]  # fmt: skip


def measure(fleet: Fleet, params: Mapping[str, Any], rng: np.random.Generator) -> Rows:
    """Errors of every combination of shares; NaN shares do not occur, combinations beyond 115 % are skipped."""
    following, other = fleet.sets[params["next"]], fleet.sets[params["train"]]
    learn = rng.random(len(following)) < 0.7
    bins = _full_bins(following.take(learn))
    train = reduced(other, DENSITY, rng)
    coming = reduced(_inside(following.take(learn), bins), DENSITY, rng)
    test = _inside(following.take(~learn), bins)
    share = int(params["real"])
    part = reduced(coming, share / 100 * DENSITY, rng) if share else coming.take(slice(0, 0))
    real = Samples.concat([train, part])
    if not len(bins) or not len(test):
        return []
    equations = fit_chosen(real, touched(bins, SAMPLING_GRID, EQUATION_GRID), fleet.machine, PAPER_CHOICE)
    most = {"pia": max(params["pia_shares"]), "pie": max(params["pie_shares"])}
    # one pool of rows per origin, of which every combination takes the first ones of each bin: combinations differ by
    # their numbers and not by the luck of the draw
    pia = _pool(_inside(part, bins), bins, most["pia"], rng)
    drawn, _ = draw_inputs(
        bins, np.full(len(bins), _number(most["pie"])), SAMPLING_GRID, real, fleet.machine, rng, nuisance="paper"
    )
    made = {"pia": replace(pia, origin=np.full(len(pia), PIA)), "pie": replace(drawn, origin=np.full(len(drawn), PIE))}
    made = {k: replace(rows, currents=equations.predict(rows)) if len(rows) else rows for k, rows in made.items()}
    seed, rows = int(rng.integers(2**31)), []
    live = np.flatnonzero(varies(test.currents))
    models = dict.fromkeys(AXES, _forest(int(params["trees"])))
    for a in params["pia_shares"]:
        for e in params["pie_shares"]:
            if (share + a + e >= MOST and (a or e)) or a > share:
                continue
            extra = [_first(made["pia"], _number(a)), _first(made["pie"], _number(e))]
            model = AxisModels.fit(Samples.concat([real, *extra]), choice=models, inputs="paper", seed=seed)
            error = np.sqrt(np.nanmean((test.currents - model.predict(test))[:, live] ** 2, axis=0))
            rows += [
                {"pia": a, "pie": e, "axis": AXES[i], "rmse": float(rmse)}
                for i, rmse in zip(live, error, strict=True)
                if np.isfinite(rmse)
            ]
    return [row | {"pia_shares": str(params["pia_shares"]), "pie_shares": str(params["pie_shares"])} for row in rows]


def summarise(table: pd.DataFrame) -> Outcome:
    """Table 3 beside ours, distance correlations, share functions beside eq. 15 and 16, mean best shares."""
    import dcor

    place = ["train", "distance", "real", "repeat", "axis"]
    best = table.loc[table.groupby(place, sort=False)["rmse"].idxmin()].reset_index(drop=True)
    none = table[(table.pia == 0) & (table.pie == 0)].set_index(place)["rmse"]
    gain = 100 * (best["rmse"].to_numpy() / none.reindex(pd.MultiIndex.from_frame(best[place])).to_numpy() - 1)
    mean = best.groupby(["train", "distance", "real", "axis"], sort=False)[["pia", "pie"]].mean().reset_index()
    fits, functions = [], {"real share": np.arange(0, 101, 10)}
    highest = min(7, mean["real"].nunique() - 1)  # of a polynomial that so many shares determine
    drawn = min(4, highest)
    for order in range(1, highest + 1):
        row: dict[str, Any] = {"order": order}
        for k, kind in enumerate(("pia", "pie")):
            r2, rmse, coefficients = polynomial(mean["real"].to_numpy(float), mean[kind].to_numpy(float), order)
            row |= {f"R² {kind}": r2, f"R² {kind}, published": paper.TABLE_3[order][k]}
            row |= {f"RMSE {kind}": rmse, f"RMSE {kind}, published": paper.TABLE_3[order][k + 2]}
            if order == drawn:
                functions[f"{kind}, ours"] = np.polyval(coefficients, functions["real share"])
        fits.append(row)
    functions["pia, eq. 15"] = paper_pia(functions["real share"].astype(float))
    functions["pie, eq. 16"] = paper_pie(functions["real share"].astype(float))
    ties = []
    for word, column in (("real share", "real"), ("Wasserstein", "distance")):
        row = {"against": word}
        for k, kind in enumerate(("pia", "pie")):
            value = float(dcor.distance_correlation(mean[column].to_numpy(float), mean[kind].to_numpy(float)))
            row |= {kind: value, f"{kind}, published": paper.DISTANCE_CORRELATION[word][k]}
        ties.append(row)
    distances = mean[["train", "distance"]].drop_duplicates().sort_values("distance")
    distances = distances.assign(published=[paper.WASSERSTEIN.get(n, np.nan) for n in distances.train])
    means = best.groupby(["real", "axis"], sort=False)[["pia", "pie"]].mean().unstack("axis")
    means.columns = [f"{kind} {axis}" for kind, axis in means.columns]
    verdict = (
        f"Best shares on average: PiA {best.pia.mean():.1f} %, PiE {best.pie.mean():.1f} % of the target density; chosen on "  # noqa: E501
        f"the rows that judge them they change RMSE by {np.nanmean(gain):+.1f} % against none."
    )
    return Outcome(
        verdict,
        (
            Shown("Table 3 beside ours", pd.DataFrame(fits), ("Polynomials through the mean best shares, of the orders that so many shares determine; RMSE in percent.",)),  # noqa: E501
            Shown("Share functions beside eq. 15 and 16", pd.DataFrame(functions), (f"Percent of the target density, ours of order {drawn}; eq. 15 and 16 as they are used: a negative share is none.",)),  # noqa: E501
            Shown("Distance correlation", pd.DataFrame(ties)),
            Shown("Mean best shares (figures 11 to 13)", means.reset_index(), ("Percent of the target density.",)),
            Shown("Wasserstein distances to the next part (figure 33)", distances),
        ),
        (
            "Sets and machines are not the paper's; the paper's distances carry no unit or scale, ours count 1 mm² as 1 mm/s.",  # noqa: E501
            "The best of many combinations on one test set is partly luck: with no effect at all the mean best share is not 0 "  # noqa: E501
            "but the middle of what is offered. Read the gain, not the share.",
            "A row of PiE or PiA has the currents of the local equation with the parameters of table 2, without a gate.",  # noqa: E501
        ),
    )  # fmt: skip


def polynomial(x: Float1D, y: Float1D, order: int) -> tuple[float, float, Float1D]:
    """(R², RMSE, coefficients from the highest power down) of a least-squares polynomial.

    >>> r2, rmse, c = polynomial(np.arange(5.0), 2 * np.arange(5.0) ** 2 + 1, 2)
    >>> round(r2, 9), round(abs(rmse), 9), np.abs(c).round(6).tolist()
    (1.0, 0.0, [2.0, 0.0, 1.0])
    """
    order = min(order, len(np.unique(x)) - 1)
    # on [-1, 1] the powers are told apart; the coefficients are given back in x
    fitted = np.polynomial.Polynomial.fit(x, y, order)
    error = y - fitted(x)
    spread = float(np.sum((y - y.mean()) ** 2))
    r2 = 1.0 - float(np.sum(error**2)) / spread if spread > 0 else float("nan")
    return r2, float(np.sqrt(np.mean(error**2))), np.atleast_1d(fitted.convert().coef)[::-1] + 0.0


def _fullness(samples: Samples) -> float:
    return float(np.mean(occupancy(samples.reduced, SAMPLING_GRID).count >= DENSITY / 0.7))


def _full_bins(samples: Samples) -> np.ndarray:
    """Bins with the target density; those with most rows where there are fewer than three."""
    found = occupancy(samples.reduced, SAMPLING_GRID)
    full = found.bins[found.count >= DENSITY]
    return full if len(full) >= 3 else np.sort(found.bins[np.argsort(-found.count, kind="stable")[:12]])


def _inside(samples: Samples, bins: np.ndarray) -> Samples:
    return samples.take(np.isin(SAMPLING_GRID.ids(samples.reduced), bins))


def _number(share: float) -> int:
    return round(share / 100 * DENSITY)


def _pool(real: Samples, bins: np.ndarray, share: float, rng: np.random.Generator) -> Samples:
    """Up to a share of the density of rows of each bin, each once."""
    rows = reduced(real, _number(share), rng)
    return replace(rows, voxel=SAMPLING_GRID.ids(rows.reduced)) if len(rows) else rows


def _first(rows: Samples, number: int) -> Samples:
    """The first `number` rows of each bin."""
    order = np.argsort(rows.voxel, kind="stable")
    _, first, count = np.unique(rows.voxel[order], return_index=True, return_counts=True)
    place = np.arange(len(order)) - np.repeat(first, count)
    return rows.take(order[place < number])


def _forest(trees: int) -> EstimatorFactory:
    return lambda seed: extra_trees(seed).set_params(n_estimators=trees)


EXPERIMENT = Experiment(
    "shares", "How many PiA and PiE samples a bin should get", "section IV-C, algorithm 3, table 3, figures 8 to 19", "design",  # noqa: E501
    plan, measure, summarise, quick_repeats=1,
)  # fmt: skip
