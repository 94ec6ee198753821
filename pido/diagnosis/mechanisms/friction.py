"""Friction of an axis: what it resists with, in motion, at standstill and after a reversal.

In:  `AxisState`. Out: mechanisms of the catalogue; the laws are in `pido.physics.friction`, their sign in `sliding`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.core.axes import LINEAR_AXES
from pido.diagnosis.mechanisms.base import Mechanism, Parameter, choice, column, nothing, which
from pido.diagnosis.mechanisms.sliding import (
    REST,
    RISES_MM_S,
    SIMULATED,
    V_0,
    Sliding,
    at_rest,
    direction,
    is_smooth,
    moves,
    turned,
    turning,
    turns,
)
from pido.diagnosis.state import AxisState
from pido.physics.drive import best_stretch, periods_of, wave
from pido.physics.friction import dahl_state, stribeck_curve

# Friction of the other direction, of that of the first, which is still an asymmetry: with more of it the axis lacks
# Coulomb's or viscous friction as well, which is a finding of its own; with all of it against it, it is two halves.
_LEAST_BACK, _MOST_BACK = 0.3, 0.95
_SHORTEST = 2.0  # mm, of a wave of friction along the travel: half the lead of a fine screw
PEAKS = 3  # of a periodogram that are handed on


class CoulombFriction(Sliding):
    """Friction of constant size against the motion (Coulomb 1785)."""

    id = "coulomb_friction"
    equation = "dI = F_c * sgn(v), at rest 0 or held, or with tanh(v / v_0) for sgn(v)"
    amplitudes = (Parameter("F_c", "A", low=0.0),)
    shape = (REST, V_0)
    summary = "whenever the {axis} axis moves, against its direction"

    def regressors(self, state, *, rest=0.0, v_0=RISES_MM_S[0]):
        return column(direction(state, rest, v_0))

    def starts(self, states):
        """A spindle that stands holds nothing: what it draws at rest is no friction. Where a simulation holds something
        of its own at rest, that is a start, too."""
        every = super().starts(states)
        if states[0].axis not in LINEAR_AXES:
            return tuple(shape for shape in every if shape["rest"] == 0.0)
        known = any(s.sim_held is not None for s in states)
        return (*every, {**every[0], "rest": float(SIMULATED)}) if known else every

    def equation_in(self, axis, shape):
        return f"dI = F_c * sgn(v), {at_rest(shape.get('rest', 0.0))}"

    def needs(self, states):
        return moves(states)


class ViscousFriction(Mechanism):
    """Friction that grows in proportion to speed."""

    id = "viscous_friction"
    equation = "dI = F_v * v"
    amplitudes = (Parameter("F_v", "A/(mm/s)", low=0.0),)
    axes = LINEAR_AXES
    summary = "in motion of the {axis} axis, more at higher feed"

    def regressors(self, state, **shape):
        return column(state.v * state.moving)

    def needs(self, states):
        return moves(states)


class StribeckFriction(Sliding):
    """Friction that rises as the axis slows down (Stribeck 1902; Armstrong-Hélouvry 1994).

    rest : 0 nothing at standstill; else the drive goes on holding against the static friction with which it stopped
    """

    id = "stribeck_friction"
    transient = True
    equation = (
        "dI = (F_s - F_c) * exp(-(|v| / v_s)^delta) * sgn(v), at rest 0 or with the sign of the last motion, "
        "or with tanh(v / v_0) for sgn(v)"
    )
    amplitudes = (Parameter("F_s - F_c", "A", low=0.0),)
    shape = (
        Parameter("v_s", "mm/s", low=0.05, high=40.0, scale="log", points=9),
        Parameter("delta", "–", low=0.5, high=2.0, values=(1.0, 2.0)),
        REST,
        V_0,
    )
    axes = LINEAR_AXES

    def regressors(self, state, *, v_s, delta, rest=0.0, v_0=RISES_MM_S[0]):
        return column(stribeck_curve(state.v, v_s, delta) * direction(state, rest, v_0))

    def equation_in(self, axis, shape):
        return f"dI = (F_s - F_c) * exp(-(|v| / v_s)^delta) * sgn(v), {at_rest(shape.get('rest', 0.0))}"

    def needs(self, states):
        return moves(states)

    def starts(self, states):
        """With what holds at rest only curves that have fallen off at usual speeds: otherwise it is Coulomb's."""
        fast = [np.abs(s.v[s.moving & np.isfinite(s.v)]) for s in states]
        usual = float(np.median(np.concatenate(fast) if any(map(len, fast)) else np.zeros(1)))
        return tuple(x for x in super().starts(states) if x["rest"] == 0.0 or x["v_s"] <= usual)

    def conditions(self, axis, shape):
        limit = 1.5 * shape["v_s"]
        return f"while the {axis} axis moves slowly, below {limit:.3g} mm/s", (f"|v_{axis}| < {limit:.3g}",)


