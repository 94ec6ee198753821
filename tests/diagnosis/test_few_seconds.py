"""A law that acts in a few seconds of one part only is shown by pieces of these, and said to be shown by no more."""

from dataclasses import replace

import numpy as np
import pytest

from pido.diagnosis.diagnose import diagnose
from pido.diagnosis.gates import Gate
from pido.diagnosis.identify import Answer
from pido.diagnosis.library import Library
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.seldom import blocks_of, in_pieces, of_few_seconds
from pido.diagnosis.select import grid_terms
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from tests.diagnosis.planted import STEP, VISCOUS, part, planted

FAST = Term(VISCOUS, gates=(Gate("v_x", low=30.0),))
COULOMB = next(m for m in CATALOGUE if m.id == "coulomb_friction")


def once(k, recording):
    """The second part goes fast for two and a half seconds, from its tenth on; no other does."""
    v = recording["v_x"].copy()
    if k == 1:
        v[1000:1250] = 35.0 + 60.0 * np.hanning(250)
    moved = {"v_x": v, "pos_x": np.cumsum(v) * STEP, "a_x": np.gradient(v, STEP)}
    return replace(recording, columns={**recording.columns, **moved})


def pulse(state):
    """A force of one level over the same seconds."""
    return ((state.v > 30.0) & (state.part == "p1")).astype(float)


def asked(effect, strength=0.6):
    library, noise = planted(effect, strength=strength, change=once)
    laws = [
        FAST,
        *(replace(t, gates=FAST.gates) for t in grid_terms(COULOMB, library.mismatch.states, "coulomb_friction")),
    ]
    library = Library(library.mismatch, laws)
    library.whiten(noise)
    answer = Answer("x")
    return of_few_seconds(library, noise, laws, answer, 50), answer, library, noise


def test_a_law_is_found_by_the_pieces_of_the_seconds_that_show_it():
    (fine, kept), answer, library, _ = asked(lambda s: FAST.columns([s])[0])
    assert [t.name for t in kept] == ["viscous_friction"]
    assert answer.q_values[0] < 0.01
    few = blocks_of(library.mismatch, FAST.columns(library.mismatch.states)[0])
    assert few is not None
    assert len(few) <= 4
    inside = np.isin(library.mismatch.block, few)
    assert len(np.unique(fine.mismatch.block[inside])) >= 8
    pairs = np.unique(np.stack([library.mismatch.block, fine.mismatch.block])[:, ~inside], axis=1)
    assert pairs.shape[1] == len(np.unique(library.mismatch.block[~inside]))  # all others are as they were
    assert np.all(np.diff(fine.mismatch.block) >= 0)
    assert fine.mismatch.scheme == "leave-one-block-out"
    assert len(np.unique(fine.mismatch.fold[inside])) == 5


def test_a_force_over_the_same_seconds_is_no_law():
    (_, kept), _, _, _ = asked(pulse)
    assert kept == []


def test_noise_is_no_law():
    (_, kept), _, _, _ = asked(lambda s: FAST.columns([s])[0], strength=0.0)
    assert kept == []


def told(effect):
    """What a diagnosis says of three parts with a simulated friction, and an effect beside it: state -> (n,), A."""
    rng = np.random.default_rng(1)
    recordings = [once(k, part(k)) for k in range(3)]
    for k, (recording, state) in enumerate(zip(recordings, axis_states(recordings, "x"), strict=True)):
        simulated = 0.5 * np.tanh(recording["v_x"] / 0.5)
        recorded = simulated + effect(state) + rng.normal(0, 0.05, len(simulated))
        columns = {**recording.columns, "curr_x_sim": simulated, "curr_x": recorded}
        recordings[k] = replace(recording, columns=columns)
    return diagnose(recordings)


@pytest.mark.thorough
def test_a_diagnosis_names_a_law_of_few_seconds_and_says_how_little_shows_it():
    (finding,) = told(lambda s: 0.004 * FAST.columns([s])[0]).findings
    assert finding.mechanism == "viscous_friction"
    low, high = finding.parameters["F_v"].ci95
    assert low < 0.004 < high
    assert "shown by a few seconds alone, most of them in part p1 from 10" in finding.where.summary
    assert finding.to_record.startswith("the motion of part p1 from 10")
    assert finding.fit.scheme == "leave-one-block-out"


@pytest.mark.thorough
def test_a_level_over_these_seconds_may_be_anything_and_is_told_as_that():
    found = told(lambda s: 0.3 * pulse(s))
    assert found.findings == ()
    assert found.unproved == ("x",)
    assert any("something is there that is more than noise" in note for note in found.notes)


@pytest.mark.parametrize("law", ["tool_wear", "thermal_drift"])
def test_what_changes_over_hours_gives_its_box_to_a_law_that_seconds_can_show(law):
    library, noise = planted(lambda s: FAST.columns([s])[0], strength=0.6, change=once)
    (found,) = of_few_seconds(library, noise, [replace(FAST, name=law)], Answer("x"), 50)[1]
    assert (found.name, found.gates) == ("viscous_friction", FAST.gates)


def test_what_acts_often_is_not_cut():
    library, noise = planted(lambda s: s.v, strength=0.5)
    assert in_pieces(library.mismatch, noise, [Term(VISCOUS)]) is None
