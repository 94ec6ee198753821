"""Stock removal along a path: the loop, compiled.

In:  tool tip positions, tools, and the cells of a height map (`pido.process.height_map`).
Out: per step the volume removed and its first moments; the cells are changed in place.

A step is the volume swept between two samples (a capsule), not a series of discs. Where the tool does not go down, the
disc of the step before is already clear, and only the crescent ahead of it is visited. Steps that follow each other on
one straight, level line are swept together (`pido.process.straight`). What a cell keeps: `pido.process.cells`.

numba keeps the compiled loop until *this* file changes: after a change of `cells` or `straight` alone, delete
`__pycache__` beside it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pido.process.cells import COV, FAST, HALF_DIAGONAL, SKIN, TOP, covered, cut_part, cut_whole, row_span
from pido.process.straight import COARSE, straight_run, sweep_run


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _profile(r, flat, corner, slope):
    """Height of the tool's underside above its tip at radius r (in cells; heights in mm)."""
    if r <= flat:
        return 0.0
    if slope > 0.0:
        return (r - flat) * slope
    x = min((r - flat) / corner[0], 1.0)
    return corner[1] * (1.0 - math.sqrt(1.0 - x * x))


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _lowest(q, s, length, w0, dw, radius, flat, corner, slope):
    """Lowest height that the tool's underside reaches over one point during a sloped step.

    q and s place the point beside and along the step. The underside is convex and the step straight, so height over
    time is convex: a flat tool is lowest where it enters or leaves the point, others are found by ternary search.
    """
    if length == 0.0:
        return w0 + min(dw, 0.0) + _profile(math.hypot(q, s), flat, corner, slope)
    half = math.sqrt(max(radius * radius - q * q, 0.0))
    if length > 0.0:
        t0 = min(max((s - half) / length, 0.0), 1.0)
        t1 = min(max((s + half) / length, 0.0), 1.0)
    else:
        t0, t1 = 0.0, 1.0
    if flat >= radius:
        return w0 + dw * (t1 if dw < 0.0 else t0)
    for _ in range(14):  # places it within 0.4 % of the step; the error in height is of second order
        a = t0 + (t1 - t0) / 3.0
        b = t1 - (t1 - t0) / 3.0
        if w0 + dw * a + _profile(math.hypot(q, s - a * length), flat, corner, slope) < w0 + dw * b + _profile(
            math.hypot(q, s - b * length), flat, corner, slope
        ):
            t1 = b
        else:
            t0 = a
    t = 0.5 * (t0 + t1)
    return w0 + dw * t + _profile(math.hypot(q, s - t * length), flat, corner, slope)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _cut_row(cells, j, i0, i1, z, tip):
    """Lower the cells i0 to i1 of a row wholly to z: (sum removed, its moment about the row's start, deepest cut)."""
    top, cov = cells[TOP, j], cells[COV, j]
    total, about, depth = 0.0, 0.0, 0.0
    for i in range(i0, i1):
        before = top[i]
        if before <= tip:
            continue
        if cov[i] > 0.0:
            removed = cut_whole(cells, j, i, z)
        elif before > z + SKIN:
            removed = float(before) - z
            top[i] = z
        else:
            continue
        total += removed
        about += removed * (i + 0.5)
        if removed > 1e-6:
            depth = max(depth, before - tip)
    return total, about, depth


