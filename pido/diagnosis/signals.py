"""Everything that a recording knows about the state, by name and with its unit.

In:  the states of an axis. Out: name -> (values (n,), unit), of what a current could depend on.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from itertools import pairwise

import numpy as np

from pido.core.arrays import Array1D, Bool1D, Float1D, Float2D, Int1D
from pido.core.axes import LINEAR_AXES
from pido.core.errors import DiagnosisError
from pido.diagnosis.state import AxisState, seconds_of_each

Known = Mapping[str, tuple[Float1D, str]]
"""Signals by name, (n,) each, with their units."""

CLOCKS = ("uptime", "t_part")  # which tell when, not what
# Over which neither a peak nor a bend is a law.
NO_PLACE = ("held", "speeding", "braking", "coolant", *CLOCKS, "I_", "pos_sp")
LONG_S = 10.0  # after which it no longer matters how long ago a block, a cut or a motion began
_STANDS = 0.02  # mm/s along the path, and less
_CREEPS = 1.0  # mm/s in the plane, and less: which way the path turns is then noise
_CORNER = 1.0  # 1/mm: what turns more sharply is a corner, of which no radius is known
_LONG_REST_S = 60.0  # after which it no longer matters how long an axis stood
_ELSEWHERE = 0.02  # of an axis' travel, by which parts begin at different places


def signals(state: AxisState, names: Collection[str] | None = None) -> dict[str, tuple[Float1D, str]]:
    """Name -> (values (n,), unit) of everything known about the state that a current could depend on, or of `names`.

    What only tells when something happens is given by its name alone: `occasions`.
    speeding, braking : 1 while the drive puts energy into the motion, while it takes it out; else 0
    A speed within the dead band of its axis is none: its sign is noise.

    Raises DiagnosisError where one of `names` is not known.
    """
    spindle = state.axis == "sp"
    length, speed = ("deg", "deg/s") if spindle else ("mm", "mm/s")
    a = state.axis
    found: dict[str, tuple[Float1D | Callable[[], Float1D | None] | None, str]] = {
        f"v_{a}": (lambda: state.v * state.moving, speed),
        f"a_{a}": (state.a, f"{speed}²"),
        f"pos_{a}": (None if spindle else state.pos, length),
        **{f"pos_{axis}": (place, "mm") for axis, place in state.places.items() if axis != a},
        **{f"from_{axis}": (partial(_from_start, place), "mm") for axis, place in state.places.items() if len(place)},
        f"held_{a}": (state.held, "–"),
        f"speeding_{a}": (lambda: (state.v * state.a > 0).astype(float), "–"),
        f"braking_{a}": (lambda: (state.v * state.a < 0).astype(float), "–"),
        f"d_{a}": (state.since_reversal, length),
        f"way_{a}": (None if spindle else state.way, length),
        f"j_{a}": (lambda: _jerk(state), f"{speed}³"),
        f"t_go_{a}": (lambda: _since_change(state.time, state.moving, state.moving), "s"),
        f"stood_{a}": (lambda: _since_change(state.time, state.moving, ~state.moving), "s"),
        f"rested_{a}": (lambda: _rested(state.time, state.moving), "s"),
        f"I_{a}": (state.sim, "A"),
        **{f"I_{axis}": (sim, "A") for axis, sim in state.sims.items()},
        "I_all": (lambda: _together(state), "A"),
        "feed": (lambda: _feed(state), "mm/s"),
        "feed_rev": (lambda: _feed_per_revolution(state), "mm"),
        "a_n": (lambda: _across_path(state), "mm/s²"),
        "kappa": (lambda: _curvature(state), "1/mm"),
        **{f"f_{axis}": (force, "N") for axis, force in state.forces.items()},
        "t_block": (lambda: _since_change(state.time, state.nc_line), "s"),
        "t_cut": (lambda: _since_change(state.time, state.engaged, state.engaged), "s"),
        "M_sp": (state.m_sp, "N·m"),
        "MRR": (state.mrr, "mm³/s"),
        "removed": (lambda: _so_far(state.time, state.mrr), "mm³"),
        "AR": (state.ar, "mm²"),
        "coolant": (state.coolant, "–"),
        "pos_sp": (state.angle, "deg"),
        "uptime": (state.clock if state.clock is not None else None, "s"),
        "t_part": (lambda: state.time - state.time[:1], "s"),
    }
    for name, other in state.others.items():
        if name != a:
            found[f"v_{name}"] = (partial(np.multiply, other.v, other.moving), "deg/s" if name == "sp" else "mm/s")
            found[f"a_{name}"] = (other.a, "deg/s²" if name == "sp" else "mm/s²")
            if names is not None:
                found["way_all"] = (lambda: _way_of_all(state), "mm")
                found[f"held_{name}"] = (other.held, "–")
                found[f"t_go_{name}"] = (partial(_since_change, state.time, other.moving, other.moving), "s")
    out = {}
    for name in found if names is None else names:
        values, unit = found.get(name, (None, ""))
        values = values() if callable(values) else values
        if values is not None:
            out[name] = (_finite(np.asarray(values, float)), unit)
        elif names is not None:
            raise DiagnosisError(
                f"part {state.part}: what axis {a} follows without a name depends on {name}, which this part does not "
                "give. Add the columns that the diagnosed parts had."
            )
    return out


def _jerk(state: AxisState) -> Float1D | None:
    """Over the step between the rows at hand, which may be thinned."""
    return np.gradient(state.a, float(np.median(np.diff(state.time)))) if len(state.time) > 1 else None


def _so_far(time: Float1D, rate: Float1D | None) -> Float1D | None:
    """(n,) – integral of a rate, which is taken to hold since the sample before."""
    return None if rate is None else np.cumsum(np.nan_to_num(rate) * seconds_of_each(time))


def _feed(state: AxisState) -> Float1D | None:
    """Speed along the path, mm/s; None with fewer than two linear axes."""
    linear = _linear(state)
    return None if linear is None else np.sqrt(np.sum(linear[0] ** 2, axis=0))


def _linear(state: AxisState) -> tuple[Float2D, Float2D] | None:
    """Speeds and accelerations of the linear axes, (k, n) each; None where nothing but one axis' own is known."""
    motions = [o for name, o in state.others.items() if name in LINEAR_AXES]
    if not motions:
        return None
    own = [] if state.axis == "sp" else [state]
    return np.array([m.v for m in (*own, *motions)]), np.array([m.a for m in (*own, *motions)])


