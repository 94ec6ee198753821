"""Every mechanism that data could show, at every point of its shape grid, and what one more of them would bring.

In:  one axis of all parts, its noise, and terms of the catalogue.
Out: `Library`, the terms chosen already as a `Basis`, and the `Score` of each further term.
Source: variable projection (Golub and Pereyra 1973): amplitudes drop out of the search, only shapes are searched;
extended BIC (Chen and Chen 2008) charges a mechanism for the number of shapes that were tried on its behalf.
"""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, csr_array

from pido.core.arrays import Array2D, Bool1D, Float1D, Float2D
from pido.diagnosis.boxes import Space, of_unit_length, own_products, space_of
from pido.diagnosis.gates import inside
from pido.diagnosis.ground import Ground
from pido.diagnosis.mechanisms.base import Mechanism
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.state import AxisState
from pido.diagnosis.terms import Term, bic
from pido.diagnosis.whiten import Noise
from pido.physics.drive import AT_ONCE, Loop

COLLINEAR = 1e-3  # share of a regressor's power that must be left once the terms already chosen are taken out of it
_FEW = 3  # columns that may be a line or a parabola
_DEPENDENT = 1e-6  # of its length, that a column has beside those before it where they are the same
_LIMITS_TRIED = 60  # limits of a region that a search looks at per step
_FEW_ROWS = 100  # in either direction, below which the sign of a current is taken as it comes
_CLEARLY_NEGATIVE = 0.2  # of the current's root mean square
_BEFORE = 2.5  # times a row itself, in units of noise, that the whitened row may be
_CHUNK = 64  # rows whitened at a time
_REMEMBERED = 128  # terms, and gates, whose rows are kept at hand
_FORBIDDEN_SE = 2.5  # standard errors by which an amplitude may lie outside its plausible range


@dataclass(frozen=True, slots=True)
class Score:
    """What one more term would bring: gain in whitened sum of squares, BIC and amplitudes."""

    term: Term
    gain: float
    bic: float
    amplitudes: Float1D

    @property
    def cost(self) -> float:
        return self.bic


