"""Files and folders that a verb writes: looked at before anything is computed; nothing that was recorded is replaced.

In:  what --out names, and the inputs of the call. Out: nothing, or InputError that names another way.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import Any

import click

from pido.core.errors import InputError
from pido.core.files import writable

_OTHER_FILES = (".csv", ".json", ".txt", ".xlsx", ".mpf", ".feather", ".h5")


class Output(click.Path):
    """A file, or a folder of files, that a verb writes when it is done.

    One that cannot be written is an error (exit code 1) before anything is imported or computed.
    """

    def __init__(self, *, file_okay: bool = True, dir_okay: bool = True) -> None:
        super().__init__(file_okay=file_okay, dir_okay=dir_okay, readable=False, path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        path: Any = super().convert(value, param, ctx)
        writable(path / "report.html" if self.dir_okay else path)
        return path


def replaceable(file: Path, own: Callable[[Collection[str]], bool], what: str) -> None:
    """Raises InputError where `file` is there and may not be replaced.

    own : whether a Parquet file with these columns is `what` the verb writes
    """
    if not file.exists():
        return
    if not own(_columns(file)):
        raise InputError(f"--out {file}: is there already and is no {what}. Name another place, or move it away.")


def not_of_another_format(out: Path, written: str) -> None:
    """Raises BadParameter where the name of a file says that it is no Parquet, which the verb writes.

    written : what is written, and under what name
    """
    if out.suffix.lower() in _OTHER_FILES and not out.is_dir():
        raise click.BadParameter(f"{out.name}: {written}", param_hint="--out")


def outside(out: Path, inputs: Iterable[Path]) -> None:
    """Raises InputError where `out` is one of the inputs, or lies in one."""
    place = out.resolve()
    for each in inputs:
        if place.is_relative_to(each.resolve()):
            raise InputError(f"--out {out}: belongs to {each}, which is read. Name a place outside of it.")


def _columns(file: Path) -> list[str]:
    """Of a Parquet file; none of anything else."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        return pq.read_schema(file).names
    except (pa.ArrowException, OSError):
        return []
