"""A part program: one kind of work after the other until the time is filled.

In:  a machine, the size of a workpiece, a random generator. Out: a `Path`: straight steps, each of one operation.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.newcomer import toolpaths
from benchmarks.newcomer.machines import Machine
from benchmarks.newcomer.second import toolpaths as second
from benchmarks.newcomer.third import toolpaths as third
from benchmarks.newcomer.toolpaths import SAFE, Job, Operation, Path
from pido.core.arrays import Float1D

WORK: Mapping[str, Job] = {**toolpaths.JOBS, **second.JOBS, **third.JOBS}


BORES = ("drill", "peck")
"""Work in which the infeed cuts."""


def draw_path(machine: Machine, size: Float1D, seconds: float, straight: bool, rng: np.random.Generator) -> Path:
    """Operations of the machine's kind until the time is filled. size : (2,), mm; straight : all along one line"""
    path = Path([np.array([0.0, 0.0, SAFE * float(size.max())])])
    jobs = ["lines"] if straight else list(rng.permutation(machine.kind.jobs))
    k = 0
    while not path.feeds or path.seconds() < seconds:
        name = jobs[k % len(jobs)]
        path.operations.append(_operation(machine, name, straight, rng))
        first = len(path.rests)
        WORK[name](path, size, machine, rng)
        if len(path.rests) > first:
            path.rests[first] += float(rng.uniform(0.5, 1.5)) + 0.6 * machine.kind.run_up_s
        k += 1
    return path


def _operation(machine: Machine, name: str, straight: bool, rng: np.random.Generator) -> Operation:
    """Cutting data of one operation: feed, speed and depths of a kind of work."""
    kind = machine.kind
    low, high = kind.feeds_mm_s
    cutter = int(rng.choice(list(machine.cutters)))
    d = machine.cutters[cutter].diameter_mm
    feed = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    rpm = float(np.exp(rng.uniform(*np.log(kind.rpm))))
    a_p = d * float(rng.uniform(0.04, 0.25))
    a_e = d * float(rng.uniform(0.15, 0.95))
    if name == "engrave":
        feed, a_p, a_e = max(0.5 * low, 0.3 * feed), 0.03 * d, 0.3 * d
    if name in BORES:
        feed, a_e = max(0.4 * low, 0.15 * feed), min(d, 12.0)
    if name == "creep":
        feed = low * float(rng.uniform(0.05, 0.4))
    feed = min(feed, 0.4 * float(machine.v_max.min()))
    if name not in ("creep", "air"):  # a tooth takes no more than a quarter of a millimetre
        per_tooth = 0.25 * machine.cutters[cutter].teeth / 60
        rpm = float(np.clip(feed / per_tooth, rpm, kind.rpm[1]))
        feed = min(feed, per_tooth * rpm)
    coolant = bool(rng.random() < 0.5)
    return Operation(cutter, round(feed, 3), round(rpm), round(a_p, 3), round(a_e, 3), coolant, name in BORES,
                     bool(rng.random() < 0.6))  # fmt: skip
