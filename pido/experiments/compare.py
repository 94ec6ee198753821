"""Errors of variants beside their baseline: paired over repeats, tested, corrected for the number of tests.

In:  rows of {scenario, repeat, step, space, variant, baseline, axis, rmse, ...}.
Out: one row per scenario, step, space, axis and variant with mean change, p and corrected p; counts; means.
"""
# pandas annotates groupby and pivots wider than they are
# pyright: reportAttributeAccessIssue=false, reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportOperatorIssue=false, reportReturnType=false, reportGeneralTypeIssues=false, reportAssignmentType=false

from __future__ import annotations

import numpy as np
import pandas as pd

from pido.experiments.significance import LEVEL, corrected, paired_p

CELL = ["scenario", "step", "space", "axis", "variant", "baseline"]


def differences(table: pd.DataFrame, metric: str = "rmse") -> pd.DataFrame:
    """Each row with `base`, the baseline's error in the same repeat and cell, and `delta` = base - error (A, positive is
    better); the baselines themselves are left out."""  # noqa: E501
    place = ["scenario", "repeat", "step", "space", "axis"]
    errors = table[[*place, "variant", "baseline", metric]]
    base = errors[errors.variant == errors.baseline][[*place, "variant", metric]]
    base = base.rename(columns={"variant": "baseline", metric: "base"})
    both = errors[errors.variant != errors.baseline].merge(base, on=[*place, "baseline"], how="left")
    return both.assign(delta=both["base"] - both[metric])


def beside(table: pd.DataFrame, variant: str, baseline: str) -> pd.DataFrame:
    """The rows, and those of `variant` once more to be compared with `baseline`, where that was measured."""
    if baseline not in set(table.variant):
        return table
    return pd.concat([table, table[table.variant == variant].assign(baseline=baseline)], ignore_index=True)


def changes_tested(table: pd.DataFrame, metric: str = "rmse", how: str = "holm") -> pd.DataFrame:
    """One row per scenario, step, space, axis and variant: repeats, mean baseline error, change in percent (positive is
    better), p, corrected p (over all rows of real variants; nulls among themselves), significant."""
    rows = []
    for key, group in differences(table, metric).groupby(CELL, sort=False):
        assert isinstance(key, tuple)
        p, test = paired_p(group["delta"].to_numpy())
        base = float(group["base"].mean())
        change = 100 * float(group["delta"].mean()) / base if base > 0 else 0.0
        rows.append(
            dict(zip(CELL, key, strict=True))
            | {"repeats": len(group), "base": base, "change": change, "p": p, "test": test}
        )
    result = pd.DataFrame(rows, columns=[*CELL, "repeats", "base", "change", "p", "test"])
    null = result.variant.str.endswith("other seed")
    p = np.full(len(result), np.nan)
    for mine in (null.to_numpy(), ~null.to_numpy()):
        p[mine] = corrected(result["p"].to_numpy()[mine], "bh" if how == "bh" else "holm")
    return result.assign(p_corrected=p, significant=p < LEVEL)


def over_axes(table: pd.DataFrame, metric: str = "rmse") -> pd.DataFrame:
    """The same rows with the mean of the axes' relative errors as axis 'mean': each over the baseline's mean there, so
    that an axis with large currents does not speak for all."""
    scale = table[table.variant == table.baseline].groupby("axis")[metric].mean()
    scaled = table.assign(**{metric: table[metric] / table["axis"].map(scale)})
    keys = ["scenario", "repeat", "step", "space", "variant", "baseline"]
    return scaled.groupby(keys, sort=False, as_index=False)[metric].mean().assign(axis="mean")


def counts(result: pd.DataFrame) -> pd.DataFrame:
    """Per variant and what it is compared with: cells better and worse, and how many of them beyond chance, before and
    after correction."""
    rows = []
    for (variant, baseline), group in result.groupby(["variant", "baseline"], sort=False):
        better, worse = group.change > 0, group.change < 0
        rows.append(
            {
                "variant": variant, "against": baseline, "cells": len(group),
                "better": int(better.sum()), "worse": int(worse.sum()),
                "better, p < 0.05": int((better & (group.p < LEVEL)).sum()),
                "worse, p < 0.05": int((worse & (group.p < LEVEL)).sum()),
                "better, corrected": int((better & group.significant).sum()),
                "worse, corrected": int((worse & group.significant).sum()),
            }
        )  # fmt: skip
    return pd.DataFrame(rows)


def by_step(result: pd.DataFrame) -> pd.DataFrame:
    """Change in percent (positive is better) per scenario and step, one column per variant and what it is compared
    with, named by both; a star marks significance after correction."""
    shown = result.assign(
        pair=result.variant + " against " + result.baseline,
        cell=[f"{c:+.1f}{'*' if s else ''}" for c, s in zip(result.change, result.significant, strict=True)],
    )
    wide = shown.pivot(index=["scenario", "space", "axis", "step"], columns="pair", values="cell")
    order = list(dict.fromkeys(shown["pair"]))
    return wide[order].reset_index()


def means(table: pd.DataFrame) -> pd.DataFrame:
    """Per variant and axis: mean and standard deviation of RMSE, and means of the other errors, over all cells."""
    grouped = table.groupby(["axis", "variant"], sort=False)
    wide = grouped.agg(
        rmse=("rmse", "mean"), std=("rmse", "std"), mae=("mae", "mean"), error_99=("error_99", "mean"),
        peak=("peak", "mean"), at_changes=("at_changes", "mean"), cells=("rmse", "size"),
    )  # fmt: skip
    return wide.reset_index()
