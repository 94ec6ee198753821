"""Whether a challenger may replace the champion: paired, per axis, on the last parts that neither was trained on.

In:  RMSE per part and axis of both, and of trivial rivals. Out: a verdict in words and numbers.

Parts are the unit, not samples: neighbouring samples repeat each other. A challenger passes when on no axis it is worse
than the champion by more than `tolerance` in the mean of the last parts, nor by less but on so many parts that chance
cannot have done it; and when it beats the constant current wherever the champion does. An axis on which another
trivial rival has the lower error is a warning to whoever approves, and no failure: a challenger that improves on the
champion is an improvement, also while both lie behind a friction line.

Two models that are equally wrong say nothing for either. An axis of which more than half is open alarms on every part
that it is judged by does not pass before somebody has said what they were; fewer of them, and errors of both sides that
are FAR times all of earlier parts, are said.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import binomtest

from pido.core.arrays import Float1D
from pido.core.axes import AXES
from pido.core.errors import RegistryError

_NO_ERROR = 1e-9  # A
FULL, SOME = 0.5, 0.1
"""Shares of an axis' rows in open alarms: beyond the one a part judges nothing, beyond the other it is said."""
FAR = 10.0


@dataclass(frozen=True)
class AxisVerdict:
    """change : relative change of RMSE, mean over parts (negative is better); worse_on, parts : counts; p_value : of
    being worse on so many parts by chance (sign test)."""

    axis: str
    passed: bool
    change: float
    worse_on: int
    parts: int
    p_value: float
    words: str


@dataclass(frozen=True)
class Verdict:
    passed: bool
    axes: tuple[AxisVerdict, ...]
    words: str
    warnings: tuple[str, ...] = ()
    alarms: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


def gate(
    challenger: Mapping[str, Float1D],
    champion: Mapping[str, Float1D],
    rival: Mapping[str, Float1D] | None = None,
    *,
    others: Mapping[str, Mapping[str, Float1D]] | None = None,
    alarmed: Mapping[str, Float1D] | None = None,
    earlier: Mapping[str, Mapping[str, Float1D]] | None = None,
    tolerance: float = 0.02,
    level: float = 0.05,
) -> Verdict:
    """Compare RMSE (4,) per part, keyed by part; NaN where an axis was not recorded.

    champion : empty where there is none yet; the challenger then has to beat `rival`, a constant current, on each axis
    others : further trivial rivals by name; where one has the lower error, the words warn of it, with both errors
    alarmed : share (4,) of a part's rows in open alarms, by part; parts without any may be left out
    earlier : by part, what the challenger's likes were wrong by on the parts before it
    tolerance : relative worsening of the mean that is let pass; level : of the sign test
    RegistryError where the two were not judged on the same parts.
    """
    against, name = (champion, "the champion") if champion else (rival or {}, "the constant current")
    if not against:
        raise RegistryError("nothing to compare with: give the champion's errors, or those of a trivial rival.")
    if set(challenger) != set(against):
        missing = sorted(set(challenger) ^ set(against))
        raise RegistryError(f"challenger and {name} were judged on different parts ({', '.join(missing)}).")
    parts = sorted(challenger)
    new, old = (np.array([errors[p] for p in parts], float) for errors in (challenger, against))
    floor = np.array([rival[p] for p in parts], float) if rival and champion else None
    axes = tuple(
        _axis(axis, new[:, i], old[:, i], None if floor is None else floor[:, i], name, tolerance, level)
        for i, axis in enumerate(AXES)
        if (np.isfinite(new[:, i]) & np.isfinite(old[:, i])).any()
    )
    full = covered(parts, alarmed or {})
    axes = tuple(
        replace(a, passed=False, words=f"{a.words}, and open alarms cover {full[a.axis]:.0%} of it or more")
        if a.axis in full
        else a
        for a in axes
    )
    failed = [a.axis for a in axes if not a.passed]
    passed = bool(axes) and not failed
    words = "; ".join(a.words for a in axes) or "no axis could be compared"
    lead = "may be promoted" if passed else f"must not be promoted (fails on {', '.join(failed) or 'all axes'})"
    rivals = {**({} if rival is None else {"constant": rival}), **(others or {})}
    warnings = tuple(w for i, axis in enumerate(AXES) if (w := _behind(axis, i, parts, challenger, rivals)))
    warned = f". Warning: a trivial rival has the lower error on {'; '.join(warnings)}" if warnings else ""
    alarms, doubts = open_alarms(parts, alarmed or {}), _beyond(parts, challenger, against, earlier or {})
    said = "".join(f". Warning: {each}" for each in (*alarms, *doubts))
    return Verdict(passed, axes, f"{lead}: {words}{warned}{said}", warnings, alarms, doubts)


