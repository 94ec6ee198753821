"""A wave along the travel, of which a drive and a sample pass less where the axis is fast, is one wave."""

from dataclasses import replace

import numpy as np
import pytest

from pido.diagnosis.gates import Gate
from pido.diagnosis.misfit import useless
from pido.diagnosis.select import grid_terms
from tests.diagnosis.feeds import BY_ID
from tests.diagnosis.to_and_fro import laid_out, library_of


def wave(mismatch, name, length, *gates):
    term = grid_terms(BY_ID[name], mismatch.states)[0].with_shape(L=length)
    return replace(term, gates=gates)


def ripple(state, length, share=1.0):
    return 0.3 * np.where(np.abs(state.v) > 6, share, 1.0) * np.sin(2 * np.pi * state.pos / length)


@pytest.mark.parametrize("variable", ["|v_x|", "v_x", "path speed"])
def test_what_a_fast_axis_shows_less_of_is_no_second_wave(variable):
    mismatch, noise = laid_out(lambda s: ripple(s, 5.0, 0.6))
    fast = wave(mismatch, "torque_ripple", 5.01, Gate(variable, low=6.0))
    library = library_of(mismatch, noise, wave(mismatch, "torque_ripple", 5.0), fast)
    which, reason = useless(library, noise, list(library.terms))
    assert which == 1
    assert "the same wave" in reason


def test_a_wave_of_another_length_and_one_of_all_speeds_are_waves_of_their_own():
    mismatch, noise = laid_out(lambda s: ripple(s, 5.0) + ripple(s, 3.1, 0.0) + 0.2 * np.sign(s.v) * ripple(s, 5.0))
    other = wave(mismatch, "torque_ripple", 3.1, Gate("|v_x|", high=6.0))
    friction = wave(mismatch, "position_dependent_friction", 5.0)
    library = library_of(mismatch, noise, wave(mismatch, "torque_ripple", 5.0), other, friction)
    assert useless(library, noise, list(library.terms))[1] is None
