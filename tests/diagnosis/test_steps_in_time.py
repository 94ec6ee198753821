"""Samples that were lost or repeated in one part are told as that: its part, its moment, its size, no other part."""

from dataclasses import replace

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.correct import correct, own_shift
from pido.diagnosis.datafaults import input_findings
from pido.diagnosis.diagnose import diagnose
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.models import axis_models
from pido.diagnosis.state import axis_states
from pido.diagnosis.timing import find_delay, shift_target
from pido.diagnosis.whiten import Noise
from tests.diagnosis.feeds import NOISE, recordings

STEP = 0.02  # s, of these recordings
PARTS = 4


def recorded(part=None, at=0.0, rows=0, late=(0.0,) * PARTS, drift=0.0, missing=0.0):
    """x with friction and inertia. In `part`, |rows| samples are lost (rows < 0) or repeated (rows > 0) from `at` s on,
    and the time column runs on. missing : A – friction that the simulation has not."""
    rng = np.random.default_rng(7)
    for k, recording in enumerate(recordings(PARTS)):
        t, v = recording.time, recording["v_x"]
        true = recording["curr_x_sim"] + missing * np.sign(v) * (np.abs(v) > 0.02)
        source = np.arange(len(t), dtype=float)
        if k == part:
            source[t >= at] -= rows
        clock = np.interp(source, np.arange(len(t)), t) - late[k] - drift * t
        seen = np.interp(clock, t, true) + rng.normal(0, NOISE, len(t))
        kept = {n: c for n, c in recording.columns.items() if not n.endswith("_sp") and "_sp_" not in n}
        yield Recording(recording.part, kept | {"curr_x": seen})


def delay_of(made):
    states = axis_states(made, "x")
    mismatch = lay_out(states, [s.curr - s.sim for s in states])
    return mismatch, find_delay(
        {"x": mismatch}, {"x": Noise(np.zeros(0), np.full(mismatch.n, NOISE), 1.0, mismatch.usable)}
    )


@pytest.mark.parametrize(
    ("part", "at", "rows", "word"),
    [
        pytest.param(2, 21.3, -5, "lost", marks=pytest.mark.thorough),
        pytest.param(1, 12.1, -20, "lost", marks=pytest.mark.thorough),
        (3, 26.0, 5, "repeated"),
    ],
)
def test_samples_lost_or_repeated_in_one_part_are_one_finding_of_that_part_from_then_on(part, at, rows, word):
    made = list(recorded(part, at, rows))
    found = diagnose(made)
    (shift,) = found.findings
    assert (shift.mechanism, shift.kind) == ("time_misalignment", "data_fault")
    assert shift.fit.scheme == f"one step in time in p{part}"
    size, when = shift.parameters[f"step_p{part}"], shift.parameters[f"from_p{part}"]
    assert abs(size.value - rows * STEP) < STEP / 2
    assert abs(when.value - at) < 0.5
    assert when.ci95[0] - STEP <= at <= when.ci95[1] + STEP
    assert set(shift.parameters) == {f"step_p{part}", f"from_p{part}"}
    (interval,) = shift.where.intervals
    assert (interval.part, interval.t_start) == (f"p{part}", when.value)
    assert f"in part p{part} from" in shift.where.summary
    assert f"samples {word} there" in shift.where.summary
    assert f"{abs(rows)} samples were {word} in the recording of p{part}" in shift.said
    assert f"p{part} at {when.value:.1f} s" in shift.to_record
    # Only that part is corrected, and only from then on; no other part ever.
    other = replace(made[part], part=PartInfo(part="p9", machine="m"))
    assert not correct(found.model, other).mismatch["x"].any()
    assert own_shift(found.model, other) == {}
    for recording in made:
        effect = correct(found.model, recording).mismatch["x"]
        after = (recording.time >= when.value) & (recording.part.part == f"p{part}")
        assert not effect[~after].any()
        assert effect[after].any() == (recording.part.part == f"p{part}")
    assert shift.fit.rmse_after < 0.5 * shift.fit.rmse_before