class StandstillFriction(Mechanism):
    """Friction that holds at standstill with the sign of the last motion.

    rest : 0 of any, 1 to 3 turned over a way, 4 as far as the simulation holds there
    """

    id = "standstill_friction"
    equation = "dI = F_h * sgn(v before the stop) at standstill"
    amplitudes = (Parameter("F_h", "A", low=0.0),)
    shape = (choice("rest", SIMULATED + 1),)
    axes = LINEAR_AXES
    summary = "{axis} axis, at standstill, with the sign of its last motion"

    def regressors(self, state, *, rest=0.0):
        return column(turned(state, round(rest)) * ~state.moving if round(rest) else state.held - state.along)

    def equation_in(self, axis, shape):
        form = round(shape.get("rest", 0.0))
        return f"{self.equation}, {turning(form)}" if form else self.equation

    def starts(self, states):
        known = any(s.sim_held is not None for s in states)
        return tuple(shape for shape in super().starts(states) if known or shape["rest"] != SIMULATED)

    def needs(self, states):
        still = any(np.any((s.held != 0) & ~s.moving) for s in states)
        return None if still else "the axis never stands still after a motion"

    def conditions(self, axis, shape):
        return self.summary.format(axis=axis), (f"v_{axis} = 0",)


class FrictionAsymmetry(Sliding):
    """Different Coulomb and viscous friction in the two directions.

    side : 0 both halves, 1 only +, 2 only -, 3 in + and `back` times as much in -, 4 the other way round
    """

    id = "friction_asymmetry"
    equation = (
        "dI = (dF_c + dF_v * |v|) on one side, in opposite halves, or on one side and back times as much on the other, "
        "at rest 0 or held, or with tanh(v / v_0) for sgn(v)"
    )
    amplitudes = (Parameter("dF_c", "A"), Parameter("dF_v", "A/(mm/s)"))
    shape = (
        choice("side", 5),
        Parameter("back", "–", low=-_MOST_BACK, high=_LEAST_BACK, values=(-0.4, 0.2)),
        REST,
        V_0,
    )
    axes = LINEAR_AXES
    summary = "{axis} axis, friction differs between + and - direction"

    def regressors(self, state, *, side, back=0.0, rest=0.0, v_0=RISES_MM_S[0]):
        h = direction(state, rest, v_0)
        forth, other = np.maximum(h, 0.0), np.minimum(h, 0.0)
        weight = (np.abs(h) / 2, forth, other, forth + back * other, other + back * forth)[which(side, 5)]
        return np.column_stack([weight, weight * np.abs(state.v)])

    def starts(self, states):
        """Of what acts on both sides only forms that are zero at rest: a search looks for the others from there."""
        every = super().starts(states)
        one = tuple({**shape, "back": 0.0} for shape in every if shape["side"] < 3 and shape["back"] > 0)
        return one + tuple(shape for shape in every if shape["side"] >= 3 and shape["rest"] == 0)

    def around(self, name, shape, states):
        if name != "back":
            return super().around(name, shape, states)
        return (-_MOST_BACK, _LEAST_BACK) if shape["side"] >= 3 else (shape[name], shape[name])

    def free(self, shape):
        return super().free(shape) - (shape["side"] < 3)

    def idle(self, shape):
        return super().idle(shape) | (frozenset() if shape["side"] >= 3 else {"back"})

    def equation_in(self, axis, shape):
        form = (
            "(dF_c + dF_v * |v|) / 2 in both directions",
            "dF_c + dF_v * |v| in + direction only",
            "-(dF_c + dF_v * |v|) in - direction only",
            "dF_c + dF_v * |v| in + direction, -back times as much in -",
            "-(dF_c + dF_v * |v|) in - direction, back times as much in +",
        )[which(shape["side"], 5)]
        return f"dI = {form}, {at_rest(shape.get('rest', 0.0))}"

    def needs(self, states):
        both = any(np.any(direction(s) > 0) for s in states) and any(np.any(direction(s) < 0) for s in states)
        return None if both else "the axis moves in one direction only"


