"""The figures of an iteration: how even the data are before and after, what was gained, and the arriving part itself.

In:  the files of a run. Out: matplotlib figures by file name; nothing is shown on a screen.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pido.core.axes import AXES
from pido.tracking.report_files import RunFiles

_VARIANTS = (
    ("constant", "0.75"), ("friction line", "0.6"), ("nearest commands", "0.45"),
    ("real", "tab:blue"), ("pia", "tab:cyan"), ("pie", "tab:green"), ("both", "tab:orange"),
)  # fmt: skip
_WORDS = {"real": "recorded rows", "pia": "with PiA", "pie": "with PiE", "both": "with PiA and PiE"}


def figures(files: RunFiles) -> dict[str, Figure]:
    """File name -> figure. An axis or table without data leaves its figure out."""
    made = {"balance.png": _balance(files.bins), "errors.png": _errors(files.summary["metrics"])}
    if len(files.trace):
        made["part.png"] = _trace(files.trace)
    return made


def _balance(bins: pd.DataFrame) -> Figure:
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    ceiling = max(float(bins[["before", "after"]].to_numpy(float).max(initial=1.0)), 1.0)
    for place, (column, title) in enumerate((("before", "recorded"), ("after", "with PiA and PiE")), start=1):
        ax = figure.add_subplot(1, 2, place)
        total = bins.pivot_table(values=column, index=["v_x", "v_y"], aggfunc="sum").reset_index()
        shown = ax.scatter(total["v_x"], total["v_y"], c=total[column], s=16, marker="s", vmin=0, vmax=ceiling)
        spread = float(np.std(bins[column])) if len(bins) else 0.0
        ax.set(title=f"{title}: std {spread:.1f} samples per bin", xlabel="v_x in mm/s", ylabel="v_y in mm/s")
    figure.colorbar(shown, ax=figure.axes, label="samples per relevant bin")
    return figure


def _errors(metrics: dict[str, dict[str, dict[str, float]]]) -> Figure:
    axes = [a for a in AXES if metrics.get(a)]
    figure = Figure(figsize=(max(3.0 * len(axes), 4.0), 3.2), layout="constrained")
    names = [name for name, _ in _VARIANTS if any(name in metrics[axis] for axis in axes)]
    for place, axis in enumerate(axes, start=1):
        ax = figure.add_subplot(1, len(axes), place)
        shown = [(names.index(name), name, colour) for name, colour in _VARIANTS if name in metrics[axis]]
        values = [metrics[axis][name]["rmse"] for _, name, _ in shown]
        bars = ax.barh([at for at, _, _ in shown], values, color=[colour for _, _, colour in shown])
        ax.bar_label(bars, fmt="%.3g", fontsize="small", padding=2)
        ax.margins(x=0.2)
        ax.set(title=axis, ylim=(len(names) - 0.4, -0.6))
        ax.set_yticks(
            range(len(names)), [_WORDS.get(name, name) for name in names] if place == 1 else [""] * len(names)
        )
    figure.supxlabel("RMSE on the arriving part in A", fontsize="medium")
    return figure


def _trace(trace: pd.DataFrame) -> Figure:
    axes = [a for a in AXES if np.isfinite(trace[f"measured_{a}"].to_numpy(float)).any()]
    figure = Figure(figsize=(10, 2.0 * max(len(axes), 1)), layout="constrained")
    for place, axis in enumerate(axes, start=1):
        ax = figure.add_subplot(len(axes), 1, place)
        ax.plot(trace["time"], trace[f"measured_{axis}"], color="0.3", lw=0.7, label="measured")
        if f"both_{axis}" in trace:
            ax.plot(trace["time"], trace[f"both_{axis}"], color="tab:orange", lw=0.7, label="predicted (PiA + PiE)")
        ax.set(ylabel=f"I_{axis} in A", xlabel="time in s" if place == len(axes) else "")
        if place == 1:
            ax.legend(loc="upper right", fontsize="small")
    return figure


def markdown(metrics: dict[str, dict[str, dict[str, float]]]) -> list[str]:
    """Lines of a Markdown table, one row per axis: RMSE by what the models were trained on, beside the trivial rivals,
    and R² of what was delivered; one that is not defined (of a constant current) is a dash. Nothing without metrics."""
    names = [name for name, _ in _VARIANTS if any(name in of for of in metrics.values())]
    if not names:
        return []
    lines = [
        "| RMSE in A | " + " | ".join(_WORDS.get(name, name) for name in names) + " | R² |",
        "|---" * (len(names) + 2) + "|",
    ]
    for axis in (axis for axis in AXES if axis in metrics):
        errors = [f"{of['rmse']:.3g}" if (of := metrics[axis].get(name)) else "–" for name in names]
        r2 = metrics[axis].get("both", {}).get("r2")
        lines.append(f"| {axis} | " + " | ".join(errors) + f" | {'–' if r2 is None else f'{r2:.3f}'} |")
    return lines


def table(metrics: dict[str, dict[str, dict[str, float]]]) -> list[dict[str, Any]]:
    """One row per axis and variant with its measures, in the order in which they are read."""
    return [
        {"axis": axis, "trained on": name, **metrics[axis][name]}
        for axis in AXES
        for name, _ in _VARIANTS
        if name in metrics.get(axis, {})
    ]
