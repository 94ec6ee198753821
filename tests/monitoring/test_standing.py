"""A standing axis: every current that friction can hold is expected, and nothing beyond."""

import numpy as np
import pytest

from pido.config import machine
from pido.core.axes import AXES
from pido.core.columns import INPUTS
from pido.models.inputs import NAMES
from pido.monitoring.standing import explained, other_end

MILL = machine("cmx600v")
FRICTION = 0.4
OFFSET = 0.1
COLUMNS = NAMES["extended"]


def _rows(n: int, **values: float) -> np.ndarray:
    rows = np.zeros((n, len(COLUMNS)))
    for name, value in values.items():
        rows[:, COLUMNS.index(name)] = value
    return rows


def _friction(axis: str):
    return lambda rows: OFFSET + FRICTION * rows[:, COLUMNS.index(f"direction_{axis}")]


PREDICT = {axis: _friction(axis) for axis in AXES}


@pytest.mark.parametrize("direction", [-1.0, 1.0])
@pytest.mark.parametrize(("current", "beyond"), [(0.5, 0.0), (-0.3, 0.0), (0.1, 0.0), (0.7, 0.2), (-0.6, -0.3)])
def test_a_standing_axis_deviates_by_what_lies_beyond_the_friction_of_either_direction(direction, current, beyond):
    rows = _rows(3, direction_x=direction, direction_y=1.0, v_y=20.0)
    said = np.column_stack([predict(rows) for predict in PREDICT.values()])
    recorded = np.full((3, 4), current)
    residual = recorded - explained(said, other_end(PREDICT, rows, MILL), recorded)
    np.testing.assert_allclose(residual[:, 0], beyond, atol=1e-12)
    np.testing.assert_allclose(residual[:, 1], current - (OFFSET + FRICTION), atol=1e-12)  # it moves


def test_what_is_expected_of_a_standing_axis_does_not_hang_on_the_direction_that_was_read():
    recorded = np.linspace(-1, 1, 9)[:, None] * np.ones(4)
    found = []
    for direction in (-1.0, 1.0):
        rows = _rows(9, direction_z=direction)
        said = np.column_stack([predict(rows) for predict in PREDICT.values()])
        found.append(recorded - explained(said, other_end(PREDICT, rows, MILL), recorded))
    np.testing.assert_array_equal(found[0][:, 2], found[1][:, 2])


def test_an_unknown_direction_a_spindle_and_the_inputs_of_the_paper_leave_what_is_said():
    assert np.isnan(other_end(PREDICT, _rows(2), MILL)).all()
    assert np.isnan(other_end(PREDICT, _rows(2, direction_sp=1.0), MILL)).all()
    assert np.isnan(other_end(PREDICT, np.zeros((2, len(INPUTS))), MILL)).all()


def test_a_missing_input_and_a_missing_current_stay_missing():
    rows = _rows(2, direction_x=1.0)
    rows[0, 0] = np.nan
    assert np.isnan(other_end(PREDICT, rows, MILL)[0]).all()
    said, recorded = np.full((1, 4), 0.5), np.full((1, 4), np.nan)
    np.testing.assert_array_equal(explained(said, -said, recorded), said)
