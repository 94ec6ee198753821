"""Which recording tells two mechanisms apart that the data at hand cannot: pairs of identifiers and a sentence; which
one tells what a force is that nothing recorded drives; and what a law without a name is really a law of.
"""

from __future__ import annotations

_THREE_FEEDS = "an air cut at three feeds, both directions, 40 s"
_SLOW = "an air cut at 0.1, 0.3, 1, 3, 10 and 30 mm/s, both directions, with stops of 2 s, 90 s in all"
_STOPS = "moves of 20 mm in both directions, each followed by a stop of 3 s, ten times"
_TO_AND_FRO = "to and fro moves of 0.05, 0.2 and 1 mm at 1 mm/s, ten of each, with a stop of 1 s after every second one"
_AIR = "the same program as an air cut, 50 mm above the workpiece"
_RAMPS = "moves of 50 mm at one feed with the acceleration limited to 100, 50 and 25 %, five of each"
_DAY = "the same air cut of 60 s at start-up, after an hour of running and after an hour's pause"

_MOVES = "moves of the {a} axis alone in the air at five speeds from {slow} to {fast} mm/s, both directions, 10 s each"
_TRAVEL = (
    "one slow move of the {a} axis over its whole travel at 5 mm/s, both ways, twice, in the air: a friction turns "
    "with the direction, a load does not"
)
_LOADS = "the same path with material, at two depths of cut, and without it"
_SHOWS: tuple[tuple[str, str], ...] = (  # beginnings of signals' names, and what changes that signal and little else
    ("v_sp", "the idling spindle at five speeds from {slow_rpm} to {fast_rpm} rpm, 10 s each, with all axes at rest"),
    ("a_sp", "run-ups of the spindle at two accelerations"),
    (
        "pos_sp",
        "the idling spindle at two speeds, 10 s each: what belongs to its angle comes as often in each turn",
    ),
    ("v_", _MOVES),
    ("feed_rev", "slots at three feeds per revolution with one spindle speed, and at one of them with three speeds"),
    ("feed", "straight moves along x, along y and between the two at three feeds in the air, both directions, 60 s"),
    ("a_n", "circles of 10 and 40 mm radius in the air, each at three feeds, both ways round"),
    ("kappa", "circles of 3, 10 and 40 mm radius in the air at one feed, both ways round"),
    (
        "a_",
        "moves of 50 mm of the {a} axis at one feed with the acceleration limited to 100, 50 and 25 %, five of each",
    ),
    ("j_", "moves of 50 mm of the {a} axis at one feed, the jerk limited to 100, 50 and 25 %, five of each"),
    ("speeding_", "moves of 50 mm of the {a} axis, speeding up hard and slowing down gently, and the other way round"),
    ("braking_", "moves of 50 mm of the {a} axis, speeding up hard and slowing down gently, and the other way round"),
    ("pos_", _TRAVEL),
    (
        "from_",
        "a short program begun at four places of the {a} axis: what belongs to the place does not move along",
    ),
    ("held_", "moves of 20 mm of the {a} axis in both directions, each followed by a stop of 3 s, ten times"),
    ("d_", "to and fro moves of 0.05, 0.2, 1 and 5 mm of the {a} axis at 1 mm/s, ten of each"),
    (
        "way_",
        "the same moves for ten minutes, long rapids and then short ones, and beside it the lubrication pump",
    ),
    ("t_go_", "moves of 5, 20 and 80 mm of the {a} axis, ten of each, with stops of 3 s"),
    ("stood_", "moves of 20 mm of the {a} axis with stops of 1, 3 and 10 s, ten of each"),
    ("rested_", "moves of 20 mm of the {a} axis with stops of 1, 3, 10 and 30 s, five of each"),
    ("t_block", "the same path as one NC block and divided into ten"),
    ("t_cut", "slots of 10, 40 and 160 mm with one depth of cut"),
    ("t_part", _DAY),
    ("uptime", _DAY),
    ("removed", "the same slot at the beginning and at the end of a part, once with a new tool at the end"),
    ("coolant", "an air cut with coolant on and off every 10 s, 60 s"),
    ("I_", "hard accelerations at 100, 50 and 25 %, five of each, and the same slot at two depths of cut"),
    ("f_", _LOADS),
    ("M_sp", _LOADS),
    ("MRR", _LOADS),
    ("AR", _LOADS),
)
SEVERAL = (
    "each motion by itself: moves of one axis at a time at three feeds in the air, both directions, then the same path "
    "with and without material: of the laws that share out what is missing now, each then stands in a recording where "
    "the others do not act"
)
"""Where several laws at once stand for what is missing."""

_UNITS = ("lubrication pump", "hydraulic unit", "chip conveyor")
"""That switch by themselves, and are in no recording."""

