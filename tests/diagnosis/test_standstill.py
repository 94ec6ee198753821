"""A friction that nothing but standstill shows is what the axis holds there, whatever curve over speed fits it too."""

from dataclasses import replace

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.answers import equation_text
from pido.diagnosis.bands import dead_bands, speed_of
from pido.diagnosis.correct import correct
from pido.diagnosis.forms import plainest
from pido.diagnosis.gates import Gate
from pido.diagnosis.library import Library, basis
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mechanisms.sliding import SIMULATED
from pido.diagnosis.misfit import useless
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.models import AxisModel, as_json, known_of
from pido.diagnosis.search import first_look, search
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term, fit
from tests.diagnosis.feeds import laid_out
from tests.diagnosis.planted import NOISE, part, white

BY_ID = {m.id: m for m in CATALOGUE}


@pytest.mark.parametrize(("v_s", "name"), [(0.05, "standstill_friction"), (8.0, "stribeck_friction")])
def test_what_falls_with_speed_before_the_axis_moves_is_held_at_standstill(v_s, name):
    states = axis_states([part(k, stops=True) for k in range(3)], "x")
    rng = np.random.default_rng(0)
    effect = [s.held * np.exp(-np.abs(s.v) / v_s) for s in states]
    mismatch = lay_out(states, [e + rng.normal(0, NOISE, len(e)) for e in effect])
    noise = white(mismatch)
    falls = Term(BY_ID["stribeck_friction"], (("v_s", v_s), ("delta", 1.0), ("rest", 1.0)))
    library = Library(mismatch, [falls, Term(BY_ID["standstill_friction"], (("rest", 0.0),))])
    library.whiten(noise)
    assert [t.name for t in plainest(library, noise, [falls])] == [name]


@pytest.mark.parametrize("v_0", [0.0, 0.2, *(pytest.param(v, marks=pytest.mark.thorough) for v in (0.8, 3.0))])
def test_friction_that_rises_with_the_speed_is_one_law(v_0):
    """Its sign is smooth in another form than the catalogue's."""
    mismatch, _ = laid_out(lambda s: 0.3 * s.v / np.maximum(np.hypot(s.v, v_0), 1e-9) * s.moving)
    look = first_look(mismatch, np.random.default_rng(0))
    (found,) = search(look, 1, False, np.random.default_rng(0)).terms
    assert found.mechanism.id == "coulomb_friction"
    assert ("tanh" in equation_text(found, "x")) == (v_0 > 0)


def noisy(name, seconds_in_motion):
    """A rest whose speed is noisy, with some slow motion before it."""
    rng, t = np.random.default_rng(0), np.arange(2000) * 0.01
    v = np.where(t < seconds_in_motion, 20 * np.sin(t), 0.0) + rng.normal(0, 0.05, len(t))
    columns = {"time": t, "v_x": v, "curr_x_sim": np.zeros(len(t)), "curr_x": np.zeros(len(t))}
    return Recording(PartInfo(part=name, machine="m"), columns)


def test_an_axis_has_one_dead_band_whatever_it_does_in_one_part():
    moves, rests = noisy("moves", 15.0), noisy("rests", 0.0)
    assert axis_states([rests], "x")[0].moving.any()  # by itself, this part takes noise for motion
    assert not axis_states([moves, rests], "x")[1].moving.any()


def test_a_part_is_corrected_with_the_dead_bands_of_the_diagnosis():
    moves, rests = noisy("moves", 15.0), noisy("rests", 0.0)
    states = axis_states([moves], "x")
    friction = AxisModel("x", 0.1, (Term(BY_ID["coulomb_friction"]),), (np.ones(1),), known=known_of(states))
    model = as_json({"x": friction}) | {"dead_bands": dead_bands([moves])}
    assert not correct(model, rests).mismatch["x"].any()


def test_quick_turns_are_no_noise_at_standstill():
    """A slow sample between two quick ones bends a lot."""
    t = np.arange(2000) * 0.01
    v = 120 * np.abs((6.7 * t) % 2 - 1) - 60
    v = np.where(v > 0, v, 2 * v)
    recording = Recording(PartInfo(part="turns", machine="m"), {"time": t, "v_x": v, "curr_x": v})
    assert dead_bands([recording] * 5) == {"x": 0.02}


