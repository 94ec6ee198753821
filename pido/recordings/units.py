"""Units that slipped: a column, or the time, that is a factor away from what the others say.

In:  a Recording, and the machine where known. Out: faults, each naming the factor and the unit that it points to.

Position, speed and acceleration of an axis are tied by time. With T, P, V and A the factors by which time and columns
are off, two ratios can be seen, each the median over the samples that move, inside stretches:

    r_v = v / (dp/dt) = V T / P          r_a = a / (dv/dt) = A T / V

One time holds for all axes, and x, y and z are mostly written in one unit. So explanations are compared as a whole:
time or not, and for each group of axes with the same ratios the positions, the speeds, the accelerations, or speeds and
accelerations in one other unit. The one with the fewest slips that leaves no ratio unexplained is named; where several
are left, those that make a mill of it (its top speed, its rate), or else all. What was derived from another column says
nothing about it. Currents have no such partner: they are compared with the drive's limit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from pido.core.arrays import Float1D
from pido.core.axes import AXES, LINEAR_AXES
from pido.core.columns import ACCELERATION, CURRENT, POSITION, TIME, UNITS, VELOCITY
from pido.core.machining import Machine
from pido.core.recording import Recording
from pido.recordings.derive import derivative, derived
from pido.recordings.faults import ERROR, Fault, whole
from pido.recordings.segments import counter_resets, starts, turns_known, unwrap_deg

_TIME = {1e3: "ms", 1e6: "µs", 1 / 60.0: "minutes", 1 / 3600.0: "hours", 1e-3: "ks"}
_LENGTH = {1e-3: "m", 1 / 25.4: "inch", 1e3: "µm", 0.1: "cm"}
_LINEAR = {
    60.0: "mm/min",
    1e-3: "m/s",
    0.06: "m/min",
    1e3: "µm/s",
    1 / 25.4: "inch/s",
    60.0 / 25.4: "inch/min",
}
_LINEAR_A = {
    1e-3: "m/s²",
    1e-3 / 9.80665: "g",
    60.0: "mm/s per min",
    3600.0: "mm/min²",
    1e3: "µm/s²",
    1 / 25.4: "inch/s²",
}
_ANGLE = {np.pi / 180.0: "rad", 1 / 360.0: "turns"}
_ANGULAR = {1 / 6.0: "1/min", 1 / 360.0: "1/s", np.pi / 180.0: "rad/s", 60.0: "deg/min", 1 / 60.0: "deg/min²"}
_ANGULAR_A = {np.pi / 180.0: "rad/s²", 1 / 360.0: "1/s²", 1 / 6.0: "1/min per s"}
_NEAR = 0.08
"""Ratios this close are the same."""
_UNEXPLAINED = 100.0
_TOP_SPEED = (1.0, 5000.0)  # mm/s, of the fastest axis of any mill
_RATES = (0.5, 20_000.0)  # Hz, of any recorder


@dataclass(frozen=True, slots=True)
class _Seen:
    """One axis' ratios r_v and r_a; None where they cannot be told."""

    axis: str
    speed: float | None
    change: float | None

    def ratios(self) -> list[float]:
        return [r for r in (self.speed, self.change) if r is not None]


@dataclass(frozen=True, slots=True)
class _Slip:
    """Columns that are `factor` times what they should be, as `what` shows; unit : what that factor is, '' if none."""

    columns: tuple[str, ...]
    factor: float
    what: str
    unit: str


_Explanation = tuple[_Slip, ...]


def unit_slips(recording: Recording, machine: Machine | None) -> list[Fault]:
    """Columns that are a factor off; one fault for each slip, or one for all that would explain the same."""
    derived_columns = derived(recording)
    fastest = machine.spindle_max_deg_s if machine else None
    seen = []
    for axis in AXES:
        given = [column not in derived_columns for column in (VELOCITY[axis], ACCELERATION[axis])]
        # A derived speed is in step with its position: an acceleration that was recorded is compared with both.
        speed = _speed_ratio(recording, axis, fastest) if any(given) else None
        change = _acceleration_ratio(recording, axis) if given[1] else None
        seen.append(_Seen(axis, speed, change))
    best = _best([one for one in seen if one.ratios()], recording)
    common = [slip for slip in best[0] if all(slip in other for other in best)] if best else []
    faults = [_named(slip, recording) for slip in common]
    if len(best) > 1:
        faults.append(_either([tuple(s for s in one if s not in common) for one in best]))
    slipped = {name for one in best for slip in one for name in slip.columns}
    return [*faults, *_beyond_the_machine(recording, machine, slipped)]


