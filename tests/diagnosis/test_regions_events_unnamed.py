"""Boxes of the reduced space, forces over intervals, waves in time, effects without a name: each planted and found."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.bends import Bend
from pido.diagnosis.confirm import even
from pido.diagnosis.events import ExternalForce, Rhythm, find_events, find_rhythms
from pido.diagnosis.forms import plainest, rivals_of
from pido.diagnosis.formulas import Formula, Peak
from pido.diagnosis.identify import Answer, confirm, seen_slowly, select_terms
from pido.diagnosis.library import Library, basis
from pido.diagnosis.loop import answered
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mismatch import Mismatch, lay_out
from pido.diagnosis.models import AxisModel, as_json, axis_models
from pido.diagnosis.regions import CLEARLY, best_region
from pido.diagnosis.search import first_look, search
from pido.diagnosis.select import MOST_TERMS, grid_terms
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Gate, Term, fit
from pido.diagnosis.unnamed import with_unknown
from pido.diagnosis.waves import Wave
from pido.diagnosis.whiten import Noise, estimate_noise
from pido.physics.drive import answered_late

NOISE = 0.05
VISCOUS = next(m for m in CATALOGUE if m.id == "viscous_friction")


def recordings(count=3, rows=1500):
    """x and y go to and fro at feeds of their own; one sample in 0.02 s."""
    for k in range(count):
        rng = np.random.default_rng(k)
        t = np.arange(rows) * 0.02
        columns = {"time": t}
        for axis in "xy":
            v = np.convolve(np.repeat(rng.uniform(-12, 12, rows // 25), 25), np.ones(7) / 7, "same")
            columns |= {f"v_{axis}": v, f"pos_{axis}": np.cumsum(v) * 0.02, f"a_{axis}": np.gradient(v, t)}
        yield Recording(PartInfo(part=f"p{k}", machine="m", order=k + 1, start_time_s=100.0 * k), columns)


POS = np.concatenate([r["pos_x"] for r in recordings()])


def laid_out(effect, seed=0) -> tuple[Mismatch, Noise]:
    """effect : state -> (n,), A, beside white noise; and that noise as it is."""
    states = axis_states(list(recordings()), "x")
    rng = np.random.default_rng(seed)
    mismatch = lay_out(states, [effect(s) + rng.normal(0, NOISE, len(s.time)) for s in states])
    return mismatch, Noise(np.zeros(0), np.full(mismatch.n, NOISE), 1.0, mismatch.usable)


def library_of(mismatch, noise, *terms):
    library = Library(mismatch, terms or [Term(VISCOUS)])
    library.whiten(noise)
    return library


def nothing(state):
    return np.zeros(len(state.time))


@pytest.mark.parametrize(("harmonics", "amplitudes"), [(0.0, 2), (1.0, 4)])
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


def test_what_is_more_of_a_simulated_mechanism_in_a_box_only_is_no_wrong_coefficient():
    def simulated(recording):
        return recording.with_columns(curr_x_sim=0.03 * recording["v_x"] + 0.3 * np.sign(recording["v_x"]))

    rng = np.random.default_rng(0)
    states = axis_states([simulated(r) for r in recordings()], "x")
    effects = [0.05 * s.v * (s.others["y"].v > 4.0) + rng.normal(0, NOISE, len(s.time)) for s in states]
    answer = search(first_look(lay_out(states, effects), rng), 1, False, rng)
    (term,) = answer.terms
    assert (term.name, term.gates[0].variable) == ("viscous_friction", "v_y")


@pytest.mark.parametrize(("level", "begin", "end"), [(0.15, 10.0, 14.0), (-0.2, 2.0, 4.0)])
def test_a_force_over_an_interval_is_found_in_its_part_and_stays_there(level, begin, end):
    mismatch, noise = laid_out(lambda s: level * ((s.part == "p1") & (s.time >= begin) & (s.time < end)))
    found = find_events(mismatch, noise, mismatch.target / NOISE)
    ((part, first, last),) = found.intervals
    assert part == "p1"
    assert (first, last) == (pytest.approx(begin, abs=0.25), pytest.approx(end, abs=0.25))
    seen = [found.regressors(state).any() for state in mismatch.states]
    assert seen == [False, True, False]
    assert found.conditions("x", {})[0].startswith("x axis, over single intervals")


FORCES = (("p0", 3.0, 10.0, 0.1), ("p0", 20.0, 23.0, 0.12), ("p1", 7.0, 11.0, -0.12), ("p1", 12.5, 20.0, 0.1))


def forced(state):
    t, of = state.time, [f for f in FORCES if f[0] == state.part]
    return sum((level * ((t >= begin) & (t < end)) for _, begin, end, level in of), nothing(state))


def test_several_forces_are_no_scatter_to_one_another():
    mismatch, noise = laid_out(forced)
    found = find_events(mismatch, noise, mismatch.target / NOISE)
    assert [part for part, _, _ in found.intervals] == [part for part, *_ in FORCES]
    np.testing.assert_allclose([i[1:] for i in found.intervals], [f[1:3] for f in FORCES], atol=0.5)


def test_laws_that_forces_over_intervals_have_made_up_give_way_to_them():
    mismatch, noise = laid_out(forced)
    laws = [t for m in CATALOGUE if m.id in ("position_dependent_friction", "torque_ripple", "presliding_hysteresis")
            for t in grid_terms(m, mismatch.states)]  # fmt: skip
    library = library_of(mismatch, noise, *laws)
    assert select_terms(library, noise, in_time=False) != []
    assert [t.name for t in select_terms(library, noise)] == ["external_force"]


def slowly_noisy(effect, seed=0) -> tuple[Mismatch, Noise]:
    """effect : state -> (n,), A, beside noise that remembers ten samples; and what is known of that noise."""
    states, rng = axis_states(list(recordings()), "x"), np.random.default_rng(seed)
    noise = [lfilter([0.2 * NOISE], [1, -0.9], rng.normal(size=len(s.time))) for s in states]
    mismatch = lay_out(states, [effect(s) + e for s, e in zip(states, noise, strict=True)])
    return mismatch, estimate_noise(np.concatenate(noise), mismatch.starts, mismatch.noise_class, mismatch.usable)


def test_forces_that_last_for_much_of_the_time_are_no_constant_beside_them():
    long = {"p0": ((4.0, 11.0), (19.0, 24.0)), "p1": ((9.0, 17.0),), "p2": ((1.0, 6.0), (14.0, 21.0))}
    mismatch, _ = slowly_noisy(lambda s: 0.3 * sum(((s.time > i) & (s.time < j) for i, j in long[s.part]), nothing(s)))
    rng = np.random.default_rng(0)
    (force,) = search(first_look(mismatch, rng), 1, False, rng).terms
    assert force.name == "external_force"


def test_short_forces_whose_ends_are_a_few_rows_beside_the_true_ones_are_proved():
    begins = {"p0": (2.0, 9.0, 17.0, 25.0), "p1": (4.0, 13.0, 20.0, 27.0), "p2": ()}
    mismatch, noise = slowly_noisy(
        lambda s: 0.15 * sum(((s.time >= b) & (s.time < b + 2.0) for b in begins[s.part]), nothing(s))
    )
    late = Term(ExternalForce(tuple((part, b + 0.2, b + 2.2) for part, of in begins.items() for b in of)))
    assert confirm(library_of(mismatch, noise), noise, [late], Answer("x"), 20) == [late]


@pytest.mark.parametrize(("level", "stands"), [(0.35, False), (0.7, True)])
def test_an_interval_is_judged_as_the_clearest_of_all_that_were_looked_at(level, stands):
    """The first is five standard errors high: noise alone has such an interval in one recording of some."""
    mismatch, noise = laid_out(lambda s: level * NOISE * ((s.part == "p1") & (s.time >= 10.0) & (s.time < 14.0)))
    force = Term(ExternalForce((("p1", 10.0, 14.0),)))
    assert bool(confirm(library_of(mismatch, noise), noise, [force], Answer("x"), 1)) == stands


def test_a_force_is_compared_with_a_law_on_other_seconds_of_its_own_part(monkeypatch):
    mismatch, noise = slowly_noisy(lambda s: 2 * forced(s))
    forces = Term(ExternalForce(tuple(f[:3] for f in FORCES)))
    drift = next(m for m in CATALOGUE if m.id == "thermal_drift")
    law = Term(drift, (("tau", 64.0), ("clock", 1.0), ("along", 0.0), ("rises", 0.0)))
    library = library_of(mismatch, noise)
    assert confirm(library, noise, [law], Answer("x"), 20) == [law]
    monkeypatch.setattr("pido.diagnosis.identify.select_terms", lambda *_, **__: [law])
    assert seen_slowly(library, noise, [forces], 20)[0] == [forces]


def test_noise_alone_has_no_events_and_no_rhythm():
    for seed in range(10):
        mismatch, noise = laid_out(nothing, seed)
        assert find_events(mismatch, noise, mismatch.target / NOISE) is None
        assert find_rhythms(mismatch, noise, mismatch.target / NOISE) == []


@pytest.mark.parametrize("level", [0.0, 0.6])
def test_noise_that_is_slow_at_standstill_makes_no_events_and_hides_no_large_one(level):
    def rests(recording):
        t = recording["time"]
        columns = {name: recording[name] * (t % 8.0 < 4.0 if name == "v_x" else 1.0) for name in recording.columns}
        return Recording(recording.part, columns)

    rng = np.random.default_rng(3)
    states = axis_states([rests(r) for r in recordings()], "x")
    slow = [np.convolve(rng.normal(0, 0.15, len(s.time) + 49), np.ones(50) / np.sqrt(50), "valid") for s in states]
    event = [level * ((s.part == "p1") & (s.time >= 20.5) & (s.time < 23.5)) for s in states]
    targets = [
        rng.normal(0, NOISE, len(s.time)) + e + ~s.moving * w for s, w, e in zip(states, slow, event, strict=True)
    ]
    mismatch = lay_out(states, targets)
    found = find_events(
        mismatch, Noise(np.zeros(0), np.full(mismatch.n, NOISE), 1.0, mismatch.usable), mismatch.target / NOISE
    )
    parts = [part for part, first, last in found.intervals if 20 < first < last < 24] if found else []
    assert parts == ["p1"] * (level > 0)
    assert level > 0 or found is None


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize(("size", "found"), [(5.5, False), (9.0, True)])
def test_a_level_that_few_others_are_there_to_compare_with_has_to_be_the_clearer(size, found, seed):
    """The tool cuts for 8 s of each part only."""
    rng = np.random.default_rng(seed)
    cuts = [r.with_columns(mrr_sim=50.0 * ((r.time >= 8.0) & (r.time < 16.0))) for r in recordings()]
    states = axis_states(cuts, "x")
    noises = [rng.normal(0, NOISE, len(s.time)) for s in states]
    level = (states[1].time >= 10.0) & (states[1].time < 14.0)
    noises[1][level] += size * NOISE / np.sqrt(level.sum()) - noises[1][level].mean()
    mismatch = lay_out(states, noises)
    noise = Noise(np.zeros(0), np.full(mismatch.n, NOISE), 1.0, mismatch.usable)
    assert (find_events(mismatch, noise, mismatch.target / NOISE) is not None) == found


@pytest.mark.parametrize(("begin", "end", "found"), [(12.0, 16.0, False), (12.8, 15.0, True), (9.0, 15.0, True)])
def test_what_stays_from_a_stop_to_the_next_motion_is_no_force(begin, end, found):
    def rests(recording):
        t = recording["time"]
        return recording.with_columns(v_x=np.where((t >= 12.0) & (t < 16.0), 0.0, recording["v_x"]))

    rng = np.random.default_rng(3)
    states = axis_states([rests(r) for r in recordings()], "x")
    level = [0.3 * ((s.part == "p1") & (s.time >= begin) & (s.time < end)) for s in states]
    mismatch = lay_out(states, [e + rng.normal(0, NOISE, len(s.time)) for s, e in zip(states, level, strict=True)])
    noise = Noise(np.zeros(0), np.full(mismatch.n, NOISE), 1.0, mismatch.usable)
    assert (find_events(mismatch, noise, mismatch.target / NOISE) is not None) == found


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


@pytest.mark.parametrize("period", [0.37, 3.1])
def test_a_wave_in_time_is_found_with_its_period(period):
    mismatch, noise = laid_out(lambda s: 0.04 * np.sin(2 * np.pi * s.clock / period))
    rhythm, found = find_rhythms(mismatch, noise, mismatch.target / NOISE)[0]
    assert isinstance(rhythm, Rhythm)
    assert found == pytest.approx(period, rel=0.03)


def test_a_rhythm_on_the_machines_clock_runs_on_through_the_pauses():
    states = axis_states(list(recordings(2)), "x")
    waves = [Rhythm(clock=True).regressors(s, T=7.0)[:, 0] for s in states]
    np.testing.assert_allclose(waves[1], np.sin(2 * np.pi * (100.0 + states[1].time) / 7.0), atol=1e-12)
    alone = Rhythm(clock=False).regressors(states[1], T=7.0)[:, 0]
    np.testing.assert_allclose(alone, waves[0], atol=1e-12)


def test_levels_of_intervals_are_numbered_amplitudes():
    force = ExternalForce((("p0", 1.0, 2.0), ("p2", 3.0, 5.0)))
    assert [(a.name, a.unit) for a in force.amplitudes] == [("F_1", "A"), ("F_2", "A")]


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
    library = Library(mismatch, [Term(VISCOUS)], lag=0.1)
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
