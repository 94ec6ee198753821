"""The picture of a law without a name: of laws that are known, on data that hold them and nothing else but noise."""

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.answers import equation_text
from pido.diagnosis.arms import Arm
from pido.diagnosis.bends import Bend
from pido.diagnosis.dynamics import Ringing
from pido.diagnosis.finding import Diagnosis, Estimate, Evidence, Finding, HeldOut, PartSeries, Where
from pido.diagnosis.formulas import Formula, Peak, Surface
from pido.diagnosis.late import Lagged
from pido.diagnosis.models import AxisModel, as_json
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from pido.diagnosis.waves import Wave
from pido.reports.diagnosis import diagnosis_page

NOISE = 0.05


def recording():
    t = np.arange(6000) / 50.0
    columns = {"time": t, "pos_x": 100 + 100 * np.sin(0.7 * t), "pos_y": 50 * np.cos(0.31 * t)}
    columns |= {f"v_{a}": np.gradient(columns[f"pos_{a}"], t) for a in "xy"}
    columns |= {f"a_{a}": np.gradient(columns[f"v_{a}"], t) for a in "xy"}
    return Recording(PartInfo(part="p01", machine="m"), columns)


def section(law, amplitudes, shape=None, level=0.0):
    """The section of a law without a name. level : A – of another finding, which the data hold as well"""
    term = Term(law, tuple((shape or {}).items()))
    made = recording()
    (state,) = axis_states([made], "x")
    effect = np.array(amplitudes) @ term.of_part(state)
    noise = np.random.default_rng(0).normal(0, NOISE, len(made))
    made = made.with_columns(curr_x=effect + level + noise)
    series = PartSeries(made.time, {"x": effect + level}, {"x": 0 * effect + 1}, {"x": effect + level})
    model = as_json({"x": AxisModel("x", NOISE, (term,), (np.array(amplitudes, float),))})
    sizes = zip(law.amplitudes, map(float, amplitudes), strict=True)
    names = {p.name: Estimate(v, p.unit, (v - 0.1, v + 0.1)) for p, v in sizes}
    own = Finding(
        "x", "unknown", "unexplained", equation_text(term, "x"), names, Where("somewhere"),
        Evidence(1e-6, 1e-6, 100.0), HeldOut("leave-one-part-out", 0.3, 0.1, 0.5, 0.9, 1e-6),
    )  # fmt: skip
    page = diagnosis_page(Diagnosis((own,), (), {"p01": series}, model), [made])
    return next(s for s in page.sections if s.title.startswith("Axis x"))


def picture(*law, **how):
    """Its points and lines, each (x, y), and the words of its axes."""
    (plot,) = [f for f in section(*law, **how).figures if "what is missing" in f.title.text.text]
    each = {"points": [], "lines": []}
    for renderer in plot.renderers:
        data = renderer.data_source.data
        if "y" in data:
            kind = "lines" if type(renderer.glyph).__name__ == "Line" else "points"
            each[kind].append((np.asarray(data["x"]), np.asarray(data["y"])))
    return each["points"], each["lines"], plot.xaxis.axis_label.text


ALONE = [
    (Bend("pos_x", (0.0, 200.0)), [0.2, 0.5, -0.7], None, lambda x: np.polyval([-0.7, 0.5, 0.2], x / 100 - 1)),
    (Formula((("v_y", "u²"),), "(mm/s)^2", ((-16.0, 16.0),)), [0.01], None, lambda x: 0.01 * x**2),
    (Peak("pos_y", "mm", False), [0.8], {"c": 10.0, "w": 6.0}, lambda x: 0.8 * np.exp(-(((x - 10) / 6) ** 2))),
    (Wave("pos_x", "mm", "", "–"), [0.5, 0.0], {"L": 25.0}, lambda x: 0.5 * np.sin(2 * np.pi * x / 25)),
    (
        Surface(("pos_x",), ((0.0, 50.0, 120.0, 200.0),), (False,)),
        [0.1, 0.9, -0.3, 0.4],
        None,
        lambda x: np.interp(x, (0.0, 50.0, 120.0, 200.0), (0.1, 0.9, -0.3, 0.4)),
    ),
]  # fmt: skip


