"""Samples of a current that no motor drew: a logger's sentinel, a torn packet, a spike on a cable.

In:  parts of one machine, and the column of a current, recorded or simulated.
Out: per part, the samples that are wrong.
A true peak is never one of them: it comes with a motion, a load or a simulated current that is as far out of the
ordinary, or it has smaller ones of its kind beside it. So a sample is wrong only where it leaves its surroundings for
an instant, by many times the range of all other samples, and nothing else that was recorded or simulated stands out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.ndimage import median_filter

from pido.core.arrays import Bool1D, Float1D
from pido.core.columns import ACCELERATION, CURRENT, CURRENT_SIM, POSITION, PROCESS, VELOCITY
from pido.core.recording import Recording

_FAR = 10.0  # times the range of all other samples
_DEVIATIONS = 100.0  # robust standard deviations from the running median, at least
_INSTANT_S = 0.2  # a wrong stretch is shorter, or a single sample
_AROUND_S = 1.0  # of the running median
_BESIDE_S = 0.25  # within which what would explain a peak stands
_OUT = 1.5  # times the largest value elsewhere: out of the ordinary
_USUAL = (0.005, 0.995)  # quantiles between which the usual range lies at least
_FEWEST = 50


def wild_samples(parts: Sequence[Recording], column: str) -> list[Bool1D]:
    """Per part (n,): samples of the current in `column` that are wrong; none where nothing tells what is ordinary."""
    none = [np.zeros(len(r), bool) for r in parts]
    values = [np.asarray(r[column], float) if column in r else np.full(len(r), np.nan) for r in parts]
    known = np.concatenate([v[np.isfinite(v)] for v in values])
    if len(known) < _FEWEST:
        return none
    low, high = np.quantile(known, _USUAL)
    span = float(high - low)
    if np.ptp(known) <= _FAR * span:
        return none
    beside = [_signals(r, column) for r in parts]
    if not any(beside):
        return none
    away = [_from_median(v, r.sample_rate_hz) for v, r in zip(values, parts, strict=True)]
    sd = 1.4826 * float(np.median(np.concatenate([a[np.isfinite(v)] for a, v in zip(away, values, strict=True)])))
    while True:
        limit = max(_FAR * span, _DEVIATIONS * sd)
        found = [list(_instants(r, a > limit)) for r, a in zip(parts, away, strict=True)]
        rows = [_rows(f, len(r)) for f, r in zip(_unexplained(parts, beside, found), parts, strict=True)]
        rest = np.concatenate([v[np.isfinite(v) & ~w] for v, w in zip(values, rows, strict=True)])
        if np.ptp(rest) <= span or not any(w.any() for w in rows):
            return rows
        span = float(np.ptp(rest))


def _from_median(values: Float1D, rate_hz: float) -> Float1D:
    """(n,) – how far each sample is from the running median; 0 where it is missing."""
    known = np.isfinite(values)
    if not known.any():
        return np.zeros(len(values))
    at = np.arange(len(values))
    whole = np.interp(at, at[known], values[known])
    return np.abs(whole - median_filter(whole, max(5, int(_AROUND_S * rate_hz) | 1), mode="reflect")) * known


def _instants(recording: Recording, rows: Bool1D) -> Iterator[tuple[int, int]]:
    """First and last index of each uninterrupted stretch that is short enough."""
    edges = np.flatnonzero(np.diff(np.r_[False, rows, False].astype(np.int8)))
    for i, j in zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True):
        if i == j or recording.time[j] - recording.time[i] < _INSTANT_S:
            yield i, j


def _rows(stretches: Sequence[tuple[int, int]], n: int) -> Bool1D:
    out = np.zeros(n, bool)
    for i, j in stretches:
        out[i : j + 1] = True
    return out


def _signals(recording: Recording, column: str) -> dict[str, Float1D]:
    """What would stand out with a true peak, as sizes: motion and its changes, loads, and the current's own partner."""
    axis = next(a for a in CURRENT if column in (CURRENT[a], CURRENT_SIM[a]))
    partner = CURRENT[axis] if column == CURRENT_SIM[axis] else CURRENT_SIM[axis]
    given = {
        n: np.asarray(recording[n], float)
        for n in (partner, *POSITION.values(), *VELOCITY.values(), *ACCELERATION.values(), *PROCESS)
        if n in recording and recording[n].dtype != object and np.isfinite(recording[n]).any()
    }
    if not {partner, POSITION[axis], VELOCITY[axis], ACCELERATION[axis]} & set(given):
        return {}
    changes = {
        n: np.diff(given[n], prepend=given[n][:1]) for n in (*POSITION.values(), *VELOCITY.values()) if n in given
    }
    sizes = {n: v for n, v in given.items() if n not in POSITION.values()} | {f"d {n}": v for n, v in changes.items()}
    return {n: np.abs(np.nan_to_num(v)) for n, v in sizes.items()}


def _unexplained(
    parts: Sequence[Recording],
    signals: Sequence[dict[str, Float1D]],
    found: Sequence[Sequence[tuple[int, int]]],
) -> list[list[tuple[int, int]]]:
    """Per part the stretches beside which no signal is larger than anywhere else in all parts."""
    reach = [max(1, int(_BESIDE_S * r.sample_rate_hz)) for r in parts]
    near = [[(max(0, i - k), j + k) for i, j in f] for f, k in zip(found, reach, strict=True)]
    most: dict[str, float] = {}
    for r, s, stretches in zip(parts, signals, near, strict=True):
        elsewhere = ~_rows(stretches, len(r))
        for n, v in s.items():
            most[n] = max(most.get(n, 0.0), float(np.max(v[elsewhere], initial=0.0)))
    return [
        [
            f
            for f, (i, j) in zip(own, stretches, strict=True)
            if all(v[i : j + 1].max() <= _OUT * most[n] for n, v in s.items())
        ]
        for own, stretches, s in zip(found, near, signals, strict=True)
    ]
