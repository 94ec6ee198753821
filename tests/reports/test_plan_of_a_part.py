"""A plan says which bins matter most and how much of the coming part runs where something is known."""

import numpy as np
import pytest

from pido.feature_space.grid import Grid
from pido.reports.page import render
from pido.reports.plan import plan_figures, plan_page, plan_rows
from pido.sampling.optimise import Report

GRID = Grid((2.0, 2.0, 2.0))


def report():
    bins = np.sort(GRID.ids(np.array([[1.0, 1.0, 11.0], [3.0, 1.0, 11.0], [5.0, 1.0, 11.0]])))
    zero = np.zeros(3, np.int64)
    return Report(
        bins, np.array([7, 0, 0]), zero, zero, np.array([1, 0, 0]), np.array([0, 4, 0]), np.zeros((5, 4), int)
    )


def test_the_most_visited_bin_stands_first_and_the_known_share_counts_samples_not_bins():
    rows = plan_rows(report(), GRID, np.array([10, 60, 30]))
    assert [row["coming"] for row in rows] == [60, 30, 10]
    assert (rows[0]["v_x"], rows[0]["v_y"], rows[0]["ar"]) == (3.0, 1.0, 11.0)
    figures = plan_figures(rows)
    assert figures["share_of_the_part_in_known_bins"] == pytest.approx(0.10)
    assert figures["bins_without_real_samples"] == 2
    assert (figures["pia_would_generate"], figures["pie_would_generate"]) == (1, 4)


def test_the_page_of_a_plan_opens_with_its_verdict_and_escapes_names():
    page = render(plan_page("<b>p</b>", plan_rows(report(), GRID, np.array([10, 60, 30])), "", {"duration_s": 3.5}))
    assert "10% of this part runs" in page
    assert "Of its 3 bins of speed and removal 2 hold no recorded sample; PiDO would generate 5 rows in them." in page
    assert "<b>p</b>" not in page


def test_rows_in_other_bins_are_told_apart_from_those_in_the_parts_own():
    rows = plan_rows(report(), GRID, np.array([10, 60, 30]))
    assert plan_figures(rows, 900)["would_generate_in_other_bins"] == 900
    page = render(plan_page("p", rows, "", {}, 900))
    assert "PiDO would generate 5 rows in them, and 900 between recorded rows in other bins." in page
