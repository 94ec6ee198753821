"""Generating samples with a gate beside a loop over rows: `python -m benchmarks.generation`.

Rows of {work, peer, ratio, goal, error}. The peer is SMOTE for regression as `smogn` does it, one row at a time in
Python (nearest neighbours, interpolation of inputs, distance-weighted target); it is timed on some rows and multiplied.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from benchmarks.fits import MACHINE, bins_of, row, samples
from pido.equations.choose import fit_chosen
from pido.feature_space.grid import EQUATION_GRID
from pido.sampling.gate import Gate
from pido.sampling.optimise import optimise
from pido.sampling.shares import ShareRule, fill, nothing


def smote_loop(inputs: np.ndarray, targets: np.ndarray, number: int, rng: np.random.Generator, k: int = 5) -> None:
    """`number` rows, each from a seed row and one of its k nearest neighbours."""
    for _ in range(number):
        seed = int(rng.integers(len(inputs)))
        distance = np.sqrt(((inputs - inputs[seed]) ** 2).sum(axis=1))
        other = int(rng.choice(np.argsort(distance)[1 : k + 1]))
        new = inputs[seed] + rng.random() * (inputs[other] - inputs[seed])
        near, far = np.linalg.norm(new - inputs[seed]), np.linalg.norm(new - inputs[other])
        _ = (far * targets[seed] + near * targets[other]) / (near + far)


QUICK = {"number": 10_000, "bins": 200, "real": 5_000}


def run(number: int = 1_000_000, bins: int = 10_000, real: int = 100_000) -> list[dict[str, Any]]:
    data, needed = samples(real), bins_of(bins)
    equations = fit_chosen(data, needed, MACHINE)
    held = np.isin(EQUATION_GRID.ids(data.reduced), needed).sum()
    rule = ShareRule(density=(number + held) / bins, pia=nothing, pie=fill)  # so that `number` rows are asked for
    gate = Gate(quantile=0.95, compare=False)
    optimise(data, needed[:50], equations, rule, EQUATION_GRID, rng=np.random.default_rng(0), gate=gate)  # compiles
    start = time.perf_counter()
    made, report = optimise(data, needed, equations, rule, EQUATION_GRID, rng=np.random.default_rng(0), gate=gate)
    seconds = time.perf_counter() - start
    asked = int(report.asked_pie.sum())
    start = time.perf_counter()
    smote_loop(data.inputs[:28_000], data.currents[:28_000], 20, np.random.default_rng(0))
    peer = (time.perf_counter() - start) / 20 * asked
    what = f"{asked} PiE rows in {bins} bins, gate on"
    return [
        row(f"{what}, s", "–", seconds, "<= 10", f"{len(made)} let through"),
        row(what, "SMOTE for regression, row by row on 28 000 rows (extrapolated)", peer / seconds, ">= 100", "–"),
    ]


if __name__ == "__main__":
    for line in run():
        print(f"{line['ratio']:>10.4g}  goal {line['goal']:<8} {line['work']} | {line['peer']} | {line['error']}")
