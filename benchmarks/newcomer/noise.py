"""Noise of a current: correlated in time, larger where the axis moves or cuts, and a converter's steps.

In:  parts at the logged samples, an axis, the size. Out: `Noise`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from benchmarks.newcomer.parts import Part
from benchmarks.newcomer.world import number
from benchmarks.sealed_truth import NoiseRows
from pido.core.arrays import Float1D


@dataclass(frozen=True, eq=False)
class Noise(NoiseRows):
    """independent : share of such rows, –"""

    independent: float

    def times(self, factor: float) -> Noise:
        return replace(self, rows=[factor * r for r in self.rows], step=factor * self.step)


def draw_noise(parts: Sequence[Part], axis: str, size: float, rng: np.random.Generator) -> Noise:
    """size : A, rms of an axis that rests"""
    machine = parts[0].machine
    tau, slow_tau = float(np.exp(rng.uniform(*np.log(machine.kind.short_s)))), float(rng.uniform(0.3, 1.2))
    shares = rng.dirichlet(machine.kind.colours)  # white, short, long
    moves, cuts = float(rng.uniform(*machine.kind.moves)), float(rng.uniform(*machine.kind.cuts))
    rows = [_state(p, axis, moves, cuts) * size * _coloured(len(p.t), machine.rate, (tau, slow_tau), shares, rng)
            for p in parts]  # fmt: skip
    if machine.kind.outliers:
        rows = [r + size * _outliers(len(r), machine.kind.outliers, rng) for r in rows]
    spread = 1 + 2 * machine.rate * (shares[1] ** 2 * tau + shares[2] ** 2 * slow_tau)
    return Noise(rows, size * float(rng.uniform(*machine.kind.steps)), float(1 / spread))


def _outliers(n: int, share: float, rng: np.random.Generator) -> Float1D:
    """(n,): single samples that are far off, 0 elsewhere. share : of them, –"""
    far = rng.uniform(4, 10, n) * rng.choice([-1.0, 1.0], n)
    return np.where(rng.random(n) < share, far, 0.0)


def _coloured(n: int, rate: float, taus: tuple[float, float], shares: Float1D, rng: np.random.Generator) -> Float1D:
    """(n,), rms one: white noise and two of first order."""
    total = np.sqrt(shares[0]) * rng.normal(size=n)
    for tau, share in zip(taus, shares[1:], strict=True):
        keep = float(np.exp(-1 / (rate * tau)))
        raw = lfilter([np.sqrt(1 - keep**2)], [1, -keep], rng.normal(size=n), zi=[keep * rng.normal()])[0]
        total += np.sqrt(share) * raw
    return total


def _state(part: Part, axis: str, moves: float, cuts: float) -> Float1D:
    """(n,), from 1: how much noisier it is here than at rest."""
    v = part.v_sp if axis == "sp" else part.v[:, number(axis)]
    fast = float(np.quantile(np.abs(v), 0.95)) or 1.0
    return 1 + moves * np.minimum(np.abs(v) / fast, 1.5) + cuts * part.engaged
