"""Parts for a demo without recordings: impellers of the virtual mill, one of them with something concealed in it.

In:  how many parts, a seed, a folder. Out: part folders as a plant would deliver them, and a sealed file with the truth
that no reader of recordings opens.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pido.synthetic.effects import Effect
from pido.synthetic.equip import equip
from pido.synthetic.families import impellers
from pido.synthetic.machine import produce
from pido.synthetic.mills import newer_vertical
from pido.synthetic.write import write_part

CONCEALED = Effect("load_dependent_friction", "x", strength=3.0)
"""A guideway whose lubrication fails under load: the simulation knows nothing of it."""


@dataclass(frozen=True)
class Delivery:
    """Part folders in production order, and where the truth about one of them is sealed."""

    parts: list[Path]
    sealed: Path


def deliver(folder: Path, count: int, seed: int = 0) -> Delivery:
    """`count` impellers of one machine; the one after two thirds of them has the effect, the others have none."""
    mill = newer_vertical()
    courses = mill.plan(impellers(mill.machine, count, seed=seed))
    produced = produce(mill, courses, seed=seed)
    odd = min(2 * count // 3, count - 1)
    effects = equip(mill, courses[odd : odd + 1], [CONCEALED], np.random.default_rng(seed))
    produced[odd] = produce(mill, courses[odd : odd + 1], effects, seed=seed + 1)[0]
    paths = [write_part(part, folder / "parts") for part in produced]
    sealed = folder / "sealed.json"
    truth = {"part": paths[odd].name, "axis": CONCEALED.axis, "mechanism": CONCEALED.id}
    sealed.write_text(json.dumps(truth), encoding="utf-8")
    return Delivery(paths, sealed)
