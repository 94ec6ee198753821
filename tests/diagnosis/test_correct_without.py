"""A part, or a sample, that does not say what a finding follows from is not corrected in silence."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from pido.core.errors import DiagnosisError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.correct import correct, not_told_of
from pido.diagnosis.dynamics import Ringing
from pido.diagnosis.formulas import Formula
from pido.diagnosis.gaps import known_columns
from pido.diagnosis.gates import Gate
from pido.diagnosis.lateness import Late, shifted
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.models import AxisModel, as_json, known_of
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term

COOLANT = Term(next(m for m in CATALOGUE if m.id == "coolant_load"), (("along", 0.0),))


def part(**more):
    t = np.arange(500) * 0.02
    v = 10 * np.sin(t)
    columns = {"time": t, "v_x": v, "a_x": np.gradient(v, t), "pos_x": np.cumsum(v) * 0.02, "curr_x_sim": v}
    return Recording(PartInfo(part="p1", machine="m"), {**columns, **more})


def model_of(term, recording):
    states = axis_states([recording], "x")
    amplitudes = np.ones(len(term.of_part(states[0])))
    return as_json({"x": AxisModel("x", 0.1, (term,), (amplitudes,), known=known_of(states))})


def test_a_part_without_the_column_is_refused_and_the_column_named():
    model = model_of(COOLANT, part(coolant=np.ones(500)))
    with pytest.raises(DiagnosisError, match=r"p1: coolant_load on axis x .* lacks coolant"):
        correct(model, part())


def test_a_part_in_which_coolant_was_off_is_corrected_by_nothing():
    model = model_of(COOLANT, part(coolant=np.ones(500)))
    series = correct(model, part(coolant=np.zeros(500)))
    np.testing.assert_array_equal(series.corrected["x"], part()["curr_x_sim"])
    on = correct(model, part(coolant=np.ones(500)))
    np.testing.assert_allclose(on.mismatch["x"], 1.0)


DRIFT = Term(
    next(m for m in CATALOGUE if m.id == "thermal_drift"),
    (("tau", 100.0), ("clock", 2.0), ("along", 0.0), ("rises", 0.0)),
)


def made(order):
    """Parts of ten seconds, a second after one another."""
    return replace(part(), part=PartInfo(part=f"p{order}", machine="m", order=order, start_time_s=11.0 * (order - 1)))


def test_heat_is_carried_on_from_the_parts_that_are_known_and_the_others_are_named():
    parts = [made(k) for k in (1, 2)]
    states = axis_states(parts, "x")
    model = as_json({"x": AxisModel("x", 0.1, (DRIFT,), (np.ones(1),), known=known_of(states))})
    model |= {"history": [[0.0, 9.98], [11.0, 20.98]], "orders": [1, 2]}
    assert not_told_of(model, made(3)) == []
    assert not_told_of(model, made(5)) == [3, 4]
    assert not_told_of(model, made(5), [made(3), made(4)]) == []
    cold = correct(model, made(5)).mismatch["x"][0]
    warm = correct(model, made(5), [made(3), made(4)]).mismatch["x"][0]
    # forty seconds of running against twenty, of a hundred that heat takes; pauses of a second cool a little
    assert warm == pytest.approx(np.exp(-0.4), abs=0.03)
    assert cold > warm + 0.1


@pytest.mark.parametrize(
    ("used", "missing"), [({}, [2]), ({"used_before": {"cut_volume_mm3": 9.0, "cut_time_s": 3.0}}, [])]
)
def test_wear_that_a_part_states_itself_is_not_asked_for(used, missing):
    wear = Term(next(m for m in CATALOGUE if m.id == "tool_wear"), (("by", 1.0), ("of", 1.0)))
    late = replace(
        made(3), part=PartInfo.model_validate({"part": "p3", "machine": "m", "order": 3, "tools": {"1": used}})
    )
    model = as_json({"x": AxisModel("x", 0.1, (wear,), (np.ones(1),))}) | {"orders": [1]}
    assert not_told_of(model, late) == missing


def mechanism(name, **shape):
    return Term(next(m for m in CATALOGUE if m.id == name), tuple(shape.items()))


RIPPLE = mechanism("torque_ripple", L=5.0, harmonics=0.0, late=0.0)
HOLE = slice(200, 240)


def rich(**more):
    """Both axes move, the tool cuts now and then, coolant is on throughout."""
    t, cuts = np.arange(500) * 0.02, np.arange(500) % 100 < 60
    y = {"v_y": 6 * np.cos(t), "a_y": -6 * np.sin(t), "pos_y": 6 * np.sin(t)}
    load = {f"f_{axis}_sim": 80.0 * cuts for axis in "xyz"}
    return part(**y, **load, mrr_sim=50.0 * cuts, coolant=np.ones(500), **more)


def with_hole(recording, *names):
    columns = {name: recording[name].copy() for name in names}
    for values in columns.values():
        values[HOLE] = np.nan
    return recording.with_columns(**columns)


@pytest.mark.parametrize(
    ("term", "column"),
    [
        (RIPPLE, "pos_x"),
        (COOLANT, "coolant"),
        (mechanism("inertia"), "a_x"),
        (mechanism("coulomb_friction", rest=0.0, v_0=0.1), "v_x"),
        (mechanism("coulomb_friction", rest=1.0, v_0=0.1), "v_x"),
        (mechanism("coulomb_friction", rest=3.0, v_0=0.1), "v_x"),
        (mechanism("axis_coupling", source=5.0), "v_y"),
        (mechanism("edge_force", along=0.0, length=0.0), "mrr_sim"),
        (Term(Formula((("pos_y", "u"),), "mm")), "pos_y"),
        (Term(Formula((("feed", "u"),), "mm/s")), "v_y"),
        (replace(COOLANT, gates=(Gate("v_x", low=3.0),)), "v_x"),
        (replace(COOLANT, gates=(Gate("v_y", high=3.0),)), "v_y"),
    ],
)
def test_nothing_is_said_where_what_a_finding_follows_from_is_missing(term, column):
    model = model_of(term, rich())
    whole, holed = correct(model, rich()), correct(model, with_hole(rich(), column))
    missing = np.zeros(500, bool)
    missing[HOLE] = True
    for series in (holed.mismatch, holed.score, holed.corrected):
        np.testing.assert_array_equal(np.isnan(series["x"]), missing)
    np.testing.assert_allclose(holed.mismatch["x"][~missing], whole.mismatch["x"][~missing], atol=1e-12)


@pytest.mark.parametrize(
    ("term", "column"),
    [
        (COOLANT, "pos_x"),
        (COOLANT, "v_x"),
        (RIPPLE, "a_x"),
        (mechanism("cutting_force"), "mrr_sim"),
        (mechanism("backlash", gap=1.0, edge=1.0, per=0.0), "pos_y"),
        (replace(RIPPLE, gates=(Gate("v_y", low=1000.0),)), "pos_x"),
    ],
)
def test_what_a_finding_does_not_follow_from_may_be_missing(term, column):
    model = model_of(term, rich())
    whole, holed = correct(model, rich()), correct(model, with_hole(rich(), column))
    np.testing.assert_allclose(holed.mismatch["x"], whole.mismatch["x"], atol=1e-12)


def test_a_value_that_was_recorded_and_is_wrong_is_not_missing():
    """A counter that was reset is a finding of its own; what cannot be said because of it corrects nothing."""
    (state,) = axis_states([rich()], "x")
    wrong = state.pos.copy()
    wrong[HOLE] = np.nan
    assert np.isfinite(known_columns(RIPPLE, rich(), replace(state, pos=wrong))).all()


def test_a_play_that_no_reversal_has_shown_yet_is_nothing_and_not_missing():
    model = model_of(mechanism("backlash", gap=1.0, edge=1.0, per=0.0), rich())
    before = correct(model, with_hole(rich(), "pos_y")).mismatch["x"][:100]
    np.testing.assert_array_equal(before, 0.0)


@pytest.mark.parametrize(
    ("term", "columns", "lacking"),
    [
        (RIPPLE, ["pos_x"], "pos_x"),
        (COOLANT, ["coolant"], "coolant"),
        (mechanism("viscous_friction"), ["v_x", "pos_x"], "v_x or pos_x"),
    ],
)
def test_a_column_without_any_value_is_refused_as_one_that_is_not_there(term, columns, lacking):
    model = model_of(term, rich())
    empty = rich().with_columns(**dict.fromkeys(columns, np.full(500, np.nan)))
    gone = replace(rich(), columns={n: v for n, v in rich().columns.items() if n not in columns})
    for recording in (empty, gone):
        with pytest.raises(DiagnosisError, match=f"p1: {term.name} on axis x .* lacks {lacking}, which"):
            correct(model, recording)


def test_a_simulation_without_any_value_is_refused():
    empty = rich().with_columns(curr_x_sim=np.full(500, np.nan))
    with pytest.raises(DiagnosisError, match="'curr_x_sim' is missing"):
        correct(model_of(RIPPLE, rich()), empty)


def test_what_remembers_nothing_asks_for_no_parts():
    model = model_of(COOLANT, part(coolant=np.ones(500))) | {"orders": [1]}
    assert not_told_of(model, made(5)) == []


@pytest.mark.parametrize(
    "term",
    [
        Term(Formula((("coolant", "u"),), "–")),
        Term(Ringing("f_x", "N"), (("f", 5.0), ("zeta", 0.1))),
    ],
)
def test_what_has_no_name_says_which_quantity_it_misses(term):
    model = model_of(term, part(coolant=np.ones(500), f_x_sim=np.ones(500)))
    with pytest.raises(DiagnosisError, match=r"p1: .* depends on (coolant|f_x)"):
        correct(model, part())


@pytest.mark.parametrize("last", [5e-324, 1e-310, 1e-200])
def test_a_current_that_fades_out_below_all_numbers_is_shifted_without_a_warning(last):
    t = np.arange(400) * 0.02
    fading = np.geomspace(1.0, last, 400)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        moved = shifted(t, fading, Late(0.02))
    np.testing.assert_allclose(moved[1:], fading[:-1], rtol=1e-9, atol=1e-300)


def test_peaks_between_samples_are_not_cut_where_a_current_is_shifted():
    t = np.arange(200) * 0.02
    moved = shifted(t, np.sin(10 * np.pi * t), Late(0.01))
    np.testing.assert_allclose(moved[2:], np.sin(10 * np.pi * (t - 0.01))[2:], atol=0.02)