class Library:
    """Every mechanism at every point of its shape grid, as rows of one array.

    any_sign : names whose amplitude may have any sign, because the simulation contains them
    loop : behind which all terms are that pass one
    """

    def __init__(
        self,
        mismatch: Mismatch,
        terms: Sequence[Term],
        any_sign: frozenset[str] = frozenset(),
        collinear: float = COLLINEAR,
        loop: Loop = AT_ONCE,
    ) -> None:
        self.mismatch = mismatch
        self.loop = loop
        self.any_sign = any_sign
        self.collinear = collinear
        self.polarity = polarity(mismatch)
        self.terms: list[Term] = []
        self.everywhere = lru_cache(_REMEMBERED)(lambda term: term.columns(mismatch.states))
        self.inside = lru_cache(_REMEMBERED)(lambda gate: np.concatenate([inside(s, (gate,)) for s in mismatch.states]))
        self.varies: list[bool] = []  # whether a term takes more than one value
        self.spans: list[tuple[int, int]] = []
        self.rows = np.zeros((0, mismatch.n), np.float32)
        # Of laws without a name, under one noise: what they are looked for from, and those found beside which terms.
        self.ground: Ground | None = None
        self.nameless: dict[tuple[Term, ...], Nameless] = {}
        self.take(terms)

    def on(self, mismatch: Mismatch) -> Library:
        """The same rows, counted in other blocks."""
        other = copy.copy(self)
        other.mismatch = mismatch
        return other

    def take(self, terms: Sequence[Term]) -> None:
        """Take in more terms; all are to be whitened then."""
        mismatch, loop, rows, first = self.mismatch, self.loop, [self.rows], len(self.rows)
        counted = None if mismatch.usable.all() else np.flatnonzero(mismatch.usable)
        for term in (t.behind(loop) for t in terms):
            columns = _used(term, term.columns(mismatch.states).astype(np.float32))
            seen = columns if counted is None else columns[:, counted]
            least, most = seen.min(axis=1, initial=np.inf), seen.max(axis=1, initial=-np.inf)
            if not np.any((least < 0) | (most > 0)):
                continue
            rows.append(columns)
            self.terms.append(term)
            self.varies.append(bool(np.any(most > least)))
            self.spans.append((first, first + len(columns)))
            first += len(columns)
        self.rows = np.concatenate(rows)
        # What a friction does at rest makes it no other law: a claim of friction is not charged for it.
        tried = {(t.name, tuple(p for p in t.shape if p[0] != "rest")) for t in self.terms}
        self.tries = Counter(name for name, _ in tried)
        self.whitened = self.rows
        self.grams: list[Float2D] = []
        self._own = np.zeros(0)
        self._single = np.zeros(0, bool)
        self.noise: Noise | None = None

    @cached_property
    def space(self) -> Space | None:
        """The reduced space in which a term may be confined, None where nothing varies."""
        return space_of(self.mismatch)

    @cached_property
    def whitening(self) -> csr_array:
        """(n, n) – the matrix of the present noise."""
        assert self.noise is not None
        return self.noise.matrix()

    @cached_property
    def whitening_late(self) -> csr_array:
        """(n, n) – the same of what the loop answers late: of rows as they are before it."""
        late = [self.loop.matrix(s.time) for s in self.mismatch.states]
        return csr_array(self.whitening @ csr_array(block_diag(late)))

    @cached_property
    def of_themselves(self) -> NDArray[np.float32]:
        """The whitened rows without what came before them (see the function), of unit length."""
        assert self.noise is not None
        out = np.empty_like(self.rows)
        for i in range(0, len(self.rows), _CHUNK):
            some = slice(i, i + _CHUNK)
            out[some] = of_unit_length(of_themselves(self.noise, self.whitened[some], self.rows[some]))
        return out

    @cached_property
    def in_groups(self) -> list[NDArray[np.float32]]:
        """Per term, (pairs, groups): `own_products` of its rows of themselves, over the groups of the coarse grid."""
        assert self.space is not None
        return [own_products(self.space.coarse, self.of_themselves[i:j]) for i, j in self.spans]

    def whiten(self, noise: Noise) -> None:
        """From now on, under this noise."""
        if noise is self.noise:
            return
        self.noise = noise
        for remembered in ("whitening", "whitening_late", "of_themselves", "in_groups"):
            self.__dict__.pop(remembered, None)
        self.whitened = np.empty_like(self.rows)
        for i in range(0, len(self.rows), _CHUNK):
            self.whitened[i : i + _CHUNK] = noise.whiten(self.rows[i : i + _CHUNK])
        self.grams = [np.asarray(self.whitened[i:j] @ self.whitened[i:j].T, float) for i, j in self.spans]
        self._own = np.concatenate([np.diag(g) for g in self.grams]) if self.grams else np.zeros(0)
        self._single = np.repeat([j - i == 1 for i, j in self.spans], [j - i for i, j in self.spans])

    def columns(self, term: Term) -> Float2D:
        """(k, n), A per unit of the amplitude; what was asked for lately is remembered."""
        if term.loop:
            return self.everywhere(replace(term, name=""))
        values = self.everywhere(Term(term.mechanism, term.shape))
        for gate in term.gates:
            values = values * self.inside(gate)
        return values

    def charge(self, term: Term) -> float:
        """BIC for the shapes and the limits of a region that were tried on a term's behalf."""
        return 2 * np.log(max(1, self.tries.get(term.name, 1))) + len(term.gates) * 2 * np.log(_LIMITS_TRIED)

    def screen(self, current: Basis) -> list[Score]:
        """One more term of the library, each at its grid point; implausible amplitudes are left out."""
        onto = np.asarray(self.whitened @ current.Q32.T, float)
        with_residual = np.asarray(self.whitened @ current.residual32, float)
        single = self._single
        left = self._own - np.einsum("ij,ij->i", onto, onto)
        open_ = single & (left > self.collinear * np.maximum(self._own, 1e-30))
        gain = np.where(open_, with_residual**2 / np.where(open_, left, 1.0), 0.0)
        out = []
        for k, (term, (i, j)) in enumerate(zip(self.terms, self.spans, strict=True)):
            if not single[i]:
                score = self._score(term, self.grams[k], onto[i:j], with_residual[i:j], current)
                if score is not None:
                    out.append(score)
            elif 0 < gain[i] < current.rss:
                beta = with_residual[i : i + 1] / left[i]
                sd = np.sqrt(current.rss / current.n / left[i : i + 1])
                if term.name in self.any_sign or plausible(term.mechanism, self.polarity * beta, sd):
                    out.append(self._scored(term, float(gain[i]), beta, 1, current))
        return out

    def score(self, term: Term, current: Basis) -> Score | None:
        """The same for one term anywhere in its shape space."""
        assert self.noise is not None
        columns, turned = told_apart(term, self.columns(term))
        # A cube of a jerk is beyond what single precision holds; by powers of two nothing is rounded.
        size = np.exp2(np.frexp(np.max(np.abs(columns), axis=1, initial=0.0))[1].astype(float))
        rows = self.noise.whiten((columns / size[:, None]).astype(np.float32))
        gram, onto, inner = rows @ rows.T, rows @ current.Q32.T, rows @ current.residual32
        found = self._score(term, gram * np.outer(size, size), onto * size[:, None], inner * size, current)
        return found if found is None or turned is None else replace(found, amplitudes=turned @ found.amplitudes)

    def _score(self, term: Term, gram: Float2D, onto: Float2D, inner: Float1D, current: Basis) -> Score | None:
        own = np.diag(gram)
        left = gram - onto @ onto.T
        keep = np.diag(left) > self.collinear * np.maximum(own, 1e-30)
        if not keep.any() or own.max() <= 0:
            return None
        beta = np.zeros(len(own))
        sub = left[np.ix_(keep, keep)]
        size = np.sqrt(np.diag(sub))
        values, vectors = np.linalg.eigh(sub / np.outer(size, size))
        good = values > self.collinear
        inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T / np.outer(size, size)
        beta[keep] = inverse @ inner[keep]
        gain = float(beta @ inner)
        if not 0 < gain < current.rss:
            return None
        if term.name not in self.any_sign:
            sd = np.zeros(len(own))
            sd[keep] = np.sqrt(np.diag(inverse) * current.rss / current.n)
            if not plausible(term.mechanism, self.polarity * beta, sd):
                return None
        return self._scored(term, gain, beta, int(good.sum()), current)

    def _scored(self, term: Term, gain: float, beta: Float1D, rank: int, current: Basis) -> Score:
        free = current.free + rank + term.free
        return Score(term, gain, bic(current.rss - gain, current.n, free) + current.searched + self.charge(term), beta)


