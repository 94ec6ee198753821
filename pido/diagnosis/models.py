"""The model of one axis that a diagnosis leaves behind: named terms with amplitudes, as plain JSON data and back.

In:  terms and amplitudes, or `Diagnosis.model`.
Out: `AxisModel`: simulated current and systematic mismatch of any part, from its state alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pido.core.arrays import Float1D
from pido.core.columns import CURRENT_SIM
from pido.core.errors import DiagnosisError
from pido.core.recording import Recording
from pido.diagnosis.arms import Arm, Eased
from pido.diagnosis.baseline import equation_inputs, equation_names, equation_rows
from pido.diagnosis.bends import Bend
from pido.diagnosis.dynamics import Ringing, RingingAlong
from pido.diagnosis.events import ExternalForce, Rhythm
from pido.diagnosis.formulas import Formula, Peak, Surface, unit_of
from pido.diagnosis.gaps import known_columns
from pido.diagnosis.gates import Gate
from pido.diagnosis.latched import Latched, Switched
from pido.diagnosis.late import Fading, Lagged, Modulated
from pido.diagnosis.late_arms import LaggedArm, Warped
from pido.diagnosis.late_eased import EasedLately
from pido.diagnosis.lateness import Late, shifted
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mechanisms.base import Mechanism
from pido.diagnosis.patches import Patch
from pido.diagnosis.pulses import Pulses
from pido.diagnosis.resonant import Resonant
from pido.diagnosis.rested import Rested
from pido.diagnosis.state import AxisState
from pido.diagnosis.terms import Term
from pido.diagnosis.tools import ByTool
from pido.diagnosis.transients import Transient
from pido.diagnosis.waves import Wave
from pido.physics.drive import Loop

_GIVEN_BY = {
    "way": "v_{axis} or pos_{axis}",
    "pos": "pos_{axis}",
    "force": "f_{axis}_sim",
    "force_perp": "f_x_sim, f_y_sim, f_z_sim",
    "m_sp": "m_sp_sim",
    "mrr": "mrr_sim",
    "ar": "mrr_sim and the speeds of x, y and z",
    "engaged": "mrr_sim",
    "edge_length": "a_p of the operations in part.json",
    "tool_radius": "diameter_mm of the tools in part.json",
    "coolant": "coolant",
    "tool_mass": "mass_kg of the tools in part.json",
    "cut_volume": "mrr_sim",
    "cut_time": "mrr_sim",
    "clock": "start_time_s in part.json",
    "wx": "workpiece in part.json",
    "vertical": "vertical_axis in part.json",
}
"""What a part may leave out of an axis' state, and where it would say so."""
BEYOND = 3.0  # times the largest effect that a term had on the diagnosed parts: no further on any other part


@dataclass(frozen=True)
class Equation:
    """The equation that stands for the simulation: alone, and refitted together with the findings.

    seen : range of each column that it follows from on the diagnosed parts, in the column's unit; of a model of before,
        which does not keep it, empty
    """

    names: tuple[str, ...]
    alone: Float1D
    joint: Float1D
    seen: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def of(self, recording: Recording, state: AxisState, coefficients: Float1D) -> Float1D:
        """(n,), A. Raises DiagnosisError where the part lacks a column that the equation follows from."""
        lacking = [c for c in equation_inputs(self.names) if c not in recording or np.isnan(recording[c]).all()]
        if lacking:
            raise DiagnosisError(_not_without(state, "the equation", lacking))
        at = [equation_names().index(n) for n in self.names]
        return coefficients @ equation_rows(recording, state)[at]


