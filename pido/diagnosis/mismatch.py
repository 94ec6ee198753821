"""One axis of all parts, laid out for statistics: what is to be explained, and what may not be confused with it.

In:  the state of one axis in every part, and the signal that simulation and recording disagree about.
Out: `Mismatch`: target row by row, the terms that are always in the fit, parts, blocks, interruptions, classes of
     noise.
The unit of every claim is the part; with fewer than `FEW_PARTS` parts, contiguous blocks stand in, and the answer
says so.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from pido.core.arrays import Array1D, Bool1D, Float1D, Float2D, Int1D
from pido.diagnosis.gates import IN_PLACE, VARIABLES, gate_variable
from pido.diagnosis.state import AxisState

FEW_PARTS = 3
SEARCH_ROWS = 40_000  # rows that a search looks at; a longer record is averaged down to them, final fits use every row
BLOCKS = 160  # blocks in all, at most, that uncertainty is counted in
_SHORTEST_BLOCK_S = 1.0  # whitened rows forget within a few samples; what whitening misses is forgotten within this
_SLOWEST_SEARCH_HZ = 20.0  # a search never averages below this rate: reversals last a tenth of a second
# Fields whose means over the rows that a search averages stand for them.
_OF_MOTION = ("v", "a", "held", "along")
_OF_LOAD = ("force", "forces", "force_perp", "m_sp", "mrr", "ar", "sim", "sims", "sim_held", "curr")

Rows = TypeVar("Rows")


@dataclass(frozen=True, eq=False)
class Mismatch:
    """n rows of one axis, parts one after another.

    target : (n,), A – recorded minus simulated current; the recorded current itself where `base` is the simulation
    base : (b, n) – terms of an equation that stands for the simulation; fitted together with every candidate
    base_names : (b,) names of these terms
    sim : (n,), A – the simulated current, if one was given
    part, block : (n,) – index of the part; index of the block that counts as one observation
    starts : (n,) – True where a row does not follow the one before it
    usable : (n,) – rows that may be fitted
    noise_class : (n,) – class of state with a noise level of its own
    stride : rows of the recording that one row here stands for
    before_moving : (n,), A – the target before the simulation was moved in time, where it was
    fine : per part the time, s, and the simulated current, A, of the rows that were averaged, where they were
    left_out : (n,) – what is left out together, where that is not the part
    """

    axis: str
    states: tuple[AxisState, ...]
    target: Float1D
    base: Float2D
    base_names: tuple[str, ...]
    sim: Float1D | None
    part: Int1D
    block: Int1D
    starts: Bool1D
    usable: Bool1D
    noise_class: Int1D
    stride: int = 1
    before_moving: Float1D | None = None
    fine: tuple[tuple[Float1D, Float1D], ...] = ()
    left_out: Int1D | None = None

    @property
    def n(self) -> int:
        return len(self.target)

    @property
    def simulated(self) -> Float1D:
        """(n,), A – the simulated current, where one was given."""
        if self.sim is None:
            raise ValueError(f"axis {self.axis}: no simulated current was given, and nothing can be compared with it")
        return self.sim

    @property
    def parts(self) -> tuple[str, ...]:
        return tuple(s.part for s in self.states)

    @cached_property
    def step(self) -> float:
        """s – between two rows of a part."""
        return float(np.median(np.diff(self.states[0].time)))

    @cached_property
    def edges(self) -> Int1D:
        """(p + 1,) – first row of each part, and n."""
        return np.r_[0, np.cumsum([len(s.time) for s in self.states])]

    @property
    def fold(self) -> Int1D:
        """(n,) – what is left out together: the part, or a fifth of the record in time where there are few parts."""
        if self.left_out is not None:
            return self.left_out
        if len(self.states) >= FEW_PARTS:
            return self.part
        return np.minimum(4, 5 * np.arange(self.n) // max(1, self.n))

    @property
    def scheme(self) -> str:
        if self.left_out is not None:
            return "leave-one-block-out"
        return "leave-one-part-out" if len(self.states) >= FEW_PARTS else "leave-one-block-out (fewer than 3 parts)"

    def with_target(self, target: Float1D) -> Mismatch:
        return replace(self, target=target)


def lay_out(
    states: Sequence[AxisState],
    targets: Sequence[Float1D],
    bases: Sequence[Float2D] | None = None,
    base_names: tuple[str, ...] = (),
    stride: int = 1,
) -> Mismatch:
    """Parts one after another, with blocks of equal length and every interruption marked.

    targets : per part (n_p,), NaN where recorded or simulated current is missing
    bases : per part (b, n_p); none where the simulated current is given
    stride : so many rows are averaged into one
    """
    thin = [_thin(s, stride) for s in states]
    target = np.concatenate([averaged(t, stride) for t in targets])
    base = np.concatenate([averaged(b, stride) for b in bases], axis=-1) if bases else np.zeros((0, len(target)))
    sims = [s.sim for s in thin]
    sim = np.concatenate([s for s in sims if s is not None]) if all(s is not None for s in sims) else None
    usable = np.concatenate([s.usable for s in thin]) & np.isfinite(target) & np.isfinite(base).all(axis=0)
    starts = np.concatenate([_starts(s.time) for s in thin])
    starts |= ~usable
    starts[1:] |= ~usable[:-1]
    part = np.repeat(np.arange(len(thin)), [len(s.time) for s in thin])
    return Mismatch(
        axis=thin[0].axis,
        states=tuple(thin),
        target=np.where(usable, target, 0.0),
        base=np.where(usable, base, 0.0),
        base_names=base_names,
        sim=sim,
        part=part,
        block=_blocks(thin),
        starts=starts,
        usable=usable,
        noise_class=_noise_class(thin),
        stride=stride,
        fine=tuple((s.time, s.sim) for s in states if s.sim is not None) if stride > 1 and sim is not None else (),
    )


def search_stride(rows: int, rate_hz: float) -> int:
    """How many rows a search may average into one.

    >>> search_stride(40_000, 100.0), search_stride(1_000_000, 500.0)
    (1, 25)
    """
    wanted = int(np.ceil(rows / SEARCH_ROWS))
    return max(1, min(wanted, int(rate_hz / _SLOWEST_SEARCH_HZ)))


def take_rows(value: Rows, rows: slice, n: int) -> Rows:
    """The same value (dataclass, mapping, array) with every array of n rows cut to `rows`."""
    return _take(value, rows, n)


def _take(value: Any, rows: slice, n: int) -> Any:
    if isinstance(value, np.ndarray):
        return value[rows] if value.ndim and len(value) == n else value
    if isinstance(value, Mapping):
        return {k: _take(v, rows, n) for k, v in value.items()}
    if isinstance(value, tuple) and not hasattr(value, "_fields"):
        return tuple(_take(v, rows, n) for v in value)
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value, **{f.name: _take(getattr(value, f.name), rows, n) for f in fields(value) if f.init})
    return value


def _thin(state: AxisState, stride: int) -> AxisState:
    """A row in the middle of every `stride` rows, with the means of what acts in proportion to itself.

    Of the direction, too: where the axis turns within a row, its friction is a part of itself there, as in the target.
    """
    if stride == 1:
        return state
    n = len(state.time)
    thin = take_rows(state, slice(stride // 2, (n // stride) * stride, stride), n)
    others = {
        a: replace(
            _means(motion, thin.others[a], _OF_MOTION, stride),
            wrong=None if motion.wrong is None else averaged(motion.wrong, stride) > 0,
        )
        for a, motion in state.others.items()
    }
    usable = averaged(state.usable, stride) == 1.0
    limiting = {name: gate_variable(state, name) for name in (*VARIABLES, *IN_PLACE)}
    ranges = {name: _range(values, stride) for name, values in limiting.items() if values is not None}
    means = _means(state, thin, (*_OF_MOTION, *_OF_LOAD), stride)
    return replace(means, others=others, usable=usable, ranges=ranges)


def _range(values: Float1D, stride: int) -> Float2D:
    """(n, 2) – least and most within the rows that are averaged into one."""
    rows = values[: len(values) // stride * stride].reshape(-1, stride)
    return np.stack([rows.min(axis=1), rows.max(axis=1)], axis=1)


def _means(whole: Rows, thin: Rows, names: Sequence[str], stride: int) -> Rows:
    """`thin` with the means of some fields of `whole`, arrays or mappings of them."""

    def mean(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {k: mean(v) for k, v in value.items()}
        return None if value is None else averaged(value, stride)

    return replace(thin, **{name: mean(getattr(whole, name)) for name in names})  # type: ignore[type-var]


def averaged(values: Array1D | Float2D, stride: int) -> Float2D:
    """Means of every `stride` values along the last axis; what is left at the end is no row."""
    if stride == 1:
        return np.asarray(values, float)
    n = values.shape[-1] // stride * stride
    return np.asarray(values[..., :n], float).reshape(*values.shape[:-1], -1, stride).mean(axis=-1)


def _starts(time: Float1D) -> Bool1D:
    """First row, and every row after a gap of more than 1.5 steps."""
    starts = np.ones(len(time), bool)
    if len(time) > 1:
        step = np.diff(time)
        starts[1:] = step > 1.5 * np.median(step)
    return starts


def _blocks(states: Sequence[AxisState]) -> Int1D:
    rows = np.array([len(s.time) for s in states])
    seconds = np.array([s.time[-1] - s.time[0] for s in states])
    per_part = np.maximum(4, np.minimum(seconds / _SHORTEST_BLOCK_S, BLOCKS * rows / rows.sum())).astype(int)
    out, first = [], 0
    for n, k in zip(rows, per_part, strict=True):
        out.append(first + np.minimum(k - 1, k * np.arange(n) // max(1, n)))
        first += k
    return np.concatenate(out)


def _noise_class(states: Sequence[AxisState]) -> Int1D:
    """0 standstill, 1 motion, 2 change of speed; 3 more per quarter of the load of an engaged tool."""
    moves, loads = [], []
    for state in states:
        hard = np.abs(state.a) > 0.2 * max(1e-12, float(np.nanmax(np.abs(state.a), initial=0.0)))
        moves.append(np.where(hard, 2, np.where(state.moving, 1, 0)))
        engaged = np.zeros(len(state.time), bool) if state.engaged is None else np.asarray(state.engaged, bool)
        loads.append(np.where(engaged, _load(state), np.nan))
    load = np.concatenate(loads)
    cuts = np.isfinite(load)
    quarters = np.quantile(load[cuts], [0.25, 0.5, 0.75]) if cuts.any() else np.zeros(3)
    return np.concatenate(moves) + 3 * np.where(cuts, 1 + np.searchsorted(quarters, load), 0)


def _load(state: AxisState) -> Float1D:
    """(n,) – how hard the tool works: process force, else torque or removal rate; 0 where none is given."""
    if state.forces:
        return np.sqrt(np.sum([np.nan_to_num(force) ** 2 for force in state.forces.values()], axis=0))
    known = next((v for v in (state.force, state.m_sp, state.mrr) if v is not None), np.zeros(len(state.time)))
    return np.abs(np.nan_to_num(known))
