"""One block's words -> moves: modal G functions, frames, feeds, spindle, tool, circles and cycles.

In:  the words of a block in their order, with values (`Values`), and the modal state.
Out: rows in a `Path`. The loop over blocks, variables and jumps is in `pido.nc.interpreter`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pido.core.machining import Tool
from pido.nc import words as known
from pido.nc.cycles import CYCLES, PATTERNS, Cycle, arguments
from pido.nc.frames import identity, scaling, translation, turn
from pido.nc.geometry import Arc, arc_by_angle, arc_by_centre, arc_by_radius, arc_from_tangent, circle_through
from pido.nc.grammar import Coordinate
from pido.nc.offset import Element, offset_contour
from pido.nc.path import RAPID_FEED, Circle, Modal, Path

PLANES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
_CENTRE = ("I", "J", "K")


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


class Executor:
    """The modal state of the control, and what a block does to it."""

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
        self.feed_word = 0.0  # as programmed: mm/min, mm/rev, 1/min
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

    # --- modal state -------------------------------------------------------------------------------------------

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
            and self.scale == 1.0
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
        tool = _find(self.tools, self.tool_names[self.tool]) if self.tool >= 0 else None
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
            return self.override * self.feed_word * self.scale * abs(self.rpm) / 60.0
        return self.override * self.feed_word * self.scale / 60.0

    def state(self) -> tuple[Any, ...]:
        """Everything that decides what the next block does, except variables: equal states repeat for ever."""
        return (
            tuple(self.position), self.motion, self.plane, self.absolute, self.scale, self.feed_mode, self.feed_word,
            self.rpm, self.exact, self.coolant, self.tool, self.preselected, self.offset_name, self.side,
            self.modal_cycle, self.programmable.matrix.tobytes(), self.programmable.shift.tobytes(),
            self.base.shift.tobytes(), self.override,
        )  # fmt: skip

    # --- a block -----------------------------------------------------------------------------------------------

    def run(self, b: Values) -> None:
        """Execute one block. Raises ValueError with what is wrong with it."""
        once_exact = suppress = moved_frame = False
        special = ""
        for g in b.g:
            if g in known.MOTION_G:
                self.motion = int(g)
                self.iso_cycle = None
            elif g in known.ISO_CYCLES_G:
                special = "iso"
                self._begin_iso(int(g), b)
            elif g == 80:
                self.iso_cycle = None
            elif g in (98, 99):
                self.iso_return_to_start = g == 98
            elif g == 4:
                special = "dwell"
            elif g == 9:
                once_exact = True
            elif g in PLANES:
                self._flush()
                self.plane = int(g)
            elif g in (25, 26):
                special = "limits"
            elif g in (40, 41, 42):
                self._compensation(int(g))
            elif g in (53, 153):
                suppress = True
            elif g in known.OFFSETS_G:
                self._work_offset(f"G{int(g)}")
                moved_frame = True
            elif g in (58, 59):
                special = f"G{int(g)}"
            elif g in (60, 61):
                self.exact, self.smoothing = True, math.nan
            elif g in known.SMOOTHING_G:
                self.exact, self.smoothing = False, math.nan
            elif g in known.UNITS_G:
                self.scale = known.UNITS_G[int(g)]
            elif g in (90, 91):
                self.absolute = g == 90
            elif g in known.FEED_G:
                self.feed_mode = int(g)
            elif g in known.SPINDLE_G:
                self.constant_speed = g in (96, 961, 962)
                self.feed_mode = {96: 95, 961: 94, 97: 95, 971: 94}.get(int(g), self.feed_mode)
            elif g in (28, 74):
                special = "reference"
            elif g in (110, 111, 112):
                special = f"G{int(g)}"
        for name in b.names:
            if name in known.FRAME_NAMES:
                special = name
            elif name in ("CIP", "CT"):
                self.motion = name
            elif name == "SUPA":
                suppress = True
        self._auxiliary(b, special)
        if "ADIS" in b.at:
            self.smoothing = b.take("ADIS") * self.scale
        self.renew(exact=True if once_exact else None)
        if special == "dwell":
            self._dwell(b)
        elif special == "limits":
            b.take("S")
        elif special in known.FRAME_NAMES:
            self._programmable(special, b)
            moved_frame = True
        elif special in ("G58", "G59"):
            shift = np.array([b.take(a, 0.0) * self.scale for a in known.LINEAR])
            self.base = translation(self.offsets.get(self.offset_name, np.zeros(3)) + shift)
            moved_frame = True
        elif special in ("G110", "G111", "G112"):
            self._set_pole(special, b)
        elif special == "reference":
            self._go_to_reference(b)
        if moved_frame:
            self._new_frame()
        if suppress:
            self._without_frame(b)
        else:
            self._move(b)
        for name, values in b.calls:
            self._call(name, values)
        self._after(b)
        left = [k for k in b.at if k not in known.NEUTRAL_ASSIGNED]
        if left:
            raise ValueError(f"word {', '.join(left)} has no meaning in this block")
        if once_exact:
            self.renew()

    def _auxiliary(self, b: Values, special: str) -> None:
        """F, S, T, D, M3/4/5, coolant; H and rotary axes at zero change nothing."""
        for word in ("S", "S1"):
            if word in b.at and special not in ("dwell", "limits"):
                self.speed_word = float(b.take(word))
        if "M1" in b.at:
            b.m.append(float(b.take("M1")))
        if "F" in b.at and special != "dwell":
            self.feed_word = float(b.take("F"))
        if "OVR" in b.at:
            self.override = float(b.take("OVR")) / 100.0
        for word in ("FRC", "FRCM", "RNDM"):
            if b.at.get(word) not in (None, 0.0):
                raise ValueError(f"{word}= is not understood; use RND= or CHF= in the block")
            b.at.pop(word, None)
        if "SPOS" in b.at:
            b.take("SPOS")
            self.direction = 0.0
        b.at.pop("H", None)
        for axis in known.ROTARY:
            if axis in b.at and b.take(axis) != 0.0:
                raise ValueError(
                    f"rotary axis {axis} leaves zero: only three axes are simulated; split the program per side"
                )
        if "T" in b.at:
            self._select(b.at.pop("T"))
        if "D" in b.at:
            self.cutting_edge = int(b.take("D"))
        for m in b.m:
            if m in known.SPINDLE_M:
                self.direction = known.SPINDLE_M[int(m)]
            if m in known.COOLANT_M:
                self.coolant = known.COOLANT_M[int(m)]
            elif m == 6:
                self._flush()
                self.tool = self.preselected
                self.direction = 0.0 if self.tool >= 0 else self.direction
                self.renew()
                self.path.dwell(self._row(RAPID_FEED), 0.0)

    def _select(self, which: Any) -> None:
        name = which if isinstance(which, str) else f"{which:g}"
        if name in ("0", ""):
            self.preselected = -1
        else:
            if self.tools:
                tool = _find(self.tools, name)
                if tool is None:
                    raise ValueError(f"tool '{name}' is not in the list; it has {', '.join(sorted(self.tools))}")
                name = next(k for k, t in self.tools.items() if t is tool)
            if name not in self.tool_names:
                self.tool_names.append(name)
            self.preselected = self.tool_names.index(name)
        if not self.m6_changes:
            self.tool = self.preselected

    def _after(self, b: Values) -> None:
        for m in b.m:
            if m in known.STOPS_M:
                self.path.dwell(self._row(RAPID_FEED), 0.0)

    def _dwell(self, b: Values) -> None:
        if "F" in b.at:
            seconds = b.take("F")
        elif "S" in b.at:
            if self.rpm == 0:
                raise ValueError("G4 S counts revolutions of a spindle that stands still")
            seconds = b.take("S") * 60.0 / abs(self.rpm)
        elif "P" in b.at:  # ISO: milliseconds, or seconds with a decimal point; both read as ms from 100 on
            p = b.take("P")
            seconds = p / 1000.0 if p >= 100 else p
        elif "X" in b.at:
            seconds = b.take("X")
        else:
            raise ValueError("G4 without F (seconds), S (revolutions) or P")
        if seconds < 0:
            raise ValueError("a dwell cannot be negative")
        self._flush()
        self.path.dwell(self._row(RAPID_FEED), float(seconds))

    # --- frames ------------------------------------------------------------------------------------------------

    def _work_offset(self, name: str) -> None:
        if name != "G500" and self.zero_offsets is not None and name not in self.offsets:
            raise ValueError(f"zero offset {name} is not given; given: {', '.join(sorted(self.offsets)) or 'none'}")
        if name != "G500" and self.zero_offsets is None and name not in self.offsets:
            note = f"zero offset {name} is not known: taken as 0, so positions are those of the workpiece"
            if note not in self.notes:
                self.notes.append(note)
        self.offset_name = name
        self.base = translation(self.offsets.get(name, np.zeros(3)))

    def set_offset(self, number: float, axis: str, value: float) -> None:
        """$P_UIFR[number, axis, TR] = value; holds from the next call of that offset on."""
        name = f"G{53 + int(number)}" if 1 <= number <= 4 else "G500" if number == 0 else f"G{500 + int(number)}"
        self.offsets.setdefault(name, np.zeros(3))[known.LINEAR.index(axis)] = value

    def _programmable(self, name: str, b: Values) -> None:
        given = {a: b.take(a) for a in known.LINEAR if a in b.at}
        values = [given.get(a, 0.0) for a in known.LINEAR]
        kind = name.removeprefix("A") if name not in ("AROT",) else "ROT"
        if kind == "TRANS":
            step = translation(np.array(values) * self.scale)
        elif kind == "ROT":
            if "RPL" in b.at:
                values = [0.0, 0.0, 0.0]
                values[PLANES[self.plane][2]] = b.take("RPL")
            step = turn(np.array(values))
        elif kind == "SCALE":
            step = scaling(np.array([given.get(a, 1.0) for a in known.LINEAR]))
            if np.any(np.diagonal(step.matrix) == 0):
                raise ValueError("a scale factor of 0 leaves nothing")
        else:
            step = scaling(np.array([-1.0 if a in given else 1.0 for a in known.LINEAR]))
        self.programmable = self.programmable.then(step) if name.startswith("A") else step

    def _new_frame(self) -> None:
        self._flush()
        machine = self.path.frames[self.frame].apply(np.array(self.position))
        frame = self.base.then(self.programmable)
        self.frame = self.path.frame(frame)
        self.position = frame.invert(machine).tolist()
        self.renew()

    def _without_frame(self, b: Values) -> None:
        """G53, G153, SUPA: this block in machine coordinates."""
        self._flush()
        held, self.frame = self.frame, 0
        frame = self.path.frames[held]
        self.position = frame.apply(np.array(self.position)).tolist()
        self.renew()
        self._move(b)
        self._flush()
        self.position = frame.invert(np.array(self.position)).tolist()
        self.frame = held
        self.renew()

    def _set_pole(self, which: str, b: Values) -> None:
        u, v, _ = PLANES[self.plane]
        start = {"G110": [self.position[u], self.position[v]], "G111": [0.0, 0.0], "G112": list(self.pole)}[which]
        given = [b.take(known.LINEAR[a]) for a in (u, v)]
        if "RP" in b.at:
            angle, radius = math.radians(b.take("AP", 0.0)), b.take("RP") * self.scale
            shift = [radius * math.cos(angle), radius * math.sin(angle)]
        else:
            shift = [(g or 0.0) * self.scale for g in given]
        self.pole = [start[0] + shift[0], start[1] + shift[1]]

    def _go_to_reference(self, b: Values) -> None:
        axes = [i for i, a in enumerate(known.LINEAR) if a in b.at or f"{a}1" in b.at]
        target = self._target(b) if any(a in b.at for a in known.LINEAR) and 28 in b.g else None
        for a in known.LINEAR:
            b.at.pop(a, None)
            b.at.pop(f"{a}1", None)
        if self.reference is None:
            raise ValueError("a move to the reference point: give its machine coordinates as `reference`")
        if target is not None:
            self._to(target, RAPID_FEED)
        held, self.frame = self.frame, 0
        frame = self.path.frames[held]
        self.position = frame.apply(np.array(self.position)).tolist()
        self.renew()
        goal = list(self.position)
        for i in axes:
            goal[i] = self.reference[i]
        self._to(goal, RAPID_FEED)
        self.position = frame.invert(np.array(self.position)).tolist()
        self.frame = held
        self.renew()

    # --- moves -------------------------------------------------------------------------------------------------

    def _target(self, b: Values) -> list[float]:
        """Programmed end, mm; an axis that is not named stays."""
        target = list(self.position)
        for i, a in enumerate(known.LINEAR):
            if a not in b.at:
                continue
            value = b.at.pop(a)
            incremental = not self.absolute
            if isinstance(value, Coordinate):
                value, incremental = value.value, value.incremental
            if not isinstance(value, (int, float)):
                raise ValueError(f"{a} is no number: {value!r}")
            value = float(value) * self.scale
            if incremental and math.isnan(self.position[i]):
                raise ValueError(f"{a} moves by a distance, but where it stands is not known: give `start`")
            target[i] = self.position[i] + value if incremental else value
        if "RP" in b.at or "AP" in b.at:
            self._polar(b, target)
        return target

    def _polar(self, b: Values, target: list[float]) -> None:
        u, v, _ = PLANES[self.plane]
        for word, name in (("AP", "polar_angle"), ("RP", "polar_radius")):
            if word not in b.at:
                continue
            value = b.at.pop(word)
            incremental = isinstance(value, Coordinate) and value.incremental
            number = value.value if isinstance(value, Coordinate) else value
            number *= self.scale if word == "RP" else 1.0
            setattr(self, name, getattr(self, name) + number if incremental else number)
        angle = math.radians(self.polar_angle)
        target[u] = self.pole[0] + self.polar_radius * math.cos(angle)
        target[v] = self.pole[1] + self.polar_radius * math.sin(angle)

    def _move(self, b: Values) -> None:
        named = any(a in b.at for a in (*known.LINEAR, "AP", "RP"))
        circular = self.motion in (2, 3, "CIP") and (named or any(c in b.at for c in (*_CENTRE, "CR", "AR", "TURN")))
        if not named and not circular:
            return
        if self.iso_cycle is not None:
            self._iso_hole(b)
            return
        corner = next((b.take(w) * self.scale for w in ("RND", "CHF", "CHR") if w in b.at), None)
        if corner:
            raise ValueError("RND=, CHF= and CHR= are not understood: write the corner as its own block")
        target = self._target(b)
        if circular:
            self._circle(target, b)
        elif self.motion == "CT":
            self._tangential(target)
        elif self.motion in (33, 331, 332):
            self._thread(target, b)
        elif self.motion == 0:
            self._to(target, RAPID_FEED)
        else:
            self._to(target, self.feed_for(_distance(self.position, target)))
        if self.modal_cycle is not None:
            self._run_cycle(*self.modal_cycle)

    def _row(self, feed: float) -> tuple[float, float, float, float, int, int, int]:
        x, y, z = self.position
        return (x, y, z, feed, self.line, self.modal, self.step)

    def _to(self, target: list[float], feed: float) -> None:
        if self.side in (41, 42) or self.closing:
            self._collect(target, feed, None)
            return
        self.position = target
        self.path.rows.append(self._row(feed))

    def _plane(self, p: list[float]) -> tuple[float, float]:
        u, v, _ = PLANES[self.plane]
        return p[u], p[v]

    def _circle(self, target: list[float], b: Values) -> None:
        if any(math.isnan(c) for c in self.position):
            raise ValueError("a circle begins where the axes stand, and that is not known: give `start`")
        if self.motion == "CIP":
            self._through(target, b)
            return
        u, v, w = PLANES[self.plane]
        start, end = self._plane(self.position), self._plane(target)
        clockwise = self.motion == 2
        turns = int(b.take("TURN", 0.0) or 0)
        centre_words = [c for c in (_CENTRE[u], _CENTRE[v]) if c in b.at]
        if "CR" in b.at:
            arc = arc_by_radius(start, end, b.take("CR") * self.scale, clockwise)
        elif "R" in b.at:
            arc = arc_by_radius(start, end, b.take("R") * self.scale, clockwise)
        elif "AR" in b.at and not centre_words:
            arc = arc_by_angle(start, end, b.take("AR"), clockwise)
        elif centre_words or "AR" in b.at:
            centre = []
            for axis, word in ((u, _CENTRE[u]), (v, _CENTRE[v])):
                value = b.at.pop(word, 0.0)
                if isinstance(value, Coordinate) and not value.incremental:
                    centre.append(value.value * self.scale)
                else:
                    value = value.value if isinstance(value, Coordinate) else value
                    centre.append(self.position[axis] + value * self.scale)
            if "AR" in b.at:
                angle = math.radians(b.take("AR")) * (-1.0 if clockwise else 1.0)
                du, dv = start[0] - centre[0], start[1] - centre[1]
                end = (
                    centre[0] + du * math.cos(angle) - dv * math.sin(angle),
                    centre[1] + du * math.sin(angle) + dv * math.cos(angle),
                )
                target[u], target[v] = end
            arc = arc_by_centre(start, end, (centre[0], centre[1]), clockwise, turns)
        else:
            raise ValueError("a circle without its centre (I, J, K), radius (CR=) or angle (AR=)")
        if turns and not centre_words:
            arc = replace(arc, sweep=arc.sweep + math.copysign(2 * math.pi * turns, arc.sweep))
        b.at.pop(_CENTRE[w], None)
        length = math.hypot(abs(arc.sweep) * (arc.radius + arc.radius_end) / 2, target[w] - self.position[w])
        self._arc(target, arc, self.feed_for(length))

    def _arc(self, target: list[float], arc: Arc, feed: float) -> None:
        if self.side in (41, 42) or self.closing:
            self._collect(target, feed, arc)
            return
        w = PLANES[self.plane][2]
        circle = self._in_space(arc, self.position[w], target[w])
        self.position = target
        self.path.circle(self._row(feed), circle)

    def _in_space(self, arc: Arc, low: float, high: float) -> Circle:
        u, v, w = PLANES[self.plane]
        sign = math.copysign(1.0, arc.sweep)
        cos, sin = math.cos(arc.start), math.sin(arc.start)

        def vector(a: float, b: float, c: float) -> tuple[float, float, float]:
            out = [0.0, 0.0, 0.0]
            out[u], out[v], out[w] = a, b, c
            return out[0], out[1], out[2]

        return Circle(
            centre=vector(arc.u, arc.v, low),
            e1=vector(cos, sin, 0.0),
            e2=vector(-sign * sin, sign * cos, 0.0),
            normal=vector(0.0, 0.0, 1.0),
            sweep=abs(arc.sweep),
            radius=arc.radius,
            radius_end=arc.radius_end,
            rise=high - low,
        )

    def _through(self, target: list[float], b: Values) -> None:
        """CIP: the circle through an intermediate point I1, J1, K1, anywhere in space."""
        a, c = np.array(self.position), np.array(target)
        middle = a.copy()
        for i, word in enumerate(("I1", "J1", "K1")):
            if word in b.at:
                value = b.at.pop(word)
                incremental = value.incremental if isinstance(value, Coordinate) else not self.absolute
                number = (value.value if isinstance(value, Coordinate) else value) * self.scale
                middle[i] = a[i] + number if incremental else number
        if self.side in (41, 42):
            raise ValueError("CIP with tool radius compensation is not understood; use G2 or G3")
        centre, normal = circle_through(a, middle, c)
        radius = float(np.linalg.norm(a - centre))
        e1 = (a - centre) / radius
        e2 = np.cross(normal, e1)
        sweep = math.atan2(float((c - centre) @ e2), float((c - centre) @ e1)) % (2 * math.pi)
        feed = self.feed_for(radius * sweep)
        self.position = target
        circle = Circle(_three(centre), _three(e1), _three(e2), _three(normal), sweep, radius, radius, 0.0)
        self.path.circle(self._row(feed), circle)

    def _tangential(self, target: list[float]) -> None:
        """CT: the circle that goes on in the direction in which the last move ended."""
        arc = arc_from_tangent(self._plane(self.position), self._plane(target), self._last_direction())
        feed_length = _distance(self.position, target)
        if arc is None:
            self._to(target, self.feed_for(feed_length))
        else:
            self._arc(target, arc, self.feed_for(abs(arc.sweep) * arc.radius))

    def _last_direction(self) -> tuple[float, float]:
        u, v, _ = PLANES[self.plane]
        rows = self.path.rows
        if not rows or self.side in (41, 42):
            raise ValueError("CT needs a move before it, without tool radius compensation")
        if (circle := self.path.circles.get(len(rows) - 1)) is not None:
            tangent = [
                math.cos(circle.sweep) * q - math.sin(circle.sweep) * p
                for p, q in zip(circle.e1, circle.e2, strict=True)
            ]
        else:
            tangent = [b - a for a, b in zip(rows[-2][:3] if len(rows) > 1 else self.first, rows[-1][:3], strict=True)]
        if math.hypot(tangent[u], tangent[v]) < 1e-12 or math.isnan(tangent[u] + tangent[v]):
            raise ValueError("CT needs a move in the working plane before it")
        return tangent[u], tangent[v]

    def _thread(self, target: list[float], b: Values) -> None:
        """G33, G331, G332: the pitch I, J or K per revolution."""
        pitch = next((abs(b.take(c)) for c in _CENTRE if c in b.at), 0.0) * self.scale
        if not pitch or not self.speed_word:
            raise ValueError("a thread needs its pitch (I, J or K) and a spindle speed")
        self._to(target, pitch * abs(self.speed_word) / 60.0)

    # --- tool radius compensation --------------------------------------------------------------------------------

    def _compensation(self, g: int) -> None:
        if g == 40:
            self.closing = bool(self.contour) and self.side in (41, 42)
            if not self.closing:
                self.side = 40
            return
        if self.contour and self.side != g:
            raise ValueError("change of side without G40 in between")
        self.side = g
        if self.cutting_edge and self.radius is None:
            raise ValueError("G41/G42 needs the tool's radius: give the tool in the list of tools")

    def _collect(self, target: list[float], feed: float, arc: Arc | None) -> None:
        _u, _v, w = PLANES[self.plane]
        what = (feed, self.line, self.modal, self.step)
        self.contour.append(Element(self._plane(self.position), self._plane(target), target[w], what, arc))
        self.position = target
        if self.closing and not self.contour[-1].is_upright:
            self._flush()

    def _flush(self) -> None:
        """Write the compensated contour down."""
        if not self.contour:
            return
        elements, closes, left = self.contour, self.closing, self.side == 41
        self.contour, self.closing = [], False
        if closes:
            self.side = 40
        radius = (self.radius or 0.0) if self.cutting_edge else 0.0
        if any(math.isnan(c) for e in elements for c in (*e.start, *e.end, e.w)):
            raise ValueError(
                "tool radius compensation begins where the axes stand, and that is not known: give `start`"
            )
        if radius > 0:
            elements = offset_contour(elements, radius, left, closes)
        u, v, w = PLANES[self.plane]
        height = elements[0].w
        if self.path.rows:
            height = self.path.rows[-1][w]
        height = elements[0].w if math.isnan(height) else height
        for e in elements:
            feed, line, modal, step = e.what
            place = [0.0, 0.0, 0.0]
            place[u], place[v], place[w] = e.end[0], e.end[1], e.w
            row = (place[0], place[1], place[2], feed, line, modal, step)
            if e.arc is None:
                self.path.rows.append(row)
            else:
                self.path.circle(row, self._in_space(e.arc, height, e.w))
            height = e.w

    def finish(self) -> None:
        """The end of the program."""
        self._flush()

    # --- cycles --------------------------------------------------------------------------------------------------

    def _call(self, name: str, values: tuple[Any, ...]) -> None:
        if name == "CYCLE800":
            if any(v not in (None, 0.0, "") for v in values[7:13]):
                raise ValueError("CYCLE800 turns the plane: only three axes are simulated; split the program per side")
            return
        if name == "MCALL":
            self.modal_cycle = None
            self.renew()
            return
        if name.startswith("MCALL "):
            self.modal_cycle = (name.removeprefix("MCALL "), values)
            if not CYCLES[self.modal_cycle[0]].at_point:
                raise ValueError(f"{self.modal_cycle[0]} does not work at points: it cannot follow MCALL")
            arguments(*self.modal_cycle)
            self.renew()
            return
        if name in PATTERNS:
            if self.modal_cycle is None:
                raise ValueError(f"{name} needs a drilling cycle before it: MCALL CYCLE81(...)")
            for u, v in PATTERNS[name](arguments(name, values)):
                self.pen_rapid(u=u, v=v)
                self._run_cycle(*self.modal_cycle)
            return
        self._run_cycle(name, values)

    def _run_cycle(self, name: str, values: tuple[Any, ...]) -> None:
        self._flush()
        cycle: Cycle = CYCLES[name]
        cycle.run(_Pen(self), arguments(name, values))

    def pen_rapid(self, u: float | None = None, v: float | None = None, w: float | None = None) -> None:
        self._to(self._pen_target(u, v, w), RAPID_FEED)

    def _pen_target(self, u: float | None, v: float | None, w: float | None) -> list[float]:
        target = list(self.position)
        for axis, value in zip(PLANES[self.plane], (u, v, w), strict=True):
            if value is not None:
                target[axis] = float(value)
        return target

    def _begin_iso(self, g: int, b: Values) -> None:
        """G73, G81-G89: hold R (safe plane), Z (depth), Q (step), P (dwell) until G80 or another motion."""
        w = known.LINEAR[PLANES[self.plane][2]]
        held = self.iso_cycle[1] if self.iso_cycle else {}
        if self.iso_cycle is None:
            self.iso_start = self.position[PLANES[self.plane][2]]
        for word in ("R", w, "Q", "P"):
            if word in b.at:
                held = {**held, ("Z" if word == w else word): b.at.pop(word)}
        for word in ("K", "L"):
            if word in b.at and b.take(word) != 1:
                raise ValueError("repeated holes (K or L) are not understood: write each position")
        if "Z" not in held or "R" not in held:
            raise ValueError(f"G{g} needs the depth {w} and the plane R")
        self.iso_cycle = (g, held)
        if not any(a in b.at for a in known.LINEAR):
            u = known.LINEAR[PLANES[self.plane][0]]
            b.at[u] = Coordinate(0.0, True)

    def _iso_hole(self, b: Values) -> None:
        assert self.iso_cycle is not None
        g, held = self.iso_cycle
        w = PLANES[self.plane][2]
        for word in ("R", known.LINEAR[w], "Q", "P"):
            if word in b.at:
                held["Z" if word == known.LINEAR[w] else word] = b.at.pop(word)
        target = self._target(b)
        self._to(target, RAPID_FEED)
        plane = held["R"] * self.scale if self.absolute else self.iso_start + held["R"] * self.scale
        depth = held["Z"] * self.scale if self.absolute else plane + held["Z"] * self.scale
        back = self.iso_start if self.iso_return_to_start and not math.isnan(self.iso_start) else plane
        wait = held.get("P", 0.0)
        values: dict[str, Any] = {"RTP": back, "RFP": plane, "SDIS": 0.0, "DP": depth, "DPR": None}
        values |= {"DTB": wait / 1000.0 if wait >= 100 else wait}
        values |= {"FDEP": None, "FDPR": (held.get("Q") or 0.0) * self.scale, "DAM": 0.0, "DTS": 0.0, "FRF": 1.0}
        values["VARI"] = 1 if g == 83 else 0
        name = {73: "CYCLE83", 83: "CYCLE83", 85: "CYCLE85", 86: "CYCLE88", 89: "CYCLE89"}.get(g, "CYCLE81")
        CYCLES[name].run(_Pen(self), values)


class _Pen:
    """A cycle's view of the executor: plane coordinates, feeds in mm/s."""

    def __init__(self, executor: Executor) -> None:
        self._e = executor

    @property
    def feed_mm_s(self) -> float:
        return self._e.feed_for(1.0)

    @property
    def rpm(self) -> float:
        return self._e.rpm

    @property
    def tool_radius_mm(self) -> float | None:
        return self._e.radius

    @property
    def position(self) -> tuple[float, float, float]:
        u, v, w = PLANES[self._e.plane]
        p = self._e.position
        return p[u], p[v], p[w]

    def rapid(self, u: float | None = None, v: float | None = None, w: float | None = None) -> None:
        self._e.pen_rapid(u, v, w)

    def feed(
        self, u: float | None = None, v: float | None = None, w: float | None = None, rate: float | None = None
    ) -> None:
        e = self._e
        target = e._pen_target(u, v, w)
        e._to(target, rate if rate else e.feed_for(_distance(e.position, target)))

    def arc(
        self, u: float, v: float, centre_u: float, centre_v: float, clockwise: bool, rate: float | None = None
    ) -> None:
        e = self._e
        target = e._pen_target(u, v, None)
        arc = arc_by_centre(e._plane(e.position), (u, v), (centre_u, centre_v), clockwise)
        e._arc(target, arc, rate if rate else e.feed_for(abs(arc.sweep) * arc.radius))

    def dwell(self, seconds: float) -> None:
        self._e.path.dwell(self._e._row(RAPID_FEED), seconds)

    def spindle(self, rpm: float) -> None:
        e = self._e
        e.direction = math.copysign(1.0, rpm) if rpm else 0.0
        if rpm:
            e.speed_word = abs(rpm)
        e.renew()


def _find(tools: Mapping[str, Tool] | None, name: str) -> Tool | None:
    """A tool by the name in the program: as written, with or without T, in any case of letters."""
    if not tools:
        return None
    for key in (name, f"T{name}", name.removeprefix("T")):
        if key in tools:
            return tools[key]
    folded = {k.casefold(): t for k, t in tools.items()}
    return folded.get(name.casefold())


def _distance(a: list[float], b: list[float]) -> float:
    d = math.dist(a, b)
    return 0.0 if math.isnan(d) else d


def _three(v: Any) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])
