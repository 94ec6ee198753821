"""A share of the simulated current that is missing in a box only: no name of the catalogue says it."""

import numpy as np
import pytest

from pido.diagnosis.formulas import factor_on_current
from pido.diagnosis.library import Library, basis
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.regions import best_region
from pido.diagnosis.select import grid_terms
from tests.diagnosis.planted import planted

NAMES = ("viscous_friction", "coulomb_friction", "inertia")


def simulated(k, recording):
    current = 0.5 * np.sign(recording["v_x"]) + 0.1 * recording["v_x"] + 0.01 * recording["a_x"]
    return type(recording)(recording.part, {**recording.columns, "curr_x_sim": current})


def test_it_is_found_with_its_limit():
    library, noise = planted(lambda s: s.sim * (s.others["y"].v > 3.0), change=simulated)
    terms = [t for m in CATALOGUE if m.id in NAMES for t in grid_terms(m, library.mismatch.states, m.id)]
    library = Library(library.mismatch, terms)
    library.whiten(noise)
    found = best_region(library, basis(library, noise, []))
    assert found is not None
    assert found.term.mechanism == factor_on_current("x")
    (gate,) = found.term.gates
    assert (gate.variable, gate.high) == ("v_y", np.inf)
    assert gate.low == pytest.approx(3.0, abs=0.3)
