"""A drift that goes back in the pauses between parts, as fast as it came or more slowly."""

from __future__ import annotations

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.correct import correct
from pido.diagnosis.diagnose import diagnose

STEP, ROWS = 0.05, 2400
PAUSES = (0.0, 60.0, 300.0, 30.0, 600.0, 120.0, 45.0, 1500.0)


def warmth(tau, cools):
    """Integrated over the machine's clock, per part: (start, warmth of its rows)."""
    warm, clock = 0.0, 0.0
    for pause in PAUSES:
        clock += pause
        warm *= np.exp(-pause / (cools * tau))
        t = np.arange(ROWS) * STEP
        rows = 1 - (1 - warm) * np.exp(-t / tau)
        yield clock, rows
        warm, clock = float(rows[-1]), clock + ROWS * STEP


def parts(tau, cools, noise=0.04):
    made, effects = [], []
    for k, (start, warm) in enumerate(warmth(tau, cools)):
        rng, t = np.random.default_rng(90 + k), np.arange(ROWS) * STEP
        v = np.convolve(np.repeat(rng.choice([-12.0, -5.0, 5.0, 12.0], ROWS // 40), 40), np.ones(9) / 9, "same")
        effect = 0.3 * (1 - warm)
        columns = {"time": t, "pos_x": np.cumsum(v) * STEP, "v_x": v, "a_x": np.gradient(v, t), "curr_x_sim": 0.03 * v}
        columns["curr_x"] = columns["curr_x_sim"] + effect + rng.normal(0, noise, ROWS)
        made.append(Recording(PartInfo(part=f"p{k}", machine="m", order=k + 1, start_time_s=start), columns))
        effects.append(effect)
    return made, effects


@pytest.mark.thorough
@pytest.mark.parametrize(("tau", "cools"), [(150.0, 2.5), (240.0, 0.5)])
def test_what_cools_otherwise_than_it_warms_says_so_and_is_right_after_a_longer_pause(tau, cools):
    made, effects = parts(tau, cools)
    found = diagnose(made[:-1])
    assert [f.mechanism for f in found.findings] == ["thermal_drift"]
    [drift] = found.findings
    assert drift.parameters["tau"].value == pytest.approx(tau, rel=0.1)
    assert drift.parameters["cools"].value == pytest.approx(cools, rel=0.15)
    low, high = drift.parameters["cools"].ci95
    assert low <= cools <= high < 2 * low
    assert "cool with cools * tau" in drift.equation
    mismatch = correct(found.model, made[-1]).mismatch["x"]
    assert np.mean((mismatch - effects[-1]) ** 2) < 0.02 * np.mean(effects[-1] ** 2)


@pytest.mark.thorough
def test_what_cools_as_it_warms_has_no_second_time_constant():
    made, effects = parts(150.0, 1.0)
    found = diagnose(made[:-1])
    [drift] = found.findings
    assert drift.mechanism == "thermal_drift"
    assert drift.parameters["tau"].value == pytest.approx(150.0, rel=0.1)
    assert "cools" not in drift.parameters
    assert "cool with" not in drift.equation
    mismatch = correct(found.model, made[-1]).mismatch["x"]
    assert np.mean((mismatch - effects[-1]) ** 2) < 0.02 * np.mean(effects[-1] ** 2)
