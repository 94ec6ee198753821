"""Forces over intervals and waves in time, each planted and found; and noise that has none."""

import numpy as np
import pytest
from scipy.signal import lfilter

from pido.diagnosis.events import ExternalForce, Rhythm, find_events, find_rhythms
from pido.diagnosis.identify import Answer, confirm, noise_of, seen_slowly, select_terms
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mismatch import Mismatch, lay_out
from pido.diagnosis.search import _forces_alone, first_look, search
from pido.diagnosis.select import grid_terms
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from pido.diagnosis.whiten import Noise, estimate_noise
from tests.diagnosis.planted import white
from tests.diagnosis.to_and_fro import NOISE, laid_out, library_of, nothing, recordings


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


def resting(recording, at):
    """The part with x at rest in some rows: its position and acceleration say so, too."""
    v = np.where(at, 0.0, recording["v_x"])
    return recording.with_columns(v_x=v, pos_x=np.cumsum(v) * 0.02, a_x=np.gradient(v, recording.time))


FORCES = (("p0", 3.0, 10.0, 0.1), ("p0", 20.0, 23.0, 0.12), ("p1", 7.0, 11.0, -0.12), ("p1", 12.5, 20.0, 0.1))


def forced(state):
    t, of = state.time, [f for f in FORCES if f[0] == state.part]
    return sum((level * ((t >= begin) & (t < end)) for _, begin, end, level in of), nothing(state))


def test_several_forces_are_no_scatter_to_one_another():
    mismatch, noise = laid_out(forced)
    found = find_events(mismatch, noise, mismatch.target / NOISE)
    assert [part for part, _, _ in found.intervals] == [part for part, *_ in FORCES]
    np.testing.assert_allclose([i[1:] for i in found.intervals], [f[1:3] for f in FORCES], atol=0.5)


@pytest.mark.thorough
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


@pytest.mark.thorough
def test_forces_that_last_for_much_of_the_time_are_no_constant_beside_them():
    long = {"p0": ((4.0, 11.0), (19.0, 24.0)), "p1": ((9.0, 17.0),), "p2": ((1.0, 6.0), (14.0, 21.0))}
    mismatch, _ = slowly_noisy(lambda s: 0.3 * sum(((s.time > i) & (s.time < j) for i, j in long[s.part]), nothing(s)))
    rng = np.random.default_rng(0)
    (force,) = search(first_look(mismatch, rng), 1, False, rng).terms
    assert force.name == "external_force"


def test_waves_and_drifts_give_way_to_the_forces_that_they_stood_for():
    mismatch, noise = laid_out(forced)
    library = library_of(mismatch, noise)
    drift = next(m for m in CATALOGUE if m.id == "thermal_drift")
    slow = [
        Term(Rhythm(False), (("T", 17.0),)),
        Term(drift, (("tau", 64.0), ("clock", 1.0), ("along", 0.0), ("rises", 0.0))),
    ]
    some = Term(ExternalForce(tuple(f[:3] for f in FORCES[:2])))
    (force,) = _forces_alone(library, noise, [slow[1], some, slow[0]])
    assert isinstance(force.mechanism, ExternalForce)
    assert len(force.mechanism.intervals) == len(FORCES)
    assert _forces_alone(library, noise, slow) == slow


def test_a_wave_that_is_there_beside_forces_stays():
    wave = Term(Rhythm(False), (("T", 3.0),))
    mismatch, noise = laid_out(lambda s: forced(s) + 0.1 * np.sin(2 * np.pi * s.time / 3.0))
    forces = Term(ExternalForce(tuple(f[:3] for f in FORCES)))
    assert _forces_alone(library_of(mismatch, noise), noise, [forces, wave]) == [forces, wave]


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


@pytest.mark.parametrize(("tau", "size", "seed"), [(3.0, 0.5, 7), (3.0, 0.5, 8), (6.0, 1.0, 3), (6.0, 1.0, 4)])
def test_noise_that_wanders_more_slowly_than_its_model_has_no_events(tau, size, seed):
    """Beside white noise it wanders over seconds, which a flexible model of the clock takes for an effect."""
    rng, states = np.random.default_rng(seed), axis_states(list(recordings(4, 6000)), "x")
    memory = np.exp(-0.02 / tau)
    wander = [lfilter([np.sqrt(1 - memory**2)], [1, -memory], rng.normal(size=len(s.time))) for s in states]
    mismatch = lay_out(states, [NOISE * (size * w + rng.normal(size=len(w))) for w in wander])
    noise = estimate_noise(mismatch.target, mismatch.starts, mismatch.noise_class, mismatch.usable)
    noise = noise_of(mismatch, noise, [])
    assert find_events(mismatch, noise, noise.whiten(mismatch.target[None])[0]) is None


