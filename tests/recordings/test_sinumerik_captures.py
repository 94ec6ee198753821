"""Captures written here, message by message, with known content; and the real one."""

import json

import numpy as np
import pytest

from pido.core.errors import RecordingError
from pido.recordings import read_recording, recognise
from pido.recordings.check import check
from pido.recordings.folder import write_folder

SIGNALS = ["CYCLE", "CURRENT|2", "ENC_POS|1", "CURRENT|1", "ENC_POS|2", "CURRENT|6", "ENC_POS|6", "LOAD|1", "CURRENT|4"]
AXES = {"1": "X1", "2": "Y1", "6": "SP1", "4": "C1"}


def _row(k):
    """The k-th row: every value says which signal and which count it is."""
    return [1000 + k, 2 + k / 100, 10.0 + 0.01 * k, 1 + k / 100, 20.0 - 0.02 * k, 6.0, 3.6 * k, 0.0, 4.0]


def _event(k, code, tool=6):
    return {"HFBlockEvent": {"HFProbeCounter": 1000 + k, "SeekOffset": len(code), "ActiveTool": tool, "GCode": code}}


MESSAGES = [
    _event(-5, "N10 G0"),
    {"HFData": [_row(k) for k in range(40, 100)]},
    {"HFTimestamp": {"Time": "2024-01-01T00:00:10.000Z", "HFProbeCounter": 1000}},
    _event(50, "N20 G1"),
    {"HFData": [_row(k) for k in range(0, 40)]},
    _event(80, "N10 G0", tool=7),
    {"HFCallEvent": {"HFProbeCounter": 1003}},
]


def _write(path, messages=MESSAGES, *, style="lines", cycle_ms=2, axes=AXES, header_last=False):
    signals = [{"Name": s, "Axis": axes.get(s.partition("|")[2], "Cycle")} for s in SIGNALS]
    header = {"SignalListHFData": signals, "MachineInfo": {"MachineName": "mill 7"}, "CycleTimeMs": cycle_ms}
    if style == "lines":
        body = ",\n".join(json.dumps(m) for m in messages)
        path.write_text(f'{{\n"Header":\n{json.dumps(header)},\n"Payload":\n[{body}],\n"Footer": {{}}\n}}\n')
    else:
        parts = {"Header": header, "Payload": messages, "Footer": {}}
        if header_last:
            parts = {"Payload": messages, "Header": header}
        path.write_text(json.dumps(parts, indent=2 if style == "pretty" else None))
    return path


@pytest.mark.parametrize("style", ["lines", "pretty", "one line"])
def test_a_capture_reads_the_same_in_whatever_way_its_json_is_laid_out(tmp_path, style):
    recording = read_recording(_write(tmp_path / "c.json", style=style))
    k = np.arange(100)
    np.testing.assert_allclose(recording.time, 0.002 * k, atol=1e-12)
    np.testing.assert_array_equal(recording["curr_x"], 1 + k / 100)
    np.testing.assert_array_equal(recording["curr_y"], 2 + k / 100)
    np.testing.assert_allclose(recording["v_x"], 5.0)  # 0.01 mm in 2 ms
    np.testing.assert_allclose(recording["v_y"], -10.0)
    np.testing.assert_allclose(recording["v_sp"], 1800.0)
    assert recording.part.machine == "mill 7"
    assert "curr_z" not in recording


def test_header_may_come_after_the_payload(tmp_path):
    assert len(read_recording(_write(tmp_path / "c.json", style="one line", header_last=True))) == 100


def test_every_sample_carries_the_block_and_tool_of_the_last_event_before_it(tmp_path):
    recording = read_recording(_write(tmp_path / "c.json"))
    np.testing.assert_array_equal(recording["nc_line"], np.repeat([1, 2, 1], [50, 30, 20]))
    np.testing.assert_array_equal(recording["tool_id"], np.repeat([6, 7], [80, 20]))


def test_time_stamps_give_the_clock_at_the_first_sample_and_the_rate_if_the_header_has_none(tmp_path):
    stamps = [
        {"HFTimestamp": {"Time": f"2024-01-01T00:00:{10 + 0.05 * j:06.3f}Z", "HFProbeCounter": 1000 + 50 * j}}
        for j in range(3)
    ]
    messages = [m for m in MESSAGES if "HFTimestamp" not in m] + stamps
    recording = read_recording(_write(tmp_path / "c.json", messages, cycle_ms=None))
    assert recording.sample_rate_hz == pytest.approx(1000.0)
    assert recording.part.start_time_s == pytest.approx(1704067210.0, abs=1e-3)  # 2024-01-01T00:00:10Z


def test_axes_can_be_named_otherwise(tmp_path):
    recording = read_recording(_write(tmp_path / "c.json"), channels={"z": "C1"})
    assert (recording["curr_z"] == 4.0).all()
    with pytest.raises(RecordingError, match="'Q9'"):
        read_recording(tmp_path / "c.json", channels={"z": "Q9"})


def test_an_unknown_payload_key_is_noted_and_the_rest_is_read(tmp_path):
    recording = read_recording(_write(tmp_path / "c.json", [*MESSAGES, {"HFNovelty": {"a": 1}}]))
    assert len(recording) == 100
    assert any("HFNovelty" in note for note in recording.notes)


