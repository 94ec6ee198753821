"""The page of an experiment: verdict, the published table beside ours, what differs and why, all other tables.

In:  a verdict, tables, what differs, facts. Out: a `Page`.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from pido.reports.page import COLOURS, Page, Section, Table, number, signal_figure


def experiment_page(
    title: str,
    source: str,
    verdict: str,
    tables: Sequence[tuple[str, pd.DataFrame, Sequence[str]]],
    differs: Sequence[str],
    facts: Sequence[str],
) -> Page:
    """tables : (title, table, words), the published one first; it is open, the others are folded if long."""
    sections = []
    for k, (name, table, text) in enumerate(tables):
        plots = [_steps(name, table)] if {"scenario", "step"} <= set(table.columns) else []
        sections.append(
            Section(name, text, as_table(table), [p for p in plots if p is not None], k > 0 and len(table) > 12)
        )
        if k == 0 and differs:
            sections.append(Section("What differs from the paper, and why", differs))
    sections.append(Section("How it was run", facts, folded=True))
    return Page(f"{title} ({source})", verdict, sections)


def as_table(table: pd.DataFrame) -> Table:
    """Numbers as a person writes them."""
    rows = [[_cell(value) for value in row] for row in table.itertuples(index=False, name=None)]
    return Table([str(c) for c in table.columns], rows)


def _cell(value: Any) -> str:
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (int, np.integer)):
        return str(value)
    if isinstance(value, (float, np.floating)):
        return number(float(value), 4)
    return "–" if value is None else str(value)


def _steps(title: str, table: pd.DataFrame) -> Any | None:
    """Lines over the steps of scenario 1, where the table has numbers per step."""
    names = [c for c in table.columns if c not in ("scenario", "step", "space", "axis")]
    if "axis" in table.columns and len(set(table["axis"])) > 1:
        return None
    rows = [row for row in table.to_dict("records") if row["scenario"] == table["scenario"].tolist()[0]]
    rows = [row for row in rows if row.get("space") == rows[0].get("space")]
    if len(rows) < 2:
        return None
    plot = signal_figure(f"{title}: {rows[0]['scenario']}", "percent of the file, or files", "as in the table")
    steps = [float(row["step"]) for row in rows]
    for (colour, dash), name in zip(_strokes(len(names)), names, strict=True):
        values = np.asarray(pd.to_numeric([str(row[name]).rstrip("*") for row in rows], errors="coerce"), float)
        plot.line(steps, values, color=colour, line_dash=dash, legend_label=name, line_width=2)
    return plot


def _strokes(n: int) -> list[tuple[str, str]]:
    """Colour and dash of n lines, all different: the colours solid, then again dashed, dotted, in dots and dashes."""
    dashes = ("solid", "dashed", "dotted", "dotdash")
    return list(itertools.islice(((c, d) for d in dashes for c in COLOURS.values()), n))