def louder_for_some_seconds(seed) -> tuple[Mismatch, Noise]:
    """Noise that remembers 0.3 s; how loud it is wanders over 4 s, whatever the state."""

    def wander(tau):
        memory = np.exp(-0.02 / tau)
        return lfilter([np.sqrt(1 - memory**2)], [1, -memory], rng.normal(size=6500))[500:]

    rng, states = np.random.default_rng(100 + seed), axis_states(list(recordings(4, 6000)), "x")
    mismatch = lay_out(states, [NOISE * wander(0.3) * np.exp(0.6 * wander(4.0) - 0.18) for _ in states])
    noise = estimate_noise(mismatch.target, mismatch.starts, mismatch.noise_class, mismatch.usable)
    return mismatch, noise_of(mismatch, noise, [])


def test_noise_that_is_louder_for_some_seconds_has_hardly_an_event():
    """Judged by how it scatters in all, there are 39 in these eight recordings."""
    found = [
        find_events(m, noise, noise.whiten(m.target[None])[0]) for m, noise in map(louder_for_some_seconds, range(8))
    ]
    assert sum(len(f.intervals) for f in found if f is not None) <= 2


@pytest.mark.parametrize("seed", range(1, 5))
def test_noise_that_is_louder_for_some_seconds_hides_no_large_event(seed):
    mismatch, noise = louder_for_some_seconds(seed)
    force = [0.3 * ((s.part == "p1") & (s.time >= 50.0) & (s.time < 60.0)) for s in mismatch.states]
    found = find_events(mismatch, noise, noise.whiten((mismatch.target + np.concatenate(force))[None])[0])
    assert {part for part, *_ in found.intervals} == {"p1"}
    ends = [end for _, *ends in found.intervals for end in ends]
    assert (min(ends), max(ends)) == (pytest.approx(50.0, abs=1.0), pytest.approx(60.0, abs=1.0))


@pytest.mark.parametrize("level", [0.0, 0.6])
def test_noise_that_is_slow_at_standstill_makes_no_events_and_hides_no_large_one(level):
    rng = np.random.default_rng(3)
    states = axis_states([resting(r, r.time % 8.0 >= 4.0) for r in recordings()], "x")
    slow = [np.convolve(rng.normal(0, 0.15, len(s.time) + 49), np.ones(50) / np.sqrt(50), "valid") for s in states]
    event = [level * ((s.part == "p1") & (s.time >= 20.5) & (s.time < 23.5)) for s in states]
    targets = [
        rng.normal(0, NOISE, len(s.time)) + e + ~s.moving * w for s, w, e in zip(states, slow, event, strict=True)
    ]
    mismatch = lay_out(states, targets)
    found = find_events(mismatch, white(mismatch), mismatch.target / NOISE)
    parts = [part for part, first, last in found.intervals if 20 < first < last < 24] if found else []
    assert set(parts) == ({"p1"} if level > 0 else set())
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
    noise = white(mismatch)
    assert (find_events(mismatch, noise, mismatch.target / NOISE) is not None) == found


@pytest.mark.parametrize(("begin", "end", "found"), [(12.0, 16.0, False), (12.8, 15.0, True), (9.0, 15.0, True)])
def test_what_stays_from_a_stop_to_the_next_motion_is_no_force(begin, end, found):
    rng = np.random.default_rng(3)
    states = axis_states([resting(r, (r.time >= 12.0) & (r.time < 16.0)) for r in recordings()], "x")
    level = [0.3 * ((s.part == "p1") & (s.time >= begin) & (s.time < end)) for s in states]
    mismatch = lay_out(states, [e + rng.normal(0, NOISE, len(s.time)) for s, e in zip(states, level, strict=True)])
    noise = white(mismatch)
    assert (find_events(mismatch, noise, mismatch.target / NOISE) is not None) == found


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
