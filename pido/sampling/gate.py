"""Which generated rows are let through, axis by axis.

In:  leverage and expected error of generated currents, the same of the samples that the equation was fitted on, and how
     wrong equation and model are in each region on samples that neither had seen.
Out: a reason to refuse per row and axis, or none.

Density of rows is not support: where all near samples move along x, an equation says nothing about the diagonal,
however many they are. Measured on two real machines, equations without a gate made models up to 60 % worse there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Float1D, Float2D, Float3D, Int2D
from pido.core.axes import AXES
from pido.core.errors import FitError
from pido.core.machining import Machine

PASSED, NO_SUPPORT, WORSE_THAN_MODEL, BEYOND_DRIVE, NOT_RECORDED = range(5)
REASONS = ("passed", "no support", "worse than the model", "beyond the drive's current", "axis not recorded")


@dataclass(frozen=True)
class Gate:
    """Rules for generated rows.

    quantile : a row may have at most the leverage that this share of the fitted samples has; None: no such rule
    compare : whether the equation must be better than the model in the region, on held-out samples
    margin : the equation's error must be below margin times the model's
    """

    quantile: float | None = 0.95
    compare: bool = True
    margin: float = 0.9

    def __post_init__(self) -> None:
        if self.quantile is not None and not 0 < self.quantile <= 1:
            raise FitError(f"leverage quantile {self.quantile}: it lies above 0 and up to 1, or is None for no gate.")

    def limits(self, fitted_leverage: Float2D) -> Float1D:
        """(4,): the largest leverage that may pass."""
        if self.quantile is None or not len(fitted_leverage):
            return np.full(4, np.inf)
        return np.quantile(fitted_leverage, self.quantile, axis=0)

    def judge(
        self,
        current: Float2D,
        leverage: Float2D,
        limits: Float1D,
        equation_error: Float3D | None,
        model_error: Float3D | None,
        machine: Machine,
    ) -> Int2D:
        """(n, 4): index into REASONS for each row and axis.

        current, leverage : (n, 4), A and –; limits : (4,)
        equation_error, model_error : (k, n, 4), A – from k circles of held-out rows, the near ones and all; the
            equation has to be better in each, since a handful of near rows can flatter it
        """
        verdict = np.full(current.shape, PASSED, np.int64)
        most = np.array([machine.current_max_a.get(axis, np.inf) for axis in AXES])
        verdict[np.abs(current) > most] = BEYOND_DRIVE
        if self.compare and equation_error is not None and model_error is not None:
            # no evidence on either side is no reason to trust the equation
            better = (equation_error < self.margin * model_error) & np.isfinite(equation_error)
            verdict[~better.all(axis=0)] = WORSE_THAN_MODEL
        verdict[leverage > limits] = NO_SUPPORT
        verdict[~np.isfinite(current)] = NOT_RECORDED
        return verdict


OPEN = Gate(quantile=None, compare=False)
"""Everything passes but what the drive cannot do: the paper."""
