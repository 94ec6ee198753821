"""Pictures of where a finding acts, of findings whose truth is known: shown where they show something."""

from dataclasses import replace

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.answers import where_of
from pido.diagnosis.arms import Arm, Eased
from pido.diagnosis.finding import Diagnosis, Estimate, Evidence, Finding, HeldOut, PartSeries, Where
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.models import AxisModel, as_json
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from pido.reports.diagnosis import diagnosis_page

CURVE = next(m for m in CATALOGUE if m.id == "position_dependent_friction")
TABLE, SPEEDS = "Where on the machine table", "At which speeds"


def recording():
    t = np.arange(4000) / 50.0
    columns = {"time": t, "pos_x": 100 + 100 * np.sin(t), "pos_y": 50 * np.cos(t)}
    columns |= {f"v_{a}": np.gradient(columns[f"pos_{a}"], t) for a in "xy"}
    columns |= {f"a_{a}": np.gradient(columns[f"v_{a}"], t) for a in "xy"}
    # The spindle turns in every other ten seconds, and while it cuts a place on the workpiece is known.
    columns |= {"v_sp": 18000.0 * (t // 10 % 2), "a_sp": 0 * t, "mrr_sim": 50.0 * (t // 10 % 2)}
    return Recording(PartInfo(part="p01", machine="m"), {**columns, "curr_x": np.sign(columns["v_x"])})


def finding(mechanism, equation="dI_x = ...", conditions=(), parameters=None):
    return Finding(
        "x", mechanism, "missing_physics", equation, parameters or {}, Where("somewhere", conditions),
        Evidence(1e-6, 1e-6, 100.0), HeldOut("leave-one-part-out", 0.3, 0.1, 0.5, 0.9, 1e-6),
    )  # fmt: skip


def section(own, model=None, changed=None):
    made = recording().with_columns(**(changed or {}))
    zero, axis = np.zeros(len(made)), own.axis
    series = PartSeries(made.time, {axis: zero + 0.1}, {axis: zero}, {axis: zero})
    page = diagnosis_page(Diagnosis((own,), (), {"p01": series}, model or {}), [made])
    return next(s for s in page.sections if s.title.startswith(f"Axis {axis}"))


def titles(own):
    return " ".join(plot.title.text.text for plot in section(own).figures)


@pytest.mark.parametrize(
    ("name", "seconds"), [("shift", (0.5, 2.0)), ("shift_p01", (3.0, 5.0)), ("shift_p02", (10.0, 13.0))]
)
def test_a_shift_in_time_is_shown_over_so_little_time_that_it_is_seen(name, seconds):
    size = 0.1 if name == "shift_p01" else 0.03
    own = finding("time_misalignment", parameters={name: Estimate(size, "s", (size, size))})
    first = section(own).figures[0]
    time = first.renderers[0].data_source.data["x"]
    assert seconds[0] < np.ptp(time) < seconds[1]


@pytest.mark.parametrize(
    "nowhere",
    [
        finding("thermal_drift", "dI_x = T * exp(-t / tau) * sgn(v_x)"),
        finding("external_force"),
        finding("time_misalignment"),
        finding("sensor_gain"),
        finding("coolant_load"),
        finding("unknown", "dI_x = (k_0 + k_1 * exp(-|v_sp| / c)) * sgn(v_x)"),
        finding("unknown", "dI_x = A * sin(2 pi t / T) + B * cos(2 pi t / T)"),
    ],
    ids=lambda f: f"{f.mechanism} {f.equation[7:20]}",
)
def test_what_no_place_or_speed_makes_has_no_map(nowhere):
    assert TABLE not in titles(nowhere)
    assert SPEEDS not in titles(nowhere)


def test_what_a_place_or_a_speed_makes_has_the_map_of_it_alone():
    for own in (finding("material_hard_zone"), finding("unknown", "dI_x = k * pos_y * v_sp")):
        assert TABLE in titles(own)
        assert SPEEDS not in titles(own)
    confined = finding("coulomb_friction", conditions=("v_x > 4 and v_x < 9",))
    for own in (confined, finding("miscalibrated:viscous_friction"), finding("unknown", "dI_x = k * v_x * v_y")):
        assert SPEEDS in titles(own)
        assert TABLE not in titles(own)


def test_a_map_shows_axes_that_move_and_no_others():
    """x and y move in the recording, z does not; then z and x."""
    assert SPEEDS not in titles(replace(finding("viscous_friction"), axis="z"))
    assert TABLE not in titles(replace(finding("position_dependent_friction"), axis="z"))
    made = recording()
    up = {"pos_z": made["pos_y"], "v_z": made["v_y"], "a_z": made["a_y"]}
    up |= {"pos_y": 0 * made.time + 20.0, "v_y": 0.01 * np.sin(made.time)}
    plots = section(replace(finding("viscous_friction"), axis="z"), changed=up).figures
    (plot,) = [p for p in plots if SPEEDS in p.title.text.text]
    assert plot.xaxis.axis_label.text == "v_x, mm/s"
    assert plot.yaxis.axis_label.text == "v_z, mm/s"


def test_a_few_rapids_do_not_press_a_map_of_the_speeds_together():
    made = recording()
    fast = np.arange(len(made)) % 200 == 0
    figures = section(finding("viscous_friction"), changed={"v_x": np.where(fast, 5000.0, made["v_x"])}).figures
    (plot,) = [p for p in figures if SPEEDS in p.title.text.text]
    at = plot.renderers[0].data_source.data
    assert np.max(at["x"]) <= np.max(made["v_x"])
    assert np.all(np.diff(at["size"]) >= 0)
    assert plot.title.text.text.endswith("on axis x, A; the fastest few are left out")


@pytest.mark.parametrize(
    ("law", "place"),
    [(Eased("v_sp", "v_x", "sgn u", "mm/s", "deg/s"), False), (Arm("pos_y", "v_x", "mm/s", form="sgn u"), True)],
)
def test_a_place_on_the_workpiece_is_told_of_a_law_that_has_one(law, place):
    made = recording()
    states = axis_states([made], "x")
    state = states[0]
    with_places = [type(state)(**{**_fields(state), "wx": made["pos_x"], "wy": made["pos_y"]})]
    assert with_places[0].engaged is not None
    assert with_places[0].engaged.any()
    term = Term(law, (("c", 500.0),) if isinstance(law, Eased) else ())
    where = where_of(with_places, term, np.full(len(made), 0.2), np.array([0, len(made)]), 0.05)
    assert (where.workpiece is not None) == place


def _fields(state):
    return {name: getattr(state, name) for name in state.__dataclass_fields__}


def test_a_number_that_the_form_sets_has_no_interval_on_the_page():
    numbers = {"G_1": Estimate(0.3, "A", (0.2, 0.4)), "L": Estimate(215.3, "mm", (215.3, 215.3))}
    rows = {row[0]: row[2] for row in section(finding("torque_ripple", parameters=numbers)).table.rows}
    assert rows["G_1"] == "0.2 … 0.4 A"
    assert "…" not in rows["L"]
    assert "not estimated" in rows["L"]


def test_a_friction_along_the_travel_is_drawn_over_it_with_its_band():
    heights = np.zeros(13)
    heights[5:8] = 0.3  # over places from -1 to 1 in steps of a sixth
    shape = {"form": 6.0, "L": 100.0, "p_0": 100.0, "rest": 0.0, "v_0": 0.1}
    term = Term(CURVE, tuple(shape.items()))
    model = as_json({"x": AxisModel("x", 0.1, (term,), (heights,))})
    known = {f"G_{n}": Estimate(float(h), "A", (float(h) - 0.05, float(h) + 0.05)) for n, h in enumerate(heights)}
    figures = section(finding("position_dependent_friction", parameters=known), model).figures
    (plot,) = [f for f in figures if "along the travel" in f.title.text.text]
    band, line = (r.data_source.data for r in plot.renderers)
    at = np.asarray(line["x"])
    assert at.min() == pytest.approx(0.0, abs=0.1)  # the travel of the part
    assert at.max() == pytest.approx(200.0, abs=0.1)
    places = 100 + 100 * np.linspace(-1, 1, 13)
    np.testing.assert_allclose(line["y"], np.interp(at, places, heights), atol=1e-9)
    np.testing.assert_allclose(np.asarray(band["y2"]) - np.asarray(band["y1"]), 0.1, atol=1e-9)
