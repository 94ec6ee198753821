"""A coefficient that the simulation has wrong: what it has to be multiplied by, where that can be said."""

import json

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnoses import diagnose_into, summary
from pido.diagnosis.diagnose import diagnose
from pido.reports.diagnosis import diagnosis_page

NOISE = 0.03


def recordings(inertia):
    """x goes to and fro; the simulation has so much of the true inertia, and friction that is right."""
    for k in range(3):
        rng = np.random.default_rng(k)
        t = np.arange(1500) * 0.02
        v = np.convolve(np.repeat(rng.uniform(-12, 12, 60), 25), np.ones(15) / 15, "same")
        a = np.gradient(v, t)
        rest = 0.4 * np.sign(v) + 0.01 * v
        columns = {
            "time": t, "pos_x": np.cumsum(v) * 0.02, "v_x": v, "a_x": a,
            "curr_x_sim": rest + inertia * 0.01 * a, "curr_x": rest + 0.01 * a + rng.normal(0, NOISE, len(t)),
        }  # fmt: skip
        yield Recording(PartInfo(part=f"p{k}", machine="m", order=k + 1), columns)


@pytest.mark.parametrize("simulated", [0.6, 1.6])
def test_a_wrong_coefficient_is_said_with_what_it_has_to_be_multiplied_by(simulated, tmp_path):
    parts = list(recordings(simulated))
    found = diagnose_into(tmp_path, parts)
    (finding,) = found.findings
    assert finding.mechanism == "miscalibrated:inertia"
    low, high = finding.factor.ci95
    assert low < 1 / simulated < high
    assert high - low < 0.1
    assert f"multiply the simulation's coefficient by {finding.factor.value:.3g}" in summary(found)[0]
    (section,) = [s for s in diagnosis_page(found, parts).sections if "inertia" in s.title]
    assert any("multiply that by" in line for line in section.text)
    details = json.loads((tmp_path / "details.json").read_text(encoding="utf-8"))
    assert details["findings"][0]["factor"]["value"] == finding.factor.value


def test_what_the_simulation_does_not_have_has_no_factor(tmp_path):
    found = diagnose_into(tmp_path, list(recordings(0.0)))
    (finding,) = found.findings
    assert (finding.mechanism, finding.factor) == ("inertia", None)


@pytest.mark.parametrize(("share", "found"), [(0.02, False), (0.15, True)])
def test_a_coefficient_that_is_off_by_far_less_than_the_noise_is_no_finding(share, found):
    """No simulation is exact: 2 % of this friction is a quarter of the noise."""
    parts = []
    for part in recordings(1.0):
        friction = 0.4 * np.sign(part["v_x"])
        parts.append(Recording(part.part, {**part.columns, "curr_x_sim": part["curr_x_sim"] - share * friction}))
    assert bool(diagnose(parts).findings) == found
