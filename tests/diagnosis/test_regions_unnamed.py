"""Boxes of the reduced space and effects without a name: each planted and found."""

import re
from dataclasses import replace

import numpy as np
import pytest

from pido.core.recording import Recording
from pido.diagnosis.bends import Bend
from pido.diagnosis.confirm import even
from pido.diagnosis.forms import plainest, rivals_of
from pido.diagnosis.formulas import Formula, Peak
from pido.diagnosis.gates import Gate
from pido.diagnosis.identify import select_terms
from pido.diagnosis.library import Library, basis
from pido.diagnosis.loop import answered
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.models import AxisModel, as_json, axis_models
from pido.diagnosis.regions import CLEARLY, best_region
from pido.diagnosis.search import first_look, search
from pido.diagnosis.select import MOST_TERMS, grid_terms
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term, fit
from pido.diagnosis.unnamed import with_unknown
from pido.diagnosis.waves import Wave
from pido.diagnosis.whiten import estimate_noise
from pido.physics.drive import Loop, answered_late
from tests.diagnosis.planted import white
from tests.diagnosis.to_and_fro import NOISE, VISCOUS, laid_out, library_of, nothing, recordings

POS = np.concatenate([r["pos_x"] for r in recordings()])


@pytest.mark.parametrize(("harmonics", "amplitudes"), [(0.0, 2), (1.0, 4), (2.0, 6)])
def test_a_form_is_charged_for_its_own_amplitudes_wherever_it_is_counted(harmonics, amplitudes):
    mismatch, noise = laid_out(lambda s: 0.05 * np.sin(s.pos) + 0.03 * np.sin(2 * s.pos))
    ripple = Term(next(m for m in CATALOGUE if m.id == "torque_ripple"), (("L", 2 * np.pi), ("harmonics", harmonics)))
    library = library_of(mismatch, noise, ripple)
    chosen = basis(library, noise, [ripple])
    assert chosen.free == amplitudes + 2  # its length, and by what it is late
    assert chosen.bic == pytest.approx(fit(mismatch, noise, [ripple]).bic + library.charge(ripple))
    assert chosen.bic == pytest.approx(library.score(ripple, basis(library, noise, [])).bic, abs=0.01)


def test_an_effect_that_acts_on_one_side_of_a_speed_is_confined_there():
    mismatch, noise = laid_out(lambda s: 0.05 * s.v * (s.others["y"].v > 4.0))
    library = library_of(mismatch, noise)
    everywhere = library.screen(basis(library, noise, []))
    found = best_region(library, basis(library, noise, []))
    (gate,) = found.term.gates
    assert gate.variable == "v_y"
    assert gate.low == pytest.approx(4.0, abs=0.5)
    assert gate.high == np.inf
    assert found.bic < min(s.bic for s in everywhere) - CLEARLY
    assert found.amplitudes == pytest.approx([0.05], rel=0.05)


def test_a_law_of_which_the_parts_show_one_amplitude_alone_may_be_confined():
    shape = (("form", 0.0), ("L", 5.0), ("p_0", 0.0), ("rest", 0.0), ("v_0", 0.1))
    along_travel = Term(next(m for m in CATALOGUE if m.id == "position_dependent_friction"), shape)
    states = [replace(s, pos=np.full(len(s.time), np.nan)) for s in axis_states(list(recordings()), "x")]
    effects = [0.3 * s.along * (s.others["y"].v > 4.0) for s in states]
    rng = np.random.default_rng(0)
    mismatch = lay_out(states, [e + rng.normal(0, NOISE, len(e)) for e in effects])
    noise = white(mismatch)
    library = library_of(mismatch, noise, along_travel)
    found = best_region(library, basis(library, noise, []))
    assert [gate.variable for gate in found.term.gates] == ["v_y"]