class LoadDependentFriction(Sliding):
    """Coulomb friction that grows with the process load across the guideway.

    `across`: 0 the whole load, 1 and 2 only that along the first and second other axis, where the guideway carries it.
    """

    id = "load_dependent_friction"
    equation = "dI = mu * |F_perp| * sgn(v), at rest 0 or held, or with tanh(v / v_0) for sgn(v)"
    amplitudes = (Parameter("mu", "A/N", low=0.0),)
    shape = (choice("across", 3), REST, V_0)
    axes = LINEAR_AXES
    summary = "{axis} axis in motion under process load"
    follows_from = ("force_perp",)

    def regressors(self, state, *, across=0.0, rest=0.0, v_0=RISES_MM_S[0]):
        if state.force_perp is None:
            return nothing(state)
        others = [np.abs(f) for a, f in state.forces.items() if a != state.axis]
        load = (state.force_perp, *others)[round(across)]
        return column(load * direction(state, rest, v_0))

    def equation_in(self, axis, shape):
        one, other = (f"f_{a}" for a in LINEAR_AXES if a != axis)
        load = (f"sqrt({one}^2 + {other}^2)", f"|{one}|", f"|{other}|")[round(shape.get("across", 0.0))]
        return f"dI = mu * {load} * sgn(v), {at_rest(shape.get('rest', 0.0))}"

    def needs(self, states):
        if any(s.force_perp is None for s in states):
            return "no process forces across the axis (f_x_sim, f_y_sim, f_z_sim)"
        return None if any(np.any(s.force_perp) for s in states) else "no process load in these parts"


_PLACES = {5: 7, 6: 13}
"""At which the forms of a friction along the travel take its height, beside those with a few numbers."""


