"""The machine of the air cut: its four programs, and one program planned beside the runs that were recorded of it."""

import csv

import numpy as np
import pytest

from pido.config import machine
from pido.nc import ARC, FEED, interpret
from pido.process.motion import block_times, fit_dynamics, follow, plan_motion
from pido.process.motion.fit import box_mean

pytestmark = pytest.mark.real
RUNS_S = ((1.0, 82.0), (82.8, 163.0), (163.5, 243.4))
BOX_S = 0.082  # what the publishers averaged over


@pytest.fixture(scope="module")
def runs(real_data):
    with (real_data / "kit_dmc60h" / "S235JR_part2_aircut_1.csv").open() as file:
        rows = csv.DictReader(file)
        positions = np.array([[float(r[f"pos_{a}"]) for a in "xyz"] for r in rows])
    time = np.arange(len(positions)) / 50.0
    return [(time[a:b], positions[a:b]) for a, b in ((int(50 * lo), int(50 * hi)) for lo, hi in RUNS_S)]


@pytest.fixture(scope="module")
def program(real_data):
    return interpret(real_data / "kit_dmc60h" / "V_S235JR_VALIDATION.MPF", machine=machine("dmc60h"))


@pytest.mark.parametrize(
    ("name", "feeds", "circles", "tools"),
    [
        ("V_S235JR_VALIDATION.MPF", 24, 8, 1),
        ("AL2007_VALIDATION.MPF", 24, 8, 1),
        ("V_S235_TRAINING.MPF", 30, 8, 3),
        ("AL2007_TRAINING.MPF", 30, 8, 3),
    ],
)
def test_every_motion_block_of_the_published_programs_is_understood(real_data, name, feeds, circles, tools):
    file = real_data / "kit_dmc60h" / name
    path = interpret(file, start=(0.0, 0.0, 100.0))
    code = [line.partition(";")[0] for line in file.read_text(encoding="utf-8").splitlines()]
    moving = [
        n
        for n, text in enumerate(code, 1)
        if any(text.split()[:1] == [g] for g in ("G0", "G1", "G2", "G3")) and "B0" not in text
    ]
    assert set(moving) == set(path.nc_line[path.kind != 3].tolist())
    cut = np.isin(path.kind, (FEED, ARC))
    assert len(np.unique(path.block[cut])) == feeds
    assert len(np.unique(path.block[path.kind == ARC])) == circles
    assert len(path.tools) == tools


def test_the_recorded_axes_stay_within_20_micrometres_of_the_programmed_path(program, runs):
    shifts = []
    for _, positions in runs:
        run = follow(program, positions)
        shifts.append(run.shift_mm)
        assert np.sqrt(np.mean(run.distance**2)) < 0.02
    np.testing.assert_allclose(np.ptp(shifts, axis=0)[:2], 0, atol=1e-3)
    np.testing.assert_allclose(shifts[0][:2], [37.792, -269.310], atol=2e-3)  # measured apart, method notes section 5


def test_dynamics_of_half_a_run_predict_the_block_times_of_the_others(program, runs):
    time, positions = runs[0]
    fitted = fit_dynamics(program, machine("dmc60h"), time, positions, box_s=BOX_S, blocks=slice(0, 13))
    motion = plan_motion(program, machine("dmc60h"), 500.0, fitted)
    _, planned = block_times(program, motion.time, box_mean(motion.pos[:, :3], 41), np.zeros(3))
    for time, positions in runs[1:]:
        _, recorded = block_times(program, time, positions)
        error = np.diff(planned) - np.diff(recorded)
        assert np.sqrt(np.mean(error**2)) < 0.025
        assert abs(error.sum()) < 0.003 * np.sum(np.diff(recorded))
