"""The numbers of a finding as rows of a table: name, value with its unit, interval.

In:  the parameters of a finding. Out: a row each; one for all heights of a curve, which its picture shows.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping

from pido.diagnosis.finding import Estimate
from pido.reports.page import number

MOST_DIGITS = 9
"""Of a parameter whose interval is narrow."""
MOST_NUMBERED = 8
"""Numbered parameters shown in a row each: the amplitudes of a few waves or stretches, not the knots of a curve."""
MOST_PICTURED = 4
"""The same where a picture shows what they make together."""
FIXED = "set by the form, not estimated"
"""In place of the interval of a number that has none."""


def parameter_rows(parameters: Mapping[str, Estimate], pictured: bool = False) -> list[tuple[str, str, str]]:
    """A row per parameter: name, value, interval; one for all of a name that are numbered where these are many, as the
    knots of a curve and the waves of a sum are.

    pictured : whether the page shows the curve that they make
    """
    alike = Counter(_numbered(name, e) for name, e in parameters.items())
    most = MOST_PICTURED if pictured else MOST_NUMBERED
    rows: list[tuple[str, str, str]] = []
    for kind in dict.fromkeys(_numbered(name, e) for name, e in parameters.items()):
        own = {name: e for name, e in parameters.items() if _numbered(name, e) == kind}
        if alike[kind] <= most:
            rows += [_row(name, e) for name, e in own.items()]
            continue
        first, *_, last = own
        low, high = (number(end(e.value for e in own.values()), 4) for end in (min, max))
        where = "the picture shows what they make; each in diagnosis.json" if pictured else "each in diagnosis.json"
        rows.append((f"{first} … {last}", f"{len(own)} values, {low} to {high}{of(kind[1])}", where))
    return rows


def of(unit: str) -> str:
    """A unit behind a number; nothing where it has none.

    >>> of("A"), of("–")
    (' A', '')
    """
    return "" if unit in ("–", "") else f" {unit}"


def _row(name: str, estimate: Estimate) -> tuple[str, str, str]:
    """A scale, which formulas have as what it lacks of one, is told as itself.

    >>> _row("g - 1", Estimate(0.06987, "–", (0.06748, 0.07226)))
    ('g', '× 1.070', '1.067 … 1.072')
    >>> _row("T", Estimate(39.99997, "s", (39.9998, 40.00013)))
    ('T', '40 s', '39.9998 … 40.0001 s')
    >>> _row("delta", Estimate(2.0, "–", (1.5, 2.5)))
    ('delta', '2', '1.5 … 2.5')
    """
    if name.endswith(" - 1") and estimate.unit == "–":
        value, low, high = (f"{1 + v:.4g}".ljust(5, "0") for v in (estimate.value, *estimate.ci95))
        return name.removesuffix(" - 1"), f"× {value}", f"{low} … {high}"
    low, high = estimate.ci95
    digits = next((n for n in range(4, MOST_DIGITS) if number(low, n) != number(high, n)), 4)
    interval = f"{number(low, digits)} … {number(high, digits)}{of(estimate.unit)}"
    return name, f"{number(estimate.value, digits)}{of(estimate.unit)}", FIXED if estimate.fixed else interval


def _numbered(name: str, estimate: Estimate) -> tuple[str, str]:
    """What parameters that only a number tells apart have in common, or whether they are of the sine or the cosine of a
    wave; of any other one its own name.

    >>> a = Estimate(0.1, "A", (0.0, 0.2))
    >>> _numbered("g_12", a), _numbered("k_s3", a), _numbered("k_c3", a), _numbered("tau", a)
    (('g', 'A'), ('k_sc', 'A'), ('k_sc', 'A'), ('tau', 'A'))
    """
    found = re.fullmatch(r"(\w+)_([sc]?)\d+", name)
    return (name if found is None else found[1] + "_sc" * bool(found[2])), estimate.unit
