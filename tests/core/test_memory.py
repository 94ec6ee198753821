"""Freed memory: kept while it is asked for again and again, given back afterwards."""

import subprocess
import sys

import pytest

HELD = 200  # MB
IN_A_PROCESS_OF_ITS_OWN = f"""
import resource
import numpy as np
from pido.core.memory import kept_memory

def resident():  # MB
    with open("/proc/self/statm") as pages:
        return int(pages.read().split()[1]) * resource.getpagesize() / 1e6

def hold_and_free():
    held = [np.ones(1_000_000, np.uint8) for _ in range({HELD})]
    del held

def cleared():  # MB
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    hold_and_free()
    return (resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before) * resource.getpagesize() / 1e6

start = resident()
with kept_memory():
    hold_and_free()
    print(resident() - start, cleared())
print(resident() - start)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="mallopt is a call of Linux's C library")
def test_freed_memory_is_taken_again_without_clearing_and_given_back_afterwards():
    done = subprocess.run([sys.executable, "-c", IN_A_PROCESS_OF_ITS_OWN], capture_output=True, text=True, check=True)
    kept, cleared_again, kept_afterwards = (float(word) for word in done.stdout.split())
    assert kept > HELD / 2
    assert cleared_again < HELD / 10
    assert kept_afterwards < HELD / 10
