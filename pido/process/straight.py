"""Many steps on one straight, level line, swept at once, compiled.

In:  cells of a height map, samples on a line, a flat tool whose disc at the first of them is clear.
Out: per step what it removed, as if the steps had been swept one by one; the cells are changed in place.

Each cell is visited once, for the whole line. What it loses is shared among the steps that the rim takes to pass over
it: step k gets the growth of the area that the disc covers between samples k - 1 and k. Untouched cells of one height
in a row of the grid are one stretch, which is shared as a whole: over a band of the width of one cell the disc reaches
from `back` to `front`, and both are known at every sample.

Stretches are cut in a frame with its origin at the first sample, turned over where needed so that the line runs to
larger x and y: direction (c, s), c and s >= 0.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pido.process.cells import (
    COV,
    FAST,
    HALF_DIAGONAL,
    LOW,
    N_U,
    N_V,
    SKIN,
    TOP,
    covered,
    cut_part,
    cut_whole,
    row_span,
)

STRAIGHT = 1e-3
"""Cells by which a sample may lie beside the line."""
COARSE = 4.0
"""Cells per radius below which the rim is too curved within a cell for what follows."""
STEEP = 0.9
"""Share of the radius beside which the rim passes over a cell slowly, and its curve counts."""
SHORT = 4
"""Cells below which a stretch is not worth its own arithmetic."""
POLE = 2.5
"""Cells from the disc's uppermost and lowest point within which a chord changes too much over one cell."""
PARTS = 8
"""Into which a band is divided there."""
ALONG = 1e-12
"""Sine of the angle to the rows of the grid below which a line runs along them."""


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
def _under(y, radius):
    """Area under a circle's half chord from 0 to y."""
    y = min(max(y / radius, -1.0), 1.0)
    return 0.5 * radius * radius * (y * math.sqrt(1.0 - y * y) + math.asin(y))


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _half_chord(y, wide, radius):
    """Over the band from y - wide to y + wide: mean half chord of a circle, 0 beyond it, and half of its range."""
    r2 = radius * radius
    if abs(y) < radius - 8.0 * wide:
        rim = math.sqrt(r2 - y * y)
        return rim - wide * wide * r2 / (6.0 * rim * rim * rim), wide * abs(y) / rim + 1e-9
    near, far = max(abs(y) - wide, 0.0), abs(y) + wide
    high, low = math.sqrt(max(r2 - near * near, 0.0)), math.sqrt(max(r2 - far * far, 0.0))
    return (_under(y + wide, radius) - _under(y - wide, radius)) / (2.0 * wide), 0.5 * (high - low) + 1e-9


@njit(cache=True, error_model="numpy", fastmath=FAST, inline="always")
def _passed(x, count, h):
    """Cells of a band that an oblique edge has passed; it reaches from x - h to x + h, counted from the first cell."""
    a, b = min(max(x, -h), h) + h, min(max(x - count, -h), h) + h
    return max(x - h, 0.0) - max(x - count - h, 0.0) + (a * a - b * b) / (4.0 * h)


