"""What a model is trained and tested on, step by step, as data become more (paper, section VII-B.2, algorithms 4, 5).

In:  a fleet, a scenario, the number of a repeat. Out: the steps of that repeat, each a training and a test set.

Scenario 1: one set to train on and one to test on, drawn at random; the first is added in steps of 10 %. The paper does
not say which 10 %: the first rows in time (a part being made), or a random part of the file; both are run.
Scenario 2: sets in random order; the first k train, the next one tests. It begins with the pair of scenario 1.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Bool1D
from pido.core.errors import SettingsError
from pido.core.samples import Samples
from pido.experiments.data import Fleet
from pido.feature_space.grid import SAMPLING_GRID, Grid

TIME, RANDOM, FILES = "first rows", "random rows", "files"
SCENARIOS = (TIME, RANDOM, FILES)


@dataclass(frozen=True, eq=False)
class Cell:
    """step : percent of the file (scenario 1), or number of files (scenario 2)."""

    step: int
    train: Samples
    test: Samples
    trained_on: str
    tested_on: str


def sequence(fleet: Fleet, seed: int, repeat: int) -> list[str]:
    """The sets in the random order of one repeat."""
    names = list(fleet.sets)
    return [names[k] for k in np.random.default_rng([seed, repeat]).permutation(len(names))]


def cells(fleet: Fleet, scenario: str, seed: int, repeat: int, steps: tuple[int, ...]) -> Iterator[Cell]:
    """The steps of one repeat, growing. Same arguments: same cells."""
    order = sequence(fleet, seed, repeat)
    if scenario == FILES:
        for k in steps:
            if k < len(order):
                yield Cell(k, fleet.samples(order[:k]), fleet.sets[order[k]], ", ".join(order[:k]), order[k])
        return
    if scenario not in (TIME, RANDOM):
        raise SettingsError(f"scenario '{scenario}': known are {', '.join(SCENARIOS)}.")
    whole, test = fleet.sets[order[0]], fleet.sets[order[1]]
    rows = np.arange(len(whole))
    if scenario == RANDOM:
        rows = np.random.default_rng([seed, repeat, 1]).permutation(len(whole))
    for percent in steps:
        part = np.sort(rows[: max(1, round(percent / 100 * len(whole)))])
        yield Cell(percent, whole.take(part), test, order[0], order[1])


def reduced(samples: Samples, limit: float, rng: np.random.Generator, grid: Grid = SAMPLING_GRID) -> Samples:
    """At most `limit` rows per bin, drawn at random (the paper's upper limit of 40), in their order."""
    ids = grid.ids(samples.reduced)
    order = np.lexsort((rng.random(len(ids)), ids))
    _, first, count = np.unique(ids[order], return_index=True, return_counts=True)
    place = np.arange(len(ids)) - np.repeat(first, count)
    return samples.take(np.sort(order[place < limit]))


@dataclass(frozen=True)
class Inner:
    """The subspace D of section VII-B.2: AR around its modal value, and slower than the usual feed."""

    ar_low: float
    ar_high: float
    speed: float

    def holds(self, samples: Samples) -> Bool1D:
        speed = np.hypot(samples.inputs[:, 0], samples.inputs[:, 1])
        return (samples.ar >= self.ar_low) & (samples.ar <= self.ar_high) & (speed <= self.speed)


def inner_space(fleet: Fleet) -> Inner:
    """D of these data: [M - s/4, M + s/4] around the mode M of AR with standard deviation s, and a speed of at most
    three quarters of the modal one (6 of 8 mm/s in the paper)."""
    points = np.vstack([samples.reduced for samples in fleet.sets.values()])
    ar, speed = points[:, 2], np.hypot(points[:, 0], points[:, 1])
    mode, spread = _mode(ar), float(np.std(ar))
    return Inner(mode - spread / 4, mode + spread / 4, 0.75 * _mode(speed[speed > 0.1]))


def _mode(values: np.ndarray) -> float:
    """Middle of the fullest of bins 1 wide."""
    if not len(values):
        return 0.0
    low = np.floor(values).astype(np.int64)
    found, count = np.unique(low, return_counts=True)
    return float(found[np.argmax(count)]) + 0.5 if np.ptp(values) > 0 else float(values[0])
