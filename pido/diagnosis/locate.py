"""Where a mismatch acts: sample by sample, as intervals of each part, in bins of M, NC blocks and places.

In:  the modelled mismatch of one axis and how loud its noise is.
Out: a score in 0..1 per sample that ranks samples by how surely the mismatch stands out, and what people can act on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from pido.core.arrays import Bool1D, Float1D
from pido.diagnosis.finding import Interval
from pido.diagnosis.state import AxisState

_MERGE_S = 0.2  # pauses shorter than this do not split an interval
_MOST = 60  # intervals per part; more are merged until so many are left
_STRETCHES = 40  # of the travel, in which an effect is compared
_FEW_ROWS = 10
_FEWEST_GAPS = 4  # from one interval to the next, that make a rhythm if they are the same but for this share
_SAME_GAP = 0.03
_VOXEL = (2.0, 2.0, 10.0)  # mm/s, mm/s, mm²: the grid in which bins of M are reported


def score(effect: Float1D, noise_level: Float1D | float) -> Float1D:
    """(n,) – 0 where nothing is modelled, 0.5 where the mismatch is as large as the noise, towards 1 above.

    >>> score(np.array([0.0, 1.0, 3.0]), 1.0).round(3).tolist()
    [0.0, 0.5, 0.9]
    """
    ratio = np.abs(effect) / np.maximum(noise_level, 1e-12)
    return ratio**2 / (1.0 + ratio**2)


def active(effect: Float1D, noise_level: float) -> Bool1D:
    """(n,) – samples in which the effect is a noticeable part of its own usual size."""
    size = np.abs(effect)
    if not np.any(size > 0):
        return np.zeros(len(effect), bool)
    usual = float(np.quantile(size[size > 0], 0.95))
    return size > 0.25 * usual if usual > 0 else np.zeros(len(effect), bool)


def intervals(part: str, time: Float1D, act: Bool1D, scores: Float1D) -> list[Interval]:
    """Stretches of activity, merged across short pauses; each with the mean score of its active samples."""
    if not act.any():
        return []
    dt = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    merge = _MERGE_S
    while True:
        width = max(1, 2 * int(merge / dt / 2) + 1) if dt > 0 else 1
        closed = _closing(act, width)
        edges = np.flatnonzero(np.diff(np.r_[False, closed, False].astype(np.int8)))
        first, last = edges[::2], edges[1::2] - 1
        if len(first) <= _MOST or merge > 1e4:
            break
        merge *= 2
    return [
        Interval(
            part, *lasting(time, float(time[i]), float(time[j])), float(np.mean(scores[i : j + 1][act[i : j + 1]]))
        )
        for i, j in zip(first, last, strict=True)
        if act[i : j + 1].any()
    ]


def lasting(time: Float1D, start: float, end: float) -> tuple[float, float]:
    """First and last time of a stretch of samples, s; a single sample lasts until the next one, the last of a part
    since the one before.

    >>> lasting(np.array([0.0, 0.02, 0.04]), 0.02, 0.02), lasting(np.array([0.0, 0.02, 0.04]), 0.04, 0.04)
    ((0.02, 0.04), (0.02, 0.04))
    """
    if end > start or len(time) < 2:
        return start, end
    i = min(int(np.searchsorted(time, start)), len(time) - 2)
    return float(time[i]), float(time[i + 1])


def voxels(
    states: Sequence[AxisState], act: Sequence[Bool1D], velocity_xy: Sequence[tuple[Float1D, Float1D] | None]
) -> tuple[tuple[float, float, float], ...]:
    """Centres (v_x, v_y, AR) of the bins of M in which the effect is active most of the time, fullest first."""
    cells: dict[tuple[int, int, int], list[int]] = {}
    for state, a, v in zip(states, act, velocity_xy, strict=True):
        if v is None or state.ar is None:
            continue
        index = np.column_stack(
            [np.floor(v[0] / _VOXEL[0]), np.floor(v[1] / _VOXEL[1]), np.floor(np.nan_to_num(state.ar) / _VOXEL[2])]
        )
        keys, inverse = np.unique(np.nan_to_num(index).astype(int), axis=0, return_inverse=True)
        seen, hit = np.bincount(inverse.ravel()), np.bincount(inverse.ravel(), a.astype(float))
        for key, n, h in zip(keys, seen, hit, strict=True):
            cell = cells.setdefault((int(key[0]), int(key[1]), int(key[2])), [0, 0])
            cell[0] += int(n)
            cell[1] += int(h)
    full = sorted((c for c, (n, h) in cells.items() if h > 0.5 * n and h >= 5), key=lambda c: -cells[c][1])
    return tuple(((i + 0.5) * _VOXEL[0], (j + 0.5) * _VOXEL[1], (k + 0.5) * _VOXEL[2]) for i, j, k in full[:20])


def nc_lines(states: Sequence[AxisState], act: Sequence[Bool1D]) -> tuple[int, ...]:
    """NC blocks in which the effect is active in a larger share of samples than elsewhere, at least a tenth."""
    total: dict[int, list[int]] = {}
    for state, a in zip(states, act, strict=True):
        if state.nc_line is None:
            continue
        line = np.asarray(state.nc_line, float)
        for value in np.unique(line[np.isfinite(line)]):
            rows = line == value
            cell = total.setdefault(int(value), [0, 0])
            cell[0] += int(rows.sum())
            cell[1] += int((rows & a).sum())
    return tuple(sorted(k for k, (n, h) in total.items() if h > 0.1 * n))


def workpiece_area(states: Sequence[AxisState], act: Sequence[Bool1D]) -> str | None:
    """The rectangle on the workpiece that holds nine tenths of the activity while engaged."""
    xs, ys = [], []
    for state, a in zip(states, act, strict=True):
        if state.wx is None or state.wy is None or state.engaged is None:
            continue
        rows = a & np.asarray(state.engaged, bool)
        xs.append(state.wx[rows])
        ys.append(state.wy[rows])
    if not xs or sum(map(len, xs)) < 20:
        return None
    x, y = (np.quantile(np.concatenate(v), [0.05, 0.95]) for v in (xs, ys))
    return f"x {x[0]:.1f} to {x[1]:.1f} mm, y {y[0]:.1f} to {y[1]:.1f} mm"


def strongest_stretch(states: Sequence[AxisState], effect: Float1D) -> tuple[float, float] | None:
    """From where to where along the travel an effect is at least half of what it is at its strongest, mm.

    effect : (n,), A, over all parts. None where that is in several places, or in most of them.
    """
    if any(s.pos is None for s in states):
        return None
    pos, size = np.concatenate([np.asarray(s.pos, float) for s in states]), np.abs(effect)
    seen = np.isfinite(pos) & (size > 0)
    if not seen.any() or np.ptp(pos[seen]) == 0:
        return None
    edges = np.linspace(pos[seen].min(), pos[seen].max(), _STRETCHES + 1)
    at = np.clip(np.searchsorted(edges, pos[seen], side="right") - 1, 0, _STRETCHES - 1)
    count = np.bincount(at, minlength=_STRETCHES)
    there = np.flatnonzero(count >= _FEW_ROWS)
    level = np.bincount(at, size[seen], minlength=_STRETCHES)[there] / count[there]
    strong = np.flatnonzero(level >= 0.5 * level.max(initial=0.0))
    if len(strong) == 0 or len(strong) > 0.7 * len(there) or np.any(np.diff(strong) > 1):
        return None
    return float(edges[there[strong[0]]]), float(edges[there[strong[-1]] + 1])


def rhythm(found: Sequence[Interval]) -> float | None:
    """Time from one interval to the next, s, where it is the same each time; None where it is not, or too few tell.

    Only what lies within one part is compared: between parts the clock may not be known.
    """
    starts: dict[str, list[float]] = {}
    for one in found:
        starts.setdefault(one.part, []).append(one.t_start)
    gaps = np.concatenate([np.diff(np.sort(s)) for s in starts.values()]) if starts else np.zeros(0)
    if len(gaps) < _FEWEST_GAPS:
        return None
    usual = float(np.median(gaps))
    return usual if np.all(np.abs(gaps - usual) < _SAME_GAP * usual) else None


def smooth(values: Float1D, width: int) -> Float1D:
    """Running mean over `width` samples."""
    return uniform_filter1d(values, max(1, width), mode="nearest")


def _closing(act: Bool1D, width: int) -> Bool1D:
    if width <= 1:
        return act
    grown = maximum_filter1d(act.astype(np.int8), width, mode="constant")
    return ~(maximum_filter1d((1 - grown).astype(np.int8), width, mode="constant").astype(bool)) | act
