"""A law without a name as a picture: what is missing over the quantity that it depends on, with what the data say.

In:  a finding without a name, the model of the diagnosis, the series and recordings of its parts.
Out: a figure of the law as a line, over the values that the quantity took, and of the data as points: means, in narrow
     classes of the quantity, of what was recorded and is in neither the simulation nor the other findings.
What is periodic is shown over one period. Of a law of two quantities there is a line for some values of the second;
what rings or fades after an event depends on the time since it alone, and is seen where it differs most.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from bokeh.plotting import figure

from pido.core.arrays import Array1D, Bool1D, Float1D, Float2D
from pido.core.columns import CURRENT
from pido.core.recording import Recording
from pido.diagnosis.answers import equation_text
from pido.diagnosis.arms import Arm, Eased
from pido.diagnosis.bends import Bend
from pido.diagnosis.finding import Finding, PartSeries
from pido.diagnosis.formulas import FORMS, Formula, Peak, Surface, written
from pido.diagnosis.gates import inside
from pido.diagnosis.late import Late, Modulated
from pido.diagnosis.late_arms import LaggedArm, Warped
from pido.diagnosis.mechanisms.base import Mechanism
from pido.diagnosis.models import axis_models
from pido.diagnosis.quantities import QUANTITIES, label
from pido.diagnosis.resonant import Resonant
from pido.diagnosis.signals import signals
from pido.diagnosis.state import AxisState, axis_states
from pido.diagnosis.terms import Term
from pido.diagnosis.tools import ByTool
from pido.diagnosis.waves import Wave
from pido.physics.drive import answered_late
from pido.reports.page import COLOURS, number, signal_figure

_LINE_POINTS = 400
_CLASSES = 25  # of the quantity, in which the data are averaged: as many alike in width, and alike in samples
_FEWEST = 5  # samples of a class
_ENDS = 0.005  # of the samples, at either end, that are beyond what is shown
_FEW_VALUES = 3  # of a second quantity, each of which has a line of its own
_PERIODS = 1.5  # beyond which a wave is shown over one period
_COLOURS = ("mismatch", "corrected", "fourth", "fifth")
TOOL = "tool"


@dataclass(frozen=True)
class _Drawn:
    """Over which quantity a law is drawn, and which second one tells its lines apart.

    late : s, first order, by which `signal` is behind; form : of it; period : of `signal`, over which the data are laid
    """

    signal: str
    second: str = ""
    late: float = 0.0
    form: str = "u"
    period: float = 0.0


@dataclass(frozen=True)
class _Rows:
    """(n,) each: place along the picture; second quantity; A – what the data say is missing; A – what the law says."""

    u: Float1D
    w: Array1D | None
    missing: Float1D
    law: Float1D

    def at(self, rows: Bool1D) -> _Rows:
        return _Rows(self.u[rows], None if self.w is None else self.w[rows], self.missing[rows], self.law[rows])


def shapes(
    finding: Finding,
    model: Mapping[str, Any],
    shown: Mapping[str, PartSeries],
    by_part: Mapping[str, Recording],
    unit: str,
) -> list[figure]:
    """The picture of a finding without a name; of another, and where no recording of its current is there, nothing.

    shown : the parts that have its series; unit : of the missing current, with a space before it
    """
    found = _term_of(finding, model)
    drawn = None if found is None else _drawn(*found)
    if found is None or drawn is None:
        return []
    rows = _rows(*found, drawn, finding.axis, model, shown, by_part)
    if rows is None or np.ptp(rows.u) == 0:
        return []
    over, axis = QUANTITIES[drawn.signal].words, finding.axis
    plot = signal_figure(
        f"Axis {axis}: what is missing over the\n{over}{', one period' if drawn.period else ''}",
        _label(drawn), f"missing,{unit}".rstrip(","), 320,
    )  # fmt: skip
    edges = np.unique(np.r_[np.linspace(0, 1, _CLASSES + 1) * np.ptp(rows.u) + rows.u.min(), _quantiles(rows.u)])
    if drawn.second:
        groups = _groups(rows.w, drawn.second)
        for colour, (said, of) in zip(_COLOURS, groups, strict=False):
            one = _classes(rows.at(of), edges)
            plot.scatter(one.u, one.missing, color=COLOURS[colour], size=6, alpha=0.6)
            plot.line(one.u, one.law, color=COLOURS[colour], line_width=1.8, legend_label=said)
    else:
        term, amplitudes = found
        u = np.linspace(rows.u.min(), rows.u.max(), _LINE_POINTS)
        columns = _alone(term.mechanism, dict(term.shape), drawn.signal, u)
        one = _classes(rows, edges)
        if columns is not None and np.all(columns >= 0) and isinstance(term.mechanism, Surface):
            _band(plot, u, columns, columns @ amplitudes, finding)
        plot.scatter(one.u, one.missing, color="#777777", size=6, alpha=0.8, legend_label="data, means")
        line = (one.u, one.law) if columns is None else (u, columns @ amplitudes)
        plot.line(*line, color=COLOURS["mismatch"], line_width=1.8, legend_label="this finding")
    return [plot]


def _label(drawn: _Drawn) -> str:
    """Of the axis along which a law is drawn."""
    words, unit, _ = QUANTITIES[drawn.signal]
    if drawn.period:
        return f"{words} ({drawn.signal}), from the beginning of a period of {number(drawn.period, 4)}, {unit}"
    if not drawn.late:
        return label(drawn.signal)
    of = "" if drawn.form in ("u", "|u|") else f", as {written(drawn.signal, drawn.form)}"
    behind = f"{words} as it was lately ({number(drawn.late)} s, first order){of}"
    return f"{behind}, {unit}" if drawn.form in ("u", "|u|") and unit != "–" else behind


def _band(plot: figure, u: Float1D, columns: Float2D, level: Float1D, finding: Finding) -> None:
    """95 % of the heights of a curve: between two knots it is theirs."""
    low, high = (np.array([e.ci95[end] - e.value for e in _heights(finding, columns.shape[1])]) for end in (0, 1))
    plot.varea(
        x=u, y1=level + columns @ low, y2=level + columns @ high, color=COLOURS["band"], fill_alpha=0.3,
        legend_label="95 % interval",
    )  # fmt: skip


def _heights(finding: Finding, count: int):
    return [finding.parameters[f"g_{i}"] for i in range(count)]


def _term_of(finding: Finding, model: Mapping[str, Any]) -> tuple[Term, Float1D] | None:
    """The term of a finding without a name and its amplitudes."""
    if finding.mechanism != "unknown" or finding.axis not in model.get("axes", {}):
        return None
    own = axis_models(model)[finding.axis]
    for term, amplitudes in zip(own.terms, own.amplitudes, strict=True):
        if term.name == "unknown" and equation_text(term, finding.axis) == finding.equation:
            return term, amplitudes
    return None


def _drawn(term: Term, amplitudes: Float1D) -> _Drawn | None:
    """How a law is drawn, None of one that is a law of the time since an event."""
    match term.mechanism:
        case Formula(factors=factors) if factors:
            first, *others = sorted(dict.fromkeys(s for s, _ in factors), key=_few_values)
            return _Drawn(first, others[0] if others else "")
        case Surface(variables=(first, *others)):
            return _Drawn(first, others[0] if others else "")
        case Peak(signal=signal):
            return _Drawn(signal)
        case Bend(signal=signal, turns=turns):
            return _Drawn(signal, turns)
        case Wave(place=place, signal=signal):
            return _Drawn(place, signal, period=dict(term.shape)["L"])
        case Arm(place=place, signal=signal):
            return _Drawn(signal, place) if place == "coolant" else _Drawn(place, signal)
        case LaggedArm(place=place, signal=signal):
            return _Drawn(place, signal)
        case Eased(by=by, signal=signal) | Resonant(by=by, signal=signal):
            return _Drawn(by, signal)
        case ByTool(law=law):
            return _Drawn(law.factors[0][0], TOOL)
        case Late() as late:
            name, form = late.driver
            second = {Modulated: "signal", Warped: "place"}.get(type(late), "")
            return _Drawn(name, getattr(late, second) if second else "", dict(term.shape)["tau"], form)
        case _:
            return None


def _few_values(name: str) -> bool:
    """Whether a signal is one of those that take two or three values."""
    return QUANTITIES[name].unit == "–"


def _rows(
    term: Term,
    amplitudes: Float1D,
    drawn: _Drawn,
    axis: str,
    model: Mapping[str, Any],
    shown: Mapping[str, PartSeries],
    by_part: Mapping[str, Recording],
) -> _Rows | None:
    """Of all parts in which the current was recorded, where the law acts."""
    parts = [p for p in shown if CURRENT[axis] in by_part[p]]
    bands = {a: float(band) for a, band in model.get("dead_bands", {}).items()}
    states = axis_states([by_part[p] for p in parts], axis, bands=bands) if parts else ()
    each = []
    for part, state in zip(parts, states, strict=True):
        law = amplitudes @ term.of_part(state)
        missing = np.asarray(by_part[part][CURRENT[axis]], float) - shown[part].corrected[axis] + law
        u, w = _quantities(state, drawn)
        there = np.isfinite(missing) & np.isfinite(u) & (inside(state, term.gates) > 0)
        each.append(_Rows(u, w, missing, law).at(there))
    if not each or not sum(len(r.u) for r in each):
        return None
    u, missing, law = (np.concatenate([getattr(r, name) for r in each]) for name in ("u", "missing", "law"))
    w = np.concatenate([r.w for r in each if r.w is not None]) if drawn.second else None
    if drawn.period and np.ptp(u) > _PERIODS * drawn.period:
        u = np.mod(u, drawn.period)
    low, high = np.quantile(u, [_ENDS, 1 - _ENDS])
    return _Rows(u, w, missing, law).at((u >= low) & (u <= high))


def _quantities(state: AxisState, drawn: _Drawn) -> tuple[Float1D, Array1D | None]:
    names = [n for n in (drawn.signal, drawn.second) if n and n != TOOL]
    known = signals(state, names)
    u = known[drawn.signal][0]
    if drawn.late:
        u = answered_late(FORMS[drawn.form](u)[None], state.time, drawn.late)[0]
    if drawn.second == TOOL:
        return u, state.tool_id
    return u, known[drawn.second][0] if drawn.second else None


def _classes(rows: _Rows, edges: Float1D) -> _Rows:
    """Means in classes of the quantity that have enough samples."""
    at = np.clip(np.searchsorted(edges, rows.u, side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(at, minlength=len(edges) - 1)
    some = count >= _FEWEST
    u, missing, law = (
        np.bincount(at, values, len(count))[some] / count[some] for values in (rows.u, rows.missing, rows.law)
    )
    return _Rows(u, None, missing, law)


def _quantiles(u: Float1D) -> Float1D:
    return np.quantile(u, np.linspace(0, 1, _CLASSES + 1))


def _groups(w: Array1D | None, name: str) -> Sequence[tuple[str, Bool1D]]:
    """Rows of some values of the second quantity: each of a few, either sign, or thirds of those that are not zero."""
    assert w is not None
    if name == TOOL:
        return [(f"tool {t}", w == t) for t in dict.fromkeys(w.tolist()) if t is not None]
    return list(_groups_of(np.asarray(w, float), *QUANTITIES[name][:2]))


def _groups_of(w: Float1D, words: str, unit: str) -> Iterator[tuple[str, Bool1D]]:
    unit = "" if unit == "–" else f" {unit}"
    values = np.unique(np.round(w, 9))
    if len(values) <= _FEW_VALUES:
        yield from ((f"{words} {number(float(v))}{unit}", np.isclose(w, v)) for v in values)
        return
    zero = w == 0
    if np.mean(zero) > _ENDS:
        yield f"{words} 0{unit}", zero
    if values[0] < 0 < values[-1]:
        yield f"{words} below 0{unit}", w < 0
        yield f"{words} above 0{unit}", w > 0
        return
    edges = np.quantile(w[~zero], [0, 1 / 3, 2 / 3, 1])
    for k, (low, high) in enumerate(itertools.pairwise(edges)):
        of = ~zero & (w >= low) & ((w < high) | (k == 2))
        yield f"{words} {number(float(low))} to {number(float(high))}{unit}", of


def _alone(law: Mechanism, shape: Mapping[str, float], name: str, u: Float1D) -> Float2D | None:
    """(n, k) – the law at values of the one quantity that it is a law of; None of a law of several, or of what was."""
    known = {name: (u, QUANTITIES[name].unit)}
    match law:
        case Formula():
            return law.values(known)[:, None]
        case Peak():
            return law.over(known, shape)
        case Surface() | Bend():
            return law.over(known)
        case Wave():
            return law.over(known, shape["L"])
        case _:
            return None
