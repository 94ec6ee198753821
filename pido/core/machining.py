"""What cuts, what is cut, and on what: values that settings files build (`pido.config`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from pido.core.axes import LINEAR_AXES


@dataclass(frozen=True, slots=True)
class Material:
    """Kienzle coefficients of a workpiece material (paper, section III-B and IV-A, VII-A)."""

    name: str
    k_c11: float  # N/mm², specific cutting force
    z: float  # –, chip thickness exponent of the cutting force
    k_f11: float  # N/mm², specific cutting normal force
    x: float  # –, its exponent
    k_p11: float  # N/mm², specific passive force
    y: float  # –, its exponent
    K: float = 1.0  # –, product of the correction factors


@dataclass(frozen=True, slots=True)
class Tool:
    """A rotating cutter. kind: 'end', 'ball', 'bull' or 'drill'."""

    id: str
    diameter_mm: float
    teeth: int
    kind: str = "end"
    corner_radius_mm: float = 0.0
    kappa_deg: float = 90.0  # cutting edge angle
    mass_kg: float | None = None


@dataclass(frozen=True, slots=True)
class Stock:
    """A block: opposite corners in machine coordinates, mm."""

    low_mm: tuple[float, float, float]
    high_mm: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class MeshStock:
    """A raw part of any shape: a mesh file in mm, moved by `offset_mm` into machine coordinates."""

    path: str
    offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """What one linear axis can do."""

    v_max: float  # mm/s
    a_max: float  # mm/s²
    j_max: float  # mm/s³
    travel_mm: tuple[float, float]  # machine coordinates
    dead_band: float = 0.02  # mm/s, below which the axis stands still


@dataclass(frozen=True, slots=True)
class Machine:
    """A three-axis mill. Ranges scale the columns of every fit, so they are the machine's, not the data's."""

    id: str
    axes: dict[str, AxisLimits]
    spindle_max_deg_s: float
    spindle_acc_deg_s2: float
    spindle_dead_band_deg_s: float = 6.0
    force_max_n: float = 2000.0
    torque_max_nm: float = 50.0
    mrr_max_mm3_s: float = 2000.0
    current_max_a: dict[str, float] = field(default_factory=dict)
    vertical_axis: str = "z"  # along which gravity acts
    tool_axis: str = "z"  # along which the spindle points; z on horizontal mills too (ISO 841)
    ball_screw_lead_mm: dict[str, float] = field(default_factory=dict)
    dynamics: Mapping[str, float | bool] = field(default_factory=dict)  # fields of process.motion.Dynamics

    def dead_band(self, axis: str) -> float:
        """Speed below which `axis` stands still: mm/s, spindle deg/s."""
        return self.axes[axis].dead_band if axis in LINEAR_AXES else self.spindle_dead_band_deg_s


@dataclass(frozen=True, slots=True)
class Job:
    """What is cut with what, on which machine, and how the simulation of it runs."""

    machine: Machine
    tools: Mapping[str, Tool]
    material: Material | None = None
    stock: Stock | MeshStock | None = None  # None: an air cut
    grid_mm: float = 0.1
    rate_hz: float = 50.0
    teeth: Literal["one", "mean"] = "one"
    start: tuple[float, float, float] | None = None
    zero_offsets: Mapping[str, tuple[float, float, float]] | None = None
    subprograms: str | None = None
    dynamics: Mapping[str, float | bool] | None = None
