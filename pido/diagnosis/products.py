"""What products of two recorded quantities would take away, all of them at once.

In:  quantities, and a residual: its averages, or all its rows with their noise.
Out: formulas and arms, and what each takes away.
Averages over the memory of the noise hold what is slow. What is quicker than that memory, as everything that follows an
acceleration is, cancels in them: it is looked for in the whitened rows.
Source: the size of whitened columns that are never formed, by random signs (Hutchinson 1989, Commun. Stat. 18, 1059).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from pido.core.arrays import Float1D, Int1D
from pido.diagnosis.arms import Arm, arm_of
from pido.diagnosis.flexible import Coarse
from pido.diagnosis.formulas import FORMS, Formula, formulas
from pido.diagnosis.signals import Known
from pido.diagnosis.whiten import Noise

_QUICK = 12  # formulas, and arms, that are looked at more closely
_THIRDS = 3  # products of a law with one more quantity, that are looked at more closely
_SIGNS = 16  # random columns of signs: sizes come out to a third, which is enough to rank by
_LEAST = 1e-6  # of the usual size of a column: a smaller one is zero nearly everywhere

_APART = 1e-3  # of the size of a product, that its first factor leaves: what is less is that factor again

_Matrix = NDArray[np.floating]


def gains_by_averages(offered: Sequence[Formula], known: Known, few: Coarse) -> list[tuple[Formula, float]]:
    """Formulas of one or two factors, each with what it would take away from the averages by itself."""
    factors, first, second = _factors_of(offered)
    rows = _rows(factors, known, len(few.rows))
    inner = (rows * (few.weights * few.values)) @ rows.T
    size = (rows**2 * few.weights) @ (rows**2).T
    gain = np.where(size > 0, inner**2 / np.maximum(size, 1e-300), 0.0)
    return list(zip(offered, gain[first, second].tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class QuickLaws:
    """The formulas and arms of one axis, by what they take away from whitened rows.

    known : `common_signals` of the axis, (n,) each; seed : of the random signs
    within : (n,) – how much of each row lies in the box in which the laws act; everywhere, where it is not given
    """

    axis: str
    known: Known
    noise: Noise
    seed: int = 0
    within: Float1D | None = None

    @cached_property
    def _offered(self) -> list[Formula]:
        return formulas(self.known)

    @cached_property
    def _factors(self) -> tuple[list[tuple[str, str] | None], list[int], list[int]]:
        return _factors_of(self._offered)

    @cached_property
    def _rows(self) -> NDArray[np.float32]:
        return _rows(self._factors[0], self.known, len(self.noise.valid)).astype(np.float32)

    @cached_property
    def _whitening(self) -> csr_array:
        return self.noise.matrix()

    @cached_property
    def _columns(self) -> NDArray[np.float32]:
        """(signs, n) – random columns of signs, taken back through the whitening: what meets them is not whitened."""
        signs = np.random.default_rng(self.seed).choice([-1.0, 1.0], (_SIGNS, len(self.noise.valid)))
        return np.array([self._back(s) for s in signs])

    @cached_property
    def _signs(self) -> _Matrix:
        """(signs, factors, factors) – of every product, whitened, with random columns of signs."""
        return np.array([self._inner(s) for s in self._columns])

    def _back(self, whitened: Float1D) -> NDArray[np.float32]:
        back = self._whitening.T @ whitened
        return (back if self.within is None else back * self.within).astype(np.float32)

    def _inner(self, weights: NDArray[np.float32]) -> _Matrix:
        """(factors, factors) – of every product with a column."""
        return ((self._rows * weights) @ self._rows.T).astype(float)

    def best(self, residual: Float1D) -> list[Formula | Arm]:
        """Those that take away most of a residual, (n,) in A."""
        factors, first, second = self._factors
        products = _Sketch(self._inner(self._back(self._whitening @ residual)), self._signs)
        best = [self._offered[k] for k in _ranked(products.gains(first, second))[:_QUICK]]
        both = [pair for f in self._offered if len(f.factors) > 1 for pair in (f.factors, f.factors[::-1])]
        at = {f: i for i, f in enumerate(factors)}
        ranked = _ranked(products.gains_beside([at[u] for u, _ in both], [at[w] for _, w in both]))
        arms = (arm_of(self.axis, self.known, *both[k]) for k in ranked)
        return [*best, *itertools.islice((arm for arm in arms if arm is not None), _QUICK)]

    def of_one_more(self, residual: Float1D, law: Formula) -> list[Formula]:
        """Products of a law with one more quantity, those that take away most of a residual, (n,) in A."""
        factors = self._factors[0]
        at = {f: i for i, f in enumerate(factors)}
        product = np.prod(self._rows[[at[f] for f in law.factors]], axis=0)
        towards = self._rows @ (product * self._back(self._whitening @ residual))
        size = np.mean((self._rows @ (product * self._columns).T) ** 2, axis=1)
        gains = towards**2 / np.maximum(size, _LEAST * np.median(size) + 1e-30)
        ranked = (factors[k] for k in _ranked(gains))
        more = (f for f in ranked if f is not None and law.may_have(f))
        return [law.times(f, _range(self.known[f[0]][0])) for f in itertools.islice(more, _THIRDS)]


def _range(values: Float1D) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def _ranked(gains: Float1D) -> Int1D:
    """Places of the gains, the largest first; of equal ones the first."""
    return np.argsort(-gains, kind="stable")


@dataclass(frozen=True)
class _Sketch:
    """Products of factors i and j, whitened, of which only inner products are known.

    towards : (i, j) – with a residual
    signs : (signs, i, j) – with random columns of signs, which tell sizes and angles
    """

    towards: _Matrix
    signs: _Matrix

    def gains(self, i: Sequence[int], j: Sequence[int]) -> Float1D:
        """(k,) – what the products take away, each by itself."""
        size = np.mean(self.signs[:, i, j] ** 2, axis=0)
        return self.towards[i, j] ** 2 / np.maximum(size, _LEAST * np.median(size) + 1e-300)

    def gains_beside(self, i: Sequence[int], j: Sequence[int]) -> Float1D:
        """(k,) – what they take away together with their first factor."""
        none = [0] * len(i)
        alone, both = self.signs[:, i, none], self.signs[:, i, j]
        size = np.maximum(np.mean(alone**2, axis=0), 1e-300)
        share = np.mean(alone * both, axis=0) / size
        left = np.mean((both - share * alone) ** 2, axis=0)
        towards = self.towards[i, j] - share * self.towards[i, none]
        return self.gains(i, none) + np.where(
            left > _APART * np.mean(both**2, axis=0), towards**2 / np.maximum(left, 1e-300), 0.0
        )


def _factors_of(offered: Sequence[Formula]) -> tuple[list[tuple[str, str] | None], list[int], list[int]]:
    """Different factors, None for one, and which two of them make each formula."""
    factors = [None, *dict.fromkeys(f for formula in offered for f in formula.factors)]
    at = {f: i for i, f in enumerate(factors)}
    second = [at[f.factors[1]] if len(f.factors) > 1 else 0 for f in offered]
    return factors, [at[f.factors[0]] for f in offered], second


def _rows(factors: Sequence[tuple[str, str] | None], known: Known, n: int) -> _Matrix:
    """(factors, n), each at its own scale: squares of products overflow otherwise."""
    rows = np.array([np.ones(n) if f is None else FORMS[f[1]](known[f[0]][0]) for f in factors])
    return rows / np.maximum(np.max(np.abs(rows), axis=1, keepdims=True), 1e-300)