@dataclass(frozen=True)
class AxisModel:
    """simulated + effect = corrected.

    noise_level : A – what the residual of this axis usually is
    delay : s – the recording lags the simulation by delay[0] + delay[1] * time
    late : per part, s – in place of delay[0], where not all parts lag by the same; delay[0] is that of any other part
    steps : per part, (from, by), s each – by so much more it lags from then on
    limits : per part, A – the recorded current never leaves them; a part that was not seen has the widest
    largest : per term, A – its largest effect on the diagnosed parts; where it is not known, nothing is bounded
    known : what every diagnosed part said of the axis (fields of AxisState that a part may leave out)
    seen : per term, range of each signal that it follows from on the diagnosed parts, in the signal's unit; of a model
        of before, which does not keep it, empty
    """

    axis: str
    noise_level: float
    terms: tuple[Term, ...] = ()
    amplitudes: tuple[Float1D, ...] = ()
    equation: Equation | None = None
    delay: tuple[float, float] = (0.0, 0.0)
    late: Mapping[str, float] = field(default_factory=dict)
    steps: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = field(default=())
    largest: tuple[float, ...] = ()
    known: tuple[str, ...] = ()
    seen: tuple[Mapping[str, tuple[float, float]], ...] = ()

    def simulated(self, recording: Recording, state: AxisState) -> Float1D:
        """(n,), A. Raises DiagnosisError where the recording has no simulated current and there is no equation."""
        if self.equation is not None:
            return self.equation.of(recording, state, self.equation.alone)
        if state.sim is None:
            raise DiagnosisError(
                f"part {recording.part.part}: column '{CURRENT_SIM[self.axis]}' is missing, and the diagnosis was made "
                "against simulated currents. Add the simulation's current to this part."
            )
        return state.sim

    def effect(self, simulated: Float1D, recording: Recording, state: AxisState) -> Float1D:
        """(n,), A – recorded minus simulated current as far as it is systematic; NaN where a value that it follows from
        is missing.

        Raises DiagnosisError where the part does not say what a finding follows from, and the diagnosed parts did.
        """
        total = np.zeros(len(state.time))
        if late := self.lateness(recording.part.part):
            total += shifted(state.time, simulated, late) - simulated
        if self.equation is not None:
            total += self.equation.of(recording, state, self.equation.joint) - simulated
        bounds = self.largest or (np.inf,) * len(self.terms)
        for term, amplitudes, most in zip(self.terms, self.amplitudes, bounds, strict=True):
            columns = known_columns(term, recording, state)
            if not np.nan_to_num(columns).any():
                self._check_known(term, state)
            total += np.clip(amplitudes @ columns, -BEYOND * most, BEYOND * most)
        return np.clip(simulated + total, *self._limits_of(recording.part.part)) - simulated

    def lateness(self, part: str) -> Late:
        """Of a part that was not diagnosed: what parts have in common; a step is of the recording it was seen in."""
        return Late(self.late.get(part, self.delay[0]), self.delay[1], tuple(self.steps.get(part, ())))

    def _check_known(self, term: Term, state: AxisState) -> None:
        """A term that is nothing throughout: right where the part says so, not where it does not say."""
        follows_from = ("way", *term.mechanism.follows_from)  # of the motion of its axis, every law may speak
        names = [n for n in follows_from if n in self.known and getattr(state, n) is None]
        if names:
            silent = [_GIVEN_BY[name].format(axis=self.axis) for name in names]
            raise DiagnosisError(_not_without(state, term.name, list(dict.fromkeys(silent))))

    def _limits_of(self, part: str) -> tuple[float, float]:
        every = self.limits.values()
        widest = (min((v[0] for v in every), default=-np.inf), max((v[1] for v in every), default=np.inf))
        return self.limits.get(part, widest)


def _not_without(state: AxisState, what: str, lacking: Sequence[str]) -> str:
    return (
        f"part {state.part}: {what} on axis {state.axis} cannot be applied: the part lacks {', '.join(lacking)}, which "
        "the diagnosed parts had. Add it to the part."
    )


def known_of(states: Sequence[AxisState]) -> tuple[str, ...]:
    """What every part says of an axis that a part may leave out."""
    return tuple(name for name in _GIVEN_BY if all(getattr(s, name) is not None for s in states))


def as_json(models: Mapping[str, AxisModel]) -> dict[str, Any]:
    """`Diagnosis.model`."""
    return {"axes": {axis: _axis_json(m) for axis, m in models.items()}}


def axis_models(model: Mapping[str, Any]) -> dict[str, AxisModel]:
    """Back from `as_json`. Raises DiagnosisError for what this version does not know."""
    with readable():
        return {axis: _axis_model(axis, data) for axis, data in model["axes"].items()}


@contextmanager
def readable() -> Iterator[None]:
    """Raises DiagnosisError where what is read of a model in this block is not there, or of another kind."""
    try:
        yield
    except (LookupError, TypeError, AttributeError, ValueError) as error:
        raise DiagnosisError(
            f"the model of this diagnosis is damaged ({error!r}). Run 'pido diagnose' again."
        ) from None


