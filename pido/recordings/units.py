"""Units that slipped: a column that is a known factor away from what the others say.

In:  a Recording, and the machine where known. Out: faults, each naming the factor and the unit that it points to.

Speed is compared with the derivative of position, acceleration with that of speed, over the samples that move, inside
stretches. The factor is the median ratio; the same factor on every speed is time's. Currents have no such partner: they
are compared with the drive's limit.
"""

from __future__ import annotations

import numpy as np

from pido.core.arrays import Float1D
from pido.core.axes import AXES, LINEAR_AXES
from pido.core.columns import ACCELERATION, CURRENT, POSITION, TIME, UNITS, VELOCITY
from pido.core.machining import Machine
from pido.core.recording import Recording
from pido.recordings.derive import derivative
from pido.recordings.faults import ERROR, Fault, whole
from pido.recordings.segments import counter_resets, starts, unwrap_deg

_LINEAR = {
    60.0: "mm/min",
    1e-3: "m/s",
    0.06: "m/min",
    1e3: "µm/s",
    1 / 25.4: "inch/s",
    60.0 / 25.4: "inch/min",
}
_LENGTH = {1e-3: "m", 1 / 25.4: "inch", 1e3: "µm", 0.1: "cm"}
_ANGULAR = {1 / 6.0: "1/min", 1 / 360.0: "1/s", np.pi / 180.0: "rad/s", 60.0: "deg/min", 1 / 60.0: "deg/min²"}
_LINEAR_A = {
    1e-3: "m/s²",
    1e-3 / 9.80665: "g",
    60.0: "mm/s per min",
    3600.0: "mm/min²",
    1e3: "µm/s²",
    1 / 25.4: "inch/s²",
}
_ANGULAR_A = {np.pi / 180.0: "rad/s²", 1 / 360.0: "1/s²", 1 / 6.0: "1/min per s"}
_TIME = {1e-3: "ms", 1e-6: "µs", 1e3: "ks", 1 / 60.0: "samples or another clock"}


def unit_slips(recording: Recording, machine: Machine | None) -> list[Fault]:
    """Columns that are a factor off, in one list; a slip of time is named once, not once per axis."""
    ratios = {a: r for a in AXES if (r := _speed_ratio(recording, a)) is not None}
    faults: list[Fault] = []
    linear = [ratios[a] for a in LINEAR_AXES if a in ratios]
    # Of one axis alone, its acceleration has to say the same: a speed in another unit is that far away from its change.
    changes = [r for a in LINEAR_AXES if a in ratios and (r := _acceleration_ratio(recording, a)) is not None]
    told = linear + changes if len(linear) == 1 else linear
    # v / (dp/dt) is the unit of v, or the reciprocal of time's: ms instead of s make dp/dt a thousandth.
    common = _known(float(np.median(linear)), {1 / k: u for k, u in _TIME.items()}) if len(told) > 1 else None
    if common and max(told) / min(told) < 1.1 and common[1] in {"ms", "µs"}:
        what = f"all speeds are {np.median(linear):.4g} times the derivative of their position."
        advice = f"Time looks like {common[1]}; it must be in s. Convert it and ingest again."
        return [whole("unit_slip", TIME, what, advice, ERROR)]
    for axis, ratio in ratios.items():
        table = _LINEAR if axis in LINEAR_AXES else _ANGULAR
        other = _acceleration_ratio(recording, axis)
        position = _known(1 / ratio, _LENGTH) if axis in LINEAR_AXES else None
        # A thousandfold v over dp/dt is v in µm/s or the position in m; where a agrees with v, the position is wrong.
        if position is not None and other is not None and abs(other - 1) < 0.1:
            faults.append(_fault(POSITION[axis], 1 / ratio, "what its speed adds up to", position[1]))
        elif (found := _known(ratio, table)) is not None:
            faults.append(_fault(VELOCITY[axis], ratio, "the derivative of its position", found[1]))
    slipped = {f.column for f in faults}
    for axis in AXES:
        if VELOCITY[axis] in slipped:
            continue
        ratio = _acceleration_ratio(recording, axis)
        table = _LINEAR_A if axis in LINEAR_AXES else _ANGULAR_A
        if ratio is not None and (found := _known(ratio, table)) is not None:
            faults.append(_fault(ACCELERATION[axis], ratio, "the derivative of its speed", found[1]))
    return [*faults, *_beyond_the_machine(recording, machine, slipped)]


def _fault(column: str, ratio: float, of: str, unit: str) -> Fault:
    what = f"'{column}' is {ratio:.4g} times {of}."
    advice = f"It looks like {unit}; it must be in {UNITS[column]}. Convert it and ingest again."
    return whole("unit_slip", column, what, advice, ERROR)


def _known(ratio: float, table: dict[float, str]) -> tuple[float, str] | None:
    """The entry within 8 % of `ratio`."""
    for factor, unit in table.items():
        if abs(ratio / factor - 1) < 0.08:
            return factor, unit
    return None


def _speed_ratio(recording: Recording, axis: str) -> float | None:
    if POSITION[axis] not in recording or VELOCITY[axis] not in recording:
        return None
    position = unwrap_deg(recording[POSITION[axis]]) if axis == "sp" else recording[POSITION[axis]]
    time = recording.time
    begin = starts(time)
    if axis == "sp":
        begin |= counter_resets(position, time)
        known = position[np.isfinite(position)]
        if len(known) and np.ptp(known) <= 360.0 + 1e-6:
            return None  # an angle within one turn: the turns between samples are not known
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
