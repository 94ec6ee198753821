"""Settings from people and files. Each model is checked once, refuses unknown keys, and builds a frozen value.

Settings files are TOML. `pido/settings/` ships the paper's materials and machines; a user's file may define more and
is merged over them by name.
"""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    NonNegativeFloat,
    PositiveFloat,
    PositiveInt,
    ValidationError,
    model_validator,
)

from pido.core.axes import LINEAR_AXES
from pido.core.errors import SettingsError, SettingsFileError
from pido.core.machining import AxisLimits, Job, Machine, Material, MeshStock, Stock, Tool

if TYPE_CHECKING:
    from pido.sampling.method import Method

Model = TypeVar("Model", bound=BaseModel)


class _Settings(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class MaterialConfig(_Settings):
    k_c11: PositiveFloat = Field(description="specific cutting force k_c1.1, N/mm²")
    z: float = Field(ge=0, lt=2, description="chip thickness exponent of the cutting force, –")
    k_f11: NonNegativeFloat = Field(description="specific cutting normal force k_f1.1, N/mm²")
    x: float = Field(ge=0, lt=2, description="chip thickness exponent of the cutting normal force, –")
    k_p11: NonNegativeFloat = Field(description="specific passive force k_p1.1, N/mm²")
    y: float = Field(ge=0, lt=2, description="chip thickness exponent of the passive force, –")
    K: PositiveFloat = Field(default=1.0, description="product of the correction factors, –")

    def build(self, name: str) -> Material:
        return Material(name=name, **self.model_dump())


class ToolConfig(_Settings):
    diameter_mm: PositiveFloat = Field(description="cutter diameter D, mm")
    teeth: PositiveInt = Field(description="number of cutting edges, –")
    kind: Literal["end", "ball", "bull", "drill"] = "end"
    corner_radius_mm: NonNegativeFloat = Field(default=0.0, description="corner radius, mm")
    kappa_deg: float | None = Field(
        default=None, gt=0, le=90, description="cutting edge angle, deg; default 90, drill 59 (half its point angle)"
    )
    mass_kg: PositiveFloat | None = Field(default=None, description="mass of tool and holder, kg")

    @model_validator(mode="after")
    def _corner_fits(self) -> ToolConfig:
        if 2 * self.corner_radius_mm > self.diameter_mm:
            raise ValueError("corner_radius_mm is larger than half the diameter")
        if self.kind == "bull" and self.corner_radius_mm == 0:
            raise ValueError("a bull nose needs its corner_radius_mm")
        return self

    def build(self, tool_id: str) -> Tool:
        kappa = self.kappa_deg or (59.0 if self.kind == "drill" else 90.0)
        return Tool(id=tool_id, **{**self.model_dump(), "kappa_deg": kappa})


class StockConfig(_Settings):
    low_mm: tuple[float, float, float] = Field(description="lower corner in machine coordinates, mm")
    high_mm: tuple[float, float, float] = Field(description="upper corner in machine coordinates, mm")

    @model_validator(mode="after")
    def _is_a_block(self) -> StockConfig:
        if any(h <= low for low, h in zip(self.low_mm, self.high_mm, strict=True)):
            raise ValueError("high_mm must lie above low_mm in x, y and z")
        return self

    def build(self) -> Stock:
        return Stock(**self.model_dump())


class MeshStockConfig(_Settings):
    mesh: str = Field(
        min_length=1, description="mesh of the raw part (STL, OBJ, PLY, OFF), mm; relative to the job file"
    )
    offset_mm: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0), description="its shift into machine coordinates, mm"
    )

    def build(self, folder: Path) -> MeshStock:
        return MeshStock(str(folder / self.mesh), self.offset_mm)


