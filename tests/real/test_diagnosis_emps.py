"""EMPS, a servo axis with known constants: what its published model leaves out, and friction withheld altogether."""

from pathlib import Path

import pytest

from pido.diagnosis.diagnose import diagnose
from pido.experiments.real_mismatch import PUBLISHED, emps_motions


@pytest.fixture(scope="module")
def file(real_data) -> Path:
    path = real_data / "emps" / "DATA_EMPS.mat"
    if not path.is_file():
        pytest.skip(f"EMPS is not at {path}")
    return path


@pytest.mark.slow
@pytest.mark.real
def test_friction_that_differs_between_directions_is_what_the_published_model_lacks_first(file):
    first = diagnose(list(emps_motions(file, friction=True))).findings[0]
    assert first.mechanism == "friction_asymmetry"
    assert first.fit.rmse_after < 0.85 * first.fit.rmse_before
    assert first.fit.p_value < 0.01


@pytest.fixture(scope="module")
def withheld(file) -> dict[str, float]:
    """Constants of the two findings named first where the simulation has no friction, of the published ones."""
    findings = diagnose(list(emps_motions(file, friction=False))).findings[:2]
    found = {f.mechanism: f.parameters for f in findings}
    return {
        "F_c": found["coulomb_friction"]["F_c"].value / PUBLISHED["F_c"],
        "F_v": found["viscous_friction"]["F_v"].value / PUBLISHED["F_v"] * 1000,  # N per mm/s
    }


@pytest.mark.slow
@pytest.mark.real
def test_friction_that_is_withheld_is_what_is_named_first_with_its_published_constants_within_two_percent(withheld):
    assert withheld == pytest.approx({"F_c": 1.0, "F_v": 1.0}, rel=0.02)
