"""What a current could depend on beside the columns themselves, and laws over it that are found without a name."""

from dataclasses import replace

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.arms import Arm, Eased
from pido.diagnosis.flexible import Coarse
from pido.diagnosis.formulas import Formula
from pido.diagnosis.late import Lagged, Modulated
from pido.diagnosis.library import Library, basis
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.models import AxisModel, as_json, axis_models
from pido.diagnosis.rested import Rested
from pido.diagnosis.signals import signals
from pido.diagnosis.state import AxisState, axis_states
from pido.diagnosis.terms import Term, fit
from pido.diagnosis.unnamed import of_fewer_quantities, with_unknown
from pido.diagnosis.waves import Wave, waves
from tests.diagnosis.planted import NOISE, VISCOUS, found_in, part, planted, white


def state_of(**columns) -> AxisState:
    n = len(columns["v_x"])
    info = PartInfo(part="p", machine="m", order=1)
    return axis_states([Recording(info, {"time": np.arange(n) * 0.01, **columns})], "x")[0]


def test_on_a_circle_all_acceleration_is_across_the_path():
    t = np.arange(1000) * 0.01
    v, w = 20.0, 1.5
    state = state_of(
        v_x=v * np.cos(w * t), a_x=-v * w * np.sin(w * t), v_y=v * np.sin(w * t), a_y=v * w * np.cos(w * t)
    )
    across, unit = signals(state)["a_n"]
    assert unit == "mm/s²"
    np.testing.assert_allclose(across, v * w, rtol=1e-9)


@pytest.mark.parametrize("way_round", [1.0, -1.0])
def test_a_circle_has_the_curvature_of_its_radius_to_its_side(way_round):
    t = np.arange(1000) * 0.01
    v, w = 20.0, 1.5 * way_round
    circle = {"v_x": v * np.cos(w * t), "a_x": -v * w * np.sin(w * t)}
    across = {"v_y": v * np.sin(w * t), "a_y": v * w * np.cos(w * t)}
    curvature, unit = signals(state_of(**circle, **across))["kappa"]
    assert unit == "1/mm"
    np.testing.assert_allclose(curvature, w / v, rtol=1e-9)
    assert "kappa" not in signals(state_of(**circle))


def test_what_creeps_turns_to_no_side_and_a_corner_has_no_radius():
    along, across = np.r_[np.full(50, 0.5), np.full(50, 10.0)], np.full(100, 400.0)
    still = np.zeros(100)
    curvature = signals(state_of(v_x=along, a_x=still, v_y=still, a_y=across), ["kappa"])["kappa"][0]
    np.testing.assert_allclose(curvature, np.r_[np.zeros(50), np.ones(50)])


def test_feed_per_revolution_is_none_while_the_spindle_stands():
    spindle = np.r_[np.zeros(10), np.full(90, 36_000.0)]  # 100 revolutions a second
    state = state_of(v_x=np.full(100, 3.0), v_y=np.full(100, 4.0), v_sp=spindle)
    np.testing.assert_allclose(signals(state)["feed_rev"][0], np.r_[np.zeros(10), np.full(90, 0.05)])


def test_time_since_the_start_rest_before_it_and_way():
    speed = np.r_[np.zeros(100), np.full(50, 5.0), np.zeros(200), np.full(50, -5.0)]
    known = signals(state_of(v_x=speed), ["t_go_x", "stood_x", "rested_x", "way_x"])
    began = known["t_go_x"][0]
    assert began[120] == pytest.approx(0.20)
    assert began[200] == 0.0
    assert began[360] == pytest.approx(0.10)
    stood = known["stood_x"][0]
    assert stood[120] == 0.0
    assert stood[200] == pytest.approx(0.50)
    rested = known["rested_x"][0]
    assert (rested[50], rested[200]) == (0.0, 0.0)
    assert rested[120] == pytest.approx(1.0)
    assert rested[360] == pytest.approx(2.0)
    assert known["way_x"][0][-1] == pytest.approx(5.0)


