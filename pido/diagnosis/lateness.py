"""By how much the recording of a part comes after the simulation, and a simulated current as it is seen so much later.

In:  offset, drift and steps of one part; a signal over its time.
Out: seconds per row; the moved signal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import Akima1DInterpolator

from pido.core.arrays import Float1D


@dataclass(frozen=True, slots=True)
class Late:
    """offset + drift * t, and from the time of each step on its size more.

    offset : s; drift : s/s
    steps : (from, size), s each, in order of time. Samples that are lost while the time column runs on are a step of
        negative size, samples that are repeated one of positive size; both hold to the end of the part.

    >>> Late(0.0, 0.0, ((2.0, -0.05),)).at(np.array([1.0, 2.0, 3.0])).tolist()
    [0.0, -0.05, -0.05]
    """

    offset: float = 0.0
    drift: float = 0.0
    steps: tuple[tuple[float, float], ...] = ()

    def __bool__(self) -> bool:
        return bool(self.offset or self.drift or any(size for _, size in self.steps))

    def at(self, time: Float1D) -> Float1D:
        """(n,), s"""
        late = self.offset + self.drift * time
        for start, size in self.steps:
            late = late + size * (time >= start)
        return late


Seen = Callable[[Late], Float1D]
"""A signal, (n,), as it is seen so much later."""


def shifted(time: Float1D, values: Float1D, late: Late) -> Float1D:
    """The signal as it is seen `late`; held at the ends."""
    return curved(time, values)(late)


def curved(time: Float1D, values: Float1D) -> Seen:
    """The signal as it is seen at any time, held at the ends.

    Between samples by cubics that hardly overshoot beside a step (Akima 1970, as modified in scipy): straight lines
    and monotone cubics cut the peaks, and what is cut then looks like a part of the shift.
    """
    good = np.isfinite(values)
    if np.sum(good) < 2:
        return lambda late: values
    first, last = time[good][0], time[good][-1]
    curve = Akima1DInterpolator(time[good], values[good], method="makima")
    return lambda late: curve(np.clip(time - late.at(time), first, last))


def straight(time: Float1D, values: Float1D) -> Seen:
    """As `curved`, with straight lines between samples."""
    good = np.isfinite(values)
    if not good.any():
        return lambda late: values
    return lambda late: np.interp(time - late.at(time), time[good], values[good])
