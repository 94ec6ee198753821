"""Effects that act only in a part of the reduced space M = (v_x, v_y, AR): a greedy search for the box.

In:  the most promising mechanisms of one step of the selection.
Out: the same mechanism confined to a box, where that explains clearly more than any mechanism acting everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pido.core.arrays import Float1D
from pido.diagnosis.select import Basis, Library, Score
from pido.diagnosis.terms import Gate, gate_variable

VARIABLES = ("v_x", "v_y", "AR")
_THRESHOLDS = 9  # quantiles that are tried per variable; the best is refined
_FEW_LIMITS = 3  # of a first box; only the best is given more
_LEAST_SHARE = 0.02  # of the rows must lie on either side of a limit
CLEARLY = 15.0  # BIC by which a box must beat the best mechanism that acts everywhere


def best_region(library: Library, current: Basis, shortlist: Sequence[Score]) -> Score | None:
    """The best confined version of any mechanism of `shortlist`, or None."""
    variables = {v: values for v in VARIABLES if (values := _values(library, v)) is not None}
    best: Score | None = None
    for score in shortlist:
        found = _grow(library, current, score, variables, _FEW_LIMITS)
        if found is not None and (best is None or found.bic < best.bic):
            best = found
    return None if best is None else _grow(library, current, best, variables, 2 * len(variables))


def _grow(library: Library, current: Basis, score: Score, variables: dict[str, Float1D], most: int) -> Score | None:
    """Limits added one by one while each is worth it."""
    best = score
    while len(best.term.gates) < most:
        step = _one_limit(library, current, best, variables)
        if step is None or step.bic > best.bic - CLEARLY / 2:
            break
        best = _sharpen(library, current, step, variables)
    return best if best.term.gates else None


def _one_limit(library: Library, current: Basis, score: Score, variables: dict[str, Float1D]) -> Score | None:
    best = None
    sides = {(g.variable, bool(np.isfinite(g.low))) for g in score.term.gates}
    for variable, values in variables.items():
        for threshold in _grid(values):
            for gate in (Gate(variable, low=threshold), Gate(variable, high=threshold)):
                if (variable, bool(np.isfinite(gate.low))) not in sides:
                    best = _better(best, library, current, score, (*score.term.gates, gate))
    return best


def _sharpen(library: Library, current: Basis, score: Score, variables: dict[str, Float1D]) -> Score:
    """Each limit moved in ever smaller steps."""
    best = score
    for k, gate in enumerate(score.term.gates):
        grid = np.quantile(variables[gate.variable], np.linspace(0.01, 0.99, 99))
        limit = gate.low if np.isfinite(gate.low) else gate.high
        here = int(np.argmin(np.abs(grid - limit)))
        for at in range(max(0, here - 6), min(len(grid), here + 7), 2):
            moved = replace(gate, low=float(grid[at])) if np.isfinite(gate.low) else replace(gate, high=float(grid[at]))
            gates = (*score.term.gates[:k], moved, *score.term.gates[k + 1 :])
            found = _better(best, library, current, score, gates)
            best = found if found is not None else best
    return best


def _better(
    best: Score | None, library: Library, current: Basis, score: Score, gates: tuple[Gate, ...]
) -> Score | None:
    found = library.score(replace(score.term, gates=gates), current)
    if found is None or (best is not None and found.bic >= best.bic):
        return best
    return found


def _grid(values: Float1D) -> list[float]:
    """Limits worth trying: quantiles, halfway to the next distinct level, so that a constant feed has
    none inside it.
    """
    inner = np.unique(np.quantile(values, np.linspace(_LEAST_SHARE, 1 - _LEAST_SHARE, _THRESHOLDS + 2)))
    span = float(np.ptp(inner))
    if span <= 0:
        return []
    levels = inner[np.r_[True, np.diff(inner) > 0.02 * span]]
    return [float(t) for t in (levels[1:] + levels[:-1]) / 2]


def _values(library: Library, variable: str) -> Float1D | None:
    found = [gate_variable(s, variable) for s in library.mismatch.states]
    if any(v is None for v in found):
        return None
    values = np.nan_to_num(np.concatenate([np.asarray(v, float) for v in found]))
    return values if np.ptp(values) > 0 else None
