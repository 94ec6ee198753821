"""The virtual mill as a whole: noise, strength, faults, repeatability, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from pido.core.axes import AXES
from pido.core.columns import CURRENT, CURRENT_SIM
from pido.core.errors import PidoError, ProgramError, SettingsError
from pido.core.machining import Stock
from pido.synthetic.effects import Effect
from pido.synthetic.equip import equip, noise_rms
from pido.synthetic.families import impellers, random_contours, variants
from pido.synthetic.machine import produce
from pido.synthetic.mills import newer_vertical, worn_horizontal
from pido.synthetic.parts import plan_course


@pytest.fixture(scope="module")
def mill():
    return worn_horizontal()


@pytest.fixture(scope="module")
def courses(mill):
    return mill.plan(random_contours(mill.machine, 2, np.random.default_rng(5), seconds=25.0))


def residual(produced, axis):
    return produced.recording[CURRENT[axis]] - produced.recording[CURRENT_SIM[axis]]


def test_without_effects_recording_minus_simulation_is_the_noise_of_the_sensor(mill, courses):
    for p in produce(mill, courses, seed=3):
        for axis in AXES:
            np.testing.assert_allclose(residual(p, axis), p.truth.noise[axis], atol=1e-9)
            assert np.abs(p.truth.effect[axis]).max() < 1e-9


def test_noise_has_the_size_that_its_parts_add_up_to(mill, courses):
    sensor = replace(mill.sensors.current["x"], slow_a=0.0, cutting_a=0.0, white_a=0.082, resolution_a=0.0)
    quiet = replace(mill, sensors=replace(mill.sensors, current=mill.sensors.current | {"x": sensor}))
    noise = np.concatenate([p.truth.noise["x"] for p in produce(quiet, courses, seed=1)])
    assert noise.std() == pytest.approx(0.082 / np.sqrt(41), rel=0.1)  # a mean over 41 independent samples


def test_same_seed_same_bytes_and_another_seed_another_noise(mill, courses):
    one, two, other = (produce(mill, courses[:1], seed=s)[0].recording for s in (7, 7, 8))
    assert all(one[name].tobytes() == two[name].tobytes() for name in one.columns if one[name].dtype != object)
    assert not np.array_equal(one["curr_x"], other["curr_x"])


@pytest.mark.parametrize(
    ("id", "axis", "strength"),
    [
        ("stribeck_friction", "x", 1.0),
        ("viscous_friction", "y", 4.0),
        ("presliding_hysteresis", "x", 0.5),
        ("backlash", "x", 1.0),
        ("cutting_force", "x", 2.0),
        ("edge_force", "sp", 0.5),
        ("spindle_windage", "sp", 2.0),
        ("current_saturation", "x", 1.0),
        ("sensor_gain", "y", 1.0),
        ("sensor_clipping", "x", 1.0),
        ("miscalibrated:inertia", "x", 2.0),
        ("unknown", "y", 2.0),
    ],
)
def test_an_effect_stands_out_of_the_noise_as_strongly_as_asked(mill, courses, id, axis, strength):
    effects = equip(mill, courses, [Effect(id, axis, strength)], np.random.default_rng(0))
    made = produce(mill, courses, effects, seed=4)
    current = np.concatenate([p.truth.effect[axis] for p in made])
    acts = np.abs(current) > 0.1 * np.quantile(np.abs(current), 0.995)
    noise = np.concatenate([p.truth.noise[axis] for p in made])
    assert np.sqrt(np.mean(current[acts] ** 2)) / noise.std() == pytest.approx(strength, rel=0.2)
    for p in made:  # recording = simulation + effect + noise, to the last bit that matters
        np.testing.assert_allclose(residual(p, axis), p.truth.effect[axis] + p.truth.noise[axis], atol=1e-9)


def test_a_constant_load_is_answered_by_its_current(mill, courses):
    (e,) = equip(mill, courses, [Effect("coolant_load", "x", 2.0)], np.random.default_rng(0))
    p = produce(mill, courses, [e], seed=0)[0]
    wet = p.course.coolant
    steady = np.convolve(wet, np.ones(501), "same") == 501  # half a second from any switching
    steady = np.interp(p.recording.time + 0.04, p.course.time, steady) == 1
    still_or_slow = np.abs(p.recording["a_x"]) < 1
    rows = steady & still_or_slow & (np.abs(p.recording["v_x"]) > 1)
    assert rows.any()
    assert np.median(p.truth.effect["x"][rows]) == pytest.approx(e.amplitude, rel=0.02)


def test_several_effects_add_up_where_both_are_loads(mill, courses):
    wanted = [Effect("coolant_load", "x", 2.0), Effect("edge_force", "x", 2.0)]
    p = produce(mill, courses, equip(mill, courses, wanted, np.random.default_rng(0)), seed=0)[0]
    moving = np.abs(p.recording["v_x"]) > 1  # at rest, what a bristle holds depends on the way there
    difference = (p.truth.effect["x"] - p.truth.single[0] - p.truth.single[1])[moving]
    assert np.sqrt(np.mean(difference**2)) < 0.05 * np.sqrt(np.mean(p.truth.effect["x"][moving] ** 2))


def test_other_axes_stay_clean(mill, courses):
    effects = equip(mill, courses, [Effect("stribeck_friction", "x", 4.0)], np.random.default_rng(0))
    p = produce(mill, courses, effects, seed=0)[0]
    assert all(np.abs(p.truth.effect[a]).max() < 1e-9 for a in ("y", "z", "sp"))


def test_a_machine_warms_up_while_it_runs_and_cools_in_a_pause(courses):
    first, second = courses
    tau = 100.0
    end_of_first = 1 - np.exp(-first.time[-1] / tau)
    pause = second.job.start_time_s - first.time[-1]
    assert first.warmth(tau)[0] == 0.0
    assert first.warmth(tau)[-1] == pytest.approx(end_of_first)
    assert second.warmth(tau)[0] == pytest.approx(end_of_first * np.exp(-pause / tau))


def test_what_a_tool_has_cut_is_carried_to_the_next_part(mill, courses):
    first, second = courses
    removed = np.sum(first.mrr * (first.tool == 0)) * 0.002
    info = produce(mill, courses, seed=0)[1].recording.part
    assert info.tools["1"].used_before.cut_volume_mm3 == pytest.approx(removed)
    assert second.cut_mm3[second.tool == 0][0] >= removed * 0.999


def test_an_impeller_family_differs_from_part_to_part():
    machine = newer_vertical().machine
    programs = [job.program for job in impellers(machine, 12)]
    assert len(set(programs)) == 12


@pytest.mark.parametrize("mill", [worn_horizontal(), newer_vertical()], ids=lambda m: m.machine.id)
def test_no_rapid_cuts_more_than_the_rounded_corner_where_it_lifts_off(mill):
    jobs = [
        *impellers(mill.machine, 1, seed=3),
        *(variants(mill.machine, shape, "AL2007T4", vary="a_p")[2] for shape in ("gear", "plate", "notch")),
        *(
            random_contours(mill.machine, 1, np.random.default_rng(seed), material=material, seconds=40.0)[0]
            for seed, material in enumerate(("AL2007T4", "S235JR", "POM-C"))
        ),
    ]
    for job in jobs:
        course = plan_course(job, mill.machine)
        blocks = np.array([block.startswith("G0 ") for block in job.program.split("\n")])
        rapid = blocks[np.clip(course.nc_line - 1, 0, None)]
        force = np.linalg.norm([course.force[a] for a in "xyz"], axis=0)
        assert force[rapid].max() <= force[~rapid].max(), job.name
        assert course.mrr[rapid].sum() < 0.003 * course.mrr.sum(), job.name
        speed = np.linalg.norm([course.v[a] for a in "xyz"], axis=0)
        assert speed[rapid & course.cutting].max(initial=0.0) < 0.1 * speed[rapid].max(), job.name


def _job(mill, **changes):
    return replace(random_contours(mill.machine, 1, np.random.default_rng(0), seconds=10.0)[0], **changes)


def _moved(point, x, y, z):
    return point[0] + x, point[1] + y, point[2] + z


@pytest.mark.parametrize(
    ("change", "error"),
    [
        (lambda j: {"program": j.program.replace("M30", "G1 X90000 F1000\nM30")}, ProgramError),
        (lambda j: {"tools": {"OTHER": j.tools["MILL_10"]}}, PidoError),
        (
            lambda j: {"stock": Stock(tuple(np.add(j.zero_mm, (0, 0, -1))), tuple(np.add(j.zero_mm, (3, 3, 0))))},
            PidoError,
        ),
        (lambda j: {"material": None}, SettingsError),
        (lambda j: {"program": "G54\nG0 X1 Y1 Z1\nM30"}, PidoError),
    ],
    ids=["outside the travel", "tool not in the list", "raw part too small", "no material", "no tool"],
)
def test_a_part_that_cannot_be_made_is_refused_before_anything_runs(mill, change, error):
    job = _job(mill)
    with pytest.raises(error):
        mill.plan([replace(job, **change(job))])


def test_an_impossible_machine_is_refused(mill):
    x = replace(mill.machine.axes["x"], a_max=0.0)
    broken = replace(mill, machine=replace(mill.machine, axes=mill.machine.axes | {"x": x}))
    with pytest.raises(PidoError):
        broken.plan([_job(mill)])
    with pytest.raises(SettingsError, match="table_kg"):
        replace(mill, drives=dict(mill.drives) | {"x": replace(mill.drives["x"], table_kg=-1.0)})


def test_an_effect_that_cannot_act_is_refused_with_its_reason(mill, courses):
    rng = np.random.default_rng(0)
    with pytest.raises(SettingsError, match="cannot act on axis"):
        equip(mill, courses, [Effect("spindle_windage", "x")], rng)
    with pytest.raises(SettingsError, match="not known"):
        equip(mill, courses, [Effect("no_such_effect", "x")], rng)
    with pytest.raises(SettingsError, match="reaches a strength"):  # y's weight keeps the screw pressed to one side
        equip(mill, courses, [Effect("backlash", "y", 4.0)], rng)
    air = mill.plan([replace(_job(mill), stock=None, material=None)])
    with pytest.raises(SettingsError, match="never acts"):
        equip(mill, air, [Effect("cutting_force", "x")], rng)


def test_noise_is_measured_as_recorded(mill, courses):
    assert noise_rms(mill, courses, "x", 500.0) > 2 * noise_rms(mill, courses, "x", 50.0)
