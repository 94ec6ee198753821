"""What every mechanism of the catalogue owes its users, and what states and faults are known to be."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.answers import equation_text
from pido.diagnosis.bends import Bend
from pido.diagnosis.faults import clipping, input_faults
from pido.diagnosis.formulas import Formula, Surface
from pido.diagnosis.gates import Gate
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.state import axis_state, axis_states
from pido.diagnosis.terms import Term
from pido.diagnosis.units import units

HOLDING_FRICTION = {"coulomb_friction", "viscous_friction", "stribeck_friction", "load_dependent_friction"}


def recording(part="p1", start=0.0):
    t = np.arange(0.0, 40.0, 0.01)
    v = np.where(np.sin(0.5 * t) > 0.2, 5.0, np.where(np.sin(0.5 * t) < -0.2, -5.0, 0.0))
    x = np.cumsum(v) * 0.01
    cut = (t > 10) & (t < 30)
    columns = {
        "time": t, "pos_x": x, "v_x": v, "a_x": np.gradient(v, t), "pos_y": 0 * t, "v_y": np.sin(t), "a_y": np.cos(t),
        "pos_z": 0 * t, "v_z": 0 * t, "a_z": 0 * t, "v_sp": 6000.0 * cut, "a_sp": np.gradient(6000.0 * cut, t),
        "f_x_sim": 50.0 * cut, "f_y_sim": 30.0 * cut, "f_z_sim": 40.0 * cut, "m_sp_sim": 1.0 * cut,
        "mrr_sim": 100.0 * cut, "curr_x_sim": np.sin(t), "curr_sp_sim": np.cos(t), "coolant": 1.0 * (t > 20),
    }  # fmt: skip
    about = PartInfo.model_validate(
        {
            "part": part, "machine": "m", "start_time_s": start, "vertical_axis": "x",
            "workpiece": {"center_xy_mm": [0, 0], "size_xy_mm": [100, 100], "top_z_mm": 0},
        }
    )  # fmt: skip
    return Recording(about, columns)


def first_shape(mechanism):
    return {p.name: p.grid[0] for p in mechanism.shape}


@pytest.mark.parametrize("mechanism", CATALOGUE, ids=lambda m: m.id)
def test_regressors_are_finite_with_one_column_per_amplitude(mechanism):
    for axis in mechanism.axes:
        state = axis_state(recording(), axis)
        values = mechanism.regressors(state, **first_shape(mechanism))
        assert values.shape == (len(state.time), len(mechanism.amplitudes))
        assert np.isfinite(values).all()
        summary, _ = mechanism.conditions(axis, first_shape(mechanism))
        assert summary
        assert "{" not in summary
        where = mechanism.where(state, **first_shape(mechanism))
        assert where.min() >= 0
        assert where.max() <= 1


def forms(mechanism):
    """Every combination of the forms that a mechanism chooses among, its other shapes between their limits."""
    choices = {p.name: p.values for p in mechanism.shape if p.is_choice}
    rest = {p.name: p.grid[0 if p.values else len(p.grid) // 2] for p in mechanism.shape}
    for values in itertools.product(*choices.values()):
        yield rest | dict(zip(choices, values, strict=True)), [p for p in mechanism.shape if p.name not in choices]


def test_a_place_is_a_number_and_no_choice_among_forms():
    places = [p for m in CATALOGUE for p in m.shape if p.name in ("p_0", "x_c", "y_c")]
    assert len(places) == 3
    assert not any(p.is_choice for p in places)


def full_state(axis):
    """One in which every form has an effect."""
    state = axis_state(recording(), axis)
    ones = np.ones(len(state.time))
    state = replace(state, edge_length=3 * ones, end_length=8 * ones, teeth_in_cut=2 * ones, tool_radius=8 * ones)
    state = replace(state, edge_in_cut=6 * ones)
    return replace(state, tool_mass=2 * ones, vertical=True, clock=state.time, earlier=())


@pytest.mark.parametrize("mechanism", CATALOGUE, ids=lambda m: m.id)
def test_an_equation_states_one_form_and_names_what_acts_in_it(mechanism):
    for axis in mechanism.axes:
        state = full_state(axis)
        for shape, numbers in forms(mechanism):
            text = equation_text(Term(mechanism, tuple(shape.items())), axis)
            assert " or " not in text
            assert text.startswith(f"dI_{axis} = ")
            assert not re.search(rf"[a-z] a_{axis}\b", text), "an article is no acceleration"
            columns = mechanism.regressors(state, **shape)
            idle = mechanism.idle(shape)
            for amplitude, column in zip(mechanism.amplitudes, columns.T, strict=True):
                assert amplitude.name in text or not column.any()
                assert (amplitude.name in idle) <= (not column.any())
            for p in (*mechanism.amplitudes, *numbers):
                assert (p.name in idle) != bool(re.search(rf"(?<!\w){re.escape(p.name)}(?!\w)", text)), (p.name, text)
            for p in numbers:
                if p.name in idle:
                    other = mechanism.regressors(state, **{**shape, p.name: 1.7 * shape[p.name] + 0.3})
                    np.testing.assert_array_equal(other, columns)


@pytest.mark.parametrize("mechanism", [m for m in CATALOGUE if "x" in m.axes], ids=lambda m: m.id)
def test_an_equation_says_of_standstill_what_is_so(mechanism):
    state = full_state("x")
    for shape, _ in forms(mechanism):
        text = mechanism.equation_in("x", shape)
        acts = mechanism.regressors(state, **shape)[~state.moving].any()
        if text.startswith("dI = F_p * (z - sgn(v))"):
            continue  # it is what the simulation has that is zero there
        assert not (acts and "at rest 0" in text), text
        assert acts or "held at rest" not in text, text


def test_an_equation_says_where_it_is_confined():
    coulomb = next(m for m in CATALOGUE if m.id == "coulomb_friction")
    term = Term(coulomb, (("rest", 2.0),), (Gate("v_x", high=8.0),))
    held = "held at rest, turning over 0.03 mm after reversals"
    assert equation_text(term, "x") == f"dI_x = F_c * sgn(v_x), {held}, only where v_x < 8"


def test_a_curve_without_a_name_says_over_which_range_it_was_seen():
    surface = Surface(("v_x", "AR"), ((-20.0, 0.0, 30.0), (0.0, 4.0)), (False, False))
    assert surface.conditions("x", {})[0] == "depending on v_x from -20 to 30 and AR from 0 to 4"
    pushed = Formula((("a_x", "u"), ("speeding_x", "u")), "mm/s²")
    assert pushed.conditions("x", {})[0] == "depending on a_x, while the x axis speeds up"
    said = equation_text(Term(pushed), "x")
    assert said == "dI_x = k * a_x * speeding_x; speeding_x = 1 while v_x * a_x > 0, else 0"
    assert Bend("pos_x", (10.0, 250.0)).conditions("x", {})[0] == "depending on pos_x from 10 to 250"


@pytest.mark.parametrize("mechanism", [m for m in CATALOGUE if m.id in HOLDING_FRICTION], ids=lambda m: m.id)
def test_friction_without_memory_draws_no_current_at_rest_and_turns_with_the_motion(mechanism):
    forward = recording()
    back = forward.with_columns(**{c: -forward[c] for c in ("pos_x", "v_x", "a_x")})
    one, other = axis_state(forward, "x"), axis_state(back, "x")
    shape = first_shape(mechanism)
    assert not mechanism.regressors(one, **shape)[~one.moving].any()
    np.testing.assert_allclose(mechanism.regressors(other, **shape), -mechanism.regressors(one, **shape), atol=1e-12)


@pytest.mark.parametrize(("axis", "forms_at_rest"), [("x", 3), ("sp", 1)])
def test_a_spindle_that_stands_holds_no_friction(axis, forms_at_rest):
    coulomb = next(m for m in CATALOGUE if m.id == "coulomb_friction")
    assert len({shape["rest"] for shape in coulomb.starts([axis_state(recording(), axis)])}) == forms_at_rest


def test_a_mechanism_says_why_the_data_cannot_show_it():
    bare = recording()
    still = Recording(bare.part, {"time": bare.time, "v_x": 0 * bare.time})
    for mechanism in CATALOGUE:
        reason = mechanism.applies([axis_state(still, "x")])
        if mechanism.id not in ("sensor_offset", "gravity_load", "thermal_drift"):
            assert reason, mechanism.id


@pytest.mark.parametrize("x_0", [0.05, 0.4])
def test_presliding_follows_dahl_integrated_step_by_step(x_0):
    made = recording()
    mechanism = next(m for m in CATALOGUE if m.id == "presliding_hysteresis")
    z, expected, step = 1.0, [], 0.05 / 200
    for v in made["v_x"]:
        for _ in range(200 if v else 0):
            z += step * (np.sign(v) - z) / x_0
        expected.append(z)
    got = mechanism.regressors(axis_state(made, "x"), x_0=x_0, full=1.0)[:, 0]
    moved = np.cumsum(made["v_x"] != 0) > 5
    # The two place the turn half a sample apart.
    assert np.sqrt(np.mean((got - np.array(expected))[moved] ** 2)) < 0.08


def test_wear_goes_on_from_part_to_part():
    first, second = axis_states([recording("p1"), recording("p2", 100.0)], "x")
    assert first.cut_volume[-1] == pytest.approx(100.0 * 20.0, rel=1e-2)
    assert second.cut_volume[-1] == pytest.approx(2 * first.cut_volume[-1])
    assert second.earlier == ((0.0, pytest.approx(39.99)),)


def test_way_since_a_reversal_is_travel_over_the_speed():
    made = recording()
    state = axis_state(made, "x")
    at = int(np.flatnonzero(np.diff(state.segment) > 0)[0]) + 1
    assert state.since_reversal[at + 100] == pytest.approx(5.0, abs=0.06)


def test_a_clean_recording_has_no_faulty_input_and_a_frozen_position_is_one():
    made = recording()
    rng = np.random.default_rng(0)
    noisy = made.with_columns(v_z=rng.normal(0, 0.005, len(made)))
    assert input_faults(noisy) == {}
    moving = np.flatnonzero(made["v_x"] > 0)[:100]
    x = made["pos_x"].copy()
    x[moving[20:80]] = x[moving[20]]
    faults = input_faults(made.with_columns(pos_x=x))
    assert list(faults) == ["pos_x"]
    assert min(f.t_start for f in faults["pos_x"]) == pytest.approx(made.time[moving[20]], abs=0.03)


def test_a_limited_current_is_seen_and_a_noisy_one_is_not():
    current = 3 * np.sin(np.arange(4000) / 50) + np.random.default_rng(1).normal(0, 0.1, 4000)
    made = recording()
    assert clipping(made.with_columns(curr_x=current), "x") is None
    assert clipping(made.with_columns(curr_x=np.minimum(current, 2.0)), "x") == (-np.inf, 2.0)


def test_an_edge_turns_the_spindle_with_the_lever_of_its_tool():
    one = recording()
    about = one.part.model_dump(mode="json") | {
        "tools": {"1": {"diameter_mm": 6.0}, "2": {"diameter_mm": 16.0}, "3": {}},
        "tool_changes": [{"t": 0.0, "tool_id": 1}, {"t": 15.0, "tool_id": 2}, {"t": 25.0, "tool_id": 3}],
    }
    state = axis_state(Recording(PartInfo.model_validate(about), one.columns), "sp")
    edge = next(m for m in CATALOGUE if m.id == "edge_force")
    torque = edge.regressors(state, along=2.0, length=0.0)[:, 0]
    at = np.interp([5.0, 12.0, 20.0, 28.0, 35.0], state.time, torque)
    np.testing.assert_allclose(at, [0.0, 3.0, 8.0, 0.0, 0.0])
    assert not edge.regressors(axis_state(one, "sp"), along=2.0, length=0.0).any()
    form = {"along": 2.0, "length": 1.0}
    assert units(edge, form, "sp") == {"K_e": "A/mm²"}
    assert units(edge, form, "x") == {"K_e": "A/mm"}


def test_a_tool_that_plunges_cuts_with_its_end():
    one = recording()
    about = one.part.model_dump(mode="json") | {
        "tools": {"1": {"diameter_mm": 6.0}},
        "tool_changes": [{"t": 0.0, "tool_id": 1}],
        "operations": [{"nc_line": 1, "a_p": 0.5}],
    }
    n = len(one)
    still, down = np.zeros(n), np.where(one.time < 10.0, -2.0, 0.0)
    columns = {**one.columns, "v_x": 1.0 - (down != 0), "v_y": still, "v_z": down}
    columns |= {f"a_{a}": still for a in "xyz"} | {"nc_line": still + 1}
    state = axis_state(Recording(PartInfo.model_validate(about), columns), "x")
    np.testing.assert_array_equal(state.end_length[one.time < 9.9], 3.0)
    np.testing.assert_array_equal(state.end_length[one.time > 10.1], 0.5)
    np.testing.assert_array_equal(state.edge_length, 0.5)
    edge = next(m for m in CATALOGUE if m.id == "edge_force")
    assert {s["length"] for s in edge.starts([state])} == {0.0, 1.0, 2.0, 3.0}
    assert {s["length"] for s in edge.starts([axis_state(one, "x")])} == {0.0, 1.0, 2.0}


def test_an_edge_in_cut_is_that_of_the_operation_by_the_share_of_its_area_that_is_removed():
    one = recording()
    about = one.part.model_dump(mode="json") | {
        "tools": {"1": {"diameter_mm": 6.0, "teeth": 4}},
        "tool_changes": [{"t": 0.0, "tool_id": 1}],
        "operations": [{"nc_line": 1, "a_p": 0.5, "a_e": 3.0}],
    }
    n = len(one)
    still, down = np.zeros(n), np.where(one.time < 10.0, -2.0, 0.0)
    area = np.where(down != 0, np.pi * 3.0**2, np.where(one.time < 20.0, 1.5, 0.75)) * (one.time < 30.0)
    columns = {**one.columns, "v_x": 1.0 - (down != 0), "v_y": still, "v_z": down}
    columns |= {f"a_{a}": still for a in "xyz"} | {"nc_line": still + 1}
    columns["mrr_sim"] = area * np.where(down != 0, 2.0, 1.0)
    state = axis_state(Recording(PartInfo.model_validate(about), columns), "x")
    # All four teeth over the radius in a plunge; a quarter of a turn of each of them beside it, then half of that.
    at = [np.unique(np.round(state.edge_in_cut[rows], 9)) for rows in (
        one.time < 9.9, (one.time > 10.1) & (one.time < 19.9), (one.time > 20.1) & (one.time < 29.9), one.time > 30.1,
    )]  # fmt: skip
    assert at == [[12.0], [0.5], [0.25], [0.0]]
    edge = next(m for m in CATALOGUE if m.id == "edge_force")
    np.testing.assert_array_equal(edge.regressors(state, along=0.0, length=4.0)[:, 0], state.edge_in_cut)
    assert {s["length"] for s in edge.starts([state])} == {0.0, 1.0, 2.0, 3.0, 4.0}
    assert units(edge, {"along": 0.0, "length": 4.0}, "x") == {"K_e": "A/mm"}
