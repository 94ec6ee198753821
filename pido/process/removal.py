"""What each step of a path removes from the raw part.

In:  a `HeightMap`, tool tip positions in machine coordinates, and the tool of each sample.
Out: `Removal`, per step; the map is cut in place. The loop is `pido.process.sweep`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pido.core.arrays import Float1D, Float2D, Int1D
from pido.core.errors import SettingsError
from pido.core.machining import MeshStock, Stock, Tool
from pido.core.spindle_tool import tool_name
from pido.physics.frames import to_tool_frame
from pido.process.engagement import tool_shape
from pido.process.height_map import DEFAULT_GRID_MM, HeightMap, block, mesh
from pido.process.sweep import sweep


@dataclass(frozen=True, eq=False)
class Removal:
    """n samples; the entry at k belongs to the step from k - 1 to k.

    side, end : mm³ – removed by the side of the tool, and by its end going down
    offset : mm – centroid of `side`, to the left of the path; 0 where nothing is cut
    depth : mm – axial depth at the side
    before_start : mm³ – what lay where the tool stood in the first sample
    """

    side: Float1D
    end: Float1D
    offset: Float1D
    depth: Float1D
    before_start: float

    @property
    def volume(self) -> Float1D:
        """(n,), mm³: all that a step removes."""
        return self.side + self.end


def raw_part(stock: Stock | MeshStock | HeightMap, grid_mm: float = DEFAULT_GRID_MM, tool_axis: str = "z") -> HeightMap:
    """A fresh map of a raw part; a map that is given is copied, so that the caller's stays uncut."""
    if isinstance(stock, HeightMap):
        if stock.tool_axis != tool_axis:
            raise SettingsError(f"the height map is for tool axis {stock.tool_axis}, the machine's is {tool_axis}.")
        return stock.copy()
    if isinstance(stock, MeshStock):
        return mesh(Path(stock.path), grid_mm, tool_axis, stock.offset_mm)
    return block(stock, grid_mm, tool_axis)


def remove(part: HeightMap, positions: Float2D, tool_index: Int1D, tools: tuple[Tool, ...]) -> Removal:
    """Cut `part` along a path.

    Parameters
    ----------
    part : changed in place
    positions : (n, 3), mm – tool tip, machine x, y, z; a row with NaN ends one stretch, and the next begins afresh
    tool_index : (n,) – index into `tools` of the tool that makes the step ending at this sample; -1: no tool
    """
    cell = part.cell_mm
    uvw = to_tool_frame(positions, part.tool_axis)
    uvw[:, :2] = (uvw[:, :2] - part.corner) / cell
    uvw[:, 2] -= part.bottom
    shapes = [tool_shape(tool) for tool in tools] or [(0.0, 0.0, 0.0)]
    out = np.zeros((4, len(uvw)))
    sweep(
        part.cells,
        part.ceiling,
        uvw,
        np.asarray(tool_index, np.int64),
        np.array([tool.diameter_mm / 2 / cell for tool in tools] or [0.0]),
        np.array([flat / cell for flat, _, _ in shapes]),
        np.array([[corner / cell, corner] for _, corner, _ in shapes]),
        np.array([slope * cell for _, _, slope in shapes]),
        out,
    )
    side, end, moment, depth = out
    offset = np.divide(moment, side, out=np.zeros(len(side)), where=side > 0) * cell
    side, end = side * cell**2, end * cell**2
    before = float(side[0] + end[0]) if len(side) else 0.0
    if len(side):
        side[0] = end[0] = 0.0
    return Removal(side, end, offset, depth.copy(), before)


def tool_of_each_sample(tool_id, n: int, tools: Mapping[str, Tool]) -> tuple[Int1D, tuple[Tool, ...]]:
    """Index into the tools for each sample, -1 where there is none ('' or missing).

    Without a column of tools the only one is meant. Raises SettingsError for tools that are not in the list.
    """
    names = tuple(tools)
    if tool_id is None:
        if len(names) != 1:
            raise SettingsError(
                f"the recording has no column tool_id and {len(names)} tools are given ({', '.join(names)}): "
                "give the one tool that was used, the column, or tool_changes in part.json."
            )
        return np.zeros(n, np.int64), tuple(tools.values())
    values, where = np.unique([tool_name(value) for value in tool_id], return_inverse=True)
    unknown = [value for value in values if value and value not in tools]
    if unknown:
        raise SettingsError(f"tool(s) {', '.join(unknown)} are not in the list ({', '.join(names) or 'empty'}).")
    index = np.array([names.index(value) if value else -1 for value in values], np.int64)
    return index[where], tuple(tools.values())