def covered(parts: Sequence[str], alarmed: Mapping[str, Float1D]) -> dict[str, float]:
    """Axes of which open alarms cover more than FULL on every part that has them, and at least how much.

    >>> half = np.array([0.9, 0.2, np.nan, 0.6])  # z was not recorded
    >>> covered(["p1"], {"p1": half}), covered(["p1", "p2"], {"p1": half})
    ({'x': 0.9, 'sp': 0.6}, {})
    """
    if not parts:
        return {}
    shares = np.array([alarmed.get(p, np.zeros(len(AXES))) for p in parts], float)
    least = np.min(np.where(np.isnan(shares), np.inf, shares), axis=0)
    return {axis: float(s) for axis, s in zip(AXES, least, strict=True) if FULL < s < np.inf}


def open_alarms(parts: Sequence[str], alarmed: Mapping[str, Float1D]) -> tuple[str, ...]:
    """In words, of which parts a good share is alarms that nobody has answered."""
    found = []
    for part in parts:
        shares = alarmed.get(part, np.zeros(len(AXES)))
        if axes := [f"{axis} {s:.0%}" for axis, s in zip(AXES, shares, strict=True) if s > SOME]:
            found.append(f"alarms that nobody has answered cover part {part[:12]} by {', '.join(axes)}")
    return tuple(found)


def _beyond(
    parts: Sequence[str],
    challenger: Mapping[str, Float1D],
    against: Mapping[str, Float1D],
    earlier: Mapping[str, Mapping[str, Float1D]],
) -> tuple[str, ...]:
    """In words, on which parts and axes both sides are FAR times as wrong as on any part before."""
    found = []
    for part in parts:
        before = [np.asarray(errors, float) for errors in earlier.get(part, {}).values()]
        axes = []
        for i, axis in enumerate(AXES):
            known = [errors[i] for errors in before if np.isfinite(errors[i])]
            both = np.fmin(challenger[part][i], against[part][i])
            if known and both > FAR * max(*known, _NO_ERROR):
                axes.append(f"{axis} {both:.3g} A beside at most {max(known):.3g} A")
        if axes:
            found.append(
                f"on part {part[:12]} both are wrong by far more than on any part before it ({'; '.join(axes)}): "
                "look at the part, not at the models"
            )
    return tuple(found)


def _behind(
    axis: str, i: int, parts: list[str], challenger: Mapping[str, Float1D], rivals: Mapping[str, Mapping[str, Float1D]]
) -> str:
    """Names the trivial rivals that are better than the challenger on an axis, with mean errors; '' where none is."""
    found = []
    mine = np.array([challenger[p][i] for p in parts], float)
    for name, errors in rivals.items():
        theirs = np.array([errors[p][i] if p in errors else np.nan for p in parts], float)
        both = np.isfinite(mine) & np.isfinite(theirs)
        if both.any() and np.mean(theirs[both]) < np.mean(mine[both]) - _NO_ERROR:
            found.append(f"{name} {np.mean(theirs[both]):.3g} A beside {np.mean(mine[both]):.3g} A")
    return f"{axis} ({', '.join(found)})" if found else ""


def _axis(
    axis: str, new: Float1D, old: Float1D, floor: Float1D | None, name: str, tolerance: float, level: float
) -> AxisVerdict:
    known = np.isfinite(new) & np.isfinite(old)
    # a nanoampere is no error: an axis whose current is zero throughout is neither better nor worse
    new, old, n = np.maximum(new[known], _NO_ERROR), np.maximum(old[known], _NO_ERROR), int(known.sum())
    change = float(np.mean(new) / np.mean(old) - 1.0)
    worse = int((new > old).sum())
    untied = int((new != old).sum())
    p = float(binomtest(worse, untied, 0.5, alternative="greater").pvalue) if untied else 1.0
    # many small losses are a loss too; but one within a tenth of the tolerance is no reason to keep an old model
    creeping = p < level and change > tolerance / 10
    trivial = floor is not None and bool(np.mean(old) <= np.mean(floor[known]) < np.mean(new))
    passed = change <= tolerance and not creeping and not trivial
    words = f"{axis} {change:+.1%} RMSE against {name} on {n} part(s), worse on {worse}"
    if trivial:
        words += ", and no better than a constant current"
    return AxisVerdict(axis, passed, change, worse, n, p, words)
