"""What the drive train of an axis adds: inertia, weight, lost motion, ripple, other axes.

In:  `AxisState`. Out: mechanisms of the catalogue; the laws are in `pido.physics.drive`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pido.core.axes import LINEAR_AXES
from pido.diagnosis.mechanisms.base import Mechanism, Parameter, choice, column, nothing, which
from pido.diagnosis.mechanisms.friction import PEAKS
from pido.diagnosis.mechanisms.sliding import turns
from pido.diagnosis.state import AxisState
from pido.physics.drive import lost_motion, periods_of, wave

_KINDS = ("a", "v", "sgn(v)")
# Leads of ball screws, their fractions, and pitches of linear motors and gears that are usual, mm.
_PERIODS = (
    1.0,
    1.25,
    1.5,
    2.0,
    2.5,
    3.0,
    4.0,
    5.0,
    6.0,
    7.5,
    8.0,
    10.0,
    12.0,
    16.0,
    20.0,
    24.0,
    30.0,
    32.0,
    40.0,
    50.0,
)
_HARMONICS = (2.0, 1.0, 1 / 2, 1 / 3, 1 / 4, 1 / 5, 1 / 6, 1 / 8, 1 / 12)  # of a lead, as periods
_SHORTEST, _LONGEST = 0.4, 60.0  # mm, periods of a ripple
_WAVES = 1.5  # of a ripple along the travel, the fewest that show that it repeats itself


class Inertia(Mechanism):
    """Mass that is accelerated (Newton 1687)."""

    id = "inertia"
    equation = "dI = m * a"
    amplitudes = (Parameter("m", "A/(mm/s²)", low=0.0),)
    axes = LINEAR_AXES
    summary = "while the {axis} axis speeds up or slows down"

    def regressors(self, state, **shape):
        return column(state.a)

    def needs(self, states):
        return None if any(np.any(s.moving) for s in states) else "the axis never moves in these parts"


class GravityLoad(Mechanism):
    """Weight on a vertical axis; `by_tool`: 0 constant, 1 in proportion to the tool's mass."""

    id = "gravity_load"
    equation = "dI = G (constant) or G * m_tool"
    amplitudes = (Parameter("G", "A or A/kg"),)
    shape = (choice("by_tool", 2),)
    axes = LINEAR_AXES
    summary = "{axis} axis, at all times, also at standstill"
    quantity = "by_tool"
    follows_from = ("vertical", "tool_mass")

    def regressors(self, state, *, by_tool):
        if round(by_tool) == 0:
            return column(np.ones(len(state.time)))
        return nothing(state) if state.tool_mass is None else column(state.tool_mass)

    def equation_in(self, axis, shape):
        return ("dI = G", "dI = G * m_tool")[round(shape["by_tool"])]

    def needs(self, states):
        if any(s.vertical is None for s in states):
            return "it is not known which axis is vertical (vertical_axis in part.json)"
        return None if all(s.vertical for s in states) else "the axis is not vertical"


