"""Removal against closed forms, an independent fine map, and what must hold for every path."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pido.core.errors import SettingsError
from pido.core.machining import MeshStock, Stock, Tool
from pido.process.engagement import tool_shape
from pido.process.height_map import block
from pido.process.removal import raw_part, remove, tool_of_each_sample

BLOCK = Stock((0.0, 0.0, -20.0), (60.0, 60.0, 0.0))
STEP = 0.192  # 9.6 mm/s at 50 Hz


def end_mill(D=10.0):
    return Tool("t", D, 4)


def along(*corners, step=STEP):
    """Corners of a path, filled up to a sample per step."""
    points = [np.asarray(corners[0], float)]
    for a, b in pairwise(corners):
        a, b = np.asarray(a, float), np.asarray(b, float)
        n = max(1, round(np.linalg.norm(b - a) / step))
        points += [a + (b - a) * i / n for i in range(1, n + 1)]
    return np.array(points)


def cut(points, tool=None, grid_mm=0.1, stock: Stock | MeshStock = BLOCK):
    tool = tool or end_mill()
    part = raw_part(stock, grid_mm)
    return remove(part, points, np.zeros(len(points), int), (tool,)), part


@pytest.mark.parametrize("D", [3.0, 6.35, 10.0])
@pytest.mark.parametrize("degrees", [0.0, 1.0, 15.0, 27.3, 45.0, 90.0, 200.0])
def test_a_slot_removes_its_width_times_its_depth_in_every_direction(D, degrees):
    a = np.radians(degrees)
    s = np.arange(-20, 20, STEP)
    points = np.c_[30.013 + s * np.cos(a), 29.871 + s * np.sin(a), np.full(len(s), -6.0)]
    steady = cut(points, end_mill(D))[0].volume[80:]
    assert steady.mean() == pytest.approx(D * 6 * STEP, rel=1e-4)
    assert steady.std() / steady.mean() < 1e-3  # every 20 ms step, not only their mean


@pytest.mark.parametrize("a_e", [0.37, 2.5, 5.0, 8.13])
def test_a_side_cut_removes_a_e_times_a_p_and_lies_on_its_side_of_the_path(a_e):
    points = along((-10, a_e - 5.0, -4), (70, a_e - 5.0, -4), step=0.2)
    removal, _ = cut(points)
    steady = slice(150, 300)
    assert removal.volume[steady].mean() == pytest.approx(a_e * 4 * 0.2, rel=1e-3)
    assert removal.depth[steady] == pytest.approx(4.0, abs=1e-4)
    # the material reaches from y = 0 to the tool's left edge; the tool moves along +x at y = a_e - 5
    assert removal.offset[steady].mean() == pytest.approx(5.0 - a_e / 2, abs=0.02)


@pytest.mark.parametrize("degrees", [0.0, 20.0, 160.0, 290.0])
def test_a_slot_across_an_older_one_removes_what_that_left(degrees):
    a, s = np.radians(degrees), np.arange(-20, 20, STEP)
    x, y = 30.013 + s * np.cos(a), 29.871 + s * np.sin(a)
    older = np.c_[30.013 - s * np.sin(a), 29.871 + s * np.cos(a), np.full(len(s), -2.0)]
    points = np.r_[older, [[*older[-1, :2], 1.0], [x[0], y[0], 1.0]], np.c_[x, y, np.full(len(s), -6.0)]]
    removal, _ = cut(points, end_mill())
    steps = removal.volume[-len(s) + 1 :]  # without the plunge
    assert steps.sum() == pytest.approx(10 * 6 * (s[-1] - s[0]) - 10 * 10 * 2, rel=1e-4)
    # the rim, from its sides at s to its foremost point at s + 5, lies in the older slot from -5 to 5
    inside = steps[(s[:-1] > -4.8) & (s[1:] < -0.2)]
    np.testing.assert_allclose(inside, 10 * 4 * STEP, rtol=2e-3)


def test_a_full_circle_removes_its_ring():
    t = np.linspace(0, 2 * np.pi, 500)
    ring = np.c_[30.013 + 12 * np.cos(t), 29.871 + 12 * np.sin(t), np.full(500, -5.0)]
    removal, _ = cut(np.r_[[[*ring[0, :2], 1.0]], ring])
    assert removal.volume.sum() == pytest.approx(4 * np.pi * 12 * 5 * 5, rel=1e-3)
    steady = removal.volume[100:390]  # after the start, before the ring closes
    assert steady.mean() == pytest.approx(10 * 5 * 2 * np.pi * 12 / 499, rel=1e-3)


@pytest.mark.parametrize("degrees", [0.0, 45.0])
def test_a_ramp_removes_the_slot_at_its_depth_and_the_floor_that_goes_down(degrees):
    a, fall = np.radians(degrees), 0.1
    s = np.arange(0, 36, 0.2)
    points = np.c_[12.03 + s * np.cos(a), 11.01 + s * np.sin(a), -fall * s]
    removal, _ = cut(points)
    k = np.arange(80, 175)
    side = 10 * 0.2 * fall * (s[k] + s[k - 1]) / 2
    floor = np.pi * 25 * fall * 0.2
    np.testing.assert_allclose(removal.volume[k].mean(), (side + floor).mean(), rtol=1e-3)
    np.testing.assert_allclose(removal.end[k].mean(), floor, rtol=0.02)


def pocket_path():
    ys = np.arange(15, 45.01, 6)
    corners = [(10.033, 15.071, 1.0), (10.033, 15.071, -5.0)]
    for i, y in enumerate(ys):
        x = (10.033, 50.033) if i % 2 == 0 else (50.033, 10.033)
        corners += [(x[0], y + 0.071, -5.0), (x[1], y + 0.071, -5.0)]
    return corners


def pocket_area(corners, D=10.0, h=0.04):
    """Area that the pocket's segments sweep, by counting points: shares nothing with the code under test."""
    x, y = np.meshgrid(np.arange(h / 2, 60, h), np.arange(h / 2, 60, h), indexing="ij")
    inside = np.zeros(x.shape, bool)
    for a, b in pairwise(corners):
        d = np.subtract(b, a)[:2]
        t = np.clip(((x - a[0]) * d[0] + (y - a[1]) * d[1]) / max(d @ d, 1e-12), 0, 1)
        inside |= (x - a[0] - t * d[0]) ** 2 + (y - a[1] - t * d[1]) ** 2 < D**2 / 4
    return inside.sum() * h**2


