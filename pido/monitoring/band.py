"""How far a window's mean residual may lie from nothing: honest from the first part on, narrower as parts are added.

In:  residuals of good parts on which the model had not been trained.
Out: a Band: per axis a factor by state (`pido.monitoring.difficulty`), what the model is wrong by in proportion
     (`pido.monitoring.lean`), a centre and a spread for each tool (and NC block, where that says more), shrunk towards
     the tool's and the axis' own where few windows were seen, and a threshold in units of that spread.

The threshold is the level that the largest window of a part exceeds in its share of `tolerate` of 100 good parts. Few
parts cannot show such a level, so it is extrapolated: maxima over stretches of STRETCH_S are near to independent, and a
generalised Pareto law (Pickands 1975; Coles, An Introduction to Statistical Modeling of Extreme Values, ch. 4) is
fitted to the upper half of their squares. Squares, because those of a Gaussian have exactly the law's exponential tail,
while its own tail is lighter than any Pareto law and the extrapolation would overshoot. Parts differ from one another,
which K parts show only roughly: the threshold is exceeded with its chance over all widths that the next part may have,
with a prior on the spread between parts.

From few parts that are unlike one another, such a level may lie beyond all current that an axis draws. It stays there:
an alarm beyond it is one, and a narrower limit would not keep what is promised of good parts. But silence within it
says nothing, so the band knows how much its axis draws (`AxisBand.draws`), and such windows count as not judged.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats
from scipy.optimize import root_scalar

from pido.core.arrays import Array1D, Bool1D, Float1D, Float2D, Int1D
from pido.core.axes import AXES
from pido.core.errors import FitError
from pido.monitoring.difficulty import Difficulty, learn_difficulty, means_of, window_features
from pido.monitoring.lean import Lean, fit_lean, worth_it
from pido.monitoring.residuals import WINDOW_S, PartResiduals, window_mean, window_samples, window_share

STRETCH_S = 5.0
"""Longer than the residual's memory, so that maxima over such stretches are near to independent, s."""
PRIOR_WINDOWS = 8.0
"""A block's own centre and spread weigh as much as the pooled ones once this many independent windows were seen."""
PRIOR_PARTS = 3.0
PRIOR_SPREAD, OF_STRANGERS, OF_A_LAW = 0.25, 0.6, 0.3
"""Before parts were seen: their log spreads differ by this much, as if that had been found on PRIOR_PARTS parts; by
more where parts are strangers to one another, unless the axis follows a law that held on parts left out."""
STRANGE = 0.15
"""Parts are strangers where half of a part's samples lie further than this from all that the model has learnt from, in
spreads of the model's inputs. The same program again lies ten times closer, another one two to three times further."""
FOLDS = 4
"""Groups of parts that judge one another."""
_EVENLY = (np.arange(2000) + 0.5) / 2000
"""Chances at which the widths of the next part are tried."""
LONGEST_TAIL = 0.5
"""Shape of the Pareto tail above which a fit to few maxima is not believed."""
MOST_PARTS = 20
"""The newest parts decide: a machine changes, and a verdict has to be quick."""


@dataclass(frozen=True, slots=True)
class Level:
    """Centre and spread of a window's mean residual at the usual distance from the training rows, A."""

    centre: float
    spread: float


_State = tuple[Difficulty | None, Lean | None]
Place = tuple[str | None, str | None, int | None]
"""Tool, program, NC block; None stands for any."""


@dataclass(frozen=True, eq=False)
class AxisBand:
    """levels: per place; a block not seen before falls back to its tool, a tool not seen before to the axis.
    draws: the largest window mean of the current in the parts that the band was learnt from; a band that reaches as far
    lets twice of it pass, and says nothing."""

    levels: dict[Place, Level]
    threshold: float  # in spreads
    draws: float  # A
    difficulty: Difficulty | None = None
    lean: Lean | None = None

    def level(self, tool: str, block: int, program: str = "") -> Level:
        """The closest level that was learnt for this tool and NC block."""
        known = self.levels
        return known.get((tool, program, block)) or known.get((tool, None, None)) or known[(None, None, None)]


