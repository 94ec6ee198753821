"""What is wrong with a program and its raw part, before anything runs.

In:  toolpath (tool tip, machine coordinates), raw part, tools, machine.
Out: nothing, or one ProgramError that names every place.

The check cuts a copy of the raw part along the programmed segments themselves, so it does not depend on a sample rate.
"""

from __future__ import annotations

import numpy as np

from pido.core.arrays import Float1D, Float2D, Int1D
from pido.core.errors import ProgramError
from pido.core.machining import Machine, Tool
from pido.nc.toolpath import DWELL, Toolpath
from pido.physics.frames import to_tool_frame
from pido.process.height_map import HeightMap
from pido.process.removal import Removal, remove, tool_of_each_sample

SCRATCH_MM = 0.02
"""A rapid along a finished wall may touch it by less than this; more is a gouge."""
TRACE_MM3 = 1e-3
CLEARANCE_DIAMETERS = 2.0
CLEARANCE_MM = 10.0
"""Feed moves may begin and end this far outside the raw part (or two tool diameters, whichever is more)."""


def check_program(toolpath: Toolpath, part: HeightMap, tools: dict[str, Tool], machine: Machine) -> float:
    """Volume that the program removes, mm³; `part` stays uncut.

    Raises ProgramError, all places together: a raw part smaller than the path of the feed moves, no feed move in it at
    all, a start inside it, a rapid through it (gouge), a cut with the spindle at rest.
    """
    moves = toolpath.take(toolpath.kind != DWELL)
    if not len(moves):
        raise ProgramError("the program moves nothing: there is nothing to cut.")
    index, used = tool_of_each_sample(moves.tool_id, len(moves), tools)
    name = toolpath.programs[0] if toolpath.programs else "program"
    _check_size(name, moves, part, index, used)
    # Every segment as a step of its own: sample 2k puts the tool at its start, sample 2k + 1 makes the cut.
    positions = np.empty((2 * len(moves), 3))
    positions[0::2], positions[1::2] = moves.start, moves.end
    removal = remove(part.copy(), positions, np.repeat(index, 2), used)
    volume = removal.volume[1::2] + removal.volume[0::2]
    faults = []
    if removal.before_start > TRACE_MM3:
        faults.append(
            f"the path starts inside the raw part: {removal.before_start:.3g} mm³ of it are where the tool stands. "
            "Give the start position, or check zero offset and raw part"
        )
    rest = np.abs(moves.spindle_rpm) * 6.0 <= machine.spindle_dead_band_deg_s
    for wrong, what in (
        (moves.is_rapid & _gouges(removal, moves, part.tool_axis), "gouge: a rapid runs through the raw part"),
        (~moves.is_rapid & rest & (volume > TRACE_MM3), "the tool cuts while the spindle stands still"),
    ):
        faults += _places(moves, wrong, volume, what)
    if not faults and not (volume[~moves.is_rapid] > TRACE_MM3).any():
        low, high = moves.start.min(0), moves.start.max(0)
        faults.append(
            "no feed move meets the raw part: the path runs from "
            f"{_point(low)} to {_point(high)}. Check zero offsets and stock; for an air cut leave the stock out"
        )
    if faults:
        raise ProgramError("\n".join(f"{name}: {fault}." for fault in faults))
    return float(volume.sum())


def _gouges(removal: Removal, moves: Toolpath, tool_axis: str):
    step = to_tool_frame(moves.end - moves.start, tool_axis)
    across = np.hypot(step[:, 0], step[:, 1])
    return removal.volume[1::2] > TRACE_MM3 + SCRATCH_MM * removal.depth[1::2] * across


def _check_size(name: str, moves: Toolpath, part: HeightMap, index: Int1D, used: tuple[Tool, ...]) -> None:
    ends = np.stack([to_tool_frame(moves.start, part.tool_axis), to_tool_frame(moves.end, part.tool_axis)])
    cutting = ~moves.is_rapid & (index >= 0) & (ends[..., 2].min(axis=0) < part.top)
    if not cutting.any():
        return
    diameters = [used[i].diameter_mm for i in np.unique(index[cutting])]
    clearance = max(CLEARANCE_MM, CLEARANCE_DIAMETERS * max(diameters))
    size = np.array([part.cells.shape[2], part.cells.shape[1]]) * part.cell_mm
    low = np.append(part.corner, part.bottom) - clearance
    high = np.append(part.corner + size, np.inf) + clearance
    outside = ((ends < low) | (ends > high)).any(axis=(0, 2)) & cutting
    if outside.any():
        k = int(np.argmax(outside))
        u, v = part.corner, part.corner + size
        raise ProgramError(
            f"{name}: the raw part is smaller than the path. {int(outside.sum())} feed move(s) reach more than "
            f"{clearance:g} mm beyond it, the first in line {moves.nc_line[k]} at {_point(moves.end[k])}; "
            f"across the tool the raw part reaches from {_point(u)} to {_point(v)} mm. Check stock and zero offsets."
        )


def _places(moves: Toolpath, wrong, volume: Float1D, what: str) -> list[str]:
    """One sentence per source line in which something is wrong, in order, at most ten."""
    hit = np.flatnonzero(wrong)
    lines = dict.fromkeys((int(moves.program[i]), int(moves.nc_line[i])) for i in hit)
    text = []
    for program, line in list(lines)[:10]:
        at = hit[(moves.nc_line[hit] == line) & (moves.program[hit] == program)]
        source = f" of {moves.programs[program]}" if program > 0 and program < len(moves.programs) else ""
        text.append(f"line {line}{source}: {what} ({volume[at].sum():.3g} mm³, towards {_point(moves.end[at[0]])})")
    if len(lines) > 10:
        text.append(f"and {len(lines) - 10} more lines: {what}")
    return text


def _point(values: Float1D | Float2D) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in values) + ")"
