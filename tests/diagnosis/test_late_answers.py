"""What is quick passes the loop of a drive: its law comes back as it was, with the lag beside it."""

from dataclasses import replace

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.confirm import even
from pido.diagnosis.estimate import estimate, settle_shapes
from pido.diagnosis.late import Lagged
from pido.diagnosis.loop import answered
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mismatch import Mismatch, lay_out
from pido.diagnosis.models import AxisModel, as_json, axis_models
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term

BY_ID = {m.id: m for m in CATALOGUE}
TAU, SIZE, SPEED = 0.03, 0.3, 3.0
STRIBECK = Term(BY_ID["stribeck_friction"], (("v_s", 5.0), ("delta", 2.0), ("rest", 0.0)))
FINE = 20  # steps of the machine per sample


def recordings(lag: float, count=4, seconds=60.0, step=0.02):
    """x goes to and fro, slowly through standstill; its friction, behind a servo solved in fine steps, as current."""
    for k in range(count):
        rng = np.random.default_rng(k)
        t = np.arange(0, seconds, step / FINE)
        v = sum(rng.uniform(2, 8) * np.sin(2 * np.pi * rng.uniform(0.1, 0.8) * t + rng.uniform(0, 6)) for _ in range(3))
        current, friction = np.zeros(len(t)), SIZE * np.exp(-((v / SPEED) ** 2)) * np.sign(v)
        share = 1 - np.exp(-step / FINE / lag) if lag else 1.0
        for i in range(1, len(t)):
            current[i] = current[i - 1] + share * (friction[i] - current[i - 1])
        seen = slice(None, None, FINE)
        noisy = current[seen] + rng.normal(0, 0.02, len(t[seen]))
        columns = {
            "time": t[seen], "v_x": v[seen], "a_x": np.gradient(v, t)[seen], "curr_x": noisy,
            "pos_x": (np.cumsum(v) * step / FINE)[seen],
        }  # fmt: skip
        yield Recording(PartInfo(part=f"p{k}", machine="m", order=k + 1), columns)


def laid_out(lag: float) -> Mismatch:
    parts = list(recordings(lag))
    return lay_out(axis_states(parts, "x"), [p["curr_x"] for p in parts])


def holds(interval: tuple[float, float], value: float) -> bool:
    return interval[0] <= value <= interval[1]


def test_a_friction_behind_a_loop_comes_back_as_it_was_with_the_lag_beside_it():
    mismatch = laid_out(TAU)
    noise = even(mismatch)
    at_once = settle_shapes(mismatch, noise, [STRIBECK])
    blunted = estimate(mismatch, noise, at_once, np.random.default_rng(0)).parameters[0]
    assert not holds(blunted["F_s - F_c"].ci95, SIZE)
    late = answered(mismatch, noise, at_once)
    said = estimate(mismatch, noise, late, np.random.default_rng(0)).parameters[0]
    assert holds(said["F_s - F_c"].ci95, SIZE)
    assert holds(said["v_s"].ci95, SPEED)
    assert said["lag"].value == pytest.approx(TAU, rel=0.1)
    assert holds(said["lag"].ci95, TAU)
    assert said["lag"].ci95[1] < 1.3 * said["lag"].ci95[0]


def test_what_comes_at_once_has_no_lag():
    mismatch = laid_out(0.0)
    terms = settle_shapes(mismatch, even(mismatch), [STRIBECK])
    assert answered(mismatch, even(mismatch), terms) == terms


@pytest.mark.parametrize(
    "term",
    [
        Term(BY_ID["sensor_offset"]),
        Term(BY_ID["torque_ripple"], (("L", 5.0), ("harmonics", 0.0), ("late", 0.03))),
        Term(Lagged("v_x", "u", "mm/s"), (("tau", 0.03),)),
        Term(BY_ID["current_saturation"], (("I_k", 1.0), ("form", 0.0))),
    ],
    ids=lambda t: t.name,
)
def test_a_sensor_a_limit_of_the_current_and_what_has_a_lag_of_its_own_pass_no_loop(term):
    mismatch = laid_out(TAU)
    both = answered(mismatch, even(mismatch), [STRIBECK, term])
    assert both[0].lag > 0
    assert both[1].lag == 0
    assert answered(mismatch, even(mismatch), [term]) == [term]


def test_what_has_no_name_passes_the_loop():
    mismatch = laid_out(TAU)
    (term,) = answered(mismatch, even(mismatch), [replace(STRIBECK, name="unknown")])
    assert term.lag == pytest.approx(TAU, rel=0.1)


def test_the_lag_is_in_the_model_that_corrects_other_parts():
    mismatch = laid_out(TAU)
    term = answered(mismatch, even(mismatch), [STRIBECK])[0]
    model = AxisModel("x", 0.02, (term,), (np.array([SIZE]),))
    again = axis_models(as_json({"x": model}))["x"]
    assert again.terms == model.terms
    (part, *_), (state, *_) = list(recordings(TAU)), mismatch.states
    corrected = again.effect(np.zeros(len(state.time)), part, state)
    left = np.sqrt(np.mean((part["curr_x"] - corrected) ** 2))
    at_once = AxisModel("x", 0.02, (term.at_once(),), (np.array([SIZE]),)).effect(
        np.zeros(len(state.time)), part, state
    )
    assert left < 0.5 * np.sqrt(np.mean((part["curr_x"] - at_once) ** 2))