class Backlash(Mechanism):
    """A transient after each reversal; `per`: 0 over way (mm), 1 over time (s); `edge`: 1 fading, 8 a rectangle.

    Over way it fades exponentially or ends: in between it would be a presliding friction that fits a little better.
    stands : at standstill 0 the drive goes on holding it, 1 it is zero
    """

    id = "backlash"
    transient = True
    equation = "dI = B * exp(-(s / gap)^edge) * sgn(v), held or 0 at rest, s = way or time since the reversal"
    amplitudes = (Parameter("B", "A"),)
    shape = (
        Parameter("gap", "mm or s", low=0.005, high=5.0, scale="log", points=8),
        Parameter("edge", "–", low=1.0, high=64.0, scale="log", values=(1.0, 8.0, 64.0)),
        choice("per", 2),
        choice("stands", 2, first=1),
    )
    axes = LINEAR_AXES

    def regressors(self, state, *, gap, edge, per, stands=0.0):
        s = state.since_reversal if round(per) == 0 else state.since_reversal_s
        return column(lost_motion(s, gap, edge) * (state.held, state.along)[round(stands)])

    def equation_in(self, axis, shape):
        s = ("way", "time")[round(shape["per"])]
        rest = ("held at rest", "at rest 0")[round(shape.get("stands", 0.0))]
        return f"dI = B * exp(-(s / gap)^edge) * sgn(v), {rest}; s = {s} since the last reversal"

    def needs(self, states):
        return turns(states)

    def starts(self, states):
        """What fades over way is zero at rest as well: held there, it is nearly a presliding friction."""
        every = [s for s in super().starts(states) if s["gap"] <= _longest(s)]
        return *every, *({**s, "stands": 1.0} for s in every if s["edge"] < 2 and not s["per"])

    def around(self, name, shape, states):
        low, high = super().around(name, shape, states)
        if name == "gap":
            return low, min(high, _longest(shape))
        if round(shape["per"]) == 1:
            return low, high
        return (shape[name], shape[name]) if shape[name] < 2.0 else (max(low, 2.0), high)

    def conditions(self, axis, shape):
        reach = shape["gap"] * (3.0 if shape["edge"] < 2 else 1.0)
        unit, what = ("mm", "travel") if round(shape["per"]) == 0 else ("s", "time")
        return f"within {reach:.3g} {unit} after a reversal of the {axis} axis", (
            f"{what} since reversal < {reach:.3g}",
        )


def _longest(shape):
    """mm or s – beyond which what fades after a reversal is something else, and a way that ends no play."""
    return 5.0 if round(shape["per"]) == 0 and shape["edge"] >= 2.0 else 2.0


