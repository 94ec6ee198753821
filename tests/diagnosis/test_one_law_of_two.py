"""A friction that another quantity changes is one law, however its parts could be named."""

import numpy as np
import pytest

from pido.diagnosis.arms import Arm
from pido.diagnosis.late import Modulated
from pido.diagnosis.terms import Term
from pido.diagnosis.unnamed import with_unknown
from pido.physics.drive import answered_late
from tests.diagnosis.planted import VISCOUS, found_in, planted

TAU = 4.0  # s, by which a slide feels its load


def test_what_is_a_name_and_its_product_with_a_quantity_is_one_law_without_a_name():
    library, noise = planted(lambda s: s.v * (1.0 + 0.02 * s.places["y"]), strength=4.0)
    (law,), _ = with_unknown(library, noise, [Term(VISCOUS)], 0)
    assert isinstance(law.mechanism, Arm)
    assert law.mechanism.reads == {"v_x", "pos_y"}


def test_a_viscous_friction_alone_keeps_its_name():
    library, noise = planted(lambda s: s.v, strength=4.0)
    (law,), _ = with_unknown(library, noise, [Term(VISCOUS)], 0)
    assert law.name == "viscous_friction"


def test_friction_that_a_load_along_another_axis_has_changed_lately():
    def loaded(k, recording):
        rests = np.tile([0, 1], len(recording) // 600)
        phases = rests * np.random.default_rng(k).uniform(0, 900, len(recording) // 300)
        return recording.with_columns(f_y_sim=np.repeat(phases, 300))

    def drag(state):
        return state.v * (1.0 - answered_late(state.forces["y"][None], state.time, TAU)[0] / 300)

    term = found_in(drag, strength=4.0, change=loaded)
    assert isinstance(term.mechanism, Modulated)
    assert (term.mechanism.signal, term.mechanism.cause) == ("v_x", "f_y")
    assert dict(term.shape)["tau"] == pytest.approx(TAU, rel=0.15)
