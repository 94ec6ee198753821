"""The control's modal state: what holds until a block changes it, and the feed and speed that follow from it.

In:  the words of a block in their order, with values (`Values`). Out: numbers of modal states in a `Path`.
The modules above it add one group of words each: `compensation`, `moves`, `work_frames`, `cycle_calls`, `block`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pido.core.machining import Tool
from pido.nc.frames import identity
from pido.nc.grammar import Coordinate
from pido.nc.offset import Element
from pido.nc.path import Modal, Path

PLANES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
Row = tuple[float, float, float, float, int, int, int]


@dataclass
class Values:
    """A block as it stands after its expressions were evaluated."""

    g: list[float] = field(default_factory=list)
    m: list[float] = field(default_factory=list)
    at: dict[str, Any] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)
    calls: list[tuple[str, tuple[Any, ...]]] = field(default_factory=list)

    def add(self, name: str, value: Any) -> None:
        if name == "G":
            self.g.append(value)
        elif name == "M":
            self.m.append(value)
        elif name in self.at:
            raise ValueError(f"word {name} stands twice in this block")
        else:
            self.at[name] = value

    def take(self, name: str, default: float | None = None) -> Any:
        value = self.at.pop(name, default)
        return value.value if isinstance(value, Coordinate) else value


class State:
    """What holds from block to block."""

    def __init__(
        self,
        tools: Mapping[str, Tool] | None,
        zero_offsets: Mapping[str, tuple[float, float, float]] | None,
        start: tuple[float, float, float] | None,
        reference: tuple[float, float, float] | None,
        m6_changes: bool,
    ) -> None:
        self.path = Path()
        self.tools, self.zero_offsets, self.reference, self.m6_changes = tools, zero_offsets, reference, m6_changes
        self.offsets: dict[str, np.ndarray] = {k.upper(): np.array(v, float) for k, v in (zero_offsets or {}).items()}
        self.position: list[float] = list(start) if start is not None else [math.nan] * 3
        self.first = list(self.position)
        self.line, self.step, self.program = 0, 0, 0
        self.motion: float | str = 0
        self.plane = 17
        self.absolute, self.scale, self.feed_mode = True, 1.0, 94
        self.feed_word = 0.0  # as programmed: mm/min, mm/rev, 1/min, or in inch
        self.feed_unit = self.feed_scale = 1.0  # mm per unit of F: of one that is programmed now, of the one that holds
        self.override = 1.0
        self.speed_word, self.direction, self.constant_speed = 0.0, 0.0, False
        self.exact, self.smoothing = True, math.nan
        self.coolant = False
        self.tool, self.preselected, self.cutting_edge = -1, -1, 1
        self.tool_names: list[str] = []
        self.offset_name, self.base, self.programmable = "G500", identity(), identity()
        self.frame = 0
        self.side = 0  # of the radius compensation: 40, 41, 42
        self.contour: list[Element] = []
        self.closing = False
        self.modal_cycle: tuple[str, tuple[Any, ...]] | None = None
        self.iso_cycle: tuple[int, dict[str, Any]] | None = None
        self.iso_return_to_start, self.iso_start = True, 0.0
        self.pole = [0.0, 0.0]
        self.polar_angle, self.polar_radius = 0.0, 0.0
        self.rounding = 0.0
        self.notes: list[str] = []
        self.renew()

    def renew(self, exact: bool | None = None) -> int:
        """The number of the modal state that now holds; call after every change of it."""
        state = Modal(
            self.frame,
            self.rpm,
            self.tool,
            self.coolant,
            self.exact if exact is None else exact,
            self.smoothing,
            self.program,
        )
        self.modal = self.path.modal(state)
        self.plain = (
            self.motion in (0, 1)
            and self.feed_mode == 94
            and self.scale == self.feed_unit == self.feed_scale == 1.0
            and self.side in (0, 40)
            and not self.contour
            and self.modal_cycle is None
            and self.iso_cycle is None
        )
        return self.modal

    @property
    def rpm(self) -> float:
        """1/min, clockwise positive."""
        if self.constant_speed:
            radius = self.radius
            if radius is None:
                raise ValueError("G96 turns a cutting speed into revolutions by the tool's diameter: give the tool")
            return self.direction * 1000.0 * self.speed_word / (2 * math.pi * radius)
        return self.direction * self.speed_word

    @property
    def radius(self) -> float | None:
        """mm, of the tool in the spindle; None where it is not in the list."""
        tool = find_tool(self.tools, self.tool_names[self.tool]) if self.tool >= 0 else None
        return tool.diameter_mm / 2 if tool else None

    def feed_for(self, length_mm: float) -> float:
        """mm/s along the path, from F and the kind of feed that holds."""
        if self.feed_word <= 0:
            raise ValueError("feed is zero: program F before this move")
        if self.feed_mode == 93:
            return self.override * self.feed_word * length_mm / 60.0
        if self.feed_mode == 95:
            if self.rpm == 0:
                raise ValueError("feed per revolution (G95) with a spindle that stands still: program S and M3 or M4")
            return self.override * self.feed_word * self.feed_scale * abs(self.rpm) / 60.0
        return self.override * self.feed_word * self.feed_scale / 60.0

    def state(self) -> tuple[Any, ...]:
        """Everything that decides what the next block does, except variables: equal states repeat for ever."""
        return (
            tuple(self.position), self.motion, self.plane, self.absolute, self.scale, self.feed_unit, self.feed_mode,
            self.feed_word, self.feed_scale, self.rpm, self.exact, self.coolant, self.tool, self.preselected,
            self.offset_name, self.side, self.modal_cycle, self.programmable.matrix.tobytes(),
            self.programmable.shift.tobytes(), self.base.shift.tobytes(), self.override,
        )  # fmt: skip

    def _row(self, feed: float) -> Row:
        x, y, z = self.position
        return (x, y, z, feed, self.line, self.modal, self.step)


def find_tool(tools: Mapping[str, Tool] | None, name: str) -> Tool | None:
    """A tool by the name in the program: as written, with or without T, in any case of letters."""
    if not tools:
        return None
    for key in (name, f"T{name}", name.removeprefix("T")):
        if key in tools:
            return tools[key]
    folded = {k.casefold(): t for k, t in tools.items()}
    return folded.get(name.casefold())
