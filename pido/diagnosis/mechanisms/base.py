"""What a mechanism of the catalogue can do.

In:  the state of one axis in one part (`AxisState`) and the mechanism's shape parameters.
Out: regressors that its amplitudes multiply, where it acts, and what an operator should read.
What is linear (amplitudes) is separated from what is not (shape), so that one fit serves every mechanism. A shape that
chooses among textbook forms is a whole number and is rounded; a form that a recording cannot give has a zero regressor.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from pido.core.arrays import Bool1D, Float1D, Float2D
from pido.core.axes import AXES
from pido.diagnosis.mechanisms.advice import recordings_against
from pido.diagnosis.state import AxisState

_EDGE = 0.05  # of half a width: an edge as wide lets a search move it, and a tool is never as sharp as a line


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number of a mechanism: unit, plausible range, and for a shape the values that a search starts from.

    first : of a choice, how many of its forms a search starts from; 0: all. The others are asked of what it has found.
    """

    name: str
    unit: str
    low: float | None = None
    high: float | None = None
    scale: Literal["linear", "log"] = "linear"
    values: tuple[float, ...] = ()
    points: int = 6
    first: int = 0

    @property
    def grid(self) -> tuple[float, ...]:
        """Where a search starts: `values`, or `points` values between low and high, evenly on the parameter's scale."""
        if self.values:
            return self.values[: self.first or None]
        if self.low is None or self.high is None:
            return ()
        space = np.geomspace if self.scale == "log" else np.linspace
        return tuple(float(v) for v in space(self.low, self.high, self.points))

    @property
    def is_choice(self) -> bool:
        """Whether it numbers textbook forms, which have nothing between them."""
        return len(self.values) > 1 and self.values == tuple(float(i) for i in range(len(self.values)))

    def around(self, value: float) -> tuple[float, float]:
        """From the grid's neighbour below a value to the one above."""
        least = 1e-9 * abs(value)
        below = [g for g in self.grid if g < value - least]
        above = [g for g in self.grid if g > value + least]
        return max(below, default=value), min(above, default=value)


def choice(name: str, count: int, first: int = 0) -> Parameter:
    """A shape that chooses among `count` forms, numbered from 0; a search starts from the `first` of them, or all."""
    return Parameter(name, "–", low=0.0, high=count - 1.0, values=tuple(map(float, range(count))), first=first)


def which(value: float, count: int) -> int:
    """The number of the form, of `count`, that a `choice` stands for; a search may overstep its ends."""
    return int(np.clip(round(value), 0, count - 1))


class Told(NamedTuple):
    """What an operator reads of a mechanism, as it was found.

    summary, conditions : where it acts, in words and in the form of the contract
    name : what it is, where that is more than its identifier says; '' where it is not
    to_record : what would tell more
    """

    summary: str
    conditions: tuple[str, ...] = ()
    name: str = ""
    to_record: str = ""