@dataclass(frozen=True)
class Nameless:
    """Laws without a name that say most beside some terms, each in the shape that was looked at first, and the best of
    them all; the likeliest first."""

    laws: list[Score]
    best: list[Score]


@dataclass(frozen=True)
class Basis:
    """Terms already chosen, orthogonal and whitened.

    Q : (q, n) orthonormal; residual : (n,) whitened; searched : charge for shapes tried
    """

    Q: Float2D
    residual: Float1D
    rss: float
    n: int
    free: int
    searched: float

    @property
    def bic(self) -> float:
        return bic(self.rss, self.n, self.free) + self.searched

    @cached_property
    def Q32(self) -> NDArray[np.float32]:
        """`Q` in single precision, which is enough to compare additions."""
        return self.Q.astype(np.float32)

    @cached_property
    def residual32(self) -> NDArray[np.float32]:
        """`residual` in single precision."""
        return self.residual.astype(np.float32)


def basis(library: Library, noise: Noise, terms: Sequence[Term]) -> Basis:
    """The basis of the mismatch's base and `terms` under `noise`."""
    m = library.mismatch
    columns = [library.columns(t) for t in terms]
    X = noise.whiten(np.concatenate([m.base, *columns])) if len(m.base) or terms else np.zeros((0, m.n))
    y = noise.whiten(m.target[None])[0]
    Q = orthonormal(X)
    residual = y - (Q @ y) @ Q
    free = len(m.base) + sum(len(c) - t.idle + t.free for t, c in zip(terms, columns, strict=True))
    searched = sum(library.charge(t) for t in terms)
    return Basis(Q, residual, float(residual @ residual), int(noise.valid.sum()), free, float(searched))


def orthonormal(X: Float2D) -> Float2D:
    """(q, n) orthonormal rows that span the rows of X; dependent rows are dropped."""
    if len(X) == 0:
        return X
    size = np.sqrt(np.einsum("ij,ij->i", X, X))
    X = X[size > 0] / size[size > 0, None]
    values, vectors = np.linalg.eigh(X @ X.T)
    keep = values > 1e-9 * max(len(X), 1)
    Q = (vectors[:, keep] / np.sqrt(values[keep])).T @ X
    # A second pass restores orthogonality that the Gram matrix of a badly conditioned set loses.
    values, vectors = np.linalg.eigh(Q @ Q.T)
    return (vectors / np.sqrt(values)).T @ Q


