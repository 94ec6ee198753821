"""Every mechanism of the vocabulary that this generator can conceal: on which axes, with which law.

In:  nothing. Out: `CONCEALED`, and which of them each group of a plan may draw; what lies outside: `editions`.
"""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.newcomer import axes, process
from benchmarks.newcomer.world import Concealed

CONCEALED: Mapping[str, Concealed] = {
    "coulomb_friction": Concealed(axes.coulomb),
    "viscous_friction": Concealed(axes.viscous),
    "stribeck_friction": Concealed(axes.stribeck),
    "standstill_friction": Concealed(axes.standstill),
    "friction_asymmetry": Concealed(axes.asymmetry),
    "load_dependent_friction": Concealed(axes.load_dependent),
    "position_dependent_friction": Concealed(axes.position_dependent),
    "presliding_hysteresis": Concealed(axes.presliding),
    "backlash": Concealed(axes.backlash),
    "inertia": Concealed(axes.inertia),
    "gravity_load": Concealed(axes.gravity, "vertical", facts=True, both_ways=True),
    "axis_coupling": Concealed(axes.coupling, both_ways=True),
    "torque_ripple": Concealed(axes.ripple),
    "cutting_force": Concealed(process.cutting),
    "edge_force": Concealed(process.edge, "any", facts=True),
    "tool_wear": Concealed(process.wear, "any", facts=True),
    "material_hard_zone": Concealed(process.hard_zone, "any", facts=True, both_ways=True),
    "coolant_load": Concealed(process.coolant, "any", facts=True, both_ways=True),
    "spindle_viscous_drag": Concealed(process.drag, "sp"),
    "spindle_windage": Concealed(process.windage, "sp"),
    "spindle_inertia": Concealed(process.rotor, "sp"),
    "spindle_torque_load": Concealed(process.torque, "sp"),
    "thermal_drift": Concealed(process.warming, "any", facts=True, both_ways=True),
    "current_saturation": Concealed(process.saturation, "any"),
    "external_force": Concealed(process.external, "any", both_ways=True),
}

FAULTS = ("time_misalignment", "sensor_gain", "sensor_offset", "sensor_clipping", "input_fault")
MISCALIBRATED = (
    "coulomb_friction", "viscous_friction", "inertia", "cutting_force", "gravity_load", "spindle_viscous_drag",
    "spindle_windage", "spindle_inertia", "spindle_torque_load",
)  # fmt: skip
CONFINED = (
    "coulomb_friction", "viscous_friction", "inertia", "cutting_force", "load_dependent_friction", "axis_coupling",
    "torque_ripple", "spindle_viscous_drag", "spindle_windage", "spindle_torque_load", "coolant_load", "edge_force",
    "friction_asymmetry",
)  # fmt: skip
TOGETHER = ("viscous_friction", "coulomb_friction", "inertia", "axis_coupling")
"""What cannot be told from another axis' motion where all motion is along one line."""

MENU: Mapping[str, tuple[str, ...]] = {
    "single": tuple(CONCEALED),
    "pair": tuple(CONCEALED),
    "wrong coefficient": MISCALIBRATED,
    "data fault": FAULTS,
    "confined to a region": CONFINED,
    "confounded": TOGETHER,
    "clean": ("",),
}
