"""What an interpreted program asks of the machine: path segments in machine coordinates, as arrays.

In:  the interpreter's segments, in the order in which they are executed.
Out: `Toolpath`. Arcs stand as short chords, each with the vector from the middle of the chord to the arc, so that
     `p(u) = start + u (end - start) + 4 u (1 - u) sag`, u in 0..1, is the arc to a fraction of a micrometre and keeps
     its curvature: a consumer that wants straight lines ignores `sag`, one that wants accelerations uses it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from pido.core.arrays import Array1D, Bool1D, Float1D, Float2D, Int1D

RAPID, FEED, ARC, DWELL = 0, 1, 2, 3
KINDS = ("rapid", "feed", "arc", "dwell")


@dataclass(frozen=True, eq=False)
class Toolpath:
    """n segments; one NC block may have several (arc, cycle) or none.

    start, end : (n, 3), mm, machine coordinates x, y, z
    sag : (n, 3), mm – from the middle of the chord to the arc; zero on straight segments
    kind : (n,) – RAPID, FEED, ARC or DWELL (a dwell has no length)
    feed : (n,), mm/s along the path; NaN where `kind` is RAPID or DWELL
    spindle_rpm : (n,), 1/min – commanded, clockwise (M3) positive
    tool : (n,) – index into `tools`, -1 before the first tool
    coolant : (n,) – on or off
    nc_line : (n,) – line in its source text, from 1
    program : (n,) – index into `programs`: main program or subprogram that the line belongs to
    block : (n,) – running number of the executed block: tells the passes of a loop apart
    exact_stop : (n,) – the axes come to rest at the end of the segment (G60, G9, a stop by M or T)
    smoothing : (n,), mm – how far the corner at the end may be rounded (ADIS with G641); NaN: the machine's own value
    dwell : (n,), s – waiting time, before nothing else happens
    """

    start: Float2D
    end: Float2D
    sag: Float2D
    kind: Int1D
    feed: Float1D
    spindle_rpm: Float1D
    tool: Int1D
    coolant: Bool1D
    nc_line: Int1D
    program: Int1D
    block: Int1D
    exact_stop: Bool1D
    smoothing: Float1D
    dwell: Float1D
    tools: tuple[str, ...] = ()
    programs: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.kind)

    @property
    def is_rapid(self) -> Bool1D:
        """(n,): the segment is traversed at the axes' own speed (G0)."""
        return self.kind == RAPID

    @property
    def length(self) -> Float1D:
        """(n,), mm: length along the path; on arcs that of the arc (series in sag / chord, error below 1e-6 of it)."""
        chord = np.linalg.norm(self.end - self.start, axis=1)
        sag = np.linalg.norm(self.sag, axis=1)
        ratio = np.divide(sag, chord, out=np.zeros_like(chord), where=chord > 0)
        return chord * (1 + 8 / 3 * ratio**2 - 32 / 5 * ratio**4)

    @property
    def tool_id(self) -> Array1D:
        """(n,) of str: the tool in the spindle, '' before the first."""
        return np.array([*self.tools, ""], dtype=object)[self.tool]

    def take(self, which: slice | Array1D) -> Toolpath:
        """The segments that a slice, mask or index array selects."""
        arrays = (f.name for f in fields(self) if f.name not in ("tools", "programs", "notes"))
        return replace(self, **{name: getattr(self, name)[which] for name in arrays})

    def moved(self, by_mm: tuple[float, float, float]) -> Toolpath:
        """The same path, translated (mm): a work offset that became known later."""
        by = np.asarray(by_mm, float)
        return replace(self, start=self.start + by, end=self.end + by)
