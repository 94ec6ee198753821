"""Files and folders that a verb reads."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pido.core.errors import InputError

if TYPE_CHECKING:
    from pido.core.recording import Recording


class Input(click.Path):
    """A path that is read. What is not there is input that cannot be used (exit code 1) in every verb, and no wrong
    call (2), which click makes of it.

    It is looked for before anything is imported or written, so a misspelt name is answered at once.
    """

    def __init__(self, *, file_okay: bool = True, dir_okay: bool = True) -> None:
        super().__init__(exists=True, file_okay=file_okay, dir_okay=dir_okay, path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter:
            raise InputError(_fault(Path(value), self.file_okay, self.dir_okay)) from None


def said_of(recordings: Sequence[Recording]) -> list[str]:
    """What was converted, assumed or derived while recordings were read: each note once, with the parts it is of."""
    parts = {note: [r.part.part for r in recordings if note in r.notes] for r in recordings for note in r.notes}
    return [f"{', '.join(names)}: {note}" for note, names in parts.items()]


def _fault(path: Path, file_okay: bool, dir_okay: bool) -> str:
    """What is wrong with the path, and what to give instead."""
    wanted = " or ".join(kind for kind, okay in (("file", file_okay), ("folder", dir_okay)) if okay)
    if not path.exists():
        near = "" if path.parent.is_dir() else f" There is no folder {path.parent} either."
        return f"{path}: no such {wanted}.{near}"
    if (path.is_dir() and not dir_okay) or (path.is_file() and not file_okay):
        return f"{path}: this is a {'folder' if path.is_dir() else 'file'}; give a {wanted}."
    return f"{path}: this {'folder' if path.is_dir() else 'file'} may not be read by this user."
