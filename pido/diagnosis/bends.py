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
from pido.diagnosis.signals import NO_PLACE, Known, signals
from pido.diagnosis.state import AxisState


@dataclass(frozen=True)
class Bend(Unnamed):
    """A parabola over one quantity, within the range in which it was seen; its three numbers are in A.

    turns : signal with whose sign it turns, as a friction does that changes with what another axis or the spindle does;
        '' for none
    """

    signal: str
    seen: tuple[float, float]
    turns: str = ""

    amplitudes: ClassVar[tuple[Parameter, ...]] = tuple(Parameter(f"g_{i}", "A") for i in range(3))
    shape: ClassVar[tuple[Parameter, ...]] = ()

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.signal, self.turns} - {""})

    @property
    def equation(self) -> str:  # type: ignore[override]
        middle, half = _scale(self.seen)
        powers = "g_0 + g_1 * w + g_2 * w^2"
        powers = f"({powers}) * sgn({self.turns})" if self.turns else powers
        return f"dI = {powers}, w = ({self.signal} - {middle:.4g}) / {half:.4g}"

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        low, high = self.seen
        turning = f", turning with {self.turns}" if self.turns else ""
        return f"depending on {self.signal} from {low:.3g} to {high:.3g}{turning}", ()

    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        return self.over(signals(state, self.reads))

    def over(self, known: Known) -> Float2D:
        """(n, 3) – what each number counts for, at values of the quantities."""
        powers = _powers(known[self.signal][0], self.seen)
        return powers * np.sign(known[self.turns][0])[:, None] if self.turns else powers


def bends(axis: str, known: Known, few: Coarse) -> list[tuple[float, Bend]]:
    """Bends over every quantity that takes many values, each with what it would take away by itself; over what the
    other axes and the spindle do, also as a friction of this one."""
    root = np.sqrt(few.weights)
    out = []
    for name, (values, _) in known.items():
        if name.startswith(NO_PLACE):
            continue
        of_others = name.startswith(("v_", "pos_", "from_")) and not name.endswith(f"_{axis}") and f"v_{axis}" in known
        for turns in ("", f"v_{axis}") if of_others else ("",):
            bend = Bend(name, (float(values.min()), float(values.max())), turns)
            Q, _ = np.linalg.qr(bend.over(known) * root[:, None])
            out.append((float(np.sum((Q.T @ (root * few.values)) ** 2)), bend))
    return out


def _powers(u: Float1D, seen: tuple[float, float]) -> Float2D:
    middle, half = _scale(seen)
    return np.vander((np.clip(u, *seen) - middle) / half, 3, increasing=True)


def _scale(seen: tuple[float, float]) -> tuple[float, float]:
    return (seen[0] + seen[1]) / 2, max((seen[1] - seen[0]) / 2, 1e-12)
