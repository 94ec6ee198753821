"""A CSV file that a recorder is still writing, read as it grows.

In:  a path, columns of the contract. Out: blocks of whole rows, averaged down to the method's rate.

What lies there is one part as long as it begins as it did: a copy that is brought up to date by a rename, or written
anew from its start, goes on. Where it begins otherwise, a recorder has begun the next part under the same name.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from io import FileIO
from pathlib import Path

import numpy as np

from pido.core.arrays import Float1D
from pido.core.columns import ALIASES, CURRENT, INPUTS, PROCESS, TIME
from pido.core.errors import RecordingError
from pido.process.samples import load_in
from pido.workspace import digest_of

POLL_S = 0.05
FIRST_ROWS = 50
"""Rows from which the file's rate is read."""
BEGINNING = 65536
"""Bytes by which a file is known again, at most."""


class Growing:
    """Whole lines of a file as they come; ends when nothing came for `idle_s`, or when the next part took its place.

    replaced : whether it ended by the next part, of which nothing was read then
    """

    def __init__(self, path: Path, idle_s: float, sleep: Callable[[float], None], clock: Callable[[], float]) -> None:
        self.path, self._idle_s, self._sleep, self._clock = path, idle_s, sleep, clock
        self.replaced = False
        self._file: FileIO | None = None
        self._beginning, self._place = b"", 0

    def __iter__(self) -> Iterator[list[str]]:
        try:
            yield from self._lines()
        finally:
            if self._file is not None:
                self._file.close()

    def _lines(self) -> Iterator[list[str]]:
        rest, last = b"", self._clock()
        while not self.replaced:
            new = self._new()
            if b"\0" in new or (self._place == len(new) and new.startswith(b"PAR1")):
                raise RecordingError(
                    f"{self.path}: this is no text. What is followed is a CSV file in UTF-8 that a recorder is still "
                    f"writing; a recording that is finished is judged by `pido monitor {self.path}`."
                )
            *whole, rest = (rest + new).split(b"\n")
            if new:
                last = self._clock()
            if lines := [line.decode("utf-8-sig", "replace").rstrip("\r") for line in whole if line.strip()]:
                yield lines
            elif self._clock() - last > self._idle_s:
                return
            else:
                self._sleep(POLL_S)

    def _new(self) -> bytes:
        """What has come since it was last read; of a file that was renamed away, its rest first."""
        if self._file is None:
            if not self.path.exists():
                return b""
            self._file = FileIO(self.path)
        new = self._file.readall()
        if self._begins_otherwise(self._file):  # looked at after it was read: it may be written anew at any moment
            self.replaced = True
            return b""
        self._beginning += new[: BEGINNING - len(self._beginning)]
        self._place += len(new)
        if not new:
            with suppress(FileNotFoundError):
                self._look_at_its_name(self._file)
        return new

    def _look_at_its_name(self, file: FileIO) -> None:
        if os.path.samestat(os.fstat(file.fileno()), self.path.stat()):
            return
        other = FileIO(self.path)
        if self._begins_otherwise(other):
            self.replaced = True
        elif os.fstat(other.fileno()).st_size >= self._place:  # a shorter one is still to show what it is
            other.seek(self._place)
            self._file, other = other, file
        other.close()

    def _begins_otherwise(self, file: FileIO) -> bool:
        begins = os.pread(file.fileno(), len(self._beginning), 0)
        return not self._beginning.startswith(begins)


def blocks(file: Growing, rate_hz: float, air_cut: bool) -> Iterator[tuple[str, dict[str, np.ndarray]]]:
    """Whole blocks of rows as they are written, averaged down to the method's rate; with each, the digest of the file's
    first rows.

    Raises RecordingError for what is missing, is no number, or has no time to be averaged by.
    """
    path = file.path
    names: list[str] = []
    waiting: list[list[str]] = []
    began, width, done, last = "", 0, 0, -np.inf
    for lines in file:
        rows = _split(path, lines)
        if not names:
            names, rows = _header(path, rows[0], air_cut), rows[1:]
        waiting += rows
        if not width and len(waiting) >= FIRST_ROWS:
            width = _width(path, _times(path, names, waiting[:FIRST_ROWS], 0), rate_hz)
            began = digest_of([names, waiting[:FIRST_ROWS]])[:12]
        whole = len(waiting) // width * width if width else 0
        if whole:
            time = _times(path, names, waiting[:whole], done)
            if (back := np.flatnonzero(np.diff(time, prepend=last) < 0)).size:
                raise RecordingError(
                    f"{path}: time goes backward in row {done + back[0] + 1}. Write the next part into a file of its "
                    "own, and rows in their order."
                )
            done, last = done + whole, float(time[-1])
            yield began, _averaged(path, names, waiting[:whole], width, air_cut)
            waiting = waiting[whole:]
    if waiting and not width:
        raise RecordingError(
            f"{path}: {len(waiting)} samples, {FIRST_ROWS - len(waiting)} too few: the file's rate is read from the "
            f"first {FIRST_ROWS}. Record the whole part, and end its last line."
        )


