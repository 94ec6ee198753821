"""Rows anchored in recorded ones: PiA as delivered, where what has been recorded is thin for the model that learns it.

In:  real rows, a generator of random numbers. Out: PiA rows, each for one axis.

A row lies between a recorded one and one of its nearest, and its current between theirs; where the nearest are far it is
the recorded one with a twentieth of each input's spread added. Rare currents are anchors more often, as in SMOGN (Branco,
Torgo, Ribeiro, PMLR 74, 2017): a run-up of the spindle is a few rows, and a forest with several rows to a leaf draws it
to its surroundings; with rows around it, it does not.

They are made only for a part that goes where rows have been recorded. Where it leaves them, forests that follow a few
rare rows closely carry these anywhere: on virtual mills the spindle's currents of a run-up, a hundred times the error.

What an equation says of the way between two rows so near adds nothing that could be measured on four machines; far from
both, where a term is large, it does harm. Equations speak where nothing was recorded (`pido.sampling.trust`).
"""  # noqa: E501

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from pido.core.arrays import Bool1D, Float2D, Int1D
from pido.core.samples import PIA, Samples
from pido.feature_space.grid import Grid
from pido.sampling.rarity import density, scale_of

PER_ROW = 4
"""Anchored rows per recorded one, while these are few."""
_MOST = 8_000  # anchored rows of an axis: a forest's leaves are as many as its settings allow long before
_NEIGHBOURS = 5
_SHAKE = 0.05  # of each column's spread
_RAREST = 0.1  # of the commonest current's density; what is rarer still is no likelier to be an anchor
_POOL = 20_000  # rows among which neighbours are looked for
_PATH = 2_000  # rows of a path that are asked whether they are near
_FAR = 3.0  # times the distance within which recorded rows have their neighbours
_MOST_FAR = 0.1  # of a path's rows


def anchored(real: Samples, path: Samples, grid: Grid, rng: np.random.Generator) -> Samples:
    """PiA rows around rows of `real` for every axis that was recorded there, in whatever order `real` holds its parts.

    path : the coming part, without a look at its currents; where it leaves what was recorded there are no rows
    A row carries the part and row of its anchor, the bin it lies in, and as expected error what two rows so near differ
    by. Its other currents are NaN.
    """
    real = real.take(np.lexsort((real.row, real.part.astype(str))))
    made = []
    for axis in range(4) if _within(path, real, rng) else ():
        rows = np.flatnonzero(np.isfinite(real.currents[:, axis]))
        if len(rows) > 2 * _NEIGHBOURS:
            made.append(_around(real, rows, axis, grid, rng))
    return Samples.concat(made) if made else real.take(slice(0, 0))


def _within(path: Samples, real: Samples, rng: np.random.Generator) -> bool:
    """Whether nine tenths of the path are about as near to recorded rows as these are to each other."""
    if not len(path) or len(real) <= 2 * _NEIGHBOURS:
        return False
    scale = scale_of(real.inputs)
    some, asked = (
        rows.inputs if len(rows) <= most else rows.inputs[rng.choice(len(rows), most, replace=False)]
        for rows, most in ((real, _POOL), (path, _PATH))
    )
    tree, still = KDTree(some / scale), ~np.isfinite(scale)
    usual = np.quantile(np.asarray(tree.query(some[:_PATH] / scale, k=_NEIGHBOURS + 1)[0])[:, 1:], 0.95)
    constant = real.inputs[0, still]
    far = np.asarray(tree.query(asked / scale)[0]) > _FAR * usual
    far |= (np.abs(asked[:, still] - constant) > 1e-9 * np.maximum(np.abs(constant), 1.0)).any(axis=1)
    return bool(far.mean() <= _MOST_FAR)


def _around(real: Samples, rows: Int1D, axis: int, grid: Grid, rng: np.random.Generator) -> Samples:
    n = min(PER_ROW * len(rows), _MOST)
    chance = 1.0 / np.maximum(density(real.currents[rows, axis]), _RAREST)
    a = rows[rng.choice(len(rows), n, p=chance / chance.sum())]
    scale = scale_of(real.inputs)
    b, near = _neighbour(real.inputs / scale, a, rows, rng)
    s = rng.random(n) * near
    columns = s[:, None]
    shake = _SHAKE * np.where(np.isfinite(scale), scale, 0.0) * rng.normal(size=(n, real.inputs.shape[1]))
    own, other = real.currents[a, axis], real.currents[b, axis]
    currents, error = np.full((n, 4), np.nan), np.full((n, 4), np.nan)
    currents[:, axis] = (1 - s) * own + s * other
    error[:, axis] = np.abs(own - other) / np.sqrt(2)
    rows_made = replace(
        real.take(a),
        inputs=(1 - columns) * real.inputs[a] + columns * real.inputs[b] + np.where(near[:, None], 0.0, shake),
        ar=(1 - s) * real.ar[a] + s * real.ar[b],
        direction=np.where(columns < 0.5, real.direction[a], real.direction[b]),
        origin=np.full(n, PIA, np.int64),
        currents=currents,
        expected_error=error,
    )
    return replace(rows_made, voxel=grid.ids(rows_made.reduced))


def _neighbour(scaled: Float2D, a: Int1D, rows: Int1D, rng: np.random.Generator) -> tuple[Int1D, Bool1D]:
    """One of the nearest `rows` of each of `a`, and whether it is near: half the usual distance of neighbours."""
    pool = rows if len(rows) <= _POOL else rng.choice(rows, _POOL, replace=False)
    distance, found = map(np.asarray, KDTree(scaled[pool]).query(scaled[a], k=_NEIGHBOURS + 1))
    pick, at = rng.integers(1, _NEIGHBOURS + 1, len(a)), np.arange(len(a))
    return pool[found[at, pick]], distance[at, pick] <= 0.5 * np.median(distance[:, 1:], axis=1)
