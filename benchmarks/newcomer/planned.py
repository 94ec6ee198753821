"""Which cases an examination draws.

In:  how many, a seed. Out: tasks: hands of fifty with every group by its share, and every mechanism of a group in turn.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

import numpy as np

from benchmarks.newcomer.catalogue import MENU
from benchmarks.sealed_truth import Task

T = TypeVar("T")

SHARES = {
    "single": 14,
    "pair": 7,
    "wrong coefficient": 4,
    "data fault": 4,
    "confined to a region": 8,
    "outside the vocabulary": 8,
    "confounded": 2,
    "clean": 3,
}
"""Of fifty cases."""

STRENGTHS = {"single": (0.5, 1.0, 2.0, 4.0), "clean": (1.0,)}
OTHERWISE = (1.0, 2.0, 4.0)

PAIRLESS = {"external_force", "current_saturation"}
"""Not in a pair: the one hides what stands beside it, the other is made of it."""


def plan(cases: int, seed: int) -> list[Task]:
    """Tasks, the first of a longer plan being those of a shorter one."""
    rng = np.random.default_rng([seed, 7919])
    whats = {g: _turns(g, np.random.default_rng([seed, k])) for k, g in enumerate(SHARES)}
    strengths = {g: _cycle(STRENGTHS.get(g, OTHERWISE), np.random.default_rng([seed, 50 + k]))
                 for k, g in enumerate(SHARES)}  # fmt: skip
    tasks: list[Task] = []
    while len(tasks) < cases:
        hand = [g for g, n in SHARES.items() for _ in range(n)]
        for g in rng.permutation(hand):
            group = str(g)
            tasks.append(Task(group, next(whats[group]), next(strengths[group]), int(rng.integers(2**31))))
    return tasks[:cases]


def _turns(group: str, rng: np.random.Generator) -> Iterator[str]:
    if group != "pair":
        yield from _cycle(MENU[group], rng)
    names = tuple(n for n in MENU["pair"] if n not in PAIRLESS)
    one, two = _cycle(names, rng), _cycle(names, rng)
    while True:
        first, second = next(one), next(two)
        yield f"{first} and {second if second != first else next(two)}"


def _cycle(of: tuple[T, ...], rng: np.random.Generator) -> Iterator[T]:
    """Each in turn, in a new order every time round."""
    while True:
        for k in rng.permutation(len(of)):
            yield of[int(k)]
