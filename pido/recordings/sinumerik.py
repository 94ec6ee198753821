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

from pido.core.arrays import Array1D, Float1D, Float2D
from pido.core.errors import RecordingError
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings.numbers import table
from pido.recordings.reader import Reader, head, of_machine
from pido.recordings.signals import block_index, hold, hold_names, wanted_signals

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
    if not isinstance(whole, dict) or (
        not isinstance(whole.get("Header"), dict) or not isinstance(whole.get("Payload"), list)
    ):
        raise RecordingError(
            f"{path}: a capture has an object 'Header' and a list 'Payload'; this JSON has not. Export it again."
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
        if not isinstance(message, dict):
            raise RecordingError(f"{path}: a message of the payload is {_shown(message)}, no object. Export it again.")
        for group, content in message.items():
            if group == "HFData":
                blocks.append(_rows(content, wanted, names, path))
            elif group in events:
                events[group].extend(_events(group, content, path))
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
    data |= _program(events["HFBlockEvent"], table[:, 0], path)
    found = [f"payload key '{key}' is not known and was left out ({n} times)" for key, n in unknown.items()]
    if repeated:
        found.append(f"{repeated} HFData rows came twice and were taken once")
    machine, assumed = of_machine(machine or _machine(header, path), "sinumerik", "having no MachineName")
    part = PartInfo(part=path.stem, machine=machine, start_time_s=start_s)
    return Recording(part=part, columns=data, notes=(*assumed, *notes, *clock_notes, *found))


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
    return (header, front[bracket + 1 :]) if isinstance(header, dict) else None


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
    listed = header.get("SignalListHFData")
    if not isinstance(listed, list) or not listed:
        raise RecordingError(
            f"{path}: the header has no usable SignalListHFData, so nothing says what the columns are. Export it again."
        )
    for number, signal in enumerate(listed, 1):
        if not isinstance(signal, dict) or not isinstance(signal.get("Name"), str):
            raise RecordingError(
                f"{path}: entry {number} of SignalListHFData is {_shown(signal)}, without a Name in text, so nothing "
                "says what that column is. Export it again."
            )
    signals = {s["Name"]: str(s.get("Axis", "")) for s in listed}
    if len(signals) != len(listed):
        raise RecordingError(f"{path}: SignalListHFData names a signal twice; its columns cannot be told apart.")
    return signals


def _events(group: str, content: Any, path: Path) -> list[dict[str, Any]]:
    """The events of one message: one or a list of them, or none (null)."""
    found = [] if content is None else content if isinstance(content, list) else [content]
    for event in found:
        if not isinstance(event, dict):
            raise RecordingError(f"{path}: an {group} is {_shown(event)}, no object with its keys. Export it again.")
    return found


def _shown(value: Any) -> str:
    """A value as it stands in the file, cut where it is long."""
    text = orjson.dumps(value).decode()
    return text if len(text) <= 60 else f"{text[:57]}..."


def _number(value: Any, what: str, path: Path) -> float:
    """`value` as a finite number; `what` names it where it is none."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not np.isfinite(number):
        raise RecordingError(f"{path}: {what} is {_shown(value)}, which is no number. Export it again.")
    return number


def _rows(content: Any, wanted: list[int], names: list[str], path: Path) -> Float2D:
    width = len(names)
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
    except (IndexError, KeyError, TypeError, ValueError):
        for row in content:
            at = _shown(row[wanted[0]] if isinstance(row, list) and len(row) > wanted[0] else None)
            if not isinstance(row, list) or len(row) != width:
                raise RecordingError(
                    f"{path}: the HFData row of CYCLE {at} has not {width} numbers as the signal list says. "
                    "Export it again."
                ) from None
            for i in wanted:
                if row[i] is not None:
                    _number(row[i], f"{names[i]} in the HFData row of CYCLE {at}", path)
        raise


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
    except (KeyError, TypeError, ValueError, OverflowError):
        raise RecordingError(
            f"{path}: an HFTimestamp has no readable Time and HFProbeCounter. Export it again."
        ) from None
    counter, clock = np.array(marks, float).reshape(-1, 2).T
    cycle = header.get("CycleTimeMs")
    if cycle:
        cycle_s = _number(cycle, "CycleTimeMs in the header", path) / 1000
    elif (steps := np.diff(counter) > 0).any():
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


def _program(events: list[dict[str, Any]], counter: Float1D, path: Path) -> dict[str, Array1D]:
    """`nc_line` and `tool_id` of each sample, from the block events at or before it; a tool may be a name."""
    events = [e for e in events if e.get("HFProbeCounter") is not None]
    if not events:
        return {}
    at = [_number(e["HFProbeCounter"], "HFProbeCounter of an HFBlockEvent", path) for e in events]
    order = sorted(range(len(events)), key=at.__getitem__)
    events, at = [events[i] for i in order], [at[i] for i in order]
    for key in ("SeekOffset", "GCode", "ActiveTool"):
        for count, event in zip(at, events, strict=True):
            if isinstance(event.get(key), list | dict):
                raise RecordingError(
                    f"{path}: {key} of the HFBlockEvent at count {count:.0f} is {_shown(event[key])}, neither text nor "
                    "a number. Export it again."
                )
    numbers = block_index((e.get("SeekOffset"), e.get("GCode")) for e in events)
    columns: dict[str, Array1D] = {"nc_line": hold(at, [float(n) for n in numbers], counter)}
    tools = [(a, e["ActiveTool"]) for a, e in zip(at, events, strict=True) if e.get("ActiveTool") is not None]
    if tools:
        columns["tool_id"] = hold_names([a for a, _ in tools], [tool for _, tool in tools], counter)
    return columns


def _machine(header: Mapping[str, Any], path: Path) -> str | None:
    info = header.get("MachineInfo") or {}
    if not isinstance(info, dict):
        raise RecordingError(
            f"{path}: MachineInfo in the header is {_shown(info)}, no object with MachineName. Name the machine of the "
            "recording (--machine), or export it again."
        )
    return str(name) if (name := info.get("MachineName")) else None


READER = Reader(
    name="SINUMERIK Edge capture",
    layout="a .json file with Header (SignalListHFData) and Payload",
    recognises=_recognises,
    read=_read,
)
