"""How far a window's mean residual may lie from nothing: per axis, tool and NC block, honest from the first part on.

In:  residuals of good parts on which the model had not been trained.
Out: a Band: a centre and a spread for each tool and NC block, shrunk towards the tool's and the axis' own where few
     windows were seen, and one threshold in units of that spread.

The threshold is the level that the largest window of a part exceeds in `tolerate` of 100 good parts. Few parts cannot
show such a level, so it is extrapolated: maxima over stretches of STRETCH_S are near to independent, a generalised
Pareto law (Pickands 1975; Coles, An Introduction to Statistical Modeling of Extreme Values, ch. 4) is fitted to the
upper half of them, and parts differ from one another, which K parts show only roughly: the spread between parts enters
with its prior, and the threshold grows by Student's t with K degrees of freedom. It narrows as parts are added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from pido.core.arrays import Float1D
from pido.core.axes import AXES
from pido.core.errors import FitError
from pido.monitoring.residuals import WINDOW_S, PartResiduals, window_mean, window_samples

STRETCH_S = 5.0
"""Longer than the residual's memory, so that maxima over such stretches are near to independent, s."""
PRIOR_WINDOWS = 8.0
"""A block's own centre and spread weigh as much as the pooled ones once this many independent windows were seen."""
PRIOR_PARTS = 3.0
PRIOR_SPREAD = 0.15
"""Before parts were seen: their log spreads differ by this much, as if that had been found on PRIOR_PARTS parts."""
LONGEST_TAIL = 0.3
"""Shape of the Pareto tail above which a fit to few maxima is not believed."""


@dataclass(frozen=True, slots=True)
class Level:
    """Centre and spread of a window's mean residual, A."""

    centre: float
    spread: float


_AxisLevels = dict[tuple[str | None, int | None], Level]
_Levels = dict[str, _AxisLevels]


@dataclass(frozen=True)
class Band:
    """levels: per axis and (tool, block); a block not seen before falls back to (tool, None), then (None, None)."""

    levels: _Levels
    threshold: float  # in spreads, the same on every axis
    parts: int
    tolerate: float  # false alarms per 100 parts, all axes together
    window_s: float = WINDOW_S

    def level(self, axis: str, tool: str, block: int) -> Level:
        """The closest level that was learnt for this tool and NC block."""
        known = self.levels[axis]
        for key in ((tool, block), (tool, None)):
            if key in known:
                return known[key]
        return known[(None, None)]

    def limits(self, axis: str, tool: str, block: int) -> tuple[float, float]:
        """Lowest and highest window mean of the residual that passes, A."""
        level, reach = self.level(axis, tool, block), self.threshold
        return level.centre - reach * level.spread, level.centre + reach * level.spread


def learn(parts: Sequence[PartResiduals], tolerate: float = 1.0, window_s: float = WINDOW_S) -> Band:
    """A band from residuals of good parts.

    Parameters
    ----------
    parts : residuals on which the model had not been trained, one part at least
    tolerate : false alarms per 100 good parts, all axes together, 0 < tolerate < 100
    window_s : s, shortest change to be seen

    Raises FitError where no part is given, or none has an axis with as much as one stretch of finite residuals.
    """
    if not parts:
        raise FitError("A band needs the residuals of at least one good part on which the model was not trained.")
    if not 0 < tolerate < 100:
        raise FitError(f"tolerate is {tolerate}: false alarms per 100 parts, so more than 0 and less than 100.")
    means: dict[str, list[Float1D]] = {}
    for i, axis in enumerate(AXES):
        of_axis = [window_mean(p.residual[:, i], window_samples(p.rate_hz, window_s)) for p in parts]
        if any(np.isfinite(m).any() for m in of_axis):
            means[axis] = of_axis
    if not means:
        raise FitError("No axis has residuals over a whole window: record at least a few seconds without gaps.")
    levels = {axis: _levels(parts, of_axis) for axis, of_axis in means.items()}
    return Band(levels, _threshold(parts, means, levels, tolerate / 100.0), len(parts), tolerate, window_s)


def standardise(part: PartResiduals, axis: str, band: Band) -> Float1D:
    """(n,): window means of the residual in spreads of their own tool and NC block."""
    means = window_mean(part.residual[:, AXES.index(axis)], window_samples(part.rate_hz, band.window_s))
    return _standardised(part, means, band.levels[axis])


