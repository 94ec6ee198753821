"""What can be compared at all: parts in order, axes with a recorded and a simulated current, and how far they reach.

In:  recordings as they were read.
Out: parts in production order; axes to judge; a note for everything that is left out or can only be half answered.
An axis that cannot be judged is left out with its reason, so that the others get their answer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pido.core.arrays import Bool1D
from pido.core.axes import AXES
from pido.core.columns import CURRENT, CURRENT_SIM, POSITION, TIME, UNITS, VELOCITY
from pido.core.errors import DiagnosisError
from pido.core.machining import Machine
from pido.core.recording import Recording
from pido.core.wild import wild_samples
from pido.diagnosis.bands import dead_bands
from pido.diagnosis.belongs import of_another
from pido.diagnosis.consistency import runs
from pido.diagnosis.faults import beyond_load, extreme_loads
from pido.diagnosis.state import motion

LEAST_ROWS = 500
"""Samples of a part, and samples of an axis that have both currents, below which nothing is concluded."""
SHORT_S = 60.0
"""Of motion of an axis in all parts, s: less shows only strong effects."""
_WHOLE = 0.98  # share of the recorded samples that a simulation covers: a smaller one is said
_PLACES = 3  # that a note names
_LEAST_RUN = 20  # samples in a row with both currents: shorter ones are two rates laid over each other


def in_order(recordings: Sequence[Recording], notes: list[str]) -> list[Recording]:
    """The parts in production order, each once, of one machine; what is infinite is missing.

    Raises DiagnosisError with what is wrong.
    """
    if not recordings:
        raise DiagnosisError("no part was given. Name at least one part folder or recording.")
    names = [r.part.part for r in recordings]
    double = sorted({n for n in names if names.count(n) > 1})
    if double:
        raise DiagnosisError(f"part {', '.join(double)} was given more than once. Give each part once.")
    machines = sorted({r.part.machine for r in recordings})
    if len(machines) > 1:
        raise DiagnosisError(
            f"parts of {len(machines)} machines: {', '.join(machines)}. Diagnose one machine at a time."
        )
    for r in recordings:
        if len(r) < LEAST_ROWS:
            raise DiagnosisError(
                f"part {r.part.part}: {len(r)} samples; at least {LEAST_ROWS} are needed. Leave this part out."
            )
        if missing := int(np.sum(~np.isfinite(r.time))):
            raise DiagnosisError(f"part {r.part.part}: 'time' is missing in {missing} sample(s). Cut these rows out.")
        if not np.all(np.diff(r.time) > 0):
            raise DiagnosisError(f"part {r.part.part}: 'time' does not increase. Put the samples in order first.")
    far = float("inf")
    parts = sorted(recordings, key=lambda r: (_or(r.part.order, far), _or(r.part.start_time_s, far)))
    return [finite(r, notes) for r in parts]


def finite(recording: Recording, notes: list[str]) -> Recording:
    """The part with what is infinite missing, and a note that names the columns. Time is left as it is."""
    endless = {
        name: ~np.isfinite(values) & ~np.isnan(values)
        for name, values in recording.columns.items()
        if values.dtype != object and name != TIME
    }
    columns = {name: np.where(rows, np.nan, recording[name]) for name, rows in endless.items() if rows.any()}
    if not columns:
        return recording
    notes.append(f"part {recording.part.part}: infinite values of {', '.join(columns)} are taken as missing.")
    return recording.with_columns(**columns)


def without_empty(parts: Sequence[Recording], notes: list[str]) -> list[Recording]:
    """The parts without simulated currents that have no value in any of them: those count as not recorded."""
    names = [n for n in CURRENT_SIM.values() if any(n in r for r in parts)]
    empty = [n for n in names if not any(n in r and np.isfinite(r[n]).any() for r in parts)]
    if not empty:
        return list(parts)
    notes.append(f"{', '.join(empty)}: without any value in any part, and taken as not recorded.")
    return [replace(r, columns={n: v for n, v in r.columns.items() if n not in empty}) for r in parts]


def without_wild(parts: Sequence[Recording], notes: list[str]) -> list[Recording]:
    """The parts without the samples of a current that no motor drew: they are missing, and a note says which."""
    out = list(parts)
    for axis, name in ((a, n) for a in AXES for n in (CURRENT[a], CURRENT_SIM[a])):
        for k, rows in enumerate(wild_samples(parts, name)):
            if not rows.any():
                continue
            wrong = parts[k][name][rows]
            which = f"1 sample of '{name}' is" if len(wrong) == 1 else f"{len(wrong)} samples of '{name}' are"
            out[k] = out[k].with_columns(**{name: np.where(rows, np.nan, parts[k][name])})
            notes.append(
                f"part {parts[k].part.part}, axis {axis}: {which} set aside ({_places(parts[k], rows)}): "
                f"{wrong[np.argmax(np.abs(wrong))]:.4g} at most, for an instant, many times the range of all others, "
                "and nothing else stands out there. Check the channel, or what wrote the file."
            )
    return out


def comparable_axes(parts: Sequence[Recording], machine: Machine | None, notes: list[str]) -> list[str]:
    """Axes that every part recorded and simulated (or none simulated). Raises DiagnosisError where there is none."""
    axes, reasons = [], []
    bands = dead_bands(parts, machine)
    for axis in AXES:
        if not any(CURRENT[axis] in r and np.isfinite(r[CURRENT[axis]]).any() for r in parts):
            continue
        reason = _no_current(parts, axis) or _no_overlap(parts, axis, notes) or _nothing_to_explain_it(parts, axis)
        if reason is None and all(CURRENT_SIM[axis] in r for r in parts):
            reason = of_another(parts, axis)
        if reason is None:
            axes.append(axis)
            notes += _little_motion(axis, moving_s(parts, axis, bands))
        else:
            reasons.append(f"axis {axis} is left out: {reason}")
    simulated = [a for a in axes if CURRENT_SIM[a] in parts[0]]
    if simulated and len(simulated) < len(axes):
        own = ", ".join(a for a in axes if a not in simulated)
        notes.append(f"axis {own}: no simulated current; compared with the physical equation fitted on these parts.")
    if not axes:
        raise DiagnosisError(
            "nothing can be compared: "
            + ("; ".join(reasons) or "no part has a recorded current (curr_x, curr_y, curr_z, curr_sp).")
        )
    notes += [*reasons, *_beyond_load(parts)]
    return axes


def moving_s(parts: Sequence[Recording], axis: str, bands: Mapping[str, float]) -> float | None:
    """How long the axis moves in all parts together, s; None where neither its speed nor what tells it is recorded.

    bands : per axis the speed below which it stands, in its column's unit
    """
    found = [(m, r) for r in parts if (m := motion(r, axis, bands)) is not None]
    return sum(float(np.mean(m.moving) * (r.time[-1] - r.time[0])) for m, r in found) if found else None


def _beyond_load(parts: Sequence[Recording]) -> list[str]:
    notes = []
    for r in parts:
        rows = beyond_load(r)
        if not rows.any():
            continue
        loads = [
            f"{name} reaches {load.largest:.4g} {UNITS[name]}, {load.largest / load.usual:.0f} times what 99 % of its "
            "loaded samples stay below"
            for name, load in extreme_loads(r).items()
        ]
        notes.append(
            f"part {r.part.part}: {rows.sum()} samples with an extreme simulated load are left out "
            f"({_places(r, rows)}): {'; '.join(loads)}. Either the tool plunges there with its whole end, and the load "
            "is real, or the simulation drives a rapid through material: check the simulation there."
        )
    return notes


def _places(recording: Recording, rows: Bool1D) -> str:
    """Where rows are: the first stretches in time, and the NC blocks that they begin in."""
    found = runs(rows)
    text = ", ".join(f"{recording.time[i]:.2f} to {recording.time[j]:.2f} s" for i, j in found[:_PLACES])
    more = f" and {len(found) - _PLACES} more" if len(found) > _PLACES else ""
    line = np.asarray(recording["nc_line"], float) if "nc_line" in recording else np.full(len(rows), np.nan)
    blocks = ", ".join(dict.fromkeys(f"{line[i]:.0f}" for i, _ in found[:_PLACES] if np.isfinite(line[i])))
    return f"{text}{more}{f', NC block {blocks}' if blocks else ''}"


def _no_current(parts: Sequence[Recording], axis: str) -> str | None:
    name = CURRENT[axis]
    without = [r.part.part for r in parts if name not in r or not np.isfinite(r[name]).any()]
    if without:
        return f"no '{name}' in {', '.join(without)}. Leave these parts out to judge it."
    still = [r for r in parts if np.ptp(r[name][np.isfinite(r[name])]) == 0]
    if still:
        return (
            f"'{name}' is constant ({np.nanmax(still[0][name]):g}) throughout {', '.join(r.part.part for r in still)}: "
            "nothing was measured there. Check the channel, or leave these parts out."
        )
    return None


def _no_overlap(parts: Sequence[Recording], axis: str, notes: list[str]) -> str | None:
    """Why recorded and simulated current cannot be compared; a note where they can only in part of the samples."""
    name = CURRENT_SIM[axis]
    without = [r.part.part for r in parts if name not in r]
    if len(without) == len(parts):
        return None  # the equation takes its place
    if without:
        return f"no '{name}' in {', '.join(without)}, but in other parts. Give it in all parts or in none."
    for r in parts:
        recorded, simulated = np.isfinite(r[CURRENT[axis]]), np.isfinite(r[name])
        both = recorded & simulated
        if not both.any():
            return (
                f"in part {r.part.part}, recording and simulation do not overlap in time. Align them first, or leave "
                "this part out."
            )
        if _longest(both) < _LEAST_RUN:
            return (
                f"in part {r.part.part}, no {_LEAST_RUN} samples in a row have both '{CURRENT[axis]}' and '{name}', as "
                "where one has a lower rate. Bring both to one rate."
            )
        if both.sum() < LEAST_ROWS:
            return (
                f"in part {r.part.part}, recording and simulation overlap in {both.sum()} samples; at least "
                f"{LEAST_ROWS} are needed. Align them first, or leave this part out."
            )
        if both.sum() < _WHOLE * recorded.sum():
            share = both.sum() / recorded.sum()
            notes.append(f"axis {axis}: the simulation covers {share:.0%} of part {r.part.part}; only that is judged.")
    return None


def _nothing_to_explain_it(parts: Sequence[Recording], axis: str) -> str | None:
    """Whether any signal beside the currents varies in all parts."""
    currents = {*CURRENT.values(), *CURRENT_SIM.values(), "time"}
    for r in parts:
        if not any(_varies(values) for name, values in r.columns.items() if name not in currents):
            return (
                f"in part {r.part.part}, no other signal varies (positions, speeds, process quantities), so nothing "
                "could say where a difference comes from. Record at least the motion of the axis."
            )
    return None


def _little_motion(axis: str, seconds: float | None) -> list[str]:
    if seconds is None:
        return [
            f"axis {axis}: neither '{VELOCITY[axis]}' nor a '{POSITION[axis]}' that tells its speed was recorded; what "
            "depends on its own motion (friction, inertia) cannot be judged."
        ]
    if seconds == 0:
        return [f"axis {axis}: it never moves; what depends on its own motion (friction, inertia) cannot be judged."]
    if seconds < SHORT_S:
        return [
            f"axis {axis}: it moves for {seconds:.3g} s in all parts together; less than a minute shows only strong "
            "effects."
        ]
    return []


def _varies(values) -> bool:
    if values.dtype == object:
        return False
    known = values[np.isfinite(values)]
    return len(known) > 0 and float(np.ptp(known)) > 0


def _longest(rows: Bool1D) -> int:
    edges = np.flatnonzero(np.diff(np.r_[0, rows.astype(np.int8), 0]))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def _or(value: float | None, default: float) -> float:
    return default if value is None else float(value)
