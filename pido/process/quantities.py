"""Removal rate, engagement and forces along a path, as columns of a recording (paper, section III-B).

In:  a recording (measured or planned: only its positions, time, spindle speed and tool are used), raw part, tools,
     material, machine.
Out: the recording with `f_x_sim` ... `f_sp_sim`, `m_sp_sim`, `mrr_sim`, and the engagement behind them: `a_p`, `a_e`
     (mm), `phi_s` (rad).

Positions are those of the tool tip, in the coordinates in which the raw part is given.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np

from pido.core.arrays import Array1D, Bool1D, Float1D, Float2D
from pido.core.axes import LINEAR_AXES
from pido.core.columns import FORCE_SIM, POSITION, VELOCITY
from pido.core.errors import RecordingError
from pido.core.machining import Machine, Material, MeshStock, Stock, Tool
from pido.core.recording import Recording
from pido.core.spindle_tool import tool_in_spindle
from pido.physics.cutting import (
    end_cutting_forces,
    engaged_teeth,
    feed_per_tooth,
    forces_on_tool,
    kienzle_forces,
    mean_chip_thickness,
    spindle_force,
    spindle_torque,
)
from pido.physics.frames import to_machine_frame, to_tool_frame
from pido.process.engagement import engagement
from pido.process.height_map import DEFAULT_GRID_MM, HeightMap
from pido.process.removal import Removal, raw_part, remove, tool_of_each_sample
from pido.process.steps import Steps

Teeth = Literal["one", "mean"]
ENGAGEMENT = ("a_p", "a_e", "phi_s")
"""Columns beside the contract's."""
TRACE_MM3 = 1e-3
"""A step that removes less is a touch within the accuracy of the path, not a cut."""


def process_quantities(
    recording: Recording,
    *,
    stock: Stock | MeshStock | HeightMap,
    tools: Mapping[str, Tool],
    material: Material,
    machine: Machine,
    grid_mm: float = DEFAULT_GRID_MM,
    teeth: Teeth = "one",
) -> Recording:
    """The recording with its process quantities; `stock` itself stays uncut.

    Every quantity at a sample is the mean of the step before and the step after it, so it is centred in time, and the
    sum of MRR times time is the removed volume.

    Parameters
    ----------
    stock : block, mesh, or the map that an earlier operation left (`removal.raw_part`, `removal.remove`)
    tools : by id as in the column tool_id or in tool_changes; exactly one where there is neither
    teeth : 'one' – the force of one tooth, as the paper prints it; 'mean' – times the teeth in the cut on average

    Raises SettingsError for a tool that is not in the list, RecordingError for a missing column.
    """
    positions = _linear(recording, POSITION)
    index, used = tool_of_each_sample(_tool_id(recording, tools, machine), len(recording), tools)
    part = raw_part(stock, grid_mm, machine.tool_axis)
    removal = remove(part, positions, index, used)

    time = recording.time
    v_sp = recording["v_sp"]
    standing = np.abs(v_sp) <= machine.spindle_dead_band_deg_s
    steps = Steps.of(time, to_tool_frame(positions, machine.tool_axis), removal)
    mrr = steps.both(removal.volume) / steps.duration

    n = len(recording)
    load = _Load.empty(n)
    for m, tool in enumerate(used):
        rows = index == m
        if rows.any():
            speed = np.where(standing, 0.0, v_sp)[rows]
            load.put(rows, _load(tool, steps.rows(rows), speed, material, teeth))

    unknown = np.isnan(positions).any(axis=1)
    columns = dict(
        zip((FORCE_SIM[a] for a in LINEAR_AXES), to_machine_frame(load.force, machine.tool_axis).T, strict=True)
    )
    columns |= {"f_sp_sim": load.f_sp, "m_sp_sim": load.m_sp, "mrr_sim": mrr}
    columns |= {"a_p": load.a_p, "a_e": load.a_e, "phi_s": load.phi_s}
    columns = {name: np.where(unknown, np.nan, values) for name, values in columns.items()}
    result = recording.with_columns(**columns)
    return _with_notes(result, removal, int(np.isnan(load.f_sp).sum()))