def _axis_json(m: AxisModel) -> dict[str, Any]:
    return {
        "noise_level": m.noise_level,
        "delay": list(m.delay),
        "late": dict(m.late),
        "steps": {part: [list(step) for step in steps] for part, steps in m.steps.items()},
        "limits": {p: [v if np.isfinite(v) else None for v in limits] for p, limits in m.limits.items()},
        "equation": None
        if m.equation is None
        else {
            "names": list(m.equation.names),
            "alone": m.equation.alone.tolist(),
            "joint": m.equation.joint.tolist(),
            "seen": _ends_json(m.equation.seen),
        },
        "terms": [
            _term_json(t, a) | {"seen": _ends_json(seen)}
            for t, a, seen in zip(m.terms, m.amplitudes, m.seen or ({},) * len(m.terms), strict=True)
        ],
        "largest": list(m.largest),
        "known": list(m.known),
    }


def _axis_model(axis: str, data: Mapping[str, Any]) -> AxisModel:
    equation = data["equation"]
    terms = [_term(t) for t in data["terms"]]
    return AxisModel(
        axis=axis,
        noise_level=float(data["noise_level"]),
        terms=tuple(terms),
        amplitudes=tuple(_amplitudes(term, t["amplitudes"]) for term, t in zip(terms, data["terms"], strict=True)),
        equation=None
        if equation is None
        else Equation(
            tuple(equation["names"]), np.asarray(equation["alone"]), np.asarray(equation["joint"]), _ends(equation)
        ),
        delay=(float(data["delay"][0]), float(data["delay"][1])),
        late={str(part): float(offset) for part, offset in data.get("late", {}).items()},
        steps={
            str(part): tuple((float(start), float(by)) for start, by in steps)
            for part, steps in data.get("steps", {}).items()  # models of before do not have
        },
        limits={
            part: (-np.inf if low is None else float(low), np.inf if high is None else float(high))
            for part, (low, high) in data["limits"].items()
        },
        largest=tuple(float(v) for v in data.get("largest", [])),
        known=tuple(str(name) for name in data.get("known", []) if name in _GIVEN_BY),
        seen=tuple(map(_ends, data["terms"])),
    )


