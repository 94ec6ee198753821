"""PiDO beside other ways to do with few data: generated rows, weights, inputs, equations (past the paper).

In:  a fleet. Out: errors of all variants in the same cells, with paired tests of PiDO against each.
"""
# pandas annotates groupby and pivots wider than they are
# pyright: reportAttributeAccessIssue=false, reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportOperatorIssue=false, reportReturnType=false, reportGeneralTypeIssues=false, reportAssignmentType=false

from __future__ import annotations

import numpy as np
import pandas as pd

from pido.experiments import ablation
from pido.experiments.base import Experiment, Options, Outcome, Shown, Unit
from pido.experiments.cells import FILES, RANDOM, TIME
from pido.experiments.compare import by_step, changes_tested, counts, means, over_axes
from pido.experiments.data import Fleet
from pido.experiments.significance import LEVEL, corrected, paired_p
from pido.experiments.variants import DELIVERED, GENERATING, OTHERS

QUICK_STEPS = {TIME: (30,), RANDOM: (10, 30), FILES: (1,)}


def plan(fleet: Fleet, options: Options) -> list[Unit]:
    """As the ablation, with the rivals in place of the printed variants."""
    return ablation.plan(fleet, options, ("real", "PiA+PiE", *DELIVERED, *OTHERS), QUICK_STEPS)


def summarise(table: pd.DataFrame) -> Outcome:
    """PiDO against each rival, counts against the same models without rows, all errors."""
    duel = duels(table)
    mean, result = changes_tested(over_axes(table)), changes_tested(table)
    rows = duel[duel.rival.isin(GENERATING)]
    ahead = rows[(rows.change > 0) & (rows.p_corrected < LEVEL)].rival.tolist()
    others = duel[~duel.rival.isin([*GENERATING, "PiA+PiE", "real + direction, other seed"])]
    best = others.loc[others["change"].idxmin()]
    verdict = (
        f"PiDO is ahead of {len(ahead)} of {len(rows)} row-generating rivals beyond chance "
        f"({', '.join(ahead) or 'none'}); against the best that generates no rows ({best.rival}) its RMSE is "
        f"{-best.change:+.1f} % (negative is better for PiDO)."
    )
    return Outcome(
        verdict,
        (
            Shown(
                "PiDO against each", duel, ("How much lower PiDO's RMSE is, in percent of the rival's; mean of axes.",)
            ),
            Shown("Counts", counts(result), (ablation.BASELINES,)),
            Shown("Mean of the axes per step", by_step(mean), (ablation.STARS,)),
            Shown("All errors", means(table[table.space == "C"])),
        ),
        ("The paper compares with real data alone; no published table stands beside these.",),
    )


def duels(table: pd.DataFrame) -> pd.DataFrame:
    """PiDO against every other variant: mean of the axes, one value per repeat (mean over steps and scenarios, space C),
    so that steps of one repeat do not count as independent."""  # noqa: E501
    some = table[table.space == "C"]
    scale = some[some.variant == "real + direction"].groupby("axis")["rmse"].mean()
    some = some.assign(rmse=some["rmse"] / some["axis"].map(scale))
    wide = some.groupby(["repeat", "variant"])["rmse"].mean().unstack("variant")
    rows = []
    for rival in [v for v in dict.fromkeys(table.variant) if v != "PiDO"]:
        delta = (wide[rival] - wide["PiDO"]).to_numpy()
        p, test = paired_p(delta)
        change = 100 * float(np.nanmean(delta)) / float(wide[rival].mean())
        rows.append({"rival": rival, "repeats": int(np.isfinite(delta).sum()), "change": change, "p": p, "test": test})
    result = pd.DataFrame(rows)
    return result.assign(p_corrected=corrected(result["p"].to_numpy()))


EXPERIMENT = Experiment(
    "rivals", "Generated samples beside other ways to do with few data", "past the paper", "impellers",
    plan, ablation.measure, summarise, quick_repeats=3,
)  # fmt: skip
