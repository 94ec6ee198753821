"""The raw part as a map of heights across the tool, with walls placed inside the cells.

In:  a block (`Stock`) or a closed triangle mesh (STL and other formats), in the coordinates of the path.
Out: `HeightMap`, which `pido.process.removal` cuts.

A map holds one height per cell: undercuts below an overhang count as solid. Everything is kept in the tool's frame
(u, v across the tool, w along it), so that a horizontal spindle needs no second code.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pido.core.arrays import Float1D, Float2D
from pido.core.errors import SettingsError, SettingsFileError
from pido.core.machining import Stock
from pido.physics.frames import TOOL_FRAME, to_tool_frame
from pido.process.cells import COV, FIELDS, LOW, N_U, N_V, TOP

DEFAULT_GRID_MM = 0.1
MAX_CELLS = 40_000_000
"""800 MB: a larger map is refused with the grid that would fit."""


@dataclass(eq=False)
class HeightMap:
    """Heights over a grid across the tool; `removal.remove` changes `cells` in place.

    cells : (5, n_v, n_u) float32 – per cell top, low, share at low, normal of the wall; heights in mm above `bottom`
    corner : (2,), mm – u and v of the grid's lower corner
    bottom : mm – w of the raw part's underside
    cell_mm : edge of a cell
    tool_axis : machine axis along which the tool points
    ceiling : highest `top` of the uncut part, mm; nothing above it needs a look
    """

    cells: NDArray[np.float32]
    corner: Float1D
    bottom: float
    cell_mm: float
    tool_axis: str = "z"
    ceiling: float = field(default=-1.0)

    def __post_init__(self) -> None:
        if self.ceiling < 0:
            self.ceiling = float(self.cells[TOP].max(initial=0.0))

    def copy(self) -> HeightMap:
        """A map that can be cut without changing this one."""
        return HeightMap(self.cells.copy(), self.corner.copy(), self.bottom, self.cell_mm, self.tool_axis, self.ceiling)

    @property
    def top(self) -> float:
        """Highest w of the uncut part, mm."""
        return self.bottom + self.ceiling

    @property
    def volume(self) -> float:
        """Volume of what is left, mm³."""
        cells = self.cells.astype(np.float64)
        mean = cells[COV] * cells[LOW] + (1 - cells[COV]) * cells[TOP]
        return float(mean.sum()) * self.cell_mm**2

    @property
    def heights(self) -> Float2D:
        """(n_v, n_u), mm: mean height of each cell, as w."""
        cells = self.cells.astype(np.float64)
        return self.bottom + cells[COV] * cells[LOW] + (1 - cells[COV]) * cells[TOP]


def block(stock: Stock, grid_mm: float = DEFAULT_GRID_MM, tool_axis: str = "z") -> HeightMap:
    """A block as a map; its faces may lie anywhere between the grid's lines.

    Raises SettingsError where the map would be too large for the grid.
    """
    low, high = (to_tool_frame(np.array([corner]), tool_axis)[0] for corner in (stock.low_mm, stock.high_mm))
    n_u, n_v = _size(high[:2] - low[:2], grid_mm)
    cells = np.zeros((FIELDS, n_v, n_u), np.float32)
    cells[TOP] = high[2] - low[2]
    # The last row and column may reach beyond the block: that part of the cell is already removed.
    for view, count, length, normal in (
        (cells[:, :, -1], n_u, high[0] - low[0], N_U),
        (cells[:, -1, :], n_v, high[1] - low[1], N_V),
    ):
        beyond = count - length / grid_mm
        if beyond > 1e-6:
            inside = (1 - view[COV]) * (1 - beyond)
            view[COV] = 1 - inside
            view[[N_U, N_V]] = 0.0
            view[normal] = -1.0
    return HeightMap(cells, low[:2].copy(), float(low[2]), grid_mm, tool_axis)


def mesh(path: Path, grid_mm: float = DEFAULT_GRID_MM, tool_axis: str = "z", offset_mm=(0.0, 0.0, 0.0)) -> HeightMap:
    """A raw part from a mesh file (STL binary or ASCII, OBJ, PLY, OFF), in mm, moved by `offset_mm`.

    Each cell takes the height of the upper surface over its centre.

    Raises SettingsFileError for a file that is missing, unreadable, empty, or flat.
    """
    import trimesh

    if not path.is_file():
        raise SettingsFileError(f"{path}: no such raw part.")
    try:
        loaded = trimesh.load_mesh(str(path))
    except Exception as error:  # trimesh raises whatever its parsers raise
        raise SettingsFileError(f"{path}: not a mesh that can be read ({error}). Export it as STL, in mm.") from error
    triangles = np.asarray(getattr(loaded, "triangles", np.zeros((0, 3, 3))), float)
    if not len(triangles) or not np.isfinite(triangles).all():
        raise SettingsFileError(f"{path}: holds no triangles with finite corners. Export the raw part as STL, in mm.")
    return from_triangles(triangles + np.asarray(offset_mm, float), grid_mm, tool_axis, where=str(path))


def from_triangles(triangles, grid_mm: float, tool_axis: str = "z", where: str = "raw part") -> HeightMap:
    """The upper surface of triangles (m, 3 corners, 3), mm in machine coordinates, as a map."""
    uvw = np.ascontiguousarray(np.asarray(triangles, float)[..., TOOL_FRAME[tool_axis]])
    low, high = uvw.reshape(-1, 3).min(0), uvw.reshape(-1, 3).max(0)
    if (high - low <= 0).any():
        raise SettingsFileError(f"{where}: has no volume (size {np.round(high - low, 3).tolist()} mm).")
    n_u, n_v = _size(high[:2] - low[:2], grid_mm)
    # Centred, so that both outer columns reach equally far beyond the part.
    corner = low[:2] - 0.5 * (np.array([n_u, n_v]) * grid_mm - (high[:2] - low[:2]))
    cells = np.zeros((FIELDS, n_v, n_u), np.float32)
    uvw[..., :2] = (uvw[..., :2] - corner) / grid_mm
    uvw[..., 2] -= low[2]
    _drape(uvw, cells)
    return HeightMap(cells, corner, float(low[2]), grid_mm, tool_axis)


def _size(lengths: Float1D, grid_mm: float) -> tuple[int, int]:
    if not grid_mm > 0:
        raise SettingsError(f"grid_mm is {grid_mm}; it must be above 0.")
    n_u, n_v = (max(int(np.ceil(length / grid_mm - 1e-6)), 1) for length in lengths)
    if n_u * n_v > MAX_CELLS:
        fits = grid_mm * np.sqrt(n_u * n_v / MAX_CELLS)
        raise SettingsError(
            f"a raw part of {lengths[0]:.0f} x {lengths[1]:.0f} mm at grid_mm = {grid_mm} needs {n_u * n_v / 1e6:.0f} "
            f"million cells (limit {MAX_CELLS / 1e6:.0f}). Use grid_mm = {np.ceil(fits * 100) / 100:.2f} or more."
        )
    return n_u, n_v


@njit(cache=True, error_model="numpy")
def _drape(uvw, cells):
    """Raise each cell to the highest triangle over its centre (u, v in cells)."""
    for m in range(len(uvw)):
        a, b, c = uvw[m, 0], uvw[m, 1], uvw[m, 2]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if area == 0.0:
            continue
        i0 = max(int(np.floor(min(a[0], b[0], c[0]) - 0.5)), 0)
        i1 = min(int(np.ceil(max(a[0], b[0], c[0]) + 0.5)), cells.shape[2])
        j0 = max(int(np.floor(min(a[1], b[1], c[1]) - 0.5)), 0)
        j1 = min(int(np.ceil(max(a[1], b[1], c[1]) + 0.5)), cells.shape[1])
        for j in range(j0, j1):
            for i in range(i0, i1):
                x, y = i + 0.5, j + 0.5
                r = ((b[0] - x) * (c[1] - y) - (c[0] - x) * (b[1] - y)) / area
                s = ((c[0] - x) * (a[1] - y) - (a[0] - x) * (c[1] - y)) / area
                if r >= -1e-9 and s >= -1e-9 and r + s <= 1 + 1e-9:
                    w = np.float32(r * a[2] + s * b[2] + (1 - r - s) * c[2])
                    if w > cells[TOP, j, i]:
                        cells[TOP, j, i] = w
