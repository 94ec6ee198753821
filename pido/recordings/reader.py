"""What every recording format can do: recognise its files and read one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from pido.core.recording import Recording


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


def head(path: Path, size: int = 4096) -> bytes:
    """The first bytes of a file; nothing for a folder or a file that cannot be opened."""
    try:
        with path.open("rb") as handle:
            return handle.read(size)
    except OSError:
        return b""


def csv_header(path: Path) -> list[str]:
    """Column names in the first line of a CSV file."""
    line = head(path, 65536).split(b"\n", 1)[0].decode("utf-8-sig", "replace").rstrip("\r")
    return [name.strip().strip('"') for name in line.split(",")]
