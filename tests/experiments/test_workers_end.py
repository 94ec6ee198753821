"""Workers of an experiment whose process was killed end as well."""

import os
import signal
import subprocess
import sys
import time

KILLED_LATER = """
import multiprocessing, os, time
from concurrent.futures import ProcessPoolExecutor
from pido.experiments import runner

if __name__ == "__main__":
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn"), runner._hold, ("importance", None, 0)) as pool:
        pids = set()
        while len(pids) < 2:
            pids |= set(pool.map(slow, range(4)))
        print(*pids, flush=True)
        time.sleep(600)
"""
SLOW = """
import os, time

def slow(_):
    time.sleep(0.2)
    return os.getpid()
"""
LONGEST_S = 60.0


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_workers_do_not_outlive_a_process_that_was_killed(tmp_path):
    (tmp_path / "work.py").write_text(SLOW)
    script = tmp_path / "experiment.py"
    script.write_text("from work import slow\n" + KILLED_LATER)
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True, cwd=tmp_path) as process:
        assert process.stdout is not None
        pids = [int(pid) for pid in process.stdout.readline().split()]
        assert len(pids) == 2
        assert all(map(alive, pids))
        process.send_signal(signal.SIGKILL)
    until = time.monotonic() + LONGEST_S
    while any(map(alive, pids)) and time.monotonic() < until:
        time.sleep(0.1)
    assert not any(map(alive, pids))
