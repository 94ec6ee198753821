"""What is seen in a few seconds of one part is told, though nothing can be proved from it."""

from dataclasses import replace

import numpy as np
import pytest

from pido.diagnoses import summary
from pido.diagnosis.answers import note_of_unproved
from pido.diagnosis.finding import Diagnosis
from pido.diagnosis.gates import Gate
from pido.diagnosis.terms import Term
from pido.reports.diagnosis import verdict
from tests.diagnosis.planted import STEP, VISCOUS, planted

FAST = Term(VISCOUS, gates=(Gate("v_x", low=30.0),))


def once(k, recording):
    """The second part goes fast for a second, from its tenth on; no other does."""
    v = recording["v_x"].copy()
    if k == 1:
        v[1000:1100] += 40.0 * np.hanning(100)
    moved = {"v_x": v, "pos_x": np.cumsum(v) * STEP, "a_x": np.gradient(v, STEP)}
    return replace(recording, columns={**recording.columns, **moved})


def test_the_note_says_where_it_is_what_it_could_be_and_what_to_record():
    library, noise = planted(lambda s: FAST.columns([s])[0], strength=0.5, change=once)
    note = note_of_unproved(library.mismatch, noise, [FAST]) or ""
    assert note.startswith("axis x: something is there that is more than noise, nearly all of it in ")
    assert "most in part p1 from 10" in note
    assert "It could be viscous_friction (" in note
    assert "only where v_x > 30 mm/s" in note
    assert note.endswith("Record that motion again, in further parts.")


@pytest.mark.parametrize("terms", [[], [FAST]])
def test_nothing_is_said_of_noise(terms):
    library, noise = planted(lambda s: FAST.columns([s])[0], strength=0.0, change=once)
    assert note_of_unproved(library.mismatch, noise, terms) is None


def test_nothing_is_said_of_what_was_seen_often_and_did_not_stand():
    library, noise = planted(lambda s: s.v, strength=0.5)
    assert note_of_unproved(library.mismatch, noise, [Term(VISCOUS)]) is None


@pytest.mark.parametrize(
    ("clean", "unproved", "said"),
    [
        (("x", "y"), (), "agree within the noise: nothing systematic is left out on x, y."),
        (
            ("x", "y"),
            ("y",),
            "on y. Simulation and recording agree within the noise on x.",
        ),
        (
            ("y",),
            ("y",),
            "Nothing is proved to be left out. Seen in a few seconds, and not proved by",
        ),
    ],
)
def test_the_page_does_not_call_an_axis_clean_on_which_something_is_seen(clean, unproved, said):
    found = Diagnosis((), clean, {}, {}, unproved=unproved)
    assert said in verdict(found)
    lines = "\n".join(summary(found))
    assert (f"{clean[-1]}   something is seen" in lines) == bool(unproved)
    assert ("nothing significant" in lines) == (set(clean) != set(unproved))