class AxisCoupling(Mechanism):
    """Another axis' motion felt by this one; `source`: 0-8 = a, v, sgn(v) of x, then y, then z."""

    id = "axis_coupling"
    equation = "dI = k * (a_j, v_j or sgn(v_j)), j another axis"
    amplitudes = (Parameter("k", "A per mm/s², mm/s or 1"),)
    shape = (choice("source", 9),)
    quantity = "source"

    def regressors(self, state, *, source):
        j, kind = divmod(which(source, 9), 3)
        other = state.others.get(LINEAR_AXES[j])
        if other is None or LINEAR_AXES[j] == state.axis:
            return nothing(state)
        right = np.ones(len(state.time)) if other.wrong is None else ~other.wrong
        return column((other.a, other.v * other.moving, other.along)[kind] * right)

    def equation_in(self, axis, shape):
        j, kind = divmod(which(shape["source"], 9), 3)
        name = LINEAR_AXES[j]
        return f"dI = k * {(f'a_{name}', f'v_{name}', f'sgn(v_{name}), 0 while {name} rests')[kind]}"

    def needs(self, states):
        moved = any(np.any(o.moving) for s in states for n, o in s.others.items() if n in LINEAR_AXES)
        return None if moved else "no other axis moves"

    def starts(self, states):
        """Only the other linear axes that move."""
        there = {n for s in states for n, o in s.others.items() if n in LINEAR_AXES and np.any(o.moving)}
        return tuple(x for x in super().starts(states) if LINEAR_AXES[int(x["source"]) // 3] in there)

    def conditions(self, axis, shape):
        j, kind = divmod(which(shape["source"], 9), 3)
        name = LINEAR_AXES[j]
        return f"{axis} axis, while the {name} axis moves ({_KINDS[kind]} of {name})", (f"v_{name} != 0",)


_LATEST = 0.1  # s, that a current answers late by


class TorqueRipple(Mechanism):
    """A current periodic in the axis position: cogging, ball screw (any phase).

    harmonics : 0 one wave, 1 with that of half its length, 2 with that of a third, too: no cog is a sine
    late : s, by which the current answers after the place was passed, through the loop that drives the axis; without
        it, the wave has another phase in each direction and looks like a friction that varies along the travel
    """

    id = "torque_ripple"
    equation = (
        "dI = R_s * sin(2 pi p / L) + R_c * cos(2 pi p / L), p = pos - late * v, "
        "or with R_s2 * sin(4 pi p / L) + R_c2 * cos(4 pi p / L) added, or these and R_s3, R_c3 with 6 pi p / L"
    )
    amplitudes = tuple(Parameter(name, "A") for name in ("R_s", "R_c", "R_s2", "R_c2", "R_s3", "R_c3"))
    shape = (
        Parameter("L", "mm", low=_SHORTEST, high=_LONGEST, scale="log", values=_PERIODS),
        choice("harmonics", 3, first=2),
        Parameter("late", "s", values=(0.0,)),
    )
    axes = LINEAR_AXES
    summary = "{axis} axis, repeating every {L:.4g} mm of travel"
    looked_at = 500
    follows_from = ("pos",)

    def regressors(self, state, *, L, harmonics=0.0, late=0.0):
        if state.pos is None:
            return nothing(state, len(self.amplitudes))
        passed = state.pos - late * np.nan_to_num(state.v)
        none = np.zeros((len(passed), 2))
        return np.column_stack([wave(passed, L / n) if n <= 1 + which(harmonics, 3) else none for n in (1, 2, 3)])

    def equation_in(self, axis, shape):
        text = "dI = R_s * sin(2 pi p / L) + R_c * cos(2 pi p / L)"
        for n in range(2, 2 + which(shape.get("harmonics", 0.0), 3)):
            text += f" + R_s{n} * sin({2 * n} pi p / L) + R_c{n} * cos({2 * n} pi p / L)"
        return f"{text}; p = pos - late * v"

    def idle(self, shape):
        used = 2 + 2 * which(shape.get("harmonics", 0.0), 3)
        return frozenset(p.name for p in self.amplitudes[used:])

    def needs(self, states):
        if any(s.pos is None for s in states):
            return "no position of the axis"
        longest = travel(states)
        return None if longest > 2.0 else f"the axis travels {longest:.2g} mm only"

    def starts(self, states):
        """Harmonics of the lead where it is known, usual periods besides; none that hardly repeats itself."""
        own = [h * s.lead for s in states[:1] if s.lead is not None for h in _HARMONICS]
        longest = _longest_period(states)
        periods = {round(p, 6) for p in (*own, *_PERIODS) if _SHORTEST <= p <= longest}
        return tuple({"L": p, "harmonics": 0.0, "late": 0.0} for p in sorted(periods) or [_SHORTEST])

    def suggest(self, states, left):
        """Peaks of the periodogram over position."""
        if any(s.pos is None for s in states):
            return ()
        pos = np.concatenate([s.pos for s in states if s.pos is not None])
        value, moving = np.concatenate(left), np.concatenate([s.moving for s in states])
        good = np.isfinite(value) & np.isfinite(pos) & moving
        peaks = periods_of(pos[good], value[good], _SHORTEST, _longest_period(states), PEAKS)
        return tuple({"L": p, "harmonics": harmonics, "late": 0.0} for harmonics in (0.0, 1.0) for p in peaks)

    def around(self, name, shape, states):
        """Half a wave more or less over the whole travel, or at the usual feed: beyond it begins the next wave."""
        if name == "late":
            feeds = np.concatenate([np.abs(s.v[s.moving]) for s in states])
            most = min(_LATEST, 0.25 * shape["L"] / max(float(np.median(feeds)), 1e-9)) if len(feeds) else 0.0
            return -most, most
        if name != "L":
            return shape[name], shape[name]
        step, longest = 0.5 / max(travel(states), 1e-9), _longest_period(states)
        f = 1.0 / shape["L"]
        return max(_SHORTEST, 1.0 / (f + step)), 1.0 / max(f - step, 1.0 / longest)


def _longest_period(states: Sequence[AxisState]) -> float:
    """mm – of which the travel holds one wave and a half, or one where the lead of the screw speaks for it: what does
    not repeat itself is not periodic."""
    waves = 1.0 if states and states[0].lead is not None else _WAVES
    return min(_LONGEST, travel(states) / waves)


def travel(states: Sequence[AxisState]) -> float:
    """mm from the lowest to the highest position of the axis in any part."""
    ends = [(np.nanmin(s.pos), np.nanmax(s.pos)) for s in states if s.pos is not None and np.isfinite(s.pos).any()]
    return float(max(e[1] for e in ends) - min(e[0] for e in ends)) if ends else 0.0