@njit(cache=True, error_model="numpy", fastmath=FAST)
def sweep(cells, ceiling, pos, tool, radii, flats, corners, slopes, out):
    """Remove what the tools sweep between consecutive samples.

    Parameters
    ----------
    cells : (5, n_v, n_u) float32 – changed in place; heights in mm above the map's bottom
    ceiling : highest `top` of the map, mm: nothing above it is visited
    pos : (n, 3) – tool tip: u, v in cells from the map's corner, w in mm above its bottom; NaN: nobody knows
    tool : (n,) – which tool makes the step that ends here; -1: none, nothing is cut
    radii, flats : (m,) – radius of each tool, and of its flat end, in cells
    corners : (m, 2) – corner radius in cells and in mm
    slopes : (m,) – mm per cell, of a conical end; 0 for others
    out : (4, n) – filled, for the step that ends at each sample: volume removed at the side (mm * cells), volume
        removed by the end, moment of the first about the path (to the left, in cells), axial depth at the side (mm)
    """
    n_v, n_u = cells.shape[1], cells.shape[2]
    clear = -1  # the tool whose disc at the step's start is known to be clear
    done = 0  # steps before this one belong to a run that is swept already
    for k in range(len(pos)):
        if k < done:
            continue
        out[0, k], out[1, k], out[2, k], out[3, k] = 0.0, 0.0, 0.0, 0.0
        m = tool[k]
        first = k == 0 or np.isnan(pos[k - 1, 0] + pos[k - 1, 1] + pos[k - 1, 2])
        if m < 0 or np.isnan(pos[k, 0] + pos[k, 1] + pos[k, 2]):
            clear = -1
            continue
        p = k if first else k - 1  # where nobody saw how the tool came here, it is put down here
        u0, v0, w0 = pos[p, 0], pos[p, 1], pos[p, 2]
        dw = pos[k, 2] - w0
        if min(w0, pos[k, 2]) >= ceiling:
            clear = m
            continue
        length = math.hypot(pos[k, 0] - u0, pos[k, 1] - v0)
        known = clear == m and dw >= 0.0
        clear = m
        if known and length < 1e-9:
            continue
        d_u, d_v = 1.0, 0.0
        if length >= 1e-9:
            d_u, d_v = (pos[k, 0] - u0) / length, (pos[k, 1] - v0) / length
        else:
            length = 0.0

        radius, flat, slope = radii[m], flats[m], slopes[m]
        corner = corners[m]
        is_flat = flat >= radius
        if known and is_flat and dw == 0.0 and radius > COARSE:
            last = straight_run(pos, tool, k)
            if last > k + 1:
                sweep_run(cells, pos, k, last, radius, out)
                done = last + 1
                continue
        outer = radius + HALF_DIAGONAL
        sure = max(radius - HALF_DIAGONAL, 0.0)
        inner = max(flat - HALF_DIAGONAL, 0.0)
        level = is_flat and (dw == 0.0 or length == 0.0)
        level_z = np.float32(max(w0 + min(dw, 0.0), 0.0))
        tip = max(min(w0, pos[k, 2]), 0.0)
        side, end, moment, depth = 0.0, 0.0, 0.0, 0.0

        j0 = max(math.floor(min(v0, pos[k, 1]) - outer - 0.5), 0)
        j1 = min(math.ceil(max(v0, pos[k, 1]) + outer + 0.5), n_v)
        for j in range(j0, j1):
            v = j + 0.5
            y = v - v0
            low, high = row_span(v, u0, v0, d_u, d_v, length, outer)
            if not low <= high:
                continue
            a0, a1 = low, high
            b0, b1 = 0.0, -1.0
            whole_from, whole_to = 0.0, -1.0
            if level:
                whole_from, whole_to = row_span(v, u0, v0, d_u, d_v, length, sure)
            if known:
                # Behind the start the capsule is the disc of the step before.
                if d_u > 1e-12:
                    a0 = max(a0, u0 - y * d_v / d_u)
                elif d_u < -1e-12:
                    a1 = min(a1, u0 - y * d_v / d_u)
                elif y * d_v < 0.0:
                    continue
                if abs(y) < inner:
                    x = math.sqrt(inner * inner - y * y)
                    b0, b1 = max(a0, u0 + x), a1
                    a1 = min(a1, u0 - x)
            for part in range(2):
                if part == 1:
                    a0, a1 = b0, b1
                if a1 < a0:
                    continue
                i0 = max(math.ceil(a0 - 0.5), 0)
                i1 = min(math.floor(a1 - 0.5) + 1, n_u)
                whole0, whole1 = i1, i1
                if level and whole_from <= whole_to:
                    whole0 = min(max(math.ceil(whole_from - 0.5), i0), i1)
                    whole1 = min(max(math.floor(whole_to - 0.5) + 1, whole0), i1)
                    removed, about, deep = _cut_row(cells, j, whole0, whole1, level_z, tip)
                    if dw < 0.0:
                        end += removed
                    else:
                        side += removed
                        moment += removed * y * d_u - (about - removed * u0) * d_v
                        depth = max(depth, deep)
                for n in range(i0, i1 - (whole1 - whole0)):
                    i = n if n < whole0 else n + whole1 - whole0
                    if cells[TOP, j, i] <= tip:
                        continue
                    x = i + 0.5 - u0
                    s = x * d_u + y * d_v
                    q = y * d_u - x * d_v
                    e = min(max(s, 0.0), length)
                    d2 = q * q + (s - e) * (s - e)
                    if d2 >= outer * outer:
                        continue
                    if dw == 0.0:
                        z = level_z
                        if not is_flat and d2 > flat * flat:
                            z = np.float32(max(w0 + _profile(math.sqrt(d2), flat, corner, slope), 0.0))
                    else:
                        z = np.float32(max(_lowest(q, s, length, w0, dw, radius, flat, corner, slope), 0.0))
                    before = cells[TOP, j, i]
                    if d2 <= sure * sure:
                        removed = cut_whole(cells, j, i, z)
                    else:
                        d = math.sqrt(d2)
                        n_x, n_y = (x - e * d_u) / d, (y - e * d_v) / d
                        c = covered(radius - d, n_x, n_y)
                        if c >= 0.9999:
                            removed = cut_whole(cells, j, i, z)
                        elif c > 1e-4:
                            removed = cut_part(cells, j, i, c, z, n_x, n_y)
                        else:
                            removed = 0.0
                    if removed <= 0.0:
                        continue
                    if dw < 0.0:
                        # Where the tool already stood, its end takes what it goes down; all else is the side's.
                        stood = min(max(radius + 0.5 - math.hypot(x, y), 0.0), 1.0)
                        below = min(removed, -dw * stood) if length > 0.0 else removed
                        end += below
                        removed -= below
                        if removed <= 1e-9:
                            continue
                    side += removed
                    moment += removed * q
                    if before - tip > depth and removed > 1e-6:
                        depth = before - tip
        out[0, k], out[1, k], out[2, k], out[3, k] = side, end, moment, depth
