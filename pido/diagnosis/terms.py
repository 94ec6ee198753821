"""A mechanism with its shape settled and the region in which it acts: what a joint fit adds up.

In:  mechanisms of the catalogue and one axis of all parts.
Out: `Term`, its regressors row by row, and a joint generalised least-squares `fit` of several terms.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.diagnosis.gates import Gate, inside
from pido.diagnosis.mechanisms.base import Mechanism
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.state import AxisState
from pido.diagnosis.whiten import Noise
from pido.physics.drive import AT_ONCE, Loop, delayed


@dataclass(frozen=True)
class Term:
    """A mechanism, its shape parameters, its region, and the name that the diagnosis gives it.

    `name` differs from the mechanism's id where the simulation already contains it: 'miscalibrated:<id>'.
    loop : of the drive, by which it is answered late
    """

    mechanism: Mechanism
    shape: tuple[tuple[str, float], ...] = ()
    gates: tuple[Gate, ...] = ()
    name: str = field(default="")
    loop: Loop = AT_ONCE

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", self.mechanism.id)

    @property
    def free(self) -> int:
        """Numbers that were chosen besides the amplitudes."""
        return self.mechanism.free(dict(self.shape)) + len(self.gates)

    @property
    def idle(self) -> int:
        """Amplitudes that its form does without: their columns are zero."""
        idle = self.mechanism.idle(dict(self.shape))
        return sum(a.name in idle for a in self.mechanism.amplitudes)

    @property
    def lag(self) -> float:
        """s, by which it is answered late."""
        return self.loop.lag

    def with_shape(self, **values: float) -> Term:
        """The same term with these numbers in its shape."""
        return replace(self, shape=tuple({**dict(self.shape), **values}.items()))

    def behind(self, loop: Loop) -> Term:
        """The same term behind the loop of a drive; as it is where it passes none, or has a lag of its own."""
        passes = self.mechanism.passes_loop and self.mechanism.kind != "data_fault"
        return replace(self, loop=loop) if passes and not dict(self.shape).get("late") else self

    def at_once(self) -> Term:
        """The same term, behind no loop."""
        return replace(self, loop=AT_ONCE)

    def columns(self, states: Sequence[AxisState]) -> Float2D:
        """(k, n), A per unit of the amplitude, parts one after another; zero where the state is not known."""
        return np.concatenate([self.of_part(s) for s in states], axis=1)

    def columns_delayed(self, states: Sequence[AxisState]) -> Float2D:
        """The same, as late by as much, for a loop that answers in full after that time and not before."""
        at_once = self.at_once()
        return np.concatenate([delayed(at_once.of_part(s), s.time, self.lag) for s in states], axis=1)

    def of_part(self, state: AxisState) -> Float2D:
        """(k, n) of one part."""
        with np.errstate(over="ignore", invalid="ignore"):
            values = np.asarray(self.mechanism.regressors(state, **dict(self.shape)), float).T
        values = np.where(np.isfinite(values), values, 0.0)
        values = values * inside(state, self.gates) if self.gates else values
        return self.loop.answered(values, state.time)


@dataclass(frozen=True, eq=False)
class Component:
    """A mechanism that a simulation contains, with its shape and its amplitudes there.

    size : its rms there, A; unsure : standard errors of the amplitudes, by what of the simulation no component explains
    """

    term: Term
    amplitudes: Float1D
    size: float
    unsure: Float1D


@dataclass(frozen=True)
class Fit:
    """Joint generalised least squares of base and terms.

    amplitudes : per term (k,); base : (b,); covariance : over [base, amplitudes], classical
    rss, n, bic : of the whitened rows
    residual : (n,), A – target minus base and terms
    """

    terms: tuple[Term, ...]
    amplitudes: tuple[Float1D, ...]
    base: Float1D
    covariance: Float2D
    rss: float
    n: int
    bic: float
    residual: Float1D
    whitened_residual: Float1D

    @property
    def modelled(self) -> int:
        return len(self.terms)


def without(terms: Sequence[Term], i: int) -> list[Term]:
    """`terms` but the one in place i."""
    return [t for k, t in enumerate(terms) if k != i]


def behind(columns: Float2D, states: Sequence[AxisState], loop: Loop) -> Float2D:
    """(k, n) – columns of what answers at once, behind a loop; parts one after another."""
    edges = np.cumsum([len(s.time) for s in states])[:-1]
    parts = zip(np.split(columns, edges, axis=1), states, strict=True)
    return np.concatenate([loop.answered(values, state.time) for values, state in parts], axis=1)


def fit(mismatch: Mismatch, noise: Noise, terms: Sequence[Term], columns: Sequence[Float2D] | None = None) -> Fit:
    """Amplitudes of `terms` and of the base, all at once."""
    columns = [t.columns(mismatch.states) for t in terms] if columns is None else list(columns)
    design = np.concatenate([mismatch.base, *columns]) if terms or len(mismatch.base) else np.zeros((0, mismatch.n))
    y = noise.whiten(mismatch.target[None])[0]
    X = noise.whiten(design)
    b = len(mismatch.base)
    beta, covariance = solve(X, y, held_back(X, b, terms, columns))
    whitened = y - beta @ X
    n = int(noise.valid.sum())
    rss = float(whitened @ whitened)
    sizes = np.cumsum([b, *[len(c) for c in columns]])
    amplitudes = tuple(beta[i:j] for i, j in itertools.pairwise(sizes))
    free = b + sum(len(c) - t.idle + t.free for t, c in zip(terms, columns, strict=True))
    return Fit(
        terms=tuple(terms),
        amplitudes=amplitudes,
        base=beta[:b],
        covariance=covariance,
        rss=rss,
        n=n,
        bic=bic(rss, n, free),
        residual=mismatch.target - beta @ design,
        whitened_residual=whitened,
    )


def bic(rss: float, n: int, free: int) -> float:
    """Schwarz' criterion of n independent normal errors of unknown variance."""
    return float(n * np.log(max(rss, 1e-300) / n) + free * np.log(max(n, 2)))


