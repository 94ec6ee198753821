"""One self-contained HTML page: a verdict first, then sections with plots that zoom, details folded.

In:  sections of text, tables and Bokeh figures.
Out: HTML that opens offline, prints on A4 and fits a phone. Text is escaped by the template; only Bokeh's own markup
     goes in as it is. Size: BokehJS is 1.3 MB, so that a page with decimated signals stays under 3 MB.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.embed import components
from bokeh.models import Legend, PlainText, Title
from bokeh.plotting import figure
from bokeh.resources import Resources
from jinja2 import Environment, PackageLoader
from markupsafe import Markup

from pido import __version__
from pido.core.arrays import Float1D
from pido.core.files import write_atomically

# Okabe & Ito (2008): told apart by colour-blind readers and in grey.
COLOURS = {
    "recorded": "#000000",
    "simulated": "#E69F00",
    "corrected": "#0072B2",
    "mismatch": "#D55E00",
    "fourth": "#009E73",
    "fifth": "#CC79A7",
    "band": "#56B4E9",
}
MOST_POINTS = 4000
"""Per line and plot: more than a screen can show, few enough for the page to stay small."""


@dataclass(frozen=True)
class Table:
    head: Sequence[str]
    rows: Sequence[Sequence[Any]]


@dataclass(frozen=True)
class Section:
    """A heading with paragraphs, a table and figures; `folded` hides it behind its heading."""

    title: str
    text: Sequence[str] = ()
    table: Table | None = None
    figures: Sequence[Any] = ()
    folded: bool = False


@dataclass(frozen=True)
class Page:
    title: str
    verdict: str
    sections: Sequence[Section] = field(default=())


def render(page: Page) -> str:
    """The page as HTML. Legends move above their plots, where they hide no line; a click on an entry hides its line."""
    plots = [plot for section in page.sections for plot in section.figures]
    for plot in plots:
        _legend_above(plot)
    script, divs = components(plots) if plots else ("", ())
    queue = iter(divs)
    embedded = [[Markup(next(queue)) for _ in section.figures] for section in page.sections]
    bokeh = Resources(mode="inline", components=["bokeh"])
    return (
        _environment()
        .get_template("page.html")
        .render(
            page=page,
            sections=list(zip(page.sections, embedded, strict=True)),
            library=Markup(bokeh.render_js()) if plots else "",
            script=Markup(script),
            version=__version__,
        )
    )


def write_page(page: Page, path: Path) -> None:
    """The page as one file, replaced whole."""
    write_atomically(path, render(page))


def signal_figure(title: str, x_label: str, y_label: str, height: int = 280) -> figure:
    """An empty plot that zooms and pans, as wide as the page, with units on its axes. Its words stay as they are: `$$`
    in a name is no formula."""
    plot = figure(
        title=Title(text=PlainText(text=title)),
        x_axis_label=PlainText(text=x_label),
        y_axis_label=PlainText(text=y_label),
        height=height,
        sizing_mode="stretch_width",
        tools="xpan,xwheel_zoom,box_zoom,reset,save,hover",
        output_backend="canvas",
    )
    plot.toolbar.logo = None
    for axis in plot.axis:
        axis.update(axis_label_text_font_size="13px", major_label_text_font_size="12px")
    return plot


def thin(n: int, most: int = MOST_POINTS) -> slice:
    """Every k-th of n points, so that at most `most` remain."""
    return slice(None, None, max(1, -(-n // most)))


def extremes(x: Float1D, y: Float1D, most: int = MOST_POINTS) -> tuple[Float1D, Float1D]:
    """x, y (n,) thinned to at most `most` points that keep each stretch's lowest and highest value."""
    n = len(x)
    if n <= most:
        return x, y
    edges = np.linspace(0, n, most // 2 + 1).astype(int)
    filled = np.where(np.isfinite(y), y, 0.0)
    low = [a + int(np.argmin(filled[a:b])) for a, b in itertools.pairwise(edges)]
    high = [a + int(np.argmax(filled[a:b])) for a, b in itertools.pairwise(edges)]
    keep = np.unique([*low, *high])
    return x[keep], y[keep]


def with_pauses(x: Float1D, y: Float1D, most: int = MOST_POINTS) -> tuple[Float1D, Float1D]:
    """`extremes`, broken where x jumps: a line across a pause would show what nobody recorded.

    >>> with_pauses(np.array([0.0, 1.0, 2.0, 50.0, 51.0]), np.arange(5.0))[1].tolist()
    [0.0, 1.0, 2.0, nan, 3.0, 4.0]
    """
    step = np.diff(x)
    before = np.flatnonzero(step > 10 * np.median(step)) if len(step) else np.empty(0, int)
    middle = (x[before] + x[before + 1]) / 2
    x, y = extremes(x, y, most)
    place = np.searchsorted(x, middle)
    return np.insert(x, place, middle), np.insert(y, place, np.nan)


def number(value: float, digits: int = 3) -> str:
    """A number as a person writes it; a dash where there is none.

    >>> number(0.012345), number(1234.5), number(float("nan"))
    ('0.0123', '1234', '–')
    """
    if value is None or not np.isfinite(value):
        return "–"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.{digits}g}"


def _legend_above(plot: figure) -> None:
    for legend in [one for one in plot.center if isinstance(one, Legend)]:
        plot.add_layout(legend, "above")
        legend.update(
            orientation="horizontal", click_policy="hide", border_line_color=None, background_fill_alpha=0.0,
            padding=0, margin=2, spacing=8, label_text_font_size="11px", label_height=14, glyph_height=14,
            ncols=min(3, len(legend.items)),
            location="top_left",
        )  # fmt: skip


def _environment() -> Environment:
    return Environment(loader=PackageLoader("pido.reports"), autoescape=True, trim_blocks=True, lstrip_blocks=True)
