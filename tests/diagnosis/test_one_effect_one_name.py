"""One effect gets one name: what mends the form of a finding, or takes another one back, is no finding of its own."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from pido.diagnosis.confirm import even, plain_error
from pido.diagnosis.contained import contained
from pido.diagnosis.diagnose import diagnose, proved, settled
from pido.diagnosis.forms import fewest, likelier, plainest
from pido.diagnosis.gates import Gate
from pido.diagnosis.identify import Answer, confirm, seen_slowly, select_terms
from pido.diagnosis.library import Library
from pido.diagnosis.loop import answered
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mismatch import Mismatch, lay_out
from pido.diagnosis.search import first_look, search
from pido.diagnosis.select import grid_terms
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term, fit
from pido.diagnosis.whiten import Noise, estimate_noise
from pido.physics.drive import answered_late
from pido.physics.friction import dahl_state
from tests.diagnosis.feeds import BY_ID, NOISE, laid_out, recordings
from tests.diagnosis.planted import part, planted

pytestmark = pytest.mark.thorough


def test_friction_at_low_speed_that_a_control_loop_delays_is_one_finding():
    def delayed(state):
        friction = 0.3 * np.exp(-((state.v / 2.0) ** 2)) * state.held
        return lfilter([0.3], [1, -0.7], friction)

    rng = np.random.default_rng(0)
    answer = search(first_look(laid_out(delayed)[0], rng), 1, False, rng)
    assert [t.name for t in answer.terms] == ["stribeck_friction"]


@pytest.mark.parametrize(
    ("law", "name"),
    [
        (lambda s: 0.2 * np.sign(s.v) * s.moving, "miscalibrated:coulomb_friction"),
        (lambda s: 0.1 * s.held * ~s.moving, "standstill_friction"),
        (lambda s: 0.2 * np.exp(-s.since_reversal / 0.05) * s.held * s.moving, "backlash"),
        (lambda s: 0.004 * s.a, "miscalibrated:inertia"),
        (lambda s: 0.015 * np.abs(s.v), "friction_asymmetry"),  # asked at once, a law without a name that is late
    ],
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_a_law_that_a_drive_answers_late_is_one_finding_by_its_own_name(law, name):
    mismatch, _ = laid_out(lambda s: answered_late(law(s)[None], s.time, 0.02)[0])
    rng = np.random.default_rng(0)
    (term,) = search(first_look(mismatch, rng), 1, False, rng).terms
    assert term.name == name
    late = answered(mismatch, even(mismatch), [term])
    assert late[0].lag == pytest.approx(0.02, rel=0.1)


def test_friction_that_is_more_in_one_direction_and_a_little_less_in_the_other_is_one_asymmetry():
    mismatch, _ = laid_out(lambda s: 0.03 * (np.maximum(s.v, 0.0) - 0.3 * np.minimum(s.v, 0.0)))
    rng = np.random.default_rng(0)
    (term,) = search(first_look(mismatch, rng), 1, False, rng).terms
    assert term.name == "friction_asymmetry"
    shape = dict(term.shape)
    assert shape["side"] == 3
    assert shape["back"] == pytest.approx(-0.3, abs=0.1)


def test_friction_that_is_held_at_once_and_answered_late_is_one_finding():
    mismatch, _ = laid_out(lambda s: answered_late(0.2 * s.held[None] + 0.02 * s.v, s.time, 0.04)[0])
    rng = np.random.default_rng(0)
    answer = search(first_look(without_friction(mismatch), rng), 1, False, rng)
    assert {t.name for t in answer.terms} == {"coulomb_friction", "viscous_friction"}
    assert all(t.lag == pytest.approx(0.04, rel=0.1) for t in answer.terms)


def without_friction(mismatch: Mismatch) -> Mismatch:
    """The same, against a simulation that has no friction."""
    states = [replace(s, sim=0.004 * s.a) for s in mismatch.states]
    return lay_out(states, np.split(mismatch.target, mismatch.edges[1:-1]))


@pytest.mark.parametrize(
    ("way", "name"), [(0.02, "coulomb_friction"), (0.2, "presliding_hysteresis"), (1.0, "presliding_hysteresis")]
)
def test_friction_that_turns_over_a_long_way_is_one_finding_by_that_name(way, name):
    mismatch, _ = laid_out(lambda s: 0.2 * dahl_state(s.held, s.since_reversal, s.segment, way))
    rng = np.random.default_rng(0)
    answer = search(first_look(without_friction(mismatch), rng), 1, False, rng)
    assert [t.name for t in answer.terms] == [name]


def test_the_pieces_of_a_friction_that_turns_over_a_long_way_are_put_together_by_that_name():
    def slips(state):  # two Maxwell elements
        early, late = (dahl_state(state.held, state.since_reversal, state.segment, way) for way in (0.03, 0.4))
        return 0.05 * (0.6 * early + 0.4 * late)

    mismatch, noise = laid_out(slips)
    mismatch = without_friction(mismatch)
    pieces = [
        Term(BY_ID["presliding_hysteresis"], (("x_0", 0.15), ("full", 0.0))),
        Term(BY_ID["coulomb_friction"], (("rest", 0.0),)),
        Term(BY_ID["standstill_friction"], (("rest", 0.0),)),
    ]
    library = Library(mismatch, [g for t in pieces for g in grid_terms(t.mechanism, mismatch.states)])
    library.whiten(noise)
    (term,) = fewest(library, noise, pieces)
    assert term.name == "presliding_hysteresis"
    assert dict(term.shape)["full"] == 1.0


def test_a_form_that_is_nothing_in_these_recordings_is_no_plainer_form():
    """`axis_coupling` of x with x itself comes first in its list."""
    library, noise = planted(lambda s: s.pos, strength=1e-6)
    mechanism = BY_ID["axis_coupling"]
    felt = Term(mechanism, (("source", 4.0),))  # speed of y, which does nothing here
    (term,) = plainest(library, noise, [felt])
    assert np.any(term.columns(library.mismatch.states))


def test_a_ripple_that_a_drive_answers_late_is_no_friction_along_the_travel():
    mismatch, _ = laid_out(lambda s: 0.1 * np.sin(2 * np.pi * (s.pos - 0.03 * s.v) / 5.0))
    rng = np.random.default_rng(0)
    (term,) = search(first_look(mismatch, rng), 1, False, rng).terms
    assert term.name == "torque_ripple"
    assert dict(term.shape)["L"] == pytest.approx(5.0, abs=0.01)
    assert dict(term.shape)["late"] == pytest.approx(0.03, abs=0.005)
    assert "p = pos - late * v" in term.mechanism.equation_in("x", dict(term.shape))


def test_what_acts_at_reversals_stays_beside_a_weight_that_removes_nearly_all():
    def weighed(state):
        turned = np.minimum(state.since_reversal / 0.05, 50.0)
        return 0.4 - 0.06 * np.exp(-turned) * state.held * state.moving

    mismatch, noise = laid_out(weighed)
    weight = Term(BY_ID["gravity_load"], (("by_tool", 0.0),))
    lost = Term(BY_ID["backlash"], tuple({**BY_ID["backlash"].starts(mismatch.states)[0], "gap": 0.05}.items()))
    library = Library(mismatch, [weight, lost])
    library.whiten(noise)
    assert plain_error(mismatch, [weight]) < 1.15 * plain_error(mismatch, [weight, lost])
    assert fewest(library, noise, [weight, lost]) == [weight, lost]


def test_two_findings_that_take_each_other_back_do_not_both_stand():
    mismatch, noise = laid_out(lambda s: 0.4 * np.clip(s.sim, -0.05, 0.05))
    gain, bent = Term(BY_ID["sensor_gain"]), Term(BY_ID["current_saturation"], (("I_k", 0.05), ("form", 0.0)))
    library = Library(mismatch, [gain, bent])
    library.whiten(noise)
    assert len(confirm(library, noise, [gain, bent], Answer("x"), 2)) < 2


def test_a_drift_that_is_nearly_all_mean_is_the_steady_load():
    mismatch, noise = laid_out(lambda s: 0.03 * s.held * s.moving)
    drift = Term(BY_ID["thermal_drift"], (("tau", 4000.0), ("clock", 0.0), ("along", 1.0), ("rises", 0.0)))
    library = Library(mismatch, [drift, Term(BY_ID["coulomb_friction"])])
    library.whiten(noise)
    assert [t.name for t in plainest(library, noise, [drift])] == ["coulomb_friction"]


def test_a_drift_that_is_nearly_all_mean_is_the_steady_load_in_a_second_box():
    forward, back = (Gate("v_x", low=2.0),), (Gate("v_x", high=-2.0),)
    mismatch, noise = laid_out(lambda s: np.where(s.v > 2.0, 0.1, np.where(s.v < -2.0, -0.06, 0.0)))
    drift = Term(BY_ID["thermal_drift"], (("tau", 4000.0), ("clock", 0.0), ("along", 1.0), ("rises", 0.0)), back)
    steady = Term(BY_ID["coulomb_friction"], (), forward)
    library = Library(mismatch, [drift, Term(BY_ID["coulomb_friction"])])
    library.whiten(noise)
    found = plainest(library, noise, [steady, drift])
    assert [(t.name, t.gates) for t in found] == [("coulomb_friction", forward), ("coulomb_friction", back)]


@pytest.mark.parametrize(
    ("along", "gates", "name"),
    [
        (1.0, (Gate("AR", high=3.0),), "coulomb_friction"),
        (1.0, (Gate("v_x", low=2.0),), "edge_force"),
        (1.0, (), "edge_force"),
        (0.0, (Gate("AR", high=3.0),), "edge_force"),
    ],
)
def test_a_sign_of_the_motion_in_cuts_of_some_areas_is_a_friction(along, gates, name):
    states = []
    for s in axis_states([part(0), part(1)], "x"):
        ar = np.where(np.arange(len(s.time)) % 400 < 250, 1.0 + 4.0 * np.sin(0.01 * np.arange(len(s.time))) ** 2, 0.0)
        states.append(replace(s, ar=ar, engaged=ar > 0))
    edge = Term(BY_ID["edge_force"], (("along", along), ("length", 0.0)), gates)
    rng = np.random.default_rng(5)
    mismatch = lay_out(states, [0.3 * edge.of_part(s)[0] + rng.normal(0, NOISE, len(s.time)) for s in states])
    library = Library(mismatch, [Term(BY_ID["coulomb_friction"])])
    noise = Noise(np.zeros(0), np.full(mismatch.n, NOISE), 1.0, mismatch.usable)
    library.whiten(noise)
    (found,) = plainest(library, noise, [edge])
    assert found.name == name
    assert np.allclose(library.columns(found), library.columns(edge))


def test_a_load_that_fades_a_little_is_no_wrong_zero_of_a_sensor():
    mismatch, noise = laid_out(lambda s: 0.1 * np.exp(-s.time / 60.0))
    drift = Term(BY_ID["thermal_drift"], (("tau", 60.0), ("clock", 0.0), ("along", 0.0), ("rises", 0.0)))
    library = Library(mismatch, [drift, Term(BY_ID["sensor_offset"])])
    library.whiten(noise)
    assert [t.name for t in plainest(library, noise, [drift])] == ["thermal_drift"]


def test_a_law_gives_way_to_one_with_more_numbers_only_where_this_removes_more():
    mismatch, noise = laid_out(lambda s: 1e-5 * s.v * np.exp(-s.time / 400.0), "sp")
    drift = Term(BY_ID["thermal_drift"], (("tau", 400.0), ("clock", 0.0), ("along", 2.0), ("rises", 0.0)))
    drag = Term(BY_ID["spindle_viscous_drag"])
    library = Library(mismatch, [drag, drift])
    library.whiten(noise)
    assert [t.name for t in likelier(library, noise, [drag])] == ["spindle_viscous_drag"]


@pytest.mark.parametrize(("since", "name"), [(3600.0, "cutting_force"), (0.0, "tool_wear")])
def test_a_cutting_load_that_hardly_grows_is_no_wear(since, name):
    cut = {"engaged": np.ones(3000, bool), "force": 100.0 * np.sin(0.3 * np.arange(3000))}
    states = [replace(s, **cut, cut_time=since + s.time) for s in axis_states([part(0), part(1)], "x")]
    rng = np.random.default_rng(3)
    wear = Term(BY_ID["tool_wear"], (("by", 1.0), ("of", 0.0)))
    effects = [wear.of_part(s)[0] for s in states]
    size = 0.1 / np.std(np.concatenate(effects))
    mismatch = lay_out(states, [size * e + rng.normal(0, NOISE, len(e)) for e in effects])
    noise = Noise(np.zeros(0), np.full(mismatch.n, NOISE), 1.0, mismatch.usable)
    library = Library(mismatch, [wear, Term(BY_ID["cutting_force"])])
    library.whiten(noise)
    assert [t.name for t in plainest(library, noise, [wear])] == [name]
    assert [t.name for t in likelier(library, noise, [Term(BY_ID["cutting_force"])])] == [name]


def test_a_drift_that_drifts_stays_one():
    mismatch, noise = laid_out(lambda s: 0.1 * np.exp(-s.time / 10.0) * s.held * s.moving)
    drift = Term(BY_ID["thermal_drift"], (("tau", 10.0), ("clock", 0.0), ("along", 1.0), ("rises", 0.0)))
    library = Library(mismatch, [drift, Term(BY_ID["coulomb_friction"])])
    library.whiten(noise)
    assert [t.name for t in plainest(library, noise, [drift])] == ["thermal_drift"]


def along_the_travel(swing):
    """Names for a friction of 0.3 A that changes by up to `swing` of itself along the travel, and the steady part."""
    low, high = (f(r["pos_x"] for r in recordings()) for f in (lambda p: min(map(min, p)), lambda p: max(map(max, p))))
    middle, half = (low + high) / 2, (high - low) / 2
    mismatch, noise = laid_out(lambda s: 0.3 * (1 + swing * (s.pos - middle) / half) * s.held * s.moving)
    places = Term(BY_ID["position_dependent_friction"], (("form", 1.0), ("L", half), ("p_0", middle)))
    library = Library(mismatch, [places, Term(BY_ID["coulomb_friction"])])
    library.whiten(noise)
    answer = Answer("x")
    terms = confirm(library, noise, plainest(library, noise, [places]), answer, 2)
    steady = [float(a[0]) for t, a in zip(terms, fit(mismatch, noise, terms).amplitudes, strict=True)
              if t.name == "coulomb_friction"]  # fmt: skip
    return [t.name for t in terms], steady


def test_friction_that_varies_little_along_the_travel_is_steady_first_and_what_varies_is_a_finding_of_its_own():
    names, (steady,) = along_the_travel(0.35)
    assert names == ["coulomb_friction", "position_dependent_friction"]
    assert steady == pytest.approx(0.3, rel=0.05)


def test_friction_that_varies_as_much_as_it_is_is_one_finding():
    assert along_the_travel(1.0) == (["position_dependent_friction"], [])


def test_a_gain_that_a_wrong_coefficient_takes_back_for_a_part_is_no_gain():
    mismatch, noise = laid_out(lambda s: 0.3 * np.sign(np.where(np.abs(s.v) > 0.02, s.v, 0)))
    gain = Term(BY_ID["sensor_gain"])
    inertia, friction = (Term(BY_ID[i], name=f"miscalibrated:{i}") for i in ("inertia", "coulomb_friction"))
    library = Library(mismatch, [gain, inertia, friction], frozenset({inertia.name, friction.name}))
    library.whiten(noise)
    answer = Answer("x")
    assert gain not in confirm(library, noise, [gain, inertia], answer, 3)
    assert "a gain scales all of it" in answer.rejected[0].reason


def test_a_gain_beside_a_wrong_coefficient_of_its_own_stays():
    mismatch, noise = laid_out(lambda s: 0.3 * s.sim + 0.002 * s.a)
    gain, inertia = Term(BY_ID["sensor_gain"]), Term(BY_ID["inertia"], name="miscalibrated:inertia")
    library = Library(mismatch, [gain, inertia], frozenset({inertia.name}))
    library.whiten(noise)
    assert confirm(library, noise, [gain, inertia], Answer("x"), 2) == [gain, inertia]


@pytest.mark.parametrize(
    ("effect", "names"),
    [
        (lambda s: -0.3 * s.sim * np.abs(s.sim), ["current_saturation"]),
        (lambda s: 0.1 * s.held * s.moving + 0.002 * s.a, ["miscalibrated:coulomb_friction", "miscalibrated:inertia"]),
    ],
    ids=["one", "two"],
)
def test_one_mechanism_stands_for_two_where_it_says_as_much_and_only_there(effect, names):
    mismatch, noise = laid_out(effect)
    bent = Term(BY_ID["current_saturation"], (("I_k", 1.0), ("form", 1.0)))
    two = [Term(BY_ID[i], name=f"miscalibrated:{i}") for i in ("coulomb_friction", "inertia")]
    library = Library(mismatch, [bent, Term(BY_ID["sensor_gain"]), *two], frozenset(t.name for t in two))
    library.whiten(noise)
    assert [t.name for t in fewest(library, noise, two)] == names


def test_a_limit_that_noise_hides_may_be_the_sensors_or_the_drives():
    """A flat top with noise upon it: no data tell a drive that gives no more from a sensor that shows no more."""
    states = axis_states(list(recordings()), "x")
    rng = np.random.default_rng(5)
    over = [np.clip(s.sim, -0.6, 0.6) - s.sim + rng.normal(0, NOISE, len(s.time)) for s in states]
    answer = search(first_look(lay_out(states, over), rng), 1, False, rng)
    assert [t.name for t in answer.terms] == ["current_saturation"]
    assert answer.rivals[0][0].name == "sensor_clipping"
    assert abs(answer.rivals[0][0].delta_bic) < 10.0


def test_a_law_of_speed_is_likelier_than_a_box_of_speed_that_is_as_good():
    mismatch, noise = laid_out(lambda s: 0.1 * np.exp(-((s.v / 3.0) ** 2)) * s.held * s.moving)
    coulomb, law = BY_ID["coulomb_friction"], BY_ID["stribeck_friction"]
    library = Library(mismatch, [Term(coulomb), *grid_terms(law, mismatch.states)])
    library.whiten(noise)
    slow = Term(coulomb, gates=(Gate("v_x", low=-4.0), Gate("v_x", high=4.0)))
    assert [t.name for t in fewest(library, noise, [slow])] == ["stribeck_friction"]


def test_what_changes_within_seconds_is_no_drift_of_temperature():
    mismatch, noise = laid_out(lambda s: 0.1 * np.exp(-s.time / 4.0))
    drift = Term(BY_ID["thermal_drift"], (("tau", 10.0), ("clock", 0.0), ("along", 0.0), ("rises", 0.0)))
    library = Library(mismatch, [drift])
    library.whiten(noise)
    answer = Answer("x")
    assert confirm(library, noise, [drift], answer, 2) == []
    assert "warms" in answer.rejected[0].reason


def test_one_mechanism_stands_for_three_that_share_what_it_does():
    mismatch, noise = laid_out(lambda s: 0.1 * s.held * s.moving)
    names = ("viscous_friction", "stribeck_friction", "friction_asymmetry", "coulomb_friction")
    library = Library(mismatch, [t for i in names for t in grid_terms(BY_ID[i], mismatch.states)])
    library.whiten(noise)
    slow = Term(BY_ID["stribeck_friction"], (("v_s", 6.0), ("delta", 2.0), ("rest", 0.0)))
    one_side = Term(BY_ID["friction_asymmetry"], (("side", 1.0), ("rest", 0.0)))
    three = [Term(BY_ID["viscous_friction"]), slow, one_side]
    assert [t.name for t in fewest(library, noise, three)] == ["coulomb_friction"]


@pytest.mark.parametrize(
    ("law", "effect"),
    [
        ("position_dependent_friction", lambda s, z: 0.1 * np.sin(s.pos / 3.0) * z),
        ("friction_asymmetry", lambda s, z: 0.1 * np.abs(z)),
    ],
)
def test_friction_that_is_held_at_rest_and_turns_over_a_way_is_one_finding(law, effect):
    def turning(state):
        """dz/ds = (h - z) / x_0, step by step (Dahl 1968)."""
        z, now = np.zeros(len(state.time)), 0.0
        for i, (h, way) in enumerate(zip(state.held, np.abs(np.diff(state.pos, prepend=state.pos[0])), strict=True)):
            now = h + (now - h) * np.exp(-way / 0.05)
            z[i] = now
        return effect(state, z)

    mismatch, noise = laid_out(turning)
    beside = ("sensor_offset", "coulomb_friction", "stribeck_friction", "standstill_friction", "presliding_hysteresis")
    library = Library(mismatch, [t for i in (law, *beside) for t in grid_terms(BY_ID[i], mismatch.states)])
    proposed = select_terms(library, noise, in_time=False)
    assert [t.name for t in confirm(library, noise, proposed, Answer("x"), len(beside) + 1)] == [law]


def behind_a_loop(recording):
    """Friction and inertia are simulated, with a drive that answers 15 ms late."""
    v = recording["v_x"]
    laws = 0.4 * np.sign(np.where(np.abs(v) > 0.02, v, 0.0)) + 0.03 * v + 0.004 * recording["a_x"]
    return recording.with_columns(curr_x_sim=answered_late(laws[None], recording.time, 0.015)[0])


def test_a_simulation_behind_a_loop_has_no_other_laws_than_the_loop_is_given():
    rng = np.random.default_rng(1)
    states = axis_states([behind_a_loop(r) for r in recordings(rows=8000)], "x")
    mismatch = lay_out(states, [rng.normal(0, NOISE, len(s.time)) for s in states])
    noise = Noise(np.zeros(0), np.full(mismatch.n, NOISE), 1.0, mismatch.usable)
    found = contained(mismatch, CATALOGUE, noise, rng)
    sizes = {"coulomb_friction": 0.4, "viscous_friction": 0.03, "inertia": 0.004}
    assert {i: c.amplitudes[0] for i, c in found.items()} == pytest.approx(sizes, rel=0.05)


def test_what_a_simulation_with_a_loop_lacks_passes_the_same_loop():
    """A weak effect does not show by itself how late it is answered, and would be taken for less than it is."""
    rng = np.random.default_rng(1)
    states = axis_states([behind_a_loop(r) for r in recordings()], "x")
    lacks = [answered_late(2e-4 * s.a[None], s.time, 0.015)[0] for s in states]
    mismatch = lay_out(states, [e + rng.normal(0, NOISE, len(e)) for e in lacks])
    answer = search(first_look(mismatch, rng), 1, False, rng)
    (term,) = answer.terms
    assert term.mechanism.id == "inertia"
    assert term.lag == pytest.approx(0.015, rel=0.2)
    ((m,),) = fit(mismatch, answer.noise, answer.terms).amplitudes
    assert m == pytest.approx(2e-4, rel=0.15)


DRAGS = {"spindle_viscous_drag": lambda v: 1e-5 * v, "spindle_windage": lambda v: 3e-10 * v**2}


@pytest.mark.parametrize("there", [{"spindle_viscous_drag"}, {"spindle_windage"}, set(DRAGS)])
def test_three_speeds_tell_which_drags_of_the_spindle_a_simulation_has(there):
    def of(recording):
        v = 17100.0 + 0.6 * (recording["v_sp"] - 6000.0)
        sim = 0.3 * (v > 0) + 2e-4 * recording["a_sp"] + sum(DRAGS[i](v) for i in there)
        return recording.with_columns(v_sp=v, a_sp=0.6 * recording["a_sp"], curr_sp_sim=sim)

    rng = np.random.default_rng(1)
    states = axis_states([of(r) for r in recordings()], "sp")
    mismatch = lay_out(states, [rng.normal(0, NOISE, len(s.time)) for s in states])
    noise = Noise(np.zeros(0), np.full(mismatch.n, NOISE), 1.0, mismatch.usable)
    assert set(contained(mismatch, CATALOGUE, noise, rng)) & set(DRAGS) == there


def test_what_does_not_stand_up_is_no_reason_to_keep_what_stands_beside_it(monkeypatch):
    """Averages propose one law. Quick rows propose two that come to the same, and a third too small to be a finding."""
    x_0 = ("x_0", 0.3)
    rng = np.random.default_rng(7)
    states = axis_states(list(recordings()), "x")
    whole = Term(BY_ID["presliding_hysteresis"], (x_0, ("full", 1.0)))
    parts = [replace(whole, shape=(x_0, ("full", 2.0))), Term(BY_ID["coulomb_friction"])]
    faint = Term(BY_ID["inertia"])
    rows = 0.06 * whole.columns(states)[0] + 8e-5 * faint.columns(states)[0]
    rows += lfilter([0.7 * NOISE], [1, -0.7], rng.normal(size=len(rows)))
    mismatch = lay_out(states, np.split(rows, len(states)))
    noise = estimate_noise(rows - 0.06 * whole.columns(states)[0], mismatch.starts, mismatch.noise_class)
    library = Library(mismatch, [whole, *parts, faint])
    library.whiten(noise)
    assert plain_error(mismatch, [*parts, faint]) < plain_error(mismatch, [whole]) < plain_error(mismatch, parts)
    monkeypatch.setattr("pido.diagnosis.identify.select_terms", lambda *_, **__: [whole])
    assert seen_slowly(library, noise, [*parts, faint], 4)[0] == [whole]


def test_a_law_that_could_as_well_have_the_other_sign_is_no_finding():
    """Its slow part says one sign, its quick part the other: the law is not what the machine does."""
    rng = np.random.default_rng(5)
    states = axis_states(list(recordings()), "x")
    law = Term(BY_ID["viscous_friction"])
    shape = law.columns(states)[0]
    slow = lfilter([0.1], [1, -0.9], shape)
    rows = 0.006 * slow - 0.01 * (shape - slow) + lfilter([0.3 * NOISE], [1, -0.95], rng.normal(size=len(shape)))
    mismatch = lay_out(states, np.split(rows, len(states)))
    quick = Noise(np.array([0.95]), np.full(mismatch.n, NOISE), 0.3, mismatch.usable & ~mismatch.starts)
    answer = Answer("x", [law], [1e-9], [1e-8], [500.0], [[]])
    assert plain_error(mismatch, [law]) < 0.97 * plain_error(mismatch, [])
    terms, _, _ = proved(mismatch, (even(mismatch), quick), [law], answer, rows, rng)
    assert terms == []
    assert [r.reason for r in answer.rejected] == ["the 95 % interval of its size holds zero"]


@pytest.mark.parametrize(("share", "stays"), [(0.002, False), (0.5, True)])
def test_what_has_no_name_stays_beside_a_law_only_where_it_is_more_than_its_form_may_lack(share, stays):
    law, rest = Term(BY_ID["viscous_friction"]), Term(BY_ID["inertia"], name="unknown")
    rng = np.random.default_rng(5)
    states = axis_states(list(recordings()), "x")
    rows, other = law.columns(states)[0], rest.columns(states)[0]
    rows = 0.02 * (rows + share * np.std(rows) / np.std(other) * other) + rng.normal(0, 0.1 * NOISE, len(rows))
    mismatch = lay_out(states, np.split(rows, len(states)))
    flat = even(mismatch)
    answer = Answer("x", [law, rest], [1e-9] * 2, [1e-8] * 2, [500.0] * 2, [[], []])
    terms, _, _ = proved(mismatch, (flat, flat), [law, rest], answer, rows, rng)
    assert terms == ([law, rest] if stays else [law])
    assert ["it has no name" in r.reason for r in answer.rejected] == ([] if stays else [True])


def test_a_shape_that_quick_rows_move_away_from_the_rest_is_settled_by_all_of_them(monkeypatch):
    """Friction at low speed, and beside it a quick transient of 12 mm/s that its form takes for its own."""
    shapes = {v_s: (("v_s", v_s), ("delta", 2.0), ("rest", 0.0)) for v_s in (1.0, 20.0)}
    right, wrong = (Term(BY_ID["stribeck_friction"], shape) for shape in shapes.values())
    mismatch, noise = laid_out(lambda s: 0.1 * right.columns([s])[0])
    monkeypatch.setattr(
        "pido.diagnosis.diagnose.settle_shapes", lambda _, n, terms: [wrong] if n is noise else list(terms)
    )
    assert settled(mismatch, noise, [right])[0] == [right]


def run_ups(size, rng):
    """Two parts, each with one run-up of the spindle."""
    for recording in recordings(2):
        v_sp = 3e4 * np.clip((recording["time"] - 5.2) / 0.6, 0, 1)
        a_sp = np.gradient(v_sp, recording["time"])
        drag = 4e-9 * v_sp**2
        yield recording.with_columns(
            v_sp=v_sp,
            a_sp=a_sp,
            curr_sp_sim=drag,
            curr_sp=drag + size * a_sp / a_sp.max() + rng.normal(0, NOISE, len(v_sp)),
        )


@pytest.mark.parametrize(("size", "named"), [(2 * NOISE, [("sp", "spindle_inertia")]), (0.0, [])])
def test_the_run_ups_of_two_parts_are_enough_for_what_stands_far_above_the_noise(size, named):
    found = diagnose(list(run_ups(size, np.random.default_rng(2))))
    assert [(f.axis, f.mechanism) for f in found.findings] == named
