"""What every recording format can do: recognise its files and read one."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pido.core.columns import ALIASES
from pido.core.errors import RecordingError, UnavailableError
from pido.core.files import refusal
from pido.core.recording import Recording

UNKNOWN = "columns that the contract does not know: "
"""Begins the note that lists them; `check` refuses them for the store."""


@dataclass(frozen=True, slots=True)
class Reader:
    """One format.

    name : shown to people and kept as the source in the store
    layout : what the format looks like, one line
    recognises : path -> whether this reader takes it; looks at a few bytes, never raises
    read : (path, machine or None, axis -> channel name) -> Recording
    """

    name: str
    layout: str
    recognises: Callable[[Path], bool]
    read: Callable[[Path, str | None, Mapping[str, str]], Recording]


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """What the operating system refuses while a recording is read is UnavailableError, no fault of the recording."""
    try:
        yield
    except OSError as error:
        raise UnavailableError(f"cannot be read now. {refusal(error, path)}") from None


def head(path: Path, size: int = 4096) -> bytes:
    """The first bytes of a file; nothing for a folder or a file that cannot be opened."""
    try:
        with path.open("rb") as handle:
            return handle.read(size)
    except OSError:
        return b""


def csv_header(path: Path) -> list[str]:
    """Column names in the first line of a CSV file."""
    lines = head(path, 65536).splitlines() or [b""]
    rows = csv.reader([lines[0].decode("utf-8-sig", "replace")], skipinitialspace=True)
    return [name.strip() for name in next(rows, [])]


def saved_otherwise(path: Path) -> str:
    """What to do where a program on the way has saved a table in its own manner; '' where it has not."""
    start = head(path, 65536)
    if start[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "Its text is UTF-16: save it as UTF-8. "
    first = start.split(b"\n", 1)[0]
    for between, name in ((b";", "';'"), (b"\t", "tabs")):
        if start.isascii() and first.count(between) > 2:
            return f"{name} stand between its columns: export it with ',' between columns and '.' in numbers. "
    return ""


def of_machine(named: str | None, usual: str, why: str) -> tuple[str, tuple[str, ...]]:
    """(machine of a recording that does not say it, notes): the one that was named, or the `usual` one, with a note.

    >>> of_machine(None, "emps", "as published")[1]
    ("the recording does not name its machine: 'emps' is assumed, as published; --machine names another",)
    """
    if named:
        return named, ()
    return usual, (f"the recording does not name its machine: {usual!r} is assumed, {why}; --machine names another",)


def contract_names(names: Sequence[str], path: Path) -> list[str]:
    """The contract's name of each column of a table, its own where the contract has none.

    A published name stands for the contract's (f_x for f_x_sim) only where that one is not in the table itself: a force
    that was measured stands beside its simulation. Raises RecordingError where a column stands in the table twice.
    """
    named = [name if (alias := ALIASES.get(name, name)) in names else alias for name in names]
    if twice := sorted({name for name in named if named.count(name) > 1}):
        raise RecordingError(f"{path}: column(s) {', '.join(twice)} stand in it twice. Export the recording again.")
    return named