_PAIRS: dict[tuple[str, str], str] = {
    ("coulomb_friction", "viscous_friction"): _THREE_FEEDS,
    ("coulomb_friction", "stribeck_friction"): _SLOW,
    ("coulomb_friction", "standstill_friction"): _STOPS,
    ("coulomb_friction", "friction_asymmetry"): "the same move to and fro at three feeds",
    ("coulomb_friction", "presliding_hysteresis"): _TO_AND_FRO,
    ("coulomb_friction", "load_dependent_friction"): _AIR,
    ("stribeck_friction", "standstill_friction"): _SLOW,
    ("stribeck_friction", "presliding_hysteresis"): _TO_AND_FRO,
    ("stribeck_friction", "backlash"): _TO_AND_FRO,
    ("presliding_hysteresis", "backlash"): _TO_AND_FRO,
    ("presliding_hysteresis", "standstill_friction"): _TO_AND_FRO,
    ("backlash", "standstill_friction"): _TO_AND_FRO,
    ("friction_asymmetry", "sensor_offset"): _STOPS,
    ("friction_asymmetry", "gravity_load"): _STOPS,
    ("position_dependent_friction", "torque_ripple"): "one move over the whole travel to and fro at 5 mm/s",
    ("coulomb_friction", "position_dependent_friction"): "one move over the whole travel to and fro at 5 mm/s",
    (
        "position_dependent_friction",
        "thermal_drift",
    ): "the whole travel to and fro at 5 mm/s, three times with a minute between",
    (
        "torque_ripple",
        "external_force",
    ): "one move over the whole travel at 5 and at 10 mm/s: a ripple keeps its period in mm",
    ("external_force", "thermal_drift"): "the same program three times: what is tied to no state does not come back",
    ("external_force", "material_hard_zone"): "the same program on a second workpiece",
    ("coulomb_friction", "axis_coupling"): "moves of one axis at a time, 20 mm at three feeds",
    ("material_hard_zone", "position_dependent_friction"): _AIR,
    ("load_dependent_friction", "edge_force"): "a slot along the axis in both directions at two depths of cut",
    ("current_saturation", "inertia"): "hard accelerations at 100, 50 and 25 %, five of each",
    ("current_saturation", "cutting_force"): "the same slot at 50, 100 and 150 % of the depth of cut",
    ("spindle_torque_load", "spindle_viscous_drag"): _AIR,
    ("spindle_inertia", "spindle_viscous_drag"): "run-ups of the spindle with 10 s at each of five speeds",
    ("spindle_windage", "coulomb_friction"): "the idling spindle at five speeds, 10 s each",
    ("inertia", "time_misalignment"): _RAMPS,
    ("inertia", "backlash"): _RAMPS,
    ("inertia", "axis_coupling"): "moves of one axis at a time, 20 mm at three feeds",
    ("viscous_friction", "axis_coupling"): "moves of one axis at a time, 20 mm at three feeds",
    ("gravity_load", "sensor_offset"): "the same moves with a light and a heavy tool, and the drive switched off",
    ("cutting_force", "load_dependent_friction"): "a slot along the axis in both directions at two depths of cut",
    ("cutting_force", "edge_force"): "slots at three feeds per tooth with one depth of cut",
    ("cutting_force", "tool_wear"): "the same slot with a new and a worn tool",
    ("cutting_force", "material_hard_zone"): "the same slot at four places of the workpiece",
    ("spindle_torque_load", "edge_force"): "slots at three feeds per tooth with one depth of cut",
    ("spindle_torque_load", "tool_wear"): "the same slot with a new and a worn tool",
    ("spindle_torque_load", "material_hard_zone"): "the same slot at four places of the workpiece",
    ("tool_wear", "thermal_drift"): "the same slot with a new and a worn tool, both on a warm machine",
    ("tool_wear", "material_hard_zone"): "the same slot at four places, in two orders",
    ("edge_force", "coolant_load"): "the same slot with coolant on and off",
    ("coolant_load", "sensor_offset"): "an air cut with coolant on and off every 10 s, 60 s",
    ("coolant_load", "spindle_viscous_drag"): "the spindle at three speeds, 10 s each, with coolant on and off",
    ("coolant_load", "thermal_drift"): "coolant on and off several times on a warm machine",
    ("spindle_viscous_drag", "spindle_windage"): "the idling spindle at five speeds, 10 s each",
    ("spindle_viscous_drag", "coulomb_friction"): "the idling spindle at five speeds, 10 s each",
    ("spindle_viscous_drag", "thermal_drift"): "the idling spindle at five speeds on a warm machine",
    ("spindle_inertia", "time_misalignment"): "run-ups of the spindle at two accelerations",
    ("thermal_drift", "sensor_offset"): _DAY,
    ("thermal_drift", "coulomb_friction"): _DAY,
    ("thermal_drift", "viscous_friction"): _DAY,
    ("current_saturation", "sensor_gain"): "hard accelerations and gentle moves with the same program",
    ("current_saturation", "sensor_clipping"): "hard accelerations at 100, 50 and 25 %, five of each",
    ("sensor_gain", "inertia"): "20 s at constant feed and ten hard accelerations",
    ("sensor_gain", "coulomb_friction"): "20 s at constant feed and ten hard accelerations",
}

