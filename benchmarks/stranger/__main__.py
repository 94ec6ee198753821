"""Draws sealed cases of the stranger's machines, asks `pido` blind, opens the truth, and prints what came of it.

python -m benchmarks.stranger --cases 50 --seed 1 --workers 2 --out out/stranger
python -m benchmarks.stranger --cases 50 --seed 1 --from 10 --to 20 --out out/stranger   some of the same cases
python -m benchmarks.stranger --cases 50 --seed 1 --draw out/drawn                      only the cases
"""

from __future__ import annotations

from pathlib import Path

from benchmarks.sealed_cases import Generator, command
from benchmarks.sealed_truth import Task
from benchmarks.stranger.cases import draw_case, plan
from benchmarks.stranger.files import write_case


def write(task: Task, folder: Path, sealed: Path) -> list[Path]:
    """The part folders, the unseen one last, and the truth in `sealed`."""
    return write_case(draw_case(task), folder, sealed)


STRANGER = Generator("benchmarks.stranger", "machines that share no formula with them", plan, write)

if __name__ == "__main__":
    command(STRANGER)()
