"""How much of its friction a simulation has at standstill, read from its own current.

In:  motion, process forces and simulated current of one axis in all parts.
Out: per part (n,), -1..1: the direction while the axis moves, and at rest the share of its friction that the simulation
     holds there, with its sign; None where it holds none, or all of it with the sign of the last motion.
A simulation with a friction state of its own (Dahl 1968; LuGre: Canudas de Wit et al. 1995) holds at rest what its
controller left there: seldom all, and not always with the sign of the last motion. Other laws act on the same state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.diagnosis.state import AxisState

_FEWEST = 50  # rows in motion, and at rest
_HOLDS = 0.1  # of its friction, rms at rest, from which a simulation holds something
_OWN = 0.1  # rms by which it must differ at rest from the sign of the last motion


def with_simulated_rest(states: Sequence[AxisState]) -> tuple[AxisState, ...]:
    """The states of one axis, with what its simulation holds at rest."""
    held = _held(states)
    return tuple(states) if held is None else tuple(replace(s, sim_held=h) for s, h in zip(states, held, strict=True))


def _held(states: Sequence[AxisState]) -> list[Float1D] | None:
    known = [s.sim for s in states if s.sim is not None]
    if not states or len(known) < len(states):
        return None
    columns, sim = np.concatenate([_laws(s) for s in states]), np.concatenate(known)
    held, along = (np.concatenate([getattr(s, name) for s in states]) for name in ("held", "along"))
    moving = np.concatenate([s.moving for s in states])
    good = np.isfinite(sim) & np.isfinite(columns).all(axis=1)
    seen, rest = good & moving, good & ~moving & (held != 0)
    if min(seen.sum(), rest.sum()) < _FEWEST or not _both_ways(along[seen]):
        return None
    law, *_ = np.linalg.lstsq(columns[seen], sim[seen], rcond=None)
    friction = law[0]
    if friction <= 0:
        return None
    at_rest = np.clip((sim - columns[:, _AT_REST] @ law[_AT_REST]) / friction, -1.0, 1.0)
    if _rms(at_rest[rest]) < _HOLDS or _rms(at_rest[rest] - held[rest]) < _OWN:
        return None
    state = np.where(moving, along, np.nan_to_num(at_rest))
    return np.split(state, np.cumsum([len(s.time) for s in states])[:-1])


_AT_REST = slice(2, None)  # of the laws, those that act at rest, too, beside friction


def _laws(state: AxisState) -> Float2D:
    """(n, k) – friction, its part with the speed; what acts at rest, too: inertia, a constant, the process' force."""
    one = np.ones(len(state.time))
    force = np.zeros(len(one)) if state.force is None else state.force
    return np.column_stack([state.along, state.v * state.moving, state.a, one, force])


def _both_ways(along: Float1D) -> bool:
    return bool(np.any(along > 0) and np.any(along < 0))


def _rms(values: Float1D) -> float:
    return float(np.sqrt(np.mean(values**2)))
