"""What acts in a rectangle of two places, whatever else is cut or moved: located there, without a name."""

from __future__ import annotations

import re

import numpy as np
import pytest

from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.diagnosis.correct import correct
from pido.diagnosis.diagnose import diagnose
from pido.diagnosis.models import axis_models
from pido.diagnosis.patches import Patch

STEP, ROWS = 0.05, 3000
X, Y = (130.0, 190.0), (45.0, 95.0)


def part(number, law):
    """Points at random in a travel of 300 by 200 mm, at 20 to 60 mm/s; `law` is what acts inside the rectangle."""
    rng, t = np.random.default_rng(40 + number), np.arange(ROWS) * STEP
    points, when = [rng.uniform((0, 0), (300, 200))], [0.0]
    while when[-1] < t[-1]:
        points.append(rng.uniform((0, 0), (300, 200)))
        way = float(np.linalg.norm(points[-1] - points[-2]))
        when += [when[-1] + way / rng.uniform(20, 60)]
    smooth = np.ones(7) / 7
    x, y = (np.convolve(np.interp(t, when, p), smooth, "same") for p in np.transpose(points))
    v_x, v_y = np.gradient(x, t), np.gradient(y, t)
    inside = (x > X[0]) & (x < X[1]) & (y > Y[0]) & (y < Y[1])
    effect = np.where(inside, law(v_y), 0.0)
    columns = {"time": t, "pos_x": x, "pos_y": y, "v_x": v_x, "v_y": v_y}
    columns |= {"a_x": np.gradient(v_x, t), "a_y": np.gradient(v_y, t)}
    columns |= {"curr_x_sim": 0.02 * v_x, "curr_x": 0.02 * v_x + rng.normal(0, 0.05, ROWS)}
    columns |= {"curr_y_sim": 0.03 * v_y, "curr_y": 0.03 * v_y + effect + rng.normal(0, 0.05, ROWS)}
    return Recording(PartInfo(part=f"p{number}", machine="m", order=number + 1), columns), effect


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("law", "signal", "everywhere"),
    [
        (lambda v: 0.12 * np.sign(v), "v_y", "coulomb_friction"),
        (lambda v: np.full(len(v), 0.12), "", "gravity_load"),
    ],
    ids=["friction", "load"],
)
def test_a_law_in_a_rectangle_of_the_table_is_unknown_there_and_taken_away_from_an_unseen_part(law, signal, everywhere):
    made = [part(k, law) for k in range(5)]
    found = diagnose([r for r, _ in made[:-1]])
    [one] = found.findings
    assert (one.axis, one.mechanism) == ("y", "unknown")
    assert one.alternatives[0].mechanism == everywhere
    assert one.parameters["k"].value == pytest.approx(0.12, rel=0.15)
    for name, edge in zip(("from_1", "to_1", "from_2", "to_2"), (*X, *Y), strict=True):
        assert one.parameters[name].value == pytest.approx(edge, abs=4.0)
    assert re.search(
        r"within the position of the x axis from 1[23]\d(\.\d)? to 1[89]\d(\.\d)? mm and", one.where.summary
    )
    [term] = axis_models(found.model)["y"].terms
    assert isinstance(term.mechanism, Patch)
    assert term.mechanism.signal == signal
    recording, effect = made[-1]
    mismatch = correct(found.model, recording).mismatch["y"]
    assert np.mean((mismatch - effect) ** 2) < 0.2 * np.mean(effect**2)
    assert not np.any(correct(found.model, recording).mismatch["x"])


@pytest.mark.parametrize(
    ("axis", "signal", "form", "everywhere"),
    [
        ("y", "v_y", "sgn u", "coulomb_friction"),
        ("y", "held_y", "u", "coulomb_friction"),
        ("y", "v_y", "u", "viscous_friction"),
        ("sp", "v_sp", "u", "spindle_viscous_drag"),
        ("sp", "M_sp", "u", "spindle_torque_load"),
        ("y", "v_x", "u", ""),
    ],
)
def test_a_law_in_a_rectangle_knows_the_mechanism_that_it_would_be_everywhere(axis, signal, form, everywhere):
    assert Patch(("pos_x", "pos_y"), signal, "mm/s", form).without_limits(axis) == everywhere


@pytest.mark.thorough
def test_nothing_is_found_where_nothing_acts():
    assert not diagnose([part(k, lambda v: 0.0 * v)[0] for k in range(4)]).findings
