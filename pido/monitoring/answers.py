"""What people said of alarms, and what follows from it for the band and for the next training set.

In:  answers: this alarm was false, or true.
Out: a part with false alarms only is a good part: its residuals widen the band. A true alarm's samples are neither
     learnt from nor calibrated on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pido.core.arrays import Bool1D, Float1D
from pido.core.axes import AXES
from pido.monitoring.alarms import Alarm
from pido.monitoring.residuals import PartResiduals


@dataclass(frozen=True, slots=True)
class Answer:
    alarm: Alarm
    true: bool
    by: str
    reason: str = ""


def not_to_learn_from(part: str, time: Float1D, answers: Sequence[Answer]) -> Bool1D:
    """(n,): samples of `part` inside an alarm that was answered as true, on whatever axis."""
    mask = np.zeros(len(time), bool)
    for answer in answers:
        if answer.true and answer.alarm.part == part:
            mask |= (time >= answer.alarm.t_start) & (time <= answer.alarm.t_end)
    return mask


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
