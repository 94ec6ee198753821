"""An axis that rings and a current that follows late: found without a name, with the right frequency and time."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from pido.diagnosis.arms import Arm
from pido.diagnosis.dynamics import Ringing, RingingAlong
from pido.diagnosis.estimate import estimate, settle_shapes
from pido.diagnosis.latched import Latched, Switched
from pido.diagnosis.late import Fading, Lagged, Modulated
from pido.diagnosis.late_arms import LaggedArm, Warped
from pido.diagnosis.library import Library, basis
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.models import AxisModel, as_json, axis_models
from pido.diagnosis.rested import Rested
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from pido.diagnosis.transients import Transient
from pido.diagnosis.unnamed import is_known, with_unknown
from pido.diagnosis.waves import Wave
from tests.diagnosis.planted import NOISE, STEP, found_in, part, planted, white


def test_an_axis_that_rings_after_each_change_of_speed():
    w, zeta = 2 * np.pi * 6.0, 0.05
    # The whole answer of the oscillator, drawn by the state equations and not by a filter.
    system = signal.StateSpace([[0, 1], [-w * w, -2 * zeta * w]], [[0], [1]], [[w * w, 0]], [[0]])
    term = found_in(lambda s: signal.lsim(system, s.a, s.time)[1] - s.a)
    assert isinstance(term.mechanism, Ringing)
    assert term.mechanism.signal == "a_x"
    assert dict(term.shape)["f"] == pytest.approx(6.0, rel=0.01)
    assert dict(term.shape)["zeta"] == pytest.approx(0.05, rel=0.2)


@pytest.mark.thorough
def test_an_axis_that_rings_after_changes_of_another():
    w, zeta = 2 * np.pi * 4.0, 0.06
    system = signal.StateSpace([[0, 1], [-w * w, -2 * zeta * w]], [[0], [1]], [[w * w, 0]], [[0]])
    term = found_in(lambda s: signal.lsim(system, s.others["y"].a, s.time)[1] - s.others["y"].a)
    assert isinstance(term.mechanism, Ringing)
    assert term.mechanism.signal == "a_y"
    assert dict(term.shape)["f"] == pytest.approx(4.0, rel=0.02)


def column(state, f, zeta, g):
    """What rings after a change of speed, at f Hz where y is zero; by small steps of time, and not by a filter."""
    u, out, x, v, finer = state.a, np.zeros(len(state.time)), 0.0, 0.0, 20
    w = 2 * np.pi * f * np.exp(g * state.places["y"])
    for i in range(1, len(out)):
        for k in range(finer):
            v += STEP / finer * (w[i] ** 2 * (u[i - 1] + (u[i] - u[i - 1]) * k / finer - x) - 2 * zeta * w[i] * v)
            x += STEP / finer * v
        out[i] = x - u[i]
    return out


def test_an_axis_that_rings_faster_the_further_another_is():
    f, zeta, g = 4.0, 0.03, 0.01
    term = found_in(lambda s: column(s, f, zeta, g))
    law, shape = term.mechanism, dict(term.shape)
    assert isinstance(law, RingingAlong)
    assert (law.signal, law.place) == ("a_x", "pos_y")
    assert shape["g"] == pytest.approx(g, rel=0.05)
    assert shape["f"] * np.exp(-g * law.middle) == pytest.approx(f, rel=0.02)
    assert "faster the further pos_y is" in law.conditions("x", shape)[0]


def test_what_rings_alike_everywhere_rings_along_nothing():
    (state,) = axis_states([part(0)], "x")
    shape = {"f": 5.0, "zeta": 0.05}
    along = RingingAlong("a_x", "mm/s²", "pos_y").regressors(state, g=0.0, **shape)
    plain = Ringing("a_x", "mm/s²").regressors(state, **shape)
    later = state.time > 5.0  # how it was before the first sample is not known, and no longer matters
    np.testing.assert_allclose(along[later], plain[later], atol=0.02 * np.std(along))


def test_a_compensation_that_follows_the_warmth_of_its_screw():
    tau, middle = 6.0, 3.0  # s, mm

    def screw(state):
        warm = signal.lsim(([1], [tau, 1]), state.v**2, state.time)[1]
        return (state.pos - middle) * (20.0 - warm)

    term = found_in(screw)
    assert isinstance(term.mechanism, Warped)
    assert (term.mechanism.place, term.mechanism.cause) == ("pos_x", "v_x")
    assert dict(term.shape)["tau"] == pytest.approx(tau, rel=0.2)


def test_drives_that_wind_each_other_up_the_more_the_further_out_their_load_is():
    tau, middle = 1.2, -8.0  # s, mm

    def wound(state):
        return signal.lsim(([1], [tau, 1]), state.v * (state.places["y"] - middle), state.time)[1]

    term = found_in(wound)
    assert term.mechanism == LaggedArm("v_x", "u", "mm/s", "pos_y", "mm")
    assert dict(term.shape)["tau"] == pytest.approx(tau, rel=0.1)


def test_a_current_that_follows_a_speed_late():
    term = found_in(lambda s: signal.lsim(([1], [0.8, 1]), np.abs(s.v), s.time)[1])
    assert isinstance(term.mechanism, Lagged)
    assert (term.mechanism.signal, term.mechanism.form) == ("v_x", "|u|")
    assert dict(term.shape)["tau"] == pytest.approx(0.8, rel=0.15)


@pytest.mark.parametrize("only", ["", "moving"])
def test_what_a_change_of_speed_leaves_and_time_takes_back_is_one_law(only):
    tau = 1.5

    def left(state):
        behind = signal.lsim(([1], [tau, 1]), state.v, state.time)[1]
        return (state.v - behind) * (state.moving if only else 1.0)

    term = found_in(left, stops=True)
    assert isinstance(term.mechanism, Fading)
    assert (term.mechanism.signal, term.mechanism.only) == ("v_x", only)
    assert dict(term.shape)["tau"] == pytest.approx(tau, rel=0.1)


@pytest.mark.thorough
def test_a_filter_that_is_switched_on_for_a_cut_is_one_law_of_the_simulated_current():
    tau = 0.25

    def cuts(k, recording):
        hard = np.convolve(recording["v_y"] * np.sin(0.4 * recording.time), np.ones(20) / 20, "same")
        return recording.with_columns(
            curr_x_sim=0.4 * np.sign(recording["v_x"]) + 0.1 * hard, mrr_sim=10.0 * (recording.time % 8.0 < 5.0)
        )

    def lost(state):
        behind = signal.lsim(([1], [tau, 1]), state.sim, state.time)[1]
        return (behind - state.sim) * state.engaged

    term = found_in(lost, strength=4.0, change=cuts)
    assert isinstance(term.mechanism, Fading)
    assert (term.mechanism.signal, term.mechanism.only) == ("I_x", "cutting")
    assert dict(term.shape)["tau"] == pytest.approx(tau, rel=0.2)


def test_frequency_and_damping_have_intervals_that_hold_the_truth():
    w, zeta = 2 * np.pi * 6.0, 0.05
    system = signal.StateSpace([[0, 1], [-w * w, -2 * zeta * w]], [[0], [1]], [[w * w, 0]], [[0]])
    library, noise = planted(lambda s: signal.lsim(system, s.a, s.time)[1] - s.a)
    terms, _ = with_unknown(library, noise, [], 0)
    terms = settle_shapes(library.mismatch, noise, terms)
    (found,) = estimate(library.mismatch, noise, terms, np.random.default_rng(0)).parameters
    assert found["f"].ci95[0] < 6.0 < found["f"].ci95[1]
    assert found["zeta"].ci95[0] < 0.05 < found["zeta"].ci95[1]
    assert 0.0 < found["f"].ci95[1] - found["f"].ci95[0] < 0.2


@pytest.mark.parametrize(("tau", "other_words"), [(0.0, True), (1.0, False)])
def test_a_lag_of_no_time_is_the_mechanism_itself_in_other_words(tau, other_words):
    library, noise = planted(lambda s: signal.lsim(([1], [tau, 1]), s.v, s.time)[1] if tau else s.v)
    lag = Term(Lagged("v_x", "u", "mm/s"), (("tau", max(tau, 1e-3)),))
    score = library.score(lag, basis(library, noise, []))
    assert is_known(library, noise, score) is other_words


@pytest.mark.parametrize(("tau", "other_words"), [(0.03, True), (1.5, False)])
def test_what_fades_as_soon_as_a_loop_answers_is_inertia_in_other_words(tau, other_words):
    library, noise = planted(lambda s: s.v - signal.lsim(([1], [tau, 1]), s.v, s.time)[1])
    fading = Term(Fading("v_x", "u", "mm/s"), (("tau", tau),))
    assert is_known(library, noise, library.score(fading, basis(library, noise, []))) is other_words


@pytest.mark.parametrize(("tau", "other_words"), [(0.05, True), (3.0, False)])
def test_a_torque_constant_that_follows_a_current_as_soon_as_a_loop_answers_is_saturation(tau, other_words):
    """Heat takes longer: a cube of the current that comes a little late is no warm motor."""

    def loaded(k, recording):
        return recording.with_columns(curr_x_sim=0.4 * np.sign(recording["v_x"]) + 0.05 * recording["a_y"])

    def bent(state):
        return state.sim * signal.lsim(([1], [tau, 1]), state.sim**2, state.time)[1]

    library, noise = planted(bent, change=loaded)
    saturation = next(m for m in CATALOGUE if m.id == "current_saturation")
    library = Library(library.mismatch, [Term(saturation, (("I_k", 1.0), ("form", 2.0)))])
    library.whiten(noise)
    late = Term(Modulated("I_x", "u", "I_x", "u²", "A·A²"), (("tau", tau),))
    assert is_known(library, noise, library.score(late, basis(library, noise, []))) is other_words


def test_a_torque_constant_that_was_taken_at_a_level_of_heat_is_one_law_and_no_gain_beside_it():
    def loaded(k, recording):
        hard = np.convolve(recording["v_y"], np.ones(400) / 400, "same") ** 2
        return recording.with_columns(curr_x_sim=0.4 * np.sign(recording["v_x"]) * (1 + 0.3 * hard))

    def weaker(state):
        heat = signal.lsim(([1], [6.0, 1]), state.sim**2, state.time)[1]
        return state.sim * (heat - 0.3)

    term = found_in(weaker, strength=6.0, change=loaded, rows=6000)
    assert isinstance(term.mechanism, Modulated)
    assert (term.mechanism.signal, term.mechanism.cause, term.mechanism.loss) == ("I_x", "I_x", "u²")
    assert term.mechanism.level


def test_what_lags_may_have_another_size_while_the_tool_cuts():
    (state,) = axis_states([part(0)], "x")
    cutting = replace(state, engaged=state.time > 15.0)
    late, late_cut = Lagged("v_x", "u", "mm/s", by_cut=True).regressors(cutting, tau=0.5).T
    (plain,) = Lagged("v_x", "u", "mm/s").regressors(state, tau=0.5).T
    np.testing.assert_array_equal(late + late_cut, plain)
    np.testing.assert_array_equal(late_cut != 0, (plain != 0) & (state.time > 15.0))


@pytest.mark.parametrize(
    "term",
    [
        Term(Ringing("a_x", "mm/s²"), (("f", 6.0), ("zeta", 0.05))),
        Term(RingingAlong("a_x", "mm/s²", "pos_y", "mm", 3.0, 20.0), (("f", 6.0), ("zeta", 0.05), ("g", 0.01))),
        Term(LaggedArm("v_x", "u", "mm/s", "pos_y", "mm"), (("tau", 0.8),)),
        Term(Warped("pos_x", "mm", "v_x", "|u|", "mm/s"), (("tau", 0.8),)),
        Term(Lagged("v_x", "|u|", "mm/s", by_cut=True), (("tau", 0.8),)),
        Term(Fading("v_x", "u", "mm/s", only="moving"), (("tau", 0.8),)),
        Term(Modulated("v_x", "|u|", "v_y", "u", "(mm/s)·(mm/s)", beside="(mm/s)"), (("tau", 0.8),)),
        Term(Modulated("v_x", "u", "v_x", "u²", "(mm/s)·(mm/s)^2", level="(mm/s)"), (("tau", 0.8),)),
        Term(Wave("v_x", "mm/s", "", "–"), (("L", 3.0),)),
        Term(Rested("x", "s"), (("tau", 2.0), ("L", 0.7))),
        Term(Arm("pos_x", "v_y", "mm/s")),
        Term(Transient("t_go_x", "s", "down"), (("tau", 0.3),)),
        Term(
            Transient("v_x", "mm/s", "both", even=True, level=True, rings=True), (("c", 5.0), ("f", 3.0), ("zeta", 0.1))
        ),
        Term(Latched("v_x", "mm/s", even=True), (("c", 5.0), ("T", 0.3))),
        Term(Switched("v_y", "mm/s", True, "v_x", "mm/s", "sgn u"), (("c_on", 5.0), ("c_off", 1.0))),
    ],
)
def test_a_model_that_remembers_comes_back_from_its_file(term):
    model = AxisModel("x", NOISE, (term,), (np.linspace(0.1, 0.4, len(term.mechanism.amplitudes)),))
    (state,) = axis_states([part(0)], "x")
    again = axis_models(as_json({"x": model}))["x"]
    assert again.terms == model.terms
    expected = model.effect(np.zeros(len(state.time)), part(0), state)
    assert again.effect(np.zeros(len(state.time)), part(0), state) == pytest.approx(expected)
    assert np.std(expected) > 0


@pytest.mark.parametrize(
    ("own", "law"),
    [
        ({"heats": "I_x"}, Modulated("I_x", "u", "I_x", "u²", "(A)·(A)^2")),
        ({"waves": "pos_y", "signal": "", "unit": "–"}, Wave("pos_y", "mm", "", "–")),
        ({"waves": "pos_sp", "signal": "", "unit": "–"}, Wave("pos_sp", "deg", "", "–")),
    ],
)
def test_models_of_before_are_read(own, law):
    data = as_json({"x": AxisModel("x", NOISE, (Term(Lagged("v_x", "u", "mm/s"), (("tau", 1.0),)),), (np.ones(1),))})
    data["axes"]["x"]["terms"][0]["mechanism"] = {"id": "unknown", **own}
    assert axis_models(data)["x"].terms[0].mechanism == law


def test_a_mechanism_that_has_more_forms_since_reads_the_numbers_of_before():
    along = Term(next(m for m in CATALOGUE if m.id == "position_dependent_friction"))
    along = along.with_shape(form=1.0, L=20.0, p_0=0.0, rest=0.0)
    numbers = np.zeros(len(along.mechanism.amplitudes))
    numbers[:3] = 0.1, 0.2, 0.3
    data = as_json({"x": AxisModel("x", NOISE, (along,), (numbers,))})
    data["axes"]["x"]["terms"][0]["amplitudes"] = [0.1, 0.2, 0.3]
    np.testing.assert_array_equal(axis_models(data)["x"].amplitudes[0], numbers)


def test_a_friction_that_its_heat_changes_from_a_level_of_its_own_is_one_law():
    tau, level = 4.0, 12.0  # s, mm²/s²

    def law(state):
        return state.v * (signal.lsim(([1], [tau, 1]), state.v**2, state.time)[1] - level)

    term = found_in(law)
    assert term.mechanism == Modulated("v_x", "u", "v_x", "u²", "(mm/s)·(mm/s)^2", level="(mm/s)")
    assert dict(term.shape)["tau"] == pytest.approx(tau, rel=0.15)


def test_a_torque_constant_that_falls_as_the_winding_warms_is_one_law_and_no_gain():
    tau, parts = 12.0, [part(k) for k in range(3)]
    rng = np.random.default_rng(0)
    states, recorded = [], []
    for p in parts:
        idle = np.where(p.time % 20.0 < 8.0, 0.3, 1.0)
        current = idle * (0.4 * np.sign(p["v_x"]) + 0.1 * p["v_x"])
        heat = np.full(len(current), current[0] ** 2)
        for i in range(1, len(heat)):
            heat[i] = heat[i - 1] + STEP / tau * (current[i] ** 2 - heat[i - 1])
        states += axis_states([p.with_columns(curr_x_sim=current)], "x")
        recorded.append(0.1 * current * heat + rng.normal(0, NOISE, len(heat)))
    mismatch = lay_out(states, recorded)
    noise = white(mismatch)
    library = Library(mismatch, [Term(next(m for m in CATALOGUE if m.id == "sensor_gain"))])
    library.whiten(noise)
    (term,), _ = with_unknown(library, noise, [library.terms[0]], 0)
    assert term.mechanism == Modulated("I_x", "u", "I_x", "u²", "(A)·(A)^2")
    assert dict(term.shape)["tau"] == pytest.approx(tau, rel=0.1)
    model = AxisModel("x", NOISE, (term,), (np.array([0.1]),))
    assert axis_models(as_json({"x": model}))["x"].terms == (term,)