def test_an_effect_that_acts_everywhere_is_not_confined():
    mismatch, noise = laid_out(lambda s: 0.02 * s.v)
    library = library_of(mismatch, noise)
    current = basis(library, noise, [])
    found = best_region(library, current)
    assert found is None or found.bic > min(s.bic for s in library.screen(current)) - CLEARLY


def test_laws_that_are_alike_in_a_box_are_each_others_rivals():
    """Where x and y both go forward, friction of x and a pull of y's direction are one constant."""
    box = (Gate("v_x", low=1.0), Gate("v_y", low=4.0))
    friction, pull = (next(m for m in CATALOGUE if m.id == i) for i in ("coulomb_friction", "axis_coupling"))
    terms = [t for m in (friction, pull, VISCOUS) for t in grid_terms(m, laid_out(nothing)[0].states)]
    one = replace(next(t for t in terms if t.name == "coulomb_friction"), gates=box)
    mismatch, noise = laid_out(lambda s: 0.1 * (s.v > 1.0) * (s.others["y"].v > 4.0))
    library = library_of(mismatch, noise, *terms)
    *near, last = rivals_of(library, noise, [one], 0)
    assert {(r.name, r.term.gates) for r in near} == {("axis_coupling", box), ("unknown", box)}
    assert all(abs(r.delta_bic) < 10.0 for r in near)
    assert last.delta_bic > 20.0


def test_a_place_is_a_region_by_itself_and_is_not_confined_again():
    class Zone(type(VISCOUS)):
        id = "material_hard_zone"

    mismatch, noise = laid_out(lambda s: 0.05 * s.v * (s.others["y"].v > 4.0))
    library = library_of(mismatch, noise, Term(Zone()))
    found = best_region(library, basis(library, noise, []))
    assert found is None or found.term.name == "unknown"


@pytest.mark.thorough
def test_what_is_more_of_a_simulated_mechanism_in_a_box_only_is_no_wrong_coefficient():
    def simulated(recording):
        return recording.with_columns(curr_x_sim=0.03 * recording["v_x"] + 0.3 * np.sign(recording["v_x"]))

    rng = np.random.default_rng(0)
    states = axis_states([simulated(r) for r in recordings()], "x")
    effects = [0.05 * s.v * (s.others["y"].v > 4.0) + rng.normal(0, NOISE, len(s.time)) for s in states]
    answer = search(first_look(lay_out(states, effects), rng), 1, False, rng)
    (term,) = answer.terms
    assert (term.name, term.gates[0].variable) == ("viscous_friction", "v_y")