def test_a_feed_below_the_usual_band_is_motion_where_the_speed_has_no_noise():
    creeps = np.tile(np.r_[np.zeros(100), np.linspace(0, 0.012, 10), np.full(80, 0.012), np.full(110, -4.0)], 4)

    def bands(v):
        columns = {"time": np.arange(len(v)) * 0.01, "v_x": v}
        return dead_bands([Recording(PartInfo(part="p", machine="m", order=1), columns)])

    assert bands(creeps) == {"x": pytest.approx(0.006)}
    seldom = np.r_[creeps, np.tile(np.r_[np.zeros(100), np.full(100, -4.0)], 300)]
    assert bands(seldom) == {"x": pytest.approx(0.006)}
    assert bands(creeps + np.random.default_rng(0).normal(0, 1e-3, len(creeps))) == {"x": 0.02}
    assert bands(np.where(np.abs(creeps) < 1, 1e-12 * creeps, creeps)) == {"x": 0.02}


def left_at_stops(state, seed):
    """Another part of the friction at each standstill, with any sign."""
    stops = np.cumsum(np.diff(state.moving.astype(int), prepend=0) == -1)
    return np.random.default_rng(seed).normal(size=int(stops[-1]) + 1)[stops] * ~state.moving


@pytest.mark.parametrize("everywhere", [False, True])
def test_a_wave_along_the_travel_is_seen_where_the_axis_travels(everywhere):
    """Through one number for each stop a wave of some length always goes."""
    ripple = BY_ID["torque_ripple"]
    states = axis_states([part(k, stops=True) for k in range(3)], "x")
    rng = np.random.default_rng(1)
    of_stops = [left_at_stops(s, k) for k, s in enumerate(states)]
    wave = Term(ripple, (("L", 2.9), ("harmonics", 0.0), ("late", 0.0)))
    effect = [wave.of_part(s)[0] if everywhere else e for s, e in zip(states, of_stops, strict=True)]
    mismatch = lay_out(states, [2 * NOISE * e + rng.normal(0, NOISE, len(e)) for e in effect])
    noise = white(mismatch)
    library = Library(mismatch, [wave])
    library.whiten(noise)
    rest = (Gate("v_x", -0.05, 0.05),)
    waves = [wave.with_shape(L=float(L)) for L in np.geomspace(0.5, 8.0, 300)]
    waves = [wave] if everywhere else [replace(w, gates=rest) for w in waves]
    best = max(waves, key=lambda term: -fit(mismatch, noise, [term]).rss)
    _, reason = useless(library, noise, [best])
    assert reason is None if everywhere else "nearly all of it is at standstill" in (reason or "")


@pytest.mark.parametrize(("low", "smooth"), [(4.0, False), (0.5, True)])
def test_a_sign_that_rises_smoothly_is_one_that_jumps_where_a_box_has_only_faster_motion(low, smooth):
    """Strong enough for BIC to prefer the rise in both boxes, of 4 % and of nearly all."""
    beyond = (Gate("v_x", low=low),)
    mismatch, _ = laid_out(lambda s: 3.0 * np.tanh(s.v / 2.2) * (s.v > low))
    rising = Term(BY_ID["coulomb_friction"], (("rest", SIMULATED - 1.0), ("v_0", 2.2)), beyond)
    library = Library(mismatch, [rising])
    noise = white(mismatch)
    library.whiten(noise)
    jumping = rising.with_shape(rest=0.0)
    assert basis(library, noise, [rising]).bic < basis(library, noise, [jumping]).bic - 10
    assert plainest(library, noise, [rising]) == [rising if smooth else jumping]


@pytest.mark.parametrize(("rate", "of_angle"), [(50.0, None), (500.0, 22_800.0)])
def test_a_speed_follows_from_a_counter_at_any_rate_and_from_an_angle_where_no_fast_turn_looks_slow(rate, of_angle):
    """3800 1/min are 456 degrees between samples at 50 Hz, which an angle shows as 96."""
    time = np.arange(500) / rate
    turned = 22_800.0 * time

    def speed(position):
        return speed_of(Recording(PartInfo(part="p", machine="m"), {"time": time, "pos_sp": position}), "sp")

    np.testing.assert_allclose(speed(turned), 22_800.0)
    found = speed(turned % 360.0)
    assert found is None if of_angle is None else np.allclose(found, of_angle)
