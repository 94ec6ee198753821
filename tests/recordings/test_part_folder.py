import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pido.core.errors import RecordingError, SettingsError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings import read_recording
from pido.recordings.folder import write_folder


@pytest.fixture
def folder(tmp_path):
    rng = np.random.default_rng(1)
    names = [f"{q}_{a}" for q in ("pos", "v", "a", "curr") for a in ("x", "y", "z", "sp")]
    columns = {"time": np.arange(60) / 50, **{n: rng.normal(size=60) for n in names}}
    columns["tool_id"] = np.array(["T1"] * 60, object)
    part = PartInfo(part="p01", machine="m", order=3, tools={"T1": {"diameter_mm": 10.0}})
    return write_folder(Recording(part, columns), tmp_path / "p01")


def test_a_part_folder_reads_back_what_was_written(folder):
    recording = read_recording(folder)
    assert recording.part.order == 3
    assert recording.part.tools["T1"].diameter_mm == 10.0
    assert recording["tool_id"][0] == "T1"
    again = write_folder(recording, folder.parent / "again")
    for name, values in recording.columns.items():
        np.testing.assert_array_equal(values, read_recording(again)[name])


def test_a_misspelt_key_of_part_json_is_refused_by_name(folder):
    (folder / "part.json").write_text(json.dumps({"part": "p01", "machine": "m", "materail": "S235JR", "order": 0}))
    with pytest.raises(SettingsError, match=r"(?s)2 fault.*(order.*materail|materail.*order)"):
        read_recording(folder)


def test_the_long_name_of_order_is_accepted(folder):
    (folder / "part.json").write_text(json.dumps({"part": "p01", "machine": "m", "production_order": 4}))
    assert read_recording(folder).part.order == 4


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_a_truncated_parquet_is_one_clear_error(folder, share):
    file = folder / "recording.parquet"
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    with pytest.raises(RecordingError, match=r"recording\.parquet.*damaged or cut off"):
        read_recording(folder)


def test_half_a_folder_says_what_is_missing(folder):
    (folder / "part.json").rename(folder / "p.json")
    with pytest.raises(SettingsError, match=r"no part\.json"):
        read_recording(folder)
    (folder / "p.json").rename(folder / "part.json")
    (folder / "recording.parquet").unlink()
    with pytest.raises(RecordingError, match=r"no recording\.parquet"):
        read_recording(folder)


def test_a_missing_value_stays_missing(folder):
    file = folder / "recording.parquet"
    table = pq.read_table(file)
    values = table.column("curr_x").to_pylist()
    values[7] = None
    pq.write_table(table.set_column(table.schema.get_field_index("curr_x"), "curr_x", pa.array(values)), file)
    assert np.flatnonzero(np.isnan(read_recording(folder)["curr_x"])).tolist() == [7]


def test_text_where_numbers_belong_is_refused(folder):
    file = folder / "recording.parquet"
    table = pq.read_table(file)
    text = pa.array(["1.0"] * 60)
    pq.write_table(table.set_column(table.schema.get_field_index("curr_x"), "curr_x", text), file)
    with pytest.raises(RecordingError, match="'curr_x' holds text"):
        read_recording(folder)
