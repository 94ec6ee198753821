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

from pido.core.arrays import Array1D, Bool1D, Float1D
from pido.core.axes import LINEAR_AXES
from pido.core.columns import POSITION, VELOCITY
from pido.core.recording import Recording
from pido.diagnosis.finding import Finding, PartSeries
from pido.diagnosis.mechanisms.friction import PositionDependentFriction
from pido.diagnosis.models import axis_models
from pido.diagnosis.terms import Term
from pido.reports.page import COLOURS, signal_figure, thin

MOST_MAP_POINTS = 3000
_MAP_PX, _BESIDE_PX = 300, 200  # height of a map, and what is beside it
CURVE_POINTS = 400
_ON_EITHER_AXIS = 0.05
"""Of how far one axis of a map goes, that the other one goes at least: less is a line, and no map."""
_USUAL = (0.01, 0.99)
"""Of its samples, between which an axis goes: what it does now and then is no motion that a map shows."""
_AT_PLACES = frozenset({"material_hard_zone", "position_dependent_friction"})
_AT_SPEEDS = frozenset(
    {"viscous_friction", "stribeck_friction", "standstill_friction", "friction_asymmetry", "axis_coupling"}
)


def maps(
    findings: Sequence[Finding], shown: Mapping[str, PartSeries], by_part: Mapping[str, Recording], unit: str
) -> list[figure]:
    """Over the table and over the speeds, coloured by the size of the mismatch, each where a finding speaks of it and
    two axes move.

    findings : of one axis; shown : the parts that have its series
    """
    axis, figures = findings[0].axis, []
    for title, columns, along, asked in (
        ("Where on the machine", POSITION, "mm", _places(findings)),
        ("At which speeds", VELOCITY, "mm/s", _speeds(findings)),
    ):
        pair = _that_move(columns, asked, [by_part[p] for p in shown])
        if pair is None:
            continue
        first, second = (columns[a] for a in pair)
        title = f"{title} table" if columns is POSITION and pair == ("x", "y") else title
        usable = [p for p in shown if first in by_part[p] and second in by_part[p]]
        each = MOST_MAP_POINTS // len(usable)
        x, y, size = (
            np.concatenate([np.asarray(get(p), float)[thin(len(shown[p].time), each)] for p in usable])
            for get in (
                lambda p, c=first: by_part[p][c],
                lambda p, c=second: by_part[p][c],
                lambda p: np.abs(shown[p].mismatch[axis]),
            )
        )
        order, rest = np.argsort(np.nan_to_num(size)), ""  # where it is large is seen, whatever lies there too
        if columns is VELOCITY:  # a few rapids would press all else together
            usual = np.all([_is_usual(values) for values in (x, y)], axis=0)
            order, rest = order[usual[order]], "; the fastest few are left out" * bool(np.mean(usual) < 1)
        high = float(np.nanquantile(size, 0.99)) or 1.0
        mapper = LinearColorMapper(palette=list(Cividis256), low=0.0, high=high)
        plot = signal_figure(
            f"{title}:\nsize of the mismatch on axis {axis}{f', {unit}' if unit else ''}{rest}",
            f"{first}, {along}", f"{second}, {along}", 380,
        )  # fmt: skip
        plot.scatter(
            "x",
            "y",
            source={"x": x[order], "y": y[order], "size": size[order]},
            color={"field": "size", "transform": mapper},
            size=4,
        )
        if columns is POSITION:  # a circle of the part is a circle on the page, and the page no wider than it
            plot.match_aspect = True
            plot.max_width = round(
                _MAP_PX * np.nanmax([np.ptp(x[order]) / max(np.ptp(y[order]), 1e-9), 1.0]) + _BESIDE_PX
            )
        plot.add_layout(ColorBar(color_mapper=mapper), "right")
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


def _that_move(
    columns: Mapping[str, str], asked: Sequence[str], recordings: Sequence[Recording]
) -> tuple[str, str] | None:
    """The two axes of a map: those that the findings speak of, beside the one that goes farthest of the others; None
    where none of the former moves, or one hardly does beside the other."""
    far = {a: _how_far([r[columns[a]] for r in recordings if columns[a] in r]) for a in LINEAR_AXES}
    own = [a for a in asked if far[a] > 0]
    others = sorted((a for a in LINEAR_AXES if a not in own), key=lambda a: -far[a])
    pair = tuple(sorted([*own, *others][:2]))
    if not own or min(far[a] for a in pair) < _ON_EITHER_AXIS * max(far[a] for a in pair):
        return None
    return pair[0], pair[1]


def _how_far(values: Sequence[Array1D]) -> float:
    known = [v for v in (np.asarray(v, float) for v in values) if np.isfinite(v).any()]
    return float(np.ptp(np.nanquantile(np.concatenate(known), _USUAL))) if known else 0.0


def _is_usual(values: Float1D) -> Bool1D:
    low, high = np.nanquantile(values, _USUAL)
    return (values >= low) & (values <= high)


def _places(findings: Sequence[Finding]) -> list[str]:
    """Axes whose position the findings speak of, in the order in which they do."""
    asked = []
    for finding in findings:
        name = finding.mechanism.removeprefix("miscalibrated:")
        if name == "unknown":
            asked += re.findall(r"\b(?:pos|from)_([xyz])\b", finding.equation)
            asked += LINEAR_AXES[:2] if finding.where.workpiece is not None else []
        elif name in _AT_PLACES:
            asked += LINEAR_AXES[:2] if name == "material_hard_zone" or finding.axis == "sp" else [finding.axis]
    return list(dict.fromkeys(asked))


def _speeds(findings: Sequence[Finding]) -> list[str]:
    """Axes whose speed the findings speak of, by their law or as they act at some speeds only. A sign alone is no
    speed: what turns with it has one size."""
    asked = []
    for finding in findings:
        confined = " ".join(c for c in finding.where.conditions if re.search("[<>]", c))
        asked += re.findall(r"\bv_([xyz])\b", confined)
        asked += LINEAR_AXES[:2] if "path speed" in confined else []
        name, law = finding.mechanism.removeprefix("miscalibrated:"), re.sub(r"sgn\(\w+\)", "", finding.equation)
        if name == "unknown":
            asked += re.findall(r"\bv_([xyz])\b", law)
            asked += LINEAR_AXES[:2] if re.search(r"\bfeed\b", law) else []
        elif finding.axis != "sp" and name in _AT_SPEEDS:
            asked.append(finding.axis)
    return list(dict.fromkeys(asked))
