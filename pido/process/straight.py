"""Many steps on one straight, level line, swept at once, compiled.

In:  cells of a height map, samples on a line, a flat tool whose disc at the first of them is clear.
Out: per step what it removed, as if the steps had been swept one by one; the cells are changed in place.

Each cell is visited once, for the whole line. What it loses is shared among the steps that the rim takes to pass over
it: step k gets the growth of the area that the disc covers between samples k - 1 and k. Where the line runs along a
row of the grid, untouched cells of one height are shared together.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pido.process.cells import COV, FAST, HALF_DIAGONAL, SKIN, TOP, covered, cut_part, cut_whole, row_span

STRAIGHT = 1e-3
"""Cells by which a sample may lie beside the line."""
COARSE = 4.0
"""Cells per radius below which the rim is too curved within a cell for what follows."""
STEEP = 0.9
"""Share of the radius beside which the rim passes over a cell slowly, and its curve counts."""


@njit(cache=True, error_model="numpy", fastmath=FAST)
def straight_run(pos, tool, k):
    """The last sample of the line that the step from k - 1 to k begins: k itself where the next step leaves it."""
    u0, v0, w0 = pos[k - 1, 0], pos[k - 1, 1], pos[k - 1, 2]
    length = math.hypot(pos[k, 0] - u0, pos[k, 1] - v0)
    d_u, d_v = (pos[k, 0] - u0) / length, (pos[k, 1] - v0) / length
    reached, last = length, k
    for e in range(k + 1, len(pos)):
        x, y = pos[e, 0] - u0, pos[e, 1] - v0
        along = x * d_u + y * d_v
        beside = abs(y * d_u - x * d_v)
        # written so that a missing position ends the line
        if not (tool[e] == tool[k] and beside <= STRAIGHT and pos[e, 2] == w0 and along >= reached):
            break
        reached, last = along, e
    return last


@njit(cache=True, error_model="numpy", fastmath=FAST, inline="always")
def _share(x, q, radius, d_u, d_v):
    """Area of a cell that the disc covers once its centre is x short of the cell along the line, q beside it."""
    ahead = max(x, 0.0)
    d = math.sqrt(q * q + ahead * ahead)
    if d <= radius - HALF_DIAGONAL:
        return 1.0
    if d >= radius + HALF_DIAGONAL:
        return 0.0
    return covered(radius - d, (ahead * d_u - q * d_v) / d, (ahead * d_v + q * d_u) / d)


@njit(cache=True, error_model="numpy", fastmath=FAST, inline="always")
def _edge(q, d_u, radius):
    """Where the rim is over a row that the line runs along: (rim, slope, normal in u and v, ramp), lengths in cells."""
    rim = math.sqrt(radius * radius - q * q)
    slope = rim / radius
    n_x, n_y = slope * d_u, q * d_u / radius
    return rim, slope, n_x, n_y, 0.5 * (abs(n_x) + abs(n_y)) / slope


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _even_stretch(cells, j, i0, i1, u0, d_u, y, z, length, radius):
    """From, to: the first stretch of untouched cells of one height that the rim passes over wholly."""
    rim, _, _, _, ramp = _edge(y * d_u, d_u, radius)
    # a cell at s along the line: s - rim + ramp <= length and s - rim - ramp >= 0
    low, high = rim + ramp, length + rim - ramp
    if d_u > 0.0:
        a, b = math.ceil(u0 + low - 0.5), math.floor(u0 + high - 0.5) + 1
    else:
        a, b = math.ceil(u0 - high - 0.5), math.floor(u0 - low - 0.5) + 1
    a, b = max(a, i0), min(b, i1)
    while a < b and (cells[j, a, COV] > 0.0 or cells[j, a, TOP] <= z + SKIN):
        a += 1
    end = a
    while end < b and cells[j, end, COV] == 0.0 and cells[j, end, TOP] == cells[j, a, TOP]:
        end += 1
    return a, end


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _cut_even(cells, j, i0, i1, u0, d_u, y, z, radius, at, start, out):
    """Lower an even stretch of a row to z, and share it among the steps.

    The area that the disc covers of a row of equal cells grows with its way, one cell per cell, once the rim's edge
    lies within the stretch; only where it enters or leaves the stretch are the cells under the edge looked at singly.
    """
    if i1 <= i0:
        return
    q = y * d_u
    rim, slope, n_x, n_y, ramp = _edge(q, d_u, radius)
    height = cells[j, i0, TOP] - z
    for i in range(i0, i1):
        cells[j, i, TOP] = z
    first = (i0 + 0.5 - u0) * d_u if d_u > 0.0 else (i1 - 0.5 - u0) * d_u  # along the line
    count = i1 - i0
    k = np.searchsorted(at, first - rim - ramp)
    before, m = 0.0, max(k, 1)
    while m < len(at) and before < count:
        edge = at[m] - first + rim  # cells from the middle of the first one
        if edge >= ramp and edge <= count - 1 - ramp:
            area = edge + 0.5
        else:
            a, b = max(math.ceil(edge - ramp), 0), min(math.floor(edge + ramp), count - 1)
            area = min(max(a, 0), count) * 1.0
            for c in range(a, b + 1):
                area += covered((edge - c) * slope, n_x, n_y)
        grown = height * (area - before)
        if grown > 0.0:
            out[start + m, 0] += grown
            out[start + m, 2] += grown * q
            out[start + m, 3] = max(out[start + m, 3], height)
        before = area
        m += 1


@njit(cache=True, error_model="numpy", fastmath=FAST)
def sweep_run(cells, pos, first, last, radius, out):
    """Remove what a flat tool sweeps from sample first - 1 to sample last.

    cells, pos, out : as in `pido.process.sweep.sweep`; rows first to last of `out` are filled
    radius : cells
    """
    n_v, n_u = cells.shape[0], cells.shape[1]
    start = first - 1
    u0, v0, w0 = pos[start, 0], pos[start, 1], pos[start, 2]
    length = math.hypot(pos[last, 0] - u0, pos[last, 1] - v0)
    d_u, d_v = (pos[last, 0] - u0) / length, (pos[last, 1] - v0) / length
    at = np.empty(last - start + 1)  # where each sample stands along the line
    for k in range(len(at)):
        at[k] = (pos[start + k, 0] - u0) * d_u + (pos[start + k, 1] - v0) * d_v
    for k in range(first, last + 1):
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = 0.0, 0.0, 0.0, 0.0
    end = len(at) - 1
    outer = radius + HALF_DIAGONAL
    sure = max(radius - HALF_DIAGONAL, 0.0)
    tip = max(w0, 0.0)
    z = np.float32(tip)
    k = 1  # neighbouring cells are reached by neighbouring steps: the search for one begins at the last one's
    old_q, reach, whole, rim, slope, n_x, n_y = np.inf, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0
    steep = STEEP * radius

    j0 = max(math.floor(min(v0, pos[last, 1]) - outer - 0.5), 0)
    j1 = min(math.ceil(max(v0, pos[last, 1]) + outer + 0.5), n_v)
    for j in range(j0, j1):
        y = j + 0.5 - v0
        a0, a1 = row_span(j + 0.5, u0, v0, d_u, d_v, length, outer)
        if not a0 <= a1:
            continue
        # Behind the start the capsule is the disc that is clear.
        if d_u > 1e-12:
            a0 = max(a0, u0 - y * d_v / d_u)
        elif d_u < -1e-12:
            a1 = min(a1, u0 - y * d_v / d_u)
        elif y * d_v < 0.0:
            continue
        i0 = max(math.ceil(a0 - 0.5), 0)
        i1 = min(math.floor(a1 - 0.5) + 1, n_u)
        if abs(d_v) < 1e-12 and abs(y) <= steep:
            even_from, even_to = _even_stretch(cells, j, i0, i1, u0, d_u, y, z, length, radius)
            _cut_even(cells, j, even_from, even_to, u0, d_u, y, z, radius, at, start, out)
        else:
            even_from, even_to = i1, i1
        for n in range(i0, i1 - (even_to - even_from)):
            i = n if n < even_from else n + even_to - even_from
            before = cells[j, i, TOP]
            if before <= tip:
                continue
            x = i + 0.5 - u0
            s, q = x * d_u + y * d_v, y * d_u - x * d_v
            if q != old_q:
                old_q = q
                if abs(q) <= steep:
                    # Over one cell the rim is a straight edge: its normal is that of the point which passes the centre.
                    rim = math.sqrt(radius * radius - q * q)
                    slope = rim / radius
                    n_x, n_y = (rim * d_u - q * d_v) / radius, (rim * d_v + q * d_u) / radius
                    ramp = 0.5 * (abs(n_x) + abs(n_y)) / slope
                    reach, whole = rim + ramp, rim - ramp
                else:
                    reach = math.sqrt(max(outer * outer - q * q, 0.0))
                    whole = math.sqrt(max(sure * sure - q * q, 0.0))
            if s - whole <= length and s - reach >= 0.0 and abs(q) <= steep:
                removed = cut_whole(cells, j, i, z)
                if removed <= 0.0:
                    continue
                begins, complete = s - reach, s - whole
                while k > 1 and at[k - 1] > begins:
                    k -= 1
                while k < end and at[k] <= begins:
                    k += 1
                left, m = removed, k
                while at[m] < complete:
                    still = removed * (1.0 - covered((at[m] - s + rim) * slope, n_x, n_y))
                    out[start + m, 0] += left - still
                    out[start + m, 2] += (left - still) * q
                    out[start + m, 3] = max(out[start + m, 3], before - tip)
                    left = still
                    m += 1
                out[start + m, 0] += left
                out[start + m, 2] += left * q
                out[start + m, 3] = max(out[start + m, 3], before - tip)
                continue
            if s - reach >= length:
                continue
            if s - whole <= length and abs(q) < sure:
                final = 1.0
                removed = cut_whole(cells, j, i, z)
            else:
                ahead = max(s - length, 0.0)
                d = math.sqrt(q * q + ahead * ahead)
                if d >= outer:
                    continue
                e_x, e_y = (ahead * d_u - q * d_v) / d, (ahead * d_v + q * d_u) / d
                final = covered(radius - d, e_x, e_y)
                if final >= 0.9999:
                    removed = cut_whole(cells, j, i, z)
                elif final > 1e-4:
                    removed = cut_part(cells, j, i, final, z, e_x, e_y)
                else:
                    continue
            if removed <= 0.0:
                continue
            deep = before - tip if removed > 1e-6 else 0.0
            begins = s - reach
            while k > 1 and at[k - 1] > begins:
                k -= 1
            while k < end and at[k] <= begins:
                k += 1
            # `k` is the first sample whose disc touches the cell
            complete = s - whole if abs(q) < sure else s
            if at[k] >= complete and at[k - 1] <= begins:
                out[start + k, 0] += removed
                out[start + k, 2] += removed * q
                out[start + k, 3] = max(out[start + k, 3], deep)
                continue
            last_share = _share(s - at[k - 1], q, radius, d_u, d_v)
            to_come = final - last_share
            m = k
            while True:
                now = final if m == end or at[m] >= complete else _share(s - at[m], q, radius, d_u, d_v)
                part = removed * (now - last_share) / to_come if to_come > 1e-9 else removed
                if part > 0.0:
                    out[start + m, 0] += part
                    out[start + m, 2] += part * q
                    out[start + m, 3] = max(out[start + m, 3], deep)
                last_share = now
                if m == end or at[m] >= complete or to_come <= 1e-9:
                    break
                m += 1
