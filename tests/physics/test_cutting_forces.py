"""Kienzle forces against hand calculations, averages over the arc, and the energy of the chip."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pido.config import material
from pido.core.axes import LINEAR_AXES
from pido.physics.cutting import (
    end_cutting_forces,
    engaged_teeth,
    engagement_arc,
    feed_per_tooth,
    forces_on_tool,
    kienzle_forces,
    mean_chip_thickness,
    spindle_force,
    spindle_torque,
)
from pido.physics.frames import rotate_about_w, to_machine_frame, to_tool_frame
from pido.physics.friction import held_direction

MATERIALS = [material(name) for name in ("S235JR", "AL2007T4", "POM-C")]


@pytest.mark.parametrize("a_e", [0.1, 2.0, 5.0, 10.0])
def test_mean_chip_thickness_is_the_average_chip_over_the_engagement_arc(a_e):
    D, f_z = 10.0, 0.1
    phi_s = np.arccos(1 - 2 * a_e / D)
    arc = np.linspace(0.0, phi_s, 20_001)
    average = np.trapezoid(f_z * np.sin(arc), arc) / phi_s
    assert mean_chip_thickness(f_z, a_e, D, phi_s) == pytest.approx(average, rel=1e-7)


def test_mean_chip_thickness_is_the_papers_formula_in_degrees():
    f_z, a_e, D, phi_s = 0.045, 7.0, 10.0, 1.9
    printed = 114.6 / np.degrees(phi_s) * f_z * a_e / D
    assert mean_chip_thickness(f_z, a_e, D, phi_s) == pytest.approx(printed, rel=1e-4)


def test_a_cut_wider_than_the_tool_is_refused_with_its_sample():
    with pytest.raises(ValueError, match="sample 1"):
        mean_chip_thickness(np.array([0.1, 0.1]), np.array([9.0, 11.0]), 10.0, np.array([2.0, 3.0]))


def test_the_steel_slot_of_the_paper_by_hand():
    # a_p 6, a_e 10 = D, F 576 mm/min, S 3200 1/min, four teeth: f_z = 0.045, h_m = 2/pi * 0.045 = 0.028648 mm
    steel = material("S235JR")
    h_m = mean_chip_thickness(feed_per_tooth(9.6, 19_200.0, 4), 10.0, 10.0, np.pi)
    by_hand = [6 * 1990 * 0.028648**0.2981, 6 * 351 * 0.028648**0.5089, 6 * 247 * 0.028648**0.8]
    np.testing.assert_allclose(kienzle_forces(6.0, h_m, steel), by_hand, rtol=1e-4)


@pytest.mark.parametrize("steel", MATERIALS, ids=lambda m: m.name)
def test_nothing_cut_means_no_force(steel):
    assert not kienzle_forces(np.array([0.0, 5.0]), np.array([0.1, 0.0]), steel).any()


@pytest.mark.parametrize("stuff", MATERIALS, ids=lambda m: m.name)
@given(
    f_z=st.floats(0.01, 0.3), a_p=st.floats(0.1, 20.0), share=st.floats(0.01, 1.0), teeth=st.integers(1, 8),
)  # fmt: skip
def test_spindle_power_is_specific_cutting_force_times_removal_rate(stuff, f_z, a_p, share, teeth):
    D, n = 10.0, 50.0
    a_e = share * D
    phi_s = np.arccos(1 - 2 * share)
    h_m = mean_chip_thickness(f_z, a_e, D, phi_s)
    f_c = kienzle_forces(a_p, h_m, stuff)[0] * engaged_teeth(phi_s, teeth)
    power = spindle_torque(f_c, D) * 1e3 * 2 * np.pi * n
    mrr = a_p * a_e * f_z * teeth * n
    k_c = stuff.k_c11 * h_m**-stuff.z * stuff.K
    assert power == pytest.approx(k_c * mrr, rel=1e-9)


def test_a_plunge_obeys_the_same_energy_balance():
    steel, R, f_z, teeth, n = material("S235JR"), 5.0, 0.05, 4, 50.0
    f_c = end_cutting_forces(np.array([f_z]), np.array([1.0]), R, steel)[0, 0] * teeth
    power = spindle_torque(f_c, 2 * R) * 1e3 * 2 * np.pi * n
    mrr = np.pi * R**2 * f_z * teeth * n
    assert power == pytest.approx(steel.k_c11 * f_z**-steel.z * mrr, rel=1e-9)


def test_the_force_of_a_vanishing_axial_chip_vanishes_for_every_material():
    for stuff in MATERIALS:
        tiny = end_cutting_forces(np.array([1e-9]), np.array([1.0]), 5.0, stuff)
        assert (tiny < 1.0).all()


def test_in_a_slot_the_normal_force_pushes_against_the_feed_and_the_cutting_force_to_the_side():
    # clockwise tool fed along +u: the teeth in front move towards -v, so the chip pushes the tool towards +v
    force = forces_on_tool(np.array([[100.0, 40.0, 7.0]]), np.zeros(1), np.zeros(1), np.ones(1))[0]
    np.testing.assert_allclose(force, [-40.0, 100.0, 7.0], atol=1e-12)


@given(turn=st.floats(-10, 10), mid=st.floats(-1.5, 1.5))
def test_forces_turn_with_the_feed_and_the_spindle_force_does_not_care(turn, mid):
    tooth, one = np.array([[900.0, 250.0, 60.0]]), np.ones(1)
    straight = forces_on_tool(tooth, one * mid, one * 0.0, one)
    turned = forces_on_tool(tooth, one * mid, one * turn, one)
    np.testing.assert_allclose(turned, rotate_about_w(straight, one * turn), atol=1e-9)
    assert spindle_force(turned)[0] == pytest.approx(np.hypot(900.0, 250.0))


def test_the_mirrored_cut_with_the_mirrored_spindle_has_mirrored_forces():
    tooth, one = np.array([[900.0, 250.0, 60.0]]), np.ones(1)
    right = forces_on_tool(tooth, 0.4 * one, 0 * one, one)
    left = forces_on_tool(tooth, -0.4 * one, 0 * one, -one)
    np.testing.assert_allclose(left, right * [1, -1, 1], atol=1e-9)


def test_the_arc_of_a_slot_is_half_a_turn_and_of_half_immersion_a_quarter():
    low, high = engagement_arc(np.array([-5.0, 0.0]), np.array([5.0, 5.0]), np.array([5.0, 5.0]))
    np.testing.assert_allclose(np.degrees(high - low), [180.0, 90.0])


def test_feeding_a_standing_spindle_has_no_feed_per_tooth():
    assert np.isnan(feed_per_tooth(5.0, 0.0, 2))
    assert feed_per_tooth(0.0, 0.0, 2) == 0.0


@pytest.mark.parametrize("axis", LINEAR_AXES)
def test_the_tool_frame_is_right_handed_and_undone(axis):
    frame = to_tool_frame(np.eye(3), axis)
    assert np.linalg.det(frame) == pytest.approx(1.0)
    assert frame[LINEAR_AXES.index(axis)].tolist() == [0.0, 0.0, 1.0]
    np.testing.assert_array_equal(to_machine_frame(frame, axis), np.eye(3))


@given(st.lists(st.floats(-5, 5), min_size=1, max_size=40), st.floats(0, 1))
def test_the_held_direction_is_the_sign_of_the_last_speed_beyond_the_dead_band(v, band):
    state, expected = 0.0, []
    for speed in v:
        state = float(np.sign(speed)) if abs(speed) > band else state
        expected.append(state)
    assert held_direction(np.array(v), band).tolist() == expected


def test_after_a_missing_speed_the_direction_is_unknown_until_the_axis_moves_again():
    v = np.array([1.0, 0.0, np.nan, 0.0, -1.0, 0.0])
    assert held_direction(v, 0.1).tolist() == [1.0, 1.0, 0.0, 0.0, -1.0, -1.0]
