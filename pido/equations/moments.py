"""Per-bin sufficient statistics: all that a local equation needs to know about the samples of a bin.

In:  samples of parts, added and removed in any order. Out: per cell its number of samples, their centroid and their
     packed sums (`pido.equations.rows`), from which any equation on any bins is refitted without the samples.

Cost and memory follow the cells that a part touches, never the number of samples seen before. Adding is exact: sums are
kept as whole multiples of two fixed quanta, so the statistics depend on *which* parts are in, to the last bit, not on
the order in which they came; and what is removed leaves no trace.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

import numba
import numpy as np

from pido.core.arrays import Float2D, Int1D
from pido.core.errors import FitError
from pido.core.machining import Machine
from pido.core.samples import Samples
from pido.equations.rows import accumulate, patterns, stack, width
from pido.equations.terms import TermSet
from pido.equations.weights import in_threads
from pido.feature_space.grid import EQUATION_GRID, Grid

# A sum s is hi + lo, hi a multiple of 2^-16 and lo of 2^-64. Both are whole numbers below 2^53 of their quantum, so
# their additions do not round. What is lost, 2^-64 per part and cell, is far below the ridge of every term set.
_COARSE, _FINE, _LIMIT = 2.0**-16, 2.0**-64, 2.0**36


class Moments:
    """Statistics of samples under one term set, machine and grid of cells.

    The cell width sets how far a sample may be from the point that its weight is computed at; the centroid of the
    cell's samples takes the first-order error out.
    """

    def __init__(self, terms: TermSet, machine: Machine, grid: Grid = EQUATION_GRID) -> None:
        self.terms, self.machine, self.grid = terms, machine, grid
        self._slots: dict[int, int] = {}
        self._counts = np.zeros(0, np.int64)
        self._hi = np.zeros((0, width(len(terms)) + 3))
        self._lo = np.zeros_like(self._hi)

    def __len__(self) -> int:
        """Number of samples."""
        return int(self._counts[: len(self._slots)].sum())

    def add(self, samples: Samples) -> None:
        """Take samples in; those without any current, or with a missing input, must be left out before (FitError)."""
        self._combine(*self._sums(samples), +1)

    def remove(self, samples: Samples) -> None:
        """Take samples out again; FitError where a cell does not hold that many."""
        keys, counts, sums = self._sums(samples)
        held = [self._counts[self._slots[k]] if k in self._slots else 0 for k in keys]
        if (counts > held).any():
            raise FitError("these samples are not all in the statistics: only samples that were added can be removed.")
        self._combine(keys, counts, sums, -1)

    def merged(self, other: Moments) -> Moments:
        """The statistics of both; neither changes."""
        return self._with(other, +1)

    def without(self, other: Moments) -> Moments:
        """The statistics with those of `other` taken out, as for leaving one part out."""
        return self._with(other, -1)

    @property
    def keys(self) -> Int1D:
        """(m,): bin and pattern of recorded axes of each occupied cell, ascending."""
        occupied = [k for k, slot in self._slots.items() if self._counts[slot]]
        return np.array(sorted(occupied), np.int64)

    def cells(self) -> tuple[Float2D, Int1D, Int1D, Float2D]:
        """Occupied cells in the order of their bins: centroids (m, 3), counts (m,), patterns (m,), sums (m, k)."""
        keys = self.keys
        at = np.array([self._slots[k] for k in keys], np.int64)
        values, counts = self._hi[at] + self._lo[at], self._counts[at]
        return values[:, -3:] / counts[:, None], counts, keys & 15, np.ascontiguousarray(values[:, :-3])

    def arrays(self) -> dict[str, np.ndarray]:
        """What restores these statistics to the bit, as plain arrays in canonical order."""
        keys = self.keys
        at = np.array([self._slots[k] for k in keys], np.int64)
        return {"keys": keys, "counts": self._counts[at], "hi": self._hi[at], "lo": self._lo[at]}

    @classmethod
    def from_arrays(
        cls, arrays: Mapping[str, np.ndarray], terms: TermSet, machine: Machine, grid: Grid = EQUATION_GRID
    ) -> Moments:
        """The inverse of `arrays`; FitError where they belong to another term set."""
        self = cls(terms, machine, grid)
        if arrays["hi"].shape[1] != self._hi.shape[1]:
            raise FitError(
                f"saved statistics have {arrays['hi'].shape[1]} entries per cell, the equation '{terms.id}' needs "
                f"{self._hi.shape[1]}: fit them afresh from the store."
            )
        self._slots = {int(k): slot for slot, k in enumerate(arrays["keys"])}
        self._counts, self._hi, self._lo = (np.array(arrays[name]) for name in ("counts", "hi", "lo"))
        return self

    def digest(self) -> str:
        """sha256 of the content, the term set and the cell width: equal for the same parts in whatever order."""
        text = f"{self.terms.id} {self.terms.names} {self.grid.width} {self.terms.scale(self.machine).tolist()}"
        digest = hashlib.sha256(text.encode())
        for values in self.arrays().values():
            digest.update(np.ascontiguousarray(values).tobytes())
        return digest.hexdigest()

    def _sums(self, samples: Samples) -> tuple[list[int], Int1D, Float2D]:
        points = samples.reduced
        design = self.terms.design(samples, self.machine)
        if not np.isfinite(design).all():
            row, column = np.argwhere(~np.isfinite(design))[0]
            raise FitError(
                f"sample {samples.row[row]} of part '{samples.part[row]}': term '{self.terms.names[column]}' is not a "
                "number. Missing samples are never filled in: leave them out."
            )
        pattern = patterns(samples.currents)
        key = (self.grid.ids(points) << 4) | pattern
        order = np.argsort(key, kind="stable")
        key = key[order]
        starts = np.r_[np.flatnonzero(np.r_[True, key[1:] != key[:-1]]), len(key)] if len(key) else np.zeros(1, int)
        sums = np.empty((len(starts) - 1, self._hi.shape[1]))
        if len(key):
            z = stack(design, samples.currents)[order]
            in_threads(lambda out: accumulate(z, starts, len(self.terms), out), [sums], size=sums.size)
            sums[:, -3:] = np.add.reduceat(points[order], starts[:-1], axis=0)
        if np.abs(sums).max(initial=0.0) > _LIMIT:
            entry = self.terms.names[int(np.abs(design).max(axis=0).argmax())]
            raise FitError(
                f"part '{samples.part[0]}': term '{entry}' reaches {np.abs(design).max():.3g} times its range. "
                "Check the recording's units and the machine's limits."
            )
        return key[starts[:-1]].tolist(), np.diff(starts), sums

    def _with(self, other: Moments, sign: int) -> Moments:
        if (other.terms is not self.terms and other.terms != self.terms) or other.grid != self.grid:
            raise FitError("statistics of different equations or cell widths cannot be combined.")
        result = Moments.from_arrays(self.arrays(), self.terms, self.machine, self.grid)
        theirs = other.arrays()
        result._place(theirs["keys"].tolist(), sign * theirs["counts"], sign * theirs["hi"], sign * theirs["lo"])
        return result

    def _combine(self, keys: list[int], counts: Int1D, sums: Float2D, sign: int) -> None:
        hi, lo = np.empty_like(sums), np.empty_like(sums)
        _split(sums, float(sign), hi, lo)
        self._place(keys, sign * counts, hi, lo)

    def _place(self, keys: list[int], counts: Int1D, hi: Float2D, lo: Float2D) -> None:
        for key in keys:
            self._slots.setdefault(key, len(self._slots))
        if len(self._slots) > len(self._counts):
            more = max(64, len(self._slots)) - len(self._counts) + len(self._slots) // 2
            self._counts = np.r_[self._counts, np.zeros(more, np.int64)]
            self._hi, self._lo = (np.vstack([old, np.zeros((more, old.shape[1]))]) for old in (self._hi, self._lo))
        at = np.array([self._slots[key] for key in keys], np.int64)
        self._counts[at] += counts
        _put(self._hi, self._lo, at, hi, lo)


@numba.njit(nogil=True, cache=True)
def _split(sums: Float2D, sign: float, hi: Float2D, lo: Float2D) -> None:
    """Multiples of the coarse and of the fine quantum that make up `sign * sums`."""
    for c in range(sums.shape[0]):
        for k in range(sums.shape[1]):
            s = sign * sums[c, k]
            hi[c, k] = np.rint(s / _COARSE) * _COARSE
            lo[c, k] = np.rint((s - hi[c, k]) / _FINE) * _FINE


@numba.njit(nogil=True, cache=True)
def _put(hi: Float2D, lo: Float2D, at: Int1D, more_hi: Float2D, more_lo: Float2D) -> None:
    """Add rows to the rows `at`; with a carry, so that the pair is a function of the total alone."""
    for c in range(len(at)):
        high, low = hi[at[c]], lo[at[c]]
        for k in range(len(high)):
            s = low[k] + more_lo[c, k]
            carry = np.rint(s / _COARSE) * _COARSE
            low[k] = s - carry
            high[k] += more_hi[c, k] + carry
