"""The path as the interpreter writes it down, and its conversion to a `Toolpath`.

In:  ends of lines, circles and dwells in programmed coordinates, each with the modal state that holds for it.
Out: `Toolpath` in machine coordinates; circles flattened all at once, frames applied per group of segments.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.nc.frames import Frame, identity
from pido.nc.geometry import chords
from pido.nc.toolpath import ARC, DWELL, FEED, RAPID, Toolpath

SAGITTA_MM = 0.002
RAPID_FEED = -1.0
"""Stands for "as fast as the axes go" in a row's feed."""


@dataclass(frozen=True, slots=True)
class Circle:
    """A circle or helix in programmed coordinates: p(a) = centre + r (cos a e1 + sin a e2) + rise a/sweep normal."""

    centre: tuple[float, float, float]
    e1: tuple[float, float, float]
    e2: tuple[float, float, float]
    normal: tuple[float, float, float]
    sweep: float  # rad, >= 0
    radius: float  # mm
    radius_end: float  # mm
    rise: float  # mm along normal


@dataclass(frozen=True, slots=True)
class Modal:
    """What holds for a segment besides its geometry."""

    frame: int
    rpm: float
    tool: int
    coolant: bool
    exact: bool
    smoothing: float  # mm, NaN: the machine's own
    program: int


@dataclass
class Path:
    """Rows (x, y, z, feed mm/s or RAPID_FEED, line, modal id, step), in the order of execution."""

    rows: list[tuple[float, float, float, float, int, int, int]] = field(default_factory=list)
    circles: dict[int, Circle] = field(default_factory=dict)
    dwells: dict[int, float] = field(default_factory=dict)
    frames: list[Frame] = field(default_factory=lambda: [identity()])
    modals: dict[Modal, int] = field(default_factory=dict)

    def modal(self, modal: Modal) -> int:
        """The number under which `modal` is kept."""
        return self.modals.setdefault(modal, len(self.modals))

    def frame(self, frame: Frame) -> int:
        self.frames.append(frame)
        return len(self.frames) - 1

    def circle(self, row: tuple[float, float, float, float, int, int, int], circle: Circle) -> None:
        self.circles[len(self.rows)] = circle
        self.rows.append(row)

    def dwell(self, row: tuple[float, float, float, float, int, int, int], seconds: float) -> None:
        self.dwells[len(self.rows)] = seconds
        self.rows.append(row)

    def toolpath(
        self,
        start: Float1D | None,
        tools: tuple[str, ...],
        programs: tuple[str, ...],
        notes: tuple[str, ...],
    ) -> Toolpath:
        """Everything written so far. Axes whose start is unknown start where they are first sent."""
        table = np.array(self.rows, dtype=float).reshape(-1, 7)
        n = len(table)
        arc_rows = np.fromiter(self.circles, np.int64, len(self.circles))
        ends, sag, owner = self._flattened(table, arc_rows)
        modals = list(self.modals)
        modal = table[owner, 5].astype(np.int64)
        frame_of = np.array([m.frame for m in modals] or [0])
        frame = frame_of[modal]
        for f in np.unique(frame):
            rows = frame == f
            ends[rows] = self.frames[f].apply(ends[rows])
            sag[rows] = sag[rows] @ self.frames[f].matrix.T
        origin = np.full(3, np.nan) if start is None else np.asarray(start, float)
        points = _known(np.vstack([origin, ends]))
        seconds = np.zeros(n)
        seconds[list(self.dwells)] = list(self.dwells.values())
        is_dwell = np.zeros(n, bool)
        is_dwell[list(self.dwells)] = True
        feed = table[:, 3]
        kind = np.where(is_dwell, DWELL, np.where(feed < 0, RAPID, FEED))
        kind[arc_rows] = ARC
        last = np.r_[owner[1:] != owner[:-1], True] if len(owner) else np.zeros(0, bool)

        def of(name: str, dtype: type) -> np.ndarray:
            return np.array([getattr(m, name) for m in modals], dtype=dtype)[modal] if modals else np.zeros(0, dtype)

        path = Toolpath(
            start=points[:-1],
            end=points[1:],
            sag=sag,
            kind=kind[owner],
            feed=np.where(np.isin(kind[owner], (FEED, ARC)), feed[owner], np.nan),
            spindle_rpm=of("rpm", float),
            tool=of("tool", np.int64),
            coolant=of("coolant", bool),
            nc_line=table[owner, 4].astype(np.int64),
            program=of("program", np.int64),
            block=table[owner, 6].astype(np.int64),
            exact_stop=(of("exact", bool) | is_dwell[owner]) & last,
            smoothing=of("smoothing", float),
            dwell=seconds[owner],
            tools=tools,
            programs=programs,
            notes=notes,
        )
        moves = np.any(path.start != path.end, axis=1) | np.any(path.sag != 0, axis=1) | (path.kind == DWELL)
        return path.take(moves)

    def _flattened(self, table: Float2D, arc_rows: np.ndarray) -> tuple[Float2D, Float2D, np.ndarray]:
        """Ends (k, 3), sagitta vectors (k, 3) and the row that each segment belongs to (k,)."""
        n = len(table)
        if not len(arc_rows):
            return table[:, :3].copy(), np.zeros((n, 3)), np.arange(n)
        circles = list(self.circles.values())
        vectors = [np.array([getattr(c, name) for c in circles]) for name in ("centre", "e1", "e2", "normal")]
        numbers = [np.array([getattr(c, name) for c in circles]) for name in ("sweep", "radius", "radius_end", "rise")]
        per_arc, arc_ends, arc_sag = chords(*vectors, *numbers, sagitta_mm=SAGITTA_MM)  # type: ignore[misc]
        count = np.ones(n, np.int64)
        count[arc_rows] = per_arc
        owner = np.repeat(np.arange(n), count)
        ends, sag = table[owner, :3].copy(), np.zeros((len(owner), 3))
        is_arc = np.zeros(n, bool)
        is_arc[arc_rows] = True
        ends[is_arc[owner]], sag[is_arc[owner]] = arc_ends, arc_sag
        # A block ends exactly where it says, whatever rounding its centre has.
        final = np.cumsum(count)[arc_rows] - 1
        ends[final] = table[arc_rows, :3]
        return ends, sag, owner


def _known(points: Float2D) -> Float2D:
    """Unknown coordinates (NaN, only before an axis was first sent somewhere) take the first known value, or 0."""
    for axis in range(3):
        known = np.flatnonzero(~np.isnan(points[:, axis]))
        first = points[known[0], axis] if len(known) else 0.0
        points[np.isnan(points[:, axis]), axis] = first
    return points
