"""How large an error is in a region of the reduced space, judged on samples that the fit had not seen.

In:  held-out errors of samples and where they lie. Out: an error per bin and axis, for bins that hold samples and for
     bins that hold none: an equation or model is worse off where it has to extrapolate, and is judged there by the
     held-out samples that were in the same position.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Bool1D, Float2D, Int1D
from pido.core.samples import Samples
from pido.feature_space.density import locate
from pido.feature_space.grid import SAMPLING_GRID, Grid

_NEIGHBOURS = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Errors on rows that were left out of the fit.

    points : (n, 3) of M; residual : (n, 4), A, NaN where an axis was not recorded
    covered : (n,) – whether the row's bin held samples of the fit
    fold : (n,) – which fit left the row out
    """

    points: Float2D
    residual: Float2D
    covered: Bool1D
    fold: Int1D

    def rmse(self) -> Float2D:
        """(2, 4), A: root mean square error where no sample was near (row 0) and where there were some (row 1).

        Where one of the two never occurred, the other stands for covered rows; for uncovered ones there is no evidence,
        and the error is infinite.
        """
        table = np.vstack([_rms(self.residual[~self.covered]), _rms(self.residual[self.covered])])
        table[1] = np.where(np.isnan(table[1]), _rms(self.residual), table[1])
        return np.where(np.isnan(table), np.inf, table)

    def at(self, bins: Int1D, occupied: Bool1D, grid: Grid = SAMPLING_GRID, at_least: int = 20) -> Float2D:
        """(b, 4), A: error to expect in each bin. Rows of the bin and its 26 neighbours that were in the same position
        (covered or not) decide where there are `at_least` of them, otherwise all rows in that position."""
        result = self.rmse()[np.asarray(occupied, int)]
        square = np.nan_to_num(self.residual**2)
        known = np.isfinite(self.residual)
        for state in (False, True):
            rows, mine = np.flatnonzero(self.covered == state), np.flatnonzero(np.asarray(occupied) == state)
            if not len(rows) or not len(mine):
                continue
            held, inverse = np.unique(grid.ids(self.points[rows]), return_inverse=True)
            sums, counts = np.zeros((len(held), 4)), np.zeros((len(held), 4))
            np.add.at(sums, inverse, square[rows])
            np.add.at(counts, inverse, known[rows])
            around = grid.index(bins[mine])[:, None] + _NEIGHBOURS
            found, place = locate(held, grid.id_of(around.reshape(-1, 3)))
            shape = (len(mine), len(_NEIGHBOURS), 4)
            total = np.where(found[:, None], sums[place], 0.0).reshape(shape).sum(axis=1)
            number = np.where(found[:, None], counts[place], 0.0).reshape(shape).sum(axis=1)
            local = np.sqrt(total / np.maximum(number, 1.0))
            result[mine] = np.where(number >= at_least, local, result[mine])
        return result


def folds(samples: Samples, count: int = 6) -> Int1D:
    """(n,): which of `count` groups leaves each row out. Whole parts where there are at least three of them, else
    contiguous stretches of each part: neighbouring samples are near copies and never fall on both sides."""
    names, part = np.unique(samples.part.astype(str), return_inverse=True)
    if len(names) >= 3:
        return (part % count).astype(np.int64)
    result = np.zeros(len(samples), np.int64)
    for p in range(len(names)):
        rows = np.flatnonzero(part == p)
        order = rows[np.argsort(samples.row[rows], kind="stable")]
        result[order] = np.arange(len(order)) * count // max(len(order), 1)
    return result


def interleaved(samples: Samples, count: int = 3, blocks: int = 24) -> Int1D:
    """(n,): every part cut into `blocks` stretches that take turns: what is left out has neighbours on both sides, as a
    part does that goes where others have been."""
    result = np.zeros(len(samples), np.int64)
    names, part = np.unique(samples.part.astype(str), return_inverse=True)
    for p in range(len(names)):
        rows = np.flatnonzero(part == p)
        order = rows[np.argsort(samples.row[rows], kind="stable")]
        result[order] = np.arange(len(order)) * blocks // max(len(order), 1) % count
    return result


def sectors(samples: Samples, count: int = 8) -> Int1D:
    """(n,): direction of motion in the plane of v_x and v_y, one of `count` sectors; rows at rest are -1. Leaving one
    sector out of a fit shows what the fit is worth in a direction that no part has taken yet."""
    v_x, v_y = samples.inputs[:, 0], samples.inputs[:, 1]
    turn = np.mod(np.arctan2(v_y, v_x) / (2 * np.pi) + 0.5 / count, 1.0)
    rest = np.hypot(v_x, v_y) < 1e-2 * max(float(np.quantile(np.hypot(v_x, v_y), 0.95)) if len(v_x) else 0.0, 1e-9)
    return np.where(rest, -1, np.minimum((turn * count).astype(np.int64), count - 1))


def covered(points: Float2D, others: Float2D, grid: Grid = SAMPLING_GRID) -> Bool1D:
    """(n,): whether the bin of each point holds one of `others`."""
    return locate(np.unique(grid.ids(others)), grid.ids(points))[0]


def join(near: HeldOut, far: HeldOut) -> HeldOut:
    """Covered rows of the one and uncovered rows of the other."""
    a, b = near.covered, ~far.covered
    return HeldOut(
        np.vstack([near.points[a], far.points[b]]),
        np.vstack([near.residual[a], far.residual[b]]),
        np.r_[near.covered[a], far.covered[b]],
        np.r_[near.fold[a], far.fold[b] + near.fold.max(initial=-1) + 1],
    )


def _rms(values: Float2D) -> np.ndarray:
    square, number = np.nansum(values**2, axis=0), np.isfinite(values).sum(axis=0)
    return np.where(number > 0, np.sqrt(square / np.maximum(number, 1)), np.nan)
