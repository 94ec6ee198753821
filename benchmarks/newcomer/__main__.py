"""Draws sealed cases of the newcomer's machines, asks `pido` blind, opens the truth, and prints what came of it.

python -m benchmarks.newcomer --cases 50 --seed 1 --workers 2 --out out/newcomer
python -m benchmarks.newcomer --cases 50 --seed 1 --from 10 --to 20 --out out/newcomer   some of the same cases
python -m benchmarks.newcomer --cases 50 --seed 1 --draw out/drawn                       only the cases
python -m benchmarks.newcomer --edition 2 --cases 51 --seed 1 --group outside            further machines, one group
python -m benchmarks.newcomer --edition 3 --cases 60 --seed 1 --draw out/drawn           others again
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from benchmarks.newcomer.draw import draw_case
from benchmarks.newcomer.editions import EDITIONS
from benchmarks.newcomer.folders import write_case
from benchmarks.newcomer.planned import plan
from benchmarks.sealed_cases import Generator, command
from benchmarks.sealed_truth import Task


def write(task: Task, folder: Path, sealed: Path) -> list[Path]:
    """The part folders, the unseen one last, and the truth in `sealed`."""
    return write_case(draw_case(task), folder, sealed)


NEWCOMER = Generator(
    "benchmarks.newcomer",
    "twenty-five further kinds of machines, in three editions, that share no formula with them",
    plan,
    write,
    later=tuple(partial(plan, edition=n) for n in EDITIONS if n > 1),
)

if __name__ == "__main__":
    command(NEWCOMER)()
