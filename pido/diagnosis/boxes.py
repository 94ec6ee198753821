"""Every box of a coarse grid over the reduced space, and what a term that acts in that box only would take away.

In:  rows with independent errors, what is left to explain, and the variables that limit a box.
Out: the best box of each term.
Sums over the cells of the grid give all boxes at once, as in a scan statistic (Kulldorff 1997). A box is taken to
commute with the whitening, and to share nothing with what is in the model already: good enough to say which are worth
a fit of their own.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from pido.core.arrays import Bool1D, Float1D, Float2D, Int1D
from pido.diagnosis.gates import IN_PLACE, PATH_SPEED, VARIABLES, Gate, between, gate_variable
from pido.diagnosis.mismatch import Mismatch

_CUTS = (0.04, 0.1, 0.2, 0.4, 0.6, 0.8, 0.9, 0.96)  # shares of the rows between which a coarse grid is cut
_FINE = 16  # limits of a variable on the grid on which a single term is asked
_NEAR_A_LIMIT = 24  # values between which a limit is moved at last
_SAME_LEVEL = 0.01  # of the range of a variable: nearer values are one level
_SAME_AREA = 0.0025  # the same of AR, which reaches from a finishing cut to a hole
_ALONE = 1e-3  # share of a column's power in a box that must be left beside the columns before it
_AT_ONCE = 8_000_000  # sums over boxes held at a time, 4 bytes each
_THERE = 1e-5  # share of a column's power that lies in a box in which it can be seen at all

Float32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Places:
    """Where a variable can be cut in two: halfway from each of its levels to the next, rising.

    gaps : how far these two are apart; below : share of the rows that lie below, of AR while the tool cuts
    """

    limits: Float1D
    gaps: Float1D
    below: Float1D


def places_of(values: Float1D) -> Places:
    """Percents of the rows that differ are levels: a constant feed is one, and is not cut."""
    return _between(np.quantile(values, np.linspace(0.01, 0.99, 99)), values, _SAME_LEVEL)


def places_of_area(values: Float1D) -> Places:
    """The same of a removed area, which is none in the air: limits are about how it differs while the tool cuts."""
    cutting = values[values > 0]
    if len(cutting) == 0:
        return places_of(values)
    half_percents = np.quantile(cutting, np.linspace(0.005, 0.995, 199))
    return _between(np.r_[np.zeros(int(len(cutting) < len(values))), half_percents], cutting, _SAME_AREA)


def _between(ranked: Float1D, rows: Float1D, same: float) -> Places:
    """Halfway between values that are further apart than a share of their range."""
    least = same * float(np.ptp(ranked))
    levels = ranked[:1].tolist()
    for value in ranked[1:]:
        if value - levels[-1] > least:
            levels.append(value)
    limits = (np.array(levels[1:]) + levels[:-1]) / 2
    return Places(limits, np.diff(levels), np.searchsorted(np.sort(rows), limits) / len(rows))


@dataclass(frozen=True, eq=False)
class Lattice:
    """Cells over some variables, and all boxes made of them.

    cuts : variable -> limits between its classes, rising; cell : (groups,) – the cell in which a group of rows lies
    """

    cuts: Mapping[str, Float1D]
    cell: Int1D

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(len(c) + 1 for c in self.cuts.values())

    @cached_property
    def spans(self) -> list[list[tuple[int, int]]]:
        """Per variable: first and last class of each interval."""
        return [list(itertools.combinations_with_replacement(range(k), 2)) for k in self.shape]

    @cached_property
    def limits(self) -> Float32:
        """(boxes,) – how many limits each box has; the one that is all of the space has none."""
        counts = [[(i > 0) + (j < k - 1) for i, j in s] for k, s in zip(self.shape, self.spans, strict=True)]
        return np.asarray(sum(np.ix_(*counts)), np.float32).ravel()

    @cached_property
    def _inside(self) -> list[Float32]:
        """Per variable, (intervals, classes): 1 where a class lies in an interval."""
        sizes = zip(self.shape, self.spans, strict=True)
        return [np.array([(np.arange(k) >= i) & (np.arange(k) <= j) for i, j in s], np.float32) for k, s in sizes]

    @cached_property
    def _order(self) -> tuple[Int1D, Int1D]:
        return _sorted(self.cell)

    def pieces(self, groups: Float32) -> Iterator[Float32]:
        """(k, groups) -> (k, boxes), some boxes after others: sums over the groups of rows in each box."""
        order, first = self._order
        cells = np.zeros((len(groups), int(np.prod(self.shape))), np.float32)
        cells[:, self.cell[order][first]] = np.add.reduceat(groups[:, order], first, axis=1)
        cells = cells.reshape(-1, *self.shape)
        outer, *inner = self._inside
        at_once = max(1, _AT_ONCE // (len(groups) * int(np.prod([len(i) for i in inner]))))
        for k in range(0, len(outer), at_once):
            out = np.tensordot(cells, outer[k : k + at_once], axes=(1, 1))
            for inside in inner:
                out = np.tensordot(out, inside, axes=(1, 1))
            yield out.reshape(len(groups), -1)

    def gates(self, box: int) -> tuple[Gate, ...]:
        """The limits of a box, one gate each."""
        at = np.unravel_index(box, tuple(len(s) for s in self.spans))
        out = []
        for (variable, cuts), spans, k in zip(self.cuts.items(), self.spans, at, strict=True):
            first, last = spans[k]
            if first > 0:
                out.append(Gate(variable, low=float(cuts[first - 1])))
            if last < len(cuts):
                out.append(Gate(variable, high=float(cuts[last])))
        return tuple(out)


@dataclass(frozen=True, eq=False)
class Grid:
    """The boxes of several lattices, one after another; rows that share a cell in each are a group.

    order : (n,) – rows, group by group; first : first of each group in that order
    """

    lattices: tuple[Lattice, ...]
    order: Int1D
    first: Int1D

    @cached_property
    def limits(self) -> Float32:
        """(boxes,) – how many limits each box has."""
        return np.concatenate([each.limits for each in self.lattices])

    @cached_property
    def by_limits(self) -> dict[int, Int1D]:
        """The boxes by how many limits they have; without those that are all of the space."""
        counts = self.limits.astype(np.int8)
        return {int(c): np.flatnonzero(counts == c) for c in np.unique(counts) if c}

    def without(self, variable: str) -> tuple[Grid, Bool1D]:
        """The lattices that do not cut this variable, and which boxes are theirs, (boxes,)."""
        free = [variable not in each.cuts for each in self.lattices]
        lattices = tuple(itertools.compress(self.lattices, free))
        return replace(self, lattices=lattices), np.repeat(free, [len(each.limits) for each in self.lattices])

    def sums(self, values: Float32) -> Float32:
        """(k, n) -> (k, boxes): sums over the rows of each box."""
        return np.concatenate(list(self.pieces(values)), axis=1)

    def pieces(self, values: Float32) -> Iterator[Float32]:
        """The same, some boxes after others: all of a fine grid at once take gigabytes."""
        yield from self.pieces_of(self.groups(values))

    def groups(self, values: Float32) -> Float32:
        """(k, n) -> (k, groups): sums over the rows of each group."""
        return np.add.reduceat(values[:, self.order], self.first, axis=1)

    def pieces_of(self, groups: Float32) -> Iterator[Float32]:
        """(k, groups) -> (k, boxes), some boxes after others: sums over the groups of each box."""
        for each in self.lattices:
            yield from each.pieces(groups)

    def gates(self, box: int) -> tuple[Gate, ...]:
        """The limits of a box, one gate each."""
        for lattice in self.lattices:
            if box < len(lattice.limits):
                return lattice.gates(box)
            box -= len(lattice.limits)
        raise IndexError(box)


def places_in(variables: Mapping[str, Float1D], rows: Bool1D) -> dict[str, Places]:
    """The places of each in these rows."""
    return {v: (places_of_area if v in ("AR", "MRR") else places_of)(x[rows]) for v, x in variables.items()}


def cuts_of(places: Mapping[str, Places]) -> dict[str, Float1D]:
    """Where a coarse grid is cut: of the places in each range of the rows, the widest gap."""
    out = {}
    for name, at in places.items():
        group = np.arange(len(at.limits)) if len(at.limits) <= len(_CUTS) else np.searchsorted(_CUTS, at.below)
        widest = [max(np.flatnonzero(group == g), key=lambda i: at.gaps[i]) for g in np.unique(group)]
        out[name] = at.limits[widest]
    return out


def fine_cuts_of(places: Mapping[str, Places]) -> dict[str, Float1D]:
    """So many places of each variable that one term can be asked in all boxes between them."""
    return {name: some_of(at) for name, at in places.items()}


def some_of(places: Places) -> Float1D:
    """Limits, spread evenly over all there are."""
    picks = np.linspace(0, len(places.limits) - 1, min(_FINE, len(places.limits)))
    some: Float1D = places.limits[np.round(picks).astype(int)]
    return some


def grid_at(variables: Mapping[str, Float1D], *cuts: Mapping[str, Float1D]) -> Grid:
    """The grid over `variables`, (n,) each, with a lattice between the limits of each of `cuts`."""
    cells = [_cell_of(variables, each) for each in cuts]
    group = cells[0]
    for cell in cells[1:]:
        group = group * (int(cell.max()) + 1) + cell
    order, first = _sorted(group)
    return Grid(tuple(Lattice(c, cell[order[first]]) for c, cell in zip(cuts, cells, strict=True)), order, first)


def _sorted(cell: Int1D) -> tuple[Int1D, Int1D]:
    """(n,) – places in rising order of the cell; and the first of each cell in that order."""
    order = np.argsort(cell, kind="stable")
    return order, np.flatnonzero(np.r_[True, np.diff(cell[order]) > 0])


def _cell_of(variables: Mapping[str, Float1D], cuts: Mapping[str, Float1D]) -> Int1D:
    cell = np.zeros(len(next(iter(variables.values()))), int)
    for name, limits in cuts.items():
        cell = cell * (len(limits) + 1) + np.searchsorted(limits, variables[name], side="right")
    return cell


@dataclass(frozen=True, eq=False)
class Space:
    """The reduced space of one recording: what limits a box, (n,) each, where that can be cut, and the grids of it.

    ranges : (n, 2) – least and most of a variable within rows that were averaged
    Each variable by itself is cut in all places: a law that ends within the steps of a lattice over all of them looks
    weak in each of its boxes.
    """

    variables: Mapping[str, Float1D]
    ranges: Mapping[str, Float2D]
    places: Mapping[str, Places]
    coarse: Grid
    fine: Grid

    @cached_property
    def distinct(self) -> dict[str, Float1D]:
        """The values of each variable that occur, rising."""
        return {name: np.unique(values) for name, values in self.variables.items()}

    def between(self, variable: str, limits: Float1D) -> csr_array:
        """(classes, n), sparse – how much of each row lies between each of `limits`, rising, and the next."""
        return between(self.variables[variable], self.ranges.get(variable), limits)

    def between_rows(self, variable: str, limits: list[float], share: float) -> Float1D:
        """Halfway between some of the values that occur about each of `limits`: of a share of those from the place
        before it to that behind it."""
        at, values = self.places[variable].limits, self.distinct[variable]
        out = list(limits)
        for limit in limits:
            before = at[max(0, int(np.searchsorted(at, limit)) - 1)]
            behind = at[min(len(at) - 1, int(np.searchsorted(at, limit, side="right")))]
            low, here, high = np.searchsorted(values, (before, limit, behind))
            far = max(2, int(share * (high - low)))
            there = values[max(low - 1, here - far, 0) : min(high, here + far) + 1]
            some = there[np.unique(np.linspace(0, len(there) - 1, _NEAR_A_LIMIT).astype(int))]
            out += ((some[1:] + some[:-1]) / 2).tolist()
        return np.unique(np.array(out, float))


def space_of(mismatch: Mismatch) -> Space | None:
    """The space of v_x, v_y and AR, and of what comes in their place, as far as a recording has them and they vary;
    None where none does."""
    variables = {v: values for v in (*VARIABLES, *IN_PLACE) if (values := _values(mismatch, v)) is not None}
    if not variables:
        return None
    places = places_in(variables, mismatch.usable)
    together = {name: at for name, at in places.items() if name in VARIABLES}
    alone = [{name: at.limits} for name, at in together.items() if len(at.limits)]
    path = {name: at for name, at in places.items() if name == PATH_SPEED and len(at.limits)}
    coarse, fine = (
        grid_at(variables, *(cuts(each) for each in (together, path) if each), *alone)
        for cuts in (cuts_of, fine_cuts_of)
    )
    averaged = [v for v in variables if all(v in s.ranges for s in mismatch.states)]
    ranges = {v: np.nan_to_num(np.concatenate([s.ranges[v] for s in mismatch.states])) for v in averaged}
    return Space(variables, ranges, places, coarse, fine)


def _values(mismatch: Mismatch, variable: str) -> Float1D | None:
    found = [gate_variable(s, variable) for s in mismatch.states]
    if any(v is None for v in found):
        return None
    values = np.nan_to_num(np.concatenate([np.asarray(v, float) for v in found]))
    return values if np.ptp(values) > 0 else None


def gains_of_each(grid: Grid, rows: Float32, residual: Float32, sign: Float1D, own: Float32) -> Float32:
    """(k, boxes) – what each row by itself would take away in each box; nothing with an amplitude of the wrong sign.

    rows : (k, n), whitened, of unit length; residual : (n,), whitened; sign : (k,) – of the amplitude, 0 where it may
    have any; own : (k, groups) – `own_products` of each row
    """
    inner, power = grid.sums(rows * residual), np.concatenate(list(grid.pieces_of(own)), axis=1)
    right = inner * np.asarray(sign, np.float32)[:, None] >= 0
    return np.divide(inner**2, power, out=np.zeros_like(power), where=right & (power > _THERE))


def gains_together(grid: Grid, rows: Float32, residual: Float32, own: Float32) -> Float32:
    """(boxes,) – what all `rows` would take away together in each box.

    rows : (k, n), whitened, of unit length; residual : (n,), whitened; own : (pairs, groups) – `own_products` of them
    """
    groups = np.concatenate([grid.groups(rows * residual), own])
    return np.concatenate([_gain_of(sums, len(rows), _pairs(len(rows))) for sums in grid.pieces_of(groups)])


def own_products(grid: Grid, rows: Float32) -> Float32:
    """(pairs, groups) – products of every row, (k, n), with itself and those after it, summed over the groups."""
    return grid.groups(np.array([rows[i] * rows[j] for i, j in _pairs(len(rows))]))


def of_unit_length(rows: Float32) -> Float32:
    """(k, n) – rows of zeros stay as they are."""
    length = np.sqrt(np.einsum("ij,ij->i", rows, rows))
    return (rows / np.where(length > 0, length, 1.0)[:, None]).astype(np.float32, copy=False)


def _pairs(k: int) -> list[tuple[int, int]]:
    return list(itertools.combinations_with_replacement(range(k), 2))


def _gain_of(sums: Float32, k: int, pairs: list[tuple[int, int]]) -> Float32:
    """(boxes,) – what k columns take away, from (k + pairs, boxes): their products with what is left, and each other's.
    The products are used up."""
    inner, gram = sums[:k], dict(zip(pairs, sums[k:], strict=True))
    least = [np.maximum(_THERE, _ALONE * gram[i, i]) for i in range(k)]
    gain = np.zeros(inner.shape[1], np.float32)
    for i in range(k):  # column by column, in all boxes at once
        inverse = np.divide(1.0, gram[i, i], out=np.zeros_like(gain), where=gram[i, i] > least[i])
        gain += inner[i] ** 2 * inverse
        for j in range(i + 1, k):
            share = gram[i, j] * inverse
            inner[j] -= share * inner[i]
            for m in range(j, k):
                gram[j, m] -= share * gram[i, m]
    return gain


def gains_of_intervals(
    rows: csr_array, k: int, Q: Float32, residual: Float32, sign: float = 0.0
) -> tuple[Int1D, Int1D, Float1D]:
    """First and last class of every interval of classes, and what k columns would take away there together.

    rows : (k * classes, n), sparse – whitened rows of each column within each class; Q : (q, n) – orthonormal, what is
    in the model; residual : (n,); sign : of the amplitude of one column, 0 where it may have any
    """
    power = np.asarray((rows * rows).sum(axis=1)).reshape(k, -1)
    size, count = np.sqrt(power.sum(axis=1)), power.shape[1]
    each = np.repeat(np.where(size > 0, size, 1.0), count)
    onto = rows @ Q.T / each[:, None]
    alone = (rows @ rows.T).toarray() / np.outer(each, each)
    gram = (alone - onto @ onto.T).reshape(k, count, k, count)
    sums = np.zeros((k, count + 1, k, count + 1))
    sums[:, 1:, :, 1:] = gram.cumsum(axis=1).cumsum(axis=3)
    along = np.zeros((k, count + 1))
    along[:, 1:] = (rows @ residual / each).reshape(k, count).cumsum(axis=1)
    first, last = np.triu_indices(count)
    i, j = first, last + 1
    left = (sums[:, j, :, j] - sums[:, i, :, j] - sums[:, j, :, i] + sums[:, i, :, i]).reshape(-1, k, k)
    inner = (along[:, j] - along[:, i]).T
    own = np.einsum("mii->mi", left)
    # What is not there, or in the model already, takes nothing away.
    seen = own > _THERE
    left = left * seen[:, :, None] * seen[:, None, :]
    scale = np.where(seen, own, 1.0)
    np.einsum("mii->mi", left)[:] = np.where(seen, own * (1 + _ALONE), 1.0)
    inner = inner * seen
    gain: Float1D = np.einsum(
        "mi,mi->m", inner, np.linalg.solve(left / scale[:, :, None], (inner / scale)[..., None])[..., 0]
    )
    gain[inner[:, 0] * sign < 0] = 0.0
    return first, last, gain