def test_thinned_rows_know_the_same_way_and_jerk_as_all_rows():
    t = np.arange(2000) * 0.01
    state = state_of(v_x=20.0 * np.sin(t), a_x=20.0 * np.cos(t))
    stride = 5
    (thin,) = lay_out([state], [np.zeros(len(t))], stride=stride).states
    known, whole = signals(thin, ["way_x", "j_x"]), signals(state, ["way_x"])
    np.testing.assert_allclose(known["way_x"][0], whole["way_x"][0][stride // 2 :: stride])
    np.testing.assert_allclose(known["j_x"][0][1:-1], -20.0 * np.sin(thin.time)[1:-1], atol=0.02)


def test_a_supply_is_loaded_by_all_axes_together():
    load = {f"curr_{a}_sim": np.full(50, i) for a, i in zip("xyz", (1.0, -2.0, 0.5), strict=True)}
    state = state_of(v_x=np.ones(50), **load)
    np.testing.assert_allclose(signals(state)["I_all"][0], 3.5)


def test_what_repeats_itself_along_the_way_since_a_reversal_is_one_law_with_its_period():
    def teeth(state):
        return np.nan_to_num(state.since_reversal, posinf=0.0) / 3.1 % 1.0 - 0.5

    term = found_in(teeth, strength=6.0)
    assert isinstance(term.mechanism, Wave)
    assert term.mechanism.place == "d_x"
    assert term.mechanism.harmonics > 1
    assert dict(term.shape)["L"] == pytest.approx(3.1, rel=0.01)
    model = AxisModel("x", NOISE, (term,), (np.ones(len(term.mechanism.amplitudes)),))
    assert axis_models(as_json({"x": model}))["x"].terms == (term,)


def test_a_drag_that_grows_until_the_guideway_is_greased_repeats_along_the_way():
    def greased(state):
        way = np.cumsum(np.abs(state.v) * state.moving) * 0.01
        return ((way / 40.0 % 1.0) ** 2 - 1 / 3) * state.held  # beside what it is on average

    term = found_in(greased, strength=4.0)
    assert isinstance(term.mechanism, Wave)
    assert (term.mechanism.place, term.mechanism.signal) == ("way_x", "held_x")
    assert dict(term.shape)["L"] == pytest.approx(40.0, rel=0.02)


def test_a_speed_within_the_dead_band_is_none_of_any_axis():
    rng = np.random.default_rng(2)
    speed = np.r_[np.full(300, 5.0), np.zeros(300), np.full(300, -5.0), np.zeros(300)]
    noisy = {f"v_{axis}": speed + rng.normal(0, 0.01, len(speed)) for axis in "xy"}
    known = signals(state_of(**noisy), ["v_x", "v_y"])
    for name, recorded in noisy.items():
        np.testing.assert_array_equal(known[name][0], np.where(speed == 0, 0.0, recorded))


def test_a_friction_that_repeats_along_the_way_and_holds_nothing_at_rest_is_carried_by_the_sign_of_the_speed():
    def lame_ball(state):
        return np.sin(2 * np.pi * state.way / 4.3) * state.held * state.moving

    term = found_in(lame_ball, stops=True)
    assert isinstance(term.mechanism, Wave)
    assert (term.mechanism.place, term.mechanism.signal, term.mechanism.form) == ("way_x", "v_x", "sgn u")
    assert term.mechanism.equation.endswith("* sgn(v_x)")
    model = AxisModel("x", NOISE, (term,), (np.ones(len(term.mechanism.amplitudes)),))
    assert axis_models(as_json({"x": model}))["x"].terms == (term,)


def test_a_film_that_another_axis_lifts_eases_a_friction_by_one_law():
    def lifted(state):
        return (np.exp(-np.abs(state.others["y"].v) / 1.2) - 0.4) * state.held * state.moving

    term = found_in(lifted, strength=4.0, stops=True)
    assert term.mechanism == Eased("v_y", "v_x", "sgn u", "mm/s", "mm/s")
    assert dict(term.shape)["c"] == pytest.approx(1.2, rel=0.15)
    model = AxisModel("x", NOISE, (term,), (np.ones(2),))
    assert axis_models(as_json({"x": model}))["x"].terms == (term,)


def test_a_load_that_coolant_eases_is_one_law_beside_what_the_simulation_takes_for_its_mean():
    states = axis_states([part(k) for k in range(4)], "x")
    rng = np.random.default_rng(1)
    states = [
        replace(
            s, force=rng.normal(40, 15, len(s.v)), coolant=(np.arange(len(s.v)) // (400 + 90 * k) % 2).astype(float)
        )
        for k, s in enumerate(states)
    ]
    states = [replace(s, forces={"x": s.force}) for s in states]
    mismatch = lay_out(states, [0.004 * s.force * (0.45 - s.coolant) + rng.normal(0, NOISE, len(s.v)) for s in states])
    noise = white(mismatch)
    library = Library(mismatch, [Term(VISCOUS)])
    library.whiten(noise)
    (term,), _ = with_unknown(library, noise, [], 0)
    assert term.mechanism == Arm("coolant", "f_x", "N", "–")
    assert term.mechanism.equation == "dI = (k_0 + k_1 * coolant) * f_x"
    np.testing.assert_allclose(fit(mismatch, noise, [term]).amplitudes[0], [0.0018, -0.004], rtol=0.1)


def test_a_few_places_are_no_wave():
    """What differs from level to level of the tool is met by some wave, whatever it is."""
    rng = np.random.default_rng(3)
    level = np.repeat([0.0, 3.1, 8.7, 13.2], 500)
    rows, part_of = np.arange(2000), np.zeros(2000, int)
    few = Coarse(rows, part_of, level % 2.0 + rng.normal(0, 0.1, 2000), np.ones(2000))
    moved = level + rng.uniform(-0.05, 0.05, 2000)
    everywhere = rng.uniform(0, 13.2, 2000)
    wave = Coarse(rows, part_of, np.sin(2 * np.pi * everywhere / 3.0), few.weights)
    assert waves("x", {"pos_z": (moved, "mm")}, few) == []
    ((_, term),) = waves("x", {"pos_z": (everywhere, "mm")}, wave)
    assert dict(term.shape)["L"] == pytest.approx(3.0, rel=0.04)


def test_what_repeats_itself_over_the_speed_is_one_law_and_not_a_name_for_every_speed():
    term = found_in(lambda s: np.sin(2 * np.pi * s.v / 3.3))
    assert isinstance(term.mechanism, Wave)
    assert (term.mechanism.place, term.mechanism.signal) == ("v_x", "")
    assert dict(term.shape)["L"] == pytest.approx(3.3, rel=0.01)


def test_a_drive_that_hunts_while_its_axis_stands_is_one_law_with_its_period():
    def hunts(state):
        stood = signals(state, ["stood_x"])["stood_x"][0]
        return (2 * np.abs(2 * (stood / 0.31 % 1.0) - 1) - 1) * state.held * (stood > 0)

    term = found_in(hunts, strength=1.0, stops=True)
    assert isinstance(term.mechanism, Wave)
    assert (term.mechanism.place, term.mechanism.signal) == ("stood_x", "held_x")
    assert dict(term.shape)["L"] == pytest.approx(0.31, rel=0.01)


def test_a_belt_that_runs_out_of_true_is_felt_with_the_load_on_it():
    states = [replace(s, sim=1.5 * np.sign(s.v) + 0.02 * s.a) for s in axis_states([part(k) for k in range(3)], "x")]
    rng = np.random.default_rng(0)
    belt = [0.1 * s.sim * np.cos(2 * np.pi * s.pos / 7.7 + 1) for s in states]
    mismatch = lay_out(states, [b + rng.normal(0, NOISE, len(b)) for b in belt])
    noise = white(mismatch)
    library = Library(mismatch, [])
    library.whiten(noise)
    (term,), _ = with_unknown(library, noise, [], 0)
    assert isinstance(term.mechanism, Wave)
    assert (term.mechanism.place, term.mechanism.signal) == ("pos_x", "I_x")
    assert dict(term.shape)["L"] == pytest.approx(7.7, rel=0.01)


def test_a_friction_that_rest_builds_up_and_way_takes_away_is_one_law():
    def settled(state):
        z, out = 0.0, np.zeros(len(state.v))
        for i, (v, moves) in enumerate(zip(state.v, state.moving, strict=True)):
            z = z * np.exp(-abs(v) * 0.01 / 5.0) if moves else 1 - (1 - z) * np.exp(-0.01 / 1.6)
            out[i] = z * np.sign(v) * moves
        return out

    term = found_in(settled, strength=6.0, stops=True)
    assert term.mechanism == Rested("x", "mm")
    assert dict(term.shape) == {"tau": pytest.approx(1.6, rel=0.1), "L": pytest.approx(5.0, rel=0.1)}


def test_where_a_speed_is_missing_what_rest_built_up_stays():
    speed = np.r_[np.zeros(50), np.full(50, 4.0), np.full(10, np.nan), np.full(90, 4.0)]
    for unit in ("mm", "s"):
        felt = Rested("x", unit).regressors(state_of(v_x=speed, a_x=np.zeros(200)), tau=1.0, L=3.0)[:, 0]
        assert np.isfinite(felt).all()
        assert felt[50] > felt[99] > felt[-1] > 0.0
        np.testing.assert_array_equal(felt[100:110], 0.0)


def test_a_drive_that_is_weak_where_its_current_turns_is_a_curve_over_the_current():
    states = [
        replace(s, sim=4.0 * np.sin(2 * np.pi * 0.11 * s.time) * np.sign(s.v) + 0.02 * s.a)
        for s in axis_states([part(k) for k in range(3)], "x")
    ]
    rng = np.random.default_rng(0)
    lost = [-0.3 * s.sim * np.exp(-((s.sim / 1.0) ** 2)) for s in states]
    mismatch = lay_out(states, [e + rng.normal(0, NOISE, len(e)) for e in lost])
    noise = white(mismatch)
    library = Library(mismatch, [])
    library.whiten(noise)
    (term,), _ = with_unknown(library, noise, [], 0)
    assert term.mechanism.reads == {"I_x"}
    joint = fit(mismatch, noise, [term])
    assert np.std(joint.residual) == pytest.approx(NOISE, rel=0.1)


def test_what_another_quantity_has_been_lately_is_felt_more_at_speed():
    def surge(state):
        feed = signals(state, ["feed"])["feed"][0]
        lately = np.full(len(feed), feed[0])
        for i in range(1, len(feed)):
            lately[i] = lately[i - 1] + 0.01 / 1.2 * (feed[i] - lately[i - 1])
        return lately * (0.4 + 0.1 * np.abs(state.v))

    term = found_in(surge, strength=6.0)
    law = term.mechanism
    assert isinstance(law, Modulated)
    assert (law.signal, law.form, law.cause, law.beside) == ("v_x", "|u|", "feed", "(mm/s)")
    assert dict(term.shape)["tau"] == pytest.approx(1.2, rel=0.1)
    assert [a.unit for a in law.amplitudes] == ["A/((mm/s)·(mm/s))", "A/(mm/s)"]
    assert law.equation == "dI = (k_0 + k * |v_x|) * (feed / (1 + tau s))"


def test_a_friction_that_its_own_heat_thins_is_one_law_with_its_time_constant():
    def thinned(state):
        heat, out = abs(state.v[0]), np.zeros(len(state.v))
        for i, v in enumerate(state.v):
            heat += 0.01 / 2.0 * (abs(v) - heat)
            out[i] = -v * heat
        return out

    term = found_in(thinned, strength=6.0, stops=True)
    assert isinstance(term.mechanism, Modulated)
    law = term.mechanism
    assert (law.signal, law.form, law.cause, law.loss) == ("v_x", "u", "v_x", "|u|")
    assert dict(term.shape)["tau"] == pytest.approx(2.0, rel=0.1)


def test_what_acts_late_counts_from_a_level_of_its_own():
    def late(state):
        out, level = np.zeros(len(state.v)), 0.0
        for i, v in enumerate(np.abs(state.v)):
            level += 0.01 / 2.0 * (v - level)
            out[i] = level - 9.0
        return out

    term = found_in(late, strength=6.0)
    assert isinstance(term.mechanism, Lagged)
    assert (term.mechanism.signal, term.mechanism.form, term.mechanism.level) == ("v_x", "|u|", True)
    assert dict(term.shape)["tau"] == pytest.approx(2.0, rel=0.15)


def test_a_law_is_judged_alike_in_whatever_unit_its_quantity_is_large():
    def judged(times):
        states = [replace(s, a=times * s.a) for s in axis_states([part(k) for k in range(2)], "x")]
        target = [1e-6 * (s.a / times) ** 3 + np.random.default_rng(0).normal(0, NOISE, len(s.a)) for s in states]
        mismatch = lay_out(states, target)
        noise = white(mismatch)
        library = Library(mismatch, [])
        library.whiten(noise)
        cube = Term(Formula((("a_x", "u³"),), "(mm/s²)^3"))
        return library.score(cube, basis(library, noise, [])).gain

    assert judged(1e10) == pytest.approx(judged(1.0), rel=1e-4)


def test_a_product_has_no_factor_without_which_it_is_as_likely():
    def loaded(k, recording):
        turns = np.where(np.abs(recording["v_x"]) < 0.1, -1.0, 1.0)  # where the cube of the speed is nothing
        return Recording(recording.part, {**recording.columns, "curr_x_sim": turns, "curr_y_sim": turns})

    library, noise = planted(lambda s: s.v**3, change=loaded)
    current = basis(library, noise, [])
    cube = Formula((("v_x", "u³"),), "(mm/s)^3")
    product = Formula((("v_x", "u³"), ("I_y", "sgn u")), "(mm/s)^3")
    score = library.score(Term(product), current)
    assert of_fewer_quantities(library, noise, current, score).term.mechanism == cube
    needed = Formula((("v_x", "u²"), ("v_x", "sgn u")), "(mm/s)^2")
    score = library.score(Term(needed), current)
    assert of_fewer_quantities(library, noise, current, score).term.mechanism == needed


def test_a_corner_that_loads_an_axis_is_a_law_of_what_turns_the_path():
    term = found_in(lambda s: signals(s, ["a_n"])["a_n"][0])
    assert isinstance(term.mechanism, Formula)
    assert term.mechanism.reads == {"a_n"}
    assert [p.unit for p in term.mechanism.amplitudes] == ["A/(mm/s²)"]


def test_what_turns_of_the_path_do_to_the_left_and_to_the_right_is_a_law_of_its_curvature():
    term = found_in(lambda s: np.tanh(signals(s, ["kappa"])["kappa"][0] / 0.1))
    assert term.mechanism.reads == {"kappa"}


def test_a_workpiece_gets_lighter_by_what_was_removed_of_it():
    def cuts(k, recording):
        rate = np.where(np.arange(len(recording.time)) // 300 % 2, 100.0 + 40 * k, 0.0)
        return Recording(recording.part, {**recording.columns, "mrr_sim": rate})

    def lighter(state):
        return -state.a * np.cumsum(state.mrr)

    assert found_in(lighter, change=cuts).mechanism.equation == "dI = k * a_x * removed"
