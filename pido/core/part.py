"""`part.json`: what a plant knows about a part. Only `part` and `machine` are required; nothing is guessed.

Some rules hold only for what is given now (`GIVEN`): what a store took before there were such rules stays readable.
"""

from __future__ import annotations

from typing import Any

from pydantic import (
    AliasChoices,
    BaseModel,
    ConfigDict,
    Field,
    NonNegativeFloat,
    PositiveFloat,
    PositiveInt,
    ValidationInfo,
    field_validator,
)

from pido.core.axes import LINEAR_AXES
from pido.core.names import unusable

GIVEN = {"given": True}
"""The validation context of a part.json that arrives."""
LAST = 2**63 - 1
"""The largest production order: an index keeps it as a whole number of 64 bits."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class UsedBefore(_Strict):
    """What a cutting edge had already done before this part."""

    cut_volume_mm3: NonNegativeFloat = Field(default=0.0, description="volume cut, mm³")
    cut_time_s: NonNegativeFloat = Field(default=0.0, description="time in cut, s")


class PartTool(_Strict):
    diameter_mm: PositiveFloat | None = Field(default=None, description="tool diameter, mm")
    teeth: PositiveInt | None = Field(default=None, description="number of teeth, –")
    mass_kg: NonNegativeFloat | None = Field(default=None, description="mass of tool and holder, kg")
    corner_radius_mm: NonNegativeFloat | None = Field(default=None, description="corner radius, mm")
    used_before: UsedBefore | None = None


class ToolChange(_Strict):
    t: float = Field(description="time in the recording, s")
    tool_id: int | str


class Operation(_Strict):
    """From this NC block on, until the next entry."""

    nc_line: int
    tool_id: int | str | None = None
    feed_mm_s: float | None = Field(default=None, description="programmed feed, mm/s")
    rpm: float | None = Field(default=None, description="programmed spindle speed, 1/min")
    a_p: float | None = Field(default=None, description="axial depth of cut, mm")
    a_e: float | None = Field(default=None, description="radial depth of cut, mm")
    coolant: bool | int | None = None

    @field_validator("coolant")
    @classmethod
    def _on_or_off(cls, coolant: bool | int | None, info: ValidationInfo) -> bool | int | None:
        if info.context == GIVEN and coolant not in (None, 0, 1):
            raise ValueError("must be 0 (off) or 1 (on)")
        return coolant


class Workpiece(_Strict):
    center_xy_mm: tuple[float, float] | None = Field(default=None, description="in machine coordinates, mm")
    size_xy_mm: tuple[float, float] | None = Field(default=None, description="mm")
    top_z_mm: float | None = Field(default=None, description="highest z of the blank in machine coordinates, mm")
    blank_mm: tuple[float, float, float] | None = Field(
        default=None, description="size of the blank along x, y and z of the machine, mm"
    )

    @field_validator("size_xy_mm", "blank_mm")
    @classmethod
    def _sizes(cls, sizes: tuple[float, ...] | None, info: ValidationInfo) -> tuple[float, ...] | None:
        if info.context == GIVEN and sizes is not None and min(sizes) <= 0:
            raise ValueError("sizes must be greater than 0")
        return sizes


class PartInfo(_Strict):
    """The content of `part.json`; unknown keys are refused by name."""

    part: str = Field(min_length=1, description="identifier of the part (one production iteration)")
    machine: str = Field(min_length=1, description="identifier of the machine")
    order: PositiveInt | None = Field(
        default=None,
        le=LAST,
        validation_alias=AliasChoices("order", "production_order"),
        description="position in the machine's production sequence, from 1",
    )
    start_time_s: float | None = Field(default=None, description="machine's clock at the first sample, s")
    duration_s: NonNegativeFloat | None = None
    sample_rate_hz: PositiveFloat | None = None
    material: str | None = None
    program: str | None = Field(default=None, description="file name of the NC program in the folder")
    tools: dict[str, PartTool] = Field(default_factory=dict)
    tool_changes: tuple[ToolChange, ...] = ()
    operations: tuple[Operation, ...] = ()
    ball_screw_lead_mm: dict[str, PositiveFloat] = Field(default_factory=dict, description="per axis, mm")
    vertical_axis: str | None = Field(default=None, pattern="^[xyz]$")
    workpiece: Workpiece | None = None

    @field_validator("part", "machine")
    @classmethod
    def _name(cls, name: str, info: ValidationInfo) -> str:
        if info.context == GIVEN and (fault := unusable(name)):
            raise ValueError(f"the name {fault}")
        return name

    @field_validator("order", mode="before")
    @classmethod
    def _a_number(cls, order: Any, info: ValidationInfo) -> Any:
        if info.context == GIVEN and isinstance(order, bool | str):
            raise ValueError("must be a whole number, without quotes")
        return order

    @field_validator("ball_screw_lead_mm")
    @classmethod
    def _axes(cls, leads: dict[str, float], info: ValidationInfo) -> dict[str, float]:
        if info.context == GIVEN and (odd := [axis for axis in leads if axis not in LINEAR_AXES]):
            raise ValueError(f"{', '.join(map(repr, odd))} is no axis with a screw: {', '.join(LINEAR_AXES)}")
        return leads
