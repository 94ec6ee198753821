"""Files that are replaced whole: who reads one sees the old content or the new, never a part of it.

In:  a path, and content or a block that writes it. Out: the file, flushed to disk.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A place beside `path` to write to. What is there when the block ends takes the place of `path`, flushed to disk;
    where the block fails, `path` stays as it was.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}.new")
    try:
        yield temporary
        _sync(temporary)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    _sync(path.parent)


def write_atomically(path: Path, content: str | bytes, mode: int = 0o666) -> None:
    """`path` with this content (text in UTF-8), whole or not at all. `mode`: who may open it, less the umask."""
    with replacing(path) as temporary:
        temporary.touch(mode)
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