def _ends(data: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Ranges by name; none of a model of before."""
    return {str(name): (float(low), float(high)) for name, (low, high) in data.get("seen", {}).items()}


def _ends_json(seen: Mapping[str, tuple[float, float]]) -> dict[str, list[float]]:
    return {name: list(ends) for name, ends in seen.items()}


def _amplitudes(term: Term, kept: Sequence[float]) -> Float1D:
    """As kept; a model of before has none of the amplitudes that its mechanism's later forms alone have."""
    missing = len(term.mechanism.amplitudes) - len(kept)
    return np.pad(np.asarray(kept, float), (0, max(missing, 0)))


def _formula_json(law: Formula) -> dict[str, Any]:
    return {"factors": [list(f) for f in law.factors], "unit": law.unit, "seen": [list(r) for r in law.seen]}


def _term_json(term: Term, amplitudes: Sequence[float] | Float1D) -> dict[str, Any]:
    own: dict[str, Any] = {"id": term.mechanism.id}
    match term.mechanism:
        case ExternalForce(intervals=intervals):
            own["intervals"] = [list(i) for i in intervals]
        case Pulses(clock=clock, origin=origin, cycles=cycles):
            own |= {"pulses": clock, "origin": origin, "cycles": cycles}
        case Rhythm(clock=clock):
            own["clock"] = clock
        case Formula() as law:
            own |= _formula_json(law)
        case Peak(signal=signal, unit=unit, even=even, odd=odd, wide=wide):
            own |= {"signal": signal, "unit": unit, "even": even, "odd": odd, "wide": wide}
        case Bend(signal=signal, seen=seen, turns=turns):
            own |= {"bends": signal, "seen": list(seen), "turns": turns}
        case Arm(place=place, signal=signal, unit=unit, length=length, by=by, form=form):
            own |= {"arm": place, "of": signal, "unit": unit, "length": length, "by": by, "form": form}
        case Eased(by=by, signal=signal, form=form, unit=unit, of=of):
            own |= {"eased": by, "carries": signal, "form": form, "unit": unit, "of": of}
        case Resonant(by=by, signal=signal, form=form, unit=unit, of=of, even=even, ends=ends, flat=flat):
            own |= {"resonant": by, "carries": signal, "form": form, "unit": unit, "of": of, "even": even}
            own |= {"ends": list(ends), "flat": flat}
        case ByTool(tools=tools, law=law):
            own |= {"tools": list(tools)} | _formula_json(law)
        case Wave(place=place, length=length, signal=signal, unit=unit, harmonics=harmonics, form=form):
            own |= {"waves": place, "length": length, "signal": signal, "unit": unit, "harmonics": harmonics}
            own |= {"form": form}
        case RingingAlong(signal=signal, unit=unit, place=place, length=length, middle=middle, reach=reach):
            own |= {"rings": signal, "unit": unit, "along": place, "length": length, "middle": middle, "reach": reach}
        case Ringing(signal=signal, unit=unit):
            own |= {"rings": signal, "unit": unit}
        case Lagged(signal=signal, form=form, unit=unit, by_cut=by_cut, level=level):
            own |= {"lags": signal, "form": form, "unit": unit, "by_cut": by_cut, "level": level}
        case Fading(signal=signal, form=form, unit=unit, only=only):
            own |= {"fades": signal, "form": form, "unit": unit, "only": only}
        case Modulated(signal=signal, form=form, cause=cause, loss=loss, unit=unit, beside=beside, level=level):
            own |= {"modulates": signal, "form": form, "cause": cause, "loss": loss, "unit": unit}
            own |= {"beside": beside, "level": level}
        case EasedLately(cause=cause, signal=signal, form=form, unit=unit, of=of):
            own |= {"eased_lately": cause, "carries": signal, "form": form, "unit": unit, "of": of}
        case LaggedArm(signal=signal, form=form, unit=unit, place=place, length=length):
            own |= {"lags": signal, "form": form, "unit": unit, "along": place, "length": length}
        case Warped(place=place, length=length, cause=cause, loss=loss, unit=unit):
            own |= {"warps": place, "length": length, "cause": cause, "loss": loss, "unit": unit}
        case Rested(axis=axis, unit=unit):
            own |= {"rested": axis, "unit": unit}
        case Latched(signal=signal, unit=unit, even=even):
            own |= {"latched": signal, "unit": unit, "even": even}
        case Switched(signal=signal, unit=unit, even=even, carried=carried, carried_unit=of_it, form=form):
            own |= {"switched": signal, "unit": unit, "even": even}
            own |= {"carried": carried, "carried_unit": of_it, "form": form}
        case Patch(places=places, signal=signal, unit=unit, form=form):
            own |= {"patch": list(places), "carries": signal, "unit": unit, "form": form}
        case Transient(signal=signal, unit=unit, side=side, even=even, level=level, rings=rings):
            own |= {"after": signal, "unit": unit, "side": side, "even": even, "level": level, "ringing": rings}
        case Surface(variables=variables, knots=knots, split=split):
            own |= {"variables": list(variables), "knots": [list(k) for k in knots], "split": list(split)}
        case _:
            pass
    return {
        "name": term.name,
        "mechanism": own,
        "shape": dict(term.shape),
        "gates": [
            {
                "variable": g.variable,
                "low": g.low if np.isfinite(g.low) else None,
                "high": g.high if np.isfinite(g.high) else None,
            }
            for g in term.gates
        ],
        "amplitudes": [float(a) for a in amplitudes],
        "lag": term.lag,
        "lags": term.loop.lags,
    }


def _term(data: Mapping[str, Any]) -> Term:
    gates = tuple(
        Gate(
            g["variable"],
            -np.inf if g["low"] is None else float(g["low"]),
            np.inf if g["high"] is None else float(g["high"]),
        )
        for g in data["gates"]
    )
    loop = Loop(float(data.get("lag", 0.0)), int(data.get("lags", 1)))
    return Term(_mechanism(data["mechanism"]), tuple(data["shape"].items()), gates, data["name"], loop)


def _formula(own: Mapping[str, Any]) -> Formula:
    seen = tuple((float(low), float(high)) for low, high in own.get("seen", []))
    return Formula(tuple((str(s), str(f)) for s, f in own["factors"]), str(own["unit"]), seen)


def _mechanism(own: Mapping[str, Any]) -> Mechanism:
    if "intervals" in own:
        return ExternalForce(tuple((str(p), float(a), float(b)) for p, a, b in own["intervals"]))
    if "pulses" in own:
        return Pulses(bool(own["pulses"]), float(own["origin"]), float(own["cycles"]))
    if "clock" in own:
        return Rhythm(bool(own["clock"]))
    if "tools" in own:
        law: dict[str, Any] = {k: v for k, v in own.items() if k != "tools"}
        if "carries" in own:  # models of before have one quantity
            factor = (str(own["carries"]), str(own["form"]))
            law = {"factors": [factor], "unit": unit_of([(str(own["unit"]), factor[1])])}
        return ByTool(tuple(map(str, own["tools"])), _formula(law))
    if "factors" in own:
        return _formula(own)
    if "arm" in own:
        later = (str(own.get(k, other)) for k, other in (("length", "mm"), ("by", "u"), ("form", "u")))
        return Arm(str(own["arm"]), str(own["of"]), str(own["unit"]), *later)
    if "resonant" in own:
        by, signal, form, unit, of = (str(own[k]) for k in ("resonant", "carries", "form", "unit", "of"))
        low, high = map(float, own["ends"])
        return Resonant(by, signal, form, unit, of, bool(own["even"]), (low, high), bool(own["flat"]))
    if "eased" in own:
        return Eased(*(str(own[k]) for k in ("eased", "carries", "form", "unit", "of")))
    if "eased_lately" in own:
        return EasedLately(*(str(own[k]) for k in ("eased_lately", "carries", "form", "unit", "of")))
    if "waves" in own:
        place = str(own["waves"])
        length = str(own.get("length", "deg" if place == "pos_sp" else "mm"))  # models of before do not have
        carrier = (str(own["signal"]), str(own["unit"]))
        return Wave(place, length, *carrier, int(own.get("harmonics", 1)), str(own.get("form", "u")))
    if "signal" in own:
        flags = (bool(own.get(flag)) for flag in ("odd", "wide"))  # models of before do not have
        return Peak(str(own["signal"]), str(own["unit"]), bool(own["even"]), *flags)
    if "bends" in own:
        seen = (float(own["seen"][0]), float(own["seen"][1]))
        return Bend(str(own["bends"]), seen, str(own.get("turns", "")))  # models of before do not turn
    if "rings" in own:
        said = (str(own["rings"]), str(own["unit"]))
        if "along" not in own:
            return Ringing(*said)
        return RingingAlong(*said, str(own["along"]), str(own["length"]), float(own["middle"]), float(own["reach"]))
    if "lags" in own and "along" in own:
        return LaggedArm(*(str(own[n]) for n in ("lags", "form", "unit", "along", "length")))
    if "lags" in own:
        level = bool(own.get("level"))  # models of before do not have
        return Lagged(str(own["lags"]), str(own["form"]), str(own["unit"]), bool(own["by_cut"]), level)
    if "fades" in own:
        only = own.get("only", "moving" if own.get("in_motion") else "")  # models of before say whether in motion alone
        return Fading(str(own["fades"]), str(own["form"]), str(own["unit"]), str(only))
    if "modulates" in own:
        said = (str(own[n]) for n in ("modulates", "form", "cause", "loss", "unit", "beside"))
        return Modulated(*said, level=str(own.get("level", "")))
    if "warps" in own:
        return Warped(*(str(own[n]) for n in ("warps", "length", "cause", "loss", "unit")))
    if "rested" in own:
        return Rested(str(own["rested"]), str(own["unit"]))
    if "latched" in own:
        return Latched(str(own["latched"]), str(own["unit"]), bool(own["even"]))
    if "switched" in own:
        carried = (str(own[k]) for k in ("carried", "carried_unit", "form"))
        return Switched(str(own["switched"]), str(own["unit"]), bool(own["even"]), *carried)
    if "patch" in own:
        one, other = map(str, own["patch"])
        return Patch((one, other), *(str(own[k]) for k in ("carries", "unit", "form")))
    if "after" in own:
        flags = (bool(own[flag]) for flag in ("even", "level", "ringing"))
        return Transient(str(own["after"]), str(own["unit"]), str(own["side"]), *flags)
    if "heats" in own:  # a model of before
        form, loss, unit = (str(own.get(n, d)) for n, d in (("form", "u"), ("loss", "u²"), ("unit", "(A)·(A)^2")))
        return Modulated(str(own["heats"]), form, str(own["heats"]), loss, unit)
    if "variables" in own:
        knots = tuple(tuple(float(k) for k in ks) for ks in own["knots"])
        return Surface(tuple(own["variables"]), knots, tuple(bool(s) for s in own["split"]))
    found = next((m for m in CATALOGUE if m.id == own["id"]), None)
    if found is None:
        raise DiagnosisError(
            f"mechanism '{own['id']}' is not in the catalogue of this version. Run 'pido diagnose' again."
        )
    return found