class JobConfig(_Settings):
    """What is cut with what, on which machine: one file, given to `simulate`, `plan` and `iterate`."""

    machine: str = Field(description="name of the machine's settings")
    material: str | None = Field(default=None, description="name of a material; needed where there is a raw part")
    machines: str | None = Field(default=None, description="file of own machines, relative to the job file")
    materials: str | None = Field(default=None, description="file of own materials, relative to the job file")
    stock: dict[str, Any] | None = Field(default=None, description="block or mesh; left out for an air cut")
    tools: dict[str, ToolConfig] = Field(min_length=1, description="by the name in the NC program")
    grid_mm: PositiveFloat = Field(default=0.1, le=2.0, description="edge of a cell of the height map, mm")
    rate_hz: PositiveFloat = Field(default=50.0, le=1000.0, description="samples per second of a planned motion")
    teeth: Literal["one", "mean"] = Field(default="one", description="force of one tooth (paper), or of all in the cut")
    start: tuple[float, float, float] | None = Field(default=None, description="tool tip before the first move, mm")
    zero_offsets: dict[str, tuple[float, float, float]] | None = Field(
        default=None, description="of G54 and so on, in machine coordinates, mm; left out: 0"
    )
    subprograms: str | None = Field(default=None, description="folder of subprograms, relative to the job file")
    dynamics: dict[str, float | bool] | None = Field(
        default=None, description="servo gain, stop window and so on of the machine (process.motion.Dynamics)"
    )

    @model_validator(mode="after")
    def _material_for_stock(self) -> JobConfig:
        if self.stock is not None and self.material is None:
            raise ValueError("a stock needs its material")
        return self


class AxisConfig(_Settings):
    v_max: PositiveFloat = Field(description="highest speed, mm/s")
    a_max: PositiveFloat = Field(description="highest acceleration, mm/s²")
    j_max: PositiveFloat = Field(description="highest jerk, mm/s³")
    travel_mm: tuple[float, float] = Field(description="travel in machine coordinates, mm")
    dead_band: NonNegativeFloat = Field(default=0.02, description="speed below which the axis stands still, mm/s")
    ball_screw_lead_mm: PositiveFloat | None = Field(default=None, description="lead of the ball screw, mm")
    current_max_a: PositiveFloat | None = Field(default=None, description="limit of the drive, A")
    channel: str | None = Field(default=None, description="name in the control's own recordings, e.g. X1")

    @model_validator(mode="after")
    def _travel_has_length(self) -> AxisConfig:
        if self.travel_mm[1] <= self.travel_mm[0]:
            raise ValueError("travel_mm must be (lower, upper) with upper > lower")
        return self


class SpindleConfig(_Settings):
    max_rpm: PositiveFloat = Field(description="highest speed, 1/min")
    acc_deg_s2: PositiveFloat = Field(default=36000.0, description="acceleration when running up, deg/s²")
    dead_band_deg_s: NonNegativeFloat = Field(default=6.0, description="speed below which it stands still, deg/s")
    current_max_a: PositiveFloat | None = Field(default=None, description="limit of the drive, A")
    channel: str | None = Field(default=None, description="name in the control's own recordings, e.g. SP1")


class DynamicsConfig(_Settings):
    """How the control executes a path; `pido.process.motion.fit_dynamics` finds it in a recorded run."""

    kv_per_s: PositiveFloat | None = Field(default=None, description="servo gain, 1/s (1 m/min/mm = 16.7 1/s)")
    stop_window_mm: PositiveFloat | None = Field(default=None, description="lag at which an exact stop ends, mm")
    block_overhead_s: NonNegativeFloat | None = Field(default=None, description="what each stop costs besides, s")
    path_a_max: PositiveFloat | None = Field(default=None, description="acceleration along a feed path, mm/s²")
    path_j_max: PositiveFloat | None = Field(default=None, description="jerk along a feed path, mm/s³")
    smoothing_mm: NonNegativeFloat | None = Field(default=None, description="where G64 begins to round a corner, mm")
    stop_at_speed_change: bool | None = Field(default=None, description="a new S begins from rest")
    spindle_acc_deg_s2: PositiveFloat | None = Field(default=None, description="acceleration of the spindle, deg/s²")
    spindle_tolerance: NonNegativeFloat | None = Field(default=None, description="feed waits for this share of S, –")
    tool_change_s: NonNegativeFloat | None = Field(default=None, description="time of a tool change, s")


