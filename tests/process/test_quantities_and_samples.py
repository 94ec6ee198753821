"""From a path or a program to the contract's columns and to rows: units, frames, engagement, early refusals."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from pido.cli import pido
from pido.config import load_job, machine, material
from pido.core.columns import INPUTS, PROCESS
from pido.core.errors import ProgramError, RecordingError, SettingsError
from pido.core.machining import Machine, Stock, Tool
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.preparation import job_of
from pido.process.engagement import engagement
from pido.process.motion import Dynamics
from pido.process.quantities import area_removal, process_quantities
from pido.process.samples import to_samples
from pido.process.simulate import as_air_cut, simulate_program

MILL = machine("dmc60h")
STEEL = material("S235JR")
STOCK = Stock((0.0, 0.0, -30.0), (80.0, 60.0, 0.0))
TOOLS = {"T10": Tool("T10", 10.0, 4)}


def recorded(points, v_sp=19_200.0, rate_hz=50.0, **columns):
    points = np.asarray(points, float)
    time = np.arange(len(points)) / rate_hz
    v = np.gradient(points, time, axis=0)
    a = np.gradient(v, time, axis=0)
    return Recording(
        PartInfo(part="p", machine="dmc60h"),
        {
            "time": time,
            **{f"pos_{c}": points[:, i] for i, c in enumerate("xyz")},
            **{f"v_{c}": v[:, i] for i, c in enumerate("xyz")},
            **{f"a_{c}": a[:, i] for i, c in enumerate("xyz")},
            "v_sp": np.full(len(time), v_sp),
            "a_sp": np.zeros(len(time)),
            **columns,
        },
    )


def slot(y=30.03, z=-6.0, v=9.6):
    x = np.arange(-8, 70, v / 50)
    return np.c_[x, np.full(len(x), y), np.full(len(x), z)]


def quantities(recording, mill: Machine = MILL, stock=STOCK, tools=TOOLS, **more):
    return process_quantities(recording, stock=stock, tools=tools, material=STEEL, machine=mill, **more)


def test_the_steel_slot_of_the_paper_has_its_removal_rate_forces_and_torque():
    # 576 mm/min, a_p 6, a_e 10: MRR 576 mm3/s, AR 60 mm2; forces by hand as in the test of the formulas
    row = quantities(recorded(slot())).rows(slice(200, 201))
    assert row["mrr_sim"][0] == pytest.approx(576.0, rel=1e-4)
    assert area_removal(row)[0] == pytest.approx(60.0, rel=1e-4)
    f_c, f_cn = 6 * 1990 * 0.028648**0.2981, 6 * 351 * 0.028648**0.5089
    assert row["f_y_sim"][0] == pytest.approx(f_c, rel=1e-3)
    assert row["f_x_sim"][0] == pytest.approx(-f_cn, abs=1e-3 * f_c)
    assert row["f_z_sim"][0] == pytest.approx(6 * 247 * 0.028648**0.8, rel=1e-3)
    assert row["f_sp_sim"][0] == pytest.approx(np.hypot(f_c, f_cn), rel=1e-3)
    assert row["m_sp_sim"][0] == pytest.approx(np.hypot(f_c, f_cn) * 5e-3, rel=1e-3)


@pytest.mark.parametrize(("y", "a_e"), [(0.0, 5.0), (-3.0, 2.0), (2.5, 7.5)])
def test_engagement_of_a_side_cut_is_that_of_the_drawing(y, a_e):
    row = quantities(recorded(slot(y=y))).rows(slice(200, 201))
    assert row["a_p"][0] == pytest.approx(6.0, abs=1e-3)
    assert row["a_e"][0] == pytest.approx(a_e, abs=0.02)
    assert row["phi_s"][0] == pytest.approx(np.arccos(1 - a_e / 5), abs=0.01)


def test_removal_rate_over_time_is_the_removed_volume():
    done = quantities(recorded(slot()))
    assert np.trapezoid(done["mrr_sim"], done.time) == pytest.approx(float(done.notes[-1].split()[2]), rel=1e-3)


@pytest.mark.parametrize(("axis", "order"), [("x", (1, 2, 0)), ("y", (2, 0, 1))])
def test_a_horizontal_spindle_cuts_the_same_chip_along_its_own_axes(axis, order):
    upright = quantities(recorded(slot(y=2.5)))
    place = np.argsort(order)
    config = Machine(MILL.id, MILL.axes, MILL.spindle_max_deg_s, MILL.spindle_acc_deg_s2, tool_axis=axis)
    stock = Stock(*(tuple(np.array(c)[place].tolist()) for c in (STOCK.low_mm, STOCK.high_mm)))
    lying = quantities(recorded(slot(y=2.5)[:, place]), config, stock)
    np.testing.assert_allclose(lying["mrr_sim"], upright["mrr_sim"], atol=1e-6)
    names = [f"f_{c}_sim" for c in "xyz"]
    for i, name in enumerate(names):
        np.testing.assert_allclose(lying[names[order[i]]], upright[name], atol=1e-6)


@pytest.mark.parametrize("name", ["S235JR", "AL2007T4"])
@pytest.mark.parametrize("way", [0.0, 1e-6, 1e-5, 1e-4, 1e-3])
def test_a_tool_that_stops_in_the_material_and_is_lifted_feels_no_more_than_in_the_cut(name, way):
    cut = slot()[:200]
    lifted = cut[-1] + np.c_[np.minimum(np.arange(1, 21), 2) * way, np.zeros(20), np.cumsum(np.arange(1, 21) * 0.05)]
    done = process_quantities(
        recorded(np.r_[cut, lifted]), stock=STOCK, tools=TOOLS, material=material(name), machine=MILL
    )
    force = np.linalg.norm([done[f"f_{a}_sim"] for a in "xyz"], axis=0)
    # with z = 1.08 the force of a thin chip is higher: 1e-4 mm in 40 ms is a chip 4000 times as thin
    assert force[200:].max() <= force[100:199].max() * (1.0 if name == "S235JR" else 4000.0**0.08)


def test_what_a_step_cuts_beyond_one_width_is_depth_only_where_the_tool_went_somewhere():
    ten = TOOLS["T10"]
    side, across = np.array([88.0, 0.088]), np.array([1.0, 1e-3])  # twice the slot of 4.4 mm, on 1 mm and on a hair
    none = np.zeros(2)
    state = engagement(ten, side, none, none, np.full(2, 4.4), across, none)
    np.testing.assert_allclose(state.edge_depth, [8.8, 4.4])
    np.testing.assert_allclose(state.a_e, 10.0)


def test_half_the_sample_rate_sees_the_same_removal_rate():
    fast = quantities(recorded(slot()))
    slow = quantities(recorded(slot()[::2], rate_hz=25.0))
    np.testing.assert_allclose(slow["mrr_sim"][60:180], fast["mrr_sim"][120:360:2], rtol=1e-3)


def test_the_mean_of_all_teeth_is_the_tooth_times_the_teeth_in_the_cut():
    one, all_teeth = quantities(recorded(slot())), quantities(recorded(slot()), teeth="mean")
    np.testing.assert_allclose(
        all_teeth["m_sp_sim"][200], 2.0 * one["m_sp_sim"][200], rtol=1e-3
    )  # 4 teeth, half a turn


def test_material_removed_with_the_spindle_at_rest_has_no_force_and_the_notes_say_so():
    done = quantities(recorded(slot(), v_sp=0.0))
    assert np.isnan(done["m_sp_sim"][200])
    assert done["mrr_sim"][200] == pytest.approx(576.0, rel=1e-3)
    assert "spindle at rest" in done.notes[-1]
    with pytest.raises(RecordingError, match="no sample has the tool engaged"):
        to_samples(
            done.rows(done["mrr_sim"] > 0).with_columns(mrr_sim=np.zeros((done["mrr_sim"] > 0).sum())), MILL, "d"
        )


def test_a_sample_without_position_has_no_process_quantities():
    path = slot()
    path[150] = np.nan
    done = quantities(recorded(path))
    assert all(np.isnan(done[name][150]) for name in PROCESS)


def test_rows_are_the_engaged_samples_with_the_held_direction():
    still = np.repeat(slot()[-1:], 40, axis=0)
    back = slot()[::-1]
    recording = quantities(recorded(np.r_[slot(), still, back], curr_x=np.arange(2 * len(slot()) + 40.0)))
    samples = to_samples(recording, MILL, "digest")
    ar = area_removal(recording)
    assert (samples.ar > 0).all()
    assert (samples.ar < 200).all()
    np.testing.assert_array_equal(samples.ar, ar[samples.row])
    np.testing.assert_array_equal(samples.currents[:, 0], samples.row)
    assert np.isnan(samples.currents[:, 1:]).all()
    assert (samples.direction[:, 0] == 1).all()
    np.testing.assert_array_equal(samples.inputs[:, 0], recording["v_x"][samples.row])
    assert samples.inputs.shape[1] == len(INPUTS)
    everything = to_samples(recording, MILL, "digest", engaged_only=False)
    assert len(everything) == len(recording)
    stands = slice(len(slot()) + 5, len(slot()) + 35)
    assert (everything.direction[stands, 0] == 1).all()  # held while the axis rests
    assert (everything.direction[stands, 1] == 0).all()  # never moved: not known
    assert (everything.direction[-10:, 0] == -1).all()


def test_rows_of_a_recording_without_process_quantities_are_refused_unless_it_is_an_air_cut():
    with pytest.raises(RecordingError, match="f_x_sim"):
        to_samples(recorded(slot()), MILL, "d")
    air = to_samples(as_air_cut(recorded(slot())), MILL, "d", engaged_only=False)
    assert len(air) == len(slot())
    assert not air.ar.any()


def test_a_recording_without_a_spindle_is_not_told_to_derive_its_motion_from_positions():
    whole = as_air_cut(recorded(slot()))

    def refused(*gone):
        kept = {name: values for name, values in whole.columns.items() if name not in gone}
        with pytest.raises(RecordingError) as error:
            to_samples(Recording(whole.part, kept), MILL, "d", engaged_only=False)
        return str(error.value)

    said = refused("pos_sp", "v_sp", "a_sp")
    assert "v_sp, a_sp missing" in said
    assert "Nothing of the spindle was recorded: export v_sp in deg/s and curr_sp in A" in said
    assert "Derive" not in said
    assert "Derive the motion of the spindle first" in refused("a_sp")
    assert "Derive the motion of axis y first" in refused("v_y", "a_y")
    assert "Nothing of axis y was recorded: export pos_y in mm and curr_y in A" in refused("pos_y", "v_y", "a_y")


PROGRAM = """G90 G94 G17
T="T10"
M6
G0 X-10 Y30 Z10 S3200 M3
G0 Z-4
G1 X60 F600
G1 Y10
G0 Z10
M30
"""


def simulated(program=PROGRAM, stock: Stock | None = STOCK, **more):
    # Without servo lag, so that what a block cuts is cut while it is executed.
    more.setdefault("dynamics", Dynamics())
    return simulate_program(program, machine=MILL, tools=TOOLS, material=STEEL, stock=stock, **more)


def test_a_program_becomes_a_recording_in_the_contracts_columns():
    recording = simulated()
    for name in (*INPUTS, *PROCESS, "pos_x", "pos_sp", "nc_line", "tool_id", "coolant"):
        assert len(recording[name]) == len(recording)
    cuts = (
        recording["mrr_sim"] > 0.05 * recording["mrr_sim"].max()
    )  # a block's last micrometre may fall to the next sample
    assert set(recording["nc_line"][cuts]) == {6.0, 7.0}
    # two slots at depth 4, each with its round end, less what lies in both (a square and a quarter disc)
    assert np.trapezoid(recording["mrr_sim"], recording.time) == pytest.approx(
        4 * (600 + 200 + 2 * np.pi * 25 / 2 - 25 - np.pi * 25 / 4), rel=1e-3
    )


def test_without_a_raw_part_nothing_is_cut_and_the_notes_say_so():
    recording = simulated(stock=None)
    assert not any(recording[name].any() for name in PROCESS)
    assert any("air cut" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("change", "stock", "message"),
    [
        (("G1 Y10", "G0 Y10"), STOCK, r"line 7: gouge"),
        (("G0 Z-4", "G0 Z-4\nG0 X20"), STOCK, r"line 6: gouge"),
        (("S3200 M3", ""), STOCK, r"line 6: .*spindle stands still"),
        (("G1 X60", "G1 X140"), STOCK, r"raw part is smaller than the path.*line 6"),
        (("", ""), Stock((200.0, 200.0, -30.0), (300.0, 300.0, 0.0)), r"smaller than the path"),
        (("", ""), Stock((0.0, 0.0, -60.0), (80.0, 60.0, -20.0)), r"no feed move meets the raw part"),
        (('T="T10"', 'T="T99"'), STOCK, r"T99"),
    ],
)
def test_an_impossible_program_is_refused_before_anything_runs(change, stock, message):
    with pytest.raises((ProgramError, SettingsError), match=message):
        simulated(PROGRAM.replace(*change), stock)


JOB = """
machine = "dmc60h"
material = "S235JR"
[stock]
low_mm = [0.0, 0.0, -30.0]
high_mm = [80.0, 60.0, 0.0]
[tools.T10]
diameter_mm = 10.0
teeth = 4
"""


def test_a_job_file_is_checked_whole_and_every_fault_is_named(tmp_path):
    path = tmp_path / "job.toml"
    path.write_text(JOB.replace("teeth = 4", "teeths = 4").replace('material = "S235JR"', "grid_mm = -1"))
    with pytest.raises(SettingsError) as caught:
        load_job(path)
    for place in ("teeths", "teeth:", "grid_mm"):
        assert place in str(caught.value)


def test_a_job_needs_the_material_of_its_raw_part(tmp_path):
    path = tmp_path / "job.toml"
    path.write_text(JOB.replace('material = "S235JR"', ""))
    with pytest.raises(SettingsError, match="material"):
        load_job(path)


def test_the_command_writes_a_part_and_says_what_it_will_take(tmp_path):
    (tmp_path / "job.toml").write_text(JOB)
    (tmp_path / "part.MPF").write_text(PROGRAM)
    call = ["simulate", str(tmp_path / "part.MPF"), "--job", str(tmp_path / "job.toml")]
    done = CliRunner().invoke(pido, [*call, "--out", str(tmp_path / "out"), "--json"])
    assert done.exit_code == 0, done.output
    figures = json.loads(done.stdout)
    assert figures["median_ar_mm2"] == pytest.approx(40.0, rel=1e-2)
    from pido.recordings import read_recording

    back = read_recording(tmp_path / "out")
    assert back.part.program == "part.MPF"
    assert len(back) == figures["samples"]


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_the_blank_of_a_part_stands_where_it_says_whichever_way_the_tool_points(axis):
    config = Machine(MILL.id, MILL.axes, MILL.spindle_max_deg_s, MILL.spindle_acc_deg_s2, tool_axis=axis)
    about = {"center_xy_mm": [10, 20], "top_z_mm": 5, "blank_mm": [150, 75, 50]}
    part = PartInfo.model_validate({"part": "p", "machine": "m", "workpiece": about})
    stock = job_of(Recording(part, {"time": np.zeros(1)}), None, config, {}).stock
    assert stock == Stock((-65.0, -17.5, -45.0), (85.0, 57.5, 5.0))
