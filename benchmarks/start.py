"""Start of the command line beside Python's own start.

In:  nothing; a workspace with one finished iteration is written to a temporary folder. Out: rows {work, peer, ratio,
     goal, error}; ratio is the CPU time beyond `python -c pass`, s.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.table import Row, row
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

QUICK = {"repeats": 3}


def run(repeats: int = 9) -> list[Row]:
    """`pido --help` and `pido status`; the smallest of several starts: what a busy machine adds is not theirs."""
    pido = Path(sys.executable).with_name("pido")
    with tempfile.TemporaryDirectory() as folder:
        workspace = Workspace.open(folder)
        Ledger(workspace.ledger).took("0" * 64, "p01", "1" * 64)
        calls = {
            "python": [sys.executable, "-c", "pass"],
            "pido --help": [str(pido), "--help"],
            "pido status": [str(pido), "status", "--workspace", folder],
        }
        taken = {name: [_cpu(call) for _ in range(repeats)] for name, call in calls.items()}
    cpu = {name: min(c for c, _ in times) for name, times in taken.items()}
    wall = {name: min(w for _, w in times) for name, times in taken.items()}
    return [
        row(
            f"`{name}`, s", "Python's own start", cpu[name] - cpu["python"], "<= 0.3", f"wall {wall[name]:.2f} s in all"
        )
        for name in calls
        if name != "python"
    ]


def _cpu(call: list[str]) -> tuple[float, float]:
    """CPU and wall seconds of one start."""

    def used() -> float:
        spent = resource.getrusage(resource.RUSAGE_CHILDREN)
        return spent.ru_utime + spent.ru_stime

    before, start = used(), time.perf_counter()
    subprocess.run(call, check=True, capture_output=True)
    return used() - before, time.perf_counter() - start
