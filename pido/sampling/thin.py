"""A store that outgrows memory: at most so many real rows, taken evenly from the bins that have too many.

In:  how many rows lie in which bin, over all parts; a limit. Out: per bin the share of its rows that is kept, and the
     rows of any part that belong to it.

Above the limit every bin keeps about k rows at most, with the largest k that holds it: what is rare stays whole, what
has been recorded a thousand times is thinned (the paper caps a bin at rho rows for the same reason, section III-F).
Each row has a fixed place between 0 and 1, made from its part's digest and its number; a bin keeps those below its
share. So
    - which rows are kept depends on the *set* of parts, never on the order in which they came;
    - shares only fall while parts are added: the rows kept for more parts are among those kept for fewer, and a new
      part costs its own rows and the kept ones, whatever the store holds.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Bool1D, Float1D, Float2D, Int1D
from pido.core.samples import Samples
from pido.feature_space.density import lookup
from pido.feature_space.grid import Grid

_GOLDEN, _MIX1, _MIX2 = (
    np.uint64(0x9E3779B97F4A7C15),
    np.uint64(0xBF58476D1CE4E5B9),
    np.uint64(0x94D049BB133111EB),
)


@dataclass(frozen=True, eq=False)
class BinCounts:
    """Rows per occupied bin: bins (m,), ascending; count (m,)."""

    bins: Int1D
    count: Int1D

    @classmethod
    def of(cls, points: Float2D, grid: Grid) -> BinCounts:
        """Of points of the reduced space (n, 3)."""
        bins, count = np.unique(grid.ids(points), return_counts=True)
        return cls(bins, count.astype(np.int64))

    @classmethod
    def sum(cls, parts: Iterable[BinCounts]) -> BinCounts:
        """Over several parts."""
        every = list(parts)
        if not every:
            return cls(np.zeros(0, np.int64), np.zeros(0, np.int64))
        bins, inverse = np.unique(np.concatenate([part.bins for part in every]), return_inverse=True)
        total = np.zeros(len(bins), np.int64)
        np.add.at(total, inverse, np.concatenate([part.count for part in every]))
        return cls(bins, total)

    @property
    def rows(self) -> int:
        """Over all bins."""
        return int(self.count.sum())


def level(counts: BinCounts, limit: int) -> float:
    """The largest k with sum over bins of min(count, k) <= limit; the largest count where nothing must go. Below 1
    where there are more bins than `limit`: then some bins keep a row, and others none.

    >>> level(BinCounts(np.arange(3), np.array([5, 100, 1000])), 205)
    100.0
    """
    if counts.rows <= limit:
        return float(counts.count.max(initial=0))
    ordered = np.sort(counts.count)
    before = np.r_[0, np.cumsum(ordered)[:-1]]  # rows of the bins that stay whole
    k = (limit - before) / np.arange(len(ordered), 0, -1)  # if all bins from here on are cut to the same height
    return float(k[np.flatnonzero(k < ordered)[0]])  # the first bin that its height cuts decides


def shares(counts: BinCounts, limit: int) -> Float1D:
    """(m,): the share of each bin's rows that is kept, 0 to 1."""
    return np.minimum(1.0, level(counts, limit) / np.maximum(counts.count, 1))


def kept(samples: Samples, counts: BinCounts, limit: int, grid: Grid) -> Bool1D:
    """(n,): which rows stay; `counts` are those of all parts. Rows of bins that `counts` does not know do not stay."""
    if counts.rows <= limit:
        return np.ones(len(samples), bool)
    return places(samples) < lookup(counts.bins, shares(counts, limit), grid.ids(samples.reduced), missing=0.0)


def places(samples: Samples) -> Float1D:
    """(n,): a number in [0, 1) per row, even, fixed by part and row (splitmix64; Steele et al. 2014)."""
    names, inverse = np.unique(samples.part.astype(str), return_inverse=True)
    seeds = np.array(
        [int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little") for name in names], np.uint64
    )
    with np.errstate(over="ignore"):
        z = (seeds[inverse] if len(names) else np.zeros(0, np.uint64)) + samples.row.astype(np.uint64) * _GOLDEN
        z = (z ^ (z >> np.uint64(30))) * _MIX1
        z = (z ^ (z >> np.uint64(27))) * _MIX2
        z ^= z >> np.uint64(31)
    return (z >> np.uint64(11)).astype(float) * 2.0**-53
