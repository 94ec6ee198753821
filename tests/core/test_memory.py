"""Freed memory: kept while it is asked for again and again, given back afterwards."""

import resource
import sys

import numpy as np
import pytest

from pido.core.memory import kept_memory

LARGE, TIMES = 1_000_000, 40  # bytes, arrays one after another


def _cleared_pages() -> int:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(TIMES):
        np.ones(LARGE, np.uint8)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


@pytest.mark.skipif(sys.platform != "linux", reason="mallopt is a call of Linux's C library")
def test_arrays_of_the_same_size_take_the_memory_of_those_before_them_while_it_is_kept():
    pages = LARGE // resource.getpagesize()
    with kept_memory():
        assert _cleared_pages() < 3 * pages
    assert _cleared_pages() > TIMES * pages / 2
