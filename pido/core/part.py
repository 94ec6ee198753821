"""`part.json`: what a plant knows about a part. Only `part` and `machine` are required; nothing is guessed."""

from __future__ import annotations

from pydantic import AliasChoices, BaseModel, ConfigDict, Field, NonNegativeFloat, PositiveFloat, PositiveInt


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


class Workpiece(_Strict):
    center_xy_mm: tuple[float, float] | None = Field(default=None, description="in machine coordinates, mm")
    size_xy_mm: tuple[float, float] | None = Field(default=None, description="mm")
    top_z_mm: float | None = Field(default=None, description="highest z of the blank in machine coordinates, mm")
    blank_mm: tuple[float, float, float] | None = Field(
        default=None, description="size of the blank along x, y and z of the machine, mm"
    )


class PartInfo(_Strict):
    """The content of `part.json`; unknown keys are refused by name."""

    part: str = Field(min_length=1, description="identifier of the part (one production iteration)")
    machine: str = Field(min_length=1, description="identifier of the machine")
    order: PositiveInt | None = Field(
        default=None,
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
