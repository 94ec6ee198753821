"""The air cut of a DMC 60H against the paper's equation: known from outside, told to nobody inside the tool."""

import numpy as np
import pandas as pd
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.diagnose import diagnose


@pytest.fixture(scope="module")
def diagnosis(real_data):
    path = real_data / "kit_dmc60h" / "S235JR_part2_aircut_1.csv"
    if not path.is_file():
        pytest.skip(f"the air cut of the DMC 60H is not at {path}")
    table = pd.read_csv(path, index_col=0)
    columns = {"time": np.arange(len(table)) * 0.02, **{c: table[c].to_numpy(float) for c in table}}
    keep = {c: v for c, v in columns.items() if c not in ("curr_z", "curr_sp")}
    return diagnose([Recording(PartInfo(part="aircut", machine="dmc60h"), keep)])


@pytest.mark.slow
@pytest.mark.real
@pytest.mark.parametrize("axis", ["x", "y"])
def test_the_axis_goes_on_holding_friction_at_standstill(diagnosis, axis):
    assert next(f.mechanism for f in diagnosis.findings if f.axis == axis) == "standstill_friction"


@pytest.mark.slow
@pytest.mark.real
def test_the_resets_of_the_spindle_counter_are_faults_of_the_input(diagnosis):
    assert [f.mechanism for f in diagnosis.findings if f.axis == "sp"] == ["input_fault"]
