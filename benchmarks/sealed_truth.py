"""What all generators of sealed cases say in the same words: task, effect, noise, case, unfair draw, files of a truth.

The truth of a case is `truth.json` and, per part, a table with `effect_<axis>` (A) and `acts_<axis>`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import pandas as pd

from pido.core.arrays import Array1D, Bool1D, Float1D
from pido.core.axes import AXES
from pido.core.errors import PidoError

AnyPart = TypeVar("AnyPart")


class UnfairError(PidoError):
    """A draw that nobody could decide."""


def require_fair(fair: bool, why: str) -> None:
    """UnfairError where a draw is not."""
    if not fair:
        raise UnfairError(why)


@dataclass(frozen=True)
class Task:
    """What to draw; the key names its files and says nothing."""

    group: str
    what: str
    strength: float
    seed: int
    edition: int = 1

    @property
    def key(self) -> str:
        said = f"{self.group}|{self.what}|{self.strength}|{self.seed}"
        said += f"|{self.edition}" if self.edition > 1 else ""  # rows of the first are kept under the key they had
        return hashlib.sha256(said.encode()).hexdigest()[:12]


@dataclass(frozen=True, eq=False)
class Effect:
    """What is concealed. columns : per part (n,), A, at the fine step, without lag; strength : rms over noise"""

    axis: str
    mechanism: str
    kind: str
    columns: Sequence[Float1D]
    parameters: Mapping[str, tuple[float, str]]
    shape: Mapping[str, Any]
    strength: float


@dataclass(frozen=True, eq=False)
class NoiseRows:
    """rows : per part (n,), A, at the samples, before rounding; step : A, of the converter"""

    rows: Sequence[Float1D]
    step: float

    def rms(self, where: Sequence[Bool1D]) -> float:
        """A, of what is not systematic, rounding included, in the samples that masks of the first parts select."""
        held = np.concatenate([r[w] for r, w in zip(self.rows, where, strict=False)])
        return float(np.sqrt(np.mean(held**2) + self.step**2 / 12)) if len(held) else 0.0


@dataclass(frozen=True, eq=False)
class Case(Generic[AnyPart]):
    """parts : at the samples, the unseen one last; per axis and part (n,), A: sim, recorded, effect

    rich : whether part.json says all that a plant knows; columns : the optional ones; seed : of what files are given
    """

    task: Task
    parts: Sequence[AnyPart]
    sim: Mapping[str, Sequence[Float1D]]
    recorded: Mapping[str, Sequence[Float1D]]
    effect: Mapping[str, Sequence[Float1D]]
    effects: Sequence[Effect]
    rich: bool
    columns: Sequence[str]
    seed: int


def name_of(k: int) -> str:
    """Of the part with index k.

    >>> name_of(0)
    'p01'
    """
    return f"p{k + 1:02d}"


def write_truth(
    sealed: Path,
    task: Task,
    machine: str,
    effects: Sequence[Effect],
    effect: Mapping[str, Sequence[Float1D]],
    acts: Mapping[str, Sequence[Array1D]],
) -> None:
    """`truth.json` and a table per part, the last one unseen. effect, acts : per axis and part (n,), A and bool"""
    sealed.mkdir(parents=True, exist_ok=True)
    parts = len(effect[AXES[0]])
    for k in range(parts):
        table = {f"effect_{a}": effect[a][k] for a in AXES} | {f"acts_{a}": acts[a][k] for a in AXES}
        pd.DataFrame(table).to_parquet(sealed / f"{name_of(k)}.parquet", index=False)
    said = [
        {
            "axis": e.axis, "mechanism": e.mechanism, "kind": e.kind, "shape": dict(e.shape), "strength": e.strength,
            "parameters": {n: {"value": value, "unit": unit} for n, (value, unit) in e.parameters.items()},
        }
        for e in effects
    ]  # fmt: skip
    truth = {"group": task.group, "what": task.what, "strength": task.strength, "seed": task.seed,
             "machine": machine, "unseen": name_of(parts - 1), "effects": said}  # fmt: skip
    (sealed / "truth.json").write_text(json.dumps(truth, indent=1, ensure_ascii=False, default=float), encoding="utf-8")
