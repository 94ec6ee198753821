"""What is wrong with the data rather than the simulation, as findings: faulty inputs, clipping, a shift in time.

In:  recordings, and what `pido.diagnosis.faults` and `pido.diagnosis.timing` saw in them.
Out: `Finding` values of kind data_fault, and the rows that no fit may use.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from scipy import stats

from pido.core.arrays import Bool1D, Float1D
from pido.core.axes import AXES
from pido.core.columns import CURRENT, CURRENT_SIM
from pido.core.recording import Recording
from pido.diagnosis.confirm import paired_p
from pido.diagnosis.faults import DISPLACED, clipping, faulty, input_faults
from pido.diagnosis.finding import Estimate, Evidence, FaultySignal, Finding, HeldOut, Interval, Where
from pido.diagnosis.locate import lasting
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.state import AxisState
from pido.diagnosis.timing import Delay, Step, shift_target
from pido.diagnosis.timing_told import (
    advice_of,
    equation_of,
    late_in_words,
    listed,
    parameters_of,
    said_of,
    scheme_of,
)

_MERGE_S = 0.5
_NEAR_STEP_S = 0.3  # of a step in time, within which signals that jump jump with it


def input_findings(
    parts: Sequence[Recording], axes: Sequence[str], delays: Collection[Delay] = (), notes: list[str] | None = None
) -> list[Finding]:
    """One finding per axis whose position, speed or acceleration is wrong somewhere.

    axes : whose currents are compared, at least one
    delays : whose steps in time are told by themselves: where samples are missing, positions jump, and no sensor is
        wrong; notes : takes what is said of that
    """
    by_axis: dict[str, list[FaultySignal]] = {}
    jumped: dict[str, list[str]] = {}
    for recording in parts:
        for column, faults in input_faults(recording).items():
            axis = next(a for a in sorted(AXES, key=len, reverse=True) if column.endswith(f"_{a}"))
            steps = [s for d in delays for s in d.steps if parts[s.part] is recording]
            kept = [f for f in faults if not any(_at(f.t_start, s) for s in steps)]
            if len(kept) < len(faults):
                jumped.setdefault(recording.part.part, []).append(column)
            by_axis.setdefault(axis, []).extend(
                FaultySignal(recording.part.part, column, *lasting(recording.time, f.t_start, f.t_end), f.reason)
                for f in kept
            )
    if notes is not None:
        notes += [
            f"part {part}: {', '.join(columns)} jump where its time jumps against the simulation. Samples are "
            "missing, or stand there twice, in all columns; that is no fault of its own"
            for part, columns in jumped.items()
        ]
    out = []
    for axis, faults in ((a, f) for a, f in by_axis.items() if f):
        columns = sorted({f.column for f in faults})
        reasons = sorted({f.reason for f in faults})
        intervals = [
            each
            for part in dict.fromkeys(f.part for f in faults)
            for each in _merged(part, [(f.t_start, f.t_end) for f in faults if f.part == part])
        ]
        first = intervals[0]
        done = "these rows are set aside"
        if DISPLACED in reasons:
            done = "rows of a displaced position are used without it, all others are set aside"
        named = listed(columns)
        where = Where(
            f"{named} {'are' if len(columns) > 1 else 'is'} wrong in {len(intervals)} "
            f"place{'s' if len(intervals) > 1 else ''}, first in part {first.part} at "
            f"{first.t_start:.2f} s: {'; '.join(reasons)}; {done}",
            tuple(columns),
            tuple(intervals),
            faults=tuple(faults),
        )
        out.append(
            Finding(
                axis=axis,
                mechanism="input_fault",
                kind="data_fault",
                equation=f"{', '.join(columns)} not usable over these intervals",
                parameters={},
                where=where,
                evidence=Evidence(0.0, 0.0, 0.0),  # a contradiction: neither chance nor a model of it
                fit=_without(parts, axis, axis if axis in axes else axes[0]),
            )
        )
    return out


def _at(time: float, step: Step) -> bool:
    """Whether a fault that begins at a time, s, begins where a step may be."""
    return step.times[0] - _NEAR_STEP_S <= time <= step.times[1] + _NEAR_STEP_S


def _without(parts: Sequence[Recording], axis: str, judged: str) -> HeldOut:
    """Errors of the simulation of `judged` on all rows, and without those in which an input of `axis` is faulty; of the
    mean where nothing is simulated. Nothing is fitted: p is that of the fault, whose signals contradict each other.
    """
    curr = np.concatenate([r[CURRENT[judged]] for r in parts])
    simulated = all(CURRENT_SIM[judged] in r for r in parts)
    sim = np.concatenate([r[CURRENT_SIM[judged]] for r in parts]) if simulated else np.full(len(curr), np.nanmean(curr))
    good = np.isfinite(curr) & np.isfinite(sim)
    right = good & ~np.concatenate([faulty(r, axis) for r in parts])
    values = []
    for rows in (good, right if right.any() else good):
        error, total = _rms(curr[rows] - sim[rows]), float(np.var(curr[rows]))
        values.append((error, 1 - error**2 / total if total > 0 else 0.0))
    (before, r2_before), (after, r2_after) = values
    scheme = (
        f"nothing fitted: error of {'the simulation' if simulated else 'the mean'} of axis {judged} on all rows, and "
        "without those set aside"
    )
    return HeldOut(scheme, before, after, r2_before, r2_after, 0.0)


Limits = Mapping[str, tuple[float, float]]


def clipped(parts: Sequence[Recording], axis: str) -> Limits:
    """Per part, the limits that the recorded current of `axis` runs into while the simulation goes on."""
    out = {}
    for recording in parts:
        limits = clipping(recording, axis)
        if limits is None or CURRENT_SIM[axis] not in recording:
            continue
        current, sim = recording[CURRENT[axis]], recording[CURRENT_SIM[axis]]
        # A coarse converter repeats its largest value as well, which the simulation exceeds by what was rounded.
        rounded = float(np.median(np.diff(np.unique(current[np.isfinite(current)])))) / 2
        low = limits[0] if _exceeds(-sim, current <= limits[0], rounded - limits[0]) else -np.inf
        high = limits[1] if _exceeds(sim, current >= limits[1], rounded + limits[1]) else np.inf
        if np.isfinite(low) or np.isfinite(high):
            out[recording.part.part] = (float(low), float(high))
    return out


def _exceeds(values: Float1D, rows: Bool1D, level: float) -> bool:
    return bool(rows.any()) and float(np.nanmean(values[rows])) > level


def at_limit(recording: Recording, axis: str, limits: Limits) -> Bool1D:
    """(n,) – rows in which the recorded current stands at a limit."""
    current = recording[CURRENT[axis]]
    low, high = limits.get(recording.part.part, (-np.inf, np.inf))
    return (current <= low) | (current >= high)


def clipping_finding(parts: Sequence[Recording], axis: str, limits: Limits, noise: float) -> Finding:
    """The limit as a finding; its proof is how far the simulation goes beyond it there."""
    intervals, before, after, recorded = [], [], [], []
    for recording in parts:
        current, sim = recording[CURRENT[axis]], recording[CURRENT_SIM[axis]]
        rows = at_limit(recording, axis, limits)
        intervals += _runs(recording, rows)
        before.append((current - sim)[np.isfinite(current - sim)])
        after.append(
            (current - np.clip(sim, *limits.get(recording.part.part, (-np.inf, np.inf))))[np.isfinite(current - sim)]
        )
        recorded.append(current[np.isfinite(current - sim)])
    b, a, c = np.concatenate(before), np.concatenate(after), np.concatenate(recorded)
    gain = float(np.sum(b**2 - a**2)) / max(noise, 1e-9) ** 2
    total = float(np.var(c)) or 1.0
    finite = {}
    for k, name in enumerate(("lowest", "highest")):
        values = np.array([v[k] for v in limits.values() if np.isfinite(v[k])])
        if len(values):
            finite[name] = Estimate(float(np.median(values)), "A", (float(values.min()), float(values.max())))
    p = float(stats.chi2.sf(max(gain, 0.0), 1))
    return Finding(
        axis=axis,
        mechanism="sensor_clipping",
        kind="data_fault",
        equation=f"curr_{axis} = min(max(I, lowest), highest)",
        parameters=finite,
        where=Where(
            f"wherever the current of {axis} reaches {' or '.join(f'{e.value:.4g} A' for e in finite.values())}",
            tuple(f"curr_{axis} {'<=' if n == 'lowest' else '>='} {e.value:.4g}" for n, e in finite.items()),
            tuple(intervals),
        ),
        evidence=Evidence(p, p, gain),
        fit=HeldOut(
            "limits read from the record, nothing fitted",
            _rms(b),
            _rms(a),
            1 - _rms(b) ** 2 / total,
            1 - _rms(a) ** 2 / total,
            p,
        ),
    )


def timing_finding(delay: Delay, axes: Mapping[str, Mismatch]) -> Finding:
    """The shift of all these axes as one finding, on the axis that shows it best."""
    axis = max(delay.by_axis, key=lambda a: delay.by_axis[a])
    m = axes[axis]
    moved = shift_target(m, delay)
    rows = moved.usable
    recorded = (m.target + m.sim)[rows] if m.sim is not None else m.target[rows]
    total = float(np.var(recorded)) or 1.0
    before, after = m.target[rows], moved.target[rows]
    others = ", ".join(a for a in delay.axes if a != axis)
    p = float(stats.chi2.sf(delay.gain, 1 + delay.form.numbers))
    return Finding(
        axis=axis,
        mechanism="time_misalignment",
        kind="data_fault",
        equation=equation_of(delay, axis),
        parameters=parameters_of(delay, m.parts),
        where=Where(
            f"at every change of current: the recording comes {late_in_words(delay, m.parts)}"
            + (f", on {others} as well" if others else ""),
            (),
            tuple(_out_of_time(delay, k, s) for k, s in enumerate(m.states) if k in delay.late),
        ),
        evidence=Evidence(p, p, delay.gain),
        fit=HeldOut(
            scheme_of(delay, m.parts) + ", for all axes" * (len(axes) > 1),
            _rms(before),
            _rms(after),
            1 - _rms(before) ** 2 / total,
            1 - _rms(after) ** 2 / total,
            paired_p(m.target**2 - moved.target**2, m, rows),
        ),
        said=said_of(delay, m.parts, m.states[0].dt),
        to_record=advice_of(delay, m.parts, m.states[0].dt),
    )


def _out_of_time(delay: Delay, part: int, state: AxisState) -> Interval:
    """The whole part, or from its first step on where it is in time before."""
    steps = [s.time for s in delay.steps if s.part == part]
    from_start = delay.offsets[part] or delay.drift or not steps
    return Interval(state.part, float(state.time[0]) if from_start else steps[0], float(state.time[-1]), 1.0)


def _merged(part: str, spans: Sequence[tuple[float, float]]) -> list[Interval]:
    out: list[tuple[float, float]] = []
    for start, end in sorted(spans):
        if out and start <= out[-1][1] + _MERGE_S:
            out[-1] = out[-1][0], max(out[-1][1], end)
        else:
            out.append((start, end))
    return [Interval(part, start, end, 1.0) for start, end in out]


def _runs(recording: Recording, rows: Bool1D) -> list[Interval]:
    edges = np.flatnonzero(np.diff(np.r_[False, rows, False].astype(np.int8)))
    time = recording.time
    spans = [lasting(time, float(time[i]), float(time[j - 1])) for i, j in zip(edges[::2], edges[1::2], strict=True)]
    return _merged(recording.part.part, spans)


def _rms(x) -> float:
    return float(np.sqrt(np.mean(x**2))) if len(x) else float("nan")
