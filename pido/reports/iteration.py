"""The page of an iteration: did the models get better, where were data missing, what was generated, may it be promoted.

In:  the files of a run, and the summaries of the machine's earlier runs for the course over parts.
Out: `Page`. All errors are of models that had not seen the part.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from bokeh.models import ColorBar, ColumnDataSource, FactorRange, FixedTicker, LinearColorMapper
from bokeh.palettes import Cividis256
from bokeh.plotting import figure
from bokeh.transform import factor_cmap, transform

from pido.core.axes import AXES
from pido.reports.page import COLOURS, Page, Section, Table, number, signal_figure, thin, with_pauses
from pido.tracking.report_files import RunFiles

TRAINED = ("real", "pia", "pie", "both")
LABEL = {
    "real": "real only",
    "pia": "with PiA",
    "pie": "with PiE",
    "both": "PiA + PiE",
    "rival": "trivial rival",
}
COLOUR = {"rival": "#999999", "real": "#56B4E9", "pia": "#009E73", "pie": "#CC79A7", "both": "#D55E00"}
MOST_GENERATED = 3000
MOST_NAMED = 8
"""Parts whose name stands under a plot."""

_Measured = dict[str, dict[str, float | None]]


def iteration_page(
    files: RunFiles, version: int | None = None, history: Sequence[dict[str, Any]] = (), fate: str = ""
) -> Page:
    """The page; `history`: summaries of the machine's iterations, oldest first, this one among them or not; `fate`:
    what became of the version since (`pido.tracking.fate`)."""
    summary = files.summary
    measured: dict[str, _Measured] = summary["metrics"]
    name = f"Version {version}" if version is not None else "New models"
    sections = [
        _better(measured),
        *([_course(history)] if len(_parts(history)) > 1 else []),
        *([_arriving(files.trace)] if len(files.trace) else []),
        _balance(files),
        *([_generated(files)] if len(files.generated) else []),
        _gate(summary),
        _errors(measured),
        _details(summary),
    ]
    title = f"{name} of {summary['machine']}, after part {summary['part']['name']} ({len(summary['parts'])} part(s))"
    return Page(title, verdict(summary, fate), [s for s in sections if s is not None])


def verdict(summary: dict[str, Any], fate: str = "") -> str:
    """How wrong the models were on a new part, whether generated rows helped, and whether they may go into force."""
    measured: dict[str, _Measured] = summary["metrics"]
    if not measured:
        said = "First part of this machine: nothing was known before it, so nothing can be compared yet."
    else:
        axes = [a for a in AXES if a in measured]
        errors = ", ".join(f"{axis} {number(_rmse(measured[axis], 'both'))} A" for axis in axes)
        said = f"Error (RMSE) of the predicted currents on this part, which the models had not seen: {errors}."
        changes = {a: _rmse(measured[a], "both") / _rmse(measured[a], "real") - 1 for a in axes}
        helped = [f"{axis} ({change:+.0%})" for axis, change in changes.items() if change <= -0.01]
        harmed = [f"{axis} ({change:+.0%})" for axis, change in changes.items() if change >= 0.01]
        if helped or harmed:
            said += " Against recorded rows alone, generated rows made it " + " and ".join(
                f"{word} on {', '.join(those)}" for word, those in (("smaller", helped), ("larger", harmed)) if those
            ) + "."  # fmt: skip
        elif np.isfinite(list(changes.values())).any():
            said += " Generated rows changed it by less than 1 %."
    gate = summary["gate"]
    return (
        f"{said} The gate {'is passed' if gate.get('passed') else 'is not passed'}: "
        + (fate or f"this version {'may be approved' if gate.get('passed') else 'is not offered for approval'}.")
        + "".join(f" Warning: a trivial rival has the lower error on {w}." for w in gate.get("warnings", ()))
        + "".join(f" Warning: {w}." for w in (*gate.get("alarms", ()), *gate.get("doubts", ())))
    )


def best_rival(measured: _Measured) -> tuple[str, float]:
    """The trivial rival with the smallest error: ('', NaN) where none was compared."""
    rivals = {n: _rmse(measured, n) for n in measured if n not in TRAINED}
    rivals = {n: v for n, v in rivals.items() if np.isfinite(v)}
    name = min(rivals, key=lambda n: rivals[n], default="")
    return name, rivals.get(name, float("nan"))


def _better(measured: dict[str, _Measured]) -> Section:
    if not measured:
        return Section("Did it get better?", ["The next part answers: the models of now say what they expect of it."])
    shown = ("rival", *TRAINED)
    factors, heights, kinds = [], [], []
    rows = []
    for axis in (a for a in AXES if a in measured):
        name, rival = best_rival(measured[axis])
        values = {"rival": rival, **{k: _rmse(measured[axis], k) for k in TRAINED}}
        base = values["real"] if np.isfinite(values["real"]) else values["both"]
        for kind in shown:
            if np.isfinite(values[kind]) and base > 0:
                factors.append((axis, LABEL[kind]))
                heights.append(100 * values[kind] / base)
                kinds.append(LABEL[kind])
        r2 = measured[axis].get("both", {}).get("r2") if isinstance(measured[axis].get("both"), dict) else None
        rows.append([
            axis, f"{number(rival)} ({name})" if name else "–", *(number(values[k]) for k in TRAINED),
            _change(values["both"], values["real"]), "–" if r2 is None else f"{r2:.3f}",
        ])  # fmt: skip
    plot = figure(
        x_range=FactorRange(*factors, group_padding=0.8), height=320, sizing_mode="stretch_width",
        title="Error; real only = 100 %", y_axis_label="RMSE, % of real only",
        tools="save,hover", toolbar_location="above",
    )  # fmt: skip
    plot.toolbar.logo = None
    source = ColumnDataSource({"x": factors, "top": heights, "kind": kinds})
    fill = factor_cmap("kind", [COLOUR[k] for k in shown], [LABEL[k] for k in shown])
    plot.vbar("x", top="top", width=0.85, source=source, fill_color=fill, line_color="white", legend_group="kind")
    plot.hover.tooltips = [("axis, model", "@x"), ("error", "@top{0.0} %")]  # pyright: ignore[reportAttributeAccessIssue]
    plot.xaxis.major_label_text_font_size = "0px"
    plot.xaxis.major_tick_line_color = None
    own = [height for height, kind in zip(heights, kinds, strict=True) if kind != LABEL["rival"]]
    plot.y_range.update(start=0, end=1.6 * max([*own, 100.0]))
    head = ["axis", "best trivial rival, A", *(f"{LABEL[k]}, A" for k in TRAINED), "PiDO against real only", "R²"]
    text = [
        "RMSE per axis. Every model had seen the earlier parts only, and none this one. PiA adds rows between recorded "
        "ones, PiE rows of the coming part's path whose currents the physical equation has a say in, both only where "
        "they had helped on rows held out. The trivial rival is the best of a constant, a friction line and a nearest "
        "neighbour. A grey bar that reaches the top of the plot goes on: its number stands in the table."
    ]
    return Section("Did it get better?", text, Table(head, rows), [plot])


def _course(history: Sequence[dict[str, Any]]) -> Section:
    """Error on each arriving part, in the order in which they came."""
    summaries = _parts(history)
    names = [s["part"]["name"] for s in summaries]
    figures = []
    for axis in AXES:
        if not any(axis in s["metrics"] for s in summaries):
            continue
        plot = signal_figure(f"Axis {axis}", "part, in the order of arrival", "RMSE, A", 240)
        x = np.arange(1, len(summaries) + 1)
        named = x[:: max(1, len(x) // MOST_NAMED)].tolist()
        plot.xaxis.ticker = FixedTicker(ticks=named)
        plot.xaxis.major_label_overrides = {at: names[at - 1] for at in named}
        for kind, dash in (("rival", "dotted"), ("real", "dashed"), ("both", "solid")):
            y = [
                best_rival(s["metrics"].get(axis, {}))[1]
                if kind == "rival"
                else _rmse(s["metrics"].get(axis, {}), kind)
                for s in summaries
            ]
            source = ColumnDataSource({"x": x, "y": y, "part": names})
            colour = COLOUR[kind] if kind != "real" else COLOURS["corrected"]
            plot.line("x", "y", source=source, color=colour, line_width=2, line_dash=dash, legend_label=LABEL[kind])
            plot.scatter("x", "y", source=source, color=colour, size=6, legend_label=LABEL[kind])
        plot.hover.tooltips = [("part", "@part"), ("RMSE", "@y A")]  # pyright: ignore[reportAttributeAccessIssue]
        figures.append(plot)
    return Section(
        "Over the parts", ["Error on each part as it came, by models of the parts before it."], figures=figures
    )


def _parts(history: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The newest summary of each part that was compared with something, in the order in which they first came."""
    return list({s["part"]["digest"]: s for s in history if s["metrics"]}.values())


