"""The data set for the coming part: real samples, balanced by PiA and PiE rows in its bins (paper, section III-F).

In:  real samples, the bins that the coming part needs, equations fitted on those samples, how many to add.
Out: generated rows only, each with origin, bin, source row and expected error; and a report, bin by bin.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np

from pido.core.arrays import Float2D, Float3D, Int1D, Int2D
from pido.core.axes import AXES
from pido.core.errors import FitError
from pido.core.machining import Machine
from pido.core.samples import PIA, PIE, Samples
from pido.feature_space.density import locate, occupancy
from pido.feature_space.grid import SAMPLING_GRID, Grid
from pido.feature_space.regional import HeldOut
from pido.sampling.gate import NOT_RECORDED, OPEN, PASSED, REASONS, Gate
from pido.sampling.inputs import ForceModel, draw_inputs
from pido.sampling.shares import ShareRule

log = logging.getLogger(__name__)


class Equations(Protocol):
    """What generates currents: `LocalEquations`, `AxisEquations`, or any model that knows its own support."""

    @property
    def machine(self) -> Machine: ...

    def predict_with_support(self, samples: Samples) -> tuple[Float2D, Float2D, Float2D]: ...


@dataclass(frozen=True, eq=False)
class Report:
    """What was asked for and what came of it, per bin (b,), ascending.

    asked_pia, asked_pie : rows that the share rule wants; pia, pie : rows that lie there, with at least one current
    refused : (5, 4) – generated currents per reason (`gate.REASONS`) and axis
    elsewhere : PiA and PiE rows in no bin of the coming part
    """

    bins: Int1D
    real: Int1D
    asked_pia: Int1D
    asked_pie: Int1D
    pia: Int1D
    pie: Int1D
    refused: Int2D
    elsewhere: tuple[int, int] = (0, 0)

    def counting(self, generated: Samples) -> Report:
        """The same with these rows as what came of it."""
        pia, pie = (occupancy_of(generated, origin, self.bins) for origin in (PIA, PIE))
        pia_all, pie_all = (int((generated.origin == origin).sum()) for origin in (PIA, PIE))
        return replace(self, pia=pia, pie=pie, elsewhere=(pia_all - int(pia.sum()), pie_all - int(pie.sum())))

    def summary(self) -> str:
        """One line per origin, one per reason and axis that refused anything."""
        lines = [f"{len(self.bins)} bins, {self.real.sum()} real samples in them"]
        kinds = (("PiA", self.asked_pia, self.pia), ("PiE", self.asked_pie, self.pie))
        for (name, asked, made), beside in zip(kinds, self.elsewhere, strict=True):
            more = f", and {beside} in bins that the coming part does not go through" if beside else ""
            lines.append(f"{name}: {asked.sum()} asked for, {made.sum()} let through{more}")
        for reason, counts in zip(REASONS[1:], self.refused[1:], strict=True):
            if counts.any():
                lines.append(f"{reason}: " + ", ".join(f"{a} {n}" for a, n in zip(AXES, counts, strict=True) if n))
        return "\n".join(lines)


def optimise(
    real: Samples,
    needed: Int1D,
    equations: Equations,
    share: ShareRule,
    grid: Grid = SAMPLING_GRID,
    *,
    rng: np.random.Generator,
    gate: Gate = OPEN,
    equation_error: HeldOut | None = None,
    model_error: HeldOut | None = None,
    planned: Samples | None = None,
    forces: ForceModel | None = None,
    nuisance: Literal["joint", "paper", "planned"] = "joint",
) -> tuple[Samples, Report]:
    """PiA and PiE rows for the bins `needed` (ids of `grid`).

    equations : fitted on `real`
    equation_error, model_error : errors of equation and model on held-out rows, for a gate that compares them
    planned : inputs of the coming part where they are known (NC program, simulation); PiE rows then take spindle
        speed, v_z, accelerations and forces from it where it visits the bin
    A current that the gate refuses is NaN, so that only its own axis' model misses it; a row without any is left out.
    Same arguments and generator state: same rows, in whatever order `real` holds its parts.
    """
    machine = equations.machine
    real = real.take(np.lexsort((real.row, real.part.astype(str))))  # the order of arrival must not matter
    bins = np.unique(np.asarray(needed, np.int64))
    ids = grid.ids(real.reduced)
    n_real = occupancy(real.reduced, grid).count_in(bins) if len(real) else np.zeros(len(bins), np.int64)
    n_pia, n_pie = share.wanted(n_real, rng)
    augmented = _pia(real, ids, bins, n_pia, rng)
    source = real
    if planned is not None and len(planned):
        source = planned if nuisance == "planned" else Samples.concat([planned, real])
    elif nuisance == "planned":
        raise FitError("nuisance 'planned' takes rows of the planned path: give `planned`, or use 'joint'.")
    explored, _ = draw_inputs(bins, n_pie, grid, source, machine, rng, nuisance=nuisance, forces=forces)
    rows = Samples.concat([augmented, explored])
    current, standard_error, leverage = equations.predict_with_support(rows)
    occupied = (n_real > 0)[locate(bins, rows.voxel)[1]] if len(rows) else np.zeros(0, bool)
    expected = _at_rows(equation_error, rows.voxel, occupied, grid)
    rival = _at_rows(model_error, rows.voxel, occupied, grid)
    limits = np.full(4, np.inf) if gate.quantile is None else gate.limits(equations.predict_with_support(real)[2])
    verdict = gate.judge(current, leverage, limits, expected, rival, machine)
    near = np.zeros_like(current) if expected is None else np.where(np.isfinite(expected[0]), expected[0], 0.0)
    error = np.hypot(standard_error, near)
    passed = verdict == PASSED
    rows = replace(rows, currents=np.where(passed, current, np.nan), expected_error=np.where(passed, error, np.nan))
    generated = rows.take(passed.any(axis=1))
    refused = np.stack([(verdict == reason).sum(axis=0) for reason in range(NOT_RECORDED + 1)])
    none = np.zeros(len(bins), np.int64)
    report = Report(bins, n_real, n_pia, n_pie, none, none, refused).counting(generated)
    log.info("%s", report.summary())
    return generated, report


def occupancy_of(samples: Samples, origin: int, bins: Int1D) -> Int1D:
    """(b,): rows of one origin in each of `bins` (ascending)."""
    found, at = locate(bins, samples.voxel[samples.origin == origin])
    return np.bincount(at[found], minlength=len(bins))


def _pia(real: Samples, ids: Int1D, bins: Int1D, number: Int1D, rng: np.random.Generator) -> Samples:
    """`number` rows of each bin, drawn without replacement: a random order within the bin, its first rows."""
    found, at = locate(bins, ids)
    rows = np.flatnonzero(found)
    order = rows[np.lexsort((rng.random(len(rows)), at[rows]))]
    of = at[order]
    first = np.searchsorted(of, np.arange(len(bins)))
    take = order[np.arange(len(order)) - first[of] < number[of]] if len(order) else order
    chosen = real.take(take)
    return replace(chosen, origin=np.full(len(take), PIA, np.int64), voxel=ids[take])


def _at_rows(errors: HeldOut | None, voxel: Int1D, occupied: np.ndarray, grid: Grid) -> Float3D | None:
    """(2, n, 4): held-out error around each row's bin, and over all rows in the same position."""
    if errors is None:
        return None
    bins, first, inverse = np.unique(voxel, return_index=True, return_inverse=True)
    return np.stack([errors.at(bins, occupied[first], grid)[inverse], errors.rmse()[occupied.astype(int)]])
