"""A force that comes on again and again is one law of the clock, and says when it comes in another part."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from pido.core.errors import DiagnosisError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.correct import correct, not_applied
from pido.diagnosis.diagnose import diagnose
from pido.diagnosis.events import ExternalForce
from pido.diagnosis.pulses import Pulses, repeating
from pido.diagnosis.terms import Term
from tests.diagnosis.feeds import NOISE, laid_out, recordings

EVERY, FOR, SINCE, FORCE = 13.7, 3.0, 4.0, 0.15


def on(clock):
    return ((clock - SINCE) % EVERY < FOR).astype(float)


def intervals(mismatch):
    """Of the pulses, those that lie in a part as a whole, two samples too long."""
    found = []
    for state in mismatch.states:
        assert state.clock is not None
        edges = np.flatnonzero(np.diff(on(state.clock)))
        found += [(state.part, state.time[i] - 0.04, state.time[j] + 0.04) for i, j in pairwise(edges)]
    return ExternalForce(tuple(e for e in found if e[2] - e[1] < FOR + 0.2))


def parts(count) -> list[Recording]:
    rng = np.random.default_rng(9)
    out = []
    for r in recordings(count):
        clock = (r.part.start_time_s or 0.0) + r.time
        columns = {k: v for k, v in r.columns.items() if "_sp" not in k}
        seen = r["curr_x_sim"] + FORCE * on(clock) + rng.normal(0, NOISE, len(r))
        out.append(Recording(r.part, columns | {"curr_x": seen}))
    return out


def test_pulses_have_their_period_ends_and_phase_on_the_machines_clock():
    mismatch, noise = laid_out(lambda s: FORCE * on(s.clock))
    (term,) = repeating(mismatch, noise, [Term(intervals(mismatch))])
    assert isinstance(term.mechanism, Pulses)
    assert term.mechanism.clock
    assert 5 < term.mechanism.cycles < 20
    shape = dict(term.shape)
    assert shape["T"] == pytest.approx(EVERY, abs=5e-3)
    assert shape["w"] == pytest.approx(FOR, abs=0.03)
    begin = (term.mechanism.origin + shape["t_0"] - SINCE + EVERY / 2) % EVERY - EVERY / 2
    assert begin == pytest.approx(0.0, abs=0.03)


def test_pulses_that_each_part_starts_anew_are_on_its_own_time():
    mismatch, noise = laid_out(lambda s: FORCE * on(s.time))
    found = [(s.part, SINCE + k * EVERY, SINCE + k * EVERY + FOR) for s in mismatch.states for k in (0, 1)]
    (term,) = repeating(mismatch, noise, [Term(ExternalForce(tuple(found)))])
    assert isinstance(term.mechanism, Pulses)
    assert not term.mechanism.clock
    assert dict(term.shape)["T"] == pytest.approx(EVERY, abs=0.02)


@pytest.mark.thorough
def test_what_comes_again_is_told_proved_by_parts_and_foretold():
    *made, another = parts(5)
    found = diagnose(made)
    (force,) = found.findings
    assert (force.mechanism, force.fit.scheme) == ("external_force", "leave-one-part-out")
    assert force.said == "a force that comes on every 13.7 s for 3 s"
    assert force.parameters["T"].value == pytest.approx(EVERY, abs=2e-3)
    for name, truth in (("F", FORCE), ("w", FOR)):
        low, high = force.parameters[name].ci95
        assert low <= truth <= high
    assert not force.of_its_parts_only
    assert not_applied(found.model, another) == []
    left = another["curr_x"] - correct(found.model, another).corrected["x"]
    assert np.std(left) < 1.2 * NOISE
    # On which part of the clock a part was made decides, and has to be known.
    nowhere = replace(another, part=PartInfo(part="p9", machine="m"))
    with pytest.raises(DiagnosisError, match="start_time_s"):
        correct(found.model, nowhere)


@pytest.mark.thorough
def test_forces_at_no_rhythm_stay_intervals():
    rng = np.random.default_rng(1)
    begins = {f"p{k}": np.sort(rng.uniform(0, 37, 3)) for k in range(3)}

    def effect(r):
        return FORCE * np.any([(r.time >= b) & (r.time < b + 2.0) for b in begins[r.part.part]], axis=0)

    made = []
    for r in recordings():
        columns = {k: v for k, v in r.columns.items() if "_sp" not in k}
        seen = r["curr_x_sim"] + effect(r) + rng.normal(0, NOISE, len(r))
        made.append(Recording(r.part, columns | {"curr_x": seen}))
    (force,) = diagnose(made).findings
    assert force.mechanism == "external_force"
    assert force.of_its_parts_only
