"""A friction along the travel that has no whole wave on it is told by a slope and a bend."""

import numpy as np
import pytest

from pido.diagnosis.forms import plainest
from pido.diagnosis.library import Library
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.terms import Term
from tests.diagnosis.planted import planted

ALONG = next(m for m in CATALOGUE if m.id == "position_dependent_friction")


def wave(length):
    return Term(ALONG, (("form", 0.0), ("L", length), ("p_0", 0.0), ("rest", 0.0), ("v_0", 0.1)))


def asked(length, effect):
    library, noise = planted(effect)
    library = Library(library.mismatch, [wave(length)])
    library.whiten(noise)
    (out,) = plainest(library, noise, [wave(length)])
    travel = np.concatenate([s.pos for s in library.mismatch.states if s.pos is not None])
    return dict(out.shape), travel


def test_a_part_of_a_wave_is_a_slope_and_a_bend():
    shape, travel = asked(900.0, lambda s: (0.3 + 0.1 * s.pos) * np.sign(s.v))
    assert shape["form"] == 1.0
    assert shape["p_0"] == pytest.approx((travel.min() + travel.max()) / 2, abs=0.1 * np.ptp(travel))
    assert np.ptp(travel) / 2 >= shape["L"] > np.ptp(travel) / 3


def test_a_wave_of_which_more_than_one_is_seen_stays_a_wave():
    shape, travel = asked(9.0, lambda s: np.sin(2 * np.pi * s.pos / 9.0) * np.sign(s.v))
    assert np.ptp(travel) > 9.0
    assert (shape["form"], shape["L"]) == (0.0, 9.0)


def test_a_long_wave_that_bends_more_than_once_stays_a_wave():
    _, travel = asked(900.0, lambda s: s.v)
    length = 1.05 * float(np.ptp(travel))
    shape, _ = asked(length, lambda s: np.sin(2 * np.pi * s.pos / length) * np.sign(s.v))
    assert shape["form"] == 0.0
