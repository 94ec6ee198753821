"""Rows anchored in recorded ones: PiA as delivered, where what has been recorded is thin for the model that learns it.

In:  real rows, the coming path, a way to train a model, a generator of random numbers.
Out: PiA rows, each for one axis; PiE rows of the path where it leaves what was recorded.

A row lies between a recorded one and one of its nearest, and its current between theirs; where the nearest are far it is
the recorded one with a twentieth of each input's spread added. Rare currents are anchors more often, as in SMOGN (Branco,
Torgo, Ribeiro, PMLR 74, 2017): a run-up of the spindle is a few rows, and a forest with several rows to a leaf draws it
to its surroundings; with rows around it, it does not.

Where the coming part leaves what was recorded, such rows say nothing new, and a forest carries them there all the same: a
run-up of the spindle, carried so, was up to five times the error on a virtual mill, and 1.7 times on a small one whose
spindle stopped once in a part. So rows of the path that are far from recorded ones go with them, with the word of a model
that knows none of these, for axes whose models would say much else there: measured on four machines, that leaves what is
gained near recorded rows. A part that leaves them for most of its way gets neither, for there is nothing to gain.

What an equation says of the way between two rows so near adds nothing that could be measured on four machines; far from
both, where a term is large, it does harm. Equations speak where nothing was recorded (`pido.sampling.trust`, `pido.sampling.steady`).
"""  # noqa: E501

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from pido.core.arrays import Bool1D, Float1D, Float2D, Int1D
from pido.core.samples import PIA, PIE, Samples, Train
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
_MOST_FAR = 0.3  # of a path's rows: with more, it is a path elsewhere
_MUCH = 0.1  # of the spread of recorded currents, on the whole path: what rows that say nothing new may change there
_ASKED = 4_000  # recorded rows, and rows of a path, that either is asked of


def anchored(real: Samples, path: Samples, train: Train, grid: Grid, rng: np.random.Generator) -> Samples:
    """PiA rows around rows of `real`, in whatever order it holds its parts, for every axis that was recorded there; and
    rows of the path far from these (PiE), which keep the number of their row in it, with the model's own word. None for
    a path that is far from them for the most part.

    path : the coming part; its currents are not looked at
    A PiA row carries the part and row of its anchor, the bin it lies in, and as expected error what two rows so near
    differ by. Its other currents are NaN. That of a PiE row is what it differs by from the nearest recorded one.
    """
    real, none = real.take(np.lexsort((real.row, real.part.astype(str)))), real.take(slice(0, 0))
    if not len(real) or not len(path):
        return none
    path = path if len(path) <= _ASKED else path.take(np.sort(rng.choice(len(path), _ASKED, replace=False)))
    scale, made = scale_of(real.inputs), []
    scaled = real.inputs / scale
    far, nearest = _far(path, real, scaled, scale, rng)
    if far.mean() > _MOST_FAR:
        return none
    for axis in range(4):
        rows = np.flatnonzero(np.isfinite(real.currents[:, axis]))
        if len(rows) > 2 * _NEIGHBOURS:
            made.append(_around(real, scaled, rows, axis, scale, grid, rng))
    if not made:
        return none
    rows = Samples.concat(made)
    if not far.any():
        return rows
    held = _held(real, rows, path, far, nearest, train, grid, rng)
    return Samples.concat([rows, held])


def unsaid(beside: Samples, path_rows: Int1D, currents: Float2D) -> Samples:
    """`beside` without the model's word on rows of the path where `currents` (n, 4) say something else.

    path_rows : (n,) – their numbers in the path
    """
    held = beside.origin == PIE
    said = np.zeros((int(max(path_rows.max(initial=-1), beside.row[held].max(initial=-1))) + 1, 4), bool)
    said[path_rows] = np.isfinite(currents)
    kept = beside.currents.copy()
    kept[held] = np.where(said[beside.row[held]], np.nan, kept[held])
    return replace(beside, currents=kept).take(np.flatnonzero(np.isfinite(kept).any(axis=1)))


def _far(
    path: Samples, real: Samples, scaled: Float2D, scale: Float1D, rng: np.random.Generator
) -> tuple[Bool1D, Int1D]:
    """(n,) each: rows of the path that are clearly further from recorded rows than these are from each other; and the
    recorded row that is nearest."""
    pool = np.arange(len(real)) if len(real) <= _POOL else rng.choice(len(real), _POOL, replace=False)
    tree, still = KDTree(scaled[pool]), ~np.isfinite(scale)
    usual = np.quantile(np.asarray(tree.query(scaled[pool][:_ASKED], k=_NEIGHBOURS + 1)[0])[:, 1:], 0.95)
    constant = real.inputs[0, still]
    distance, nearest = tree.query(path.inputs / scale)
    far = np.asarray(distance) > _FAR * usual
    far |= (np.abs(path.inputs[:, still] - constant) > 1e-9 * np.maximum(np.abs(constant), 1.0)).any(axis=1)
    return far, pool[nearest]


def _held(
    real: Samples, made: Samples, path: Samples, far: Bool1D, nearest: Int1D, train: Train, grid: Grid,
    rng: np.random.Generator,
) -> Samples:  # fmt: skip
    """The `far` rows of the path with what a model of the real rows says of them, for axes of which it would say much
    else with the rows `made`. Where there are many, it learns from an even share of them."""
    axes = np.any(np.isfinite(made.currents), axis=0)
    known = real.take(np.flatnonzero(np.isfinite(real.currents[:, axes]).any(axis=1)))
    share = _ASKED / len(known)
    known, more = known.take(rng.random(len(known)) <= share), made.take(rng.random(len(made)) <= share)
    known = replace(known, currents=np.where(axes, known.currents, np.nan))
    rows = path.take(far)
    said, beside = (train(r, np.ones((len(r), 4)))(rows) for r in (known, Samples.concat([known, more])))
    change = np.sqrt(np.sum((beside - said) ** 2, axis=0) / len(path))
    spread = np.array([np.std(c[np.isfinite(c)]) if np.isfinite(c).any() else np.nan for c in known.currents.T])
    currents = np.where(change > _MUCH * spread, said, np.nan)
    error = np.abs(currents - real.currents[nearest[far]])
    held = replace(of_path(rows, grid), currents=currents, expected_error=error)
    return held.take(np.flatnonzero(np.isfinite(currents).any(axis=1)))


def of_path(rows: Samples, grid: Grid) -> Samples:
    """Rows of a coming path as PiE rows, which belong to no part."""
    n = len(rows)
    part, origin = np.full(n, "", dtype=object), np.full(n, PIE, np.int64)
    return replace(rows, part=part, origin=origin, voxel=grid.ids(rows.reduced))


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
