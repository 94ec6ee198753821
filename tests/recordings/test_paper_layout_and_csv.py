"""Files written in the published layouts, with known content."""

import re

import numpy as np
import pandas as pd
import pytest

from pido.core.errors import RecordingError
from pido.recordings import read_recording, recognise
from pido.recordings.check import check

N = 200


def _trial(root, *, encoders=True, header=True, events=True, spindle="S1", tools=None):
    folder = root / "IMP-01" / "processed_data"
    folder.mkdir(parents=True)
    k = np.arange(N)
    table = {"CYCLE": 7000 + k}
    axis = {1: "X1", 2: "Y1", 3: "Z1", 6: spindle}
    for n in axis:
        table[f"DES_POS|{n}"] = n + 0.01 * n * k
        if encoders:
            table[f"ENC_POS|{n}"] = n + 0.01 * n * k + 0.001
            table[f"LOAD|{n}"] = 0.0 * k
        table[f"CURRENT|{n}"] = n + 0.0 * k
    pd.DataFrame(table).to_csv(folder / "IMP-01_hfdata.csv", index=False)
    if header:
        rows = [(name, "DOUBLE", axis[int(name[-1])], name) for name in table if "|" in name]
        pd.DataFrame(rows, columns=["SignalName", "Type", "Axis", "Address"]).to_csv(
            folder / "IMP-01_header.csv", index=False
        )
    if events:
        blocks = {"HFProbeCounter": [7100, 7000, 7150], "GCode": ["N2 G1 X1", "N1 G0", "N1 G0"], "Unused": 1}
        named = {} if tools is None else {"ActiveTool": tools}
        pd.DataFrame({**blocks, **named}).to_csv(folder / "IMP-01_hfblockevent.csv", index=False)
    return root / "IMP-01"


@pytest.mark.parametrize("header", [True, False])
def test_a_trial_reads_by_its_header_and_without_one_by_axis_numbers(tmp_path, header):
    folder = _trial(tmp_path, header=header)
    for path in (folder, folder / "processed_data" / "IMP-01_hfdata.csv"):
        recording = read_recording(path)
        assert recording.part.part == "IMP-01"
        assert recording.sample_rate_hz == pytest.approx(500.0)
        np.testing.assert_allclose(recording["pos_z"], 3.001 + 0.03 * np.arange(N))
        np.testing.assert_allclose(recording["v_z"], 15.0)  # 0.03 mm in 2 ms
        assert (recording["curr_sp"] == 6.0).all()
        np.testing.assert_array_equal(recording["nc_line"], np.repeat([1, 2, 1], [100, 50, 50]))


def test_a_trial_without_encoders_takes_commanded_positions_and_says_so(tmp_path):
    recording = read_recording(_trial(tmp_path, encoders=False))
    np.testing.assert_allclose(recording["pos_x"], 1 + 0.01 * np.arange(N))
    assert any("pos_x is DES_POS" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("tools", "held"),
    [
        ([2, 1, None], [1.0] * 100 + [2.0] * 100),  # an event without a tool says nothing about it
        (["FR_10", "T1", 7], ["T1"] * 100 + ["FR_10"] * 50 + ["7"] * 50),
        ([None, None, "T1"], [None] * 150 + ["T1"] * 50),
    ],
)
def test_the_tool_of_a_trial_is_a_number_or_a_name(tmp_path, tools, held):
    assert read_recording(_trial(tmp_path, tools=tools))["tool_id"].tolist() == held


def test_a_trial_whose_first_counter_is_empty_has_a_time_base_and_says_which_row_is_missing(tmp_path):
    folder = _trial(tmp_path)
    file = folder / "processed_data" / "IMP-01_hfdata.csv"
    file.write_text(file.read_text().replace("\n7000,", "\n,", 1))
    recording = read_recording(folder)
    np.testing.assert_allclose(recording.time[1:], np.arange(N - 1) * 0.002, atol=1e-12)
    assert [(f.kind, f.rows) for f in check(recording) if f.severity == "error"][:1] == [("time_missing", 1)]
    file.write_text(re.sub(r"\n7\d+,", "\n,", file.read_text()))
    with pytest.raises(RecordingError, match=r"hfdata\.csv: 'CYCLE' is empty"):
        read_recording(folder)


def test_a_trial_that_a_spreadsheet_saved_with_semicolons_is_told_how_to_export_it(tmp_path):
    folder = _trial(tmp_path)
    for file in (folder / "processed_data").iterdir():
        file.write_text(file.read_text().replace(",", ";"))
    with pytest.raises(RecordingError, match=r"'CYCLE' is missing\. ';' stand between its columns: export it"):
        read_recording(folder)


def test_a_machine_that_the_recording_does_not_name_is_assumed_in_words(tmp_path):
    _csv(tmp_path / "a.csv", time=np.arange(60) / 250)
    pd.read_csv(tmp_path / "a.csv").to_parquet(tmp_path / "b.parquet")
    for path, usual in (
        (tmp_path / "a.csv", "dmc60h"),
        (_trial(tmp_path), "cmx600v"),
        (tmp_path / "b.parquet", "unknown"),
    ):
        assumed, named = read_recording(path), read_recording(path, machine="mine")
        assert (assumed.part.machine, named.part.machine) == (usual, "mine")
        assert [n for n in assumed.notes if "does not name its machine" in n and repr(usual) in n and "--machine" in n]
        assert not [n for n in named.notes if "does not name its machine" in n]


