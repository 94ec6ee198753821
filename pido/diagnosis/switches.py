"""Quantities that a law feels as a switch: on or off, however much of them there is. What an operator then reads.

In:  the states of one axis, and from which size of a quantity on a law has nearly its whole effect.
Out: 'while the spindle turns' in place of a law of its speed, or of a limit that lies below its slowest turning.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pido.core.arrays import Bool1D, Float1D
from pido.diagnosis.gates import PATH_SPEED, Gate, gate_variable
from pido.diagnosis.mechanisms.base import Told
from pido.diagnosis.signals import signals
from pido.diagnosis.state import AxisState

_SOME = 0.02  # of all rows, in which a switch is on at least, and off
_RAMPS = 0.1  # of what is on, that may lie on the way up and down
_NOTHING = 0.25  # of the effect while on, or off, that may be left at the other time: there it is none
_CUTS = ("the tool cuts", "the tool does not cut")


def on_and_off(name: str) -> tuple[str, str] | None:
    """What an operator says while a quantity is there and while it is not; None of what is no state of the machine.

    >>> on_and_off("v_sp"), on_and_off("|v_y|"), on_and_off("pos_x")
    (('the spindle turns', 'the spindle stands'), ('the y axis moves', 'the y axis stands'), None)
    """
    name = name.strip("|")
    if name == "v_sp":
        return "the spindle turns", "the spindle stands"
    if name.startswith("v_"):
        return f"the {name[2:]} axis moves", f"the {name[2:]} axis stands"
    if name in ("feed", PATH_SPEED):
        return "the tool moves along its path", "the tool stands"
    if name in ("MRR", "AR", "M_sp") or name.startswith("f_"):
        return _CUTS
    return ("coolant is on", "coolant is off") if name == "coolant" else None


def is_switch(left: Float1D, on: Bool1D) -> bool:
    """Whether a law feels a quantity as a switch, which is now on and now off.

    left : (n,) – share of its effect that a law lacks at each row; on : (n,) – whether the quantity is there
    """
    return bool(_SOME <= np.mean(on) <= 1 - _SOME and np.mean(left[on]) < _RAMPS)


def eased_in(by: str, size: float, states: Sequence[AxisState]) -> bool:
    """Whether exp(-|w| / size) of a quantity w is a switch of it."""
    if on_and_off(by) is None:
        return False
    w = np.abs(np.concatenate([signals(s, [by])[by][0] for s in states]))
    return is_switch(np.exp(-w / size), w > 0)


def told_of_switch(axis: str, carrier: tuple[str, str], by: str, on: float, off: float) -> Told | None:
    """What an operator reads of a friction or a load that has one size while `by` is on and another while it is off.

    carrier : signal and form that it is in proportion to; on, off : its sizes; None of what has no plain word
    """
    what, while_on = _carried(axis, carrier), on_and_off(by)
    if what is None or while_on is None:
        return None
    noun, where, moving = what
    if abs(off) < _NOTHING * abs(on):
        size, when, condition = on, while_on[0], f"{by} != 0"
    elif abs(on) < _NOTHING * abs(off):
        size, when, condition = off, while_on[1], f"{by} = 0"
    else:
        size, when, condition = on - off, while_on[0], ""
    name = f"{'more' if size > 0 else 'less'} {noun} while {when}"
    if not condition:
        name += f", and {'more' if off > 0 else 'less'} than simulated while {while_on[1]}"
    return Told(
        f"{where}: {name}",
        tuple(c for c in (moving, condition) if c),
        name,
        f"the same moves while {while_on[0]} and while {while_on[1]}, 20 s each, and once with all else left off that "
        "is usually switched at the same time: that tells whether it is that itself or what is switched with it",
    )


def gate_words(gate: Gate, states: Sequence[AxisState]) -> str:
    """Where a term acts: 'only where v_x > 4 mm/s', or what of the machine a limit near its slowest motion means."""
    names = on_and_off(gate.variable)
    low, high = np.isfinite(gate.low), np.isfinite(gate.high)
    every = [gate_variable(s, gate.variable) for s in states]
    known = [np.asarray(v, float) for v in every if v is not None]
    if names is None or low == high or len(known) < len(every) or min(v.min() for v in known) < 0:
        return f"only where {gate.words}"  # between two limits, or with a side
    on = np.concatenate([_is_there(s, gate.variable, v) for s, v in zip(states, known, strict=True)])
    limit = gate.low if low else gate.high
    below = np.concatenate(known) < limit
    if limit <= 0 or not is_switch(below.astype(float), on) or np.mean(below[~on]) < 1 - _RAMPS:
        return f"only where {gate.words}"
    return f"only while {names[0] if low else names[1]} ({gate.words})"


def _is_there(state: AxisState, variable: str, values: Float1D) -> Bool1D:
    axis = variable.strip("|").removeprefix("v_")
    if axis == state.axis:
        return state.moving
    if axis in state.others:
        return state.others[axis].moving
    if variable == PATH_SPEED:
        linear = [m.moving for name, m in state.others.items() if name != "sp"]
        linear += [state.moving] if state.axis != "sp" else []
        return np.any(linear, axis=0)
    return values > 0


def _carried(axis: str, carrier: tuple[str, str]) -> tuple[str, str, str] | None:
    """Noun, place and condition of what goes with a signal's form."""
    signal, form = carrier
    in_motion = f"{axis} axis in motion"
    if (signal, form) in ((f"held_{axis}", "u"), (f"v_{axis}", "sgn u")):
        return "friction", in_motion if signal[0] == "v" else f"{axis} axis", f"v_{axis} != 0" * (signal[0] == "v")
    if (signal, form) == (f"v_{axis}", "u"):
        return "friction that grows with speed", in_motion, f"v_{axis} != 0"
    if signal == f"a_{axis}":
        return "inertia", f"while the {axis} axis speeds up or slows down", ""
    if signal.startswith("f_") or signal == "M_sp":
        return "load", f"in proportion to {signal}", ""
    return None
