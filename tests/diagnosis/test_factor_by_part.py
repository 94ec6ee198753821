"""A wrong coefficient that is wrong by another factor in every part, and one that is wrong by the same in all."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnoses import diagnose_into, summary
from pido.diagnosis.by_part import by_part
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from pido.diagnosis.whiten import Noise
from pido.reports.diagnosis import diagnosis_page

INERTIA, COULOMB = (next(m for m in CATALOGUE if m.id == name) for name in ("inertia", "coulomb_friction"))
M = 0.01  # A/(mm/s²), in the simulation
NOISE = 0.03


def part(k, rng, rows=1500, factor=1.0, noise=NOISE):
    t = np.arange(rows) * 0.02
    v = np.convolve(np.repeat(rng.uniform(-12, 12, rows // 25), 25), np.ones(15) / 15, "same")
    a = np.gradient(v, t)
    rest = 0.4 * np.sign(v) + 0.01 * v
    # Louder where it moves fast: the errors of the amplitudes have to know.
    loud = noise * (1 + np.abs(v) / 6)
    columns = {
        "time": t, "pos_x": np.cumsum(v) * 0.02, "v_x": v, "a_x": a,
        "curr_x_sim": rest + M * a, "curr_x": rest + factor * M * a + loud * rng.normal(size=rows),
    }  # fmt: skip
    return Recording(PartInfo(part=f"p{k}", machine="m", order=k + 1), columns)


def found(factors, seed=0, rows=1500):
    """The factor part by part, beside a friction that is in the fit, too."""
    rng = np.random.default_rng(seed)
    parts = [part(k, rng, rows, f) for k, f in enumerate(factors)]
    states = axis_states(parts, "x")
    mismatch = lay_out(states, [p["curr_x"] - p["curr_x_sim"] for p in parts])
    noise = Noise(np.zeros(0), np.full(mismatch.n, NOISE), 1.0, mismatch.usable)
    terms = [Term(COULOMB, (("rest", 0.0), ("v_0", 0.1))), replace(Term(INERTIA), name="miscalibrated:inertia")]
    mean = float(np.mean(factors))
    return by_part(mismatch, noise, terms, 1, (mean - 1) * M, mean)


FACTORS = [1.05, 1.3, 1.12, 1.4, 1.2, 1.35]


def test_the_factor_of_each_part_is_its_own_and_they_are_said_to_differ():
    own = found(FACTORS)
    assert own.differs
    for estimate, truth in zip(own.factors.values(), FACTORS, strict=True):
        assert estimate.value == pytest.approx(truth, abs=0.03)
    assert own.spread == pytest.approx(np.std(FACTORS, ddof=1), rel=0.25)


@pytest.mark.parametrize("factor", [1.25, 1.03, 0.8])
def test_parts_that_are_alike_are_not_said_to_differ_and_p_is_uniform(factor):
    every = [found([factor] * 6, seed, rows=800) for seed in range(60)]
    assert not any(one.differs for one in every)
    p = np.array([one.p_value for one in every])
    assert 0.25 < np.mean(p < 0.5) < 0.75
    assert np.mean(p < 0.05) < 0.15
    covered = [e.ci95[0] < factor < e.ci95[1] for one in every for e in one.factors.values()]
    assert np.mean(covered) > 0.9


def test_two_parts_do_not_tell():
    assert found(FACTORS[:2]) is None


@pytest.mark.thorough
@pytest.mark.parametrize(("factors", "differ"), [(FACTORS, True), ([1.24] * 6, False)])
def test_a_reader_is_sent_to_what_differs_between_the_parts(factors, differ, tmp_path):
    rng = np.random.default_rng(1)
    parts = [part(k, rng, factor=f) for k, f in enumerate(factors)]
    diagnosis = diagnose_into(tmp_path, parts)
    (finding,) = diagnosis.findings
    assert finding.mechanism == "miscalibrated:inertia"
    (section,) = [s for s in diagnosis_page(diagnosis, parts).sections if "inertia" in s.title]
    for text in (" ".join(section.text), finding.where.summary, summary(diagnosis)[0]):
        assert ("differs from part to part" in text) == differ
    detail = json.loads((tmp_path / "details.json").read_text(encoding="utf-8"))["findings"][0]["factor_by_part"]
    assert detail["differs"] == differ
    for estimate, truth in zip(detail["parts"].values(), factors, strict=True):
        assert estimate["value"] == pytest.approx(truth, abs=0.04)