class PositionDependentFriction(Sliding):
    """Friction that varies along the travel, with its mean.

    form : 0 a wave of any phase, 1 a slope and a bend, 2 one tight place; 3 and 4 are 0 and 1 without their mean over
        the travel, which is Coulomb's where that is a finding of its own; 5 and 6 any curve, by its heights at
        seven and at thirteen places
    """

    id = "position_dependent_friction"
    becomes = frozenset({"coulomb_friction"})
    equation = (
        "dI = g(pos) * sgn(v), at rest 0 or held, or with tanh(v / v_0) for sgn(v); "
        "g = G_0 + G_1 * sin(2 pi u) + G_2 * cos(2 pi u), "
        "or G_0 + G_1 * u + G_2 * u^2, or G_1 * exp(-u^2 / 2), u = (pos - p_0) / L; "
        "beside Coulomb's friction without a mean: G_1 * u + G_2 * (u^2 - 1/3), p_0 in the middle; "
        "or piecewise linear through G_n at places evenly spaced from u = -1 to 1"
    )
    amplitudes = tuple(Parameter(f"G_{n}", "A") for n in range(max(_PLACES.values())))
    shape = (
        choice("form", 7),
        Parameter("L", "mm", low=0.5, high=5000.0, scale="log", points=12),
        Parameter("p_0", "mm", values=(0.0,)),
        REST,
        V_0,
    )
    axes = LINEAR_AXES
    looked_at = 300
    follows_from = ("pos",)

    def regressors(self, state, *, form, L, p_0, rest=0.0, v_0=RISES_MM_S[0]):
        if state.pos is None:
            return nothing(state, len(self.amplitudes))
        return self.along(state.pos, form=form, L=L, p_0=p_0) * direction(state, rest, v_0)[:, None]

    def along(self, pos: Float1D, *, form: float, L: float, p_0: float, **_: float) -> Float2D:
        """(n, amplitudes) – what each amplitude counts for in g, at places (n,)."""
        out = np.zeros((len(pos), len(self.amplitudes)))
        u, form = (pos - p_0) / L, round(form)
        one, zero = np.ones(len(pos)), np.zeros(len(pos))
        if form in (0, 3):
            columns = [one if form == 0 else zero, *wave(pos - p_0, L).T]
        elif form == 2:
            columns = [zero, np.exp(-(u**2) / 2)]
        elif form in _PLACES:
            at = (np.clip(u, -1, 1) + 1) / 2 * (_PLACES[form] - 1)
            columns = [np.maximum(1 - np.abs(at - n), 0) for n in range(_PLACES[form])]
        else:
            columns = [one, u, u**2] if form == 1 else [zero, u, u**2 - 1 / 3]
        out[:, : len(columns)] = np.column_stack(columns)
        return out

    def equation_in(self, axis, shape):
        form = round(shape["form"])

        def through(count: int) -> str:
            return ", ".join(f"G_{n}" for n in range(count))

        g = (
            "(G_0 + G_1 * sin(2 pi u) + G_2 * cos(2 pi u))",
            "(G_0 + G_1 * u + G_2 * u^2)",
            "G_1 * exp(-u^2 / 2)",
            "(G_1 * sin(2 pi u) + G_2 * cos(2 pi u))",
            "(G_1 * u + G_2 * (u^2 - 1/3))",
            *(f"(piecewise linear through {through(n)}, evenly from u = -1 to 1)" for n in _PLACES.values()),
        )[form]
        return f"dI = {g} * sgn(v), {at_rest(shape.get('rest', 0.0))}; u = (pos - p_0) / L"

    def idle(self, shape):
        form = round(shape["form"])
        used = {0: (0, 1, 2), 1: (0, 1, 2), 2: (1,), 3: (1, 2), 4: (1, 2)}.get(form) or range(_PLACES[form])
        idle = {f"G_{n}" for n in range(len(self.amplitudes)) if n not in used}
        return super().idle(shape) | idle

    def needs(self, states):
        return "no position of the axis" if any(s.pos is None for s in states) else moves(states)

    def starts(self, states):
        """Waves from a ninth to twice the travel, a parabola and two curves over it, five tight places of an eighth of
        it."""
        low, high = _ends(states)
        span = max(high - low, 1e-3)
        waves = [(0.0, span / (0.5 + 0.5 * k), 0.0) for k in range(18)]
        bend = [(form, span / 2, (low + high) / 2) for form in (1.0, *_PLACES)]
        places = [(2.0, span / 12, low + span * (k + 0.5) / 5) for k in range(5)]
        forms = (*waves, *bend, *places)
        return _at_and_off_rest(forms)

    def suggest(self, states, left):
        """The stretch of the travel whose friction stands out most from the rest of it, and the waves along it."""
        if any(s.pos is None for s in states):
            return ()
        low, high = _ends(states)
        pos = np.concatenate([s.pos for s in states if s.pos is not None])
        h = np.concatenate([direction(s) for s in states])
        value = np.concatenate(left)
        good = np.isfinite(value) & np.isfinite(pos) & (h != 0)
        if good.sum() < 50 or high - low < 1e-3:
            return ()
        pos, level = pos[good], (value * h)[good]
        shapes = [(0.0, L, 0.0) for L in periods_of(pos, level, _SHORTEST, high - low, PEAKS)]
        stretch = best_stretch(pos, level, low, high)
        if stretch is not None:
            shapes.append((2.0, (stretch[1] - stretch[0]) / 3, sum(stretch) / 2))
        return _at_and_off_rest(shapes)

    def around(self, name, shape, states):
        low, high = _ends(states)
        span = max(high - low, 1e-3)
        form, L, p_0 = round(shape["form"]), shape["L"], shape["p_0"]
        if name == "L" and form in (0, 3):
            return 1.0 / (1.0 / L + 0.3 / span), 1.0 / max(1.0 / L - 0.3 / span, 0.2 / span)
        if name == "L" and form == 2:
            return L / 3, min(3 * L, span)
        if name == "p_0" and form == 2:
            return max(low, p_0 - 2 * L), min(high, p_0 + 2 * L)
        return super().around(name, shape, states) if name == "v_0" else (shape[name], shape[name])

    def from_the_middle(self, shape, states):
        """Waves count from the middle of the travel: from further off, a phase is as little known as the length times
        all waves in between."""
        low, high = _ends(states)
        return {**shape, "p_0": (low + high) / 2} if round(shape["form"]) in (0, 3) else dict(shape)

    def free(self, shape):
        return (1, 0, 2, 1, 0, 0, 0)[round(shape["form"])] + is_smooth(shape)

    def conditions(self, axis, shape):
        form, L, p_0 = round(shape["form"]), shape["L"], shape["p_0"]
        if form == 2:
            low, high = p_0 - 2 * L, p_0 + 2 * L
            text = f"{axis} axis in motion, friction stands out from {low:.4g} to {high:.4g} mm"
            return text, (f"pos_{axis} > {low:.4g}", f"pos_{axis} < {high:.4g}")
        how = f"repeats every {L:.3g} mm" if form in (0, 3) else "changes along the travel"
        return f"{axis} axis in motion, friction {how}", (f"v_{axis} != 0",)