@njit(cache=True, error_model="numpy", fastmath=FAST, inline="always")
def _reached_at(x, y, c, s, radius):
    """Way at which the disc touches the point (x, y)."""
    q = y * c - x * s
    return x * c + y * s - math.sqrt(max(radius * radius - q * q, 0.0))


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _even_until(top, cov, i, end):
    """The end of the stretch of untouched cells of the height of cell i."""
    height = top[i]
    while i + 32 <= end:
        others = 0
        for c in range(32):
            others += (top[i + c] != height) | (cov[i + c] > 0.0)
        if others:
            break
        i += 32
    while i < end and cov[i] == 0.0 and top[i] == height:
        i += 1
    return i


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _cover_along(at, begin, count, y, share, radius, area):
    """Cells of a stretch that the disc covers at each sample of a line along the row."""
    half, h = _half_chord(y, 0.5, radius)
    offset = half / share - begin
    bent = abs(y) > radius - POLE
    for m in range(len(at)):
        x = at[m] + offset
        area[m] = _passed(x, count, h)
        if bent and (x < 2.0 * h or x > count - 2.0 * h):  # where the rim lies wholly within, its form does not matter
            area[m] = 0.0
            for part in range(PARTS):
                v = y - 0.5 + (part + 0.5) / PARTS
                reached = min(max((radius - abs(v)) * PARTS + 0.5, 0.0), 1.0)
                if reached > 0.0:
                    chord, wide = _half_chord(v, 0.5 / PARTS, radius)
                    area[m] += reached * _passed(at[m] + chord / reached - begin, count, wide)
            area[m] /= PARTS * share


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _cover_pole(at, begin, count, y, c, s, radius, area, first):
    """Cells of a stretch that the disc covers at each sample, and the first moment of them about the origin."""
    for m in range(len(at)):
        area[m], first[m] = 0.0, 0.0
        for part in range(PARTS):
            v = y - 0.5 + (part + 0.5) / PARTS
            t = max(min(at[m], (v + c * radius) / s), 0.0)
            half, h = _half_chord(v - t * s, 0.5 / PARTS, radius)
            front = _passed(t * c + half - begin, count, h)
            t = max(min(at[m], (v - c * radius) / s), 0.0)
            half, h = _half_chord(v - t * s, 0.5 / PARTS, radius)
            back = _passed(t * c - half - begin, count, h)
            area[m] += (front - back) / PARTS
            first[m] += (front * (begin + 0.5 * front) - back * (begin + 0.5 * back)) / PARTS


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _cover(at, begin, count, y, c, s, radius, area, first):
    """As `_cover_pole`, where the chord hardly bends over one cell."""
    front_stops, back_stops = (y + c * radius) / s, (y - c * radius) / s
    r2 = radius * radius
    for m in range(len(at)):
        t = min(at[m], front_stops)
        b = y - t * s
        rim = math.sqrt(r2 - b * b)
        front = _passed(t * c + rim - r2 / (24.0 * rim * rim * rim) - begin, count, 0.5 * abs(b) / rim + 1e-9)
        area[m] = front
        first[m] = front * (begin + 0.5 * front)
    if len(at) == 0:
        return
    t = max(min(at[0], back_stops), 0.0)
    half, h = _half_chord(y - t * s, 0.5, radius)
    if t * c - half + h <= begin:
        return  # the stretch lies ahead of the back, which only moves away from it
    if at[0] >= back_stops:
        back = _passed(t * c - half - begin, count, h)
        for m in range(len(at)):
            area[m] -= back
            first[m] -= back * (begin + 0.5 * back)
        return
    for m in range(len(at)):
        t = min(at[m], back_stops)
        b = y - t * s
        rim = math.sqrt(r2 - b * b)
        back = _passed(t * c - rim + r2 / (24.0 * rim * rim * rim) - begin, count, 0.5 * abs(b) / rim + 1e-9)
        area[m] -= back
        first[m] -= back * (begin + 0.5 * back)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _share_out(area, first, height, beside, s, side, moment, depth):
    """Give each step the growth of what the disc covers of a stretch; arrays from the sample before the first step."""
    for m in range(len(side)):
        grown = max(area[m + 1] - area[m], 0.0)
        side[m] += height * grown
        moment[m] += height * (beside * grown - s * (first[m + 1] - first[m]))
        depth[m] = max(depth[m], height if grown > 1e-9 else 0.0)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _cut_even(cells, j, i0, i1, share, u0, v0, d_u, d_v, z, radius, at, out, area, first):
    """Lower a stretch of a row to z, or a share of it where the line runs along the row, and share it among the steps.

    at : where each sample stands along the line; out : from the line's first sample; area, first : room for as many
    """
    top = cells[TOP, j]
    height = float(top[i0]) - z
    if share < 1.0:
        cells[LOW, j, i0:i1] = z
        cells[COV, j, i0:i1] = share
        cells[N_U, j, i0:i1] = 0.0
        cells[N_V, j, i0:i1] = 1.0 if j + 0.5 > v0 else -1.0
    else:
        top[i0:i1] = z
    c, s = abs(d_u), abs(d_v)
    count = float(i1 - i0)
    begin = i0 - u0 if d_u >= 0.0 else u0 - i1
    y = j + 0.5 - v0 if d_v >= 0.0 else v0 - j - 0.5
    turned = 1.0 if (d_u >= 0.0) == (d_v >= 0.0) else -1.0
    soonest, latest = np.inf, -np.inf
    for v in (y - 0.5, y + 0.5):
        x = begin if s <= ALONG else min(max((v - radius) * c / s, begin), begin + count)
        soonest = min(soonest, _reached_at(x, v, c, s, radius))
        latest = max(latest, _reached_at(begin, v, c, s, radius), _reached_at(begin + count, v, c, s, radius))
    end = len(at) - 1
    a = min(max(np.searchsorted(at, soonest - 0.1), 1), end)  # the rim bulges between the band's two borders
    b = min(max(np.searchsorted(at, latest), a), end)
    steps, cover, about = at[a : b + 1], area[1 : b - a + 2], first[1 : b - a + 2]
    if s <= ALONG:
        _cover_along(steps, begin, count, y, share, radius, cover)
        for m in range(len(steps)):
            about[m] = 0.0
    else:
        smooth = np.searchsorted(steps, (y - radius + POLE) / s)
        lower = max(np.searchsorted(steps, (y + radius - POLE) / s), smooth)
        _cover_pole(steps[:smooth], begin, count, y, c, s, radius, cover[:smooth], about[:smooth])
        _cover(steps[smooth:lower], begin, count, y, c, s, radius, cover[smooth:lower], about[smooth:lower])
        _cover_pole(steps[lower:], begin, count, y, c, s, radius, cover[lower:], about[lower:])
    area[0], first[0] = 0.0, 0.0
    area[b - a + 1], first[b - a + 1] = count, count * (begin + 0.5 * count)
    beside = turned * y * c
    _share_out(
        area[: b - a + 2],
        first[: b - a + 2],
        share * height,
        beside,
        turned * s,
        out[0, a : b + 1],
        out[2, a : b + 1],
        out[3, a : b + 1],
    )


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _cut_one(cells, j, i, u0, v0, d_u, d_v, tip, z, radius, at, out, k):
    """Cut one cell and share it among the steps. The search for its first step begins at k and ends at what returns."""
    end = len(at) - 1
    length = at[end]
    outer = radius + HALF_DIAGONAL
    sure = max(radius - HALF_DIAGONAL, 0.0)
    before = float(cells[TOP, j, i])
    x, y = i + 0.5 - u0, j + 0.5 - v0
    s, q = x * d_u + y * d_v, y * d_u - x * d_v
    if abs(q) <= STEEP * radius:
        # Over one cell the rim is a straight edge: its normal is that of the point which passes the centre.
        rim = math.sqrt(radius * radius - q * q)
        slope = rim / radius
        n_x, n_y = (rim * d_u - q * d_v) / radius, (rim * d_v + q * d_u) / radius
        ramp = 0.5 * (abs(n_x) + abs(n_y)) / slope
        reach, whole = rim + ramp, rim - ramp
        if s - whole <= length and s - reach >= 0.0:
            removed = cut_whole(cells, j, i, z)
            if removed <= 0.0:
                return k
            begins, complete = s - reach, s - whole
            while k > 1 and at[k - 1] > begins:
                k -= 1
            while k < end and at[k] <= begins:
                k += 1
            left, m = removed, k
            while at[m] < complete:
                still = removed * (1.0 - covered((at[m] - s + rim) * slope, n_x, n_y))
                out[0, m] += left - still
                out[2, m] += (left - still) * q
                out[3, m] = max(out[3, m], before - tip)
                left = still
                m += 1
            out[0, m] += left
            out[2, m] += left * q
            out[3, m] = max(out[3, m], before - tip)
            return k
    else:
        reach = math.sqrt(max(outer * outer - q * q, 0.0))
        whole = math.sqrt(max(sure * sure - q * q, 0.0))
    if s - reach >= length:
        return k
    if s - whole <= length and abs(q) < sure:
        final = 1.0
        removed = cut_whole(cells, j, i, z)
    else:
        ahead = max(s - length, 0.0)
        d = math.sqrt(q * q + ahead * ahead)
        if d >= outer:
            return k
        e_x, e_y = (ahead * d_u - q * d_v) / d, (ahead * d_v + q * d_u) / d
        final = covered(radius - d, e_x, e_y)
        if final >= 0.9999:
            removed = cut_whole(cells, j, i, z)
        elif final > 1e-4:
            removed = cut_part(cells, j, i, final, z, e_x, e_y)
        else:
            return k
    if removed <= 0.0:
        return k
    deep = before - tip if removed > 1e-6 else 0.0
    begins = s - reach
    while k > 1 and at[k - 1] > begins:
        k -= 1
    while k < end and at[k] <= begins:
        k += 1
    # `k` is the first sample whose disc touches the cell
    complete = s - whole if abs(q) < sure else s
    if at[k] >= complete and at[k - 1] <= begins:
        out[0, k] += removed
        out[2, k] += removed * q
        out[3, k] = max(out[3, k], deep)
        return k
    last_share = _share(s - at[k - 1], q, radius, d_u, d_v)
    to_come = final - last_share
    m = k
    while True:
        now = final if m == end or at[m] >= complete else _share(s - at[m], q, radius, d_u, d_v)
        part = removed * (now - last_share) / to_come if to_come > 1e-9 else removed
        if part > 0.0:
            out[0, m] += part
            out[2, m] += part * q
            out[3, m] = max(out[3, m], deep)
        last_share = now
        if m == end or at[m] >= complete or to_come <= 1e-9:
            break
        m += 1
    return k