class MachineConfig(_Settings):
    x: AxisConfig
    y: AxisConfig
    z: AxisConfig
    spindle: SpindleConfig
    vertical_axis: Literal["x", "y", "z"] = Field(default="z", description="axis along which gravity acts")
    tool_axis: Literal["x", "y", "z"] = Field(
        default="z", description="axis along which the spindle points (ISO 841: z)"
    )
    force_max_n: PositiveFloat = Field(default=2000.0, description="largest process force to expect, N")
    torque_max_nm: PositiveFloat = Field(default=50.0, description="largest spindle torque to expect, N·m")
    mrr_max_mm3_s: PositiveFloat = Field(default=2000.0, description="largest removal rate to expect, mm³/s")
    dynamics: DynamicsConfig = Field(default=DynamicsConfig(), description="how the control executes a path")

    def channels(self) -> dict[str, str]:
        """Axis -> its name in the control's own recordings, where the settings say it."""
        named = {**{a: getattr(self, a).channel for a in LINEAR_AXES}, "sp": self.spindle.channel}
        return {axis: channel for axis, channel in named.items() if channel}

    def build(self, machine_id: str) -> Machine:
        axes = {a: getattr(self, a) for a in LINEAR_AXES}
        limits = {a: c.current_max_a for a, c in (*axes.items(), ("sp", self.spindle)) if c.current_max_a}
        fields = ("v_max", "a_max", "j_max", "travel_mm", "dead_band")
        return Machine(
            id=machine_id,
            axes={a: AxisLimits(**{f: getattr(c, f) for f in fields}) for a, c in axes.items()},
            spindle_max_deg_s=6.0 * self.spindle.max_rpm,
            spindle_acc_deg_s2=self.spindle.acc_deg_s2,
            spindle_dead_band_deg_s=self.spindle.dead_band_deg_s,
            force_max_n=self.force_max_n,
            torque_max_nm=self.torque_max_nm,
            mrr_max_mm3_s=self.mrr_max_mm3_s,
            current_max_a=limits,
            vertical_axis=self.vertical_axis,
            tool_axis=self.tool_axis,
            ball_screw_lead_mm={a: c.ball_screw_lead_mm for a, c in axes.items() if c.ball_screw_lead_mm},
            dynamics=self.dynamics.model_dump(exclude_none=True),
        )


class MethodSettings(_Settings):
    """How samples are generated and models trained. `MethodSettings()` adapts, `paper()` is as printed.

    With `adaptive` and `compare_with_model`, arrivals of parts are played and rows are taken from the coming path up to
    `density` per bin, or as many and in bins as wide as has proven better for an axis (`pido.sampling.trust`); share
    rules, leverage_quantile, margin, nuisance and weigh_by_certainty are for the other cases.
    """

    adaptive: bool = Field(default=True, description="terms, weights and trust per axis from held-out rows")
    bin_width: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = Field(
        default=(2.0, 2.0, 2.0), description="bins that are balanced: mm/s, mm/s, mm²"
    )
    equation_bin_width: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = Field(
        default=(1.0, 1.0, 10.0), description="bins that have an equation each: mm/s, mm/s, mm²"
    )
    density: PositiveFloat = Field(default=40.0, description="target density rho, samples per bin")
    pia: Literal["paper-pia", "fill", "none"] = Field(default="paper-pia", description="share rule of PiA (eq. 15)")
    pie: Literal["paper-pie", "generous-pie", "fill", "none"] = Field(
        default="paper-pie", description="share rule of PiE (eq. 16)"
    )
    rounding: Literal["stochastic", "nearest"] = "stochastic"
    leverage_quantile: float | None = Field(
        default=0.95, gt=0, le=1, description="gate: largest leverage, as a quantile of the fitted rows'; none: open"
    )
    compare_with_model: bool = Field(default=True, description="gate: the equation must beat the model where it speaks")
    margin: PositiveFloat = Field(default=0.9, description="gate: equation's error over the model's, at most")
    nuisance: Literal["planned", "joint", "paper"] = Field(
        default="planned", description="where PiE takes v_z, accelerations and spindle from"
    )
    omega_data: PositiveFloat = Field(default=1.0, description="weight of real rows in the loss (eq. 7)")
    omega_generated: NonNegativeFloat = Field(default=1.0, description="weight of PiA and PiE rows in the loss")
    weigh_by_certainty: bool = Field(default=True, description="generated rows count less where their error is large")
    estimators: Literal["default", "paper"] = "default"
    inputs: Literal["extended", "paper"] = Field(
        default="extended", description="13 inputs of the paper, or with each axis' last direction of motion"
    )
    rows_max: PositiveInt = Field(
        default=1_000_000, description="real rows that models learn from; above it, crowded bins are thinned"
    )
    rows_max_choice: PositiveInt = Field(
        default=100_000, description="the same for choosing equations and shares, which trains some 40 models"
    )

    @classmethod
    def paper(cls) -> MethodSettings:
        """Everything as printed."""
        return cls(
            adaptive=False, leverage_quantile=None, compare_with_model=False, margin=1.0, nuisance="paper",
            weigh_by_certainty=False, estimators="paper", inputs="paper",
        )  # fmt: skip

    def build(self) -> Method:
        from pido.feature_space.grid import Grid
        from pido.sampling.gate import Gate
        from pido.sampling.method import Method
        from pido.sampling.shares import SHARES, ShareRule

        return Method(
            grid=Grid(self.bin_width),
            equation_grid=Grid(self.equation_bin_width),
            share=ShareRule(self.density, SHARES[self.pia], SHARES[self.pie], self.rounding),
            gate=Gate(self.leverage_quantile, self.compare_with_model, self.margin),
            nuisance=self.nuisance,
            adaptive=self.adaptive,
            omega_data=self.omega_data,
            omega_generated=self.omega_generated,
            weigh_by_certainty=self.weigh_by_certainty,
        )


