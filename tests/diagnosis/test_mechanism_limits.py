"""What a mechanism must not depend on, and what it needs before it may be named at all."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.answers import equation_text
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mechanisms.advice import recording_that_tells
from pido.diagnosis.search import first_look, search
from pido.diagnosis.state import axis_state, axis_states
from pido.diagnosis.terms import fit
from tests.diagnosis.to_and_fro import laid_out

BY_ID = {m.id: m for m in CATALOGUE}
FINE = 400  # Hz
ABOUT = {
    "machine": "m",
    "start_time_s": 0.0,
    "vertical_axis": "z",
    "workpiece": {"center_xy_mm": [50, 40], "size_xy_mm": [100, 80]},
}


def part(rate: float = 200.0, sign: float = 1.0, name: str = "p", **about) -> Recording:
    """To and fro on x and y with stops, cut in between; every signal a smooth function of time."""
    t = np.arange(0.0, 30.0, 1 / FINE)
    turns = 0.5 + np.floor(t / 3.0)
    u = np.clip(t % 3.0, 0.0, 2.0)
    bell = np.sin(np.pi * u / 2) ** 2
    v_x = sign * 10.0 * bell * np.where(turns % 2 < 1, 1, -1) * (0.3 + 0.1 * (turns % 5))
    v_y = 6.0 * np.sin(0.4 * t) * bell
    v_z = 2.0 * np.cos(0.3 * t) * bell
    cut = (t > 6) & (t < 25) & (np.abs(v_x) > 0)
    columns = {"time": t}
    for axis, v in (("x", v_x), ("y", v_y), ("z", v_z)):
        columns |= {f"pos_{axis}": 50 + np.cumsum(v) / FINE, f"v_{axis}": v, f"a_{axis}": np.gradient(v, t)}
    columns |= {
        "v_sp": 6000.0 + 3000 * np.sin(0.2 * t),
        "a_sp": 600 * np.cos(0.2 * t),
        "f_x_sim": sign * 40.0 * cut * np.sign(v_x * sign),
        "f_y_sim": 20.0 * cut * bell,
        "f_z_sim": 30.0 * cut * bell,
        "m_sp_sim": 1.0 * cut * bell,
        "mrr_sim": 80.0 * cut * bell,
        "curr_x_sim": sign * np.sin(t),
        "coolant": 1.0 * (t > 12),
    }
    every = round(FINE / rate)
    kept = {k: v[::every] for k, v in columns.items()}
    return Recording(PartInfo.model_validate({**ABOUT, "part": name, **about}), kept)


def shapes(mechanism, states):
    """The first, the middle and the last shape that a search begins with."""
    every = mechanism.starts(states)
    return [every[i] for i in sorted({0, len(every) // 2, len(every) - 1})]


def axis_of(mechanism) -> str:
    return "z" if mechanism.id == "gravity_load" else "x" if "x" in mechanism.axes else "sp"


def without(recording: Recording, *names: str) -> Recording:
    return replace(recording, columns={k: v for k, v in recording.columns.items() if k not in names})


def standing(recording: Recording, *axes: str) -> Recording:
    still = {f"{k}_{a}": 0 * recording.time for a in axes for k in ("v", "a")}
    return recording.with_columns(**still, **{f"pos_{a}": 0 * recording.time + 50 for a in axes if a != "sp"})


def bare(recording: Recording, *keys: str) -> Recording:
    about = recording.part.model_dump(exclude_none=True, exclude=set(keys), exclude_defaults=True)
    return replace(recording, part=PartInfo.model_validate(about))


FORCES = ("f_x_sim", "f_y_sim", "f_z_sim", "m_sp_sim", "mrr_sim")
ONE_WAY = part().with_columns(v_x=np.abs(part()["v_x"]), pos_x=50 + np.cumsum(np.abs(part()["v_x"])) / 200)
# What the data lack, and the mechanisms that they can then not show on an axis.
LACKING = [
    ("no motion of x", "x", standing(part(), "x"), [
        "coulomb_friction", "viscous_friction", "stribeck_friction", "standstill_friction", "friction_asymmetry",
        "position_dependent_friction", "presliding_hysteresis", "backlash", "inertia", "torque_ripple",
    ]),
    ("no reversal", "x", ONE_WAY, ["presliding_hysteresis", "backlash", "friction_asymmetry"]),
    ("no process", "x", without(part(), *FORCES), [
        "load_dependent_friction", "cutting_force", "edge_force", "tool_wear", "material_hard_zone",
    ]),
    ("no process", "sp", without(part(), *FORCES), [
        "edge_force", "tool_wear", "material_hard_zone", "spindle_torque_load",
    ]),
    ("air", "x", part().with_columns(**{c: 0 * part().time for c in FORCES}), [
        "load_dependent_friction", "cutting_force", "edge_force", "tool_wear", "material_hard_zone",
    ]),
    ("no positions", "x", without(part(), "pos_x", "pos_y"), [
        "position_dependent_friction", "torque_ripple", "material_hard_zone",
    ]),
    ("x alone moves", "x", standing(part(), "y", "z"), ["axis_coupling"]),
    ("not vertical", "x", part(), ["gravity_load"]),
    ("vertical unknown", "z", bare(part(), "vertical_axis"), ["gravity_load"]),
    ("coolant always on", "y", part().with_columns(coolant=1.0 + 0 * part().time), ["coolant_load"]),
    ("coolant unknown", "y", without(part(), "coolant"), ["coolant_load"]),
    ("spindle at one speed", "sp", part().with_columns(v_sp=6000.0 + 0 * part().time, a_sp=0 * part().time), [
        "spindle_viscous_drag", "spindle_windage", "spindle_inertia",
    ]),
    ("no simulated current", "x", without(part(), "curr_x_sim"), [
        "sensor_gain", "sensor_clipping", "time_misalignment", "current_saturation",
    ]),
    ("wrong axis", "x", part(), [
        "spindle_viscous_drag", "spindle_windage", "spindle_inertia", "spindle_torque_load",
    ]),
]  # fmt: skip


@pytest.mark.parametrize(
    ("what", "axis", "recording", "names"), LACKING, ids=[f"{row[0]} ({row[1]})" for row in LACKING]
)
def test_what_the_data_cannot_show_is_refused_with_a_reason(what, axis, recording, names):
    states = axis_states([recording], axis)
    for name in names:
        reason = BY_ID[name].applies(states)
        assert reason, (what, name)
        assert len(reason) > 8


def test_a_short_part_cannot_show_heat():
    short = part()
    cut = Recording(short.part, {k: v[:1000] for k, v in short.columns.items()})
    assert "20 s" in (BY_ID["thermal_drift"].applies(axis_states([cut], "x")) or "")


ODD = {
    "coulomb_friction", "viscous_friction", "stribeck_friction", "standstill_friction", "load_dependent_friction",
    "presliding_hysteresis", "backlash", "inertia",
}  # fmt: skip


@pytest.mark.parametrize(("lead", "waves"), [(None, 1.5), (16.0, 1.0)])
def test_what_does_not_repeat_itself_along_the_travel_is_no_ripple(lead, waves):
    ripple, (state,) = BY_ID["torque_ripple"], axis_states([part()], "x")
    state = replace(state, lead=lead)
    longest = np.ptp(state.pos) / waves
    half_a_wave = [np.sin(np.pi * (state.pos - state.pos.min()) / np.ptp(state.pos))]
    shapes = [*ripple.starts([state]), *ripple.suggest([state], half_a_wave)]
    assert max(s["L"] for s in shapes) <= longest
    low, high = ripple.around("L", {"L": 0.9 * longest}, [state])
    assert low < 0.9 * longest < high <= longest * (1 + 1e-9)


@pytest.mark.parametrize("name", sorted(ODD))
def test_a_machine_that_runs_the_other_way_round_feels_the_opposite(name):
    mechanism = BY_ID[name]
    one, other = axis_state(part(), "x"), axis_state(part(sign=-1.0), "x")
    for shape in shapes(mechanism, [one]):
        np.testing.assert_allclose(
            mechanism.regressors(other, **shape), -mechanism.regressors(one, **shape), atol=1e-9, err_msg=name
        )


MEMORY = {"tool_wear", "thermal_drift"}  # these carry something from part to part, and must


@pytest.mark.parametrize("mechanism", [m for m in CATALOGUE if m.id not in MEMORY], ids=lambda m: m.id)
def test_the_order_of_parts_changes_nothing_without_memory(mechanism):
    axis = axis_of(mechanism)
    made = [part(name="a"), part(name="b", sign=-1.0, start_time_s=100.0)]
    forth, back = axis_states(made, axis), axis_states(made[::-1], axis)
    for shape in shapes(mechanism, forth):
        for one, other in zip(forth, back[::-1], strict=True):
            np.testing.assert_array_equal(mechanism.regressors(one, **shape), mechanism.regressors(other, **shape))


@pytest.mark.parametrize("mechanism", CATALOGUE, ids=lambda m: m.id)
def test_a_slower_recording_of_the_same_part_shows_the_same(mechanism):
    """At the instants that both recordings have; edges of a motion may fall a sample to either side."""
    axis = axis_of(mechanism)
    fast = [axis_state(part(400.0), axis)]
    slow = [axis_state(part(100.0), axis)]
    for shape in shapes(mechanism, fast):
        one, other = mechanism.regressors(fast[0], **shape)[::4], mechanism.regressors(slow[0], **shape)
        size = np.abs(one).max(initial=0.0)
        assert np.mean(np.abs(one - other) > 0.05 * size + 1e-12) < 0.03, shape


@pytest.mark.parametrize("mechanism", CATALOGUE, ids=lambda m: m.id)
def test_a_search_begins_somewhere_and_stays_inside_the_range_of_each_shape(mechanism):
    axis = axis_of(mechanism)
    states = [axis_state(part(), axis)]
    starts = mechanism.starts(states)
    assert starts
    assert len({tuple(s.items()) for s in starts}) == len(starts)
    names = [p.name for p in mechanism.shape]
    for shape in starts:
        assert list(shape) == names or set(shape) == set(names)
        assert 0 <= mechanism.free(shape) <= len(names)
        for p in mechanism.shape:
            low, high = mechanism.around(p.name, shape, states)
            assert low <= shape[p.name] <= high
            assert p.scale == "linear" or low > 0
        summary, conditions = mechanism.conditions(axis, shape)
        assert summary
        assert "{" not in "".join((summary, *conditions))


def test_every_recording_that_would_tell_two_mechanisms_apart_is_known_from_both_sides():
    for mechanism in CATALOGUE:
        assert mechanism.tell_apart, mechanism.id
        for other, text in mechanism.tell_apart.items():
            if other in BY_ID:
                assert BY_ID[other].tell_apart[mechanism.id] == text


def test_for_any_two_mechanisms_there_is_a_recording_that_would_tell_them_apart():
    for a, b in itertools.permutations([*BY_ID, "unknown"], 2):
        assert len(recording_that_tells(a, b)) > 10, (a, b)


def test_a_fault_of_another_axis_does_not_enter_through_a_coupling():
    made = part()
    wrong = made["v_y"].copy()
    at = np.flatnonzero(np.abs(wrong) > 2)[200]
    wrong[at] += 80.0
    state = axis_state(made.with_columns(v_y=wrong), "x")
    coupling = BY_ID["axis_coupling"].regressors(state, source=4.0)
    assert np.abs(coupling).max() < 10.0
    assert coupling[at] == 0.0


def test_a_position_that_jumped_is_not_used_where_it_cannot_be_told():
    made = part()
    pos = made["pos_x"].copy()
    pos[2000:] += 700.0
    state = axis_state(made.with_columns(pos_x=pos), "x")
    assert state.pos is not None
    assert np.isfinite(state.pos[:1999]).all()
    assert np.isnan(state.pos[2001:]).all()
    assert state.usable.mean() > 0.99
    np.testing.assert_allclose(state.since_reversal[-1], axis_state(made, "x").since_reversal[-1], rtol=0.02)


@pytest.mark.thorough
def test_a_ripple_with_a_third_harmonic_is_one_ripple():
    mismatch, noise = laid_out(lambda s: 0.08 * np.sin(s.pos / 2) + 0.07 * np.cos(3 * s.pos / 2))
    look = first_look(mismatch, np.random.default_rng(0))
    (found,) = search(look, 1, False, np.random.default_rng(0)).terms
    assert found.name == "torque_ripple"
    assert dict(found.shape)["L"] == pytest.approx(4 * np.pi, rel=0.02)
    assert "R_s3 * sin(6 pi p / L)" in equation_text(found, "x")
    (sizes,) = fit(mismatch, noise, [found]).amplitudes
    assert np.hypot(*sizes[:2]) == pytest.approx(0.08, abs=0.01)
    assert np.hypot(*sizes[4:]) == pytest.approx(0.07, abs=0.01)
