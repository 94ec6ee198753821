"""One block's words -> moves: which word means what, in which order, and what is left over.

In:  the words of a block in their order, with values (`Values`), and the modal state.
Out: rows in a `Path`. The loop over blocks, variables and jumps is in `pido.nc.interpreter`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pido.nc import words as known
from pido.nc.cycle_calls import CycleCalls
from pido.nc.frames import translation
from pido.nc.moves import CENTRE, distance
from pido.nc.path import RAPID_FEED
from pido.nc.state import PLANES, Values, find_tool


class Executor(CycleCalls):
    """The control: what a block does to its state and to the path."""

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
                self.scale, self.feed_unit = known.UNITS_G[int(g)]
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
            self.feed_word, self.feed_scale = float(b.take("F")), self.feed_unit
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
                tool = find_tool(self.tools, name)
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

    def _move(self, b: Values) -> None:
        named = any(a in b.at for a in (*known.LINEAR, "AP", "RP"))
        circular = self.motion in (2, 3, "CIP") and (named or any(c in b.at for c in (*CENTRE, "CR", "AR", "TURN")))
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
            self._to(target, self.feed_for(distance(self.position, target)))
        if self.modal_cycle is not None:
            self._run_cycle(*self.modal_cycle)

    def finish(self) -> None:
        """The end of the program."""
        self._flush()