_CHANGES = {
    "coulomb_friction": "the direction of motion",
    "viscous_friction": "the feed",
    "stribeck_friction": "a feed below 10 mm/s",
    "standstill_friction": "the length of stops",
    "friction_asymmetry": "the direction of motion",
    "load_dependent_friction": "the process load across the guideway",
    "position_dependent_friction": "the place along the travel",
    "presliding_hysteresis": "the length of short moves after reversals",
    "backlash": "the number of reversals",
    "inertia": "the acceleration",
    "gravity_load": "the mass of the tool",
    "axis_coupling": "the motion of the other axes",
    "torque_ripple": "the place within one turn of the drive",
    "cutting_force": "the depth of cut",
    "edge_force": "the feed per tooth",
    "tool_wear": "the wear of the tool",
    "material_hard_zone": "the place on the workpiece",
    "coolant_load": "the coolant, on and off,",
    "spindle_viscous_drag": "the spindle speed",
    "spindle_windage": "the spindle speed",
    "spindle_inertia": "the acceleration of the spindle",
    "spindle_torque_load": "the cutting torque",
    "thermal_drift": "the time since the machine was started",
    "current_saturation": "the size of the current",
    "external_force": "the time of day",
    "sensor_gain": "the size of the current",
    "sensor_offset": "the drive, on and off,",
    "sensor_clipping": "the size of the current",
    "time_misalignment": "the acceleration",
}
"""What has to change in a recording to show a mechanism."""


def recording_that_tells(own: str, other: str) -> str:
    """The recording that separates two mechanisms (either may be 'miscalibrated:<id>').

    >>> recording_that_tells("viscous_friction", "miscalibrated:coulomb_friction")
    'an air cut at three feeds, both directions, 40 s'
    >>> recording_that_tells("unknown", "inertia")
    'a recording in which the acceleration changes over its whole range while all else stays the same, 20 s'
    >>> recording_that_tells("coolant_load", "viscous_friction")  # doctest: +ELLIPSIS
    'a recording in which the coolant, on and off, changes while the feed does not, and one in which ..., 20 s each'
    """
    own, other = (name.removeprefix("miscalibrated:") for name in (own, other))
    known = recordings_against(own).get(other)
    if known is not None:
        return known
    a, b = (_CHANGES.get(name) for name in (own, other))
    if a is None or b is None or a == b:
        what = a or b
        whole = f"a recording in which {what} changes over its whole range while all else stays the same, 20 s"
        return whole if what else ""
    return (
        f"a recording in which {a} changes while {b} does not, and one in which {b} changes while {a} does not, "
        "20 s each"
    )


def recording_that_names(every: float | None, coolant: bool = False) -> str:
    """The recording that tells what an outside force is.

    every : s, after which it comes again; None where it has no rhythm
    coolant : whether it is recorded already when coolant is on

    >>> recording_that_names(40.0)  # doctest: +ELLIPSIS
    'at least 200 s of any program, and beside it a signal of each unit that may switch every 40 s (lubrication ...'
    """
    units = ", ".join(_UNITS if coolant else (*_UNITS, "coolant pump"))
    if every is None:
        return (
            f"the same program twice, and beside it a signal of each unit that switches by itself ({units}) or the "
            "times at which somebody touched the machine: what comes again at the same place of the program belongs to "
            "the program, the rest to what switches with it"
        )
    return (
        f"at least {5 * every:.3g} s of any program, and beside it a signal of each unit that may switch every "
        f"{every:.3g} s ({units}): the one that switches with the force is its cause, and its signal is what foretells "
        "the force on other parts"
    )


def recording_that_shows(signal: str, least: float, most: float) -> str:
    """The recording in which one signal changes and little else; '' for one of which nothing is known.

    least, most : of its size in the data at hand, in its unit: slow and fast are said by them

    >>> recording_that_shows("v_y", 0.5, 40.0)
    'moves of the y axis alone in the air at five speeds from 0.5 to 40 mm/s, both directions, 10 s each'
    >>> recording_that_shows("MRR", 0.0, 300.0)
    'the same path with material, at two depths of cut, and without it'
    """
    text = next((text for stem, text in _SHOWS if signal.startswith(stem)), "")
    slow = max(least, most / 100)
    return text.format(
        a=signal.rpartition("_")[2], slow=in_digits(slow), fast=in_digits(most), slow_rpm=in_digits(slow / 6),
        fast_rpm=in_digits(most / 6),
    )  # fmt: skip


def in_digits(value: float) -> str:
    """A number to set a machine to: two digits of it, and no power of ten.

    >>> in_digits(0.5621), in_digits(3033.0)
    ('0.56', '3000')
    """
    return f"{float(f'{value:.2g}'):g}"


def recordings_against(own: str) -> dict[str, str]:
    """Identifier of each mechanism that `own` may be mistaken for -> the recording that separates the two."""
    return {b if a == own else a: text for (a, b), text in _PAIRS.items() if own in (a, b)}
