"""What laws that are looked for in all rows, and not in averages, leave of them.

In:  the residual of one axis with its noise. Out: `Judge`, which ranks terms and feels what any column takes away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.terms import Term, solve
from pido.diagnosis.whiten import Noise

WORTH = 15.0  # of 2 log likelihood: what takes less away pays for no number
_SIGNS = 6  # random columns of signs


@dataclass(frozen=True, eq=False)
class Judge:
    """Tells what terms leave of the whitened rows of a residual, (n,) in A, each by itself."""

    mismatch: Mismatch
    noise: Noise
    residual: Float1D

    @cached_property
    def _wanted(self) -> Float1D:
        """(n,) – the whitened residual."""
        return self.noise.whiten(self.residual[None])[0]

    @cached_property
    def felt(self) -> Float2D:
        """(1 + signs, n) – whose products with a column are those of that column, whitened, with the whitened
        residual, and with random signs."""
        whitening = self.noise.matrix()
        signs = np.random.default_rng(0).choice([-1.0, 1.0], (_SIGNS, len(self.residual)))
        return np.asarray((whitening.T @ np.column_stack([whitening @ self.residual, *signs])).T)

    def ranked(self, terms: Sequence[Term]) -> list[Term]:
        """The best first."""
        left = []
        for term in terms:
            columns = self.noise.whiten(term.columns(self.mismatch.states))
            left.append(-(columns @ self._wanted) @ solve(columns, self._wanted)[0])
        return [terms[k] for k in np.argsort(left)]

    def best(self, terms: Sequence[Term]) -> Term:
        return self.ranked(terms)[0]