def _tool_id(recording: Recording, tools: Mapping[str, Tool], machine: Machine) -> Array1D | None:
    """(n,) text – tool in the spindle; None where the only one is meant. Raises RecordingError where the spindle turns
    before the first of the tool changes, with which tool nobody says."""
    tool = tool_in_spindle(recording)
    if tool is None or "tool_id" in recording:
        return tool
    if len(tools) == 1 and set(tool) <= {"", *tools}:
        return None
    turning = (tool == "") & (np.abs(recording["v_sp"]) > machine.spindle_dead_band_deg_s)
    if turning.any():
        first = min(change.t for change in recording.part.tool_changes)
        raise RecordingError(
            f"part {recording.part.part}: the spindle turns before the first of tool_changes (t = {first:g} s), and "
            "nothing says with which tool. Add that one to tool_changes with t = 0, or the column tool_id."
        )
    return tool


def area_removal(recording: Recording) -> Float1D:
    """AR = MRR / ||v|| in mm² (paper, section III-D); 0 where nothing is removed or nothing moves.

    Needs `mrr_sim` and `v_x`, `v_y`, `v_z`.
    """
    mrr = recording["mrr_sim"]
    speed = np.linalg.norm(_linear(recording, VELOCITY), axis=1)
    ar = np.divide(mrr, speed, out=np.zeros(len(mrr)), where=(speed > 0) & (mrr > 0))
    return np.where(np.isnan(mrr) | np.isnan(speed), np.nan, ar)


@dataclass(frozen=True, eq=False)
class _Load:
    """What the tool feels, (n,) each and force (n, 3) along u, v, w; N, N·m, mm, rad."""

    force: Float2D
    f_sp: Float1D
    m_sp: Float1D
    a_p: Float1D
    a_e: Float1D
    phi_s: Float1D

    @classmethod
    def empty(cls, n: int) -> _Load:
        return cls(np.zeros((n, 3)), *(np.zeros(n) for _ in range(5)))

    def put(self, rows: Bool1D, part: _Load) -> None:
        for field in fields(self):
            getattr(self, field.name)[rows] = getattr(part, field.name)


def _load(tool: Tool, steps: Steps, speed: Float1D, material: Material, teeth: Teeth) -> _Load:
    """Load of one tool; `speed` is the spindle's, deg/s, 0 where it stands still."""
    state = engagement(tool, steps.side, steps.end, steps.offset, steps.depth, steps.across, steps.down)
    kappa = np.radians(tool.kappa_deg)
    f_z, f_axial = (
        np.where(cuts > 0, feed_per_tooth(way / steps.duration, speed, tool.teeth), 0.0)
        for cuts, way in ((steps.side, steps.across), (steps.end, steps.down))
    )
    h_m = mean_chip_thickness(f_z, state.a_e, np.where(state.d_eff > 0, state.d_eff, 1.0), state.phi_s, kappa)
    tooth = kienzle_forces(state.edge_depth, h_m, material, kappa)
    disc = np.pi * tool.diameter_mm**2 / 4
    end = end_cutting_forces(f_axial, np.minimum(state.end_area / disc, 1.0), tool.diameter_mm / 2, material, kappa)
    if teeth == "mean":
        tooth = tooth * engaged_teeth(state.phi_s, tool.teeth)[:, None]
        end = end * tool.teeth
    middle = (state.alpha_low + state.alpha_high) / 2
    force = forces_on_tool(tooth, middle, steps.angle, np.where(speed < 0, -1.0, 1.0))
    f_sp = spindle_force(force) + end[:, 0]
    force[:, 2] += end[:, 1]
    return _Load(force, f_sp, spindle_torque(f_sp, tool.diameter_mm), state.a_p, state.a_e, state.phi_s)


def _linear(recording: Recording, columns: Mapping[str, str]) -> Float2D:
    return np.column_stack([np.asarray(recording[columns[a]], float) for a in LINEAR_AXES])


def _with_notes(recording: Recording, removal: Removal, unknown: int) -> Recording:
    notes = [f"process quantities: {removal.volume.sum():.4g} mm³ removed"]
    if removal.before_start > TRACE_MM3:
        notes.append(
            f"process quantities: the first sample stands in the raw part; {removal.before_start:.4g} mm³ count as "
            "removed before it"
        )
    if unknown:
        notes.append(
            f"process quantities: in {unknown} samples material is removed with the spindle at rest; there is no "
            "force law for that, so forces are missing there (is the raw part where it was?)"
        )
    return replace(recording, notes=(*recording.notes, *notes))