def _across_path(state: AxisState) -> Float1D | None:
    """mm/s² – what turns the path; 0 at rest."""
    linear = _linear(state)
    if linear is None:
        return None
    v, a = linear
    along = np.sum(v * a, axis=0) ** 2 / np.maximum(np.sum(v**2, axis=0), 1e-12)
    return np.sqrt(np.maximum(np.sum(a**2, axis=0) - along, 0.0)) * (np.sum(v**2, axis=0) > _STANDS**2)


def _curvature(state: AxisState) -> Float1D | None:
    """1/mm – of the path in the x-y plane, positive where it turns to the left; 0 at rest, a corner's at most 1."""
    x, y = (state if axis == state.axis else state.others.get(axis) for axis in ("x", "y"))
    if x is None or y is None:
        return None
    speed = np.hypot(x.v, y.v)
    turns = (x.v * y.a - y.v * x.a) / np.maximum(speed, _CREEPS) ** 3
    return np.clip(turns, -_CORNER, _CORNER) * (speed > _CREEPS)


def _feed_per_revolution(state: AxisState) -> Float1D | None:
    feed, spindle = _feed(state), state if state.axis == "sp" else state.others.get("sp")
    if feed is None or spindle is None:
        return None
    return np.where(spindle.moving, 360.0 * feed / np.where(spindle.moving, np.abs(spindle.v), 1.0), 0.0)


def _together(state: AxisState) -> Float1D | None:
    return None if state.sim is None or not state.sims else sum(map(np.abs, state.sims.values()), np.abs(state.sim))


