"""The page of a plan: which bins the coming part needs, what is known there, and what PiDO would generate.

In:  `sampling.optimise.Report`, the grid, the summary of the simulated part.
Out: `Page`, and the same numbers as rows of a table.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from bokeh.models import ColorBar, ColumnDataSource, LinearColorMapper
from bokeh.palettes import Cividis256
from bokeh.plotting import figure
from bokeh.transform import transform

from pido.feature_space.grid import Grid
from pido.reports.page import Page, Section, Table, number, signal_figure
from pido.reports.words import of_a_run
from pido.sampling.optimise import Report

ELSEWHERE = "would_generate_in_other_bins"
"""Key of a plan: generated rows in no bin of the part."""


def plan_rows(report: Report, grid: Grid, visits: np.ndarray) -> list[dict[str, float]]:
    """One row per relevant bin, the most visited first.

    visits : (b,) – samples of the coming part in each bin of the report
    """
    centres = grid.centres(report.bins)
    order = np.lexsort((report.bins, -visits))
    return [
        {
            "v_x": float(centres[b, 0]),
            "v_y": float(centres[b, 1]),
            "ar": float(centres[b, 2]),
            "coming": int(visits[b]),
            "real": int(report.real[b]),
            "pia": int(report.pia[b]),
            "pie": int(report.pie[b]),
        }
        for b in order
    ]


def is_rows(rows: Any) -> bool:
    """Whether these are rows as `plan_rows` makes them, as of a file that somebody names."""
    names = ("v_x", "v_y", "ar", "coming", "real", "pia", "pie")
    return isinstance(rows, list) and all(
        isinstance(row, dict) and all(isinstance(row.get(name), int | float) for name in names) for row in rows
    )


def plan_figures(rows: list[dict[str, float]], elsewhere: int = 0) -> dict[str, Any]:
    """What a person asks first: how many bins, how many are empty, how much of the part runs in known bins.

    elsewhere : generated rows in no bin of the part
    """
    coming = sum(row["coming"] for row in rows)
    known = sum(row["coming"] for row in rows if row["real"] > 0)
    return {
        "relevant_bins": len(rows),
        "bins_without_real_samples": sum(row["real"] == 0 for row in rows),
        "share_of_the_part_in_known_bins": known / coming if coming else 0.0,
        "real_samples_in_them": sum(row["real"] for row in rows),
        "pia_would_generate": sum(row["pia"] for row in rows),
        "pie_would_generate": sum(row["pie"] for row in rows),
        ELSEWHERE: elsewhere,
    }


def plan_page(
    part: str, rows: list[dict[str, float]], refused: str, summary: Mapping[str, Any], elsewhere: int = 0
) -> Page:
    """The plan of one part; `elsewhere` as in `plan_figures`."""
    figures = plan_figures(rows, elsewhere)
    verdict = (
        f"{figures['share_of_the_part_in_known_bins']:.0%} of this part runs at speeds and removals of which "
        f"recordings exist. Of its {figures['relevant_bins']} bins of speed and removal "
        f"{figures['bins_without_real_samples']} hold no recorded sample; PiDO would generate "
        f"{figures['pia_would_generate'] + figures['pie_would_generate']} rows in them"
        f"{f', and {elsewhere} between recorded rows in other bins' if elsewhere else ''}."
    )
    plots = [
        _map("Recorded samples per bin, over all AR", rows, "real"),
        _map("Rows that PiDO would generate", rows, "generated"),
    ]
    table = Table(
        ["v_x, mm/s", "v_y, mm/s", "AR, mm²", "coming", "real", "PiA", "PiE"],
        [
            [number(r["v_x"]), number(r["v_y"]), number(r["ar"]), r["coming"], r["real"], r["pia"], r["pie"]]
            for r in rows
        ],
    )
    about = Table(["as simulated", "value"], [[of_a_run(k), _shown(v)] for k, v in summary.items()])
    return Page(
        title=f"Plan of part {part}",
        verdict=verdict,
        sections=[
            Section(
                "What is known, and what would be added",
                ["A bin is a range of v_x, v_y and engaged area AR. The darker, the more; hover for the numbers."],
                figures=plots,
            ),
            Section("The coming part", table=about),
            *([Section("What the gate refused", text=refused.splitlines(), folded=True)] if refused else []),
            Section("Every bin", table=table, folded=True),
        ],
    )


def _map(title: str, rows: list[dict[str, float]], what: str) -> figure:
    """Bins in the plane of v_x and v_y, coloured by how many samples; AR summed over."""
    sums: dict[tuple[float, float], float] = {}
    for row in rows:
        key = (row["v_x"], row["v_y"])
        value = row["pia"] + row["pie"] if what == "generated" else row[what]
        sums[key] = sums.get(key, 0.0) + value
    plot = signal_figure(title, "v_x, mm/s", "v_y, mm/s", 360)
    places = np.array(list(sums) or [(0.0, 0.0)])
    steps = np.diff(np.unique(places.ravel()))
    width = float(steps.min()) if len(steps) else 1.0
    source = ColumnDataSource({"x": places[:, 0], "y": places[:, 1], "n": np.array(list(sums.values()) or [0.0])})
    highest = max(float(np.max(source.data["n"])), 1.0)
    mapper = LinearColorMapper(palette=list(reversed(Cividis256)), low=0, high=highest)
    plot.rect("x", "y", width, width, source=source, line_color="white", fill_color=transform("n", mapper))
    plot.add_layout(ColorBar(color_mapper=mapper, title="samples"), "right")
    plot.hover.tooltips = [("v_x, v_y", "@x, @y mm/s"), ("samples", "@n")]
    return plot


def _shown(value: Any) -> str:
    return number(value, 4) if isinstance(value, float) else str(value)