@pytest.mark.parametrize(("law", "amplitudes", "shape", "truth"), ALONE, ids=lambda v: type(v).__name__)
def test_a_law_of_one_quantity_is_drawn_over_it_with_the_means_of_the_data(law, amplitudes, shape, truth):
    ((u, mean),), ((x, y),), said = picture(law, amplitudes, shape, level=0.7)
    np.testing.assert_allclose(y, truth(x), atol=1e-9)
    period = shape["L"] if isinstance(law, Wave) else None
    seen = recording()[next(iter(law.reads))]
    assert np.ptp(x) <= (period or np.ptp(seen))  # no further than the data
    assert np.ptp(x) > 0.95 * (period or np.ptp(seen))
    assert len(u) > 20
    # Within a class the law bends: that, and the noise of the few samples of a class.
    assert np.max(np.abs(mean - truth(u))) < 4 * NOISE / np.sqrt(5) + 0.02
    assert "axis" in said
    assert said.endswith(("mm", "mm/s"))


def test_a_law_of_two_quantities_has_a_line_for_values_of_the_second():
    points, lines, said = picture(Arm("pos_y", "v_x", "mm/s", form="sgn u"), [0.3, 0.02])
    assert "position of the y axis" in said
    for (u, mean), (x, y) in zip(points, lines, strict=True):
        np.testing.assert_allclose(mean, y, atol=4 * NOISE / np.sqrt(5))
        np.testing.assert_allclose(u, x)
    slopes = sorted(np.polyfit(x, y, 1)[0] for x, y in lines if np.ptp(y))
    assert slopes[0] == pytest.approx(-0.02, abs=1e-3)  # against the direction, and with it
    assert slopes[-1] == pytest.approx(0.02, abs=1e-3)


def test_what_acts_late_is_drawn_over_how_its_quantity_was_lately():
    (_,), ((x, y),), said = picture(Lagged("v_x", "u", "mm/s"), [0.01], {"tau": 0.8})
    np.testing.assert_allclose(y, 0.01 * x, atol=1e-6)  # at once it is a loop
    assert "0.8 s" in said


def test_what_rings_after_an_event_has_no_curve():
    figures = section(Ringing("a_x", "mm/s²"), [0.01, 0.01], {"f": 5.0, "zeta": 0.1}).figures
    assert not any("what is missing" in f.title.text.text for f in figures)


@pytest.mark.parametrize(
    ("law", "amplitudes", "shape", "rows"),
    [
        (Wave("pos_x", "mm", "", "–", harmonics=6), [0.1] * 12, {"L": 25.0}, ["k_s1 … k_c6"]),
        (Surface(("pos_x",), (tuple(np.linspace(0, 200, 9)),), (False,)), [0.1] * 9, None, ["g_0 … g_8"]),
        (Bend("pos_x", (0.0, 200.0)), [0.2, 0.5, -0.7], None, ["g_0", "g_1", "g_2"]),
    ],
)
def test_the_heights_of_a_curve_that_is_shown_share_a_row(law, amplitudes, shape, rows):
    table = section(law, amplitudes, shape).table
    assert [row[0] for row in table.rows] == rows
    assert ("picture" in table.rows[0][2]) == (len(rows) == 1)


def test_a_number_without_a_unit_has_no_dash_and_the_columns_of_a_formula_are_explained():
    own = section(Peak("pos_y", "mm", False), [0.8], {"c": 10.0, "w": 6.0})
    assert "In this formula: dI_x: what the simulation lacks, A; pos_y: position of the y axis, mm." in own.text
    ringing = section(Wave("pos_x", "mm", "", "–"), [0.5, 0.0], {"L": 25.0})
    for row in [*own.table.rows, *ringing.table.rows]:
        assert "–" not in "".join(row)
