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


@pytest.mark.slow
@pytest.mark.real
def test_friction_that_is_withheld_comes_back_with_its_published_constants(file):
    findings = diagnose(list(emps_motions(file, friction=False))).findings
    found = {f.mechanism: f.parameters for f in findings}
    assert {f.mechanism for f in findings[:2]} == {"coulomb_friction", "viscous_friction"}
    assert found["coulomb_friction"]["F_c"].value == pytest.approx(PUBLISHED["F_c"], rel=0.02)
    assert found["viscous_friction"]["F_v"].value == pytest.approx(PUBLISHED["F_v"] / 1000, rel=0.02)  # N per mm/s