def told_apart(term: Term, columns: Float2D) -> tuple[Float2D, Float2D | None]:
    """The columns of a law without a name as orthogonal ones, and what takes their amplitudes back to its own; None
    where they are its own.

    k_0 + k_1 pos is a line, wherever on the machine its places are: far from zero both columns are nearly alike.
    """
    if term.name != "unknown" or not 1 < len(columns) <= _FEW or not columns.any(axis=1).all():
        return columns, None
    size = np.sqrt(np.einsum("ij,ij->i", columns, columns))
    Q, R = np.linalg.qr((columns / size[:, None]).T)
    if np.min(np.abs(np.diag(R))) < _DEPENDENT:
        return columns, None
    return Q.T, np.linalg.inv(R) / size[:, None]


def _used(term: Term, columns: NDArray[np.float32]) -> NDArray[np.float32]:
    """The columns up to the last one that the form of a term has; all of them where an amplitude has a plausible range,
    by its place."""
    free = all(p.low is None and p.high is None for p in term.mechanism.amplitudes)
    used = np.flatnonzero(columns.any(axis=1))
    return columns[: used[-1] + 1] if term.idle and free and len(used) else columns


def plausible(mechanism: Mechanism, beta: Float1D, sd: Float1D) -> bool:
    """No amplitude outside its physical range by more than its uncertainty."""
    if len(mechanism.amplitudes) != len(beta):
        return True
    low = np.array([_or(p.low, -np.inf) for p in mechanism.amplitudes])
    high = np.array([_or(p.high, np.inf) for p in mechanism.amplitudes])
    return bool(np.all(beta > low - _FORBIDDEN_SE * sd) and np.all(beta < high + _FORBIDDEN_SE * sd))


def _or(value: float | None, default: float) -> float:
    return default if value is None else value


def polarity(mismatch: Mismatch) -> float:
    """+1 where a positive current drives the axis in its positive direction, -1 where it is counted the other way.

    Read from the current itself: friction brakes and mass resists, so on the whole the current has the sign of the
    motion and of its change. The process pushes either way: its force is fitted beside them, and samples without it
    are taken where there are enough. A constant (weight) is told apart only by an axis that goes both ways.
    """
    current = mismatch.target + (mismatch.sim if mismatch.sim is not None and not len(mismatch.base) else 0.0)
    direction, a, force, idle = (
        np.concatenate(rows)
        for rows in zip(*((s.along, s.a, _or_zero(s.force, s.v), _idle(s)) for s in mismatch.states), strict=True)
    )
    rows = mismatch.usable & np.isfinite(current)

    def both_ways(among: Bool1D) -> bool:
        return all(np.sum(among & (side * direction > 0)) >= _FEW_ROWS for side in (1, -1))

    if both_ways(rows & idle) or (not both_ways(rows) and np.sum(rows & idle & (direction != 0)) >= _FEW_ROWS):
        rows = rows & idle
    if np.sum(rows & (direction != 0)) < _FEW_ROWS:
        return 1.0
    X, y = np.nan_to_num(np.array([direction[rows], a[rows], force[rows]])), current[rows]
    if both_ways(rows):
        X, y = X - X.mean(axis=1, keepdims=True), y - np.mean(y)
    X = X / np.maximum(np.sqrt(np.mean(X**2, axis=1, keepdims=True)), 1e-12)
    beta = np.linalg.lstsq(X.T, y, rcond=None)[0]
    return -1.0 if beta[0] + beta[1] < -_CLEARLY_NEGATIVE * float(np.sqrt(np.mean(y**2))) else 1.0


def _or_zero(values: Float1D | None, like: Float1D) -> Float1D:
    return np.zeros(len(like)) if values is None else values


def _idle(state: AxisState) -> Bool1D:
    return np.ones(len(state.time), bool) if state.engaged is None else ~state.engaged


def of_themselves(noise: Noise, whitened: Array2D, plain: Array2D) -> Array2D:
    """(k, n) – whitened rows without those that what came before outweighs.

    After a rapid, its speed would speak in the box of the slow motion that follows, in which it has no part.
    """
    if len(noise.ar) == 0:
        return whitened
    own = np.abs(plain) * (_BEFORE / (noise.level * noise.innovation)).astype(np.float32)
    return np.where(np.abs(whitened) <= own, whitened, np.float32(0))
