"""Files that are replaced whole: who reads one sees the old content or the new, never a part of it.

In:  a path, and content or a block that writes it. Out: the file, flushed to disk.
Also what an operating system's refusal means to a user, and whether there will be one.
"""

from __future__ import annotations

import errno
import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pido.core.errors import InputError

_ADVICE = {
    **dict.fromkeys((errno.EACCES, errno.EPERM, errno.EROFS), "Give this user the right to it, or name another place."),
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT), "Make room there, or name another place."),
    **dict.fromkeys((errno.EISDIR, errno.ENOTDIR, errno.EEXIST), "Something else is there: name another place."),
    errno.ENAMETOOLONG: "Give it a shorter name.",
}


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A place beside `path` to write to. What is there when the block ends takes the place of `path`, flushed to disk;
    where the block fails, `path` stays as it was; an error of the disk that names no file then names `path`.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}.new")
    try:
        yield temporary
        _sync(temporary)
        temporary.replace(path)
    except OSError as error:
        error.filename = error.filename or str(path)
        raise
    finally:
        temporary.unlink(missing_ok=True)
    _sync(path.parent)


def write_atomically(path: Path, content: str | bytes, mode: int = 0o666) -> None:
    """`path` with this content (text in UTF-8), whole or not at all. `mode`: who may open it, less the umask."""
    with replacing(path) as temporary:
        temporary.touch(mode)
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


def refusal(error: OSError, path: Path | None = None) -> str:
    """Where, what, and what to do, of an error of the operating system; `path` where the error does not say its own."""
    place = error.filename or path
    what = error.strerror or str(error) or type(error).__name__
    advice = _ADVICE.get(error.errno or 0, "Mend that, then try again.")
    return f"{f'{place}: ' if place else ''}{what.rstrip('.')}. {advice}"


def writable(path: Path) -> None:
    """Says before hours of work whether a file can be put at `path` after them; makes nothing that stays.

    Raises InputError where it cannot.
    """
    if path.is_dir():
        raise InputError(f"{path}: this is a folder. Name a file.")
    place = next(folder for folder in path.absolute().parents if folder.exists())
    try:
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written. {refusal(type(error)(error.errno, error.strerror), place)}"
        ) from None


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