@pytest.mark.thorough
def test_samples_lost_are_found_beside_a_friction_that_is_missing():
    found = diagnose(list(recorded(1, 17.0, -6, missing=0.15)))
    kinds = {f.mechanism: f for f in found.findings}
    assert set(kinds) == {"time_misalignment", "coulomb_friction"} or "miscalibrated:coulomb_friction" in kinds
    shift = kinds["time_misalignment"]
    assert abs(shift.parameters["step_p1"].value + 6 * STEP) < STEP / 2
    assert abs(shift.parameters["from_p1"].value - 17.0) < 0.5
    assert [i.part for i in shift.where.intervals] == ["p1"]


@pytest.mark.parametrize(
    ("late", "drift"),
    [((0.0,) * 4, 0.0), ((0.03,) * 4, 0.0), ((0.0,) * 4, 6e-4), ((0.05, -0.03, 0.08, 0.02), 0.0)],
)
def test_no_step_is_told_where_parts_are_late_throughout(late, drift):
    mismatch, found = delay_of(list(recorded(late=late, drift=drift)))
    if not any(late) and not drift:
        assert found is None
        return
    assert found is not None
    assert found.steps == ()
    moved = shift_target(mismatch, found)
    assert np.std(moved.target[moved.usable]) < 1.5 * NOISE


def test_a_step_stands_beside_a_shift_of_all_parts():
    mismatch, found = delay_of(list(recorded(2, 20.0, -8, late=(0.04,) * 4)))
    assert found is not None
    (step,) = found.steps
    assert (step.part, found.own) == (2, False)
    assert step.size == pytest.approx(-8 * STEP, abs=STEP / 2)
    assert found.offset == pytest.approx(0.04, abs=2e-3)
    moved = shift_target(mismatch, found)
    assert np.std(moved.target[moved.usable]) < 1.5 * NOISE


@pytest.mark.thorough
def test_parts_in_time_are_not_accused_of_the_shift_of_another():
    made = list(recorded(late=(0.0, 0.0, 0.06, 0.0)))
    found = diagnose(made)
    (shift,) = found.findings
    assert shift.fit.scheme == "one shift in each of p2"
    assert [i.part for i in shift.where.intervals] == ["p2"]
    assert shift.parameters["shift_p2"].value == pytest.approx(0.06, abs=2e-3)
    for part in ("p0", "p1", "p3"):
        low, high = shift.parameters[f"shift_{part}"].ci95
        assert shift.parameters[f"shift_{part}"].value == 0.0
        assert low < 0.0 < high
    assert "p0, p1 and p3 are in time" in shift.where.summary
    other = replace(made[2], part=PartInfo(part="p9", machine="m"))
    assert own_shift(found.model, other) == {}
    for recording in (made[0], other):
        assert not correct(found.model, recording).mismatch["x"].any()


@pytest.mark.thorough
def test_a_clock_that_drifts_in_one_part_alone_is_not_told_as_lost_samples():
    made = list(recorded())
    t = made[1].time
    made[1] = made[1].with_columns(curr_x=np.interp(t - 4e-3 * t, t, made[1]["curr_x"]))
    found = diagnose(made)
    (shift,) = found.findings
    assert "a clock that drifts in this part alone explains as much" in shift.where.summary
    assert "lost" not in shift.where.summary + shift.said + shift.to_record


@pytest.mark.thorough
def test_a_model_of_a_version_without_steps_is_read():
    model = diagnose(list(recorded(2, 21.3, -5))).model
    assert set(axis_models(model)["x"].steps) == {"p2"}
    former = {**model, "axes": {"x": {k: v for k, v in model["axes"]["x"].items() if k != "steps"}}}
    assert axis_models(former)["x"].steps == {}


@pytest.mark.thorough
def test_positions_that_jump_where_samples_are_missing_are_no_other_fault():
    """All columns of a recording lose the same samples; the simulation beside it goes on."""
    at, rows = 21.3, 15
    made = list(recorded(2, at, -rows))
    whole, n = made[2].columns, len(made[2]) - rows
    seen = np.arange(n) + rows * (made[2].time[:n] >= at)
    lost = {name: whole[name][seen if name in ("pos_x", "v_x", "a_x") else slice(n)] for name in whole}
    made[2] = Recording(made[2].part, lost)
    assert [f.mechanism for f in input_findings(made, ["x"])] == ["input_fault"]
    found = diagnose(made)
    assert [f.mechanism for f in found.findings] == ["time_misalignment"]
    (note,) = (n for n in found.notes if "jump" in n)
    assert note.startswith("part p2: ")
    assert "pos_x" in note
