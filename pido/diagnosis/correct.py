"""The models of a diagnosis, unchanged, on a part that was not diagnosed.

In:  `Diagnosis.model` (plain JSON data) and a recording; its recorded currents are never read.
Out: `PartSeries`: mismatch, score and corrected current per axis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pido.core.arrays import Float1D
from pido.core.axes import AXES
from pido.core.columns import CURRENT
from pido.core.errors import DiagnosisError
from pido.core.recording import Recording
from pido.diagnosis.events import ExternalForce
from pido.diagnosis.finding import PartSeries
from pido.diagnosis.locate import score
from pido.diagnosis.models import AxisModel, axis_models, readable
from pido.diagnosis.pair import pair_of
from pido.diagnosis.sim_rest import with_simulated_rest
from pido.diagnosis.state import AxisState, Worn, axis_states

_REMEMBER = frozenset({"thermal_drift", "tool_wear"})


def correct(model: Mapping[str, Any], recording: Recording, earlier: Sequence[Recording] = ()) -> PartSeries:
    """Simulation plus all findings for one part.

    earlier : parts of the same machine made before this one, oldest first, where their wear or heat is carried on;
        what the diagnosed parts left behind, the model knows itself

    Raises DiagnosisError where a part is given twice, the recording has no simulated current and the model has no
    equation for it, or where it says nothing of an axis in any sample.
    """
    _each_once([recording, *earlier])
    models = axis_models(model)
    with readable():
        worn, diagnosed = _worn(model, recording)
        history = [(float(a), float(b)) for a, b in model.get("history", [])]
        bands = {axis: float(band) for axis, band in model.get("dead_bands", {}).items()}
    earlier = [r for r in earlier if r.part.part not in diagnosed]
    pair = pair_of(model)
    if pair is not None:
        recording, earlier = pair.of(recording), [pair.of(r) for r in earlier]
    without = without_currents(recording)
    mismatch: dict[str, Float1D] = {}
    scores: dict[str, Float1D] = {}
    corrected: dict[str, Float1D] = {}
    for axis, own in models.items():
        states = axis_states([*map(without_currents, earlier), without], axis, bands=bands, worn=worn)
        states = with_simulated_rest(states)
        state = _with_history(states[-1], history)
        mismatch[axis], scores[axis], corrected[axis] = apply(own, without, state)
        if not np.isfinite(corrected[axis]).any():
            raise DiagnosisError(_says_nothing(without, axis))
    if not corrected:
        raise DiagnosisError("the model holds no axis. Run 'pido diagnose' on parts with recorded currents first.")
    return PartSeries(recording.time, mismatch, scores, corrected)


def not_told_of(model: Mapping[str, Any], recording: Recording, earlier: Sequence[Recording] = ()) -> list[int]:
    """Places in the production sequence, before this part, of parts that neither the diagnosis nor `earlier` holds,
    where a finding depends on what they left behind: heat, or wear that the part itself does not state."""
    asked = _asked(model, recording)
    known = [o for o in (*model.get("orders", []), *(r.part.order for r in earlier)) if o is not None]
    own = recording.part.order
    if own is None or not known or not asked:
        return []
    return sorted(set(range(min(known), own)) - set(known))


def not_applied(model: Mapping[str, Any], recording: Recording) -> list[str]:
    """Findings, as 'z: external_force', that are tied to times of the diagnosed parts: of any other part, as this one,
    they say nothing. Where it is diagnosed, they are known for it, and where they are not there, too."""
    part = recording.part.part
    return [
        f"{axis}: {term.name}"
        for axis, own in axis_models(model).items()
        for term in own.terms
        if isinstance(term.mechanism, ExternalForce)
        and part not in {*model.get("parts", []), *(name for name, _, _ in term.mechanism.intervals)}
    ]


def own_shift(model: Mapping[str, Any], recording: Recording) -> dict[str, float]:
    """Per axis, s: the shift in time that a part is corrected by in place of its own, which nobody knows, where the
    diagnosed parts have another one each. It is their mean; where most of them have the same, that is no other one."""
    part = recording.part.part
    return {
        axis: m.delay[0]
        for axis, m in axis_models(model).items()
        if m.late and part not in m.late and 2 * list(m.late.values()).count(m.delay[0]) <= len(m.late)
    }


def wear_not_kept(model: Mapping[str, Any], recording: Recording, earlier: Sequence[Recording] = ()) -> bool:
    """Whether a finding depends on wear that nothing says: the part does not state it, the model is of a version that
    did not keep what its own parts wore off, and not all of these are in `earlier`."""
    if "worn" in model or "tool_wear" not in _asked(model, recording):
        return False
    own, given = recording.part.order, {r.part.order for r in earlier}
    before = [o for o in model.get("orders", []) if own is None or o is None or o < own]
    return not given or any(o is not None and o not in given for o in before)


def without_currents(recording: Recording) -> Recording:
    """The recording as a correction reads it: without its recorded currents."""
    drop = {CURRENT[a] for a in AXES}
    return Recording(recording.part, {k: v for k, v in recording.columns.items() if k not in drop}, recording.notes)


def apply(model: AxisModel, recording: Recording, state: AxisState) -> tuple[Float1D, Float1D, Float1D]:
    """Mismatch, score and corrected current of one axis, (n,) each."""
    simulated = model.simulated(recording, state)
    effect = model.effect(simulated, recording, state)
    return effect, score(effect, model.noise_level), simulated + effect


def _each_once(parts: Sequence[Recording]) -> None:
    names = [r.part.part for r in parts]
    if double := sorted({n for n in names if names.count(n) > 1}):
        raise DiagnosisError(
            f"part {', '.join(double)} was given more than once: what it leaves behind would count twice. Give each "
            "part once, and with --after those made before the one that is corrected."
        )


def _says_nothing(recording: Recording, axis: str) -> str:
    empty = [n for n, v in recording.columns.items() if v.dtype != object and not np.isfinite(v).any()]
    return (
        f"part {recording.part.part}: no sample of axis {axis} can be corrected, because what its current follows from "
        f"is missing ({', '.join(empty) or 'now one column, now another'}). Export the recording again."
    )


def _asked(model: Mapping[str, Any], recording: Recording) -> frozenset[str]:
    """What of earlier parts the findings depend on, as far as the part does not state it itself."""
    asked = _REMEMBER & {t.mechanism.id for m in axis_models(model).values() for t in m.terms}
    tools = recording.part.tools.values()
    stated = tools and all(tool.used_before is not None for tool in tools)
    return asked - {"tool_wear"} if stated else asked


def _worn(model: Mapping[str, Any], recording: Recording) -> tuple[Worn, frozenset[str]]:
    """What the diagnosed parts that were made before this one had worn off, and the parts whose wear is in there or
    comes later; nothing and none in a model of before."""
    if "worn" not in model:
        return {}, frozenset()
    names, part = list(model["parts"]), recording.part
    own, theirs = part.order, model["orders"]
    if own is None:
        own, theirs = part.start_time_s, [start for start, _ in model["history"]]
    later = (i for i, other in enumerate(theirs) if own is not None and other is not None and other > own)
    at = names.index(part.part) if part.part in names else next(later, len(names))
    return {tool: (float(mm3), float(s)) for tool, (mm3, s) in model["worn"][at].items()}, frozenset(names)


def _with_history(state: AxisState, history: Sequence[tuple[float, float]]) -> AxisState:
    """The state with what the diagnosis knew of the machine's running times before this part."""
    if state.clock is None or not history or state.earlier is None:
        return state
    before = {span for span in history if span[1] <= float(state.clock[0]) + 1e-6}
    return replace(state, earlier=tuple(sorted(before | set(state.earlier))))
