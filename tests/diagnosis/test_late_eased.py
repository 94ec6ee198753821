"""A friction that remembers: its level follows how fast the axis has lately been."""

from dataclasses import replace

import numpy as np
import pytest

from pido.core.recording import Recording
from pido.diagnosis.late_eased import EasedLately
from pido.diagnosis.models import AxisModel, as_json, axis_models
from pido.diagnosis.terms import Term
from pido.physics.drive import answered_late
from tests.diagnosis.planted import STEP, found_in, planted

TAU, SPEED = 2.5, 3.0
LAW = EasedLately("v_x", "v_x", "sgn u", "mm/s", "mm/s")


def fast_and_slow(k: int, recording: Recording) -> Recording:
    """The same part with stretches of some seconds in which everything goes at a tenth of its speed."""
    spell = np.random.default_rng(100 + k).choice([0.1, 1.0], size=20)
    v = recording["v_x"] * np.repeat(spell, len(recording) // 20)
    moved = {"v_x": v, "pos_x": np.cumsum(v) * STEP, "a_x": np.gradient(v, recording.time)}
    return replace(recording, columns={**recording.columns, **moved})


def film(state):
    late = answered_late(np.abs(state.v)[None], state.time, TAU)[0]
    return np.sign(state.v) * np.exp(-late / SPEED)


def test_a_film_that_motion_builds_up_is_found_with_its_time_and_speed():
    term = found_in(film, count=5, change=fast_and_slow)
    assert isinstance(term.mechanism, EasedLately)
    assert (term.mechanism.cause, term.mechanism.signal, term.mechanism.form) == ("v_x", "v_x", "sgn u")
    assert dict(term.shape) == {"tau": pytest.approx(TAU, rel=0.15), "c": pytest.approx(SPEED, rel=0.15)}


def test_a_friction_that_only_eases_with_speed_at_once_is_not_said_to_remember():
    terms = found_in(lambda s: np.sign(s.v) * np.exp(-np.abs(s.v) / SPEED), count=5, change=fast_and_slow)
    assert not isinstance(terms.mechanism, EasedLately) or dict(terms.shape)["tau"] < 0.05


def test_it_is_written_and_read_again():
    states = planted(film, count=1, change=fast_and_slow)[0].mismatch.states
    term = Term(LAW, (("tau", TAU), ("c", SPEED)))
    apart = np.abs(np.array([0.0, 1.0]) @ term.columns(states) - film(states[0]))
    assert np.mean(apart > 1e-4) < 0.01  # but where the axis turns round
    read = axis_models(as_json({"x": AxisModel("x", 0.1, (term,), (np.ones(2),))}))["x"]
    assert read.terms == (term,)
