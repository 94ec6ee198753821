"""Whether a change of error is more than chance (paper, section VII-B.2), corrected for how often it was asked.

In:  paired differences. Out: p values, by the t test where Shapiro and Wilk find them normal, else by Wilcoxon's signed
     rank test; corrected by Holm (1979: no false finding at all) or Benjamini and Hochberg (1995: few among many).
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from scipy import stats

from pido.core.arrays import Float1D

LEVEL = 0.05


def paired_p(difference: Float1D) -> tuple[float, str]:
    """(two-sided p, name of the test) that differences (n,) scatter around zero. NaN are left out.

    p is 1 where there are fewer than three differences or all are zero: then nothing speaks for a change.

    >>> paired_p(np.zeros(30))
    (1.0, 'none')
    """
    d = np.asarray(difference, float)
    d = d[np.isfinite(d)]
    if len(d) < 3 or not d.any():
        return 1.0, "none"
    spread = float(np.ptp(d))
    if spread <= 1e-12 * float(np.abs(d).max()):  # the same change each time: no scatter to test against
        return float(stats.binomtest(len(d), len(d), 0.5).pvalue), "sign"
    shape: Any = stats.shapiro(d)  # scipy's results have names that its annotations do not know
    if shape.pvalue > LEVEL:
        t_test: Any = stats.ttest_1samp(d, 0.0)
        return float(t_test.pvalue), "t"
    method = "exact" if len(d) <= 50 and (np.abs(d) > 0).all() and len(np.unique(np.abs(d))) == len(d) else "approx"
    ranks: Any = stats.wilcoxon(d, method=method)
    return float(ranks.pvalue), "Wilcoxon"


def corrected(p: Float1D, how: Literal["holm", "bh"] = "holm") -> Float1D:
    """(n,): p values corrected for their number; NaN stay.

    >>> corrected(np.array([0.01, 0.04, 0.03])).round(4).tolist()
    [0.03, 0.06, 0.06]
    """
    p = np.asarray(p, float)
    known = np.isfinite(p)
    values, out = p[known], np.full(len(p), np.nan)
    if how == "bh":
        out[known] = stats.false_discovery_control(values) if len(values) else values
        return out
    order = np.argsort(values, kind="stable")
    steps = np.maximum.accumulate(values[order] * np.arange(len(values), 0, -1))
    holm = np.empty(len(values))
    holm[order] = np.minimum(steps, 1.0)
    out[known] = holm
    return out