def test_a_cell_that_is_no_number_is_one_clear_error(tmp_path):
    folder = _trial(tmp_path)
    file = folder / "processed_data" / "IMP-01_hfdata.csv"
    file.write_text(file.read_text().replace("7050,", "7050x,"))
    with pytest.raises(RecordingError, match=r"IMP-01_hfdata\.csv.*7050x"):
        read_recording(folder)


def test_two_trials_in_a_folder_are_not_one_part(tmp_path):
    folder = _trial(tmp_path)
    file = folder / "processed_data" / "IMP-01_hfdata.csv"
    (file.parent / "IMP-02_hfdata.csv").write_bytes(file.read_bytes())
    with pytest.raises(RecordingError, match="IMP-02"):
        read_recording(folder)


def test_published_names_become_the_contracts_names(tmp_path):
    file = tmp_path / "part.csv"
    frame = pd.DataFrame({"pos_x": np.arange(60.0), "curr_x": 1.0, "f_x": 5.0, "materialremoved": 2.0, "v_x_sim": 0.0})
    frame.to_csv(file)
    recording = read_recording(file)
    assert (recording["f_x_sim"] == 5.0).all()
    assert (recording["mrr_sim"] == 2.0).all()
    np.testing.assert_allclose(recording["v_x"], 50.0)  # 1 mm per 20 ms
    assert any("v_x_sim" in note for note in recording.notes)


def _csv(path, n=60, **columns):
    """A table in the published layout at 250 Hz, with these columns."""
    t = np.arange(n) / 250
    return pd.DataFrame({"pos_x": 10 * t, "v_x": 10.0, "a_x": 0.0, "curr_x": 1.0, **columns}).to_csv(path, index=False)


def test_a_force_that_was_measured_stands_beside_its_simulation(tmp_path):
    _csv(tmp_path / "a.csv", f_x=7.0, f_x_sim=5.0)
    pd.read_csv(tmp_path / "a.csv").assign(time=np.arange(60) / 50).to_parquet(tmp_path / "b.parquet")
    for name in ("a.csv", "b.parquet"):
        recording = read_recording(tmp_path / name)
        assert (recording["f_x_sim"] == 5.0).all()
        assert (recording["f_x"] == 7.0).all()


def test_a_column_that_stands_in_a_table_twice_is_refused(tmp_path):
    _csv(tmp_path / "a.csv", curr_y=2.0)
    (tmp_path / "a.csv").write_text((tmp_path / "a.csv").read_text().replace("curr_y", "curr_x"))
    with pytest.raises(RecordingError, match=r"a\.csv: column\(s\) curr_x stand in it twice"):
        read_recording(tmp_path / "a.csv")


@pytest.mark.parametrize("name", ["Time", "Time [s]", "timestamp", "t", "t_ms", "Zeit (s)", "seconds"])
def test_time_by_another_name_is_never_taken_for_no_time(tmp_path, name):
    _csv(tmp_path / "a.csv", **{name: np.arange(60) / 250})
    with pytest.raises(RecordingError, match=rf"no column 'time', but {re.escape(repr(name))}\. Name"):
        read_recording(tmp_path / "a.csv")


def test_columns_that_nobody_knows_are_refused_for_the_store_as_in_parquet(tmp_path):
    _csv(tmp_path / "a.csv", time=np.arange(60) / 250, temp=20, state="cut", v_x_sim=10.0, **{"force (x, y)": 1.5})
    recording = read_recording(tmp_path / "a.csv")
    assert (recording["temp"] == 20).all()
    assert "state" not in recording
    assert recording.sample_rate_hz == pytest.approx(250)
    unknown = {f.column for f in check(recording) if f.kind == "unknown_column" and f.severity == "error"}
    assert unknown >= {"temp", "state"}
    assert "v_x_sim" not in unknown


def test_names_that_are_not_utf_8_are_told_how_to_be_saved(tmp_path):
    _csv(tmp_path / "a.csv", kühl=1.0)
    (tmp_path / "a.csv").write_bytes((tmp_path / "a.csv").read_text().encode("latin-1"))
    with pytest.raises(RecordingError, match=r"k.hl are not UTF-8\. Save the file as UTF-8"):
        read_recording(tmp_path / "a.csv")


def test_blanks_after_the_commas_belong_to_no_name_and_no_value(tmp_path):
    _csv(tmp_path / "a.csv", tool_id="T1", coolant=1.0)
    text = (tmp_path / "a.csv").read_text().replace(",", ", ")
    (tmp_path / "b.csv").write_text(text)
    a, b = read_recording(tmp_path / "a.csv"), read_recording(tmp_path / "b.csv")
    assert a.columns.keys() == b.columns.keys()
    for name in a.columns:
        np.testing.assert_array_equal(a[name], b[name])
    (tmp_path / "b.csv").write_text(text.replace("10.0,", "fast,", 1))
    with pytest.raises(RecordingError, match=r"in line 2 'v_x' is ' ?fast', which is no number"):
        read_recording(tmp_path / "b.csv")


