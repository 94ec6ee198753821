"""The catalogue of mechanisms, one family per module; where two explain the same, the earlier one is named.

`external_force` needs a search in time and is in `pido.diagnosis.events`; `input_fault` is in `pido.diagnosis.faults`.
"""

from pido.diagnosis.mechanisms.base import Mechanism
from pido.diagnosis.mechanisms.friction import (
    CoulombFriction,
    FrictionAsymmetry,
    LoadDependentFriction,
    PositionDependentFriction,
    PreslidingHysteresis,
    StandstillFriction,
    StribeckFriction,
    ViscousFriction,
)

CATALOGUE: tuple[Mechanism, ...] = (
    CoulombFriction(),
    ViscousFriction(),
    StribeckFriction(),
    StandstillFriction(),
    FrictionAsymmetry(),
    LoadDependentFriction(),
    PositionDependentFriction(),
    PreslidingHysteresis(),
)
