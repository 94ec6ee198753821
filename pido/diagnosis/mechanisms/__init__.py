"""The catalogue of mechanisms, one family per module; where two explain the same, the earlier one is named.

`external_force` needs a search in time and is in `pido.diagnosis.events`; `input_fault` is in `pido.diagnosis.faults`.
"""

from pido.diagnosis.mechanisms import data, drive, friction, hard_zone, process, slow, spindle
from pido.diagnosis.mechanisms.base import Mechanism

CATALOGUE: tuple[Mechanism, ...] = (
    friction.CoulombFriction(),
    friction.ViscousFriction(),
    friction.StribeckFriction(),
    friction.StandstillFriction(),
    friction.FrictionAsymmetry(),
    friction.LoadDependentFriction(),
    friction.PositionDependentFriction(),
    friction.PreslidingHysteresis(),
    drive.Backlash(),
    drive.Inertia(),
    drive.GravityLoad(),
    drive.AxisCoupling(),
    drive.TorqueRipple(),
    process.CuttingForce(),
    process.EdgeForce(),
    process.ToolWear(),
    hard_zone.MaterialHardZone(),
    process.CoolantLoad(),
    spindle.SpindleViscousDrag(),
    spindle.SpindleWindage(),
    spindle.SpindleInertia(),
    spindle.SpindleTorqueLoad(),
    slow.ThermalDrift(),
    slow.CurrentSaturation(),
    data.TimeMisalignment(),
    data.SensorGain(),
    data.SensorOffset(),
    data.SensorClipping(),
)

__all__ = ["CATALOGUE", "Mechanism"]
