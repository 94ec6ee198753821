"""A shift in time is one finding, and none where it only imitates another."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.clocks import Form
from pido.diagnosis.correct import correct, own_shift
from pido.diagnosis.diagnose import diagnose
from pido.diagnosis.in_time import _shows, no_worse
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.search import Look, best_gain
from pido.diagnosis.select import grid_terms
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from pido.diagnosis.timing import Delay, find_delay, sharpened, shift_target
from pido.diagnosis.whiten import Noise
from pido.reports.diagnosis import verdict
from tests.diagnosis.feeds import BY_ID, NOISE, laid_out, recordings


def test_a_shift_in_time_behind_which_the_names_leave_more_error_is_not_taken():
    mismatch, _ = laid_out(lambda s: 0.3 * np.sign(s.v) * s.moving)
    look, friction = SimpleNamespace(mismatch=mismatch), Term(BY_ID["coulomb_friction"], (("rest", 0.0),))
    named, nothing = (({"x": look}, {"x": SimpleNamespace(terms=t)}) for t in ([friction], []))
    assert no_worse(named, nothing)
    assert no_worse(named, named)
    assert not no_worse(nothing, named)


def test_what_one_axis_gains_by_a_shift_and_another_loses_is_no_shift():
    late, noise = laid_out(lambda s: -0.01 * np.gradient(s.sim, s.time))
    rng = np.random.default_rng(6)
    in_time = laid_out(lambda s: rng.normal(0, 0.7, len(s.time)), "sp")[0]
    noises = {"x": noise, "sp": Noise(np.zeros(0), np.full(in_time.n, 0.7), 1.0, in_time.usable)}
    assert find_delay({"x": late}, noises) is not None
    assert find_delay({"x": late, "sp": in_time}, noises) is None


@pytest.mark.parametrize(("offset", "drift"), [(-0.011, 0.0), (0.0, -2e-4)])
def test_a_shift_of_less_than_a_sample_is_found_and_its_interval_holds_it(offset, drift):
    rng = np.random.default_rng(3)
    t = np.arange(2000) * 0.02
    # Spectral lines: what the signal is between its samples is known exactly.
    lines = np.array([rng.normal(0, 1, 40), rng.uniform(0.02, 4, 40), rng.uniform(0, 6, 40)]).T

    def signal(u):
        return sum(0.1 * a / (1 + f) * np.sin(2 * np.pi * f * u + p) for a, f, p in lines)

    made = [
        r.with_columns(curr_x_sim=signal(t), curr_x=signal(t - offset - drift * t) + rng.normal(0, NOISE, len(t)))
        for r in recordings()
    ]
    states = axis_states(made, "x")
    mismatch = lay_out(states, [s.curr - s.sim for s in states])
    noise = Noise(np.zeros(0), np.full(mismatch.n, NOISE), 1.0, mismatch.usable)
    found = find_delay({"x": mismatch}, {"x": noise})
    assert found is not None
    for value, truth, sd in zip((found.offset, found.drift), (offset, drift), found.sd, strict=True):
        assert abs(value - truth) <= 3 * max(sd, 1e-5)


def _late_by(*offsets):
    """x with friction and inertia, its recorded current late by another time in each part."""
    rng = np.random.default_rng(2)
    for late, recording in zip(offsets, recordings(len(offsets)), strict=True):
        t, sim = recording.time, recording["curr_x_sim"]
        seen = np.interp(t - late, t, sim) + rng.normal(0, NOISE, len(t))
        kept = {k: v for k, v in recording.columns.items() if not k.endswith("_sp") and "_sp_" not in k}
        yield Recording(recording.part, kept | {"curr_x": seen})


@pytest.mark.parametrize(("late", "shows"), [(0.0006, False), (0.003, True)])
def test_a_shift_that_changes_hardly_more_than_a_simulation_lacks_is_none(late, shows):
    """Three tenths of the noise, where it acts, is what counts."""
    states = axis_states(list(_late_by(*[late] * 4)), "x")
    mismatch = lay_out(states, [s.curr - s.sim for s in states])
    delay = Delay((late,) * 4, 0.0, (1e-5, 0.0), 1e3, {"x": 1e3}, (1e-5,) * 4, Form(common=True))
    assert _shows(mismatch, delay) == shows


@pytest.mark.thorough
def test_parts_that_are_late_by_another_time_each_have_a_shift_of_their_own():
    offsets = (0.05, -0.03, 0.0, 0.02)
    made = list(_late_by(*offsets))
    found = diagnose(made)
    (shift,) = found.findings
    assert (shift.mechanism, shift.fit.scheme) == ("time_misalignment", "one shift in each part")
    assert "from 30" in shift.where.summary
    assert "in part p1 to 50" in shift.where.summary
    for k, late in enumerate(offsets):
        own = shift.parameters[f"shift_p{k}"]
        assert own.value == pytest.approx(late, abs=1.5e-3)
    assert shift.fit.rmse_after < 0.3 * shift.fit.rmse_before
    # What was diagnosed is corrected by its own shift.
    for recording in made:
        again = correct(found.model, recording)
        left = recording["curr_x"] - again.corrected["x"]
        assert np.sqrt(np.mean(left**2)) < 0.3 * shift.fit.rmse_before
        assert own_shift(found.model, recording) == {}
    another = replace(made[0], part=PartInfo(part="p9", machine="m"))
    assert own_shift(found.model, another) == {"x": pytest.approx(0.01, abs=2e-3)}


@pytest.mark.thorough
def test_a_shift_of_many_seconds_is_a_shift_and_no_physics():
    found = diagnose(list(_late_by(2.7, 2.7, 2.7)))
    (shift,) = found.findings
    assert (shift.mechanism, shift.fit.scheme) == ("time_misalignment", "one shift for all parts")
    assert shift.parameters["shift"].value == pytest.approx(2.7, abs=2e-3)


def test_the_last_digits_of_a_shift_are_those_of_every_row():
    """Rows that a search averages have no peaks, and what they lack looks like a part of the shift."""
    made = list(_late_by(-0.0273, -0.0273, -0.0273))
    states = axis_states(made, "x")
    thin, whole = (lay_out(states, [s.curr - s.sim for s in states], stride=k) for k in (4, 1))
    rough = find_delay({"x": thin}, {"x": Noise(np.zeros(0), np.full(thin.n, NOISE / 2), 1.0, thin.usable)})
    assert rough is not None
    exact = sharpened(rough, {"x": whole})
    assert abs(exact.offset + 0.0273) < abs(rough.offset + 0.0273)
    assert abs(exact.offset + 0.0273) < 3 * exact.sd[0]
    # Averages are as exact, where what is averaged was moved before.
    again = sharpened(rough, {"x": thin})
    assert abs(again.offset + 0.0273) < 0.5 * abs(rough.offset + 0.0273)
    left = [np.std(shift_target(m, again).target[m.usable]) for m in (thin, replace(thin, fine=()))]
    assert left[0] < 0.7 * left[1]


def test_a_strong_shift_is_not_taken_for_the_mechanism_that_imitates_it_best():
    def late(recording, rng):
        sim = recording["curr_x_sim"]
        t = recording.time
        return recording.with_columns(curr_x=np.interp(t - 0.02, t, sim) + rng.normal(0, NOISE, len(t)))

    rng = np.random.default_rng(2)
    states = axis_states([late(r, rng) for r in recordings()], "x")
    mismatch = lay_out(states, [s.curr - s.sim for s in states])
    noise = Noise(np.zeros(0), np.full(mismatch.n, NOISE), 1.0, mismatch.usable)
    offered = [t for i in ("inertia", "presliding_hysteresis") for t in grid_terms(BY_ID[i], mismatch.states)]
    rival = best_gain(mismatch, noise, Look(mismatch, noise, {}, offered, []))
    found = find_delay({"x": mismatch}, {"x": noise}, lambda: {"x": rival})
    assert found is not None
    assert abs(found.offset - 0.02) < 1e-3


@pytest.mark.parametrize(
    ("late", "missing"),
    [
        pytest.param(0.13, 0.0, marks=pytest.mark.thorough),
        pytest.param(0.25, 0.0, marks=pytest.mark.thorough),
        (0.25, 0.01),
    ],
)
def test_a_shift_in_time_is_one_finding_whatever_lies_between_the_samples(late, missing):
    def shifted(recording, rng):
        t, sim = recording.time, recording["curr_x_sim"]
        fine = np.arange(0.0, t[-1], 0.001)
        # What the simulation is between its samples nobody knows: here it goes in steps.
        steps = sim[np.clip(np.searchsorted(t, fine, side="right") - 1, 0, len(t) - 1)]
        late_one = np.interp(t - late, fine, steps)
        keep = {k: recording[k] for k in ("time", "v_x", "pos_x", "a_x", "curr_x_sim")}
        seen = late_one + rng.normal(0, NOISE, len(t))
        seen[rng.random(len(t)) < missing] = np.nan
        return Recording(recording.part, keep | {"curr_x": seen})

    rng = np.random.default_rng(2)
    found = diagnose([shifted(r, rng) for r in recordings()])
    assert [(f.axis, f.mechanism) for f in found.findings] == [("x", "time_misalignment")]


@pytest.mark.thorough
def test_no_axis_that_is_late_as_well_is_called_clean():
    """x and y come 80 ms late; z stands still, and its current is as simulated."""

    def late(recording, rng):
        t = recording.time
        columns = {"time": t}
        for axis, feed in (("x", 1.0), ("y", 0.7)):
            v = np.roll(recording["v_x"], 700 if axis == "y" else 0)
            sim = 0.5 * np.sign(v) + 0.03 * feed * v
            seen = np.interp(t - 0.08, t, sim) + rng.normal(0, NOISE, len(t))
            columns |= {f"v_{axis}": v, f"a_{axis}": np.gradient(v, t), f"curr_{axis}_sim": sim, f"curr_{axis}": seen}
        held = 1.5 + 0.01 * np.sin(0.3 * t)
        columns |= {"v_z": np.zeros(len(t)), "curr_z_sim": held, "curr_z": held + rng.normal(0, NOISE, len(t))}
        return Recording(recording.part, columns)

    rng = np.random.default_rng(4)
    found = diagnose([late(r, rng) for r in recordings()])
    assert [f.mechanism for f in found.findings] == ["time_misalignment"]
    assert found.clean_axes == ("z",)
    (where,) = (f.where.summary for f in found.findings)
    assert where.endswith(", on x as well") or where.endswith(", on y as well")
    assert "Nothing significant on: z." in verdict(found)


@pytest.mark.thorough
def test_one_axis_that_is_late_by_itself_is_late_and_not_of_another_dynamic():
    """x comes 20 ms late; y, which moves as much, is in time."""

    def late(recording, rng):
        t = recording.time
        columns = {"time": t}
        for axis in ("x", "y"):
            v = np.roll(recording["v_x"], 700 if axis == "y" else 0)
            a = np.gradient(v, t)
            sim = 0.5 * np.tanh(v / 2) + 0.03 * v + 2e-3 * a
            seen = np.interp(t - (0.02 if axis == "x" else 0.0), t, sim) + rng.normal(0, NOISE, len(t))
            columns |= {f"v_{axis}": v, f"a_{axis}": a, f"curr_{axis}_sim": sim, f"curr_{axis}": seen}
        return Recording(recording.part, columns)

    rng = np.random.default_rng(4)
    found = diagnose([late(r, rng) for r in recordings()])
    (shift,) = found.findings
    assert (shift.axis, shift.mechanism, shift.fit.scheme) == ("x", "time_misalignment", "one shift for all parts")
    assert abs(shift.parameters["shift"].value - 0.02) < 1e-3
    assert found.clean_axes == ("y",)
    assert found.model["axes"]["y"]["delay"] == [0.0, 0.0]
