"""A current in coarse steps: what rounding leaves of its mean is no physics, and is not found as some."""

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.diagnose import diagnose
from pido.diagnosis.rounding import Rounding, rounding_of

STEP, NOISE = 0.2, 0.05  # A


def part(k, effect=0.0, step=STEP, feeds=(0.0, 2.0, 3.5, 5.0, 7.0, 9.0, 12.0)):
    """An axis that moves at some feeds, to and fro, and stands; each has a level of its own, between two steps."""
    rng = np.random.default_rng(k)
    n = 4000
    v = np.repeat(rng.choice(feeds, n // 100) * rng.choice([-1, 1], n // 100), 100)
    time = 0.02 * np.arange(n)
    simulated = 0.37 * np.sign(v) + 0.051 * v - 0.95
    current = simulated + effect * v + rng.normal(0, NOISE, n)
    columns = {"time": time, "v_x": v, "pos_x": np.cumsum(v) * 0.02, "a_x": np.gradient(v, time)}
    columns |= {"curr_x_sim": simulated, "curr_x": step * np.round(current / step) if step else current}
    return Recording(PartInfo(part=f"p{k}", machine="m", order=k + 1), columns)


@pytest.mark.parametrize("noise", [0.02, 0.05, 0.08])
def test_the_mean_of_a_rounded_signal_is_as_far_off_as_said(noise):
    rng = np.random.default_rng(0)
    for level in (0.03, 0.07, 0.1, 0.16):
        read = STEP * np.round((level + rng.normal(0, noise, 200_000)) / STEP)
        bias = Rounding(STEP, noise, 0.0).bias(np.array([level]))[0]
        assert bias == pytest.approx(np.mean(read) - level, abs=0.003)


def test_steps_and_noise_are_read_from_the_recordings():
    found = rounding_of([part(k) for k in range(3)], "x")
    assert found is not None
    assert found.step == pytest.approx(STEP)
    assert found.noise == pytest.approx(NOISE, abs=0.01)


@pytest.mark.parametrize("step", [0.0, 0.01])
def test_fine_steps_leave_nothing(step):
    assert rounding_of([part(k, step=step) for k in range(3)], "x") is None


@pytest.mark.parametrize("noise", [0.7, 2.0])
def test_a_mismatch_at_few_levels_is_no_rounding_where_noise_evens_the_steps_out(noise):
    parts = [part(k, effect=0.01, step=NOISE / noise, feeds=(1.0, 3.0)) for k in range(3)]
    assert rounding_of(parts, "x") is None


def test_beside_a_mismatch_of_a_step_and_more_it_is_not_known_what_rounding_leaves():
    assert rounding_of([part(k, effect=0.05) for k in range(3)], "x") is None


def test_what_rounding_leaves_is_no_finding():
    diagnosis = diagnose([part(k, feeds=(0.0, 4.0, 9.0)) for k in range(4)])
    assert [f.mechanism for f in diagnosis.findings] == []
    assert any("in steps of 0.2 A" in note for note in diagnosis.notes)


@pytest.mark.thorough
def test_an_effect_beside_it_is_found_with_its_size():
    diagnosis = diagnose([part(k, effect=0.02) for k in range(4)])
    (finding,) = diagnosis.findings
    assert finding.mechanism.removeprefix("miscalibrated:") == "viscous_friction"


@pytest.mark.thorough
def test_what_is_said_of_the_steps_of_a_pair_is_in_its_own_words():
    parts = [part(k, feeds=(0.0, 4.0, 9.0)) for k in range(4)]
    forces = [Recording(p.part, {n.replace("curr_x", "f_x"): v for n, v in p.columns.items()}) for p in parts]
    diagnosis = diagnose(forces, pair="f_x:f_x_sim")
    assert any("f_x is in steps of 0.2 N" in note for note in diagnosis.notes), diagnosis.notes
