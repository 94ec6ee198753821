"""The page of a judged part: what was recorded and expected, the band, the alarms, and how to answer them.

In:  a `Judgement`. Out: `Page`.
"""

from __future__ import annotations

import numpy as np
from bokeh.models import BoxAnnotation
from bokeh.plotting import figure

from pido.core.arrays import Float1D
from pido.core.axes import AXES
from pido.monitoring.band import corridor
from pido.monitoring.residuals import window_mean, window_samples
from pido.reports.page import COLOURS, Page, Section, Table, number, signal_figure
from pido.reports.words import in_words
from pido.supervision import NO_SAFETY_STOP
from pido.supervision.part import Judgement, NamedAlarm, headline, not_judged

MOST_STRETCHES = 1200
"""Steps drawn per line and axis; each keeps its extremes."""
MOST_BOXES = 100
FEW_PARTS = 10
_WIDE = (
    "From so few parts a band is wide, and changes smaller than it pass unseen. It narrows as good parts are taken in."
)


def monitor_page(judgement: Judgement) -> Page:
    """The page; axes with alarms first."""
    alarms, band = judgement.alarms, judgement.band
    first = {a.alarm.axis for a in alarms}
    axes = sorted(band.axes, key=lambda axis: (axis not in first, AXES.index(axis)))
    plots = [_plot(judgement, axis) for axis in axes if axis not in judgement.verdict.unwatched]
    sections = []
    if alarms:
        sections.append(_alarms(alarms))
    sections.append(
        Section(
            "Recorded, expected, and the band",
            [
                f"Means over {band.window_s:g} s. The band is learnt from {band.parts} part(s) on which the model had "
                f"not been trained; it lets {band.tolerate:g} of 100 good parts raise a false alarm. Drag to zoom.",
                *([_WIDE] if band.parts < FEW_PARTS else []),
            ],
            figures=plots,
        )
    )
    notes = list(judgement.notes)
    if judgement.verdict.unwatched:
        notes.append(f"Not watched, for want of a recording or a band: {', '.join(judgement.verdict.unwatched)}.")
    if notes:
        sections.append(Section("What to know about this verdict", notes))
    sections.append(Section("What this is not", [NO_SAFETY_STOP]))
    return Page(f"Monitor: part {judgement.part} of {judgement.machine}", verdict(judgement), sections)


def verdict(judgement: Judgement) -> str:
    """In one or two sentences."""
    judged = f"{judgement.verdict.judged:.0%} of its cutting time could be judged ({judgement.model})."
    if judgement.verdict.good:
        what = headline(judgement.record())
        return f"{what[0].upper()}{what[1:]}. {judged}"
    if not judgement.alarms:
        why = not_judged(judgement.verdict, judgement.band)
        return f"Not judged: this part may be good or bad. {why[0].upper()}{why[1:]} ({judgement.model})."
    worst = max(judgement.alarms, key=lambda a: abs(a.alarm.spreads))
    a = worst.alarm
    return (
        f"{len(judgement.alarms)} alarm(s); the largest on axis {a.axis} at {a.t_start:.1f} to {a.t_end:.1f} s"
        f"{_block(a.block)}: {a.size_a:+.3g} A. {_like(worst.looks_like)} {judged}"
    )


def _alarms(alarms: tuple[NamedAlarm, ...]) -> Section:
    rows = [
        [one.id, a.axis, f"{a.t_start:.1f} – {a.t_end:.1f}", a.block if a.block >= 0 else "–", a.tool or "–",
         f"{a.size_a:+.3g}", number(abs(a.spreads)), in_words(one.looks_like), one.answered or "–"]
        for one in alarms
        for a in (one.alarm,)
    ]  # fmt: skip
    head = ["alarm", "axis", "time, s", "NC block", "tool", "size, A", "in spreads", "looks like (a first guess)",
            "answer"]  # fmt: skip
    text = [
        "Say what each was: pido monitor answer ALARM --true (or --false) --by NAME --reason TEXT. A false alarm "
        "widens the band; samples of a true one are not learnt from."
    ]
    return Section("Alarms", text, Table(head, rows))


def _plot(judgement: Judgement, axis: str) -> figure:
    part, i = judgement.residuals, AXES.index(axis)
    width = window_samples(part.rate_hz, judgement.band.window_s)
    low, high = corridor(part, axis, judgement.band)
    said = window_mean(part.predicted[:, i], width, part.due)
    recorded = said + window_mean(part.residual[:, i], width, part.due)
    plot = signal_figure(f"Axis {axis}", "time, s", "current, A", 260)
    edges = np.linspace(0, len(part.time), min(MOST_STRETCHES, len(part.time)) + 1).astype(int)
    at = part.time[edges[:-1]]
    lowest, highest = _each(low, edges, np.fmin), _each(high, edges, np.fmax)
    known = np.isfinite(lowest) & np.isfinite(highest)
    # One area per stretch: a single one would be drawn across the pauses, where nothing is judged.
    for run in np.split(np.arange(len(at)), np.flatnonzero(np.diff(known.astype(int))) + 1):
        if known[run[0]]:
            x, bottom, top = at[run], lowest[run], highest[run]
            plot.varea(x, bottom, top, color=COLOURS["band"], alpha=0.35, legend_label="band")
    for label, values, colour, dash in (
        ("expected", said, COLOURS["corrected"], "dashed"),
        ("recorded", recorded, COLOURS["recorded"], "solid"),
    ):
        both = np.column_stack([_each(values, edges, np.fmin), _each(values, edges, np.fmax)]).ravel()
        plot.line(np.repeat(at, 2), both, color=colour, line_dash=dash, line_width=1.3, legend_label=label)
    for one in [a.alarm for a in judgement.alarms if a.alarm.axis == axis][:MOST_BOXES]:
        plot.add_layout(
            BoxAnnotation(left=one.t_start, right=one.t_end, fill_color=COLOURS["mismatch"], fill_alpha=0.25)
        )
    return plot


def _each(values: Float1D, edges: np.ndarray, best: np.ufunc) -> Float1D:
    """Extreme of each step; NaN where nothing is known in it."""
    return best.reduceat(values, edges[:-1])


def _like(mechanism: str) -> str:
    return "It looks like nothing known." if mechanism == "unknown" else f"It looks like {in_words(mechanism)}."


def _block(block: int) -> str:
    return f" in NC block {block}" if block >= 0 else ""
