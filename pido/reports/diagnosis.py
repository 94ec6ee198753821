"""The page of a diagnosis, for somebody who does not know the method.

In:  a Diagnosis and the recordings that it was made on.
Out: a Page: the verdict in one sentence; recorded, simulated and corrected signal at the worst place; where it acts;
     the evidence; what was tried and rejected; what to record next.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from bokeh.models import BoxAnnotation
from bokeh.plotting import figure

from pido.accepted import offers
from pido.core.arrays import Float1D
from pido.core.columns import CURRENT, UNITS
from pido.core.recording import Recording
from pido.diagnosis.comparable import SHORT_S, without_wild
from pido.diagnosis.contract import unit_of_series
from pido.diagnosis.estimate import FORM
from pido.diagnosis.finding import (
    NOT_TOLD_APART,
    ByPart,
    Diagnosis,
    Estimate,
    Finding,
    HeldOut,
    Interval,
    PartSeries,
)
from pido.diagnosis.pair import pair_of
from pido.diagnosis.quantities import columns_meant
from pido.reports.page import COLOURS, Page, Section, Table, extremes, number, signal_figure
from pido.reports.parameters import of, parameter_rows
from pido.reports.places import curves, maps
from pido.reports.shapes import shapes
from pido.reports.words import beside_its_words, in_words, shortened

AROUND_WORST_S = 12.0
"""Width of the stretch shown at the worst place, s: a few moves, so that single transients can be seen."""
NEARLY_MOST = 0.7
"""Of the power of a mismatch in the stretch that has most of it, that the one shown has."""
SHIFTS_SHOWN = 40
"""Times a shift in time, that the stretch lasts in which it is shown."""
FEWEST_SHOWN = 40
"""Samples of a stretch."""
NEARLY_ALL = 0.7
"""Of the NC blocks of the parts: a finding that is in more of them is told to be everywhere."""
ANYTHING = "tool, material, clamping, lubrication, warmth"
WHAT_DIFFERS = {
    "inertia": "first the mass that is clamped on the axis",
    "gravity_load": "first the mass that the axis carries",
    "spindle_inertia": "first what is clamped in the spindle",
}
"""Between parts that have another factor of a coefficient each."""
_ALTERNATIVES = (
    (-NOT_TOLD_APART, NOT_TOLD_APART, "These data would also allow"),
    (NOT_TOLD_APART, math.inf, "Explains most of it too, but clearly less well"),
    (
        -math.inf,
        -NOT_TOLD_APART,
        "Fits these rows better, and is not the finding because it takes more numbers or does less on data that it was "
        "not fitted to",
    ),
)
"""Least and most difference in BIC of an alternative, and what is said of it."""
MOST_PARTS = 20
"""Parts whose own factor of a coefficient is told; all stand in details.json."""
MOST_TIMES = 24
"""Stretches of time of an outside force that are told; all stand in diagnosis.json."""
MOST_FAULTS = 40
"""Faulty stretches of a signal that are marked in its picture."""
MOST_FAULTY_ROWS = 12
"""Faulty stretches shown in a row each: what is seen at once, before the pictures."""


def diagnosis_page(diagnosis: Diagnosis, recordings: Sequence[Recording]) -> Page:
    """The page; signals and maps are drawn for the strongest finding of each axis, a curve for every one."""
    pair = pair_of(diagnosis.model)
    compared = recordings if pair is None else [pair.of(r) for r in recordings]
    by_part = {r.part.part: r for r in without_wild(compared, [])}
    machines = sorted({r.part.machine for r in recordings})
    sections = [_overview(diagnosis)] if diagnosis.findings else []
    drawn: set[str] = set()
    blocks = _count_of_blocks(by_part.values())
    for finding in diagnosis.findings:
        if not finding.modelled:
            figures, own = _faulty(finding, by_part), []
        else:
            figures, own = _figures(finding, diagnosis, by_part, first=finding.axis not in drawn)
            drawn.add(finding.axis)
        section = _finding(finding, diagnosis, blocks, pictured=bool(own))
        sections.append(replace(section, figures=[*figures[:2], *own, *figures[2:]]))
    if not diagnosis.findings:
        sections.append(Section("Recorded and simulated where they differ most", figures=_clean(diagnosis, by_part)))
    next_recordings = _what_to_record(diagnosis)
    if next_recordings:
        sections.append(Section("What to record next", next_recordings))
    acceptable = _to_accept(diagnosis)
    if acceptable:
        sections.append(Section("What can become part of the machine's equation", acceptable))
    if diagnosis.notes:
        sections.append(Section("What these data could not answer", diagnosis.notes))
    if diagnosis.rejected:
        rows = [(r.axis, in_words(r.mechanism), r.mechanism, r.reason) for r in diagnosis.rejected]
        sections.append(
            Section("Tried and rejected", table=Table(("axis", "what", "identifier", "why"), rows), folded=True)
        )
    return Page(
        f"Diagnosis of {', '.join(machines)}: {len(by_part)} part{'s' * (len(by_part) != 1)}",
        verdict(diagnosis),
        sections,
    )


def verdict(diagnosis: Diagnosis) -> str:
    """The result in one or two sentences."""
    clean = ", ".join(a for a in diagnosis.clean_axes if a not in diagnosis.unproved)
    unproved = ""
    if diagnosis.unproved:
        unproved = f" Seen in a few seconds, and not proved by them: something on {', '.join(diagnosis.unproved)}."
    if not diagnosis.findings and diagnosis.unproved:
        agree = f" Simulation and recording agree within the noise on {clean}." * bool(clean)
        return f"Nothing is proved to be left out.{unproved}{agree}{_limits(diagnosis)}"
    if not diagnosis.findings:
        return (
            "Simulation and recording agree within the noise: nothing systematic is left out on "
            f"{clean or 'any axis'}.{_limits(diagnosis)}"
        )
    first = diagnosis.findings[0]
    called = _called(first)
    where = beside_its_words(first.where.summary, called)
    text = f"Axis {first.axis}: {called} ({first.mechanism}){', ' if where else ''}{where}."
    if first.modelled:
        on = " on data that was not used for the fit" if first.fit.unseen else ""
        text += f" With it the error{on} falls from {_rmse(first.fit, ' to ')}{_unit(diagnosis)}."
    others = len(diagnosis.findings) - 1
    if others:
        text += f" {others} further finding{'s' if others > 1 else ''} below."
    if clean:
        text += f" Nothing significant on: {clean}."
    return text + unproved + _limits(diagnosis)


def _called(finding: Finding) -> str:
    """What an operator calls it: as it was found, where that says more than its identifier."""
    if finding.said and finding.kind == "unexplained":
        return f"{finding.said}, which no known mechanism explains"
    return finding.said or in_words(finding.mechanism)


def _limits(diagnosis: Diagnosis) -> str:
    """How far 'nothing' reaches: axes that moved little or were not judged. Empty where all moved enough."""
    seconds = {axis: diagnosis.moving_s[axis] for axis in diagnosis.clean_axes if axis in diagnosis.moving_s}
    short = [f"{axis} moves for {s:.3g} s" for axis, s in seconds.items() if s and s < SHORT_S]
    still = [axis for axis, s in seconds.items() if not s]
    text = ""
    if short:
        text += f" Little motion stands behind this: {', '.join(short)} in all, which shows only strong effects."
    if still:
        text += f" Not seen to move, so friction and inertia are not judged: {', '.join(still)}."
    if diagnosis.not_judged and pair_of(diagnosis.model) is None:
        text += f" Not judged: {', '.join(diagnosis.not_judged)}."
    return text


def _rmse(fit: HeldOut, between: str = " → ") -> str:
    return between.join(number(value, fit.digits) for value in (fit.rmse_before, fit.rmse_after))


def _overview(diagnosis: Diagnosis) -> Section:
    rows = [
        (
            f.axis,
            _called(f),
            f.kind.replace("_", " "),
            f.where.summary,
            _rmse(f.fit) if f.modelled else "–",
            _chance(f.evidence.q_value).removeprefix("= ").replace("-", "\N{NON-BREAKING HYPHEN}")
            if f.modelled
            else "–",
        )
        for f in diagnosis.findings
    ]
    unit = _unit(diagnosis)
    held_out = "held-out " if all(f.fit.unseen for f in diagnosis.findings if f.modelled) else ""
    head = ("axis", "what", "kind", "where", f"{held_out}RMSE{',' if unit else ''}{unit}", "q")
    return Section("Findings, the strongest first", table=Table(head, rows))


def _finding(f: Finding, diagnosis: Diagnosis, blocks: int, pictured: bool) -> Section:
    """blocks : how many NC blocks the parts have; pictured : whether its law is drawn"""
    lines, beside_others = [f"{_called(f)}: {f.equation}"], diagnosis.beside_others(f)
    if f.equation.startswith("dI_"):
        missing = f"dI_{f.axis}: what the simulation lacks,{_unit(diagnosis)}".rstrip(",")
        lines.append(f"In this formula: {'; '.join([missing, *columns_meant(f.equation)])}.")
    lines.append(f"Where: {f.where.summary}")
    if f.of_its_parts_only:
        lines.append(f"When and how large, in s since each part began: {_times(f.where.intervals, f.parameters)}.")
        lines.append(
            "This finding predicts no other part: it is tied to these times and to nothing that was recorded. 'pido "
            "correct' leaves it out on other parts, and says so."
        )
    if f.factor is not None:
        low, high = (number(end, 3) for end in f.factor.ci95)
        lines.append(
            f"The simulation has it with a wrong coefficient: multiply that by {number(f.factor.value, 3)} (95 % "
            f"interval {low} … {high}). The parameter below is what has to be added."
        )
    if f.by_part is not None and f.by_part.differs:
        lines.append(_part_by_part(f.by_part, f.mechanism.removeprefix("miscalibrated:")))
    if f.where.workpiece:
        lines.append(f"On the workpiece: {f.where.workpiece}")
    if f.where.nc_lines and f.mechanism != "external_force":
        lines.append(f"NC blocks: {_blocks(f.where.nc_lines, blocks)}")
    if f.modelled:
        lines.append(
            f"Evidence: p {_chance(f.evidence.p_value)}, corrected for all questions asked q "
            f"{_chance(f.evidence.q_value)}; difference in BIC {number(f.evidence.delta_bic)}."
        )
        on = "On unseen data" if f.fit.unseen else "On all data"
        others = ", without it → with it, beside the axis' other findings" if beside_others else ""
        lines.append(
            f"{on} ({f.fit.scheme}{others}): RMSE {_rmse(f.fit)}, "
            f"R² {f.fit.r2_before:.4f} → {f.fit.r2_after:.4f}, p {_chance(f.fit.p_value)}."
        )
    else:
        lines.append("A contradiction within the recording itself: no fit is needed to see it, and none was made.")
        if meant := columns_meant(f.equation):
            lines.append(f"What these columns are: {'; '.join(meant)}.")
        if len(f.where.faults) > MOST_FAULTY_ROWS:
            lines.append(
                f"The first {MOST_FAULTY_ROWS} of {len(f.where.faults)} stretches, each column for itself; all stand "
                "in details.json."
            )
    if f.replaces:
        lines.append(f"It takes the place of: {', '.join(f.replaces)}. Do not add the same physics twice.")
    for least, most, says in _ALTERNATIVES:
        names = [
            f"{in_words(a.mechanism)} (ΔBIC {number(a.delta_bic)})"
            for a in f.alternatives
            if least <= a.delta_bic < most
        ]
        if names:
            lines.append(f"{says}: {', '.join(names)}.")
    rows = parameter_rows(f.parameters, pictured)
    table = Table(("parameter", "value", "95 % interval"), rows) if rows else None
    if rows and f.fit.unseen:
        lines.append(
            f"No interval of an amplitude is narrower than {100 * FORM:.0f} % of its value to either side: the "
            "textbook form is never quite the machine's."
        )
    if f.where.faults:
        places = [(s.part, s.column, f"{s.t_start:.2f}", f"{s.t_end:.2f}", s.reason) for s in f.where.faults]
        table = Table(("part", "column", "from, s", "to, s", "what is wrong"), places[:MOST_FAULTY_ROWS])
    return Section(f"Axis {f.axis}: {f.mechanism}", lines, table)


def _blocks(lines: Sequence[int], of: int) -> str:
    """The blocks, the first of them where they are many; or that they are nearly all."""
    if NEARLY_ALL * of < len(lines) <= of:
        return f"nearly everywhere, in {len(lines)} of {of}; all stand in details.json"
    return ", ".join(map(str, lines[:20])) + (" …" if len(lines) > 20 else "")


def _count_of_blocks(recordings: Iterable[Recording]) -> int:
    lines = [np.asarray(r["nc_line"], float) for r in recordings if "nc_line" in r]
    return len(np.unique(np.concatenate([v[np.isfinite(v)] for v in lines]))) if lines else 0


def _part_by_part(found: ByPart, mechanism: str) -> str:
    each = [
        f"{shortened(part)} {number(e.value, 3)} ({' … '.join(number(end, 3) for end in e.ci95)})"
        for part, e in list(found.factors.items())[:MOST_PARTS]
    ]
    left = len(found.factors) - len(each)
    return (
        f"This factor differs from part to part (p {_chance(found.p_value)} that it is the same in all): "
        f"{', '.join(each)}{f'; {left} more in details.json' if left else ''}. The one above is their mean and right "
        f"for none of them: look for what differs between the parts ({WHAT_DIFFERS.get(mechanism, ANYTHING)}) before a "
        "coefficient is changed."
    )


def _times(intervals: Sequence[Interval], forces: Mapping[str, Estimate]) -> str:
    """Stretches part by part, the first of them where they are many, each with its force."""
    shown, sizes = intervals[:MOST_TIMES], [""] * MOST_TIMES
    if len(forces) == len(intervals):
        sizes = [f" ({n} = {number(e.value)}{of(e.unit)})" for n, e in forces.items()]
    each = [(i.part, f"{i.t_start:.1f} to {i.t_end:.1f}{size}") for i, size in zip(shown, sizes, strict=False)]
    parts = dict.fromkeys(part for part, _ in each)
    text = "; ".join(f"{shortened(p)} " + ", ".join(said for part, said in each if part == p) for p in parts)
    left = len(intervals) - len(shown)
    return f"{text}; {left} more in diagnosis.json" if left else text


def _chance(p: float) -> str:
    """A probability; those too small to mean anything as a number are bounds.

    >>> _chance(0.0123), _chance(1e-30), _chance(2e-9)
    ('= 0.012', 'below 1e-12', '= 2e-9')
    """
    return "below 1e-12" if p < 1e-12 else f"= {number(p, 2)}".replace("e-0", "e-")


def _in_one_line(text: str) -> str:
    """A number that is not broken at its sign."""
    return text.replace("-", "\N{NON-BREAKING HYPHEN}")


def _unit(diagnosis: Diagnosis) -> str:
    """Of both signals, with a space before it; '' where it is not known."""
    unit = unit_of_series(diagnosis.model)
    return f" {unit}" if unit else ""


def _what_to_record(diagnosis: Diagnosis) -> list[str]:
    named = [f"Axis {f.axis}, {f.mechanism}, to know more: {f.to_record}" for f in diagnosis.findings if f.to_record]
    return named + [
        f"Axis {f.axis}, {f.mechanism} or {a.mechanism}: {a.to_tell_apart}"
        for f in diagnosis.findings
        for a in f.alternatives
        if a.to_tell_apart and a.delta_bic < NOT_TOLD_APART
    ]


def _to_accept(diagnosis: Diagnosis) -> list[str]:
    """What to type, with the folder of this page in place of FOLDER."""
    if pair_of(diagnosis.model) is not None:
        return []
    call = "pido accept-physics FOLDER --finding {name} --by NAME --reason TEXT"
    found = offers([(f.axis, f.mechanism, f.kind) for f in diagnosis.findings], diagnosis.model)
    why_not = {why: ", ".join(n for n, other in found if other == why) for _, why in found if why}
    return [call.format(name=n) for n, why in found if not why] + [f"Not {n}: it {w}" for w, n in why_not.items()]


def _figures(
    finding: Finding, diagnosis: Diagnosis, by_part: dict[str, Recording], *, first: bool
) -> tuple[list[figure], list[figure]]:
    """Those of its axis, where it is the first one there, and those of its own law."""
    axis = finding.axis
    shown = {p: s for p, s in diagnosis.parts.items() if axis in s.corrected and p in by_part}
    if not shown:
        return [], []
    unit = _unit(diagnosis)
    own = curves(finding, diagnosis.model, shown, by_part, unit)
    own += shapes(finding, diagnosis.model, shown, by_part, unit)
    if not first:
        return [], own
    part = max(shown, key=lambda p: float(np.nanmax(np.abs(shown[p].mismatch[axis]), initial=0.0)))
    recording, series = by_part[part], shown[part]
    recorded = recording.columns.get(CURRENT[axis])
    label = _label(diagnosis)
    return [
        _worst_place(part, axis, label, recorded, series, _seconds_shown(finding, part)),
        _over_time(part, axis, label, recorded, series),
        *maps([f for f in diagnosis.findings if f.axis == axis], shown, by_part, unit.strip()),
    ], own


def _faulty(finding: Finding, by_part: dict[str, Recording]) -> list[figure]:
    """Each faulty column where it is wrong first, its faults marked."""
    figures = []
    for column in dict.fromkeys(f.column for f in finding.where.faults):
        faults = [f for f in finding.where.faults if f.column == column and f.part in by_part]
        if not faults:
            continue
        part, start = faults[0].part, faults[0].t_start
        recording = by_part[part]
        window = np.abs(recording.time - start) <= AROUND_WORST_S / 2
        plot = signal_figure(
            f"Axis {finding.axis}, part {shortened(part)}:\n{column}, where it is wrong first", "time, s",
            f"{column},{of(UNITS[column])}".rstrip(","),
        )  # fmt: skip
        x, y = extremes(recording.time[window], np.asarray(recording[column], float)[window])
        plot.line(x, y, color=COLOURS["recorded"], line_width=1.6)
        for fault in [f for f in faults if f.part == part and f.t_start <= x[-1]][:MOST_FAULTS]:
            plot.add_layout(
                BoxAnnotation(left=fault.t_start, right=fault.t_end, fill_color=COLOURS["mismatch"], fill_alpha=0.25)
            )
        figures.append(plot)
    return figures


def _clean(diagnosis: Diagnosis, by_part: dict[str, Recording]) -> list[figure]:
    """Every axis without a finding, in the part with its largest difference."""
    figures = []
    for axis in diagnosis.clean_axes:
        seen = {}
        for part, series in diagnosis.parts.items():
            recorded = by_part[part].columns.get(CURRENT[axis])
            if axis in series.corrected and recorded is not None:
                seen[part] = (float(np.nanstd(recorded - series.corrected[axis])), recorded)
        if seen:
            part = max(seen, key=lambda p: seen[p][0])
            figures.append(_worst_place(part, axis, _label(diagnosis), seen[part][1], diagnosis.parts[part]))
    return figures


def _label(diagnosis: Diagnosis) -> str:
    """Of an axis that shows the signals that were compared."""
    pair = pair_of(diagnosis.model)
    return f"{'current' if pair is None else pair.recorded},{_unit(diagnosis)}".rstrip(",")


def _seconds_shown(finding: Finding, part: str) -> float:
    """How much of the worst place is shown: of a shift in time so little that it can be seen."""
    shift = next((s for n in (f"step_{part}", f"shift_{part}", "shift") if (s := finding.parameters.get(n))), None)
    if finding.mechanism != "time_misalignment" or shift is None:
        return AROUND_WORST_S
    return min(AROUND_WORST_S, SHIFTS_SHOWN * abs(shift.value))


def _worst_place(
    part: str,
    axis: str,
    label: str,
    recorded: Float1D | None,
    series: PartSeries,
    seconds: float = AROUND_WORST_S,
) -> figure:
    time = series.time
    # The stretch, not the sample, with the largest mismatch: a single spike is not what the reader has to see.
    simulated = series.corrected[axis] - series.mismatch[axis]
    power = np.nan_to_num(series.mismatch[axis]) ** 2
    if recorded is not None and not power.any():
        power = np.nan_to_num(recorded - simulated) ** 2
    step = max(float(np.median(np.diff(time))), 1e-6)
    width = max(1, min(len(time), max(FEWEST_SHOWN, int(seconds / step))))
    start = _shows_most(power, np.nan_to_num(simulated), width)
    window = slice(start, start + width)
    plot = signal_figure(f"Axis {axis}, part {shortened(part)}:\nwhere it differs most", "time, s", label)
    lines = [("simulated", simulated, "dashed"), ("corrected", series.corrected[axis], "solid")]
    if not series.mismatch[axis].any():
        lines.pop()  # nothing was corrected
    if recorded is not None:
        lines.insert(0, ("recorded", recorded, "solid"))
    for name, values, dash in lines:
        x, y = extremes(time[window], np.asarray(values, float)[window])
        plot.line(x, y, color=COLOURS[name], legend_label=name, line_dash=dash, line_width=1.6)
    plot.legend.click_policy = "hide"
    return plot


def _shows_most(power: Float1D, simulated: Float1D, width: int) -> int:
    """Where the stretch of `width` rows begins in which a mismatch is seen best: of those with nearly the most of its
    `power`, the one in which the current itself changes least, beside which it would be lost."""
    total, first, second = (np.cumsum(np.r_[0.0, v]) for v in (power, simulated, simulated**2))
    within, mean, square = ((v[width:] - v[:-width]) / width for v in (total, first, second))
    change = np.where(within >= NEARLY_MOST * within.max(), square - mean**2, np.inf)
    return int(np.argmin(change))


def _over_time(part: str, axis: str, label: str, recorded: Float1D | None, series: PartSeries) -> figure:
    plot = signal_figure(f"Axis {axis}, part {shortened(part)}:\ndifference", "time, s", label, 220)
    if recorded is not None:
        x, y = extremes(series.time, recorded - (series.corrected[axis] - series.mismatch[axis]))
        plot.line(x, y, color="#999999", legend_label="recorded − simulated")
    x, y = extremes(series.time, series.mismatch[axis])
    plot.line(x, y, color=COLOURS["mismatch"], legend_label="systematic part", line_width=1.6)
    for start, end in _runs(series.score[axis] > 0.5, series.time)[:200]:
        plot.add_layout(BoxAnnotation(left=start, right=end, fill_color=COLOURS["band"], fill_alpha=0.25))
    plot.legend.click_policy = "hide"
    return plot


def _runs(mask: np.ndarray, time: np.ndarray) -> list[tuple[float, float]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return [(float(time[a]), float(time[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
