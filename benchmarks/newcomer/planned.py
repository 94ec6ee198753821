"""Which cases an examination draws.

In:  how many, a seed, an edition. Out: tasks: hands with every group by its share, and every mechanism of a group in
turn.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TypeVar

import numpy as np

from benchmarks.newcomer.editions import EDITIONS
from benchmarks.sealed_truth import Task

T = TypeVar("T")

STRENGTHS = {"single": (0.5, 1.0, 2.0, 4.0), "clean": (1.0,)}
OTHERWISE = (1.0, 2.0, 4.0)

PAIRLESS = {"external_force", "current_saturation"}
"""Not in a pair: the one hides what stands beside it, the other is made of it."""


def plan(cases: int, seed: int, edition: int = 1) -> list[Task]:
    """Tasks, the first of a longer plan being those of a shorter one."""
    of, also = EDITIONS[edition], [edition] if edition > 1 else []
    rng = np.random.default_rng([seed, 7919, *also])
    whats = {g: _turns(g, of.menu, np.random.default_rng([seed, k, *also])) for k, g in enumerate(of.shares)}
    sizes = {**STRENGTHS, **of.strengths}
    strengths = {g: _cycle(sizes.get(g, OTHERWISE), np.random.default_rng([seed, 50 + k, *also]))
                 for k, g in enumerate(of.shares)}  # fmt: skip
    tasks: list[Task] = []
    while len(tasks) < cases:
        hand = [g for g, n in of.shares.items() for _ in range(n)]
        for g in rng.permutation(hand):
            group = str(g)
            tasks.append(Task(group, next(whats[group]), next(strengths[group]), int(rng.integers(2**31)), edition))
    return tasks[:cases]


def _turns(group: str, menu: Mapping[str, tuple[str, ...]], rng: np.random.Generator) -> Iterator[str]:
    if group != "pair":
        yield from _cycle(menu[group], rng)
    if " and " in menu["pair"][0]:
        yield from _cycle(menu["pair"], rng)
    names = tuple(n for n in menu["pair"] if n not in PAIRLESS)
    one, two = _cycle(names, rng), _cycle(names, rng)
    while True:
        first, second = next(one), next(two)
        yield f"{first} and {second if second != first else next(two)}"


def _cycle(of: tuple[T, ...], rng: np.random.Generator) -> Iterator[T]:
    """Each in turn, in a new order every time round."""
    while True:
        for k in rng.permutation(len(of)):
            yield of[int(k)]
