"""Rows that were written as packets in shuffled order, put back in order where continuity decides it.

In:  tracks (position, velocity and, for a counter, its range) in file order; all columns, to know repeated rows.
Out: rows in the order found, where the order is still broken, and what was done, in words.

Two neighbouring rows fit when every position moves by what its velocities say within the time that may lie between
them (0 to 2.5 steps) and its rounding to three digits. Runs of fitting rows are packets. A packet follows another
only where the two fit and the choice is decided: no other successor or predecessor that is still free fits, or each
fits worse by a clear margin. What stays undecided is left in file order and marked; nothing is sorted by a guess.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pido.core.arrays import Bool1D, Float1D, Float2D, Int1D

MARGIN = 4.0
"""By how much the second best neighbour must fit worse, in units of the rounding (summed over the tracks)."""


@dataclass(frozen=True, slots=True)
class Track:
    """position, velocity : (n,), unit and unit/s. period : range after which the position starts again, or None."""

    position: Float1D
    velocity: Float1D
    period: float | None = None


def in_order(tracks: list[Track], rows: Float2D, step_s: float) -> tuple[Int1D, Bool1D, tuple[str, ...]]:
    """(row indices in the order found, (m,) whether the order is broken before each of them, notes)."""
    moving = np.any([np.abs(t.velocity) > 0.5 * _quantum(t) / step_s for t in tracks], axis=0)
    keep, repeated = _first_of_repeated(rows, moving)
    tracks = [Track(t.position[keep], t.velocity[keep], t.period) for t in tracks]
    notes = [f"{repeated} rows came twice while the machine moved and were taken once"] if repeated else []
    if trusted := _trusted(tracks, step_s):
        notes.append(f"{len(tracks) - len(trusted)} counter(s) jump while everything else is continuous; not used")
        tracks = trusted
    before = ~_fits(tracks, np.arange(len(keep) - 1), np.arange(1, len(keep)), step_s)[0]
    edges = np.r_[0, np.flatnonzero(before) + 1, len(keep)]
    packets = [np.arange(a, b) for a, b in pairwise(edges)]
    if len(packets) == 1:
        return keep, np.zeros(len(keep), bool), tuple(notes)
    chains = _chain(packets, tracks, step_s)
    order = np.concatenate([np.concatenate([packets[p] for p in chain]) for chain in chains])
    border = np.zeros(len(order), bool)
    border[np.cumsum([sum(len(packets[p]) for p in chain) for chain in chains])[:-1]] = True
    moved = any(chain != list(range(chain[0], chain[0] + len(chain))) for chain in chains)
    notes.append(
        f"{len(packets) - 1} jumps of position in file order; "
        + (f"{len(packets)} packets put in order by continuity of position and velocity, " if moved else "")
        + (
            f"{len(chains) - 1} places stay undecided and are marked by a gap of 1 s in time"
            if len(chains) > 1
            else "no jump is left; the order is an inference"
        )
    )
    return keep[order], border, tuple(notes)


def _first_of_repeated(rows: Float2D, moving: Bool1D) -> tuple[Int1D, int]:
    """Indices without rows that repeat an earlier one while something moves: no measurement repeats itself there."""
    _, first = np.unique(rows, axis=0, return_index=True)
    is_first = np.zeros(len(rows), bool)
    is_first[first] = True
    keep = np.flatnonzero(is_first | ~moving)
    return keep, len(rows) - len(keep)


def _trusted(tracks: list[Track], step_s: float) -> list[Track]:
    """The tracks without counters that jump on their own: packets move all tracks. Empty if there is none such."""
    n = len(tracks[0].position)
    broken = [~_fits([t], np.arange(n - 1), np.arange(1, n), step_s)[0] for t in tracks]
    alone = []
    for k, t in enumerate(tracks):
        others = np.any([b for j, b in enumerate(broken) if j != k], axis=0)
        alone.append(
            t.period is not None and broken[k].sum() > 10 and (broken[k] & ~others).sum() > 0.8 * broken[k].sum()
        )
    return [t for t, bad in zip(tracks, alone, strict=True) if not bad] if any(alone) else []


def _quantum(track: Track) -> Float1D:
    """(n,) – the step of a position that is written with three significant digits."""
    size = np.maximum(np.abs(track.position), 1e-3)
    return 10.0 ** (np.floor(np.log10(size)) - 2)


def _fits(tracks: list[Track], a: Int1D, b: Int1D, step_s: float) -> tuple[Bool1D, Float1D]:
    """(whether row b may follow row a, how badly it does) for each pair; index arrays broadcast."""
    fine: Bool1D = np.ones(np.broadcast(a, b).shape, bool)
    cost: Float1D = np.zeros(fine.shape)
    for t in tracks:
        quantum = _quantum(t)
        rounding = np.maximum(quantum[a], quantum[b])
        move = t.position[b] - t.position[a]
        if t.period is not None:
            move = (move + t.period / 2) % t.period - t.period / 2
        low, high = np.minimum(t.velocity[a], t.velocity[b]), np.maximum(t.velocity[a], t.velocity[b])
        reach_low, reach_high = 2.5 * step_s * np.minimum(low, 0.0), 2.5 * step_s * np.maximum(high, 0.0)
        fine &= (move >= reach_low - 1.01 * rounding) & (move <= reach_high + 1.01 * rounding)
        expected = 0.5 * (t.velocity[a] + t.velocity[b]) * step_s
        change = np.abs(t.velocity[b] - t.velocity[a]) * step_s
        cost = cost + (np.abs(move - expected) + change) / rounding
    return fine, cost


def _chain(packets: list[Int1D], tracks: list[Track], step_s: float) -> list[list[int]]:
    """Packets linked where it is decided; chains in file order of their first packet."""
    heads = np.array([p[0] for p in packets])
    tails = np.array([p[-1] for p in packets])
    fine, cost = _fits(tracks, tails[:, None], heads[None, :], step_s)
    np.fill_diagonal(fine, False)
    cost = np.where(fine, cost, np.inf)
    following: dict[int, int] = {}
    while (link := _decided(cost)) is not None:
        i, j = link
        following[i] = j
        cost[i, :] = np.inf
        cost[:, j] = np.inf
        end = j
        while end in following:
            end = following[end]
        begin = next((k for k in _chain_starts(following) if _end(following, k) == end), i)
        cost[end, begin] = np.inf  # no rings
    first = [p for p in range(len(packets)) if p not in set(following.values())]
    chains = []
    for p in first:
        chain = [p]
        while chain[-1] in following:
            chain.append(following[chain[-1]])
        chains.append(chain)
    return chains


def _decided(cost: Float2D) -> tuple[int, int] | None:
    """The link whose alternatives, from either side, are worse by the widest margin; None below MARGIN."""
    if not np.isfinite(cost).any():
        return None
    best_j = np.argmin(cost, axis=1)
    i = np.arange(len(cost))
    best = cost[i, best_j]
    rest = cost.copy()
    rest[i, best_j] = np.inf
    second_row = rest.min(axis=1)
    others = cost[:, best_j].copy()
    others[i, i] = np.inf
    second_column = others.min(axis=0)
    with np.errstate(invalid="ignore"):
        margin = np.minimum(second_row, second_column) - best
    margin[~np.isfinite(best)] = -np.inf
    k = int(np.argmax(margin))
    return (k, int(best_j[k])) if margin[k] >= MARGIN else None


def _chain_starts(following: dict[int, int]) -> set[int]:
    return set(following) - set(following.values())


def _end(following: dict[int, int], start: int) -> int:
    while start in following:
        start = following[start]
    return start