def _way_of_all(state: AxisState) -> Float1D | None:
    """What a lubrication counts that has one pump for all axes; None with fewer than two."""
    motions = [m for m in (state, *state.others.values()) if m is not state.others.get("sp")]
    motions = motions[1:] if state.axis == "sp" else motions
    if len(motions) < 2:
        return None
    return np.cumsum(sum(np.abs(np.nan_to_num(m.v)) * m.moving for m in motions) * seconds_of_each(state.time))


def _rested(time: Float1D, moving: Bool1D) -> Float1D:
    """s that the axis stood before the motion it is in."""
    starts = np.flatnonzero(moving & ~np.r_[True, moving[:-1]])
    stops = np.flatnonzero(~moving & np.r_[True, moving[:-1]])
    out = np.zeros(len(time))
    for start, stop in zip(starts, stops, strict=False):
        out[start:] = min(time[start] - time[stop], _LONG_REST_S)
    return out * moving


def _since_change(time: Float1D, values: Array1D | None, only: Bool1D | None = None) -> Float1D | None:
    """s since `values` changed, at most ten; 0 outside `only`; None without values."""
    if values is None:
        return None
    change = np.r_[True, values[1:] != values[:-1]]
    since = time - time[np.maximum.accumulate(np.where(change, np.arange(len(time)), 0))]
    return np.minimum(since, LONG_S) * (1.0 if only is None else only)


def common_signals(states: Sequence[AxisState], rows: Int1D | None = None) -> dict[str, tuple[Float1D, str]]:
    """The signals that every part has and that vary, parts one after another; in some `rows` of all, rising.

    Of a place from where the part began only where parts begin at different places: elsewhere it is the place.
    """
    if rows is None:
        each = [signals(s) for s in states]
    else:
        # Part by part: all signals of a plant's day at once take gigabytes.
        edges = np.cumsum([0, *(len(s.time) for s in states)])
        each = [
            _in_rows(s, rows[(rows >= i) & (rows < j)] - i) for s, (i, j) in zip(states, pairwise(edges), strict=True)
        ]
    names = [n for n in each[0] if all(n in e for e in each) and (n[:5] != "from_" or _begin_elsewhere(n[5:], states))]
    out = {n: (np.concatenate([e[n][0] for e in each]), each[0][n][1]) for n in names}
    return {n: v for n, v in out.items() if np.ptp(v[0]) > 0}


def _in_rows(state: AxisState, rows: Int1D) -> dict[str, tuple[Float1D, str]]:
    return {name: (values[rows], unit) for name, (values, unit) in signals(state).items()}


def occasions(states: Sequence[AxisState]) -> dict[str, tuple[Float1D, str]]:
    """What tells when something happens, and not how much: when other linear axes begin to move, stop and turn, of
    those that every part has, and how far all have gone together; parts one after another."""
    others = [a for a in LINEAR_AXES if a != states[0].axis and all(a in s.others for s in states)]
    names = [name for a in others for name in (f"held_{a}", f"t_go_{a}")]
    names += ["way_all"] if len(others) + (states[0].axis != "sp") > 1 else []
    each = [signals(s, names) for s in states]
    return {n: (np.concatenate([e[n][0] for e in each]), each[0][n][1]) for n in names}


def _from_start(place: Float1D) -> Float1D:
    return place - place[0]


def _begin_elsewhere(axis: str, states: Sequence[AxisState]) -> bool:
    places = [s.places[axis] for s in states]
    travel = max(np.nanmax(p) for p in places) - min(np.nanmin(p) for p in places)
    return float(np.ptp([p[0] for p in places])) > _ELSEWHERE * float(travel)


def _finite(values: Float1D) -> Float1D:
    """Unknown as zero, infinite (no reversal yet) as the largest known."""
    finite = np.isfinite(values)
    if finite.all():
        return values
    known = values[finite]
    top = float(np.max(np.abs(known), initial=0.0))
    return np.nan_to_num(values, nan=0.0, posinf=top, neginf=-top)
