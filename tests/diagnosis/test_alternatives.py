"""What else a finding could be, and what is no other explanation of it."""

from dataclasses import replace

import numpy as np

from pido.diagnosis.answers import alternatives_of
from pido.diagnosis.identify import Rival
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mismatch import lay_out
from pido.diagnosis.search import first_look
from pido.diagnosis.state import axis_states
from pido.diagnosis.terms import Term
from tests.diagnosis.planted import NOISE, part

BY_ID = {m.id: m for m in CATALOGUE}


def test_what_says_the_same_law_in_more_words_is_the_last_of_its_alternatives():
    coulomb, inertia, drift, coupling = (
        Term(BY_ID[i]) for i in ("coulomb_friction", "inertia", "thermal_drift", "axis_coupling")
    )
    rivals = [Rival("thermal_drift", 21.0, 1.0, drift), Rival("axis_coupling", 112.0, 0.95, coupling)]
    assert [a.mechanism for a in alternatives_of(coulomb, rivals)] == ["axis_coupling", "thermal_drift"]
    assert [a.mechanism for a in alternatives_of(inertia, rivals)] == ["thermal_drift", "axis_coupling"]


def test_what_a_law_becomes_is_in_the_catalogue():
    assert {i for m in CATALOGUE for i in m.becomes} <= set(BY_ID)


def test_below_the_limit_of_a_sensor_no_drive_is_said_to_saturate():
    states = [replace(s, sim=0.5 * np.sign(s.v) + 0.05 * s.v) for s in axis_states([part(k) for k in range(3)], "x")]
    rng = np.random.default_rng(0)
    mismatch = lay_out(states, [0.1 * s.v + rng.normal(0, NOISE, len(s.v)) for s in states])
    offered = {}
    for clipped in (False, True):
        look = first_look(mismatch, rng, clipped)
        offered[clipped] = {t.mechanism.id for t in look.offered}
        refused = "ends at a limit" in " ".join(r.reason for r in look.rejected if r.mechanism == "current_saturation")
        assert refused is clipped
    assert offered[False] - offered[True] == {"current_saturation"}
