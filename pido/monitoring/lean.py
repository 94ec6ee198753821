"""What a model is wrong by in proportion to what goes on: on a part unlike those before, forests stay where they were.

In:  window means of held-out residuals of several parts, and the means of model inputs and prediction over the windows.
Out: the residual to be expected in a state, A, linear in it; nothing where that does not help on parts left out.

Trees cannot extrapolate: under a load that no part had so far they are wrong by about the missing load, which no width
of a band tells from a change of the load. A linear law found on the parts that were left out takes most of that away,
wherever the current is near to linear in load and speed, as the spindle's is. Ridge regression on standardised columns;
its strength, and whether it is used at all, is decided by parts that were not in the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Float1D, Float2D

LEAST_PARTS = 3
"""Fewer cannot say whether what was learnt on parts holds on another."""
STRENGTHS = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)
"""Of the ridge, as shares of the number of rows."""
WORTH = 0.8
"""The mean size of what is left on a part that was not in the fit has to fall below this share of what was there."""


@dataclass(frozen=True, eq=False)
class Lean:
    """Residual by state: `offset + (means - centre) / unit @ slope`, A."""

    centre: Float1D
    unit: Float1D
    slope: Float1D
    offset: float

    def __call__(self, means: Float2D) -> Float1D:
        """(n,): means : (n, d); rows with NaN give NaN"""
        return self.offset + (means - self.centre) / self.unit @ self.slope


def strength_of(parts: Sequence[tuple[Float2D, Float1D]]) -> float | None:
    """Strength of the ridge that leaves least on parts that were not in the fit; None where none is worth it.

    parts : per part the windows' means (m, d) and mean residuals (m,)
    """
    known = [_finite(*part) for part in parts]
    if len(known) < LEAST_PARTS:
        return None
    left = np.zeros(len(STRENGTHS))
    before = 0.0
    for k, (means, residual) in enumerate(known):
        others = [part for j, part in enumerate(known) if j != k]
        if not len(residual) or not any(len(r) for _, r in others):
            continue
        before += float(np.mean(np.abs(residual)))
        for i, strength in enumerate(STRENGTHS):
            left[i] += float(np.mean(np.abs(residual - fit_lean(others, strength)(means))))
    best = int(np.argmin(left))
    return STRENGTHS[best] if left[best] < WORTH * before else None


def fit_lean(parts: Sequence[tuple[Float2D, Float1D]], strength: float) -> Lean:
    """The law on these parts, each with the same weight, however long it was."""
    known = [part for part in (_finite(*part) for part in parts) if len(part[1])]
    means, residual = np.vstack([m for m, _ in known]), np.concatenate([r for _, r in known])
    weight = np.concatenate([np.full(len(r), 1.0 / len(r)) for _, r in known]) / len(known)
    centre = weight @ means
    unit = np.sqrt(weight @ (means - centre) ** 2)
    unit = np.where(
        unit > 1e-9 * np.maximum(np.abs(centre), 1.0), unit, np.inf
    )  # a column that stood still says nothing
    columns = (means - centre) / unit
    offset = float(weight @ residual)
    gram = columns.T @ (weight[:, None] * columns) + strength * np.eye(columns.shape[1])
    return Lean(centre, unit, np.linalg.solve(gram, columns.T @ (weight * (residual - offset))), offset)


def _finite(means: Float2D, residual: Float1D) -> tuple[Float2D, Float1D]:
    known = np.isfinite(means).all(axis=1) & np.isfinite(residual)
    return means[known], residual[known]