def test_a_pocket_removes_what_its_path_sweeps():
    removal, _ = cut(along(*pocket_path()))
    assert removal.volume.sum() == pytest.approx(5 * pocket_area(pocket_path()), rel=1e-3)


def test_two_slots_side_by_side_leave_no_wall_between_them():
    # spacing equal to the diameter, border inside a cell: each pass covers its part of the cell
    rows = [along((-10, y, -3), (70, y, -3)) for y in (20.04, 30.04)]
    removal, part = cut(np.r_[rows[0], [[70, 25, 1]], rows[1]])
    assert removal.volume.sum() == pytest.approx(2 * 10 * 60 * 3, rel=2e-4)
    v = round(25.04 / 0.1)
    assert part.heights[v - 1 : v + 2, 100:500].max() == pytest.approx(-3.0, abs=1e-3)


def ball_section(R, a):
    return R * R * np.arccos(1 - a / R) - (R - a) * np.sqrt(2 * R * a - a * a)


def test_a_ball_nose_slot_removes_the_circle_segment():
    points = along((10, 30.07, -2), (50, 30.07, -2), step=0.2)
    steady = cut(points, Tool("b", 10.0, 2, "ball"))[0].volume[60:]
    assert steady.mean() == pytest.approx(ball_section(5.0, 2.0) * 0.2, rel=1e-3)


def test_a_bull_nose_slot_removes_the_rounded_section():
    R, r, a = 5.0, 2.0, 3.0
    section = 2 * R * a - 2 * (r * r - np.pi * r * r / 4)
    points = along((10, 30.07, -a), (50, 30.07, -a), step=0.2)
    steady = cut(points, Tool("b", 2 * R, 2, "bull", r))[0].volume[60:]
    assert steady.mean() == pytest.approx(section * 0.2, rel=1e-3)


def test_a_drill_removes_cylinder_and_cone():
    cone = 5 / np.tan(np.radians(59))
    points = along((30.013, 29.87, 4), (30.013, 29.87, -12), step=0.05)
    removal, _ = cut(points, Tool("d", 10.0, 2, "drill", kappa_deg=59.0))
    assert removal.volume.sum() == pytest.approx(np.pi * 25 * (12 - cone) + np.pi * 25 * cone / 3, rel=1e-3)
    assert removal.side.sum() == pytest.approx(0.0, abs=1e-3)


def test_the_error_falls_with_the_square_of_the_grid():
    exact = np.pi * 25 * 5
    points = along((30.013, 29.87, 1), (30.013, 29.87, -5))
    grids = np.array([1.0, 0.5, 0.25, 0.125])
    error = [abs(cut(points, grid_mm=g)[0].volume.sum() - exact) / exact for g in grids]
    order = np.polyfit(np.log(grids), np.log(error), 1)[0]
    assert order > 1.7
    assert error[-1] < 5e-4


TOOLS = [
    end_mill(8.0),
    Tool("b", 8.0, 2, "ball"),
    Tool("r", 8.0, 2, "bull", 1.5),
    Tool("d", 8.0, 2, "drill", kappa_deg=59),
]


