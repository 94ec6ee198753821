"""What else one might do with the same parts: simple rivals of the mismatch finder, on the same files.

In:  folders of the parts to diagnose, of the unseen part, a folder to work in. Out: `Answer`, as the tool gives it.

All see recorded minus simulated current per axis and, where they use a library, the same one: every mechanism of the
catalogue with a grid of shapes. None is told what the tool knows besides: noise that is not white, parts as the unit.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.core.axes import AXES
from pido.core.recording import Recording
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.state import AxisState, axis_states
from pido.diagnosis.terms import Term
from pido.experiments.judged import Answer, Claim
from pido.recordings import read_recording

ROWS = 6000
SHAPES = 4
MIN_SHARE = 0.02
"""A column that explains less than this share of the variance is not claimed as a finding."""


@dataclass(frozen=True, eq=False)
class _Axis:
    """One axis: the mismatch of all rows (parts after one another), which rows to fit, states with the unseen last."""

    axis: str
    target: Float1D
    fit: np.ndarray
    states: tuple[AxisState, ...]
    lengths: tuple[int, ...]


Method = Callable[[_Axis], tuple[list[tuple[str, float]], Float1D]]
"""An axis -> (mechanism and share of the variance, strongest first; prediction for all rows of all parts)."""


def _solver(method: Method) -> Callable[[Sequence[Path], Path, Path], Answer]:
    def solve(parts: Sequence[Path], unseen: Path, _place: Path) -> Answer:
        start = time.perf_counter()
        recordings = [read_recording(p) for p in (*parts, unseen)]
        claims: list[tuple[float, Claim]] = []
        scores: dict[str, dict[str, Float1D]] = {p.name: {} for p in parts}
        coming: dict[str, Float1D] = {}
        for axis in AXES:
            one = _axis(recordings, axis)
            if one is None:
                continue
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # rivals warn of what they are: collinear columns, no convergence
                named, predicted = method(one)
            size = float(np.std(one.target[one.fit]))
            claims += [(share * size, Claim(axis, name, _kind(name))) for name, share in named]
            pieces = np.split(predicted, np.cumsum(one.lengths)[:-1])
            for part, piece in zip(parts, pieces[:-1], strict=True):
                scores[part.name][axis] = np.abs(piece) / (np.abs(piece) + max(size, 1e-12))
            coming[axis] = pieces[-1]
        ordered = tuple(claim for _, claim in sorted(claims, key=lambda c: -c[0]))
        return Answer(ordered, scores, coming, time.perf_counter() - start)

    return solve


def _kind(name: str) -> str:
    return next((m.kind for m in CATALOGUE if m.id == name), "missing_physics")


def _axis(recordings: Sequence[Recording], axis: str) -> _Axis | None:
    states = axis_states(recordings, axis)
    if any(s.sim is None or s.curr is None for s in states):
        return None
    target = np.concatenate([s.curr - s.sim for s in states if s.curr is not None and s.sim is not None])
    lengths = tuple(len(s.time) for s in states)
    known = np.concatenate([s.usable for s in states]) & np.isfinite(target)
    known[sum(lengths[:-1]) :] = False
    rows = np.flatnonzero(known)
    if len(rows) < 500:
        return None
    return _Axis(axis, target, rows[:: max(1, len(rows) // ROWS)], states, lengths)


def _library(one: _Axis) -> tuple[list[str], Float2D]:
    """Names (k,) and columns (n, k) of every mechanism that these data can show, a few shapes each, of unit size."""
    names, columns = [], []
    for mechanism in CATALOGUE:
        if mechanism.id == "time_misalignment" or mechanism.applies(one.states) is not None:
            continue
        starts = mechanism.starts(one.states)
        for shape in starts[:: max(1, len(starts) // SHAPES)]:
            for values in Term(mechanism, tuple(shape.items())).columns(one.states):
                size = float(np.std(values[one.fit])) or float(np.abs(values[one.fit]).max())
                if size > 0:
                    names.append(mechanism.id)
                    columns.append(values / size)
    return names, np.array(columns).T


def _named(names: Sequence[str], columns: Float2D, beta: Float1D, target: Float1D) -> list[tuple[str, float]]:
    """Each mechanism by the variance of its own contribution, as a share of the target's."""
    shares: dict[str, float] = {}
    for name in dict.fromkeys(names):
        own = [k for k, n in enumerate(names) if n == name]
        part = columns[:, own] @ beta[own]
        shares[name] = float(np.mean(part**2) / max(np.mean(target**2), 1e-300))
    return [(n, np.sqrt(s)) for n, s in sorted(shares.items(), key=lambda s: -s[1]) if s >= MIN_SHARE]


def _lasso(one: _Axis) -> tuple[list[tuple[str, float]], Float1D]:
    """LassoCV over the library."""
    from sklearn.linear_model import LassoCV

    names, columns = _library(one)
    X, y = columns[one.fit], one.target[one.fit]
    model = LassoCV(cv=4, alphas=30, max_iter=2000).fit(X, y)
    return _named(names, X, model.coef_, y), model.predict(columns)


