"""A page as a reader sees it: in a window, on a phone, on paper. Drawn by a real Chromium."""

import chromium
import numpy as np
import pytest

from pido.reports.page import Page, Section, Table, signal_figure, write_page

PAPER_PX = 180 / 25.4 * 96
"""Between the margins of A4, CSS px."""
LISTEN = """
window.drawn = [];
const draw = CanvasRenderingContext2D.prototype.fillText;
CanvasRenderingContext2D.prototype.fillText = function (text, ...at) {
  drawn.push(text);
  draw.call(this, text, ...at);
};
"""
pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Everything a page can hold: a hostile name, a wide table, an open and a folded plot."""
    plots = []
    for name in ("open", "folded"):
        plot = signal_figure(f"Axis {name}, part Los $$7$$:\nwhere it differs most", "time, s", "$$f_x$$, N")
        plot.line(np.arange(100.0), np.sin(np.arange(100.0)), legend_label="recorded")
        plots.append(plot)
    table = Table([f"column {k}" for k in range(9)], [["a value of some length"] * 9] * 3)
    wide = Table([f"another variant, {k}" for k in range(18)], [["+12.3*"] * 18] * 3)
    sections = [
        Section("Signals", ["words"], table, plots[:1]),
        Section("Wide", table=wide),
        Section("More", figures=plots[1:], folded=True),
    ]
    place = tmp_path_factory.mktemp("page") / "page.html"
    write_page(Page('Part <script>document.title="run"</script>', "Nothing unusual.", sections), place)
    return place.as_uri()


@pytest.fixture(scope="module")
def browser():
    """Keeps the words that a page draws."""
    with chromium.started("1280,900", **{"goog:loggingPrefs": {"browser": "ALL"}}) as found:
        found.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": LISTEN})
        yield found


@pytest.fixture(params=[1280, 390])
def opened(request, page, browser):
    """The page at a width, its plots drawn."""
    from selenium.webdriver.support.wait import WebDriverWait

    metrics = {"width": request.param, "height": 900, "deviceScaleFactor": 1, "mobile": request.param < 600}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    browser.get(page)
    WebDriverWait(browser, 60).until(lambda b: b.execute_script("return window.Bokeh && Bokeh.documents.length > 0"))
    return browser


def test_nothing_sticks_out_and_nothing_goes_wrong(opened):
    width = opened.execute_script("return window.innerWidth")
    assert opened.execute_script("return document.documentElement.scrollWidth") <= width
    assert not [one for one in opened.get_log("browser") if one["level"] == "SEVERE"]
    assert opened.title.startswith("Part <script>")


def test_words_of_a_plot_are_drawn_as_they_are(opened):
    drawn = opened.execute_script("return window.drawn")
    for words in ("Axis open, part Los $$7$$:", "where it differs most", "$$f_x$$, N"):
        assert words in drawn


def test_a_folded_plot_has_the_width_of_the_page_once_it_is_opened(opened):
    from selenium.webdriver.support.wait import WebDriverWait

    opened.execute_script("document.querySelector('details').open = true")
    drawn = "return document.querySelector('details .bk-Figure').getBoundingClientRect().width"
    wanted = "return document.querySelector('details').getBoundingClientRect().width"
    WebDriverWait(opened, 30).until(lambda b: b.execute_script(drawn) > 0.9 * b.execute_script(wanted))


def test_on_paper_each_plot_is_whole_and_on_the_screen_again_as_before(opened):
    widths = (
        "return [...document.querySelectorAll('section .plot')].map(p => p.offsetWidth * (Number(p.style.zoom) || 1))"
    )
    before = opened.execute_script(widths)
    opened.execute_script("window.dispatchEvent(new Event('beforeprint'))")
    zoomed = opened.execute_script(
        "return [...document.querySelectorAll('section .plot')].map(p => Number(p.style.zoom) || 1)"
    )
    assert all(width * zoom <= PAPER_PX + 1 for width, zoom in zip(before, zoomed, strict=True))
    opened.execute_script("window.dispatchEvent(new Event('afterprint'))")
    assert opened.execute_script(widths) == before


def test_a_table_wider_than_the_page_scrolls_on_the_screen_and_is_whole_on_paper(opened):
    widest = "return Math.max(...[...document.querySelectorAll('table')].map(t => t.getBoundingClientRect().width))"
    assert opened.execute_script(
        "return [...document.querySelectorAll('table')].every(t => t.scrollWidth <= t.parentElement.clientWidth"
        " || getComputedStyle(t.parentElement).overflowX === 'auto')"
    )
    opened.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    opened.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": int(PAPER_PX), "height": 900, "deviceScaleFactor": 1, "mobile": False},
    )
    try:
        assert opened.execute_script(widest) <= PAPER_PX + 1
    finally:
        opened.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
