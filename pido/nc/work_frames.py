"""Words that say where zero is: work offsets, TRANS, ROT, SCALE, MIRROR, the pole, the reference point.

In:  a block's values. Out: the frame that holds; the position is told anew in it.
"""

from __future__ import annotations

import math

import numpy as np

from pido.nc import words as known
from pido.nc.frames import scaling, translation, turn
from pido.nc.moves import Moves
from pido.nc.path import RAPID_FEED
from pido.nc.state import PLANES, Values


class WorkFrames(Moves):
    """Frames between the program's coordinates and the machine's."""

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
