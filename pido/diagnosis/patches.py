"""What acts where two axes stand within a rectangle, as a dented cover, a worn spot of a table or a cable that catches
there does: a model without a name.

In:  the residual of one axis with its noise, and the recorded quantities. Out: `Patch` terms worth a closer look.
All rectangles of a grid are compared at once, from sums over its cells; the best again on finer grids around it.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pido.core.arrays import Float1D, Float2D, Int1D
from pido.core.axes import LINEAR_AXES
from pido.diagnosis.formulas import FORMS, Unnamed, ampere_per, unit_of, written
from pido.diagnosis.judge import WORTH, Judge
from pido.diagnosis.mechanisms.base import Parameter, column, up_to_edge
from pido.diagnosis.mechanisms.hard_zone import over_rectangles
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.signals import Known, signals
from pido.diagnosis.state import AxisState
from pido.diagnosis.terms import Term

_CELLS = 15  # of a grid, along each of its places
_FINER = 2  # grids, each within a cell of the best rectangle of the one before
_LEAST_SHARE, _MOST_SHARE = 0.005, 0.9  # of the rows of a law that are inside
_FEWEST_VISITS, _FEWEST_PARTS = 4, 2
_BEST = 3
_EDGES = ("from_1", "to_1", "from_2", "to_2")
_EVERYWHERE = {  # what a law would be that is not confined: by the quantity that it is in proportion to, and its form
    ("", "u"): "gravity_load",
    ("v_{}", "sgn u"): "coulomb_friction",
    ("held_{}", "u"): "coulomb_friction",
    ("v_{}", "u"): "viscous_friction",
    ("v_sp", "u"): "spindle_viscous_drag",
    ("M_sp", "u"): "spindle_torque_load",
}


@dataclass(frozen=True)
class Patch(Unnamed):
    """dI = k * p(u) inside a rectangle of two places, of no u: k there.

    places : two signals, mm, in the machine's coordinates
    shape : where the rectangle begins and ends along the one, and along the other
    """

    places: tuple[str, str]
    signal: str = ""
    unit: str = "–"
    form: str = "u"

    shape: ClassVar[tuple[Parameter, ...]] = tuple(Parameter(name, "mm") for name in _EDGES)

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({*self.places, self.signal} - {""})

    @property
    def equation(self) -> str:  # type: ignore[override]
        law = f"k * {written(self.signal, self.form)}" if self.signal else "k"
        inside = " and ".join(f"from_{i} < {place} < to_{i}" for i, place in enumerate(self.places, 1))
        return f"dI = {law} where {inside}, else 0"

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        return (Parameter("k", ampere_per(unit_of([(self.unit, self.form)]))),)

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        ends = [(place, *edges) for place, edges in zip(self.places, _pairs(shape), strict=True)]
        where = " and ".join(f"{place} from {low:.4g} to {high:.4g}" for place, low, high in ends)
        with_it = f"with {written(self.signal, self.form)}, " if self.signal else ""
        return f"{with_it}within {where}", tuple(f"{low:.4g} < {place} < {high:.4g}" for place, low, high in ends)

    def without_limits(self, axis: str) -> str:
        own = self.signal if axis == "sp" else self.signal.replace(f"_{axis}", "_{}")
        return _EVERYWHERE.get((own, self.form), "")

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        return self.over(signals(state, self.reads), shape)

    def over(self, known: Known, shape: Mapping[str, float]) -> Float2D:
        """(n, 1) – what the amplitude counts for, at values of the quantities."""
        out = FORMS[self.form](known[self.signal][0]) if self.signal else np.ones(len(known[self.places[0]][0]))
        for place, (low, high) in zip(self.places, _pairs(shape), strict=True):
            half = max((high - low) / 2, 1e-9)
            far = np.abs(known[place][0] - (low + high) / 2) / half
            out = out * up_to_edge(far)
        return column(out)

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        low, high = _pairs(shape)[_EDGES.index(name) // 2]
        return shape[name] - 0.3 * (high - low), shape[name] + 0.3 * (high - low)

    def moved(self, shape: Mapping[str, float], by: Float1D) -> dict[str, float]:
        """The shape a step away, each edge in tenths of the width."""
        widths = np.repeat([high - low for low, high in _pairs(shape)], 2)
        steps = 0.1 * np.clip(by, -4, 4) * widths
        return {name: float(shape[name] + step) for name, step in zip(_EDGES, steps, strict=True)}


def patch_terms(judge: Judge, known: Known) -> list[Term]:
    """What takes away most of the whitened rows of a residual, the best of each law.

    known : `common_signals` of the mismatch
    """
    axis, found = judge.mismatch.axis, []
    whitening, wanted = judge.noise.matrix(), judge.felt[0]
    for signal, form in _carriers(axis, known):
        u = FORMS[form](known[signal][0]) if signal else np.ones(judge.mismatch.n)
        # What changes slowly feels the noise as it would if it acted everywhere.
        felt = np.array([u * wanted, u * (whitening.T @ (whitening @ u)), u != 0])
        for names in itertools.combinations([f"pos_{a}" for a in LINEAR_AXES if f"pos_{a}" in known], 2):
            # Along the axis' own travel alone, such laws have a name.
            limited = [name != f"pos_{axis}" for name in names]
            gain, edges = _best_rectangle(felt, [known[name][0] for name in names], limited)
            if gain > WORTH and _visited(judge.mismatch, [known[name][0] for name in names], edges):
                law = Patch(names, signal, known[signal][1] if signal else "–", form)
                found.append(Term(law, tuple(zip(_EDGES, edges, strict=True))))
    return judge.ranked(found)[:_BEST]


def _visited(mismatch: Mismatch, places: Sequence[Float1D], edges: Sequence[float]) -> bool:
    """Whether a rectangle was entered several times, in several parts where there are: what is met once may as well
    have happened then."""
    (x, y), (left, right, low, high) = places, edges
    inside = (x > left) & (x < right) & (y > low) & (y < high)
    visits = [
        int(np.sum(inside[i:j] & ~np.r_[False, inside[i : j - 1]])) for i, j in itertools.pairwise(mismatch.edges)
    ]
    return sum(visits) >= _FEWEST_VISITS and sum(v > 0 for v in visits) >= min(len(visits), _FEWEST_PARTS)


def _carriers(axis: str, known: Known) -> list[tuple[str, str]]:
    """Signals and forms: none, for a load by itself; frictions, held at rest or none there; a torque on the spindle."""
    speed = f"v_{axis}"
    offered = [("", "u"), (speed, "sgn u"), (speed, "u"), (f"held_{axis}", "u")]
    offered += [("M_sp", "u")] if axis == "sp" else []
    return [(name, form) for name, form in offered if not name or name in known]


def _best_rectangle(
    felt: Float2D, places: Sequence[Float1D], limited: Sequence[bool]
) -> tuple[float, tuple[float, ...]]:
    """About what the best rectangle takes away beside one size for all rows, and its edges.

    felt : (3, n), products of the law with the residual and with itself, whitened, and whether it acts
    limited : which places a rectangle has to limit
    """
    whole = [(float(p.min()), float(p.max())) for p in places]
    spans, best, edges = whole, 0.0, ()
    for _ in range(1 + _FINER):
        grids = [np.linspace(low, high, _CELLS + 1) for low, high in spans]
        at = [np.searchsorted(g[1:-1], p, side="right") for g, p in zip(grids, places, strict=True)]
        there = np.all([(p >= g[0]) & (p <= g[-1]) for g, p in zip(grids, places, strict=True)], axis=0)
        gains, first, last = _gains(felt[:, there], (at[0] * _CELLS + at[1])[there], felt.sum(axis=1))
        for k, (grid, (low, high)) in enumerate(zip(grids, whole, strict=True)):
            if limited[k]:
                unlimited = (grid[first] <= low) & (grid[last] >= high)
                gains[(slice(None), unlimited) if k else unlimited] = 0.0
        i, j = np.unravel_index(int(np.argmax(gains)), gains.shape)
        if gains[i, j] <= best:
            break
        ends = [(float(grid[first[k]]), float(grid[last[k]])) for grid, k in zip(grids, (i, j), strict=True)]
        best, edges = float(gains[i, j]), tuple(itertools.chain(*ends))
        spans = [_around(*e, float(g[1] - g[0]), w) for g, e, w in zip(grids, ends, whole, strict=True)]
    return best, _open_ended(edges, whole)


def _gains(felt: Float2D, cell: Int1D, always: Float1D) -> tuple[Float2D, Int1D, Int1D]:
    """(k, k) – gain of each rectangle of cells, by its ends along the one place and along the other; those ends, (k,)
    cells each. always : sums of `felt` over all rows"""
    (inner, own, rows), first, last = over_rectangles(cell, felt, _CELLS)
    share, there = own / max(always[1], 1e-300), rows / max(always[2], 1.0)
    left = own * (1.0 - share)
    met = (there > _LEAST_SHARE) & (there < _MOST_SHARE) & (share > _LEAST_SHARE) & (share < _MOST_SHARE)
    return np.where(met, (inner - share * always[0]) ** 2 / np.where(met, left, 1.0), 0.0), first, last


def _around(low: float, high: float, step: float, whole: tuple[float, float]) -> tuple[float, float]:
    """A cell beyond the edges of a rectangle, within all that is travelled."""
    return max(whole[0], low - step), min(whole[1], high + step)


def _open_ended(edges: Sequence[float], whole: Sequence[tuple[float, float]]) -> tuple[float, ...]:
    """Where a rectangle ends with what is travelled, it ends beyond: no edge of it was seen there."""
    out = list(edges)
    for k, (low, high) in enumerate(whole if edges else ()):
        beyond = 0.1 * (high - low)
        out[2 * k] -= beyond * (out[2 * k] <= low)
        out[2 * k + 1] += beyond * (out[2 * k + 1] >= high)
    return tuple(out)


def _pairs(shape: Mapping[str, float]) -> tuple[tuple[float, float], tuple[float, float]]:
    return (shape["from_1"], shape["to_1"]), (shape["from_2"], shape["to_2"])