@dataclass(frozen=True, eq=False)
class Band:
    """axes: what was learnt per axis that was recorded; blocks: whether NC blocks have levels of their own."""

    axes: dict[str, AxisBand]
    parts: int
    tolerate: float  # false alarms per 100 parts, all axes together
    window_s: float = WINDOW_S
    blocks: bool = False

    def limits(
        self, axis: str, tool: str, block: int, program: str = "", factor: float = 1.0, lean: float = 0.0
    ) -> tuple[float, float]:
        """Lowest and highest window mean of the residual that passes, A; NaN where nothing can be said.

        factor : by which the residual is larger in this state than usual (`AxisBand.difficulty`)
        lean : residual that is expected in this state, A (`AxisBand.lean`)
        """
        level, reach = self.axes[axis].level(tool, block, program), self.axes[axis].threshold
        low, high = level.centre - reach * level.spread, level.centre + reach * level.spread
        return lean + factor * low, lean + factor * high

    def says(self, axis: str, reach: Float1D) -> Bool1D:
        """(n,): whether silence within a band that reaches so far (n,), A, to either side says anything; where nothing
        is known of the residual (NaN) it does not."""
        with np.errstate(invalid="ignore"):
            return np.asarray(reach < self.axes[axis].draws)


@dataclass(frozen=True, eq=False)
class _Windows:
    """One part's window means on one axis, with what they are judged by."""

    mean: Float1D
    tool: Array1D
    block: Int1D
    program: str
    features: Float2D | None
    width: int
    rate_hz: float
    wider: Float1D  # (n,), factor on the spread, 1 where no value is missing

    def part(self, which: slice) -> _Windows:
        """Some of the windows."""
        features = None if self.features is None else self.features[which]
        tool, block = self.tool[which], self.block[which]
        mean, wider = self.mean[which], self.wider[which]
        return _Windows(mean, tool, block, self.program, features, self.width, self.rate_hz, wider)

    def side_by_side(self) -> _Windows:
        """Two per window width: nearly all that is to be known, at a fraction of the cost."""
        return self.part(slice(None, None, max(1, self.width // 2)))


def learn(parts: Sequence[PartResiduals], tolerate: float = 1.0, window_s: float = WINDOW_S) -> Band:
    """A band from residuals of good parts, in production order.

    Parameters
    ----------
    parts : residuals on which the model had not been trained, one part at least; the last MOST_PARTS are used
    tolerate : false alarms per 100 good parts, all axes together, 0 < tolerate < 100
    window_s : s, shortest change to be seen

    Raises FitError where no part is given, or none has an axis with as much as one stretch of finite residuals.
    """
    if not parts:
        raise FitError("A band needs the residuals of at least one good part on which the model was not trained.")
    if not 0 < tolerate < 100:
        raise FitError(f"tolerate is {tolerate}: false alarms per 100 parts, so more than 0 and less than 100.")
    parts = parts[-MOST_PARTS:]
    windows: dict[str, list[_Windows]] = {}
    for axis in AXES:
        of_axis = [_windows(p, axis, window_s) for p in parts]
        seen = [w for w in of_axis if np.isfinite(w.mean).any()]
        if seen:
            windows[axis] = seen
    if not windows:
        raise FitError("No axis has residuals over a whole window: record at least a few seconds without gaps.")
    draws = {axis: max(_drawn(part, axis, window_s) for part in parts) for axis in windows}
    leans = {axis: _leans(of_axis) for axis, of_axis in windows.items()}
    states = {axis: _state(of_axis, leans[axis]) for axis, of_axis in windows.items()}
    splits = {axis: _splits(of_axis, leans[axis]) for axis, of_axis in windows.items()}
    # An axis that follows a law on parts left out has a threshold of its own, so that those that are hard to predict
    # do not widen it. These share theirs: alone, three parts unlike one another say too little about each of them.
    alone = [axis for axis in windows if leans[axis]]
    strangers = any(_strange(part) for part in parts)
    groups = [[axis] for axis in alone] + [[axis for axis in windows if axis not in alone]]

    def chance_of(axes: int) -> float:
        """Of an alarm on so many of the axes, of all that may be."""
        return 1.0 - (1.0 - tolerate / 100.0) ** (axes / len(windows))

    bands = []
    # Blocks with levels of their own pay where the same program comes again; other parts say whether that is so.
    for blocks in (False, True) if len(parts) > 1 else (False,):
        axes = {}
        for group in groups:
            if not group:
                continue
            prior = PRIOR_SPREAD if not strangers else OF_A_LAW if group[0] in alone else OF_STRANGERS
            shared = _threshold([splits[a] for a in group], blocks, len(parts), chance_of(len(group)), prior)
            for a in group:
                # One that is nearly always right and seldom far off has a tail that the others' maxima dilute.
                own = shared if len(group) == 1 else _threshold([splits[a]], blocks, len(parts), chance_of(1), prior)
                fitted = _fit(windows[a], blocks, states[a])
                axes[a] = replace(fitted, threshold=max(shared, own), draws=draws[a])
        axes = {axis: axes[axis] for axis in windows}
        bands.append(Band(axes, len(parts), tolerate, window_s, blocks))
    return min(bands, key=lambda band: _width(band, windows))


def standardise(part: PartResiduals, axis: str, band: Band) -> tuple[Float1D, Float1D]:
    """(n,): window means of the residual in spreads of their own place and state, and (n,), A, these spreads; NaN where
    there is no whole window, or the part is too far from anything that was seen."""
    return _standardised(_windows(part, axis, band.window_s), band.axes[axis])


def corridor(part: PartResiduals, axis: str, band: Band) -> tuple[Float1D, Float1D]:
    """(n,), (n,), A: lowest and highest current whose window mean would pass, around the prediction."""
    windows = _windows(part, axis, band.window_s)
    centre, spread = _scales(windows, band.axes[axis])
    said = window_mean(part.predicted[:, AXES.index(axis)], windows.width, part.due)
    reach = band.axes[axis].threshold
    return said + centre - reach * spread, said + centre + reach * spread


def _windows(part: PartResiduals, axis: str, window_s: float) -> _Windows:
    width = window_samples(part.rate_hz, window_s)
    residual = part.residual[:, AXES.index(axis)]
    mean, share = window_mean(residual, width, part.due), window_share(residual, width, part.due)
    wider = 1.0 / np.sqrt(np.where(np.isfinite(mean), share, 1.0))
    features = window_features(part, AXES.index(axis), width)
    return _Windows(mean, part.tool.astype(str), part.block, part.program, features, width, part.rate_hz, wider)


def _drawn(part: PartResiduals, axis: str, window_s: float) -> float:
    """Largest window mean of an axis' recorded current, A; 0 where there is none."""
    recorded = (part.predicted + part.residual)[:, AXES.index(axis)]
    mean = window_mean(recorded, window_samples(part.rate_hz, window_s))
    return float(np.max(np.abs(mean), initial=0.0, where=np.isfinite(mean)))


def _splits(parts: Sequence[_Windows], leans: bool) -> list[tuple[Sequence[_Windows], list[_Windows], _State]]:
    """Judged windows, those that judge them, and what was learnt of states from these: no part has a say in its own
    levels. A single part is judged stretch by stretch."""
    if len(parts) == 1:
        edges = np.linspace(0, len(parts[0].mean), FOLDS + 1).astype(int)
        parts = [parts[0].part(slice(a, b)) for a, b in itertools.pairwise(edges)]
    count = min(FOLDS, len(parts))
    found = []
    for k in range(count):
        judged = [w for j, w in enumerate(parts) if j % count == k]
        others = [w for j, w in enumerate(parts) if j % count != k]
        if any(np.isfinite(w.mean).any() for w in others):
            found.append((judged, others, _state(others, leans)))
    return found


def _strange(part: PartResiduals) -> bool:
    doubt = np.zeros(0) if part.doubt is None else part.doubt[np.isfinite(part.doubt)]
    return bool(len(doubt)) and float(np.median(doubt)) > STRANGE


def _leans(parts: Sequence[_Windows]) -> bool:
    few = [w.side_by_side() for w in parts]
    if any(w.features is None for w in few):
        return False
    return worth_it([(means_of(w.features), w.mean) for w in few if w.features is not None])


def _state(parts: Sequence[_Windows], leans: bool) -> _State:
    """What residual, and of what size, these parts let expect in a state."""
    few = [w.side_by_side() for w in parts]
    features = [w.features for w in few if w.features is not None]
    if len(features) < len(few):
        return None, None
    means = [(means_of(f), w.mean) for f, w in zip(features, few, strict=True)]
    lean = fit_lean(means) if leans else None
    left = np.concatenate([_left(w, (None, lean)) for w in few])
    return learn_difficulty(np.vstack(features), np.abs(left)), lean


def _fit(parts: Sequence[_Windows], blocks: bool, state: _State) -> AxisBand:
    few = [w.side_by_side() for w in parts]
    values = np.concatenate([_left(w, state) for w in few])
    seen = np.isfinite(values)
    tools = np.concatenate([w.tool for w in few])[seen]
    names = np.concatenate([np.full(len(w.mean), w.program, object) for w in few])[seen]
    block = np.concatenate([w.block for w in few])[seen]
    values = values[seen]
    overall = _robust(values)
    levels: dict[Place, Level] = {(None, None, None): overall}
    for tool in np.unique(tools):
        mine = tools == tool
        levels[(str(tool), None, None)] = of_tool = _shrunk(values[mine], 0.5 * mine.sum(), overall)
        if not blocks:
            continue
        for program in np.unique(names[mine].astype(str)):
            there = mine & (names == program)
            order = np.argsort(block[there], kind="stable")
            numbers, starts = np.unique(block[there][order], return_index=True)
            for number, one in zip(numbers, np.split(values[there][order], starts[1:]), strict=True):
                if number >= 0:
                    levels[(str(tool), str(program), int(number))] = _shrunk(one, 0.5 * len(one), of_tool)
    return AxisBand(levels, np.inf, 0.0, *state)


def _expected(windows: _Windows, state: _State) -> tuple[Float1D, Float1D]:
    """(n,), A, and (n,): the residual to be expected in each window, and the factor on its spread."""
    if windows.features is None:
        return np.zeros_like(windows.mean), np.ones_like(windows.mean)
    return expected_in(windows.features, *state)


def expected_in(features: Float2D, difficulty: Difficulty | None, lean: Lean | None) -> tuple[Float1D, Float1D]:
    """(n,), A, and (n,): the residual to be expected in windows of these features (n, f), and the factor on its
    spread."""
    expected, factor = (np.zeros(len(features)), np.ones(len(features))) if lean is None else lean(means_of(features))
    return expected, factor if difficulty is None else factor * difficulty(features)


def _left(windows: _Windows, state: _State) -> Float1D:
    """(n,), A: what is not expected, as large as it would be in the usual state."""
    expected, factor = _expected(windows, state)
    return (windows.mean - expected) / factor


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


def _scales(windows: _Windows, axis: AxisBand) -> tuple[Float1D, Float1D]:
    """(n,), (n,), A: centre and spread of every window."""
    tools, tool_code = np.unique(windows.tool, return_inverse=True)
    pairs, which = np.unique(np.column_stack([tool_code, windows.block]), axis=0, return_inverse=True)
    found = [axis.level(str(tools[t]), int(b), windows.program) for t, b in pairs]
    centre, spread = np.array([(level.centre, level.spread) for level in found]).reshape(-1, 2).T
    expected, factor = _expected(windows, (axis.difficulty, axis.lean))
    return expected + centre[which.ravel()] * factor, spread[which.ravel()] * factor * windows.wider


def _standardised(windows: _Windows, axis: AxisBand) -> tuple[Float1D, Float1D]:
    centre, spread = _scales(windows, axis)
    return (windows.mean - centre) / spread, spread


def _width(band: Band, windows: dict[str, list[_Windows]]) -> float:
    """Mean log width over the windows that were seen: which of two bands is the narrower one."""
    widths = [
        np.log(band.axes[axis].threshold) + np.nanmean(np.log(_scales(w.side_by_side(), band.axes[axis])[1]))
        for axis, all_ in windows.items()
        for w in all_
    ]
    return float(np.mean(widths))


def _threshold(
    splits: Sequence[list[tuple[Sequence[_Windows], list[_Windows], _State]]],
    blocks: bool,
    parts: int,
    chance: float,
    prior: float,
) -> float:
    """In spreads: what the largest window of a part, over these axes, exceeds with this chance.

    prior : by how much log spreads of parts are expected to differ before parts were seen
    """
    maxima: list[float] = []
    log_spreads: list[float] = []
    for of_axis in splits:
        for judged, others, state in of_axis:
            fitted = _fit(others, blocks, state)
            for part in judged:
                z = np.abs(_standardised(part, fitted)[0])
                stretch = max(1, round(part.rate_hz * STRETCH_S))
                pieces = np.array_split(z, max(1, len(z) // stretch))
                own = [float(np.nanmax(piece)) for piece in pieces if np.isfinite(piece).any()]
                maxima += own
                if own:
                    log_spreads.append(float(np.log(max(np.median(own), 1e-9))))
    if not maxima:
        raise FitError("The residuals are too short to learn a band from: record at least a minute of a good part.")
    # How much wider than those seen the next part may be. What parts differ by is in the pooled maxima already; not
    # known is how well K parts show it, and, with few, what they have not shown at all.
    known = len(log_spreads) - 1
    squares = float(np.var(log_spreads) * len(log_spreads))
    between = (squares + PRIOR_PARTS * prior**2) / (known + PRIOR_PARTS)
    unseen = prior**2 * PRIOR_PARTS / (parts + PRIOR_PARTS)
    wider = stats.norm.ppf(_EVENLY) * np.sqrt(between / parts + unseen)
    beyond = _tail(np.array(maxima) ** 2)
    per_part = len(maxima) / parts

    def too_often(log_level: float) -> float:
        """Whether this level is exceeded more often than it may be: over all widths that the next part may have."""
        stretches = beyond(np.exp(2.0 * (log_level - wider)))
        return float(np.mean(1.0 - (1.0 - stretches) ** per_part)) - chance

    low = high = float(np.log(max(np.median(maxima), 1e-9)))
    while too_often(high) > 0.0:
        high += 1.0
    return float(np.exp(root_scalar(too_often, bracket=(low - 1.0, high), method="brentq").root if high > low else low))


def _tail(squares: Float1D) -> Callable[[Float1D], Float1D]:
    """Squared levels to the chance that one stretch's squared maximum exceeds them; half at the median and below."""
    base = float(np.median(squares))
    excess = squares[squares > base] - base
    if len(excess) < 8:
        # Too few to fit a tail: that of a Gaussian's maximum, at the size that was seen.
        unit = np.sqrt(base) / float(stats.norm.isf(0.25))
        return lambda levels: np.minimum(2.0 * stats.norm.sf(np.sqrt(levels) / unit), 0.5)
    # Probability-weighted moments (Hosking & Wallis 1987): closed form, and steady on a few dozen maxima.
    excess = np.sort(excess)
    below = (np.arange(1, len(excess) + 1) - 0.35) / len(excess)
    first, second = float(np.mean(excess)), float(np.mean((1.0 - below) * excess))
    shape = 2.0 - first / (first - 2.0 * second)
    # Heavier than exponential only where the maxima show it by more than the estimate's own standard error.
    shape = float(np.clip(shape - 1.0 / np.sqrt(len(excess)), 0.0, LONGEST_TAIL))
    scale = first * (1.0 - shape)
    return lambda levels: 0.5 * stats.genpareto.sf(np.maximum(levels - base, 0.0), shape, scale=scale)