def _arriving(trace: pd.DataFrame) -> Section:
    figures = []
    time = trace["time"].to_numpy(float)
    for axis in AXES:
        recorded = trace.get(f"measured_{axis}")
        if recorded is None or not np.isfinite(recorded.to_numpy(float)).any():
            continue
        plot = signal_figure(f"Axis {axis}", "time, s", "current, A", 240)
        lines = [("recorded", recorded, COLOURS["recorded"], "solid")]
        for kind, dash in (("real", "dashed"), ("both", "solid")):
            if f"{kind}_{axis}" in trace:
                lines.append((LABEL[kind], trace[f"{kind}_{axis}"], COLOUR[kind], dash))
        for label, values, colour, dash in lines:
            x, y = with_pauses(time, values.to_numpy(float), 1500)
            plot.line(x, y, color=colour, line_dash=dash, legend_label=label, line_width=1.2)
        figures.append(plot)
    text = ["Recorded current and what the models expected before the part was made. Drag to zoom."]
    return Section("The new part", text, figures=figures)


def _balance(files: RunFiles) -> Section:
    balance = files.summary["balance"]
    before, after, v_x, v_y = (files.bins[c].to_numpy(float) for c in ("before", "after", "v_x", "v_y"))
    text = [
        f"{balance['relevant_bins']} bins of (v_x, v_y, AR) matter for the path that is coming. Samples per bin differ "
        f"by {number(balance['before'])} (standard deviation) among recorded samples, and by "
        f"{number(balance['after'])} with the generated ones; {int((before == 0).sum())} had no recorded sample."
    ]
    if not len(before):
        return Section("Data balance", text)
    cells, cell = np.unique(np.column_stack([v_x, v_y]), axis=0, return_inverse=True)
    sums = {name: np.bincount(cell.ravel(), values) for name, values in (("before", before), ("after", after))}
    high = max(float(np.quantile(sums["after"], 0.95)), 1.0)
    mapper = LinearColorMapper(palette=list(reversed(Cividis256)), low=0, high=high)
    steps = [np.diff(np.unique(cells[:, k])) for k in range(2)]
    width, height = (float(step.min()) if len(step) else 1.0 for step in steps)
    plots = []
    for column, title in (("before", "Recorded samples per bin, over all AR"), ("after", "With the generated ones")):
        plot = signal_figure(title, "v_x, mm/s", "v_y, mm/s", 340)
        source = ColumnDataSource({"x": cells[:, 0], "y": cells[:, 1], "n": sums[column]})
        plot.rect("x", "y", width, height, source=source, fill_color=transform("n", mapper), line_color="white")
        plot.add_layout(ColorBar(color_mapper=mapper, title="samples"), "right")
        plot.hover.tooltips = [("v_x, v_y", "@x, @y mm/s"), ("samples", "@n")]  # pyright: ignore[reportAttributeAccessIssue]
        plots.append(plot)
    return Section("Data balance", text, figures=plots)


