"""Rows that models and equations learn from: inputs, reduced features, currents and where each row came from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np

from pido.core.arrays import Array1D, Float1D, Float2D, Int1D

REAL, PIA, PIE = 0, 1, 2
ORIGINS = ("real", "pia", "pie")


@dataclass(frozen=True, eq=False)
class Samples:
    """n rows.

    inputs : (n, 13), columns and units of `core.columns.INPUTS`
    ar : (n,), mm² – area removal MRR / ||v||, 0 where nothing is removed
    currents : (n, 4), A – in the order of AXES; NaN where an axis was not recorded
    direction : (n, 4) – sign of each axis' last real motion, -1, 0 (not known yet) or +1; needs time order, so it is
        found when a recording becomes samples and carried along
    part : (n,) – digest of the part that the row comes from ('' for PiE rows)
    row : (n,) – row in that part's recording, -1 for PiE rows
    origin : (n,) – REAL, PIA or PIE
    voxel : (n,) – flat index of the bin for which a PiA or PiE row was generated, -1 for real rows
    expected_error : (n, 4), A – expected error of a generated current, 0 for real rows
    """

    inputs: Float2D
    ar: Float1D
    currents: Float2D
    direction: Float2D
    part: Array1D
    row: Int1D
    origin: Int1D
    voxel: Int1D
    expected_error: Float2D

    @classmethod
    def real(
        cls, inputs: Float2D, ar: Float1D, currents: Float2D, direction: Float2D, part: str, row: Int1D
    ) -> Samples:
        """Rows of one recorded part."""
        n = len(inputs)
        return cls(
            inputs=np.asarray(inputs, float),
            ar=np.asarray(ar, float),
            currents=np.asarray(currents, float),
            direction=np.asarray(direction, float),
            part=np.full(n, part, dtype=object),
            row=np.asarray(row, np.int64),
            origin=np.full(n, REAL, np.int64),
            voxel=np.full(n, -1, np.int64),
            expected_error=np.zeros((n, 4)),
        )

    def __len__(self) -> int:
        return len(self.inputs)

    def take(self, which: slice | Array1D) -> Samples:
        """The rows that a slice, mask or index array selects."""
        return replace(self, **{f.name: getattr(self, f.name)[which] for f in fields(self)})

    @staticmethod
    def concat(parts: list[Samples] | tuple[Samples, ...]) -> Samples:
        """All rows, one after another."""
        return Samples(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Samples)})

    @property
    def reduced(self) -> Float2D:
        """(n, 3): the reduced feature space M = (v_x mm/s, v_y mm/s, AR mm²) (paper, section III-D)."""
        return np.column_stack([self.inputs[:, 0], self.inputs[:, 1], self.ar])


Train = Callable[[Samples, Float2D], Callable[[Samples], Float2D]]
"""Samples and weights (n, 4) to a predictor of currents (n, 4), A: any model."""