def _forward(one: _Axis) -> tuple[list[tuple[str, float]], Float1D]:
    """Forward selection by BIC over the library, as a statistician does it in an afternoon; rows as independent."""
    names, columns = _library(one)
    X, y = np.column_stack([np.ones(len(one.fit)), columns[one.fit]]), one.target[one.fit]
    chosen, best, n = [0], np.inf, len(y)
    gram, right, square = X.T @ X, X.T @ y, float(y @ y)
    while len(chosen) < 8:
        scores = np.full(X.shape[1], np.inf)
        for k in set(range(X.shape[1])) - set(chosen):
            at = [*chosen, k]
            beta = np.linalg.lstsq(gram[np.ix_(at, at)], right[at], rcond=1e-9)[0]
            scores[k] = n * np.log(max(square - right[at] @ beta, 1e-12) / n) + 2 * len(at) * np.log(n)
        k = int(np.argmin(scores))
        plain = n * np.log(max(float(np.var(y)), 1e-12)) + 2 * np.log(n) if len(chosen) == 1 else best
        if scores[k] >= plain:
            break
        chosen, best = [*chosen, k], float(scores[k])
    beta = np.linalg.lstsq(X[:, chosen], y, rcond=None)[0]
    order = [
        (names[k - 1], abs(float(b)) / max(float(np.std(y)), 1e-12)) for k, b in zip(chosen, beta, strict=True) if k
    ]
    first = list(dict.fromkeys(n for n, _ in order))  # in the order of their gain
    everything = np.column_stack([np.ones(len(columns)), columns])[:, chosen] @ beta
    return [(n, max(s for m, s in order if m == n)) for n in first], everything


_PLAIN = {
    "v": "viscous_friction", "sgn(v)": "coulomb_friction", "a": "inertia", "held": "standstill_friction",
    "F": "cutting_force", "M": "spindle_torque_load", "1": "sensor_offset", "I_sim": "sensor_gain",
    "v v": "friction_asymmetry",
}  # fmt: skip
"""What a polynomial of signals says in the vocabulary; other products have no name."""


def _signals(one: _Axis) -> tuple[list[str], Float2D]:
    """Signals of the axis, of unit size, (n, k)."""

    def joined(get: Callable[[AxisState], Float1D | None]) -> Float1D | None:
        pieces = [get(s) for s in one.states]
        known = [p for p in pieces if p is not None]
        return np.nan_to_num(np.concatenate(known)) if len(known) == len(pieces) else None

    wanted: dict[str, Callable[[AxisState], Float1D | None]] = {
        "v": lambda s: s.v, "sgn(v)": lambda s: np.sign(s.v) * s.moving, "a": lambda s: s.a, "held": lambda s: s.held,
        "pos": lambda s: s.pos, "F": lambda s: s.force, "M": lambda s: s.m_sp, "MRR": lambda s: s.mrr,
        "I_sim": lambda s: s.sim, "clock": lambda s: s.clock, "coolant": lambda s: s.coolant,
        **{f"v_{a}": (lambda s, a=a: s.others[a].v if a in s.others else None) for a in AXES},
    }  # fmt: skip
    names, columns = [], []
    for name, get in wanted.items():
        values = joined(get)
        if values is not None and (size := float(np.std(values[one.fit]))) > 0:
            names.append(name)
            columns.append((values - (values[one.fit].mean() if name in ("pos", "clock") else 0.0)) / size)
    return names, np.array(columns).T


def _sindy(one: _Axis) -> tuple[list[tuple[str, float]], Float1D]:
    """PySINDy: sparse regression (STLSQ) on second-order polynomials of the signals; most products have no name."""
    import pysindy

    names, signals = _signals(one)
    samples: Any = signals[one.fit]  # an array, as pysindy documents; its annotation knows lists alone
    library = pysindy.PolynomialLibrary(degree=2).fit(samples)
    columns = np.asarray(library.transform(signals))
    terms = library.get_feature_names(names)
    X, y = columns[one.fit], one.target[one.fit]
    optimiser = pysindy.STLSQ(threshold=0.1 * float(np.std(y)), alpha=1e-3)
    optimiser.fit(X, y[:, None])
    beta = np.asarray(optimiser.coef_)[0]
    told = [_PLAIN.get(t, "unknown") for t in terms]
    return _named(told, X, beta, y), columns @ beta


def _boosting(one: _Axis) -> tuple[list[tuple[str, float]], Float1D]:
    """Gradient boosting on the signals: no name; it claims 'unknown' where it predicts parts that it has not seen."""
    from sklearn.ensemble import HistGradientBoostingRegressor
    from sklearn.model_selection import cross_val_predict

    _, signals = _signals(one)
    X, y = signals[one.fit], one.target[one.fit]
    model = HistGradientBoostingRegressor(max_iter=100, random_state=0)
    left = cross_val_predict(model, X, y, cv=4)
    gain = 1 - float(np.mean((y - left) ** 2) / max(np.var(y), 1e-300))
    predicted = model.fit(X, y).predict(signals)
    return ([("unknown", float(np.sqrt(gain)))] if gain > MIN_SHARE else []), np.asarray(predicted, float)


RIVALS = {
    "lasso": _solver(_lasso),
    "bic-forward": _solver(_forward),
    "pysindy": _solver(_sindy),
    "boosting": _solver(_boosting),
}
