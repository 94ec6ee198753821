"""EMPS, a servo axis with known constants: what its published model leaves out, and friction withheld altogether."""

import numpy as np
import pytest
from scipy.signal import butter, filtfilt

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.diagnose import diagnose
from pido.recordings import read_recording

M, FV, FC, OFFSET = 95.1089, 203.5034, 20.3935, -3.1648  # kg, N·s/m, N, N: published


@pytest.fixture(scope="module")
def axis(real_data):
    """Position, speed, acceleration and drive force at 100 Hz; every signal is filtered the same way."""
    path = real_data / "emps" / "DATA_EMPS.mat"
    if not path.is_file():
        pytest.skip(f"EMPS is not at {path}")
    r = read_recording(path)
    time, position = r.time, r["pos_x"] / 1000
    smooth = filtfilt(*butter(4, 60 / 500), position)
    v = np.gradient(smooth, time)
    return time, smooth, v, np.gradient(v, time), r["curr_x"]


def parts(axis, simulated):
    """Four parts of 6.2 s, mm and mm/s."""
    time, position, v, a, force = axis
    low_pass = butter(4, 40 / 500)
    columns = {"pos_x": 1e3 * position, "v_x": 1e3 * v, "a_x": 1e3 * a, "curr_x": force, "curr_x_sim": simulated}
    columns = {name: filtfilt(*low_pass, values)[::10] for name, values in columns.items()}
    time = time[::10]
    for k, rows in enumerate(np.array_split(np.arange(len(time)), 4)):
        own = {name: values[rows] for name, values in columns.items()}
        info = PartInfo(part=f"p{k}", machine="emps", order=k + 1, start_time_s=float(time[rows[0]]))
        yield Recording(info, {"time": time[rows] - time[rows[0]], **own})


@pytest.mark.slow
@pytest.mark.real
def test_friction_that_differs_between_directions_is_what_the_published_model_lacks_first(axis):
    _, _, v, a, _ = axis
    result = diagnose(list(parts(axis, M * a + FV * v + FC * np.sign(v) + OFFSET)))
    first = result.findings[0]
    assert first.mechanism == "friction_asymmetry"
    assert first.fit.rmse_after < 0.8 * first.fit.rmse_before
    assert first.fit.p_value < 0.01


@pytest.mark.slow
@pytest.mark.real
def test_friction_that_is_withheld_comes_back_with_its_published_constants(axis):
    _, _, _, a, _ = axis
    result = diagnose(list(parts(axis, M * a + OFFSET)))
    found = {f.mechanism: f for f in result.findings}
    assert {f.mechanism for f in result.findings[:2]} == {"coulomb_friction", "viscous_friction"}
    assert found["coulomb_friction"].parameters["F_c"].value == pytest.approx(FC, rel=0.02)
    assert found["viscous_friction"].parameters["F_v"].value == pytest.approx(FV / 1000, rel=0.02)  # N per mm/s
