"""Captures of a SINUMERIK control, as its Edge app writes them: JSON with header, payload and footer.

In:  one .json file. The header lists the signals of HFData rows; the payload is a list of messages in any order.
Out: a Recording: positions and currents of the axes by their header names, `nc_line` (number of the NC block in
     order of first appearance) and `tool_id` from HFBlockEvent, time from the sample counter.

Messages are read one line at a time, rows of numbers straight into arrays (`pido.recordings.numbers`), the rest and all
that is not in order by a general parser; where a file is laid out otherwise it is read whole. Unknown keys of the
payload are counted and noted, not refused.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from functools import partial
from itertools import chain
from operator import itemgetter
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import orjson
from simdjson import Parser

from pido.core.arrays import Float1D, Float2D
from pido.core.errors import RecordingError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings.numbers import table
from pido.recordings.reader import Reader, head
from pido.recordings.signals import block_index, hold, wanted_signals

_USED = {"HFData", "HFBlockEvent", "HFTimestamp"}
_KNOWN = _USED | {"HFCallEvent", "LFData", "ExternalData"}
_BUFFER = 1 << 20
"""Bytes read at once: lines are ten times as long as the usual buffer, which would be put together from pieces."""


def _recognises(path: Path) -> bool:
    start = head(path)
    return (
        path.is_file()
        and start.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")
        and (b'"Header"' in start or b'"Payload"' in start or b'"SignalListHFData"' in start)
    )


def _read(path: Path, machine: str | None, channels: Mapping[str, str]) -> Recording:
    with path.open("rb", buffering=_BUFFER) as file:
        if (front := _front(file)) is not None:
            try:
                return _recording(front[0], partial(_lines, front[1], file), path, machine, channels)
            except _OtherLayout:
                pass  # valid JSON may be laid out otherwise; the parser of the whole file knows, and where it is cut
    whole = _whole(path.read_bytes().removeprefix(b"\xef\xbb\xbf"), path)
    if not isinstance(whole, dict) or "Header" not in whole or not isinstance(whole.get("Payload"), list):
        raise RecordingError(
            f"{path}: a capture has 'Header' and a list 'Payload'; this JSON has not. Export it again."
        )
    return _recording(whole["Header"], lambda *_: iter(whole["Payload"]), path, machine, channels)


class _OtherLayout(Exception):
    """The payload is not one message per line."""


def _recording(
    header: dict[str, Any],
    messages: Callable[[int, list[int]], Iterator[dict[str, Any]]],
    path: Path,
    machine: str | None,
    channels: Mapping[str, str],
) -> Recording:
    """From the messages that `messages(number of signals, those wanted)` yields."""
    signals = _signal_list(header, path)
    counter_at = next((i for i, s in enumerate(signals) if s.upper() == "CYCLE"), None)
    if counter_at is None:
        raise RecordingError(f"{path}: the signal list has no CYCLE; without the sample counter there is no time base.")
    columns, notes = wanted_signals({n: a for n, a in signals.items() if n.upper() != "CYCLE"}, channels, path)
    names = list(signals)
    wanted = [counter_at, *(names.index(signal) for signal in columns.values())]
    blocks: list[Float2D] = []
    events: dict[str, list[dict[str, Any]]] = {"HFBlockEvent": [], "HFTimestamp": []}
    unknown: Counter[str] = Counter()
    for message in messages(len(names), wanted):
        for group, content in message.items():
            if group == "HFData":
                blocks.append(_rows(content, wanted, len(names), path))
            elif group in events:
                events[group].extend(content if isinstance(content, list) else [content])
            elif group not in _KNOWN:
                unknown[group] += 1
    if not blocks:
        raise RecordingError(f"{path}: the payload has no HFData; there is nothing recorded in it.")
    table = np.concatenate(blocks)
    table = table[np.argsort(table[:, 0], kind="stable")]
    table, repeated = _without_repeats(table)
    cycle_s, start_s, clock_notes = _clock(header, events["HFTimestamp"], float(table[0, 0]), path)
    data: dict[str, Any] = {"time": (table[:, 0] - table[0, 0]) * cycle_s}
    data |= {name: np.ascontiguousarray(table[:, i + 1]) for i, name in enumerate(columns)}
    data |= _program(events["HFBlockEvent"], table[:, 0])
    found = [f"payload key '{key}' is not known and was left out ({n} times)" for key, n in unknown.items()]
    if repeated:
        found.append(f"{repeated} HFData rows came twice and were taken once")
    part = PartInfo(part=path.stem, machine=machine or _machine(header), start_time_s=start_s)
    return Recording(part=part, columns=data, notes=(*notes, *clock_notes, *found))


def _front(file: BinaryIO) -> tuple[dict[str, Any], bytes] | None:
    """(header, rest of the line after the payload's bracket) if the header stands in lines before the payload."""
    front = b""
    for line in file:
        front += line
        key = front.find(b'"Payload"')
        bracket = front.find(b"[", key)
        if key >= 0 and bracket >= 0:
            break
    else:
        return None
    if front[key + 9 : bracket].strip() != b":":
        return None
    try:
        header = orjson.loads(front[:key].removeprefix(b"\xef\xbb\xbf").rstrip().rstrip(b",") + b"}").get("Header")
    except orjson.JSONDecodeError:
        return None
    return None if header is None else (header, front[bracket + 1 :])


def _whole(data: bytes, path: Path) -> Any:
    try:
        return orjson.loads(data)
    except orjson.JSONDecodeError as error:
        raise RecordingError(
            f"{path}: the JSON is damaged or cut off at line {error.lineno}, column {error.colno} "
            f"(of {len(data)} bytes): {error.msg}. Copy or export the capture again."
        ) from None


def _lines(first: bytes, file: BinaryIO, width: int, wanted: list[int]) -> Iterator[dict[str, Any]]:
    """The messages of the payload, one per line; rows of `width` numbers as an array of the columns wanted.

    Raises _OtherLayout at the first line that is no message.
    """
    parser = Parser()
    for text in chain((first,), file):
        line = text.rstrip(b", \t\r\n").lstrip()
        if not line:
            continue
        if line == b"]" or line.startswith((b"],", b"]}")):
            return
        if (rows := table(line, width, wanted, parser)) is not None:
            yield {"HFData": rows}
            continue
        last = False
        try:
            message = orjson.loads(line)
        except orjson.JSONDecodeError:
            last = line.endswith(b"]")
            try:
                message = orjson.loads(line.removesuffix(b"]"))
            except orjson.JSONDecodeError:
                raise _OtherLayout from None
        if not isinstance(message, dict):
            raise _OtherLayout
        yield message
        if last:
            return
    raise _OtherLayout


def _signal_list(header: Mapping[str, Any], path: Path) -> dict[str, str]:
    """Signal -> axis name, in the order of the columns of HFData."""
    try:
        signals = {s["Name"]: str(s.get("Axis", "")) for s in header["SignalListHFData"]}
    except (KeyError, TypeError):
        raise RecordingError(
            f"{path}: the header has no usable SignalListHFData, so nothing says what the columns are. Export it again."
        ) from None
    if len(signals) != len(header["SignalListHFData"]):
        raise RecordingError(f"{path}: SignalListHFData names a signal twice; its columns cannot be told apart.")
    return signals


def _rows(content: Any, wanted: list[int], width: int, path: Path) -> Float2D:
    if isinstance(content, np.ndarray):
        return content
    if not isinstance(content, list):
        raise RecordingError(f"{path}: HFData is not a list of rows. Export it again.")
    if not content:
        return np.empty((0, len(wanted)))
    take = itemgetter(*wanted)
    try:
        if set(map(len, content)) != {width}:
            raise IndexError
        return np.array(list(map(take, content)), dtype=float).reshape(len(content), -1)
    except (IndexError, TypeError, ValueError):
        bad = next((r for r in content if not isinstance(r, list) or len(r) != width), content[0])
        at = bad[0] if isinstance(bad, list) and bad else "?"
        raise RecordingError(
            f"{path}: an HFData row near CYCLE {at} has not {width} numbers as the signal list says. Export it again."
        ) from None


def _without_repeats(table: Float2D) -> tuple[Float2D, int]:
    """Rows whose counter and values are those of the row before are one row sent twice."""
    again = np.zeros(len(table), bool)
    again[1:] = (table[1:] == table[:-1]).all(axis=1)
    return table[~again], int(again.sum())


def _seconds(text: object) -> float:
    return datetime.fromisoformat(str(text).replace("Z", "+00:00")).timestamp()


def _clock(
    header: Mapping[str, Any], stamps: list[dict[str, Any]], first: float, path: Path
) -> tuple[float, float | None, list[str]]:
    """(seconds per count, clock at the first sample, notes).

    The counter is the time base; the time stamps tie it to the clock, give its rate where the header does not, and are
    compared with it: they jitter by tens of milliseconds, but a jump of the clock against the counter is noted.
    """
    notes: list[str] = []
    try:
        marks = [(float(s["HFProbeCounter"]), _seconds(s["Time"])) for s in (header.get("Initial"), *stamps) if s]
    except (KeyError, TypeError, ValueError):
        raise RecordingError(
            f"{path}: an HFTimestamp has no readable Time and HFProbeCounter. Export it again."
        ) from None
    counter, clock = np.array(marks, float).reshape(-1, 2).T
    cycle = header.get("CycleTimeMs")
    if cycle:
        cycle_s = float(cycle) / 1000
    elif len(marks) > 1:
        steps = np.diff(counter) > 0
        cycle_s = round(float(np.median(np.diff(clock)[steps] / np.diff(counter)[steps])), 6)
        notes.append(f"the header has no CycleTimeMs; the time stamps give {cycle_s * 1000:g} ms")
    else:
        cycle_s = 0.002
        notes.append("neither CycleTimeMs nor time stamps: 2 ms per sample were assumed")
    if not marks:
        return cycle_s, None, notes
    offset = clock - counter * cycle_s
    spread = float(np.ptp(offset))
    if spread > 0.1:
        worst = int(np.argmax(np.abs(np.diff(offset))))
        notes.append(
            f"HFTimestamp jumps by {offset[worst + 1] - offset[worst]:+.2f} s against the sample counter at count "
            f"{counter[worst + 1]:.0f}; time is the counter's"
        )
    return cycle_s, float(offset[0] + first * cycle_s), notes


def _program(events: list[dict[str, Any]], counter: Float1D) -> dict[str, Float1D]:
    """`nc_line` and `tool_id` of each sample, from the block events at or before it."""
    events = [e for e in events if e.get("HFProbeCounter") is not None]
    if not events:
        return {}
    at = [float(e["HFProbeCounter"]) for e in events]
    order = sorted(range(len(events)), key=at.__getitem__)
    events, at = [events[i] for i in order], [at[i] for i in order]
    numbers = block_index((e.get("SeekOffset"), e.get("GCode")) for e in events)
    columns = {"nc_line": hold(at, [float(n) for n in numbers], counter)}
    tools = [(a, float(e["ActiveTool"])) for a, e in zip(at, events, strict=True) if e.get("ActiveTool") is not None]
    if tools:
        columns["tool_id"] = hold([a for a, _ in tools], [tool for _, tool in tools], counter)
    return columns


def _machine(header: Mapping[str, Any]) -> str:
    info = header.get("MachineInfo") or {}
    return str(info.get("MachineName") or "sinumerik")


READER = Reader(
    name="SINUMERIK Edge capture",
    layout="a .json file with Header (SignalListHFData) and Payload",
    recognises=_recognises,
    read=_read,
)
