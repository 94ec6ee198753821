"""Effects from a textbook, hidden in the current of a small machine of this test's own making.

The machine here shares nothing with the catalogue: exact signs, plain Euler steps, noise of its own. One axis has a
current, so that a case takes seconds.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from pido.core.errors import DiagnosisError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.correct import correct
from pido.diagnosis.diagnose import diagnose

pytestmark = pytest.mark.thorough

RATE = 50.0
NOISE = 0.05


@dataclass(frozen=True)
class Ride:
    """What the axes of one part really do."""

    time: np.ndarray
    pos: np.ndarray
    v: np.ndarray
    a: np.ndarray
    v_y: np.ndarray
    force: np.ndarray
    mrr: np.ndarray


def ride(rng, seconds=70.0):
    n = int(seconds * RATE)
    v = np.zeros((2, n))
    for k in range(2):
        at = 0
        while at < n:
            length = int(rng.uniform(0.6, 3.0) * RATE)
            v[k, at : at + length] = (
                rng.choice([-1, 1]) * rng.choice([0.0, 1.0, 3.0, 6.0, 12.0, 25.0]) * rng.uniform(0.8, 1.2)
            )
            at += length
    # Speeds change over a fifth of a second; a stop is a stop.
    width = int(0.2 * RATE)
    v = np.array([np.convolve(row, np.ones(width) / width, "same") for row in v])
    v[np.abs(v) < 1e-9] = 0.0
    cuts = np.repeat(rng.random(n // 200 + 1) < 0.6, 200)[:n]
    depth = np.repeat(rng.uniform(0.3, 1.0, n // 100 + 1), 100)[:n]
    force = 150.0 * cuts * depth * np.sign(np.where(v[0] == 0, 1.0, v[0]))
    mrr = 40.0 * cuts * depth * np.hypot(*v)
    return Ride(np.arange(n) / RATE, 100 + np.cumsum(v[0]) / RATE, v[0], np.gradient(v[0]) * RATE, v[1], force, mrr)


def coloured(rng, n):
    e = np.empty(n)
    last = 0.0
    for i, w in enumerate(rng.normal(size=n)):
        last = 0.6 * last + 0.8 * w
        e[i] = last
    return NOISE * e


def simulated(r):
    return 0.4 * np.sign(r.v) + 0.002 * r.force


def parts(effect, seed, count=5):
    """Recordings whose simulation lacks `effect`; the effect of each as well."""
    rng = np.random.default_rng(seed)
    out, truth = [], []
    for k in range(count):
        r = ride(rng)
        lacking = effect(r)
        columns = {
            "time": r.time,
            "pos_x": r.pos, "v_x": r.v + rng.normal(scale=1e-3, size=len(r.v)), "a_x": r.a,
            "v_y": r.v_y, "a_y": np.gradient(r.v_y) * RATE, "v_z": 0 * r.v, "a_z": 0 * r.v,
            "f_x_sim": r.force, "f_y_sim": 0.3 * np.abs(r.force), "f_z_sim": 0.2 * np.abs(r.force), "mrr_sim": r.mrr,
            "curr_x_sim": simulated(r),
            "curr_x": simulated(r) + lacking + coloured(rng, len(r.v)),
        }  # fmt: skip
        out.append(Recording(PartInfo(part=f"p{k}", machine="m", order=k + 1), columns))
        truth.append(lacking)
    return out, truth


EFFECTS = {
    "viscous_friction": lambda r: 0.012 * r.v,
    "inertia": lambda r: 0.004 * r.a,
    "stribeck_friction": lambda r: 0.25 * np.exp(-((np.abs(r.v) / 4.0) ** 2)) * np.sign(r.v),
    "axis_coupling": lambda r: 0.01 * r.v_y,
    "miscalibrated:coulomb_friction": lambda r: 0.08 * np.sign(r.v),
    "miscalibrated:cutting_force": lambda r: 0.0007 * r.force,
    "sensor_gain": lambda r: 0.2 * simulated(r),
    "sensor_offset": lambda r: 0.06 + 0 * r.v,
    "unknown": lambda r: 0.05 * np.sin(2 * np.pi * r.time / 7.3),
}
SLOWLY = ("viscous_friction", "miscalibrated:coulomb_friction", "sensor_gain")
"""Of which another of their kind is asked at every `make test-thorough`; these with `make test-slow`."""


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n in SLOWLY else n for n in EFFECTS])
def test_a_concealed_effect_is_named_first_and_removed_from_a_part_that_was_not_seen(name):
    recordings, truth = parts(EFFECTS[name], seed=len(name))
    found = diagnose(recordings[:-1])
    assert [(f.axis, f.mechanism) for f in found.findings][:1] == [("x", name)]
    if name != "unknown":  # the phase of a wave in time starts anew in every part only if the machine's clock says so
        effect = correct(found.model, recordings[-1]).mismatch["x"]
        assert np.mean((effect - truth[-1]) ** 2) < 0.1 * np.mean(truth[-1] ** 2)


@pytest.mark.parametrize("seed", [1, 2, pytest.param(3, marks=pytest.mark.slow)])
def test_nothing_is_found_where_nothing_is_missing(seed):
    recordings, _ = parts(lambda r: 0 * r.v, seed)
    found = diagnose(recordings)
    assert found.findings == ()
    assert found.clean_axes == ("x",)
    assert all(np.all(p.mismatch["x"] == 0) for p in found.parts.values())


def test_a_correction_reads_no_recorded_current():
    recordings, _ = parts(EFFECTS["viscous_friction"], seed=5)
    found = diagnose(recordings[:-1])
    last = recordings[-1]
    blind = last.rows(slice(None)).with_columns(curr_x=np.full(len(last), np.nan))
    np.testing.assert_array_equal(correct(found.model, last).corrected["x"], correct(found.model, blind).corrected["x"])


def test_a_delay_of_the_recording_is_a_fault_of_the_data_and_not_physics():
    recordings, _ = parts(lambda r: 0 * r.v, seed=8)
    late = [
        r.with_columns(
            curr_x=np.interp(r.time - 0.05, r.time, r["curr_x_sim"]) + coloured(np.random.default_rng(k), len(r))
        )
        for k, r in enumerate(recordings)
    ]
    found = diagnose(late)
    assert found.findings[0].mechanism == "time_misalignment"
    assert found.findings[0].parameters["shift"].value == pytest.approx(0.05, abs=0.005)


def test_the_answer_does_not_depend_on_the_order_in_which_parts_are_given():
    recordings, _ = parts(EFFECTS["inertia"], seed=9)
    one, other = diagnose(recordings), diagnose(recordings[::-1])
    assert [f.mechanism for f in one.findings] == [f.mechanism for f in other.findings]
    assert one.findings[0].parameters["m"].value == pytest.approx(other.findings[0].parameters["m"].value, rel=1e-6)


def test_one_part_alone_is_answered_by_blocks_and_says_so():
    recordings, _ = parts(EFFECTS["viscous_friction"], seed=4, count=1)
    found = diagnose(recordings)
    assert found.findings[0].mechanism == "viscous_friction"
    assert "block" in found.findings[0].fit.scheme
    assert any("1 part(s) only" in n for n in found.notes)


def apart(recording):
    """The recording in the first half of the time, the simulation in the second."""
    early = recording.time < recording.time.mean()
    return recording.with_columns(
        curr_x=np.where(early, recording["curr_x"], np.nan), curr_x_sim=np.where(early, np.nan, recording["curr_x_sim"])
    )


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda r: r.with_columns(curr_x=np.ones(len(r))), "'curr_x' is constant"),
        (apart, "do not overlap"),
        (lambda r: r.rows(slice(0, 50)), "at least"),
    ],
)
def test_what_cannot_be_compared_is_refused_with_a_reason(change, says):
    recordings, _ = parts(EFFECTS["inertia"], seed=3, count=3)
    with pytest.raises(DiagnosisError, match=says):
        diagnose([change(r) for r in recordings])
