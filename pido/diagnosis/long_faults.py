"""A speed that is not that of its position for a while: a fault so long that it would pass for what is usual.

In:  time, position, speed and acceleration of a linear axis.
Out: `LongFault` per stretch, with the factor between both where it is the same throughout.
Over a second noise, rounding and filters hardly add up, a wrong unit does. How far the ways of position and speed are
apart there is judged beside the calmer half of the record; that it is the speed which is wrong, the acceleration says.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Bool1D, Float1D

_WINDOW_S = 1.0  # over which ways are compared
_LASTS_S = 2.0  # a shorter fault is found sample by sample
_APART = 0.15  # of the way in a window, by which two signals that belong together are never apart
_TIMES = 12.0  # what is usual of the way
_SOME_WAY = 0.02  # of the longest way in a window: less says nothing
_LATE_S = 0.1  # a filter may delay one signal against another by so much
_CHANGE_S = 0.1  # over which a change of speed is compared with the acceleration, and a way is taken at least
_SIDES = 0.5  # of what the speed differs from an acceleration, below which the position belongs to it
_MOST = 0.5  # of the record: of two signals that mostly contradict each other none is usual
_FROZEN = 0.5  # of its steps in motion, in which a signal that stays as it is to the last digit is frozen
_CONSTANT = 0.05  # relative, by which a factor that is the same throughout may vary
_LIKE = 0.02  # relative, by which a factor may miss that of a unit
_UNITS = ((0.06, "m/min", "mm/s"), (60.0, "mm/min", "mm/s"), (1 / 25.4, "inch/s", "mm/s"), (0.001, "m/s", "mm/s"))
"""Factor of a speed that is in the first unit in place of the second."""


@dataclass(frozen=True)
class LongFault:
    """Samples `first` to `last` whose speed is wrong. factor : of what was recorded by what the position says."""

    first: int
    last: int
    factor: float | None

    @property
    def reason(self) -> str:
        said = "not the speed of the position for a while"
        if self.factor is None:
            return said
        pairs = (*_UNITS, *((1 / factor, b, a) for factor, a, b in _UNITS))
        alike = (f", like {a} in place of {b}" for factor, a, b in pairs if abs(self.factor / factor - 1) < _LIKE)
        unit = next(alike, "")
        return f"{said}: {self.factor:.3g} times it throughout{unit}"


def long_faults(time: Float1D, pos: Float1D, v: Float1D, a: Float1D, known: Bool1D) -> list[LongFault]:
    """time, pos, v, a : (n,), s, mm, mm/s, mm/s²; known : (n,) – rows whose speed is already known to be wrong"""
    step = np.diff(time)
    dt = float(np.median(step))
    moved, expected = np.diff(pos), 0.5 * (v[1:] + v[:-1]) * step
    use = (step < 1.5 * dt) & np.isfinite(moved) & np.isfinite(expected) & ~known[1:] & ~known[:-1]
    moved, expected = np.where(use, moved, 0.0), np.where(use, expected, 0.0)
    width = max(8, round(_WINDOW_S / dt))
    if len(time) < 20 * width:
        return []
    around = max(1, round(_CHANGE_S / dt))
    # Ways to and fro add up, and what noise adds to them is little where they are taken over more than a step.
    ways = [_summed(np.abs(_summed(each, around)), width) / around for each in (moved, expected)]
    way = np.maximum(*ways)
    gap = moved - expected
    lost = np.maximum(np.abs(_summed(gap, width)), np.abs(ways[0] - ways[1]))
    # A filter that is late gives back within the window what it kept, but for the speeds at its ends.
    late = _LATE_S * np.abs(_changed(v, width))
    says = (way > _SOME_WAY * min(float(w.max()) for w in ways)) & (_summed(use.astype(float), width) > 0.9 * width)
    if not says.any():
        return []
    usual = float(np.median(lost[says] / way[says]))
    most = max(_APART, _TIMES * usual) * way
    apart = says & (lost > most + late)
    if apart.sum() > _MOST * says.sum():
        return []
    belongs = says & (lost < 0.5 * most)
    rate = np.abs(gap) / np.maximum(step, dt)
    out = []
    edges = np.flatnonzero(np.diff(np.r_[False, _joined(apart, belongs), False].astype(np.int8)))
    stretches = [(i, j) for i, j in zip(edges[::2], edges[1::2], strict=True) if j - i >= round(_LASTS_S / dt)]
    away = np.ones(len(rate), bool)
    for i, j in stretches:
        away[max(i - width, 0) : j + width] = False
    if not (away & use).any():
        return []
    least = float(np.quantile(rate[away & use], 0.999))
    for i, j in stretches:
        clear = max(i - width, 0) + np.flatnonzero(rate[max(i - width, 0) : j + width] > least)
        # A step before or after, as noise has one in a thousand, has no company.
        clear = [int(k) for k in clear if np.sum(np.abs(clear - k) <= width // 4) > width // 10]
        if not clear:
            continue
        rows = slice(clear[0], clear[-1] + 2)
        inner = slice(rows.start, rows.stop - 1)
        stood = (np.diff(v) == 0)[inner][np.abs(moved[inner]) > least * dt]
        if (
            len(stood)
            and stood.mean() < _FROZEN
            and _like_position(np.diff(pos, prepend=pos[:1])[rows] / dt, v[rows], a[rows], dt)
        ):
            out.append(
                LongFault(
                    rows.start,
                    rows.stop - 1,
                    _factor(*(_summed(each[inner][around:-around], around) for each in (moved, expected))),
                )
            )
    return out


def _joined(apart: Bool1D, belongs: Bool1D) -> Bool1D:
    """Windows between two that are apart, where none says that the signals belong together, as while the axis rests."""
    out = apart.copy()
    at = np.flatnonzero(apart)
    contrary = np.cumsum(belongs)
    for i, j in itertools.pairwise(at):
        if contrary[i] == contrary[j]:
            out[i:j] = True
    return out


def _summed(values: Float1D, width: int) -> Float1D:
    """(n,) – sums over windows around each value; at the ends over what there is."""
    total, n = np.cumsum(np.r_[0.0, values]), len(values)
    at = np.arange(n)
    return total[np.minimum(at + width // 2 + 1, n)] - total[np.maximum(at - width // 2, 0)]


def _changed(v: Float1D, width: int) -> Float1D:
    """(n - 1,) – how far the speeds at both ends of a window are apart."""
    at, n = np.arange(len(v) - 1), len(v)
    return np.nan_to_num(v[np.minimum(at + width // 2 + 1, n - 1)] - v[np.maximum(at - width // 2, 0)])


def _like_position(speed: Float1D, v: Float1D, a: Float1D, dt: float) -> bool:
    """Whether the changes of speed that the acceleration tells are those of the position and not of `v`."""
    width = max(1, round(_CHANGE_S / dt))
    told = np.cumsum(np.nan_to_num(a)) * dt
    by_pos, by_v, all_of = (
        float(np.nansum((each[width:] - each[:-width]) ** 2)) for each in (speed - told, v - told, told)
    )
    return by_pos < _SIDES**2 * min(by_v, all_of)


def _factor(moved: Float1D, expected: Float1D) -> float | None:
    """Way by the speed over way by the position, in windows short enough not to turn, where each fifth of it has the
    same one."""
    fifth = np.minimum(4, 5 * np.cumsum(np.abs(moved)) // max(float(np.sum(np.abs(moved))), 1e-12)).astype(int)
    square, product = np.bincount(fifth, moved**2, 5), np.bincount(fifth, moved * expected, 5)
    if not (square > 0).all():
        return None
    each, whole = product / square, float(product.sum() / square.sum())
    return whole if whole > 0 and np.all(np.abs(each / whole - 1) < _CONSTANT) else None
