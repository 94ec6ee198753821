"""One cell of a height map under a tool that cuts it wholly or partly, compiled.

In:  a cell (j, i) of `pido.process.height_map`, the height that the tool lowers it to, the share that the tool covers.
Out: the mean height removed; the cell is changed in place.

Each cell keeps more than a height, so that a wall may stand anywhere inside it: a share `cov` of the cell is at height
`low`, the rest at `top`, and (n_u, n_v) points from the removed part to the wall. A tool covers a cell by the area that
a straight edge at the rim's distance and direction cuts from a unit square, exactly. Covering the same part twice
removes it once. Without this, a slot's width is a whole number of cells: 0.4 % wrong at 45 degrees and 0.1 mm, for a
10 mm tool, and 3 % for a 3 mm tool.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

TOP, LOW, COV, N_U, N_V = 0, 1, 2, 3, 4
FIELDS = 5
HALF_DIAGONAL = 0.7072
SKIN, SLIVER = 1e-5, 1e-6
"""What the cells' numbers cannot tell apart: heights (mm) and shares of a cell. A deeper cut takes it later."""
PARALLEL = 0.5
"""Cosine between two walls in one cell: above it they are the same wall, below minus it opposite ones."""


FAST = {"contract", "reassoc", "arcp", "nsz"}  # not nnan, ninf: a missing position must stay recognisable


@njit(cache=True, error_model="numpy", fastmath=FAST, inline="always")
def covered(s, n_u, n_v):
    """Area of a unit square behind a line at signed distance s beyond its centre, with normal (n_u, n_v)."""
    a, b = abs(n_u), abs(n_v)
    if a < b:
        a, b = b, a
    t = abs(s)
    outer = 0.5 * (a + b)
    if t >= outer:
        share = 1.0
    elif t <= 0.5 * (a - b):
        share = 0.5 + t / a
    else:
        share = 1.0 - (outer - t) ** 2 / (2.0 * a * b)
    return share if s >= 0.0 else 1.0 - share


@njit(cache=True, error_model="numpy", fastmath=FAST, inline="always")
def cut_whole(cells, j, i, z):
    """Lower a whole cell to z; mean height removed."""
    removed = 0.0
    cov = cells[COV, j, i]
    if cov > 0.0:
        if cells[LOW, j, i] > z + SKIN:
            removed += cov * (cells[LOW, j, i] - z)
            cells[LOW, j, i] = z
        if cells[TOP, j, i] > z + SKIN:
            removed += (1.0 - cov) * (cells[TOP, j, i] - z)
            cells[TOP, j, i] = z
        if cells[LOW, j, i] >= cells[TOP, j, i]:
            cells[COV, j, i] = 0.0
    elif cells[TOP, j, i] > z + SKIN:
        removed = cells[TOP, j, i] - z
        cells[TOP, j, i] = z
    return removed


@njit(cache=True, error_model="numpy", fastmath=FAST, inline="always")
def cut_part(cells, j, i, c, z, n_u, n_v):
    """Lower the share c of a cell to z, behind a wall with normal (n_u, n_v); mean height removed."""
    top, low, cov = cells[TOP, j, i], cells[LOW, j, i], cells[COV, j, i]
    if z + SKIN >= top:
        return 0.0
    if cov == 0.0:
        cells[LOW, j, i], cells[COV, j, i], cells[N_U, j, i], cells[N_V, j, i] = z, c, n_u, n_v
        return c * (top - z)
    along = n_u * cells[N_U, j, i] + n_v * cells[N_V, j, i]
    if along > PARALLEL:
        union = max(c, cov)
    elif along < -PARALLEL:
        union = min(1.0, c + cov)
    else:
        union = c + cov - c * cov
    extra = union - cov
    removed = 0.0
    if low > z + SKIN:
        deeper = (c - extra) * (low - z)
        removed += deeper
        low -= deeper / cov
    if extra > SLIVER:
        removed += extra * (top - z)
        low = (low * cov + z * extra) / union
    else:
        union = cov
    if c >= cov:
        cells[N_U, j, i], cells[N_V, j, i] = n_u, n_v
    if union >= 0.9999:
        cells[TOP, j, i], cells[COV, j, i] = low, 0.0
    else:
        cells[LOW, j, i], cells[COV, j, i] = low, union
    return removed


@njit(cache=True, error_model="numpy", fastmath=FAST)
def row_span(v, u0, v0, d_u, d_v, length, radius):
    """Where a capsule (half width `radius`, from (u0, v0) along (d_u, d_v)) meets the row at v: (from, to)."""
    low, high = np.inf, -np.inf
    for end in (0.0, length):
        y = v - v0 - end * d_v
        if abs(y) <= radius:
            x = math.sqrt(radius * radius - y * y)
            u = u0 + end * d_u
            low, high = min(low, u - x), max(high, u + x)
    y = v - v0
    for side in (-radius, radius):  # corners of the rectangle between the two ends
        # the edge runs from foot to foot + length * d, foot = start + side * normal(-d_v, d_u)
        along = d_v * length
        if along != 0.0:
            t = (y - side * d_u) / along
            if 0.0 <= t <= 1.0:
                u = u0 - side * d_v + t * length * d_u
                low, high = min(low, u), max(high, u)
    return low, high
