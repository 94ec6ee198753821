"""The step before a sample and the step after it, taken together: quantities centred in time.

In:  time, tool tip in the tool's frame, and what each step removed.
Out: per sample the duration, way and removal of its two steps.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from pido.core.arrays import Bool1D, Float1D, Float2D
from pido.process.removal import Removal


@dataclass(frozen=True, eq=False)
class Steps:
    """The two steps around each sample, taken together; (n,) each, in mm, mm³, s, rad."""

    duration: Float1D
    across: Float1D
    down: Float1D
    angle: Float1D
    side: Float1D
    end: Float1D
    offset: Float1D
    depth: Float1D

    @classmethod
    def of(cls, time: Float1D, uvw: Float2D, removal: Removal) -> Steps:
        step = np.diff(uvw, axis=0, prepend=uvw[:1])
        across = np.hypot(step[:, 0], step[:, 1])
        side = cls.both(removal.side)
        moment = cls.both(removal.side * removal.offset)
        # The direction of the step that cuts more; where neither does, of the whole.
        weight = np.where(cls.both(removal.side) > 0, removal.side, 1.0)
        # A path that turns by 180 degrees between two samples has no mean direction: any of the two will do.
        u, v = (cls.both(np.nan_to_num(step[:, i]) * np.nan_to_num(weight)) for i in (0, 1))
        return cls(
            duration=np.maximum(cls.both(np.diff(time, prepend=time[:1])), 1e-12),
            across=cls.both(np.nan_to_num(across)),
            down=cls.both(np.nan_to_num(np.maximum(-step[:, 2], 0.0))),
            angle=np.arctan2(v, u),
            side=side,
            end=cls.both(removal.end),
            offset=np.divide(moment, side, out=np.zeros(len(side)), where=side > 0),
            depth=np.maximum(removal.depth, np.append(removal.depth[1:], 0.0)),
        )

    def rows(self, which: Bool1D) -> Steps:
        """The samples that a mask selects."""
        return Steps(**{f.name: getattr(self, f.name)[which] for f in fields(self)})

    @staticmethod
    def both(per_step: Float1D) -> Float1D:
        """The step before a sample plus the step after it."""
        return per_step + np.append(per_step[1:], 0.0)