def _best(seen: Sequence[_Seen], recording: Recording) -> list[_Explanation]:
    """The explanations with the fewest slips; a time in no known unit counts a little more. Empty where all fits."""
    groups = _groups(seen)
    found: list[tuple[float, float, _Explanation]] = []
    for time in (1.0, *_common_factors(seen)):
        slips = [] if time == 1.0 else [_time_slip(time, seen)]
        options = [_least(list(_explained(group, time)), time, recording) for group in groups]
        cost = sum(1.0 if slip.unit else 1.5 for slip in slips) + sum(cost for cost, _ in options)
        if time == 1.0 or cost < _UNEXPLAINED:  # a time explains all ratios or is none
            found += [(cost, time, (*slips, *sum(chosen, ()))) for chosen in product(*(kept for _, kept in options))]
    least = min((cost for cost, _, _ in found), default=0.0)
    equal = [(time, slips) for cost, time, slips in found if cost == least]
    likely = [slips for time, slips in equal if _is_a_mill(time, slips, recording)]
    return list(dict.fromkeys(likely or [slips for _, slips in equal]))


def _least(
    options: list[tuple[float, _Explanation]], time: float, recording: Recording
) -> tuple[float, list[_Explanation]]:
    """(cost, explanations) of those of one group of axes that cost least."""
    cost = min(cost for cost, _ in options)
    equal = [slips for each, slips in options if each == cost]
    return cost, [slips for slips in equal if _is_a_mill(time, slips, recording)] or equal


def _same(a: float, b: float) -> bool:
    return abs(a / b - 1.0) < _NEAR


def _groups(seen: Sequence[_Seen]) -> list[list[_Seen]]:
    """Axes with the same ratios, the spindle by itself."""
    groups: list[list[_Seen]] = []
    for one in seen:
        for group in groups:
            if (one.axis in LINEAR_AXES) == (group[0].axis in LINEAR_AXES) and all(
                a is None or b is None or _same(a, b)
                for other in group
                for a, b in ((one.speed, other.speed), (one.change, other.change))
            ):
                group.append(one)
                break
        else:
            groups.append([one])
    return groups


def _common_factors(seen: Sequence[_Seen]) -> list[float]:
    """What time may be off by: a factor on which two ratios or more agree, and that is not 1.

    If it is that of no unit, a position has to say so as well, and not that time is right: accelerations may all have
    passed one filter, or be those of ramps that last a few samples.
    """
    moved = [one.speed for one in seen if one.speed is not None]
    ratios = np.array([r for one in seen for r in one.ratios()])
    factors: list[float] = []
    for r in ratios:
        alike = ratios[np.abs(ratios / r - 1.0) < _NEAR]
        middle = float(np.median(alike))
        said = _known(middle, _TIME) is not None or any(
            _same(speed, middle) and abs(speed - middle) < abs(speed - 1.0) for speed in moved
        )
        if said and len(alike) > 1 and not _same(middle, 1.0) and not any(_same(middle, f) for f in factors):
            factors.append(middle)
    return factors