def _generated(files: RunFiles) -> Section:
    data = files.summary["data"]
    origin = files.generated["origin"].to_numpy(str)
    v_x, v_y = (files.generated[c].to_numpy(float) for c in ("v_x", "v_y"))
    text = [
        f"{data['pia']['rows']} PiA and {data['pie']['rows']} PiE rows beside {data['real']['rows']} recorded ones."
    ]
    plot = signal_figure("Where PiDO generated", "v_x, mm/s", "v_y, mm/s", 380)
    for kind, marker in (("pia", "circle"), ("pie", "triangle")):
        mine = np.flatnonzero(origin == kind)
        mine = mine[thin(len(mine), MOST_GENERATED)]
        if len(mine):
            plot.scatter(
                v_x[mine], v_y[mine], marker=marker, size=5, alpha=0.5, color=COLOUR[kind],
                legend_label={"pia": "PiA: beside recorded rows", "pie": "PiE: rows from the equation"}[kind],
            )  # fmt: skip
    refused = str(files.summary["balance"].get("report", "")).splitlines()
    return Section("Where PiDO generated", [*text, *refused], figures=[plot])


def _gate(summary: dict[str, Any]) -> Section:
    gate = summary["gate"]
    rows = [[axis, f"{change:+.1%}"] for axis, change in gate.get("change", {}).items()]
    table = Table(["axis", "change of the error on the last parts"], rows) if rows else None
    return Section("The gate", [gate.get("words", "")], table)


def _errors(measured: dict[str, _Measured]) -> Section | None:
    rows = [
        [axis, LABEL.get(name, name), *(number(_value(m, key)) for key in ("rmse", "mae", "error_99", "peak", "r2"))]
        for axis in AXES
        for name, m in measured.get(axis, {}).items()
    ]
    head = ["axis", "model", "RMSE, A", "mean error, A", "99 % below, A", "RMSE at the highest load, A", "R²"]
    return Section("All errors", table=Table(head, rows), folded=True) if rows else None


def _details(summary: dict[str, Any]) -> Section:
    rows = [["bundle", summary["bundle"]], ["code", summary["code"]], ["seed", summary["seed"]]]
    rows += [[f"digest of {name} rows", d["digest"]] for name, d in summary["data"].items()]
    rows += [[f"equation, axis {axis}", words] for axis, words in summary["settings"].get("equations", {}).items()]
    rows += [[f"time for {name}", f"{number(s)} s"] for name, s in summary["seconds"].items()]
    return Section("How it was made", table=Table(["what", "value"], rows), folded=True)


def _rmse(measured: _Measured, name: str) -> float:
    return _value(measured.get(name) or {}, "rmse")


def _value(measures: dict[str, float | None], key: str) -> float:
    value = measures.get(key)
    return float("nan") if value is None else float(value)


def _change(new: float, old: float) -> str:
    """Change of an error; negative is better."""
    return f"{new / old - 1:+.0%}" if np.isfinite(new) and np.isfinite(old) and old > 0 else "–"
