"""All that is wrong with a recording, at once, with where it is. Nothing is repaired here.

In:  a Recording, and the machine where it is known (its ranges bound what is possible).
Out: faults; `usable_mask` says which samples are left.

Each check looks at one kind of fault and knows nothing of the others; `CHECKS` is their list.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable

import numpy as np
from scipy.ndimage import binary_dilation, median_filter

from pido.core.arrays import Bool1D, Float1D
from pido.core.axes import AXES, LINEAR_AXES
from pido.core.columns import ACCELERATION, CURRENT, MOTION, POSITION, PROCESS, TIME, UNITS, VELOCITY
from pido.core.machining import Machine
from pido.core.recording import Recording, usual_step
from pido.core.wild import wild_samples
from pido.recordings.faults import ERROR, WARNING, Fault, at, whole
from pido.recordings.missing import missing_values
from pido.recordings.reader import UNKNOWN
from pido.recordings.segments import GAP, counter_resets, is_angle, starts, stretches, unwrap_deg
from pido.recordings.units import unit_slips

Check = Callable[[Recording, Machine | None], list[Fault]]

PLACE = (TIME, *POSITION.values(), "nc_line", "tool_id", "coolant")
"""Columns that stay where a sample cannot be used: the path removes stock all the same."""
SHORTEST = 50
"""Samples below which nothing can be learned: one second at 50 Hz."""
LATEST_START_S = 86_400.0
"""A piece cut out of a recording may keep its time; none is longer than a day."""
V_POSSIBLE = {**dict.fromkeys(LINEAR_AXES, 5_000.0), "sp": 600_000.0}  # mm/s; deg/s (100 000 rpm): of any mill
A_POSSIBLE = {**dict.fromkeys(LINEAR_AXES, 100_000.0), "sp": 1_000_000.0}  # mm/s² (10 g); deg/s²: of any mill


_BY_MOTION = {"shuffled", "position_jump", "impossible_speed", "impossible_acceleration"}
"""Kinds that compare motion with time and with what is possible: where a unit slipped, they say nothing more."""


def check(recording: Recording, machine: Machine | None = None, *, air_cut: bool = True) -> tuple[Fault, ...]:
    """Every fault of the recording, errors first.

    machine : its ranges, where known; without it only what no mill can do is called impossible
    air_cut : whether a recording in which the tool never cuts is welcome (it teaches friction, but nothing of cutting)
    """
    structural = [*_columns(recording), *_length(recording), *_time(recording)]
    faults = [*structural]
    if _has_time_base(recording.time):
        for one in CHECKS:
            faults.extend(one(recording, machine))
        if any(f.kind == "unit_slip" and {TIME, *MOTION} & set(f.column.split(", ")) for f in faults):
            faults = [f for f in faults if f.kind not in _BY_MOTION]
        if not air_cut:
            faults.extend(_engagement(recording))
    return tuple(sorted(faults, key=lambda f: f.severity != ERROR))


def usable_mask(recording: Recording, faults: tuple[Fault, ...]) -> Bool1D:
    """(n,) – samples that no fault leaves out; none where a fault is an error."""
    usable = np.ones(len(recording), bool)
    for fault in faults:
        if fault.severity == ERROR:
            usable[:] = False
        elif fault.mask is not None:
            usable &= ~fault.mask
    return usable


def blanked(recording: Recording, faults: tuple[Fault, ...]) -> Recording:
    """The recording without what its faults leave out: a fault of a current costs that current alone, any other one the
    whole sample, but for the columns in PLACE."""
    currents = {name: tuple(f for f in faults if f.column == name) for name in CURRENT.values()}
    rows = usable_mask(recording, tuple(f for f in faults if f.column not in currents))
    usable = {name: rows & usable_mask(recording, own) for name, own in currents.items()}
    if all(mask.all() for mask in usable.values()):
        return recording
    return recording.with_columns(
        **{
            name: np.where(usable.get(name, rows), values, np.nan)
            for name, values in recording.columns.items()
            if name not in PLACE and values.dtype != object
        }
    )


def _axis_columns(axis: str) -> tuple[str, ...]:
    return (POSITION[axis], VELOCITY[axis], ACCELERATION[axis], CURRENT[axis])


def _columns(recording: Recording) -> list[Fault]:
    faults = []
    present = [axis for axis in AXES if any(c in recording for c in _axis_columns(axis))]
    if not present:
        faults.append(whole("missing_column", "curr_x ... pos_sp", "no axis was recorded.", "Export it again.", ERROR))
    for axis in present:
        for column in _axis_columns(axis):
            if column not in recording and column != POSITION["sp"]:
                what = f"axis {axis} was recorded without it" + (
                    ", and pos_sp, an angle within one turn, does not tell it: the turns between samples are not known."
                    if column in (VELOCITY["sp"], ACCELERATION["sp"])
                    and POSITION["sp"] in recording
                    and is_angle(recording[POSITION["sp"]])
                    else "."
                )
                advice = f"Export the recording again with {column} in {UNITS[column]}, or without the axis."
                faults.append(whole("missing_column", column, what, advice, ERROR))
    for name in recording.columns:
        if name not in UNITS:
            near = _meant(name)
            advice = (f"Did you mean '{near}'? " if near and near not in recording else "") + "Rename or drop it."
            faults.append(whole("unknown_column", name, "the contract has no such column.", advice, ERROR))
    for note in recording.notes:  # columns that are not numbers do not reach the recording
        if note.startswith(UNKNOWN):
            for name in note.removeprefix(UNKNOWN).split(", "):
                if name not in recording.columns:
                    faults.append(
                        whole("unknown_column", name, "the contract has no such column.", "Rename or drop it.", ERROR)
                    )
    return faults


def _meant(name: str) -> str:
    """The column whose name is nearest, '' where none is: f_x is the process force, and no speed.

    >>> _meant("F_X"), _meant("curr_xx"), _meant("temperature")
    ('f_x_sim', 'curr_x', '')
    """
    plain = name.lower()
    same = next((n for n in (plain, f"{plain}_sim") if n in UNITS), None)
    return same or next(iter(difflib.get_close_matches(plain, UNITS, 1)), "")


def _length(recording: Recording) -> list[Fault]:
    n = len(recording)
    if n >= SHORTEST:
        return []
    what = f"{n} samples are too few to learn from (at least {SHORTEST})."
    return [whole("too_short", TIME, what, "Record the whole part.", ERROR)]


def _time(recording: Recording) -> list[Fault]:
    time = recording.time
    faults = []
    known = np.isfinite(time)
    if not known.all():
        row = np.arange(len(time))
        about = np.interp(row, row[known], time[known]) if known.any() else np.zeros(len(time))
        what = f"time is missing, first in row {int(np.argmin(known)) + 1}."
        faults.append(at("time_missing", TIME, ~known, about, what, "Cut these rows out.", ERROR, mask=True))
        return faults
    if len(time) and abs(time[0]) > LATEST_START_S:
        what = f"time begins at {time[0]:.10g} s; it counts from the recording's first sample, and is no clock's."
        advice = "Take the first value off (from the t of tool_changes too), and give it as start_time_s in part.json."
        faults.append(whole("clock_time", TIME, what, advice, ERROR))
    step = np.diff(time)
    back = np.r_[False, step < 0]
    same = np.r_[False, step == 0]
    advice = "Sort it at its source or export it again; rows are never put in order by their time stamps."
    if back.any():
        what = f"time goes backward, by up to {-step.min():.4g} s."
        faults.append(at("time_backward", TIME, back, time, what, advice, ERROR, mask=True))
    if same.any():
        faults.append(at("time_repeated", TIME, same, time, "time stands still.", advice, ERROR, mask=True))
    typical = usual_step(time)
    gap = np.r_[False, step > GAP * typical]
    if gap.any():
        what = f"{int(gap.sum())} gap(s), the longest {step.max():.2f} s at a usual step of {typical:.4g} s."
        advice = "Nothing is filled in or derived across; if the missing samples exist, export them."
        faults.append(at("gap", TIME, gap, time, what, advice, WARNING, mask=False))
    return faults


def _has_time_base(time: Float1D) -> bool:
    """Whether anything along time can be judged: it never goes backward, and stands still in a row or two at most.

    Stamps that were rounded to more than a step repeat everywhere, and what lies between them is not known.
    """
    step = np.diff(time)
    forward = len(time) >= 3 and bool(np.isfinite(time).all() and (step >= 0).all())
    return forward and float(np.mean(step == 0)) <= 0.01


def _outside_the_contract(recording: Recording, machine: Machine | None) -> list[Fault]:
    """Values that a column cannot have by what it means; rounding below zero is none."""
    rules: tuple[tuple[str, Callable[[Float1D], Bool1D], str], ...] = (
        (
            "coolant",
            lambda v: ~np.isin(v, (0.0, 1.0)) & ~np.isnan(v),
            "Write 1 where coolant is on, 0 where it is off.",
        ),
        ("nc_line", np.isinf, "Write the index of the NC block, or leave the cell empty."),
        (
            "mrr_sim",
            lambda v: v < -1e-6 * np.nanmax(np.abs(v), initial=0.0),
            "Simulate again: no removal is below 0.",
        ),
    )
    faults = []
    for name, odd, advice in rules:
        if name not in recording or recording[name].dtype == object or not (bad := odd(recording[name])).any():
            continue
        severity = ERROR if bad.sum() > 0.5 * np.count_nonzero(np.nan_to_num(recording[name])) else WARNING
        what = f"'{name}' is {recording[name][bad][0]:g}, which it cannot be."
        faults.append(at("outside_contract", name, bad, recording.time, what, advice, severity, mask=True))
    return faults


def _constant(recording: Recording, machine: Machine | None) -> list[Fault]:
    """Channels that never change, and currents or positions that stop changing while their axis moves."""
    faults = []
    for axis in AXES:
        moving = _moving(recording, axis, machine)
        for name in (CURRENT[axis], POSITION[axis]):
            if name not in recording:
                continue
            values = recording[name]
            known = values[np.isfinite(values)]
            if name == POSITION["sp"]:
                moving = moving & ~_whole_turns(recording)
            if len(known) and np.ptp(known) == 0:
                if name == POSITION[axis] and not moving.any():
                    continue  # an axis that was not used
                what = f"'{name}' is {known[0]:g} throughout."
                advice = "Check the channel; nothing is learned for this axis."
                faults.append(whole("constant", name, what, advice, WARNING))
                continue
            still = _frozen(recording, name, moving, VELOCITY[axis])
            if still.any():
                what = f"'{name}' does not change while the axis moves."
                advice = "The channel hung: these samples are left out."
                faults.append(at("frozen", name, still, recording.time, what, advice, WARNING, mask=True))
    return faults


def _moving(recording: Recording, axis: str, machine: Machine | None) -> Bool1D:
    if VELOCITY[axis] not in recording:
        return np.zeros(len(recording), bool)
    v = np.abs(recording[VELOCITY[axis]])
    return v > (machine.dead_band(axis) if machine else (0.05 if axis in LINEAR_AXES else 6.0))


def _whole_turns(recording: Recording) -> Bool1D:
    """Where the spindle turns a whole number of times from sample to sample: its angle then stands still, and is right.

    3000 1/min at 50 Hz are such, and an angle that counts from 0 to 360 degrees.
    """
    if VELOCITY["sp"] not in recording:
        return np.zeros(len(recording), bool)
    turns = np.abs(np.nan_to_num(recording[VELOCITY["sp"]])) / recording.sample_rate_hz / 360.0
    return (turns > 0.5) & (np.abs(turns - np.round(turns)) < 0.01)


def _frozen(recording: Recording, name: str, moving: Bool1D, speed: str) -> Bool1D:
    """Runs of one value for half a second and at least 5 samples, while the axis moves.

    A coarse scale repeats values by itself: a position counts only where the axis went on by ten times the third digit
    of its value, a current only where it otherwise changes from one sample to the next.
    """
    values = recording[name]
    same = np.r_[False, values[1:] == values[:-1]] & moving
    is_current = name in CURRENT.values()
    if moving.sum() < 5 or (is_current and same[moving].mean() > 0.5):
        return np.zeros(len(values), bool)
    long = same & (_run_length(same) >= max(5, int(0.5 * recording.sample_rate_hz)))
    if is_current or not long.any():
        return long
    way = np.abs(np.nan_to_num(recording[speed])) / recording.sample_rate_hz
    edges = np.flatnonzero(np.diff(np.r_[0, long.astype(np.int8), 0]))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        third_digit = 10.0 ** (np.floor(np.log10(max(abs(values[first]), 0.1))) - 2)
        if way[first:last].sum() < 10.0 * third_digit:
            long[first:last] = False
    return long


def _run_length(flags: Bool1D) -> Float1D:
    """(n,) – length of the run of True that each sample belongs to, 0 elsewhere."""
    edges = np.flatnonzero(np.diff(np.r_[0, flags.astype(np.int8), 0]))
    length = np.zeros(len(flags))
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        length[a:b] = b - a
    return length


def _impossible(recording: Recording, machine: Machine | None) -> list[Fault]:
    """Speeds and accelerations that the axis cannot have, and what a counter that was set back leaves behind."""
    faults = []
    for axis in AXES:
        spikes = _spikes(recording, axis) if axis == "sp" else np.zeros(len(recording), bool)
        v_max = V_POSSIBLE[axis]
        if machine:
            v_max = 1.2 * (machine.axes[axis].v_max if axis in LINEAR_AXES else machine.spindle_max_deg_s)
        around = spikes.copy()
        if VELOCITY[axis] in recording:
            v = recording[VELOCITY[axis]]
            bad = (np.abs(v) > v_max) & np.isfinite(v) | spikes
            around = np.asarray(
                binary_dilation(bad, iterations=2), dtype=bool
            )  # a was differenced from v, v from the position
            if bad.mean() > 0.2:
                continue  # not single samples: `unit_slips` names the cause
            if bad.any():
                kind = "counter_reset" if axis == "sp" else "impossible_speed"
                worst = float(np.nanmax(np.abs(v[bad])))
                what = f"|{VELOCITY[axis]}| up to {worst:.3g} {UNITS[VELOCITY[axis]]}: no such motion took place."
                advice = (
                    "The counter behind the position was set back; these samples are left out."
                    if axis == "sp"
                    else "These samples are left out; check the unit and the machine's v_max."
                )
                faults.append(at(kind, VELOCITY[axis], bad, recording.time, what, advice, WARNING, mask=True))
        if ACCELERATION[axis] in recording:
            a = np.abs(recording[ACCELERATION[axis]])
            beyond = (a > A_POSSIBLE[axis]) & np.isfinite(a) | around
            if beyond.any() and beyond.mean() <= 0.2:
                kind = "counter_reset" if axis == "sp" and around.any() else "impossible_acceleration"
                worst = float(np.nanmax(a[beyond], initial=0.0))
                what = f"{ACCELERATION[axis]} of up to {worst:.3g} {UNITS[ACCELERATION[axis]]}."
                advice = "No axis of a mill accelerates like that: these samples are left out."
                faults.append(at(kind, ACCELERATION[axis], beyond, recording.time, what, advice, WARNING, mask=True))
    position = POSITION["sp"]
    if position in recording:
        reset = counter_resets(unwrap_deg(recording[position]), recording.time) & ~starts(recording.time)
        if reset.any():
            times = 1 + int((np.diff(recording.time[reset]) > 1.0).sum())
            what = f"the spindle's counter was set to another value {times} time(s)."
            advice = "Nothing is derived across; the samples are kept."
            faults.append(at("counter_reset", position, reset, recording.time, what, advice, WARNING, mask=False))
    return faults


def _spikes(recording: Recording, axis: str) -> Bool1D:
    """(n,) – speed that leaves its running median of half a second and comes back: no spindle does.

    The median follows every ramp, so running up and down is not mistaken for a spike; nor is a missing sample one.
    """
    if VELOCITY[axis] not in recording or not (known := np.isfinite(recording[VELOCITY[axis]])).any():
        return np.zeros(len(recording), bool)
    row = np.arange(len(known))
    v = np.interp(row, row[known], recording[VELOCITY[axis]][known])
    width = int(0.5 * recording.sample_rate_hz) | 1
    limit = max(0.5 * float(np.quantile(np.abs(v), 0.99)), 360.0)
    spikes = np.zeros(len(v), bool)
    for s in stretches(starts(recording.time)):
        if s.stop - s.start > 2 * width >= 10:
            spikes[s] = np.abs(v[s] - median_filter(v[s], width, mode="nearest")) > limit
    return spikes & known


def _clipped(recording: Recording, machine: Machine | None) -> list[Fault]:
    """Currents with a flat top: the extreme value comes in runs, while its neighbourhood is hardly ever reached.

    One that is far from everything else was not measured at all: a program wrote it where it had no value.
    """
    faults = []
    for axis in AXES:
        if CURRENT[axis] not in recording:
            continue
        current = recording[CURRENT[axis]]
        known = current[np.isfinite(current)]
        if len(known) < SHORTEST or np.ptp(known) == 0:
            continue
        flat, held = np.zeros((2, len(current)), bool)
        for extreme in (known.max(), known.min()):
            top = current == extreme
            near = current[(np.abs(current - extreme) <= 0.05 * np.ptp(known)) & ~top]
            beside = int(np.unique(near, return_counts=True)[1].max()) if len(near) else 0
            runs = _run_length(top) >= 3
            # A coarse scale repeats every value; a flat top repeats one. Zero is a drive at rest, not a limit.
            if extreme != 0 and runs.sum() >= 6 and top.sum() > 5 * beside:
                # A current that is cut off comes from just below its limit: it is not ten ranges away from all others.
                rest = known[known != extreme]
                far = np.abs(extreme - rest).min() > 10.0 * np.ptp(rest)
                (held if far else flat)[top] = True
        if held.any():
            value = current[held][0]
            what = f"'{CURRENT[axis]}' is {value:.6g} in {int(held.sum())} samples, far from all others."
            advice = "It looks like a placeholder for what was not measured; leave such cells empty. They are left out."
            severity = ERROR if held.mean() > 0.5 else WARNING
            faults.append(at("placeholder", CURRENT[axis], held, recording.time, what, advice, severity, mask=True))
        if flat.any():
            share = flat.mean()
            what = f"'{CURRENT[axis]}' stops at {np.nanmax(np.abs(current[flat])):.4g} A, a flat top."
            advice = "The measuring range was exceeded: widen it; these samples are left out."
            severity = ERROR if share > 0.5 else WARNING
            faults.append(at("clipped", CURRENT[axis], flat, recording.time, what, advice, severity, mask=True))
    return faults


def _wild(recording: Recording, machine: Machine | None) -> list[Fault]:
    """Currents that leave everything else for an instant, with nothing that would explain it."""
    faults = []
    for name in CURRENT.values():
        (rows,) = wild_samples([recording], name)
        if rows.any():
            wrong = recording[name][rows]
            what = f"'{name}' is up to {wrong[np.argmax(np.abs(wrong))]:.4g} A for an instant, as nothing else."
            advice = "No motor drew it: these samples are left out; check the channel, or what wrote the file."
            faults.append(at("wild_current", name, rows, recording.time, what, advice, WARNING, mask=True))
    return faults


def _order(recording: Recording, machine: Machine | None) -> list[Fault]:
    """Positions that jump against their speeds: rows that are not in the order in which they were taken."""
    time = recording.time
    if len(time) < 3:
        return []
    inside = ~starts(time)[1:]
    step = np.diff(time)
    jump = np.zeros(len(step), bool)
    for axis in LINEAR_AXES:
        p, v = POSITION[axis], VELOCITY[axis]
        if p in recording and v in recording:
            fastest = np.maximum(np.abs(recording[v][1:]), np.abs(recording[v][:-1]))
            way = np.abs(np.diff(recording[p]))
            known = way[np.isfinite(way)]
            scale = float(np.quantile(known, 0.9)) if len(known) else 0.0
            jump |= way > 3.0 * fastest * step + max(10 * scale, 0.5)
    jump &= inside
    if not jump.any():
        return []
    often = jump.mean() > 0.01 and jump.sum() > 10
    what = f"positions jump {int(jump.sum())} time(s) by more than the speeds allow" + (
        ": the rows are not in time order." if often else "."
    )
    advice = (
        "Export the recording in order; every difference and every filter along it would be wrong."
        if often
        else "The samples at the jumps are left out."
    )
    bad = np.r_[False, jump] | np.r_[jump, False]
    kind = "shuffled" if often else "position_jump"
    return [at(kind, "pos_x, pos_y, pos_z", bad, time, what, advice, ERROR if often else WARNING, mask=True)]


def _repeated(recording: Recording, machine: Machine | None) -> list[Fault]:
    names = [n for n in (*MOTION, *CURRENT.values()) if n in recording]
    if not names:
        return []
    moving = np.any([_moving(recording, axis, machine) for axis in AXES], axis=0)
    same = np.r_[False, np.all([recording[n][1:] == recording[n][:-1] for n in names], axis=0)] & moving
    if not same.any():
        return []
    what = "every channel repeats the sample before while the machine moves."
    advice = "A row was written twice; the second is left out."
    return [at("duplicate", "all columns", same, recording.time, what, advice, WARNING, mask=True)]


def _parked(recording: Recording, machine: Machine | None) -> list[Fault]:
    moving = np.any([_moving(recording, axis, machine) for axis in AXES], axis=0)
    length = _run_length(~moving)
    long = length >= 5.0 * recording.sample_rate_hz
    if long.mean() <= 0.2:
        return []
    what = f"the machine stands still in {long.mean():.0%} of the recording, spindle included."
    return [
        at("parked", "v_*", long, recording.time, what, "Kept; it teaches only the standstill.", WARNING, mask=False)
    ]


def _engagement(recording: Recording) -> list[Fault]:
    if "mrr_sim" not in recording or np.nanmax(recording["mrr_sim"], initial=0.0) > 0:
        return []
    loads = [name for name in PROCESS if name in recording and np.nanmax(np.abs(recording[name]), initial=0.0) > 0]
    advice = f"{loads[0]} is not: export both as simulated." if loads else "Check stock, or call it an air cut."
    return [whole("never_engaged", "mrr_sim", "no sample has the tool engaged: it is 0 throughout.", advice, ERROR)]


CHECKS: tuple[Check, ...] = (
    missing_values,
    _outside_the_contract,
    _constant,
    unit_slips,
    _impossible,
    _clipped,
    _wild,
    _order,
    _repeated,
    _parked,
)
