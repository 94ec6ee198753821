"""Memory of large arrays kept at hand between one calculation and the next.

The C library of Linux hands large freed blocks back to the kernel at once, which clears them page by page when they are
asked for again: for thousands of arrays of the same size that is a fifth of the time. Where there is no `mallopt`,
nothing changes.
Source: mallopt(3), M_MMAP_THRESHOLD and M_TRIM_THRESHOLD; glibc's dynamic threshold.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_MAPPED_FROM = 32 << 20  # bytes: the most that glibc takes
_TRIMMED_FROM = (1 << 31) - 1  # bytes: the most that an int holds
_TRIMMED_AFTERWARDS = 2 * _MAPPED_FROM  # bytes: where glibc's own adjustment, which `mallopt` ends, comes to rest


@contextmanager
def kept_memory() -> Iterator[None]:
    """While inside, freed memory stays with the process; afterwards it is given back."""
    libc = ctypes.CDLL(None) if sys.platform == "linux" else None
    if libc is None or not (hasattr(libc, "mallopt") and hasattr(libc, "malloc_trim")):
        yield
        return
    libc.mallopt(_M_MMAP_THRESHOLD, _MAPPED_FROM)
    libc.mallopt(_M_TRIM_THRESHOLD, _TRIMMED_FROM)
    try:
        yield
    finally:
        libc.mallopt(_M_TRIM_THRESHOLD, _TRIMMED_AFTERWARDS)
        libc.malloc_trim(0)
