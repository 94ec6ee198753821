"""Rows anchored in recorded ones: PiA as delivered, where what has been recorded is thin for the model that learns it.

In:  real rows, the coming path, a way to train a model, a generator of random numbers. Out: PiA rows, each for one axis.

A row lies between a recorded one and one of its nearest, and its current between theirs; where the nearest are far it is
the recorded one with a twentieth of each input's spread added. Rare currents are anchors more often, as in SMOGN (Branco,
Torgo, Ribeiro, PMLR 74, 2017): a run-up of the spindle is a few rows, and a forest with several rows to a leaf draws it
to its surroundings; with rows around it, it does not.

Only a coming part that goes where rows were recorded gets them; elsewhere they say nothing new, and change the error of a
model by nothing on the mean of four machines, and threefold where they carry a run-up of the spindle to where nothing was
recorded. The same may happen in the few rows in which a part leaves what was recorded: an axis whose answers there change
by so much that it is half the spread of the recorded currents on the whole path gets none. (On a small mill whose spindle
stopped once, a twentieth of a part made the error of all of it 1.7 times as large; a quarter of the spread would have
taken a real air cut's gains.)

What an equation says of the way between two rows so near adds nothing that could be measured on four machines; far from
both, where a term is large, it does harm. Equations speak where nothing was recorded (`pido.sampling.trust`, `pido.sampling.steady`).
"""  # noqa: E501

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from pido.core.arrays import Bool1D, Float1D, Float2D, Int1D
from pido.core.samples import PIA, Samples, Train
from pido.feature_space.grid import Grid
from pido.sampling.rarity import density, scale_of

PER_ROW = 4
"""Anchored rows per recorded one, while these are few."""
_MOST = 8_000  # anchored rows of an axis: a forest's leaves are as many as its settings allow long before
_NEIGHBOURS = 5
_SHAKE = 0.05  # of each column's spread
_RAREST = 0.1  # of the commonest current's density; what is rarer still is no likelier to be an anchor
_POOL = 20_000  # rows among which neighbours are looked for
_FAR = 3.0  # times the distance within which recorded rows have their neighbours
_MOST_FAR = 0.1  # of a path's rows: with more, it is a path elsewhere
_STEADY = 0.5  # of the spread of recorded currents: what rows that say nothing new may change on a path
_ASKED = 4_000  # recorded rows, and rows of a path, that either is asked of


def anchored(real: Samples, path: Samples, train: Train, grid: Grid, rng: np.random.Generator) -> Samples:
    """PiA rows around rows of `real`, in whatever order it holds its parts, for every axis that was recorded there and
    whose model they leave steady where the path leaves it; none for a path that goes elsewhere.

    path : the coming part; its currents are not looked at
    A row carries the part and row of its anchor, the bin it lies in, and as expected error what two rows so near differ
    by. Its other currents are NaN.
    """
    real, none = real.take(np.lexsort((real.row, real.part.astype(str)))), real.take(slice(0, 0))
    if not len(real) or not len(path):
        return none
    path = path if len(path) <= _ASKED else path.take(rng.choice(len(path), _ASKED, replace=False))
    scale, made = scale_of(real.inputs), []
    scaled = real.inputs / scale
    far = _far(path, real, scaled, scale, rng)
    if far.mean() > _MOST_FAR:
        return none
    for axis in range(4):
        rows = np.flatnonzero(np.isfinite(real.currents[:, axis]))
        if len(rows) > 2 * _NEIGHBOURS:
            made.append(_around(real, scaled, rows, axis, scale, grid, rng))
    rows = Samples.concat(made) if made else none
    if not far.any() or not len(rows):
        return rows
    steady = _steady(real, rows, path, far, train, rng)
    return rows.take(np.flatnonzero(np.isfinite(rows.currents[:, steady]).any(axis=1)))


def _far(path: Samples, real: Samples, scaled: Float2D, scale: Float1D, rng: np.random.Generator) -> Bool1D:
    """(n,): rows of the path that are clearly further from recorded rows than these are from each other."""
    some = scaled if len(real) <= _POOL else scaled[rng.choice(len(real), _POOL, replace=False)]
    tree, still = KDTree(some), ~np.isfinite(scale)
    usual = np.quantile(np.asarray(tree.query(some[:_ASKED], k=_NEIGHBOURS + 1)[0])[:, 1:], 0.95)
    constant = real.inputs[0, still]
    far = np.asarray(tree.query(path.inputs / scale)[0]) > _FAR * usual
    far |= (np.abs(path.inputs[:, still] - constant) > 1e-9 * np.maximum(np.abs(constant), 1.0)).any(axis=1)
    return far


def _steady(
    real: Samples, made: Samples, path: Samples, asked: Bool1D, train: Train, rng: np.random.Generator
) -> Bool1D:
    """(4,): axes whose models say nearly the same of the path, where it is `asked`, with the rows `made` and without.
    Where there are many, an even share of both is learned: it says as much, and training with all takes as long as the
    models themselves."""
    real = real.take(np.flatnonzero(np.isfinite(real.currents).any(axis=1)))
    share = min(1.0, _ASKED / len(real))
    some, more = real.take(rng.random(len(real)) <= share), made.take(rng.random(len(made)) <= share)
    without, beside = (train(rows, np.ones((len(rows), 4)))(path) for rows in (some, Samples.concat([some, more])))
    change = np.sqrt(np.mean((beside - without) ** 2 * asked[:, None], axis=0))
    known = [column[np.isfinite(column)] for column in some.currents.T]
    return change <= _STEADY * np.array([np.std(column) if len(column) else np.nan for column in known])


def _around(
    real: Samples, scaled: Float2D, rows: Int1D, axis: int, scale: Float1D, grid: Grid, rng: np.random.Generator
) -> Samples:
    n = min(PER_ROW * len(rows), _MOST)
    chance = 1.0 / np.maximum(density(real.currents[rows, axis]), _RAREST)
    a = rows[rng.choice(len(rows), n, p=chance / chance.sum())]
    b, near = _neighbour(scaled, a, rows, rng)
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
    asked, again = np.unique(a, return_inverse=True)  # a row is an anchor several times
    distance, found = (np.asarray(v)[again] for v in KDTree(scaled[pool]).query(scaled[asked], k=_NEIGHBOURS + 1))
    pick, at = rng.integers(1, _NEIGHBOURS + 1, len(a)), np.arange(len(a))
    return pool[found[at, pick]], distance[at, pick] <= 0.5 * np.median(distance[:, 1:], axis=1)
