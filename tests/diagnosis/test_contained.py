"""What a simulation is made of, read from its own current."""

from dataclasses import replace

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.contained import _component, _not_cancelled, contained
from pido.diagnosis.library import Library
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from tests.diagnosis.planted import NOISE, white


def _recordings(force, feeds=(0.3, 0.7, 1.8, 15.0)):
    """x goes to and fro at a few feeds, with stops; force : v -> (n,), A, which is all that is simulated."""
    for k in range(3):
        rng = np.random.default_rng(k)
        v = np.repeat(rng.choice(feeds, 100) * rng.choice([-1, 0, 1], 100), 40)
        v = np.convolve(v, np.ones(5) / 5, "same")
        v = np.where(np.abs(v) < 1e-9, 0.0, v)
        t = np.arange(len(v)) * 0.02
        columns = {"time": t, "v_x": v, "pos_x": np.cumsum(v) * 0.02, "a_x": np.gradient(v, t), "curr_x_sim": force(v)}
        yield Recording(PartInfo(part=f"p{k}", machine="m", order=k + 1), columns)


@pytest.mark.parametrize("v_s", [1.0, 2.5])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_friction_that_falls_with_speed_is_coulombs_and_stribecks(v_s, seed):
    """Neither is all of it what falls with the speed, nor is there anything beside the two."""
    falls = _recordings(lambda v: (0.7 + 0.48 * np.exp(-((np.abs(v) / v_s) ** 2))) * np.sign(v))
    states, rng = axis_states(list(falls), "x"), np.random.default_rng(5)
    mismatch = lay_out(states, [rng.normal(0, NOISE, len(s.time)) for s in states])
    found = contained(mismatch, CATALOGUE, white(mismatch), np.random.default_rng(seed))
    assert set(found) == {"coulomb_friction", "stribeck_friction"}
    np.testing.assert_allclose([found[i].amplitudes[0] for i in sorted(found)], [0.7, 0.48], rtol=0.05)


@pytest.mark.parametrize(
    "more",
    [
        lambda v: 0.1 * v**0.8,
        lambda v: 0.15 * v**0.6,
        lambda v: 0.04 * v - 0.0003 * v**2,
        lambda v: 0.3 * np.arcsinh(v / 5),
    ],
)
def test_a_friction_that_bends_has_coulombs_in_its_size(more):
    """A friction that falls over all speeds, and one that rises, say a bend as well: Coulomb's is not what those two
    leave of it, none at all or less than nothing."""
    bends = _recordings(lambda v: (1 + more(np.abs(v))) * np.sign(v), (0.3, 2.0, 5.0, 10.0, 20.0, 30.0, 40.0))
    states, rng = axis_states(list(bends), "x"), np.random.default_rng(5)
    mismatch = lay_out(states, [rng.normal(0, NOISE, len(s.time)) for s in states])
    found = contained(mismatch, CATALOGUE, white(mismatch), np.random.default_rng(0))
    assert 0.9 < found["coulomb_friction"].amplitudes[0] < 1.3


def test_a_component_is_as_large_as_it_is_whichever_object_stands_for_it():
    """A shape that was settled again is another object of the same term: left out, it must be left out."""
    states = axis_states(list(_recordings(lambda v: 0.7 * np.sign(v))), "x")
    mismatch = lay_out(states, [0.7 * np.sign(s.v) + 0.02 * s.v for s in states])
    terms = [Term(m) for m in CATALOGUE if m.id in ("viscous_friction", "inertia")]
    library = Library(mismatch, terms)
    library.whiten(white(mismatch))
    assert library.noise is not None
    again = replace(terms[0])
    assert again is not terms[0]
    own = _component(library, library.noise, terms, terms[0])
    assert own.size > NOISE
    assert _component(library, library.noise, terms, again).size == own.size


def test_of_two_that_take_each_other_back_one_is_no_component():
    """y turns with x in all parts: the difference of their accelerations would mend whatever else there is."""
    states = []
    for recording in _recordings(lambda v: 0.7 * np.sign(v)):
        more = {f"{name}_y": 0.4 * recording.columns[f"{name}_x"] for name in ("v", "pos", "a")}
        more["a_y"] = more["a_y"] * (1 + 0.05 * np.random.default_rng(1).normal(size=len(recording)))
        states += axis_states([replace(recording, columns={**recording.columns, **more})], "x")
    mismatch = lay_out(states, [s.a - 2.5 * s.others["y"].a for s in states])
    terms = [Term(m) for m in CATALOGUE if m.id in ("inertia", "axis_coupling")]
    terms = [t if t.mechanism.id == "inertia" else t.with_shape(source=3.0) for t in terms]
    library = Library(mismatch, terms)
    noise = white(mismatch)
    library.whiten(noise)
    assert len(_not_cancelled(library, noise, terms)) == 1
    assert _not_cancelled(library, noise, terms[:1]) == terms[:1]
