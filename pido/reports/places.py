"""Where a mismatch acts, as pictures: over the machine's table and over the speeds, and a friction along its travel.

In:  the findings of one axis, the series and recordings of the parts.
Out: figures, of those alone that show something: what heat, a clock or a shift in time makes is alike at every place.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from bokeh.models import ColorBar, LinearColorMapper
from bokeh.palettes import Cividis256
from bokeh.plotting import figure

from pido.core.columns import POSITION, VELOCITY
from pido.core.recording import Recording
from pido.diagnosis.finding import Finding, PartSeries
from pido.diagnosis.mechanisms.friction import PositionDependentFriction
from pido.diagnosis.models import axis_models
from pido.diagnosis.terms import Term
from pido.reports.page import COLOURS, signal_figure, thin

MOST_MAP_POINTS = 3000
CURVE_POINTS = 400
_TABLE = ("Where on the machine table", POSITION["x"], POSITION["y"], "mm")
_SPEEDS = ("At which speeds", VELOCITY["x"], VELOCITY["y"], "mm/s")
_AT_PLACES = frozenset({"material_hard_zone", "position_dependent_friction"})
_AT_SPEEDS = frozenset(
    {"viscous_friction", "stribeck_friction", "standstill_friction", "friction_asymmetry", "axis_coupling"}
)


def maps(
    findings: Sequence[Finding], shown: Mapping[str, PartSeries], by_part: Mapping[str, Recording], unit: str
) -> list[figure]:
    """Over the table and over the speeds, coloured by the size of the mismatch, each where a finding speaks of it.

    findings : of one axis; shown : the parts that have its series
    """
    axis = findings[0].axis
    planes = [_TABLE] if any(map(_speaks_of_places, findings)) else []
    planes += [_SPEEDS] if any(map(_speaks_of_speeds, findings)) else []
    figures = []
    for title, first, second, along in planes:
        usable = [p for p in shown if first in by_part[p] and second in by_part[p]]
        if not usable:
            continue
        each = MOST_MAP_POINTS // len(usable)
        x, y, size = (
            np.concatenate([np.asarray(get(p), float)[thin(len(shown[p].time), each)] for p in usable])
            for get in (
                lambda p, c=first: by_part[p][c],
                lambda p, c=second: by_part[p][c],
                lambda p: np.abs(shown[p].mismatch[axis]),
            )
        )
        high = float(np.nanquantile(size, 0.99)) or 1.0
        mapper = LinearColorMapper(palette=list(Cividis256), low=0.0, high=high)
        plot = signal_figure(
            f"{title}:\nsize of the mismatch on axis {axis}", f"{first}, {along}", f"{second}, {along}", 380
        )
        plot.scatter(
            "x", "y", source={"x": x, "y": y, "size": size}, color={"field": "size", "transform": mapper}, size=4
        )
        plot.match_aspect = True  # a circle of the part is a circle on the page
        plot.add_layout(ColorBar(color_mapper=mapper, title=unit), "right")
        figures.append(plot)
    return figures


def curves(
    finding: Finding,
    model: Mapping[str, Any],
    parts: Iterable[str],
    by_part: Mapping[str, Recording],
    unit: str,
) -> list[figure]:
    """The level of a friction along its travel, as far as the parts went, with the 95 % band of its heights; of another
    finding nothing.

    unit : with a space before it
    """
    axis, name = finding.axis, POSITION.get(finding.axis, "")
    found = _along_travel(finding, model)
    seen = [by_part[p][name] for p in parts if name in by_part[p]]
    if found is None or not seen:
        return []
    term, law, amplitudes = found
    pos = np.linspace(min(map(np.nanmin, seen)), max(map(np.nanmax, seen)), CURVE_POINTS)
    columns = law.along(pos, **dict(term.shape))
    plot = signal_figure(
        f"Axis {axis}: friction along the travel,\nmore than simulated", f"{name}, mm", f"friction,{unit}"
    )
    half = np.zeros(len(amplitudes))
    for i, amplitude in enumerate(law.amplitudes):
        if (known := finding.parameters.get(amplitude.name)) is not None:
            half[i] = (known.ci95[1] - known.ci95[0]) / 2
    level = columns @ amplitudes
    if np.all(columns >= 0):  # heights: between two of them the band is theirs; of a wave their correlation decides
        band = columns @ half
        plot.varea(
            x=pos, y1=level - band, y2=level + band, color=COLOURS["band"], fill_alpha=0.3, legend_label="95 % interval"
        )
    plot.line(pos, level, color=COLOURS["mismatch"], line_width=1.6, legend_label="g(pos)")
    return [plot]


def _along_travel(finding: Finding, model: Mapping[str, Any]):
    """The term of a friction along the travel, its law and its amplitudes."""
    if finding.mechanism.removeprefix("miscalibrated:") != PositionDependentFriction.id or "axes" not in model:
        return None
    own = axis_models(model)[finding.axis]
    terms: Iterable[Term] = own.terms
    for term, amplitudes in zip(terms, own.amplitudes, strict=True):
        if term.name == finding.mechanism and isinstance(term.mechanism, PositionDependentFriction):
            return term, term.mechanism, amplitudes
    return None


def _speaks_of_places(finding: Finding) -> bool:
    if finding.mechanism == "unknown":
        return finding.where.workpiece is not None or bool(re.search(r"\b(pos|from)_[xyz]\b", finding.equation))
    return finding.mechanism.removeprefix("miscalibrated:") in _AT_PLACES


def _speaks_of_speeds(finding: Finding) -> bool:
    """By its law, or as it acts at some speeds only. A sign alone is no speed: what turns with it has one size."""
    if any(re.search(r"\bv_[xy]\b.*[<>]|path speed", condition) for condition in finding.where.conditions):
        return True
    if finding.mechanism == "unknown":
        return bool(re.search(r"\b(v_[xy]|feed)\b", re.sub(r"sgn\(\w+\)", "", finding.equation)))
    return finding.axis != "sp" and finding.mechanism.removeprefix("miscalibrated:") in _AT_SPEEDS