def parse(model: type[Model], data: dict[str, Any], where: str) -> Model:
    """`data` as `model`, or one SettingsFileError that lists every fault with its place."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        faults = "\n".join(f"  {'.'.join(map(str, e['loc'])) or '(top)'}: {e['msg']}" for e in error.errors())
        raise SettingsFileError(f"{where}: {error.error_count()} fault(s) in these settings:\n{faults}") from None


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a settings file; SettingsFileError names a fault in it with its line."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise SettingsFileError(f"{path}: no such settings file. Bring it back, or correct what names it.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsFileError(f"{path}: not a TOML file: {error}. Correct it, or name another.") from None


def material(name: str, own: Path | None = None) -> Material:
    """A material by name: from `own` (a TOML file with one table per material), else as shipped.

    Raises SettingsError for a name that nobody defines, SettingsFileError for a fault of the file; `machine` too.
    """
    return _named(MaterialConfig, "material", name, _shipped("materials.toml"), own).build(name)


def machine(name: str, own: Path | None = None) -> Machine:
    """A machine by name: from `own` (a TOML file with one table per machine), else as shipped."""
    return machine_config(name, own).build(name)


def machine_config(name: str, own: Path | None = None) -> MachineConfig:
    """The settings behind `machine`, with the names of the axes in the control's recordings."""
    return _named(MachineConfig, "machine", name, _shipped("machines.toml"), own)


def machines_in(own: Path) -> tuple[str, ...]:
    """Names of the machines that a user's file defines; SettingsFileError for a fault of the file."""
    return tuple(read_toml(own))


def load_job(path: Path) -> Job:
    """A job file (TOML): machine, material, tools, raw part, and how to simulate.

    Raises SettingsFileError with every fault of the file and its place.
    """
    where = str(path)
    config = parse(JobConfig, read_toml(path), where)
    folder = path.parent
    try:
        own = machine(config.machine, folder / config.machines if config.machines else None)
        cut = None
        if config.material is not None:
            cut = material(config.material, folder / config.materials if config.materials else None)
    except SettingsError as error:
        raise SettingsFileError(f"{where}: {error}") from None
    stock: Stock | MeshStock | None = None
    if config.stock is not None:
        if "mesh" in config.stock:
            stock = parse(MeshStockConfig, config.stock, f"{where}: [stock]").build(folder)
        else:
            stock = parse(StockConfig, config.stock, f"{where}: [stock]").build()
    return Job(
        machine=own,
        material=cut,
        tools={name: tool.build(name) for name, tool in config.tools.items()},
        stock=stock,
        grid_mm=config.grid_mm,
        rate_hz=config.rate_hz,
        teeth=config.teeth,
        start=config.start,
        zero_offsets=config.zero_offsets,
        subprograms=str(folder / config.subprograms) if config.subprograms else None,
        dynamics=config.dynamics,
    )


def shipped(kind: Literal["materials", "machines"]) -> tuple[str, ...]:
    """Names that come with the package."""
    return tuple(_shipped(f"{kind}.toml"))


@cache
def _shipped(name: str) -> dict[str, Any]:
    return tomllib.loads(files("pido").joinpath("settings", name).read_text(encoding="utf-8"))


def _named(model: type[Model], kind: str, name: str, known: dict[str, Any], own: Path | None) -> Model:
    tables = {**known, **(read_toml(own) if own else {})}
    if name not in tables:
        define = f"Define it in {own}."
        if own is None:
            define = (
                f"Define it in a TOML file (docs/extending.md), and name that file in the workspace's workspace.toml: "
                f'{kind}s_file = "{kind}s.toml"; in a job file: {kind}s = "{kind}s.toml"; or to the command, by '
                "--settings where it has that."
            )
        raise SettingsError(f"{kind} '{name}' is not known. Known: {', '.join(sorted(tables))}. {define}")
    return parse(model, tables[name], f"{kind} '{name}'")
