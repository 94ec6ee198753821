"""What people said of alarms, and what follows from it for the band.

In:  answers: this alarm was false, or true.
Out: a part with false alarms only is a good part: its residuals widen the band. A true alarm's samples are not
     calibrated on; what is not learnt from is in `pido.monitoring.records`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pido.core.axes import AXES
from pido.monitoring.alarms import Alarm
from pido.monitoring.residuals import PartResiduals


@dataclass(frozen=True, slots=True)
class Answer:
    alarm: Alarm
    true: bool
    by: str
    reason: str = ""


def to_calibrate_on(
    parts: Sequence[PartResiduals], alarms: Sequence[Alarm], answers: Sequence[Answer]
) -> list[PartResiduals]:
    """Parts as a band may learn from them: without the samples of true alarms, and of alarms nobody has answered yet,
    on the axis of the alarm. What was answered as false stays in, and widens the band."""
    false = {answer.alarm for answer in answers if not answer.true}
    out = []
    for part in parts:
        residual = part.residual.copy()
        for alarm in {*alarms, *(answer.alarm for answer in answers)} - false:
            if alarm.part == part.part:
                inside = (part.time >= alarm.t_start) & (part.time <= alarm.t_end)
                residual[inside, AXES.index(alarm.axis)] = np.nan
        out.append(replace(part, residual=residual))
    return out
