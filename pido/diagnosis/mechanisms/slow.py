"""Slow and electrical: heat and saturation.

In:  `AxisState`. Out: mechanisms of the catalogue; warming is in `pido.physics.thermal`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pido.core.arrays import Bool1D, Float1D
from pido.core.axes import LINEAR_AXES
from pido.diagnosis.mechanisms.base import Mechanism, Parameter, Told, choice, column, nothing, which
from pido.diagnosis.mechanisms.sliding import HELD, SIMULATED, STEEP, at_rest, direction
from pido.diagnosis.state import AxisState
from pido.physics.drive import beyond
from pido.physics.thermal import coldness, coldness_after

_USUAL, _HIGH = 0.95, 0.99  # quantiles of the current's size: where a law acts, and of all
_HIGH_SHARE = 0.5  # of the latter, from which the former is high


class ThermalDrift(Mechanism):
    """A load that goes to a steady value, first order.

    clock : 0 every part starts cold, 1 cold at the first part only, 2 cooling in the pauses between parts, 3 cold where
        the machine's clock begins, which may be long before the first part
    along : 0 a constant load, 1 against the motion, 2 with the speed (oil thins as it warms)
    rises : 0 fades from cold, 1 grows towards the steady value
    rest : of a load against the motion, what it is at rest (see `direction`)
    cools : the time constant in the pauses (clock 2) over that of warming; what does not run has no fan and stirs no
        oil, and cools more slowly
    """

    id = "thermal_drift"
    becomes = frozenset({"coulomb_friction", "viscous_friction", "gravity_load", "sensor_offset"})
    equation = "dI = T * exp(-t / tau) or T * (1 - exp(-t / tau)), constant or along sgn(v) or v"
    amplitudes = (Parameter("T", "A or A/(mm/s)"),)
    shape = (
        Parameter("tau", "s", low=10.0, high=20000.0, scale="log", points=8),
        choice("clock", 4),
        choice("along", 3),
        choice("rises", 2),
        choice("rest", SIMULATED + 1, first=1),
        Parameter("cools", "–", low=0.1, high=10.0, scale="log", values=(1.0, 0.4, 2.0, 5.0), first=1),
    )
    summary = "{axis} axis, changing over the time since start with a time constant of {tau:.3g} s"
    follows_from = ("clock",)

    def regressors(self, state, *, tau, clock, along, rises, rest=0.0, cools=1.0):
        if round(clock) == 0:
            cold = coldness(state.time, tau)
        elif state.clock is None or state.earlier is None:
            return nothing(state)
        elif round(clock) == 1:
            first = state.earlier[0][0] if state.earlier else float(state.clock[0])
            cold = coldness(state.clock - first, tau)
        elif round(clock) == 3:
            cold = coldness(np.maximum(state.clock, 0.0), tau)
        else:
            start = float(state.clock[0])
            cold = coldness(state.clock - start, tau, coldness_after(state.earlier, start, tau, cools * tau))
        level = 1.0 - cold if round(rises) == 1 else cold
        factor = (np.ones(len(cold)), direction(state, rest), state.v * state.moving)[which(along, 3)]
        return column(level * factor)

    def equation_in(self, axis, shape):
        clock, rises = round(shape["clock"]), round(shape["rises"]) == 1
        cold = f"{'c_0 * ' if clock == 2 else ''}exp(-t / tau)"
        along = ("", f" * sgn(v), {at_rest(shape.get('rest', 0.0))}", " * v")[which(shape["along"], 3)]
        slowly = ", which cool with cools * tau" if self._cools_of_itself(shape) else ""
        since = (
            "t = time since the start of each part",
            "t = time since the start of the first part",
            "t = time since the start of each part, c_0 = 1 in the first part, less after short pauses" + slowly,
            "t = time on the machine's clock",
        )[which(clock, 4)]
        return f"dI = T * {f'(1 - {cold})' if rises else cold}{along}; {since}"

    def starts(self, states):
        """Five time constants between a fifth of the longest part and three times the whole time on the clock."""
        longest = max(float(s.time[-1] - s.time[0]) for s in states)
        first, last = states[0].clock, states[-1].clock
        timed = first is not None and last is not None and all(s.earlier is not None for s in states)
        whole = float(last[-1] - first[0]) if timed and first is not None and last is not None else longest
        clocks = (0.0,) if not timed else (0.0, 1.0, 2.0) if len(states) > 1 else (0.0, 2.0)
        forms = [(clock, rises) for clock in clocks for rises in (0.0, 1.0)]
        if timed and first is not None and 0.0 < float(first[0]) < 3 * whole:
            forms.append((3.0, 1.0))  # what fades differs from clock 1 by its size only
        low, high = self.shape[0].low or 0.0, self.shape[0].high or np.inf
        taus = np.clip(np.geomspace(0.2 * longest, max(3 * whole, longest), 5), low, high)
        rests = states[0].axis in LINEAR_AXES and any(np.any((s.held != 0) & ~s.moving) for s in states)
        held = float(HELD if all(s.sim_held is None for s in states) else SIMULATED)
        return tuple(
            {"tau": tau, "clock": clock, "along": along, "rises": rises, "rest": rest, "cools": 1.0}
            for tau in dict.fromkeys(taus.tolist())
            for clock, rises in forms
            for along in (0.0, 1.0, 2.0)
            for rest in ((0.0, held) if along == 1 and rests else (0.0,))
        )

    def forms_at_rest(self, shape):
        return tuple({**shape, "rest": rest} for rest in STEEP) if which(shape["along"], 3) == 1 else (dict(shape),)

    def free(self, shape):
        return 1 + self._cools_of_itself(shape)

    def idle(self, shape):
        return frozenset() if self._cools_of_itself(shape) else frozenset({"cools"})

    def around(self, name, shape, states):
        if name == "cools" and self._cools_of_itself(shape):
            return self.shape[-1].low, self.shape[-1].high
        if name != "tau":
            return shape.get(name, 0.0), shape.get(name, 0.0)
        return max(self.shape[0].low or 0.0, shape["tau"] / 3), min(self.shape[0].high or np.inf, shape["tau"] * 3)

    @staticmethod
    def _cools_of_itself(shape: Mapping[str, float]) -> bool:
        return round(shape["clock"]) == 2 and shape.get("cools", 1.0) != 1

    def told(self, states, shape, sizes):
        """With which way it goes: what fades from cold falls, as far as it adds to the simulation's."""
        T, plain = sizes.get("T"), super().told(states, shape, sizes)
        if T is None:
            return plain
        along, rises = which(shape["along"], 3), round(shape["rises"]) == 1
        noun = ("a load", "friction", "friction that goes with the speed")[along]
        grows = rises if along == 0 else rises == (T > 0)
        goes = ("builds up" if grows else "fades") if along == 0 else ("grows" if grows else "falls")
        by = f" by {abs(T):.3g} A" if along < 2 else ""
        again = ", and comes back in pauses" if round(shape["clock"]) == 2 else ""
        summary = f"{states[0].axis} axis, {noun} {goes}{by} with a time constant of {shape['tau']:.3g} s{again}"
        name = f"{noun} {'and' if along == 2 else 'that'} {goes} as the machine warms up"
        return Told(summary, plain.conditions, name)

    def needs(self, states):
        longest = max(float(s.time[-1] - s.time[0]) for s in states)
        return None if longest >= 20.0 else f"the longest part lasts {longest:.0f} s; at least 20 s are needed"