@pytest.mark.parametrize("tool", TOOLS, ids=lambda t: t.kind)
def test_a_wild_path_removes_what_a_fine_map_of_whole_discs_removes(tool):
    rng = np.random.default_rng(3)
    corners = np.c_[rng.uniform(8, 22, (7, 2)), rng.uniform(-6, -1, 7)]
    points = along((*corners[0, :2], 2.0), *corners, step=0.4)
    stock = Stock((0.0, 0.0, -10.0), (30.0, 30.0, 0.0))
    removal, _ = cut(points, tool, grid_mm=0.25, stock=stock)
    h = 0.05
    x = np.arange(h / 2, 30, h)
    heights = np.zeros((600, 600))
    R = tool.diameter_mm / 2
    flat, corner, slope = tool_shape(tool)
    for u, v, w in along(*points, step=0.1):
        i, j = (slice(max(int((c - R) / h) - 1, 0), int((c + R) / h) + 2) for c in (u, v))
        r = np.hypot(x[i, None] - u, x[None, j] - v)
        over = np.maximum(r - flat, 0.0)
        rise = over * slope if slope else corner - np.sqrt(np.maximum(corner**2 - over**2, 0.0))
        under = np.where(r <= R, w + rise, np.inf)
        heights[i, j] = np.minimum(heights[i, j], under)
    assert removal.volume.sum() == pytest.approx(-heights.sum() * h**2, rel=5e-3)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), kind=st.sampled_from(["end", "ball"]))
def test_what_is_removed_is_missing_and_cutting_again_removes_next_to_nothing(seed, kind):
    rng = np.random.default_rng(seed)
    corners = np.c_[rng.uniform(-5, 35, (5, 2)), np.sort(rng.uniform(-9, 1, 5))[::-1]]
    points = along((*corners[0, :2], 3.0), *corners, step=0.5)
    part = block(Stock((0.0, 0.0, -8.0), (30.05, 30.0, 0.0)), 0.3)
    before = part.volume
    removal = remove(part, points, np.zeros(len(points), int), (Tool("t", 6.0, 2, kind),))
    assert before - part.volume == pytest.approx(removal.volume.sum(), rel=1e-4, abs=0.02)
    again = remove(part, points, np.zeros(len(points), int), (Tool("t", 6.0, 2, kind),))
    assert again.volume.sum() + again.before_start <= 5e-3 * removal.volume.sum() + 0.05
    assert (removal.side >= 0).all()
    assert (removal.end >= 0).all()


def test_a_block_that_is_no_multiple_of_the_grid_has_its_exact_volume():
    part = block(Stock((0.0, 0.0, 0.0), (10.03, 7.17, 5.0)), 0.1)
    assert part.volume == pytest.approx(10.03 * 7.17 * 5.0, rel=1e-6)


def test_a_tool_without_id_cuts_nothing_and_unknown_tools_are_named():
    index, used = tool_of_each_sample(
        np.array(["", "A", 3.0, np.nan], dtype=object), 4, {"A": end_mill(), "3": end_mill()}
    )
    assert index.tolist() == [-1, 0, 1, -1]
    points = along((10, 30, -5), (30, 30, -5))
    part = raw_part(BLOCK, 0.5)
    assert remove(part, points, np.full(len(points), -1), used).volume.sum() == 0.0
    with pytest.raises(SettingsError, match="B"):
        tool_of_each_sample(np.array(["B"], dtype=object), 1, {"A": end_mill()})


def test_missing_positions_are_not_bridged():
    points = along((10, 30, -5), (50, 30, -5))
    points[60:160] = np.nan
    removal, _ = cut(points, grid_mm=0.25)
    assert removal.volume[60:160].sum() == 0.0
    assert removal.volume.sum() < 0.75 * 40 * 10 * 5


def test_an_stl_block_cuts_like_the_block(tmp_path):
    import trimesh

    box = trimesh.creation.box(bounds=[[0, 0, -20], [60, 60, 0]])
    points = along((-10, 30.03, -4), (70, 30.03, -4))
    wanted = cut(points)[0].volume
    for name, kind in (("binary.stl", "stl"), ("ascii.stl", "stl_ascii")):
        box.export(tmp_path / name, file_type=kind)
        got = cut(points, stock=MeshStock(str(tmp_path / name)))[0].volume
        np.testing.assert_allclose(got, wanted, atol=2e-3)


def test_a_round_bar_as_a_mesh_has_its_volume_and_its_place(tmp_path):
    import trimesh

    trimesh.creation.cylinder(radius=20, height=10, sections=256).export(tmp_path / "bar.stl")
    part = raw_part(MeshStock(str(tmp_path / "bar.stl"), (100.0, 50.0, -5.0)), 0.2)
    assert part.volume == pytest.approx(np.pi * 400 * 10, rel=2e-3)
    assert part.top == pytest.approx(0.0, abs=1e-4)
    assert part.corner + 20 == pytest.approx([100.0, 50.0], abs=0.2)


@pytest.mark.parametrize("content", [b"", b"solid nothing\nendsolid nothing\n", b"no mesh at all, only text"])
def test_a_mesh_that_cannot_be_read_is_one_clear_error(tmp_path, content):
    path = tmp_path / "raw.stl"
    path.write_bytes(content)
    with pytest.raises(SettingsError, match=r"raw\.stl"):
        raw_part(MeshStock(str(path)))


def test_a_map_that_would_not_fit_names_the_grid_that_does():
    with pytest.raises(SettingsError, match="grid_mm"):
        block(Stock((0.0, 0.0, 0.0), (3000.0, 2000.0, 10.0)), 0.1)
