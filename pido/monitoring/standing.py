"""What the friction of a standing axis leaves open.

In:  model inputs, predictions for them, recorded currents.
Out: predictions that allow every current which a standing axis' friction can hold.

At rest, friction holds whatever the control asks of it, up to the friction of either direction; where in between is
decided by how the axis settled, over micrometres that no recording resolves (Dahl, A solid friction model, 1968). A
model knows only the direction of the last motion and says one end of that range, and which end turns with a swing back
that just reaches the dead band. So a current between both ends is no deviation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.core.axes import AXES, LINEAR_AXES
from pido.core.columns import INPUTS, VELOCITY
from pido.core.machining import Machine
from pido.models.inputs import NAMES

_EXTENDED = NAMES["extended"]


def other_end(predict: Mapping[str, Callable[[Float2D], Float1D]], inputs: Float2D, machine: Machine) -> Float2D:
    """(n, 4), A: as if each axis had come to rest out of the other direction; NaN where it moves, or where the
    direction is not known or no input.

    predict : per axis, from inputs (m, d) to currents (m,), A; inputs : (n, d), columns as in `models.inputs.NAMES`
    """
    found = np.full((len(inputs), len(AXES)), np.nan)
    if inputs.shape[1] != len(_EXTENDED):
        return found
    for axis in LINEAR_AXES:
        direction = _EXTENDED.index(f"direction_{axis}")
        stands = np.abs(inputs[:, INPUTS.index(VELOCITY[axis])]) <= machine.dead_band(axis)
        rows = np.flatnonzero(stands & (inputs[:, direction] != 0) & np.isfinite(inputs).all(axis=1))
        if axis in predict and len(rows):
            turned = inputs[rows]
            turned[:, direction] *= -1
            found[rows, AXES.index(axis)] = predict[axis](turned)
    return found


def explained(said: Float2D, other: Float2D, recorded: Float2D) -> Float2D:
    """(n, 4), A: of all that friction allows, what is nearest to the recorded current; `said` where `other` is NaN.

    >>> explained(np.array([[0.3, 0.3, 0.3]]), np.array([[-0.3, -0.3, np.nan]]), np.array([[0.1, 0.5, 0.1]])).tolist()
    [[0.1, 0.3, 0.3]]
    """
    other = np.where(np.isfinite(other), other, said)
    nearest = np.clip(recorded, np.minimum(said, other), np.maximum(said, other))
    return np.where(np.isfinite(recorded), nearest, said)
