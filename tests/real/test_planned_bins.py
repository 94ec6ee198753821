"""The bins that a program promises, beside those that its recording went through."""

import csv

import numpy as np
import pytest

from pido.config import machine
from pido.core.part import PartInfo
from pido.feature_space.density import relevant_bins
from pido.feature_space.grid import SAMPLING_GRID
from pido.nc import interpret
from pido.process.motion import plan_motion

pytestmark = pytest.mark.real


def test_planned_bins_hold_at_least_95_percent_of_what_is_later_recorded(real_data):
    mill = machine("dmc60h")
    folder = real_data / "kit_dmc60h"
    motion = plan_motion(interpret(folder / "V_S235JR_VALIDATION.MPF", machine=mill), mill)
    planned = motion.recording(PartInfo(part="planned", machine="dmc60h"))
    path = np.column_stack([planned["v_x"], planned["v_y"], np.zeros(len(planned))])
    with (folder / "S235JR_part2_aircut_1.csv").open() as file:
        recorded = np.array([[float(row["v_x"]), float(row["v_y"]), 0.0] for row in csv.DictReader(file)])
    recorded = recorded[np.hypot(recorded[:, 0], recorded[:, 1]) > 0.05]
    inside = np.isin(SAMPLING_GRID.ids(recorded), relevant_bins(path, SAMPLING_GRID))
    assert inside.mean() >= 0.95