def _explained(group: Sequence[_Seen], time: float) -> Iterator[tuple[float, _Explanation]]:
    """(number of slips, slips) that give the ratios of a group of axes once time is right.

    The last one gives none of them, and costs `_UNEXPLAINED`.
    """
    linear = group[0].axis in LINEAR_AXES
    lengths, speeds, changes = (_LENGTH, _LINEAR, _LINEAR_A) if linear else (_ANGLE, _ANGULAR, _ANGULAR_A)
    r_v, with_v = _median({one.axis: one.speed for one in group}, time)
    r_a, with_a = _median({one.axis: one.change for one in group}, time)
    v_off = tuple(VELOCITY[one.axis] for one in group)
    a_off = tuple(ACCELERATION[axis] for axis in with_a)
    v_fits, a_fits = r_v is None or _same(r_v, 1.0), r_a is None or _same(r_a, 1.0)
    if v_fits and a_fits:
        yield 0.0, ()
        return
    if r_a is not None and v_fits and (unit := _known(r_a, changes)):
        yield 1.0, (_Slip(a_off, r_a, "the derivative of its speed|the derivatives of their speeds", unit),)
    if r_v is None:
        V, of = 1 / (r_a or 1.0), "what its acceleration adds up to|what their accelerations add up to"
    else:
        V, of = r_v, "the derivative of its position|the derivatives of their positions"
    if (v_unit := _known(V, speeds)) and (r_a is None or _same(r_a * V, 1.0)):
        yield 1.0, (_Slip(v_off, V, of, v_unit),)
    if r_v is not None and not v_fits:
        position = _Slip(
            tuple(POSITION[axis] for axis in with_v),
            1 / r_v,
            "what its speed adds up to|what their speeds add up to",
            _known(1 / r_v, lengths) or "",
        )
        A = r_v * (r_a or 1.0)
        if a_fits and position.unit:
            yield 1.0, (position,)
        if r_a is not None and v_unit and (unit := _known(A, changes)):
            of_a = "the second derivative of its position|the second derivatives of their positions"
            one_unit = _same(A, V) or _same(A, V * V)  # of length, or of time
            yield 1.0 if one_unit else 2.0, (_Slip(v_off, V, of, v_unit), _Slip(a_off, A, of_a, unit))
        if a_fits and len(with_v) > 1:  # no unit, but no recording of a mill either
            yield _UNEXPLAINED, (position,)
    yield _UNEXPLAINED + 1.0, ()


def _median(ratios: dict[str, float | None], time: float) -> tuple[float | None, tuple[str, ...]]:
    """(median of the known ratios with time put right, their axes)."""
    known = {axis: r for axis, r in ratios.items() if r is not None}
    return (float(np.median(list(known.values()))) / time if known else None), tuple(known)


def _time_slip(factor: float, seen: Sequence[_Seen]) -> _Slip:
    ratios = [r for one in seen for r in one.ratios()]
    agree = sum(_same(r, factor) for r in ratios)
    what = f"{agree} of {len(ratios)} comparisons of speeds with positions and accelerations with speeds say so"
    return _Slip((TIME,), factor, what, _known(factor, _TIME) or "")


def _is_a_mill(time: float, slips: _Explanation, recording: Recording) -> bool:
    """Whether the rate, and the top speed of the linear axes concerned, are such as occur once all is put right."""
    by = {name: slip.factor for slip in slips for name in slip.columns}
    tops = [
        float(np.nanmax(np.abs(recording[VELOCITY[axis]]))) / by.get(VELOCITY[axis], 1.0)
        for axis in LINEAR_AXES
        if VELOCITY[axis] in recording
        and np.isfinite(recording[VELOCITY[axis]]).any()
        and by.keys() & {TIME, POSITION[axis], VELOCITY[axis], ACCELERATION[axis]}
    ]
    rate = recording.sample_rate_hz * time
    return _RATES[0] <= rate <= _RATES[1] and (not tops or _TOP_SPEED[0] <= max(tops) <= _TOP_SPEED[1])


def _named(slip: _Slip, recording: Recording) -> Fault:
    column = ", ".join(slip.columns)
    if slip.columns == (TIME,):
        step = 1.0 / recording.sample_rate_hz
        what = f"time goes {slip.factor:.4g} times as fast as it should: {slip.what}."
        if slip.unit:
            advice = f"It looks like {slip.unit}; it must be in s. Convert it and ingest again."
        else:
            advice = (
                "It may count samples, or another clock's ticks; it must be in s. Divide it by that factor (a step of "
                f"{step:.4g} becomes {step / slip.factor:.4g} s) and ingest again."
            )
        return whole("unit_slip", column, what, advice, ERROR)
    one = len(slip.columns) == 1
    of = slip.what.split("|")[0 if one else 1]
    what = f"{_quoted(slip.columns)} {'is' if one else 'are'} {slip.factor:.4g} times {of}."
    must = f"{'it' if one else 'they'} must be in {UNITS[slip.columns[0]]}"
    if slip.unit:
        looks = "It looks" if one else "They look"
        advice = f"{looks} like {slip.unit}; {must}. Convert {'it' if one else 'them'} and ingest again."
    else:
        advice = f"No unit is that factor; {must}, and speeds in mm/s. Correct what is wrong and ingest again."
    return whole("unit_slip", column, what, advice, ERROR)


