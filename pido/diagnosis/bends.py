"""A smooth law without a name: level, slope and bend over one recorded quantity.

In:  recorded quantities. Out: `Bend`, and how much each would take away from a coarse residual.
Any smooth law is a parabola around a place where it is flat. Where that place lies away from zero, as that of a spring
or of a cable does, no power of the quantity says it, and a level beside a wave says it with more numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.diagnosis.flexible import Coarse
from pido.diagnosis.formulas import Unnamed
from pido.diagnosis.mechanisms.base import Parameter
from pido.diagnosis.signals import NO_PLACE, signals
from pido.diagnosis.state import AxisState


@dataclass(frozen=True)
class Bend(Unnamed):
    """A parabola over one quantity, within the range in which it was seen; its three numbers are in A."""

    signal: str
    seen: tuple[float, float]

    amplitudes: ClassVar[tuple[Parameter, ...]] = tuple(Parameter(f"g_{i}", "A") for i in range(3))
    shape: ClassVar[tuple[Parameter, ...]] = ()

    @property
    def equation(self) -> str:  # type: ignore[override]
        middle, half = _scale(self.seen)
        return f"dI = g_0 + g_1 * w + g_2 * w^2, w = ({self.signal} - {middle:.4g}) / {half:.4g}"

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        low, high = self.seen
        return f"depending on {self.signal} from {low:.3g} to {high:.3g}", ()

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        return _powers(signals(state, [self.signal])[self.signal][0], self.seen)


def bends(known: Mapping[str, tuple[Float1D, str]], few: Coarse) -> list[tuple[float, Bend]]:
    """Bends over every quantity that takes many values, each with what it would take away by itself."""
    root = np.sqrt(few.weights)
    out = []
    for name, (values, _) in known.items():
        if name.startswith(NO_PLACE):
            continue
        bend = Bend(name, (float(values.min()), float(values.max())))
        Q, _ = np.linalg.qr(_powers(values, bend.seen) * root[:, None])
        out.append((float(np.sum((Q.T @ (root * few.values)) ** 2)), bend))
    return out


def _powers(u: Float1D, seen: tuple[float, float]) -> Float2D:
    middle, half = _scale(seen)
    return np.vander((np.clip(u, *seen) - middle) / half, 3, increasing=True)


def _scale(seen: tuple[float, float]) -> tuple[float, float]:
    return (seen[0] + seen[1]) / 2, max((seen[1] - seen[0]) / 2, 1e-12)
