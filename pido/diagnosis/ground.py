"""What a search for laws without a name starts from, whatever is left over.

In:  one axis and its noise. Out: `Ground`: signals and offers that are made once, however often it is asked what else
is left beside other terms.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pido.core.arrays import Int1D
from pido.diagnosis.flexible import coarse
from pido.diagnosis.formulas import Formula, Peak, Surface, formulas, peaks, surfaces
from pido.diagnosis.late import Lately
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.products import QuickLaws
from pido.diagnosis.signals import Known, common_signals, occasions
from pido.diagnosis.whiten import Noise


@dataclass(frozen=True, eq=False)
class Ground:
    """Signals of one axis, in all rows and in those of its averages, and what is offered over them."""

    mismatch: Mismatch
    noise: Noise

    @cached_property
    def whole(self) -> Known:
        """`common_signals`, (n,) each."""
        return common_signals(self.mismatch.states)

    @cached_property
    def seldom(self) -> Known:
        """The same, and `occasions`."""
        return {**self.whole, **occasions(self.mismatch.states)}

    @cached_property
    def rows(self) -> Int1D:
        """(m,) – those in the middle of the averages (`Coarse`)."""
        return coarse(self.mismatch, np.zeros(self.mismatch.n), self.noise).rows

    @cached_property
    def thin_seldom(self) -> Known:
        """`seldom` in the rows of the averages, (m,) each."""
        return {name: (values[self.rows], unit) for name, (values, unit) in self.seldom.items()}

    @cached_property
    def thin(self) -> Known:
        """`whole` in the rows of the averages, (m,) each."""
        return {name: self.thin_seldom[name] for name in self.whole}

    @cached_property
    def formulas(self) -> list[Formula]:
        return formulas(self.thin)

    @cached_property
    def peaks(self) -> list[tuple[Peak, dict[str, float]]]:
        return peaks(self.thin)

    @cached_property
    def surfaces(self) -> list[Surface]:
        return surfaces(self.mismatch)

    @cached_property
    def quick(self) -> QuickLaws:
        return QuickLaws(self.mismatch.axis, self.whole, self.noise)

    @cached_property
    def lately(self) -> Lately:
        return Lately(self.mismatch, self.whole, self.rows)