def _either(several: list[_Explanation]) -> Fault:
    """One fault for explanations that are as good as one another."""
    columns = dict.fromkeys(name for slips in several for slip in slips for name in slip.columns)
    ways = [" and ".join(f"{_quoted(slip.columns)} in {_unit(slip)}" for slip in slips) for slips in several]
    what = f"{_quoted(tuple(columns))} do not fit one another; several units would explain it: {', or '.join(ways)}."
    advice = "Find out which it is, convert that, and ingest again."
    return whole("unit_slip", ", ".join(columns), what, advice, ERROR)


def _unit(slip: _Slip) -> str:
    return slip.unit or f"{slip.factor:.4g} times {UNITS[slip.columns[0]]}"


def _quoted(names: Sequence[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)


def _known(ratio: float, table: dict[float, str]) -> str | None:
    """The entry within 8 % of `ratio`."""
    return next((unit for factor, unit in table.items() if _same(ratio, factor)), None)


def _speed_ratio(recording: Recording, axis: str, spindle_max_deg_s: float | None) -> float | None:
    if POSITION[axis] not in recording or VELOCITY[axis] not in recording:
        return None
    position, time = recording[POSITION[axis]], recording.time
    begin = starts(time)
    if axis == "sp":
        if not turns_known(position, time, spindle_max_deg_s):
            return None
        position = unwrap_deg(position)
        begin |= counter_resets(position, time)
    return _ratio(recording[VELOCITY[axis]], derivative(position, time, begin))


def _acceleration_ratio(recording: Recording, axis: str) -> float | None:
    if VELOCITY[axis] not in recording or ACCELERATION[axis] not in recording:
        return None
    v = recording[VELOCITY[axis]]
    return _ratio(recording[ACCELERATION[axis]], derivative(v, recording.time, starts(recording.time)))


def _ratio(values: Float1D, derived: Float1D) -> float | None:
    """Median of values / derived where the derivative is large; None where the two are not the same signal."""
    size = np.abs(derived)
    known = np.isfinite(values) & np.isfinite(derived)
    if known.sum() < 20 or not (size[known] > 0).any():
        return None
    large = known & (size > 0) & (size >= np.quantile(size[known & (size > 0)], 0.5))
    if large.sum() < 10 or (np.std(derived[large]) == 0 and np.std(values[large]) > 0):
        return None
    ratio = values[large] / derived[large]
    middle = float(np.median(ratio))
    # Two thirds must agree: noise and rounding scatter, another signal does not agree at all.
    if middle <= 0 or np.mean(np.abs(ratio / middle - 1) < 0.3) < 0.6:
        return None
    return middle


def _beyond_the_machine(recording: Recording, machine: Machine | None, slipped: set[str]) -> list[Fault]:
    if machine is None:
        return []
    faults = []
    for axis in AXES:
        column = CURRENT[axis]
        limit = machine.current_max_a.get(axis)
        if column in recording and limit:
            known = np.abs(recording[column][np.isfinite(recording[column])])
            usual = float(np.quantile(known, 0.9)) if len(known) else 0.0
            if usual > 5 * limit:
                what = f"'{column}' is above {usual:.3g} in a tenth of the samples; the drive's limit is {limit:g} A."
                advice = f"It looks like {'mA' if usual < 5000 * limit else 'raw counts'}; it must be in A."
                faults.append(whole("unit_slip", column, what, advice, ERROR))
        column = VELOCITY[axis]
        top = machine.axes[axis].v_max if axis in LINEAR_AXES else machine.spindle_max_deg_s
        if column in recording and column not in slipped:
            often = float(np.nanmean(np.abs(recording[column]) > 1.2 * top))
            if often > 0.2:
                what = f"|{column}| is beyond the machine's {top:g} {UNITS[column]} in {often:.0%} of the samples."
                advice = "Check its unit, and the machine named for this recording."
                faults.append(whole("unit_slip", column, what, advice, ERROR))
    return faults
