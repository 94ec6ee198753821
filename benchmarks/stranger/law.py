"""The world that an effect is hidden in, and what an effect is: a column per part that an amplitude multiplies."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.stranger.parts import Part
from pido.core.arrays import Float1D

Columns = list[Float1D]


@dataclass(frozen=True, eq=False)
class World:
    """parts : all, the unseen one last; sim : per axis the simulated current of each part (n,), A, before any lag"""

    parts: Sequence[Part]
    sim: Mapping[str, Columns]

    @property
    def shown(self) -> Sequence[Part]:
        return self.parts[:-1]

    def each(self, of: Callable[[Part], Float1D]) -> Columns:
        return [of(p) for p in self.parts]


@dataclass(frozen=True, eq=False)
class Law:
    """columns : per part (n,), per unit of the amplitude
    scaled : name -> (value per amplitude, unit); fixed : name -> (value, unit); shape : what is not comparable
    """

    columns: Columns
    scaled: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    fixed: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    shape: Mapping[str, Any] = field(default_factory=dict)


Draw = Callable[[World, str, np.random.Generator], Law]