def test_lines_that_end_as_on_old_machines_are_lines(tmp_path):
    _csv(tmp_path / "a.csv", coolant=1.0)
    (tmp_path / "b.csv").write_bytes((tmp_path / "a.csv").read_bytes().replace(b"\n", b"\r"))
    assert (read_recording(tmp_path / "b.csv")["coolant"] == 1).all()


@pytest.mark.real
def test_the_published_air_cut_is_read_unchanged(real_data):
    path = real_data / "kit_dmc60h" / "S235JR_part2_aircut_1.csv"
    recording, frame = read_recording(path), pd.read_csv(path)
    for name in ("pos_x", "v_sp", "a_z", "curr_y"):
        np.testing.assert_array_equal(recording[name], frame[name])
    assert recording.sample_rate_hz == pytest.approx(50.0)


@pytest.mark.real
def test_the_published_equation_of_the_servo_axis_holds_on_its_recording(real_data):
    """Janot et al.: M a + Fv v + Fc sgn(v) + offset; parameters found again from pos and force, in N, mm and s."""
    from pido.recordings.resample import resample

    recording = resample(read_recording(real_data / "emps" / "DATA_EMPS.mat"), 100.0)
    v, a = recording["v_x"] / 1000, recording["a_x"] / 1000
    X = np.column_stack([a, v, np.sign(v), np.ones_like(v)])
    found, *_ = np.linalg.lstsq(X, recording["curr_x"], rcond=None)
    np.testing.assert_allclose(found, [95.1089, 203.5034, 20.3935, -3.1648], rtol=0.03)


def test_empty_missing_and_foreign_files_are_refused_by_name(tmp_path):
    (tmp_path / "empty.csv").touch()
    (tmp_path / "folder").mkdir()
    (tmp_path / "song.mp3").write_bytes(b"ID3" * 100)
    for name, why in {
        "empty.csv": "empty",
        "folder": "empty",
        "song.mp3": "not a recording",
        "nowhere": "no such file",
    }.items():
        with pytest.raises(RecordingError, match=why):
            recognise(tmp_path / name)


def test_text_where_numbers_belong_is_named_by_line_and_column(tmp_path):
    path = tmp_path / "a.csv"
    rows = [f"{k},{k * 0.1:.1f},0.0,1.0" for k in range(50)]
    rows[10], rows[20], rows[21] = "10,,0.0,1.0", "20,2.0,x7,1.0", "21,2.1,-,1.0"
    path.write_text("\n".join([",pos_x,v_x,curr_x", *rows]) + "\n\n")
    with pytest.raises(RecordingError) as fault:
        read_recording(path)
    assert "in line 22 'v_x' is 'x7', which is no number, 2 times in all." in str(fault.value)
    assert "pos_x" not in str(fault.value)  # a missing value is no text


@pytest.mark.parametrize(
    ("saved", "advice"),
    [
        (lambda text: text.replace(",", ";").replace(".", ",").encode(), "export it with ',' between columns"),
        (lambda text: text.replace(",", "\t").encode(), "tabs stand between its columns"),
        (lambda text: text.encode("utf-16"), "save it as UTF-8"),
    ],
    ids=["semicolons", "tabs", "UTF-16"],
)
def test_a_table_that_a_spreadsheet_saved_in_its_own_manner_is_told_how_to_export_it(saved, advice, tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(saved(",pos_x,v_x,curr_x\n" + "\n".join(f"{k},{k * 0.1:.1f},0.0,1.0" for k in range(50))))
    with pytest.raises(RecordingError, match=advice):
        read_recording(path)


def test_a_folder_of_recordings_is_told_to_name_each(tmp_path):
    (tmp_path / "a.csv").write_text(
        ",pos_x,v_x,a_x,curr_x\n" + "\n".join(f"{k},{k * 0.1:.1f},0.0,0.0,1.0" for k in range(50))
    )
    (tmp_path / "notes.txt").write_text("first week")
    with pytest.raises(RecordingError, match=r"holds recordings, 1 of them: give each"):
        read_recording(tmp_path)


@pytest.mark.parametrize(("at", "said"), [(-1, ": the file may have been cut off there."), (3, ".")])
def test_a_line_with_too_few_cells_is_named_by_its_number(tmp_path, at, said):
    path, axes = tmp_path / "part.csv", ("x", "y", "z", "sp")
    table = pd.DataFrame({"time": np.arange(N) / 50.0, **{f"pos_{a}": np.arange(N) * 1.0 for a in axes}})
    lines = table.assign(**{f"curr_{a}": 1.0 for a in axes}).to_csv(index=False).splitlines()
    number = len(lines) if at < 0 else at
    lines[at if at < 0 else at - 1] = "3.98,1"
    path.write_text("\n".join(lines))
    with pytest.raises(RecordingError, match=rf"line {number} has 2 of {1 + 2 * len(axes)} columns{re.escape(said)}"):
        read_recording(path, machine="m")
