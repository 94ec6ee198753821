"""How far the values go that a finding was fitted on, and what of another part lies beyond them.

In:  a term, or the columns of an equation, on the diagnosed parts; or the model of a diagnosis and the recording of a
     part that is corrected by it.
Out: the range of each quantity that the term is a law of; the part's rows outside of it; a pause before the part that
     is longer than any that a drift was fitted on. A law is known where it was seen: what it says beyond is
     extrapolated, however well it holds within.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from pido.core.arrays import Bool1D, Float1D
from pido.core.columns import FORCE_SIM
from pido.core.recording import Recording
from pido.diagnosis.answers import equation_text
from pido.diagnosis.correct import without_currents
from pido.diagnosis.gates import PATH_SPEED, inside
from pido.diagnosis.models import axis_models, readable
from pido.diagnosis.pair import pair_of
from pido.diagnosis.quantities import QUANTITIES, the
from pido.diagnosis.signals import signals
from pido.diagnosis.state import AxisState, axis_states, running
from pido.diagnosis.terms import Term

_NO_RANGE = ("held_", "speeding_", "braking_", "coolant", "pos_sp", "t_go_", "stood_", "rested_", "t_block", "t_cut")
"""Signs, switches, an angle of which every turn is like the other, times that count no further than a few seconds."""
_SIGNALS = {**{c: f"f_{a}" for a, c in FORCE_SIM.items()}, "m_sp_sim": "M_sp", "mrr_sim": "MRR"}
"""What columns are called that are signals under another name."""
_MARGIN = 0.05
"""Of a range, by which a value has to leave it: its ends are those of samples, not of what the machine does."""
_SOME = 1e-3
"""Of the rows of a part, that lie beyond at least: fewer are wild samples."""


_CLEARLY_LONGER = 1.5
"""Times the longest pause, above which one is longer than what was seen."""
_SHORT_S = 60.0
"""A pause in which nothing cools."""


@dataclass(frozen=True)
class Beyond:
    """What of a part lies outside of what a finding was fitted on.

    signal : that does; low, high : what it was fitted on, in the signal's unit; share : of the part's rows where the
    finding acts, 0 to 1; least, most : of the signal in this part
    """

    axis: str
    mechanism: str
    signal: str
    low: float
    high: float
    share: float
    least: float
    most: float

    def __str__(self) -> str:
        unit = QUANTITIES[self.signal].unit
        ends = " and ".join(f"{v:.4g} {unit}" for v in (self.least, self.most) if not self._within(v))
        return (
            f"{self.axis}: {self.mechanism} was fitted on {the(self.signal)} from {self.low:.4g} to {self.high:.4g} "
            f"{unit}; {_percent(self.share)} of the rows lie beyond, as far as {ends}. What it corrects there is "
            "extrapolated."
        )

    def _within(self, value: float) -> bool:
        return self.low <= value <= self.high


def ranges(term: Term, states: Sequence[AxisState], usable: Bool1D) -> dict[str, tuple[float, float]]:
    """Least and greatest value, by signal and in its unit, of what a term is a law of, where it was fitted.

    usable : (n,), bool – rows of all parts, one after another, that may be fitted
    """
    names, found, at = _names(term, states[0].axis), {}, 0
    for state in states:
        there = usable[at : at + len(state.time)] & (inside(state, term.gates) > 0)
        at += len(state.time)
        if there.any():
            for name, values in _known(state, names).items():
                low, high = found.get(name, (np.inf, -np.inf))
                found[name] = (min(low, float(values[there].min())), max(high, float(values[there].max())))
    return found


def ranges_of_columns(
    parts: Sequence[Recording], columns: Sequence[str], usable: Bool1D
) -> dict[str, tuple[float, float]]:
    """The same of columns of the recordings, for an equation of them in place of a simulation."""
    every = {
        name: np.concatenate([np.asarray(p[name], float) for p in parts])[usable]
        for name in columns
        if all(name in p for p in parts)
    }
    return {n: (float(np.nanmin(v)), float(np.nanmax(v))) for n, v in every.items() if np.isfinite(v).any()}


def beyond(model: Mapping[str, Any], recording: Recording) -> list[Beyond]:
    """What of a part lies outside of what each finding was fitted on; nothing for a model that does not keep that.

    Raises DiagnosisError for a model that this version does not know.
    """
    pair = pair_of(model)
    without = without_currents(recording if pair is None else pair.of(recording))
    with readable():
        bands = {axis: float(band) for axis, band in model.get("dead_bands", {}).items()}
    out = []
    for axis, own in axis_models(model).items():
        for column, (low, high) in ({} if own.equation is None else own.equation.seen).items():
            if column in without and (found := _outside(np.asarray(without[column], float), low, high)) is not None:
                out.append(Beyond(axis, "the equation", _SIGNALS.get(column, column), low, high, *found))
        if not any(own.seen):
            continue
        (state,) = axis_states([without], axis, bands=bands)
        for term, seen in zip(own.terms, own.seen, strict=True):
            there, known = inside(state, term.gates) > 0, _known(state, seen)
            for name, (low, high) in seen.items():
                if name in known and (found := _outside(known[name][there], low, high)) is not None:
                    out.append(Beyond(axis, term.name, name, low, high, *found))
    return out


def longer_pauses(
    model: Mapping[str, Any], recording: Recording, earlier: Sequence[Recording] = ()
) -> dict[str, tuple[float, float]]:
    """Per axis that drifts with what the machine did before: the pause before this part and the longest that the drift
    was fitted on, s, where this one is clearly longer. Machines seldom cool as they warm.

    earlier : parts made after the diagnosed ones and before this one
    """
    axes = [
        axis
        for axis, own in axis_models(model).items()
        if any(t.mechanism.id == "thermal_drift" and round(dict(t.shape)["clock"]) > 0 for t in own.terms)
    ]
    with readable():
        known = sorted((float(a), float(b)) for a, b in model.get("history", []))
    this = running(recording)
    before = [*known, *(run for r in earlier if (run := running(r)) is not None)]
    ends = [end for start, end in before if this is not None and start < this[0]]
    if not axes or this is None or not ends or recording.part.part in model.get("parts", ()):
        return {}
    pause, longest = this[0] - max(ends), max((b - a for (_, a), (b, _) in pairwise(known)), default=0.0)
    return dict.fromkeys(axes, (pause, longest)) if pause > _CLEARLY_LONGER * max(longest, _SHORT_S) else {}


def _outside(values: Float1D, low: float, high: float) -> tuple[float, float, float] | None:
    """Share beyond, least and greatest value; None where what lies beyond is next to nothing."""
    margin = _MARGIN * (high - low)
    share = float(np.mean((values < low - margin) | (values > high + margin))) if len(values) else 0.0
    return None if share < _SOME else (share, float(np.nanmin(values)), float(np.nanmax(values)))


def _names(term: Term, axis: str) -> list[str]:
    """Signals that a term is a law of, and those that confine it."""
    law = term.mechanism
    names = {g.variable.strip("|").replace(PATH_SPEED, "feed") for g in term.gates} | law.reads
    if not law.reads:
        text = equation_text(term, axis)
        names |= {name for name in QUANTITIES if re.search(rf"(?<![\w.]){name}(?!\w)", text)}
        names |= {f"f_{axis}"} if law.id == "cutting_force" else set()
        names |= {f"I_{axis}"} if re.search(r"\bI(_sim)?\b", text.partition("=")[2]) else set()
    return sorted(n for n in names if n in QUANTITIES and not n.startswith(_NO_RANGE))


def _known(state: AxisState, names: Sequence[str] | Mapping[str, Any]) -> dict[str, Float1D]:
    """Those of the signals that a part gives, (n,) each."""
    every = signals(state) if names else {}
    return {name: every[name][0] for name in names if name in every}


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.02 else f"{100 * share:.1g} %"