def _levels(parts: Sequence[PartResiduals], means: list[Float1D], window_s: float = WINDOW_S) -> _AxisLevels:
    values = np.concatenate(means)
    tools = np.concatenate([p.tool.astype(str) for p in parts])
    blocks = np.concatenate([p.block for p in parts])
    # Overlapping windows say little new: count them by how many would stand side by side.
    side_by_side = np.concatenate([np.full(len(p.time), 1.0 / window_samples(p.rate_hz, window_s)) for p in parts])
    seen = np.isfinite(values)
    values, tools, blocks, side_by_side = values[seen], tools[seen], blocks[seen], side_by_side[seen]
    overall = _robust(values)
    levels: _AxisLevels = {(None, None): overall}
    for tool in np.unique(tools):
        of_tool = tools == tool
        levels[(tool, None)] = _shrunk(values[of_tool], side_by_side[of_tool].sum(), overall)
        order = np.argsort(blocks[of_tool], kind="stable")
        sorted_blocks, sorted_values = blocks[of_tool][order], values[of_tool][order]
        weights = side_by_side[of_tool][order]
        names, starts = np.unique(sorted_blocks, return_index=True)
        for block, one, w in zip(
            names, np.split(sorted_values, starts[1:]), np.split(weights, starts[1:]), strict=True
        ):
            if block >= 0:
                levels[(tool, int(block))] = _shrunk(one, w.sum(), levels[(tool, None)])
    return levels


def _robust(values: Float1D) -> Level:
    centre = float(np.median(values))
    spread = float(np.median(np.abs(values - centre)) / stats.norm.ppf(0.75))
    # Quantised or nearly constant residuals: the ordinary spread is then the honest one.
    return Level(centre, max(spread, float(np.std(values)) * 0.5, 1e-9))


def _shrunk(values: Float1D, windows: float, towards: Level) -> Level:
    own = _robust(values)
    weight = windows / (windows + PRIOR_WINDOWS)
    centre = weight * own.centre + (1 - weight) * towards.centre
    variance = weight * own.spread**2 + (1 - weight) * towards.spread**2
    # What the centre does not know yet, the spread has to cover.
    unknown = (1 - weight) * weight * (own.centre - towards.centre) ** 2
    return Level(centre, float(np.sqrt(variance + unknown)))


def _standardised(part: PartResiduals, means: Float1D, levels: dict[tuple[str | None, int | None], Level]) -> Float1D:
    tools, tool_code = np.unique(part.tool.astype(str), return_inverse=True)
    pairs, which = np.unique(np.column_stack([tool_code, part.block]), axis=0, return_inverse=True)
    found = [
        levels.get((str(tools[t]), int(b)), levels.get((str(tools[t]), None), levels[(None, None)])) for t, b in pairs
    ]
    centre, spread = np.array([(level.centre, level.spread) for level in found]).T
    return (means - centre[which]) / spread[which]


def _threshold(
    parts: Sequence[PartResiduals], means: dict[str, list[Float1D]], levels: _Levels, chance: float
) -> float:
    """In spreads: what the largest window of a part, over all axes, exceeds with this chance."""
    maxima, log_spreads = [], []
    for axis, of_axis in means.items():
        for k, (part, mean) in enumerate(zip(parts, of_axis, strict=True)):
            # A part may not have had a say in its own levels: with others at hand, they judge it.
            others = [j for j in range(len(parts)) if j != k and np.isfinite(of_axis[j]).any()]
            judged_by = _levels([parts[j] for j in others], [of_axis[j] for j in others]) if others else levels[axis]
            z = np.abs(_standardised(part, mean, judged_by))
            stretch = max(1, round(part.rate_hz * STRETCH_S))
            pieces = np.array_split(z, max(1, len(z) // stretch))
            own = [float(np.nanmax(piece)) for piece in pieces if np.isfinite(piece).any()]
            maxima += own
            if own:
                log_spreads.append(np.log(max(float(np.median(own)), 1e-9)))
    level = _exceeded_with(np.array(maxima), 1.0 - (1.0 - chance) ** (len(parts) / len(maxima)))
    # How much wider the next part may be than those seen: one in ten is wider than this. Student's t, because the
    # spread between parts is itself estimated from few.
    known = len(log_spreads) - 1
    squares = float(np.var(log_spreads) * len(log_spreads))
    between = np.sqrt((squares + PRIOR_PARTS * PRIOR_SPREAD**2) / (known + PRIOR_PARTS))
    wider = stats.t.ppf(0.9, df=known + PRIOR_PARTS) * between * np.sqrt(1.0 / len(parts))
    return float(level * np.exp(wider))


def _exceeded_with(maxima: Float1D, chance: float) -> float:
    """Level that one stretch's maximum exceeds with this chance."""
    base = float(np.median(maxima))
    excess = maxima[maxima > base] - base
    if len(excess) < 8:
        # Too few to fit a tail: that of a Gaussian's maximum, at the size that was seen.
        return base * float(stats.norm.isf(chance / 2) / stats.norm.isf(0.25))
    # Probability-weighted moments (Hosking & Wallis 1987): closed form, and steady on a few dozen maxima.
    excess = np.sort(excess)
    below = (np.arange(1, len(excess) + 1) - 0.35) / len(excess)
    first, second = float(np.mean(excess)), float(np.mean((1.0 - below) * excess))
    shape = 2.0 - first / (first - 2.0 * second)
    # Heavier than exponential only where the maxima show it by more than the estimate's own standard error.
    shape = float(np.clip(shape - 1.0 / np.sqrt(len(excess)), 0.0, LONGEST_TAIL))
    scale = first * (1.0 - shape)
    return base + float(stats.genpareto.isf(min(2.0 * chance, 1.0), shape, scale=scale))