def _at_and_off_rest(forms: Sequence[tuple[float, float, float]]) -> tuple[dict[str, float], ...]:
    """Forms (form, L, p_0) of a friction along the travel as shapes: zero at rest, and held there."""
    return tuple(
        {"form": f, "L": L, "p_0": p, "rest": rest, "v_0": RISES_MM_S[0]} for rest in (0.0, 2.0) for f, L, p in forms
    )


def _ends(states: Sequence[AxisState]) -> tuple[float, float]:
    """mm, lowest and highest position in motion."""
    moved = [s.pos[s.moving & np.isfinite(s.pos)] for s in states if s.pos is not None]
    pos = np.concatenate([p for p in moved if len(p)] or [np.zeros(1)])
    return float(pos.min()), float(pos.max())


class PreslidingHysteresis(Mechanism):
    """Friction that turns over a small way after a reversal (Dahl 1968).

    `full`: 0 what a held sign lacks of it; 1 all of it; 2 what sgn(v) lacks of it, which is zero at standstill; 3 that
    of a drive which holds nothing at standstill.
    """

    id = "presliding_hysteresis"
    transient = True
    becomes = frozenset({"coulomb_friction"})
    equation = "dI = F_p * (z - z_sim); dz/ds = (h - z) / x_0, h = direction of the last motion, z_sim = h, 0 or sgn(v)"
    amplitudes = (Parameter("F_p", "A", low=0.0),)
    shape = (Parameter("x_0", "mm", low=0.003, high=3.0, scale="log", points=7), choice("full", 4))
    axes = LINEAR_AXES

    def regressors(self, state, *, x_0, full):
        z = dahl_state(state.held, state.since_reversal, state.segment, x_0)
        if round(full) == 3:
            return column((z - state.held) * state.moving)
        simulated = (state.held, np.zeros(len(z)), direction(state))[round(full)]
        return column(z - simulated)

    def equation_in(self, axis, shape):
        lacks = ("(z - h)", "z", f"(z - sgn(v)), sgn(v) {at_rest()}", f"(z - h), {at_rest()}")[round(shape["full"])]
        return f"dI = F_p * {lacks}; dz/ds = (h - z) / x_0, h = direction of the last motion"

    def needs(self, states):
        return turns(states)

    def conditions(self, axis, shape):
        """All of it acts all the time; what sgn(v) lacks of it also at standstill."""
        way, full = f"{3 * shape['x_0']:.3g}", round(shape.get("full", 0.0))
        if full == 1:
            turning = f"its sign turning within {way} mm after a reversal"
            return f"whichever way the {axis} axis moves and while it holds, {turning}", ()
        held, stands = (" and at standstill", f" or v_{axis} = 0") if full == 2 else ("", "")
        near = f"travel since reversal < {way}"
        return f"within {way} mm after a reversal of the {axis} axis{held}", (near + stands,)

    def told(self, states, shape, sizes):
        name = "friction that turns over a short distance after each reversal" * (round(shape.get("full", 0.0)) == 1)
        return super().told(states, shape, sizes)._replace(name=name)