def _split(path: Path, lines: list[str]) -> list[list[str]]:
    try:
        return list(csv.reader(lines))
    except csv.Error as error:
        raise RecordingError(f"{path}: no line of a CSV file ({error}): {lines[0][:60]!r}. Export it again.") from None


def _header(path: Path, cells: list[str], air_cut: bool) -> list[str]:
    names = [ALIASES.get(name.strip(), name.strip()) for name in cells]
    needed = {TIME, *INPUTS} - (set(PROCESS) if air_cut else set())
    missing = sorted(needed - set(names))
    if missing:
        raise RecordingError(
            f"{path}: a part cannot be followed without {', '.join(missing)}. Write them with the recording; where "
            "nothing is cut, set air_cut = true in workspace.toml."
        )
    if not set(names) & set(CURRENT.values()):
        raise RecordingError(f"{path}: no current to watch; one of {', '.join(CURRENT.values())} is needed.")
    return names


def _times(path: Path, names: list[str], rows: list[list[str]], done: int) -> Float1D:
    """(n,) s. `done`: rows before these."""
    time = _numbers(path, names, rows, names.index(TIME))
    if (missing := np.flatnonzero(~np.isfinite(time))).size:
        raise RecordingError(
            f"{path}: time is missing in row {done + missing[0] + 1}. Have the recorder write the time of every row."
        )
    return time


def _width(path: Path, time: Float1D, rate_hz: float) -> int:
    """Rows per sample of the method, from the times of the first rows."""
    if (still := np.flatnonzero(np.diff(time) <= 0)).size:
        raise RecordingError(
            f"{path}: time does not go on from row {still[0] + 1}, {time[still[0]]:g} s, to row {still[0] + 2}. Where "
            "stamps are rounded, have the recorder write them to a thousandth of a second or finer."
        )
    rate = 1.0 / float(np.median(np.diff(time)))
    if rate < 0.8 * rate_hz:
        raise RecordingError(
            f"{path}: {rate:.4g} samples per second; the models were trained on {rate_hz:g}. Record at least that many."
        )
    return max(1, round(rate / rate_hz))


def _averaged(path: Path, names: list[str], rows: list[list[str]], width: int, air_cut: bool) -> dict[str, np.ndarray]:
    """Means over `width` rows; of states the last one. A missing value makes its mean missing."""
    columns: dict[str, np.ndarray] = {}
    for i, name in enumerate(names):
        if name == "tool_id":
            columns[name] = np.array([_tool(_cell(row, i)) for row in rows[width - 1 :: width]], object)
            continue
        grouped = _numbers(path, names, rows, i).reshape(-1, width)
        columns[name] = grouped[:, -1] if name in (TIME, "nc_line", "coolant") else grouped.mean(axis=1)
    if air_cut:
        missing = [name for name in PROCESS if name in INPUTS and name not in columns]
        if missing and (load := load_in(columns)):
            raise RecordingError(
                f"{path}: {', '.join(missing)} cannot be taken as 0, though air_cut = true: {load}. Write "
                "them with the recording."
            )
        columns |= {name: np.zeros(len(columns[TIME])) for name in missing}
    return columns


def _numbers(path: Path, names: list[str], rows: list[list[str]], i: int) -> Float1D:
    """(n,): column `i`, NaN where nothing stands."""
    text = [_cell(row, i) for row in rows]
    try:
        return np.array([float(value) if value.strip() else np.nan for value in text])
    except ValueError:
        raise RecordingError(f"{path}: column '{names[i]}' holds what is not a number near {text[0]!r}.") from None


def _cell(row: list[str], i: int) -> str:
    return row[i] if i < len(row) else ""


def _tool(value: str) -> str:
    """As a stored part says it: a number without its empty decimals."""
    value = value.strip()
    return value[: -len(".0")] if value.endswith(".0") else value