def test_noise_that_grows_with_the_load_has_a_level_per_quarter_of_it():
    rng = np.random.default_rng(4)

    def cutting(recording):
        n = len(recording["time"])
        force = np.repeat(rng.uniform(100.0, 2000.0, n // 50), 50)
        return Recording(
            recording.part, {k: recording[k] for k in recording.columns} | {"f_x_sim": force, "mrr_sim": force}
        )

    states = axis_states([cutting(r) for r in recordings()], "x")
    mismatch = lay_out(states, [rng.normal(0, 1e-4 * s.force) for s in states])
    noise = estimate_noise(mismatch.target, mismatch.starts, mismatch.noise_class, mismatch.usable)
    force = np.concatenate([s.force for s in states])
    heavy, light = noise.level[force > 1700], noise.level[force < 400]
    assert np.median(heavy) == pytest.approx(1e-4 * 1750, rel=0.2)
    assert np.median(light) < 0.3 * np.median(heavy)


def test_what_no_mechanism_describes_becomes_one_unknown_over_the_right_quantity():
    mismatch, noise = laid_out(lambda s: 0.3 * np.exp(-(((np.abs(s.others["y"].v) - 6.0) / 1.2) ** 2)))
    terms, _ = with_unknown(library_of(mismatch, noise), noise, [], seed=0)
    (term,) = terms
    assert term.name == "unknown"
    assert "v_y" in term.mechanism.equation


def test_a_drag_around_one_speed_turns_with_the_motion_and_is_one_peak():
    mismatch, noise = laid_out(lambda s: 0.2 * np.exp(-(((np.abs(s.v) - 6.0) / 1.2) ** 2)) * np.sign(s.v))
    (term,), _ = with_unknown(library_of(mismatch, noise), noise, [], seed=0)
    assert term.mechanism == Peak("v_x", "mm/s", even=False, odd=True)
    assert dict(term.shape)["c"] == pytest.approx(6.0, abs=0.1)
    model = AxisModel("x", NOISE, (term,), (np.array([0.2]),))
    assert axis_models(as_json({"x": model}))["x"].terms == (term,)


def test_a_resonance_fades_as_the_answer_of_an_oscillator_and_needs_no_law_beside_it():
    mismatch, noise = laid_out(lambda s: 0.3 / (1 + ((np.abs(s.others["y"].v) - 6.0) / 1.2) ** 2))
    (term,), _ = with_unknown(library_of(mismatch, noise), noise, [], seed=0)
    assert isinstance(term.mechanism, Peak)
    assert term.mechanism.wide
    assert dict(term.shape)["w"] == pytest.approx(1.2, rel=0.1)
    assert "k / (1 +" in term.mechanism.equation
    model = AxisModel("x", NOISE, (term,), (np.array([0.3]),))
    assert axis_models(as_json({"x": model}))["x"].terms == (term,)


def test_what_has_no_name_passes_the_loop_of_the_drive_as_laws_do():
    def drag(s):
        return 0.2 * np.exp(-(((np.abs(s.v) - 6.0) / 1.2) ** 2)) * np.sign(s.v)

    mismatch, noise = laid_out(lambda s: answered_late(drag(s)[None], s.time, 0.1)[0])
    library = Library(mismatch, [Term(VISCOUS)], loop=Loop(0.1))
    library.whiten(noise)
    (term,), _ = with_unknown(library, noise, [], seed=0)
    assert (term.mechanism, term.lag) == (Peak("v_x", "mm/s", even=False, odd=True), 0.1)
    assert dict(term.shape)["c"] == pytest.approx(6.0, abs=0.1)


def test_a_drift_in_a_box_that_does_not_drift_only_mends_the_same_steady_law():
    drift, coulomb = (next(m for m in CATALOGUE if m.id == i) for i in ("thermal_drift", "coulomb_friction"))
    friction = Term(coulomb, (("rest", 0.0),))
    mismatch, noise = laid_out(lambda s: 0.3 * np.arctan(s.v / 0.4) * 2 / np.pi)
    near = (Gate("v_x", low=-1.0), Gate("v_x", high=1.0))
    steady = Term(drift, (("tau", 5_000.0), ("clock", 0.0), ("along", 1.0), ("rises", 0.0)), near)
    assert plainest(library_of(mismatch, noise, friction), noise, [friction, steady]) == [friction]


@pytest.mark.thorough
def test_coolant_whose_pump_takes_time_is_coolant_behind_a_lag():
    def watered():
        for k, recording in enumerate(recordings(rows=3000)):
            t = recording.time
            on = sum((t > b + k) & (t < e + 2 * k) for b, e in ((4, 13), (20, 33), (41, 52)))
            yield recording.with_columns(coolant=np.asarray(on, float))

    states, rng = axis_states(list(watered()), "x"), np.random.default_rng(1)
    late = [answered_late(s.coolant[None], s.time, 0.5)[0] for s in states]
    mismatch = lay_out(states, [e + rng.normal(0, 0.1, len(e)) for e in late])
    terms = search(first_look(mismatch, rng), 1, False, rng).terms
    (term,) = answered(mismatch, even(mismatch), terms)
    assert term.name == "coolant_load"
    assert term.lag == pytest.approx(0.5, rel=0.1)


@pytest.mark.parametrize("sign", [1, -1])
def test_what_acts_only_while_the_drive_pushes_or_brakes_is_one_law_and_no_wrong_inertia_beside_another(sign):
    mismatch, noise = laid_out(lambda s: 5e-4 * s.a * (sign * s.v * s.a > 0))
    inertia = Term(next(m for m in CATALOGUE if m.id == "inertia"))
    other = Term(Formula((("a_x", "|u|"), ("held_x", "sgn u")), "mm/s²"))
    both = [replace(inertia, name="miscalibrated:inertia"), other]
    (term,), _ = with_unknown(library_of(mismatch, noise, inertia), noise, both, seed=0)
    assert term.mechanism.equation == f"dI = k * a_x * {'speeding' if sign > 0 else 'braking'}_x"


def test_a_spring_about_a_place_is_one_unknown_and_not_a_level_beside_a_wave():
    middle = 0.5 * (POS.min() + POS.max()) + 0.2 * np.ptp(POS)
    mismatch, noise = laid_out(lambda s: 0.15 * ((s.pos - middle) / np.ptp(POS)) ** 2)
    offset, ripple = (Term(next(m for m in CATALOGUE if m.id == i)) for i in ("sensor_offset", "torque_ripple"))
    ripple = Term(ripple.mechanism, (("L", 1.5 * np.ptp(POS)),))
    terms, _ = with_unknown(library_of(mismatch, noise, offset, ripple), noise, [offset, ripple], seed=0)
    (term,) = terms
    assert term.mechanism == Bend("pos_x", (POS.min(), POS.max()))
    model = AxisModel("x", NOISE, (term,), (np.array([0.1, 0.2, 0.3]),))
    (again,) = axis_models(as_json({"x": model}))["x"].terms
    assert again == term


def test_a_friction_that_another_axis_eases_as_it_moves_is_one_law_of_both():
    """More than it should be at one speed of y, less than it should be far from it: no power of the speed says that."""
    states = axis_states(list(recordings()), "x")
    speeds = np.concatenate([s.others["y"].v for s in states])
    most = np.abs(speeds).max()
    mismatch, noise = laid_out(lambda s: 0.2 * s.held * s.moving * (0.3 - (s.others["y"].v / most - 0.4) ** 2))
    coulomb = Term(next(m for m in CATALOGUE if m.id == "coulomb_friction"), name="miscalibrated:coulomb_friction")
    (term,), _ = with_unknown(library_of(mismatch, noise, coulomb), noise, [coulomb], seed=0)
    assert term.mechanism == Bend("v_y", (speeds.min(), speeds.max()), "v_x")
    model = AxisModel("x", NOISE, (term,), (np.array([0.1, 0.2, 0.3]),))
    assert axis_models(as_json({"x": model}))["x"].terms == (term,)


@pytest.mark.parametrize(
    ("place", "carrier", "signal"),
    [
        ("y", lambda s: s.v, "v_x"),
        ("y", lambda s: s.held, "held_x"),
        ("y", lambda s: np.ones(len(s.v)), ""),
        ("x", lambda s: s.v, "v_x"),
    ],
)
def test_a_load_that_is_periodic_along_an_axis_is_a_wave_of_the_right_length(place, carrier, signal):
    size = 0.1 / max(abs(carrier(s)).max() for s in axis_states(list(recordings()), "x"))
    mismatch, noise = laid_out(lambda s: size * carrier(s) * np.cos(s.places[place] / 1.3 + 0.4))
    (term,), _ = with_unknown(library_of(mismatch, noise), noise, [], seed=0)
    assert term.mechanism == Wave(f"pos_{place}", "mm", signal, "mm/s" if signal == "v_x" else "–")
    assert dict(term.shape)["L"] == pytest.approx(2 * np.pi * 1.3, rel=0.01)
    model = AxisModel("x", NOISE, (term,), (np.array([0.1, 0.2]),))
    assert axis_models(as_json({"x": model}))["x"].terms == (term,)


def test_what_two_places_do_together_is_one_surface_over_both():
    """It averages out over either of them: a cable chain that is stiff in two corners."""
    y = {r.part.part: r["pos_y"] for r in recordings()}
    mismatch, noise = laid_out(lambda s: 0.001 * (s.pos - 20.0) * y[s.part])
    laws = [t for m in CATALOGUE if m.id in ("position_dependent_friction", "axis_coupling", "thermal_drift")
            for t in grid_terms(m, mismatch.states)]  # fmt: skip
    (term,), _ = with_unknown(library_of(mismatch, noise, *laws), noise, [], 0)
    assert set(term.mechanism.variables) == {"pos_x", "pos_y"}
    assert np.std(fit(mismatch, noise, [term]).residual) < 1.2 * NOISE


def test_a_faint_law_without_a_name_counts_by_its_own_size_and_not_by_the_noise():
    mismatch, noise = laid_out(lambda s: 1.3e-4 * s.v * s.others["y"].v)  # takes 0.8 % of the error away
    terms, _ = with_unknown(library_of(mismatch, noise), noise, [], seed=0)
    (term,) = terms
    assert {"v_x", "v_y"} <= set(re.findall("v_.", term.mechanism.equation))


def test_what_jumps_where_the_current_turns_is_one_curve_over_it_and_not_three_laws(monkeypatch):
    """As the dead time of a drive's switches leaves it; the laws that each take a part of it are worse together."""
    rng = np.random.default_rng(0)
    parts = [r.with_columns(curr_x_sim=0.02 * r["v_x"] + 0.004 * r["a_x"]) for r in recordings()]
    states = axis_states(parts, "x")
    effects = [-0.1 * np.sign(s.sim) * np.exp(-np.abs(s.sim) / 0.1) for s in states]
    mismatch = lay_out(states, [e + rng.normal(0, NOISE, len(e)) for e in effects])
    _, noise = laid_out(nothing)
    box = tuple(g for v in ("v_x", "v_y") for g in (Gate(v, low=-9.0), Gate(v, high=9.0)))
    laws = ("coulomb_friction", "inertia", "viscous_friction")
    three = [Term(m, gates=box) for m in CATALOGUE if m.id in laws]
    monkeypatch.setattr("pido.diagnosis.unnamed.best_nameless", lambda *_: [])  # nor any formula over other quantities
    (term,), _ = with_unknown(library_of(mismatch, noise, *three), noise, three, seed=0)
    assert term.name == "unknown"
    assert term.mechanism.variables == ("I_x",)


def test_a_named_effect_that_explains_everything_keeps_its_name():
    mismatch, noise = laid_out(lambda s: 0.03 * s.v)
    terms, note = with_unknown(library_of(mismatch, noise), noise, [Term(VISCOUS)], seed=0)
    assert terms == [Term(VISCOUS)]
    assert note is None


def test_a_gate_says_its_condition_as_the_contract_has_it():
    assert Gate("v_x", low=4.0).condition == "v_x > 4"
    assert Gate("AR", low=1.0, high=2.5).condition == "AR > 1 and AR < 2.5"


def test_a_tone_that_drifts_does_not_keep_the_search_adding_waves():
    def chirp(state):
        return np.sin(2 * np.pi * (1.0 + 0.02 * state.time) * state.time)

    mismatch, noise = laid_out(chirp)
    terms = select_terms(library_of(mismatch, noise), noise)
    assert 1 <= len(terms) <= MOST_TERMS


def test_a_load_on_an_arm_is_one_law_whose_arm_is_zero_anywhere():
    mismatch, noise = laid_out(lambda s: 0.002 * s.others["y"].v * (s.pos - POS.min() - 0.3 * np.ptp(POS)))
    (term,), _ = with_unknown(library_of(mismatch, noise), noise, [], seed=0)
    assert {"pos_x", "v_y"} <= term.mechanism.reads
