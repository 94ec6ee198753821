"""Rows in which nothing can be said of a term, because a value that it follows from is missing there.

In:  a term, a recording, and the state of one axis in it; a missing value is NaN.
Out: the term's columns with NaN where they would be others if a missing value were another one.
The term itself is asked, with several values in place of each missing one. So a law that does not read what is missing,
or does not act there whatever it is, is known there; and what is nothing by itself (before the first reversal, at
standstill) is not taken for missing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pido.core.arrays import Bool1D, Float1D, Float2D
from pido.core.axes import LINEAR_AXES
from pido.core.columns import CURRENT
from pido.core.recording import Recording
from pido.diagnosis.state import AxisState, Motion
from pido.diagnosis.terms import Term

_TRIED = 16  # values in place of a missing one: 0, 1, and the rest from the least to the greatest that are known
_EACH = ("v", "a", "pos", "force", "force_perp", "m_sp", "mrr", "ar", "wx", "wy", "wz", "angle")
_CURRENTS = frozenset(CURRENT.values())  # which no finding follows from
_PER_AXIS = ("forces", "places", "sims")


def known_columns(term: Term, recording: Recording, state: AxisState) -> Float2D:
    """(k, n) – as `Term.of_part`, NaN where a missing value leaves the term open."""
    missing = _missing(recording, state)
    columns = term.of_part(state)
    if not missing.any():
        return columns
    first, *others = (term.of_part(_tried(recording, state, k)) for k in range(_TRIED))
    differs = np.any([np.any(other != first, axis=0) for other in others], axis=0)
    return np.where(missing, np.where(differs, np.nan, first), columns)


def _missing(recording: Recording, state: AxisState) -> Bool1D:
    """(n,) – rows in which a value was not recorded, and the state lacks one.

    A value that was recorded and is wrong is a fault of the data, which is a finding of its own.
    """
    inputs = [v for name, v in recording.columns.items() if name not in _CURRENTS and v.dtype != object]
    missing = np.any([~np.isfinite(v) for v in inputs], axis=0)
    return missing & _lacking(recording, state) if np.any(missing) else missing


def _lacking(recording: Recording, state: AxisState) -> Bool1D:
    values = [getattr(state, name) for name in _names(recording)]
    values += [v for name in _PER_AXIS for v in getattr(state, name).values()]
    values += [v for motion in state.others.values() for v in (motion.v, motion.a)]
    return np.any([np.isnan(v) for v in values if v is not None], axis=0)


def _names(recording: Recording) -> tuple[str, ...]:
    """Where no column says whether coolant is on, the operations do as far as they go, and it is not missing."""
    return (*_EACH, "coolant") if "coolant" in recording else _EACH


def _tried(recording: Recording, state: AxisState, k: int) -> AxisState:
    """The state with the k-th value in place of every missing one, and what follows from it at once."""
    new: dict[str, Any] = {name: _filled(v, k) for name in _names(recording) if (v := getattr(state, name)) is not None}
    new |= {name: {a: _filled(v, k) for a, v in getattr(state, name).items()} for name in _PER_AXIS}
    own = _moved(Motion(state.v, state.a, state.held, state.moving, state.along), k)
    new |= {name: getattr(own, name) for name in ("held", "moving", "along")}
    new["others"] = {a: _moved(motion, k) for a, motion in state.others.items()}
    if state.ar is not None:
        speeds = [v for a, v in state.speeds.items() if a in LINEAR_AXES]
        new["ar"] = _filled(np.where(np.isnan(speeds).any(axis=0), np.nan, state.ar), k)
    if state.engaged is not None:
        load = [v for v in (state.mrr, state.m_sp, *state.forces.values()) if v is not None][:1]
        new["engaged"] = np.where(np.isnan(load).any(axis=0), k % 2 == 1, state.engaged)
    return replace(state, **new)


def _moved(motion: Motion, k: int) -> Motion:
    missing, v = np.isnan(motion.v), _filled(motion.v, k)
    held, moving = np.where(missing, np.sign(v), motion.held), np.where(missing, v != 0, motion.moving)
    along = np.where(missing, held, motion.along)
    return replace(motion, v=v, a=_filled(motion.a, k), held=held, moving=moving, along=along)


def _filled(values: Float1D, k: int) -> Float1D:
    missing = np.isnan(values)
    if not missing.any():
        return values
    known = values[np.isfinite(values)]
    quantile = (k - 2) / (_TRIED - 3)
    value = float(k) if k < 2 or len(known) == 0 else float(np.quantile(known, quantile))
    return np.where(missing, value, values)