def held_back(X: Float2D, base: int, terms: Sequence[Term], columns: Sequence[Float2D]) -> Float1D:
    """(len(X),) – what is added to the diagonal of X Xᵀ: a corner of a curve or surface that hardly any row
    reaches is drawn to zero, and cannot take any height.
    """
    out = np.zeros(len(X))
    sizes = np.cumsum([base, *[len(c) for c in columns]])
    for term, (i, j) in zip(terms, itertools.pairwise(sizes), strict=True):
        if term.mechanism.held_back:
            out[i:j] = term.mechanism.held_back * float(np.mean(np.einsum("ij,ij->i", X[i:j], X[i:j])))
    return out


def solve(X: Float2D, y: Float1D, ridge: Float1D | None = None) -> tuple[Float1D, Float2D]:
    """Least squares of y on the rows of X, minimum norm where they are dependent; and (X Xᵀ)⁻¹ * residual variance.

    ridge : (len(X),) – added to the diagonal of X Xᵀ
    """
    if len(X) == 0:
        return np.zeros(0), np.zeros((0, 0))
    beta, inverse = solve_normal(X @ X.T + (0.0 if ridge is None else np.diag(ridge)), X @ y)
    residual = y - beta @ X
    free = max(1, int(np.count_nonzero(y)) - len(X))
    return beta, inverse * (residual @ residual) / free


def solve_normal(gram: Float2D, inner: Float1D) -> tuple[Float1D, Float2D]:
    """Solution of the normal equations, minimum norm of the scaled columns where they are dependent; pseudo-inverse."""
    if len(gram) == 0:
        return np.zeros(0), gram
    size = np.sqrt(np.diag(gram))
    size = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(gram / np.outer(size, size))
    keep = values > 1e-9 * max(values[-1], 1e-300)
    inverse = (vectors[:, keep] / values[keep]) @ vectors[:, keep].T / np.outer(size, size)
    return inverse @ inner, inverse
