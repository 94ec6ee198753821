"""NC programs with closed-form paths."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pido.core.errors import ProgramError
from pido.core.machining import Tool
from pido.nc import ARC, DWELL, FEED, RAPID, interpret

TOOLS = {"MILL10": Tool("MILL10", 10.0, 4), "MILL6": Tool("MILL6", 6.0, 3), "7": Tool("7", 8.0, 2, kind="drill")}
ORIGIN = (0.0, 0.0, 0.0)


def run(*lines, **options):
    return interpret("\n".join(lines) + "\n", start=options.pop("start", ORIGIN), **options)


def end(path):
    return path.end[-1].tolist()


def test_linear_moves_have_the_programmed_ends_feeds_and_lines():
    path = run("N10 G0 X10 Y20 Z5 ; approach", "N20 G1 Z-1 F300", "X40 Y60 F600", "M30")
    assert path.kind.tolist() == [RAPID, FEED, FEED]
    np.testing.assert_allclose(path.end, [[10, 20, 5], [10, 20, -1], [40, 60, -1]])
    np.testing.assert_allclose(path.feed[1:], [5.0, 10.0])
    assert np.isnan(path.feed[0])
    assert path.nc_line.tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("block", "length"),
    [
        ("G2 X0 Y0 I10 J0", 20 * math.pi),
        ("G3 X20 Y0 I10 J0", 10 * math.pi),
        ("G2 X10 Y10 CR=10", 5 * math.pi),
        ("G2 X10 Y10 CR=-10", 15 * math.pi),
        ("G2 X10 Y10 R10", 5 * math.pi),
        ("G3 X20 Y0 AR=180", 10 * math.pi),
        ("G2 I10 J0 AR=90", 5 * math.pi),
        ("G3 X0 Y0 I=AC(10) J=AC(0)", 20 * math.pi),
        ("G3 X20 Y0 Z0 I10 J0 TURN=2", 50 * math.pi),
        ("CIP X20 Y0 Z0 I1=10 J1=10 K1=0", 10 * math.pi),
        ("CIP X20 Y0 Z0 I1=10 J1=0 K1=10", 10 * math.pi),
        ("G2 X0 Y0 Z-10 I10 J0", math.hypot(20 * math.pi, 10)),
    ],
)
def test_a_circle_has_its_length_whatever_its_notation(block, length):
    path = run("G1 F600", block)
    assert set(path.kind) == {ARC}
    assert path.length.sum() == pytest.approx(length, rel=1e-6)


def test_every_point_of_a_flattened_circle_lies_on_it():
    path = run("G0 X12 Y5 Z3", "G3 X12 Y5 I-12 J-5 F1000")
    arc = path.take(path.kind == ARC)
    for u in (0.0, 0.3, 0.5, 0.8, 1.0):
        points = arc.start + u * (arc.end - arc.start) + 4 * u * (1 - u) * arc.sag
        np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), 13.0, atol=1e-5)
    assert np.linalg.norm(arc.sag, axis=1).max() <= 0.002 + 1e-12
    assert np.unique(arc.nc_line).tolist() == [2]


@pytest.mark.parametrize(("plane", "block", "apex"), [("G17", "X20 I10", (10, 10, 0)), ("G18", "X20 I10", (10, 0, -10)),
                                                      ("G19", "Y20 J10", (0, 10, 10))])  # fmt: skip
def test_g2_is_clockwise_seen_against_the_third_axis_of_the_plane(plane, block, apex):
    path = run(plane, f"G2 {block} F100")
    middle = path.end[np.argmin(np.abs(np.cumsum(path.length) - 5 * math.pi))]
    np.testing.assert_allclose(middle, apex, atol=0.6)


def test_a_tangential_circle_continues_in_the_direction_of_the_line_before():
    path = run("G1 X10 F600", "CT X20 Y10")  # quarter circle about (10, 10)
    assert path.take(path.kind == ARC).length.sum() == pytest.approx(5 * math.pi, rel=1e-6)


def test_incremental_and_absolute_words_mix_in_one_block():
    assert end(run("G0 X10 Y10", "G91", "G1 X5 Y=AC(1) F100", "G90 X=IC(-3)")) == pytest.approx([12, 1, 0])


@pytest.mark.parametrize(
    ("blocks", "feed"),
    [
        (("G70", "G1 X1 F600"), 10.0),  # 840D sl: feedrates are not influenced by G70 and G71
        (("F600", "G70", "G1 X1"), 10.0),
        (("G1 F600 G70", "X1"), 10.0),
        (("G95 S60 M3", "G70 G1 X1 F0.1"), 0.1),
        (("G700", "G1 X1 F10"), 254 / 60),  # they are by G700, and by G20 of ISO
        (("G20 G1 X1 F10",), 254 / 60),
        (("G95 S60 M3", "G700 G1 X1 F0.1"), 2.54),
        (("G710 F600", "G700", "G1 X1"), 10.0),  # F counts in what held when it was programmed
        (("G700 F10", "G70", "G1 X1"), 254 / 60),
        (("G700 F10", "G71", "G1 X25.4"), 254 / 60),
        (("G700 F10", "G71", "G1 X25.4 F600"), 10.0),
        (("G93 G700 G1 X1 F2",), 2 * 25.4 / 60),
    ],
)
def test_every_inch_command_converts_lengths_and_only_g700_and_g20_the_feed_that_follows(blocks, feed):
    path = run(*blocks)
    assert end(path)[0] == pytest.approx(25.4)
    assert path.feed[-1] == pytest.approx(feed)


def test_feed_per_revolution_and_inverse_time_and_cutting_speed_become_mm_per_second():
    assert run("S600 M3", "G95 G1 X10 F0.2").feed[0] == pytest.approx(2.0)
    assert run("G93 G1 X30 Y40 F2").feed[0] == pytest.approx(50 * 2 / 60)
    path = run('T="MILL10"', "M6", "G96 S31.4159265359 M3", "G95 G1 X10 F0.1", tools=TOOLS)
    assert path.spindle_rpm[-1] == pytest.approx(1000.0)


def test_speed_direction_coolant_and_tool_hold_from_their_block_on():
    path = run('T="mill10"', "M6", "G0 Z5 S2000 M3 M8", "G1 X5 F100 S2500", "G1 X6 M4", "G0 Z9 M5 M9", tools=TOOLS)
    moves = path.take(path.kind != DWELL)
    assert moves.spindle_rpm.tolist() == [2000, 2500, -2500, 0]
    assert moves.coolant.tolist() == [True, True, True, False]
    assert set(moves.tool_id) == {"MILL10"}


def test_without_m6_in_the_program_t_changes_the_tool():
    assert run("T7 D1", "G0 X1", tools=TOOLS).tool_id.tolist() == ["7"]


def test_stops_and_smoothing_follow_g60_g64_g9_and_g641():
    path = run("G64", "G1 X1 F100", "G9 X2", "X3", "G641 ADIS=0.5 X4", "G60 X5")
    assert path.exact_stop.tolist() == [False, True, False, False, True]
    assert path.smoothing[3] == 0.5
    assert np.isnan(path.smoothing[0])


def test_a_dwell_takes_seconds_or_revolutions():
    path = run("S300 M3", "G0 X1", "G4 F2.5", "G4 S10", "X2")
    assert path.dwell.tolist() == [0, 2.5, 2.0, 0]
    assert path.kind.tolist() == [RAPID, DWELL, DWELL, RAPID]


def test_work_offsets_move_the_path_and_g53_and_supa_do_not_see_them():
    offsets = {"G54": (100.0, 50.0, 10.0), "G55": (1.0, 2.0, 3.0)}
    path = run(
        "G54", "G0 X1 Y1 Z1", "G53 X7 Y8 Z9", "X1 Y1 Z1", "G55 X0 Y0 Z0", "SUPA Z0", "G500 X0", zero_offsets=offsets
    )
    expected = [[101, 51, 11], [7, 8, 9], [101, 51, 11], [1, 2, 3], [1, 2, 0], [0, 2, 0]]
    np.testing.assert_allclose(path.end, expected)


def test_a_program_sets_an_offset_itself():
    path = run("$P_UIFR[1,X,TR]=40", "G54", "G0 X2")
    assert end(path)[0] == pytest.approx(42.0)


def test_frames_turn_shift_scale_and_mirror():
    assert end(run("TRANS X10 Y5", "G0 X1 Y1")) == pytest.approx([11, 6, 0])
    assert end(run("TRANS X10", "ATRANS X5", "G0 X1")) == pytest.approx([16, 0, 0])
    assert end(run("ROT Z90", "G0 X10 Y0")) == pytest.approx([0, 10, 0])
    assert end(run("TRANS X10", "AROT RPL=90", "G0 X10 Y0")) == pytest.approx([10, 10, 0])
    assert end(run("SCALE X2", "G0 X10 Y10")) == pytest.approx([20, 10, 0])
    assert end(run("MIRROR X0", "G0 X10 Y10")) == pytest.approx([-10, 10, 0])
    assert end(run("TRANS X10", "TRANS", "G0 X1")) == pytest.approx([1, 0, 0])
    assert end(run("G18", "ROT RPL=90", "G0 Z10 X0")) == pytest.approx([10, 0, 0])  # about y, from z to x


@given(angle=st.floats(-360, 360), radius=st.floats(0.5, 50))
@settings(max_examples=25, deadline=None)
def test_a_rotated_circle_keeps_its_length_and_turns_with_the_frame(angle, radius):
    path = run(f"ROT Z={angle:.6f}", f"G2 X{2 * radius:.6f} Y0 I{radius:.6f} J0 F600")
    assert path.length.sum() == pytest.approx(math.pi * radius, rel=1e-4)
    expected = [2 * radius * math.cos(math.radians(angle)), 2 * radius * math.sin(math.radians(angle)), 0]
    assert end(path) == pytest.approx(expected, abs=1e-4)


def test_polar_words_count_from_the_pole():
    path = run("G111 X10 Y10", "G0 AP=90 RP=5", "AP=IC(90)")
    np.testing.assert_allclose(path.end[:, :2], [[10, 15], [5, 10]], atol=1e-12)


def test_an_unknown_start_is_where_each_axis_is_first_sent():
    path = run("G0 X5 Y6", "G1 Z-1 F100", "X7", start=None)
    np.testing.assert_allclose(path.start[0], [5, 6, -1])


# --- tool radius compensation: areas and lengths of offset contours in closed form ------------------------------------


def square(side_words, *, inside):
    approach = "G0 X25 Y15" if inside else "G0 X20 Y-20"
    return (
        'T="MILL10"', "M6", approach, f"G1 {side_words} X20 Y0 F600",
        "X40", "Y40", "X0", "Y0", "X20", "G40 X20 Y20" if inside else "G40 X20 Y-20",
    )  # fmt: skip


def test_outside_a_square_the_tool_runs_its_perimeter_and_one_circle_of_its_radius():
    path = run(*square("G42", inside=False), tools=TOOLS)
    cut = path.take(np.isin(path.kind, (FEED, ARC)) & (path.nc_line >= 5) & (path.nc_line <= 9))
    assert cut.length.sum() == pytest.approx(160 + 2 * math.pi * 5, rel=1e-6)
    assert cut.end[:, :2].min() == pytest.approx(-5.0, abs=1e-6)


def test_inside_a_square_the_tool_runs_a_smaller_square():
    path = run(*square("G41", inside=True), tools=TOOLS)
    cut = path.take(np.isin(path.kind, (FEED, ARC)) & (path.nc_line >= 5) & (path.nc_line <= 9))
    assert cut.length.sum() == pytest.approx(4 * 30, rel=1e-9)


def test_inside_a_circle_the_tool_runs_the_radius_less():
    lines = ('T="MILL10"', "M6", "G0 X10 Y0", "G41 G1 X30 Y0 F600", "G3 X30 Y0 I-30 J0", "G40 G1 X10 Y0")
    path = run(*lines, tools=TOOLS)
    assert path.take(path.kind == ARC).length.sum() == pytest.approx(2 * math.pi * 25, rel=1e-6)


def test_an_inner_corner_between_line_and_circle_is_cut_at_their_offsets_intersection():
    # Line y = 0 meets the circle about (20, 0) with radius 10 at (10, 0); tool of radius 3 to the left.
    lines = ('T="MILL6"', "M6", "G0 X-10 Y-5", "G41 G1 X0 Y0 F600", "X10", "G2 X20 Y10 I10 J0", "G40 G1 X20 Y30")
    path = run(*lines, tools=TOOLS)
    corner = path.end[np.flatnonzero(path.nc_line == 5)[-1]]
    assert corner[1] == pytest.approx(3.0)
    assert math.hypot(corner[0] - 20, corner[1]) == pytest.approx(13.0, abs=1e-6)


def test_a_tool_too_large_for_the_contour_is_refused():
    lines = ('T="MILL10"', "M6", "G0 X10 Y0", "G41 G1 X30 Y0 F600", "G3 X30 Y0 I-4 J0", "G40 G1 X10 Y0")
    with pytest.raises(ProgramError, match=r"line 5.*too small for the tool"):
        run(*lines, tools=TOOLS)


# --- cycles -----------------------------------------------------------------------------------------------------------


def test_drilling_cycles_reach_depth_and_return():
    path = run("G0 X5 Y5 Z20", "S1000 M3 F100", "CYCLE82(10,0,2,-15,,0.5)")
    z = path.end[:, 2]
    assert z.min() == -15
    assert z[-1] == 10
    feed = path.take(path.kind == FEED)
    assert feed.length.sum() == pytest.approx(17.0)  # from the safety clearance to depth
    assert path.dwell.max() == 0.5


def test_drilling_as_the_control_itself_writes_it_is_the_same_hole():
    plain = run("G0 X5 Y5 Z20", "S1000 M3 F100", "CYCLE82(10,0,2,-15,,0.5)")
    written = run("G0 X5 Y5 Z20", "S=1000 M=3 F100", "CYCLE82(10,0,2,-15,,0.5,0,1,12)")
    np.testing.assert_array_equal(plain.end, written.end)
    assert run("S1000 M13", "G0 X1").coolant.all()


def test_deep_drilling_goes_down_step_by_step_and_clears_the_hole():
    path = run("G0 Z20", "S1000 M3 F100", "CYCLE83(10,0,2,-30,,,10,0,0,0,1,1)")
    turning_points = path.end[path.kind == FEED][:, 2]
    assert turning_points.tolist() == [-10, -20, -30]
    assert (path.end[path.kind == RAPID][:, 2] == 2).sum() >= 3


def test_a_modal_cycle_drills_after_each_move_and_a_pattern_at_each_hole():
    path = run(
        "G0 Z20", "F100 S500 M3", "MCALL CYCLE81(5,0,1,-3)", "G0 X10 Y0", "X20", "HOLES2(0,0,10,0,0,4)", "MCALL", "X0"
    )
    holes = path.end[path.end[:, 2] == -3][:, :2]
    expected = [[10, 0], [20, 0], [10, 0], [0, 10], [-10, 0], [0, -10]]
    np.testing.assert_allclose(holes, expected, atol=1e-9)


def test_tapping_feeds_at_pitch_times_speed_and_reverses():
    path = run("G0 Z20", "S500 M3", "CYCLE84(10,0,2,-10,,0,3,,1.25,,500,600)")
    feed = path.take(path.kind == FEED)
    np.testing.assert_allclose(feed.feed, [500 * 1.25 / 60, 600 * 1.25 / 60])
    assert feed.spindle_rpm.tolist() == [500, -600]


def test_iso_drilling_holds_until_g80():
    path = run("G0 X0 Y0 Z30", "F100", "G99 G81 X5 Y5 Z-4 R2", "X10", "G98 X15", "G80 X20")
    assert path.end[path.end[:, 2] == -4][:, 0].tolist() == [5, 10, 15]
    assert path.end[-1].tolist() == [20, 5, 30]


@pytest.mark.parametrize(
    "cycle", ["POCKET3(10,0,1,-4,60,40,8,50,30,0,2,0,0,600,200,0,1)", "POCKET4(10,0,1,-4,20,50,30,2,0,0,600,200,0,1)"]
)
def test_a_pocket_touches_its_walls_and_leaves_no_ridge(cycle):
    path = run('T="MILL10"', "M6", "S3000 M3", "G0 Z20", cycle, tools=TOOLS)
    floor = path.take((path.end[:, 2] == -4) & (path.start[:, 2] == -4))
    half = (30.0, 20.0) if "POCKET3" in cycle else (20.0, 20.0)
    for axis, centre in ((0, 50.0), (1, 30.0)):
        assert floor.end[:, axis].max() == pytest.approx(centre + half[axis] - 5, abs=0.02)
        assert floor.end[:, axis].min() == pytest.approx(centre - half[axis] + 5, abs=0.02)
    # Every point of the floor lies under the tool at some time.
    dense = np.concatenate([floor.start + u * (floor.end - floor.start) for u in np.linspace(0, 1, 40)])[:, :2]
    rng = np.random.default_rng(1)
    inside = rng.uniform(-1, 1, (300, 2)) * (np.array(half) - 6.0)
    if "POCKET4" in cycle:
        inside = inside[np.hypot(*inside.T) < 19]
    nearest = np.min(np.linalg.norm(dense[None] - (inside + np.array([50.0, 30.0]))[:, None], axis=2), axis=1)
    assert nearest.max() < 5.0