@pytest.mark.parametrize("style", ["lines", "one line"])
@pytest.mark.parametrize("share", [0.4, 0.8, 0.99])
def test_a_truncated_capture_is_one_clear_error(tmp_path, style, share):
    path = _write(tmp_path / "c.json", style=style)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(RecordingError, match=r"c\.json.*(damaged or cut off|not a recording)"):
        read_recording(path)


def _changed(row, i, value):
    return [value if k == i else cell for k, cell in enumerate(row)]


@pytest.mark.parametrize(
    ("message", "words"),
    [
        ({"HFData": [_row(100), _row(101)[:-1]]}, "row of CYCLE 1101 has not 9 numbers"),
        ({"HFData": [_row(100), 5]}, "row of CYCLE null has not 9 numbers"),
        (
            {"HFData": [_row(100), _changed(_row(105), 3, "x")]},
            r'CURRENT\|1 .* of CYCLE 1105 is "x", which is no number',
        ),
        ({"HFData": [_changed(_row(100), 2, [1])]}, r"ENC_POS\|1 .*CYCLE 1100 is \[1\], which is no number"),
        ({"HFBlockEvent": "N10 G0"}, 'an HFBlockEvent is "N10 G0", no object'),
        ({"HFBlockEvent": {"HFProbeCounter": "abc", "GCode": "N10"}}, 'HFProbeCounter .* is "abc", which is no number'),
        ({"HFBlockEvent": {"HFProbeCounter": 1007, "GCode": ["N1"]}}, r'GCode .* count 1007 is \["N1"\], neither text'),
        (_event(7, "N10", tool={"T": 1}), r'ActiveTool .* count 1007 is \{"T":1\}, neither text'),
        ({"HFTimestamp": "2024"}, 'an HFTimestamp is "2024", no object'),
        ([1, 2], r"a message of the payload is \[1,2\], no object"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
@pytest.mark.parametrize("style", ["lines", "one line"])
def test_what_is_odd_in_a_message_is_said_where_it_is(tmp_path, style, message, words):
    path = _write(tmp_path / "c.json", [*MESSAGES, message], style=style)
    with pytest.raises(RecordingError, match=rf"c\.json: .*{words}.*Export it again"):
        read_recording(path)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("CycleTimeMs", "2,0", 'CycleTimeMs in the header is "2,0", which is no number'),
        ("MachineInfo", ["mill 7"], r'MachineInfo in the header is \["mill 7"\], no object .*--machine'),
        ("SignalListHFData", [{"Name": "CYCLE"}, {"Name": None}], r'entry 2 of SignalListHFData is \{"Name":null\}'),
        ("SignalListHFData", 5, "no usable SignalListHFData"),
    ],
)
def test_what_is_odd_in_the_header_is_said_by_its_key(tmp_path, key, value, words):
    path = _write(tmp_path / "c.json", style="one line")
    whole = json.loads(path.read_text())
    whole["Header"][key] = value
    path.write_text(json.dumps(whole))
    with pytest.raises(RecordingError, match=words):
        read_recording(path)


def test_an_event_that_is_null_is_none(tmp_path):
    recording = read_recording(_write(tmp_path / "c.json", [{"HFBlockEvent": None}, *MESSAGES]))
    np.testing.assert_array_equal(recording["nc_line"], np.repeat([1, 2, 1], [50, 30, 20]))


def test_a_tool_that_is_a_name_stays_one(tmp_path):
    messages = [_event(10, "N5", tool="FRAESER"), *MESSAGES[1:]]
    recording = read_recording(_write(tmp_path / "c.json", messages))
    assert recording["tool_id"].tolist() == 10 * [None] + 40 * ["FRAESER"] + 30 * ["6"] + 20 * ["7"]
    again = read_recording(write_folder(recording, tmp_path / "c"))
    assert again["tool_id"].tolist() == recording["tool_id"].tolist()


def test_a_capture_that_counts_each_cycle_twice_has_time_that_stands_still(tmp_path):
    twice = [_row(k // 2)[:1] + _row(k)[1:] for k in range(200)]
    faults = check(read_recording(_write(tmp_path / "c.json", [{"HFData": twice}])))
    assert [(f.rows, f.severity) for f in faults if f.kind == "time_repeated"] == [(100, "error")]


@pytest.mark.real
def test_the_real_capture_has_its_published_size_and_its_gap(real_data):
    path = real_data / "sinumerik_edge" / "capture_840Dsl.json"
    recording = read_recording(path)
    assert recognise(path).name.startswith("SINUMERIK")
    assert len(recording) == 3818
    assert recording.sample_rate_hz == pytest.approx(500.0)
    whole = json.loads(path.read_text())
    names = [s["Name"] for s in whole["Header"]["SignalListHFData"]]
    rows = [row for m in whole["Payload"] for row in m.get("HFData", [])]
    for column, signal in {"pos_y": "ENC_POS|2", "curr_x": "CURRENT|1", "curr_sp": "CURRENT|6"}.items():
        np.testing.assert_array_equal(recording[column], [row[names.index(signal)] for row in rows])
