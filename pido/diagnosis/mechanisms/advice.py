"""Which recording tells two mechanisms apart that the data at hand cannot: pairs of identifiers and a sentence."""

from __future__ import annotations

_THREE_FEEDS = "an air cut at three feeds, both directions, 40 s"
_SLOW = "an air cut from 0.1 to 10 mm/s in six feeds, both directions, with stops of some seconds"
_STOPS = "stops of some seconds after moves in both directions"
_TO_AND_FRO = "to and fro moves of 0.05, 0.2 and 1 mm, and slow moves without a reversal"
_AIR = "the same program as an air cut"
_RAMPS = "moves at one feed with three different accelerations"
_DAY = "the same air cut at start-up, after an hour of running and after an hour's pause"

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
    ("position_dependent_friction", "torque_ripple"): "one long move to and fro at constant feed",
    ("inertia", "time_misalignment"): _RAMPS,
    ("inertia", "backlash"): _RAMPS,
    ("inertia", "axis_coupling"): "moves of one axis at a time",
    ("viscous_friction", "axis_coupling"): "moves of one axis at a time",
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
    ("coolant_load", "sensor_offset"): "an air cut with coolant on and off",
    ("coolant_load", "spindle_viscous_drag"): "the spindle at three speeds with coolant on and off",
    ("coolant_load", "thermal_drift"): "coolant on and off several times on a warm machine",
    ("spindle_viscous_drag", "spindle_windage"): "the idling spindle at five speeds",
    ("spindle_viscous_drag", "coulomb_friction"): "the idling spindle at five speeds",
    ("spindle_viscous_drag", "thermal_drift"): "the idling spindle at five speeds on a warm machine",
    ("spindle_inertia", "time_misalignment"): "run-ups of the spindle at two accelerations",
    ("thermal_drift", "sensor_offset"): _DAY,
    ("thermal_drift", "coulomb_friction"): _DAY,
    ("thermal_drift", "viscous_friction"): _DAY,
    ("current_saturation", "sensor_gain"): "hard accelerations and gentle moves with the same program",
    ("current_saturation", "sensor_clipping"): "hard accelerations at three levels",
    ("sensor_gain", "inertia"): "moves at constant feed and hard accelerations",
    ("sensor_gain", "coulomb_friction"): "moves at constant feed and hard accelerations",
}


def recordings_against(own: str) -> dict[str, str]:
    """Identifier of each mechanism that `own` may be mistaken for -> the recording that separates the two."""
    return {b if a == own else a: text for (a, b), text in _PAIRS.items() if own in (a, b)}