class CurrentSaturation(Mechanism):
    """A current that is no longer proportional to torque.

    form : 0 what lies beyond a knee, 1 grows with the square, 2 with the cube, 3 bends towards I_k (hyperbolic
        tangent), 4 with the square of what lies beyond a knee
    """

    id = "current_saturation"
    equation = (
        "dI = s * (|I| - I_k)+ * sgn(I), s * (|I| - I_k)+^2 * sgn(I), s * I * |I|, s * I^3 "
        "or s * (I - I_k * tanh(I / I_k)); I simulated"
    )
    passes_loop = False
    amplitudes = (Parameter("s", "–, 1/A or 1/A²", low=-1.2),)
    shape = (Parameter("I_k", "A", low=0.01, high=200.0, scale="log", points=9), choice("form", 5))

    def regressors(self, state, *, I_k, form):
        sim = state.sim
        if sim is None:
            return nothing(state)
        form = which(form, 5)
        if form in (0, 4):
            excess = beyond(sim, I_k)
            return column(excess if form == 0 else excess * np.abs(excess))
        if form == 3:
            return column(sim - I_k * np.tanh(sim / I_k))
        return column(sim * np.abs(sim) ** form)

    def equation_in(self, axis, shape):
        form = (
            "s * (|I| - I_k) * sgn(I) beyond |I| = I_k, else 0",
            "s * I * |I|",
            "s * I^3",
            "s * (I - I_k * tanh(I / I_k))",
            "s * (|I| - I_k)^2 * sgn(I) beyond |I| = I_k, else 0",
        )[which(shape["form"], 5)]
        return f"dI = {form}; I = simulated current"

    def idle(self, shape):
        return frozenset({"I_k"}) if round(shape["form"]) in (1, 2) else frozenset()

    def needs(self, states):
        if any(s.sim is None for s in states):
            return "no simulated current of this axis"
        return None if any(np.ptp(_sizes([s])) > 0 for s in states) else "the simulated current never changes"

    def starts(self, states):
        """Knees at quantiles of the simulated current's size; the powers have none."""
        sizes = _sizes(states)
        knees = [float(k) for k in dict.fromkeys(np.quantile(sizes, (0.5, 0.75, 0.9, 0.97, 0.995))) if k > 0]
        bends = [(k, 3.0) for k in (*knees, max(float(sizes.max()), 0.01))]
        beyond_knees = [(k, f) for k in knees for f in (0.0, 4.0)]
        return tuple({"I_k": k, "form": f} for k, f in (*beyond_knees, (1.0, 1.0), (1.0, 2.0), *bends))

    def around(self, name, shape, states):
        form, knee = round(shape["form"]), shape["I_k"]
        if name != "I_k" or form in (1, 2):
            return shape[name], shape[name]
        # Bent less than this, the tangent is the cube again.
        return knee / 2, min(knee * 2, max(knee, 1.2 * float(_sizes(states).max()))) if form == 3 else knee * 2

    def free(self, shape):
        return 0 if round(shape["form"]) in (1, 2) else 1

    def conditions(self, axis, shape):
        if round(shape["form"]) in (0, 4):
            return f"{axis} axis, at high torque, beyond {shape['I_k']:.3g} A", (
                f"|curr_{axis}_sim| > {shape['I_k']:.3g}",
            )
        return f"{axis} axis, at high torque, more the higher it is", ()

    def told_in(self, states, rows, shape, sizes):
        """Where it is confined to currents that are small beside the axis' own, these in place of a high torque."""
        plain = super().told_in(states, rows, shape, sizes)
        knee = shape["I_k"] if round(shape["form"]) in (0, 4) else 0.0
        every = _sizes(states)
        there = _sizes(states, rows)
        there = there[there > knee]
        if not 0 < len(there) < len(every):
            return plain
        usual, high = float(np.quantile(there, _USUAL)), float(np.quantile(every, _HIGH))
        if usual >= _HIGH_SHARE * high:
            return plain
        how = f"beyond {knee:.3g} A" if knee else "more the higher the current is"
        size = f"at currents of at most {usual:.3g} A there, which are low beside the axis' {high:.3g} A"
        return plain._replace(summary=f"{states[0].axis} axis, {how}, {size}")


def _sizes(states: Sequence[AxisState], rows: Sequence[Bool1D] | None = None) -> Float1D:
    """A, size of the simulated current of every sample, or of those in `rows` (per part, (n,))."""
    each = [np.ones(len(s.time), bool) for s in states] if rows is None else rows
    found = [np.abs(s.sim[np.isfinite(s.sim) & r]) for s, r in zip(states, each, strict=True) if s.sim is not None]
    return np.concatenate([f for f in found if len(f)] or [np.zeros(1)])
