import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pido.core.errors import RecordingError, SettingsError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings import read_recording
from pido.recordings.folder import says_machine, write_folder
from pido.store import Store


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


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ('"order": 10000000000000000000', "order: .*less than or equal to 9223372036854775807"),
        ('"order": true', "order: must be a whole number, without quotes"),
        ('"order": "3"', "order: must be a whole number, without quotes"),
        ('"part": "  "', "part: the name is blank"),
        ('"part": "a\\nb"', "part: the name holds a line break"),
        ('"machine": "a\\u0000"', "machine: the name holds a line break"),
        (f'"part": "{"x" * 300}"', "part: the name is too long: 300 characters as a file name, 200 at most"),
        ('"ball_screw_lead_mm": {"q": 5}', "ball_screw_lead_mm: 'q' is no axis with a screw: x, y, z"),
        ('"operations": [{"nc_line": 1, "coolant": 5}]', r"operations\.0\.coolant: must be 0 \(off\) or 1 \(on\)"),
        ('"workpiece": {"blank_mm": [-1, 2, 3]}', r"workpiece\.blank_mm: sizes must be greater than 0"),
        ('"material": "a", "material": "b"', "the key 'material' stands in it twice"),
        ('"tools": {"1": {"teeth": 2, "teeth": 3}}', "the key 'teeth' stands in it twice"),
        (f'"tools": {"[" * 900}{"]" * 900}', "tools|nested"),
    ],
    ids=lambda text: text[:40],
)
def test_what_part_json_may_not_say_is_refused_in_words(folder, wrong, words):
    given = {"part": '"part": "p01"', "machine": '"machine": "m"'}
    rest = [text for key, text in given.items() if not wrong.startswith(f'"{key}"')]
    (folder / "part.json").write_text("{" + ", ".join([*rest, wrong]) + "}")
    with pytest.raises(SettingsError, match=words):
        read_recording(folder)


def test_what_a_part_was_kept_with_before_there_were_rules_is_still_read(folder, tmp_path):
    old = PartInfo(part=" ", machine="m\n", ball_screw_lead_mm={"q": 5}, workpiece={"blank_mm": (-1, 2, 3)})  # pyright: ignore
    store = Store(tmp_path / "store")
    entry = store.add(replace(read_recording(folder), part=old))
    assert store.load(entry.digest).part == old


def test_whole_numbers_that_lose_digits_are_refused_for_that(folder):
    file = folder / "recording.parquet"
    pq.write_table(pq.read_table(file).append_column("nc_line", pa.array([2**60 + 1] * 60)), file)
    with pytest.raises(RecordingError, match=r"'nc_line' holds whole numbers beyond 2\^53, which lose digits"):
        read_recording(folder)


def test_a_file_whose_name_cannot_be_a_parts_is_said(folder):
    file = (folder / "recording.parquet").rename(folder.parent / f"{'x' * 210}.parquet")
    with pytest.raises(RecordingError, match=r"the name of its part is too long: 210 .* Give it another one"):
        read_recording(file)


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


@pytest.mark.parametrize(
    "values",
    [
        pa.array(np.arange(60) * 20_000, pa.timestamp("us")),
        pa.array(["rough"] * 20 + ["finish"] * 40).dictionary_encode(),
        pa.array([2**60 + 1] * 60),
        pa.array([{"a": 1}] * 60),
        pa.array([b"x"] * 60, pa.binary()),
    ],
    ids=lambda values: str(values.type).partition("<")[0],
)
def test_a_further_column_that_is_no_number_is_noted_like_one_of_text(folder, values):
    file = folder / "recording.parquet"
    before = read_recording(folder)
    pq.write_table(pq.read_table(file).append_column("operation", values), file)
    recording = read_recording(folder)
    assert set(recording.columns) == set(before.columns)
    assert recording.notes == ("columns that the contract does not know: operation",)
    pq.write_table(pq.read_table(file).append_column("nc_line", values), file)
    with pytest.raises(RecordingError, match="'nc_line'"):
        read_recording(folder)


def test_a_tool_given_as_a_category_is_its_name_or_number(folder):
    file = folder / "recording.parquet"
    table = pq.read_table(file)
    for given in (["T1", None, "T2"], [1, None, 2]):
        column = pa.array(np.repeat(given, 20).tolist()).dictionary_encode()
        pq.write_table(table.set_column(table.schema.get_field_index("tool_id"), "tool_id", column), file)
        read = read_recording(folder)["tool_id"]
        assert read[[0, 59]].tolist() == [given[0], given[2]]
        assert read[20] is None or np.isnan(read[20])


def test_only_a_part_json_that_belongs_to_the_recording_says_its_machine(tmp_path):
    """A CSV beside a part.json is of a machine that its reader assumes."""
    part = write_folder(Recording(PartInfo(part="p", machine="m"), {"time": np.arange(60) / 50.0}), tmp_path / "p")
    (part / "other.csv").write_text("pos_x,curr_x\n0,0\n")
    assert says_machine(part)
    assert says_machine(part / "recording.parquet")
    assert not says_machine(part / "other.csv")
    (part / "part.json").unlink()
    assert not says_machine(part)
