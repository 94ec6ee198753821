"""What a model is given: the 13 inputs of the paper (eq. 4), and the direction in which each axis last moved.

An axis at standstill holds friction with the sign of its last motion, which no velocity shows. On a real machine that
one extra input took 59 to 67 % off the error of the feed axes, more than any generated sample.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from pido.core.arrays import Float2D
from pido.core.axes import AXES
from pido.core.columns import INPUTS
from pido.core.samples import Samples

InputKind = Literal["paper", "extended"]
NAMES: dict[InputKind, tuple[str, ...]] = {
    "paper": INPUTS,
    "extended": (*INPUTS, *(f"direction_{axis}" for axis in AXES)),
}


def model_inputs(samples: Samples, kind: InputKind) -> Float2D:
    """(n, 13) or (n, 17), columns as in NAMES[kind]."""
    return samples.inputs if kind == "paper" else np.column_stack([samples.inputs, samples.direction])
