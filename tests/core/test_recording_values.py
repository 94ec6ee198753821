import numpy as np
import pytest
from pydantic import ValidationError

from pido.core.errors import RecordingError
from pido.core.part import PartInfo
from pido.core.recording import Recording

PART = PartInfo(part="p01", machine="m")


def test_a_recording_needs_time_and_columns_of_one_length():
    with pytest.raises(RecordingError, match="'time' is missing"):
        Recording(PART, {"curr_x": np.zeros(3)})
    with pytest.raises(RecordingError, match="different lengths"):
        Recording(PART, {"time": np.arange(3.0), "curr_x": np.zeros(4)})


def test_a_missing_column_is_named_with_those_that_are_there():
    with pytest.raises(RecordingError, match=r"p01.*'v_x' is missing.*curr_x"):
        Recording(PART, {"time": np.arange(3.0), "curr_x": np.zeros(3)})["v_x"]


def test_changes_make_a_new_recording_and_leave_the_old_one():
    old = Recording(PART, {"time": np.arange(4) / 50, "curr_x": np.zeros(4)})
    new = old.with_columns(curr_x=np.ones(4)).rows(np.array([True, False, True, True]))
    assert len(old) == 4
    assert len(new) == 3
    assert (old["curr_x"] == 0).all()
    np.testing.assert_allclose(new.time, [0.0, 0.04, 0.06])
    with pytest.raises(TypeError):
        new.columns["curr_x"] = np.zeros(3)  # pyright: ignore


def test_the_sample_rate_is_that_of_most_samples_and_a_gap_does_not_change_it():
    t = np.r_[np.arange(100), 900 + np.arange(100)] / 50
    assert Recording(PART, {"time": t}).sample_rate_hz == pytest.approx(50.0)
    assert Recording(PART, {"time": np.repeat(t, 2)}).sample_rate_hz == pytest.approx(50.0)
    with pytest.raises(RecordingError, match="at least two"):
        _ = Recording(PART, {"time": np.zeros(1)}).sample_rate_hz


@pytest.mark.parametrize(
    "wrong",
    [
        {"materal": "steel"},
        {"order": 0},
        {"vertical_axis": "w"},
        {"duration_s": -1.0},
        {"ball_screw_lead_mm": {"x": 0.0}},
        {"tools": {"T1": {"diameter": 10.0}}},
    ],
)
def test_what_part_json_may_not_say_is_refused(wrong):
    with pytest.raises(ValidationError):
        PartInfo.model_validate({"part": "p", "machine": "m", **wrong})


def test_part_json_of_the_contract_is_accepted_whole():
    info = PartInfo.model_validate(
        {
            "part": "p",
            "machine": "m",
            "production_order": 7,
            "start_time_s": 100.5,
            "tools": {"6": {"diameter_mm": 10, "teeth": 4, "used_before": {"cut_volume_mm3": 1e4, "cut_time_s": 60}}},
            "tool_changes": [{"t": 3.0, "tool_id": 6}],
            "operations": [{"nc_line": 10, "tool_id": 6, "feed_mm_s": 9.6, "rpm": 3200, "coolant": True}],
            "workpiece": {"center_xy_mm": [10, 20], "size_xy_mm": [150, 75], "top_z_mm": 0, "blank_mm": [150, 75, 50]},
        }
    )
    assert info.order == 7
    assert info.operations[0].feed_mm_s == 9.6
