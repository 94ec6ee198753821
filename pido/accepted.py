"""Accepted physics: findings of a diagnosis that extend the physical equation of a machine, until they are revoked.

In:  a folder that `pido diagnose` wrote, who accepts which finding, and why.
Out: the journal `registry/<machine>-physics.jsonl` of a workspace (append-only; each line one version), and what is in
     force as terms that the equations, and PiA and PiE with them, are fitted with.

Rows to learn from know the 13 inputs and the direction of each axis' last motion, and generated rows nothing else. A
finding that needs more (a position, a clock, the way since a reversal) is refused with its reason: it stays a
correction (`pido correct`), because no row could be generated for it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pido import config
from pido.core.arrays import Float2D
from pido.core.axes import AXES, LINEAR_AXES
from pido.core.clock import utc_now
from pido.core.columns import INPUTS
from pido.core.errors import DiagnosisError, RegistryError
from pido.core.machining import Machine
from pido.core.samples import Samples
from pido.equations.span import made_of, reach
from pido.equations.terms import ADAPTIVE, HELD, PAPER, TermSet
from pido.physics_journal import Entry, in_force, journal, write
from pido.tracking.promotion import check_person
from pido.workspace import Workspace

if TYPE_CHECKING:
    from pido.diagnosis.state import AxisState
    from pido.diagnosis.terms import Term

# The finder is imported where it is used: a machine without accepted physics, a monitor above all, starts without it.

INSTANT = (
    "coulomb_friction", "viscous_friction", "stribeck_friction", "standstill_friction", "friction_asymmetry",
    "load_dependent_friction", "inertia", "gravity_load", "axis_coupling", "cutting_force", "spindle_viscous_drag",
    "spindle_windage", "spindle_inertia", "spindle_torque_load",
)  # fmt: skip
"""Mechanisms that follow from the 13 inputs and the held directions of one row alone."""
NEEDS = {
    "position_dependent_friction": "the place along the travel",
    "torque_ripple": "the place along the travel",
    "material_hard_zone": "the place on the workpiece",
    "presliding_hysteresis": "the way since the last reversal and the friction state before it",
    "backlash": "the way or time since the last reversal",
    "edge_force": "the engaged length of edge (a_p of the NC block)",
    "tool_wear": "what the cutting edge has cut before",
    "coolant_load": "whether coolant is on",
    "thermal_drift": "how long the machine has been running",
    "external_force": "the time at which it was seen, in the parts it was seen in",
    "current_saturation": "the current that your simulation gives",
    "unknown": "a formula or curve without a name, which holds only over what it was fitted on",
}
"""Mechanisms that do not, and what they need beside them."""
_DIAGNOSIS = "diagnosis.json"
_AT = {name: k for k, name in enumerate(INPUTS)}


@dataclass(frozen=True)
class AcceptedTerm:
    """A finding as a term of the equation (`pido.equations.terms.ExtraTerm`).

    axis : whose equation it extends; bands : per axis in the order of AXES, mm/s (deg/s): below, an axis stands still
    reach : per column, what the machine can reach of it
    found : per column, A at that reach: the amplitude that it was found with
    """

    name: str
    axis: str
    term: Term
    bands: tuple[float, ...]
    reach: tuple[float, ...] = (1.0,)
    found: tuple[float, ...] = (0.0,)

    def columns(self, samples: Samples) -> Float2D:
        """(n, k): what the finding's amplitudes multiply, over the machine's reach; the fit finds these anew."""
        return self.term.of_part(_state(samples, self.axis, self.bands)).T / np.asarray(self.reach)


def accept(workspace: Workspace, machine: str, folder: Path, finding: str | int, *, by: str, reason: str) -> Entry:
    """Accept a finding, for the iterations that follow.

    finding : its name ('x:stribeck_friction'), or its number from 1, as in diagnosis.json; by number not where the next
        parts' diagnosis takes the place of the one that was read

    Raises DiagnosisError for a finding that is not there or cannot extend an equation, for physics that the equation
    has already, of itself or by what is in force (the same finding too), and for a diagnosis of another machine;
    RegistryError without a name and a reason, or without the credential that approval asks for: it decides what the
    next models learn from.
    """
    check_person(workspace, by, reason)
    if isinstance(finding, int) and folder.resolve().parent == workspace.diagnosis(machine).resolve().parent:
        raise DiagnosisError(
            f"{folder}: is written anew with the next parts, and finding {finding} may be another one by then. Say "
            "which by axis and mechanism: --finding x:stribeck_friction."
        )
    term, about, digest = _finding(folder, finding, machine)
    id = hashlib.sha256(json.dumps([about["axis"], term], sort_keys=True).encode()).hexdigest()[:8]
    with workspace.lock(machine):
        entries = journal(workspace, machine)
        _not_there_yet(workspace, machine, about, term)
        entry = Entry(
            len(entries) + 1, "accept", id, about["axis"], about["mechanism"], by, reason, utc_now(), term,
            about["equation"], digest,
        )  # fmt: skip
        write(workspace, machine, [*entries, entry])
    return entry


def acceptable(workspace: Workspace, machine: str, folder: Path) -> list[str]:
    """Names of the findings of a diagnosis that `accept` would take now, in its order.

    Raises DiagnosisError where no diagnosis can be read.
    """
    names = dict.fromkeys(name_of(finding) for finding in _findings(folder))
    return [name for name in names if not _refusal(workspace, machine, folder, name)]


def offers(
    findings: Iterable[tuple[str, str, str]], model: Mapping[str, Any], machine: Machine | None = None
) -> list[tuple[str, str]]:
    """Findings as (axis, mechanism, kind), each by the name by which it would be accepted, and why it would not be, ''
    where it would: as far as a diagnosis says it, for a workspace that has accepted nothing yet. Faults of the data
    are left out.

    machine : whose equation; None: a usual one, which has the same terms
    """
    known = machine or config.machine(config.shipped("machines")[0])
    result = []
    for axis, mechanism, kind in dict.fromkeys(findings):
        about = {"axis": axis, "mechanism": mechanism, "kind": kind}
        own = _terms_of(about, model)
        if kind != "data_fault":
            why = _no_row_has_it(own) or _made_already(about, own[0], HELD, known)
            result.append((name_of(about), why))
    return result


def _refusal(workspace: Workspace, machine: str, folder: Path, finding: str) -> str:
    """Why a finding cannot be accepted, '' where it can."""
    try:
        term, about, _ = _finding(folder, finding, machine)
        _not_there_yet(workspace, machine, about, term)
    except DiagnosisError as error:
        return str(error)
    return ""


def revoke(workspace: Workspace, machine: str, id: str, *, by: str, reason: str) -> Entry:
    """Take a finding out of force. RegistryError lists what is in force where `id` is not; and as of `accept`."""
    check_person(workspace, by, reason)
    with workspace.lock(machine):
        entries = journal(workspace, machine)
        now = in_force(entries)
        found = next((e for e in now if e.id == id), None)
        if found is None:
            known = ", ".join(f"{e.id} ({e.axis} {e.mechanism})" for e in now) or "nothing"
            raise RegistryError(f"machine '{machine}': '{id}' is not in force; in force: {known}.")
        entry = replace(found, version=len(entries) + 1, action="revoke", by=by, reason=reason, at=utc_now(), more={})
        write(workspace, machine, [*entries, entry])
    return entry


def terms(workspace: Workspace, machine: Machine) -> tuple[tuple[AcceptedTerm, int], ...]:
    """What is in force, as terms with their number of columns."""
    now = in_force(journal(workspace, machine.id))
    return tuple(as_term(e.term_name, e.axis, e.term, machine) for e in now)


def as_term(name: str, axis: str, term: Mapping[str, Any], machine: Machine) -> tuple[AcceptedTerm, int]:
    """A term of model.json as a term of the equation, and its number of columns."""
    from pido.diagnosis.models import axis_models

    bands = tuple(machine.dead_band(a) for a in AXES)
    alone = {"noise_level": 0.0, "delay": [0.0, 0.0], "limits": {}, "equation": None, "terms": [term]}
    model = axis_models({"axes": {axis: alone}})[axis]
    read = model.terms[0].at_once()  # rows of samples do not follow one another
    everywhere = AcceptedTerm(name, axis, replace(read, gates=()), bands)  # a box has no part in how large it can be
    most = reach(everywhere, machine)
    # what the user's simulation has in another size is known as the difference to that, of which rows know nothing
    known = model.amplitudes[0] * most * (read.name == read.mechanism.id)
    return replace(everywhere, term=read, reach=tuple(most), found=tuple(known)), len(most)


def term_sets(accepted: Sequence[tuple[AcceptedTerm, int]], adaptive: bool) -> tuple[TermSet, ...]:
    """The shipped equations (as printed: the paper's alone), each with all accepted physics in it."""
    if not accepted:
        return ()
    sets = ADAPTIVE if adaptive else (PAPER,)
    for term, size in accepted:
        sets = tuple(s.extended(term, size) for s in sets)
    return sets


def name_of(finding: Mapping[str, Any]) -> str:
    """What a finding of diagnosis.json is called where one has to be chosen."""
    return f"{finding['axis']}:{finding['mechanism']}"


def _findings(folder: Path) -> list[dict[str, Any]]:
    path = folder / _DIAGNOSIS
    try:
        return json.loads(path.read_text(encoding="utf-8"))["findings"]
    except (OSError, ValueError, KeyError):
        raise DiagnosisError(
            f"{path}: no diagnosis can be read there. Run 'pido diagnose PART ... --out DIR'."
        ) from None


def _finding(folder: Path, which: str | int, machine: str) -> tuple[dict[str, Any], dict[str, Any], str]:
    """Term, finding and digest of the model behind it."""
    from pido.diagnosis.contract import read_model
    from pido.diagnosis.models import axis_models
    from pido.diagnosis.pair import pair_of

    path, findings = folder / _DIAGNOSIS, _findings(folder)
    names = [name_of(f) for f in findings]
    if which not in (names if isinstance(which, str) else range(1, len(names) + 1)):
        known = ", ".join(f"{k} {name}" for k, name in enumerate(names, start=1)) or "none"
        raise DiagnosisError(f"{path}: there is no finding {which}. There are: {known}.")
    number = which if isinstance(which, int) else names.index(which) + 1
    about = findings[number - 1]
    name = f"{about['axis']} {about['mechanism']}"
    if about["kind"] == "data_fault":
        raise DiagnosisError(f"{path}: {name} is a fault of the data, no physics. Put the recording right instead.")
    model = read_model(folder)
    if model.get("machine", machine) != machine:
        raise DiagnosisError(
            f"{path}: a diagnosis of machine '{model['machine']}', not of '{machine}': what one machine lacks is no "
            "reason to change the equation of another. Diagnose parts of this one."
        )
    if pair_of(model) is not None:
        raise DiagnosisError(
            f"{path}: a diagnosis of the pair {model['pair']}, not of the currents that the equation is about."
        )
    axis_models(model)  # what this version does not know is said here, not in the next iteration
    own = _terms_of(about, model)
    why = _no_row_has_it(own)
    if why:
        raise DiagnosisError(f"{path}: {name} {why}")
    return own[0], about, hashlib.sha256((folder / "model.json").read_bytes()).hexdigest()


def _terms_of(about: Mapping[str, Any], model: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The terms of model.json that a finding is."""
    terms = model.get("axes", {}).get(about["axis"], {}).get("terms", [])
    return [t for t in terms if t["name"] == about["mechanism"]]


def _no_row_has_it(own: Sequence[Mapping[str, Any]]) -> str:
    """Why the terms of a finding are no term of an equation over rows, '' where they are one."""
    id = own[0]["mechanism"]["id"] if own else ""
    if id not in INSTANT:
        ends = "intervals" in own[0]["mechanism"] if own else False  # a force over times that will not come again
        use = "Nor does it predict any other part." if ends else "Apply it as a correction: pido correct."
        needs = NEEDS.get(id, "more than one row says (a place, a time, what was before)")
        return (
            f"cannot extend the equation: it follows from {needs}, and a generated row has nothing but the 13 inputs "
            f"and the direction of motion. {use}"
        )
    if len(own) > 1:
        return (
            f"stands there {len(own)} times, and nothing says which of them is meant. Apply all of them as a "
            "correction: pido correct."
        )
    return ""


def _made_already(about: Mapping[str, Any], term: Mapping[str, Any], equation: TermSet, machine: Machine) -> str:
    """Why there is nothing to accept, where the equation has the term by those that it is made of; else ''."""
    made = made_of(as_term(name_of(about), about["axis"], term, machine)[0], equation, machine)
    if not made:
        return ""
    return (
        f"is in the equation already, by {', '.join(made)}. Each iteration fits its size anew: there is nothing to "
        "accept. Where your own simulation has it wrong, correct that: pido correct."
    )


def _not_there_yet(workspace: Workspace, machine: str, about: Mapping[str, Any], term: Mapping[str, Any]) -> None:
    """DiagnosisError for what the equation of this axis has already: by what is in force, or by terms of its own."""
    from pido.parts import machine_of

    axis = about["axis"]
    name = f"{axis} {about['mechanism']}"
    now = [e for e in in_force(journal(workspace, machine)) if e.axis == axis]
    twin = next((e for e in now if _law(e.term) == _law(term)), None)
    if twin is not None and twin.term == term:
        raise DiagnosisError(
            f"machine '{machine}': {name} is in force already, as {twin.id}: this very finding was accepted by "
            f"{twin.by} on {twin.at[:10]}. Nothing was changed."
        )
    if twin is not None:
        raise DiagnosisError(
            f"machine '{machine}': {name} is in force already, as {twin.id} ({twin.equation}), and the same physics "
            "twice would share one effect out. Where the new finding is the better one, first take the old one out: "
            f"pido accept-physics --revoke {twin.id} --by NAME --reason TEXT --workspace {workspace.root}"
        )
    known = machine_of(workspace, machine)
    equation = HELD if workspace.settings.method.adaptive else PAPER
    for own, size in terms(workspace, known):
        equation = equation.extended(own, size) if own.axis == axis else equation
    why = _made_already(about, term, equation, known)
    if why:
        raise DiagnosisError(f"machine '{machine}': {name} {why}")


def _law(term: Mapping[str, Any]) -> tuple[str, float, str]:
    """What two findings of the same physics have in common: the mechanism, the box that it acts in, and, of a coupling,
    what it is coupled to."""
    return term["mechanism"]["id"], term["shape"].get("source", 0.0), json.dumps(term.get("gates", []), sort_keys=True)


def _state(samples: Samples, axis: str, bands: Sequence[float]) -> AxisState:
    """The state of one axis as far as rows know it; rows stand for themselves, in no order."""
    from pido.diagnosis.state import AxisState, Motion

    n, get = len(samples), {name: samples.inputs[:, k] for name, k in _AT.items()}
    far = np.full(n, np.inf)
    motions = {
        a: Motion.with_band(get[f"v_{a}"], get[f"a_{a}"], samples.direction[:, k], bands[k]) for k, a in enumerate(AXES)
    }
    own = motions.pop(axis)
    forces = {a: get[f"f_{a}_sim"] for a in LINEAR_AXES}
    return AxisState(
        axis=axis, part="", time=np.arange(n, dtype=float), dt=0.0, pos=None, v=own.v, a=own.a, held=own.held,
        moving=own.moving, along=own.along, since_reversal=far, since_reversal_s=far, segment=np.zeros(n),
        others=motions,
        force=forces.get(axis), forces=forces, force_perp=np.sqrt(sum(f**2 for a, f in forces.items() if a != axis)),
        m_sp=get["m_sp_sim"], mrr=get["mrr_sim"], ar=samples.ar, engaged=get["mrr_sim"] > 0,
        usable=np.ones(n, bool),
    )  # fmt: skip