@njit(cache=True, error_model="numpy", fastmath=FAST)
def sweep_run(cells, pos, first, last, radius, out):
    """Remove what a flat tool sweeps from sample first - 1 to sample last.

    cells, pos, out : as in `pido.process.sweep.sweep`; columns first to last of `out` are filled
    radius : cells
    """
    n_v, n_u = cells.shape[1], cells.shape[2]
    start = first - 1
    u0, v0, w0 = pos[start, 0], pos[start, 1], pos[start, 2]
    length = math.hypot(pos[last, 0] - u0, pos[last, 1] - v0)
    d_u, d_v = (pos[last, 0] - u0) / length, (pos[last, 1] - v0) / length
    at = np.empty(last - start + 1)  # where each sample stands along the line
    for k in range(len(at)):
        at[k] = (pos[start + k, 0] - u0) * d_u + (pos[start + k, 1] - v0) * d_v
    # Filled here and copied below: the sample before the first step belongs to another run.
    steps = np.zeros((4, len(at)))
    area, about = np.empty(len(at) + 1), np.empty(len(at) + 1)
    outer = radius + HALF_DIAGONAL
    tip = max(w0, 0.0)
    z = np.float32(tip)
    k = 1  # neighbouring cells are reached by neighbouring steps: the search for one begins at the last one's

    j0 = max(math.floor(min(v0, pos[last, 1]) - outer - 0.5), 0)
    j1 = min(math.ceil(max(v0, pos[last, 1]) + outer + 0.5), n_v)
    next_from, next_to = row_span(float(j0), u0, v0, d_u, d_v, length, radius)
    for j in range(j0, j1):
        y = j + 0.5 - v0
        # Cells between the capsule's chords at both borders of the row are cleared wholly.
        from_, to = next_from, next_to
        next_from, next_to = row_span(j + 1.0, u0, v0, d_u, d_v, length, radius)
        from_, to = max(from_, next_from), min(to, next_to)
        share = 1.0
        if abs(d_v) <= ALONG and abs(abs(y) - radius) < 0.4999:
            share = 0.5 + radius - abs(y)
            from_, to = min(u0, u0 + length * d_u), max(u0, u0 + length * d_u)
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
        whole_from, whole_to = i1, i1
        if from_ <= to:
            whole_from, whole_to = max(math.ceil(from_), i0), min(math.floor(to), i1)
        top, cov = cells[TOP, j], cells[COV, j]
        i = i0
        while i < i1:
            if top[i] <= tip:
                i += 1
                continue
            if whole_from <= i and i + SHORT <= whole_to and cov[i] == 0.0 and top[i] > z + SKIN:
                to_ = _even_until(top, cov, i, whole_to)
                if to_ - i >= SHORT:
                    _cut_even(cells, j, i, to_, share, u0, v0, d_u, d_v, z, radius, at, steps, area, about)
                    i = to_
                    continue
            k = _cut_one(cells, j, i, u0, v0, d_u, d_v, tip, z, radius, at, steps, k)
            i += 1
    for m in range(4):
        out[m, first : last + 1] = steps[m, 1:]