class Mechanism(ABC):
    """Something that a simulation may have left out of one axis' current."""

    id: ClassVar[str]
    equation: ClassVar[str]
    kind: ClassVar[Literal["missing_physics", "data_fault"]] = "missing_physics"
    held_back: ClassVar[float] = 0.0  # share of the mean information of its amplitudes that says each of them is zero
    amplitudes: ClassVar[tuple[Parameter, ...]]
    shape: ClassVar[tuple[Parameter, ...]] = ()
    axes: ClassVar[tuple[str, ...]] = AXES
    summary: ClassVar[str] = ""
    transient: ClassVar[bool] = False  # acts around stops and reversals only
    passes_loop: ClassVar[bool] = True  # of a drive; not what acts on the current itself or is late in its own way
    quantity: ClassVar[str | None] = None  # the choice that says what it is in proportion to
    follows_from: ClassVar[tuple[str, ...]] = ()  # of a state's fields that a part may lack: without them it is nothing
    becomes: ClassVar[frozenset[str]] = frozenset()  # mechanisms whose law it can be, in more words
    looked_at: ClassVar[int] = 1  # shapes that `suggest` compares; a claim is charged for them

    @property
    def tell_apart(self) -> dict[str, str]:
        """Identifier of a mechanism that this one may be mistaken for -> the recording that separates them."""
        return recordings_against(self.id)

    @abstractmethod
    def regressors(self, state: AxisState, **shape: float) -> Float2D:
        """What the amplitudes multiply: (n, len(self.amplitudes)), in A per unit of the amplitude."""

    def needs(self, states: Sequence[AxisState]) -> str | None:
        """Why these data cannot show the mechanism, or None. Members say here what they need besides their axis."""
        return None

    def applies(self, states: Sequence[AxisState]) -> str | None:
        """None where the data can show the mechanism, or the reason why they cannot."""
        if not states:
            return "no part was given"
        axis = states[0].axis
        if axis not in self.axes:
            return f"it does not act on axis {axis}"
        return self.needs(states)

    @property
    def reads(self) -> frozenset[str]:
        """Names of the recorded quantities that a law without a name is a law of; none of what has one."""
        return frozenset()

    def starts(self, states: Sequence[AxisState]) -> tuple[dict[str, float], ...]:
        """Shapes that a search in these data starts from: all of the grid, unless a member knows better."""
        names = [p.name for p in self.shape]
        points = itertools.product(*(p.grid for p in self.shape))
        return tuple(dict(zip(names, map(float, point), strict=True)) for point in points)

    def suggest(self, states: Sequence[AxisState], left: Sequence[Float1D]) -> tuple[dict[str, float], ...]:
        """Further shapes that what is left of the mismatch (A, per part, NaN where unusable) speaks for; often none."""
        return ()

    def around(self, name: str, shape: Mapping[str, float], states: Sequence[AxisState]) -> tuple[float, float]:
        """(low, high) between which a shape parameter is moved when a search refines it; equal where it is settled."""
        parameter = next(p for p in self.shape if p.name == name)
        here = shape.get(name, 0.0)
        return (here, here) if parameter.is_choice else parameter.around(here)

    def forms_at_rest(self, shape: Mapping[str, float]) -> tuple[dict[str, float], ...]:
        """A shape with each form of its choice `rest`."""
        rest = next(p for p in self.shape if p.name == "rest")
        return tuple({**shape, rest.name: value} for value in rest.values)

    def free(self, shape: Mapping[str, float]) -> int:
        """How many shape parameters were fitted; choosing among forms is charged with the number of shapes tried."""
        return sum(not p.is_choice for p in self.shape)

    def where(self, state: AxisState, **shape: float) -> Float1D:
        """(n,) in 0..1 – how strongly it acts, relative to where it acts most in this part."""
        size = np.abs(np.nan_to_num(self.regressors(state, **shape)))
        top = size.max(axis=0)
        return np.max(size / np.where(top > 0, top, 1.0), axis=1) if len(size) else np.zeros(0)

    def from_the_middle(self, shape: Mapping[str, float], states: Sequence[AxisState]) -> dict[str, float]:
        """The same law in the shape in which its sizes are known best."""
        return dict(shape)

    def equation_in(self, axis: str, shape: Mapping[str, float]) -> str:
        """The equation in the form that a shape chooses; dI, v, a, pos and _i are those of the axis."""
        return self.equation

    def idle(self, shape: Mapping[str, float]) -> frozenset[str]:
        """Names of the parameters that the form chosen by a shape does without."""
        return frozenset()

    def conditions(self, axis: str, shape: Mapping[str, float]) -> tuple[str, tuple[str, ...]]:
        """(summary in an operator's words, conditions in the form of the contract)."""
        return self.summary.format(axis=axis, **shape), ()

    def told(self, states: Sequence[AxisState], shape: Mapping[str, float], sizes: Mapping[str, float]) -> Told:
        """As `conditions`, with what the data and its sizes (amplitudes by name) say more."""
        return Told(*self.conditions(states[0].axis, shape))

    def told_in(
        self,
        states: Sequence[AxisState],
        rows: Sequence[Bool1D],
        shape: Mapping[str, float],
        sizes: Mapping[str, float],
    ) -> Told:
        """As `told`, of a law that is confined to some `rows` (per part, (n,)): what they are like may say more."""
        return self.told(states, shape, sizes)


def column(values: Float1D) -> Float2D:
    """(n,) as (n, 1)."""
    return np.asarray(values, float)[:, None]


def up_to_edge(far: Float1D) -> Float1D:
    """(n,) – 1 within an edge, 0 beyond. far : how far from the middle, as a multiple of where the edge is."""
    inside: Float1D = 0.5 * (1.0 - np.tanh((far - 1.0) / _EDGE))
    return inside


def nothing(state: AxisState, k: int = 1) -> Float2D:
    """Regressor of a form that this recording cannot give."""
    return np.zeros((len(state.time), k))
