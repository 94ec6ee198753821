"""Other ways to make rows out of few: what PiA and PiE have to be measured against.

In:  real rows, bins, how many rows each bin is to get. Out: rows of the same kind; no physics, no look at the coming part.

noise            a row of the bin plus Gaussian noise (a twentieth of each column's spread)
smote            between a row of the bin and one of its nearest in the bin, current weighted by distance
                 (SMOTE for regression: Torgo et al. 2013)
geometric_smote  in a sphere around a row of the bin, whose radius is the distance to a neighbour
                 (Camacho, Douzas, Bacao, Expert Syst. Appl. 193, 2022)
smogn            rows with rare currents, axis by axis: SMOTE towards a near neighbour, noise where there is only a far one
                 (Branco, Torgo, Ribeiro, PMLR 74, 2017)
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from pido.core.arrays import Float1D, Float2D, Int1D
from pido.core.axes import AXES
from pido.core.samples import PIA, Samples
from pido.feature_space.grid import Grid
from pido.sampling.rarity import density, scale_of

NEIGHBOURS = 5
NOISE = 0.05

RowRival = Callable[[Samples, Int1D, Int1D, Grid, np.random.Generator], Samples]
"""(real, bins, number per bin, grid, rng) -> rows."""


def noise(real: Samples, bins: Int1D, number: Int1D, grid: Grid, rng: np.random.Generator) -> Samples:
    """Copies of rows of the bin, inputs and currents shaken by a twentieth of their spread over all rows."""
    seed, target = _seeds(real, bins, number, grid, rng)
    return _shaken(real, seed, target, rng)


def smote(real: Samples, bins: Int1D, number: Int1D, grid: Grid, rng: np.random.Generator) -> Samples:
    """Points between a row and one of its nearest in the bin; bins with one row get none."""
    seed, other, target = _pairs(real, bins, number, grid, rng)
    return _between(real, seed, other, rng.random(len(seed)), target)


def geometric_smote(real: Samples, bins: Int1D, number: Int1D, grid: Grid, rng: np.random.Generator) -> Samples:
    """Points in the sphere around a row through one of its nearest; the current is weighted by nearness to both."""
    seed, other, target = _pairs(real, bins, number, grid, rng)
    scale, x = scale_of(real.inputs), real.inputs
    along = (x[other] - x[seed]) / scale
    radius = np.linalg.norm(along, axis=1, keepdims=True)
    live = scale < np.inf
    ball = np.where(live, rng.normal(size=along.shape), 0.0)
    ball /= np.maximum(np.linalg.norm(ball, axis=1, keepdims=True), 1e-12)
    ball *= rng.random((len(seed), 1)) ** (1.0 / max(int(live.sum()), 1))
    new = x[seed] + np.where(live, ball * radius * np.where(live, scale, 1.0), 0.0)
    near = np.linalg.norm((new - x[seed]) / scale, axis=1)
    far = np.linalg.norm((new - x[other]) / scale, axis=1)
    share = near / np.maximum(near + far, 1e-12)
    rows = _between(real, seed, other, share, target)
    return replace(rows, inputs=new)


def smogn(real: Samples, bins: Int1D, number: Int1D, grid: Grid, rng: np.random.Generator) -> Samples:
    """As many rows as asked for in all, where currents are rare; each axis gets its own, the others are NaN in them."""
    total, scale, made = int(number.sum()), scale_of(real.inputs), []
    for i in range(len(AXES)):
        rows = np.flatnonzero(np.isfinite(real.currents[:, i]))
        if len(rows) < 2 * NEIGHBOURS or not total:
            continue
        chance = 1.0 / np.maximum(density(real.currents[rows, i]), 1e-6)
        seed = rows[rng.choice(len(rows), total, p=chance / chance.sum())]
        tree = KDTree(real.inputs[rows] / scale)
        distance, near = map(np.asarray, tree.query(real.inputs[seed] / scale, k=NEIGHBOURS + 1))
        pick = rng.integers(1, NEIGHBOURS + 1, total)
        at = np.arange(total)
        close = distance[at, pick] <= 0.5 * np.median(distance[:, 1:], axis=1)
        target = grid.ids(real.reduced[seed])
        mixed = _between(real, seed, rows[near[at, pick]], rng.random(total), target)
        shaken = _shaken(real, seed, target, rng)
        own = Samples.concat([mixed.take(close), shaken.take(~close)])
        currents = np.full_like(own.currents, np.nan)
        currents[:, i] = own.currents[:, i]
        made.append(replace(own, currents=currents))
    return Samples.concat(made) if made else real.take(slice(0, 0))


ROW_RIVALS: dict[str, RowRival] = {
    "noise": noise,
    "SMOTE-R": smote,
    "geometric SMOTE": geometric_smote,
    "SMOGN": smogn,
}


def dense_weights(currents: Float2D, alpha: float = 1.0, least: float = 1e-3) -> Float2D:
    """(n, 4): DenseWeight (Steininger et al., Mach. Learn. 110, 2021): rare currents count more; mean 1 per axis.

    alpha : 0 for no weighting; 1 for the strongest that gives no row a weight below `least` before scaling
    """
    weights = np.ones_like(currents)
    for i in range(currents.shape[1]):
        known = np.isfinite(currents[:, i])
        if known.any():
            w = np.maximum(1.0 - alpha * density(currents[known, i]), least)
            weights[known, i] = w / w.mean()
    return weights


def _seeds(
    real: Samples, bins: Int1D, number: Int1D, grid: Grid, rng: np.random.Generator, at_least: int = 1
) -> tuple[Int1D, Int1D]:
    """Row of `real` and bin for each new row; bins with fewer than `at_least` rows give none."""
    ids = grid.ids(real.reduced)
    order = np.argsort(ids, kind="stable")
    ids = ids[order]
    first, last = np.searchsorted(ids, bins), np.searchsorted(ids, bins, side="right")
    number = np.where(last - first >= at_least, number, 0)
    which = np.repeat(np.arange(len(bins)), number)
    place = first[which] + np.floor(rng.random(len(which)) * (last - first)[which]).astype(np.int64)
    return order[place], bins[which]


def _pairs(
    real: Samples, bins: Int1D, number: Int1D, grid: Grid, rng: np.random.Generator
) -> tuple[Int1D, Int1D, Int1D]:
    seed, target = _seeds(real, bins, number, grid, rng, at_least=2)
    ids, scaled = grid.ids(real.reduced), real.inputs / scale_of(real.inputs)
    other = np.empty_like(seed)
    for bin_id in np.unique(target):
        rows, mine = np.flatnonzero(ids == bin_id), np.flatnonzero(target == bin_id)
        k = min(NEIGHBOURS, len(rows) - 1)
        near = np.asarray(KDTree(scaled[rows]).query(scaled[seed[mine]], k=k + 1)[1])
        pick = near[np.arange(len(mine)), rng.integers(1, k + 1, len(mine))]
        other[mine] = np.where(rows[pick] == seed[mine], rows[near[:, 0]], rows[pick])
    return seed, other, target


def _between(real: Samples, seed: Int1D, other: Int1D, share: Float1D, target: Int1D) -> Samples:
    """Rows at `share` of the way from seed to other; signs of directions are those of the nearer one."""
    s = share[:, None]
    rows = real.take(seed)
    direction = np.where(s < 0.5, rows.direction, real.direction[other])
    return _made(
        replace(
            rows,
            inputs=(1 - s) * rows.inputs + s * real.inputs[other],
            ar=(1 - share) * rows.ar + share * real.ar[other],
            currents=(1 - s) * rows.currents + s * real.currents[other],
            direction=direction,
        ),
        target,
    )


def _shaken(real: Samples, seed: Int1D, target: Int1D, rng: np.random.Generator) -> Samples:
    rows = real.take(seed)
    spread = np.nan_to_num(np.where(scale_of(real.inputs) < np.inf, scale_of(real.inputs), 0.0))
    known = np.isfinite(real.currents)
    mean = np.where(known, real.currents, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    sd = np.sqrt(np.where(known, (real.currents - mean) ** 2, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1))
    inputs = rows.inputs + NOISE * spread * rng.normal(size=rows.inputs.shape)
    currents = rows.currents + NOISE * sd * rng.normal(size=rows.currents.shape)
    return _made(replace(rows, inputs=inputs, currents=currents), target)


def _made(rows: Samples, target: Int1D) -> Samples:
    n = len(rows)
    return replace(
        rows, part=np.full(n, "", dtype=object), row=np.full(n, -1, np.int64),
        origin=np.full(n, PIA, np.int64), voxel=np.asarray(target, np.int64), expected_error=np.zeros((n, 4)),
    )  # fmt: skip
