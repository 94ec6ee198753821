"""The seal of a log that only grows: how many lines it had and their hash, in a file beside it.

In:  a log. Out: `<log>.head.json`, {"lines", "sha256" of these lines}, or an error where the log begins otherwise.

The log is written first and sealed after it: a process that dies in between leaves a line that is whole, and not sealed
before the next one. A log without a seal is one from before there were seals, or has not got its first line yet.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path

from pido.core.errors import RegistryError
from pido.core.files import write_atomically


@dataclass(frozen=True, slots=True)
class Seal:
    """Of the first `lines` lines of a log, none of them without its line feed."""

    lines: int
    sha256: str


def whole_lines(log: Path) -> list[bytes]:
    """The lines of a log without their line feeds; what follows the last one was cut short."""
    return log.read_bytes().split(b"\n")[:-1] if log.exists() else []


def seal_of(log: Path) -> Seal | None:
    """The seal of a log. Who reads both asks for it first: a writer that comes in between adds to the log alone.

    Raises RegistryError where it cannot be read.
    """
    place = _place(log)
    try:
        return Seal(**json.loads(place.read_text(encoding="utf-8")))
    except FileNotFoundError:
        return None
    except (ValueError, TypeError):
        raise RegistryError(f"{place}: unreadable; bring it and {log.name} back from a backup.") from None


def check(log: Path, seal: Seal | None, lines: list[bytes]) -> None:
    """Raises RegistryError where sealed lines are missing or others than they were."""
    if seal is None or _seal(lines[: seal.lines]) == seal:
        return
    missing = seal.lines - len(lines)
    what = f"the last {missing} of {seal.lines} records were taken out" if missing > 0 else "a record was changed"
    raise RegistryError(
        f"{log}: {what}, so this log was changed outside the tool. Nothing is decided on it: bring the log and "
        f"{_place(log).name} back from a backup and compare."
    )


def seal(log: Path) -> None:
    """Seal all that a log holds now. The caller holds its lock and has checked what was there."""
    now = _seal(whole_lines(log))
    if seal_of(log) != now:
        write_atomically(_place(log), json.dumps(asdict(now)))


def _seal(lines: list[bytes]) -> Seal:
    return Seal(len(lines), hashlib.sha256(b"".join(line + b"\n" for line in lines)).hexdigest())


def _place(log: Path) -> Path:
    return log.with_suffix(".head.json")
