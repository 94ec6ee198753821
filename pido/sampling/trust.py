"""How far the equation's word is followed, and where: learned by playing the arrival of parts with rows at hand.

In:  real samples, term sets from plain to rich, a way to train a model.
Out: `Trust`: per axis an equation, and per region a share between 0 (the model's own word stands) and 1 (the equation's).

A region is how much further a row is out than the samples: its leverage over what nearly all of them keep, in that of
the equations that has most. Rows are left
out of model and equations in three ways, since what is missing decides who is better:
  stretch  whole parts, or stretches of a part: a part that is like others
  forward  all that came after a third, a half, two thirds: a part that is not
  random   a quarter of the rows: a part that repeats what has been made
In a play, currents t + w (e - t) between model t and equation e have the least square error at
    w = sum (y - t)(e - t) / sum (e - t)²
A region's share is the mean over the plays of one kind less its standard error, the smallest of the three kinds, and of
that the half: three quarters of what there is to gain, for a quarter of what there is to lose. It stands only if shares
that were learned without a play would have helped it, on the geometric mean of all plays.

What models make of such rows is another question: they are trained with them in every third play. That decides how
densely rows are taken from a path (rows per bin, and width of a bin), axis by axis, whether they are used at all, and
whether rows anchored in recorded ones (`pido.sampling.anchored`) are of use beside them.

Measured on a real air cut and on virtual impellers: comparing errors on stretches alone took 20 to 50 % off models that
later met paths they knew; leverage up to ten times the samples' own is where equations gain most.
"""  # noqa: E501

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pido.core.arrays import Bool1D, Bool2D, Float1D, Float2D, Int2D
from pido.core.axes import AXES
from pido.core.machining import Machine
from pido.core.samples import PIE, Samples, Train
from pido.equations.fit import GlobalEquation, fit_global
from pido.equations.terms import FRICTION, HELD, HELD_SMALL, TermSet
from pido.feature_space.grid import SAMPLING_GRID, Grid
from pido.feature_space.regional import folds
from pido.sampling.anchored import anchored, unsaid

log = logging.getLogger(__name__)

SHIPPED = (HELD_SMALL, HELD, FRICTION)
LEVELS = (1.0, 3.0, 10.0, 100.0)
"""Leverage over that of 95 % of the samples, where a region ends and the next begins; beyond the last: no trust."""
_QUANTILE = 0.95
_CAUTION = 0.5
_GAIN = 0.98  # of the held-out error: less is not worth the rows
_ROWS = 8  # of a play in a region, to have a say there
_LEAST = 0.1  # a smaller share is none


@dataclass(frozen=True)
class Spacing:
    """How densely rows are taken from a coming path: at most `density` from a bin.

    width : of such a bin, over that of the bins that are balanced
    """

    density: float = 40.0
    width: float = 1.0

    def __str__(self) -> str:
        bins = "bin" if self.width == 1 else f"bin of {self.width:g} times the width"
        return f"{self.density:g} rows per {bins}"

    def grid(self, plain: Grid) -> Grid:
        """The bins, from those that are balanced."""
        x, y, ar = (self.width * w for w in plain.width)
        return Grid((x, y, ar))

    def others(self) -> tuple[Spacing, ...]:
        """More rows of the same bins, and fewer: as many from bins twice as wide."""
        return Spacing(4 * self.density, self.width), Spacing(self.density, 2 * self.width)


@dataclass(frozen=True, eq=False)
class Trust:
    """terms : per axis what the equation is made of; None: no generated row helps this axis
    share : (4, regions), 0 to 1; error : (4, regions), A – of such currents on rows left out; infinite: unknown
    gain : per axis relative change of held-out error, geometric mean over plays; negative is better
    tried : all equations there were; a row's region is told from all of them
    spacing : per axis, how densely rows are taken
    anchored : per axis, whether rows anchored in recorded ones help its model
    """

    terms: tuple[TermSet | None, ...]
    share: Float2D
    error: Float2D
    gain: tuple[float, ...]
    tried: tuple[TermSet, ...]
    spacing: tuple[Spacing, ...] = (Spacing(),) * 4
    anchored: tuple[bool, ...] = (False,) * 4

    @property
    def any(self) -> bool:
        """Whether any axis has use for rows of a coming path."""
        return any(terms is not None for terms in self.terms)


@dataclass(frozen=True, eq=False)
class _Play:
    """Rows that model and equations knew, rows left out, what was said of these: (n, 4), A; their regions."""

    rest: Samples
    left: Samples
    model: Float2D
    equations: tuple[Float2D, ...]
    where: Int2D


def learn(
    real: Samples, machine: Machine, train: Train, extended: Sequence[TermSet] = (), *,
    omega: float = 1.0, generated: float = 1.0, grid: Grid = SAMPLING_GRID, density: float = 40.0,
) -> Trust:  # fmt: skip
    """Play arrivals and see, per axis, which equation helps where, and how densely rows should be taken from a path.

    extended : term sets with accepted physics, tried beside the shipped ones
    omega, generated : weights of real and generated rows; grid, density : bins and rows per bin, if no others are better
    """  # noqa: E501
    real = real.take(np.lexsort((real.row, real.part.astype(str))))  # the order of arrival must not matter
    tried = (*SHIPPED, *extended)
    plays = list(_plays(real))
    p, regions = len(plays), len(LEVELS) + 1
    plain = (Spacing(density),) * 4
    none = Trust((None,) * 4, np.zeros((4, regions)), np.full((4, regions), np.inf), (0.0,) * 4, tried, plain)
    if p < 4:
        return none
    kind = np.array([name for name, _ in plays])
    # per play, axis, region, and (but for the first two) equation
    count, base = np.zeros((p, 4, regions)), np.zeros((p, 4, regions))
    along, square = np.zeros((len(tried), p, 4, regions)), np.zeros((len(tried), p, 4, regions))
    played = []
    for k, (_, out) in enumerate(plays):
        rest, left = real.take(~out), real.take(out)
        model = train(rest, np.full((len(rest), 4), omega))(left)
        equations = [fit_global(rest, machine, terms) for terms in tried]
        where, said = region(left, rest, equations), tuple(equation.predict(left) for equation in equations)
        played.append(_Play(rest, left, model, said, where))
        known = np.isfinite(left.currents) & np.isfinite(model)
        miss = np.where(known, left.currents - model, 0.0)
        base[k], count[k] = _sums(miss**2, where), _sums(known.astype(float), where)
        for c in range(len(tried)):
            away = np.where(known, said[c] - model, 0.0)
            along[c, k], square[c, k] = _sums(miss * away, where), _sums(away**2, where)
    chosen: list[TermSet | None] = [None] * 4
    share, error, gain = none.share.copy(), none.error.copy(), [0.0] * 4
    for i in range(4):
        for c, terms in enumerate(tried):
            if not terms.concerns(AXES[i]):
                continue
            sums = along[c, :, i], square[c, :, i], count[:, i]
            ratio = _ratios(base[:, i].sum(axis=1), *sums, kind)
            if ratio - 1.0 < min(gain[i], _GAIN - 1.0):
                own = _shares(*sums, kind, np.ones((1, p), bool))[0]
                chosen[i], share[i], gain[i] = terms, own, ratio - 1.0
                left_over = (base[:, i] - 2 * own * sums[0] + own**2 * sums[1]).sum(axis=0)
                number = count[:, i].sum(axis=0)
                error[i] = np.where(number > 0, np.sqrt(np.maximum(left_over, 0) / np.maximum(number, 1)), np.inf)
    found = Trust(tuple(chosen), share, error, tuple(gain), tried, plain)
    found = _spaced(found, played[::3], train, grid, omega, generated)
    for i, axis in enumerate(AXES):
        best, one = found.terms[i], found.spacing[i]
        name = "none" if best is None else f"equation '{best.id}' to {found.share[i].round(2).tolist()}, {one}"
        more = ", and anchored ones" if found.anchored[i] else ""
        log.info("%s: generated rows: %s (%+.1f %% held-out RMSE)%s", axis, name, 100 * found.gain[i], more)
    return found


def _spaced(trust: Trust, plays: Sequence[_Play], train: Train, grid: Grid, omega: float, generated: float) -> Trust:
    """Models trained with rows of each spacing: another spacing than the plain one must be better by 2 % and by two
    standard errors over the plays; an axis whose models lose by the rows, by a standard error, has no use for them.
    Anchored rows need only be better beside the plain ones on the mean: they lie where rows are, and risk little.

    The others are cautious: there are four plays, and on a real air cut one standard error for another spacing, or less
    than one against the rows, took a third off what they bring. Asked of anchored rows, a standard error did the same.
    """
    spacings = (trust.spacing[0], *trust.spacing[0].others()) if trust.any else (trust.spacing[0],)
    tried = [(spacing, False) for spacing in spacings] + [(spacings[0], True)]
    used = [terms is not None for terms in trust.terms]
    ratio = np.zeros((len(tried), len(plays), 4))  # log of the error over that of the model without such rows
    for k, play in enumerate(plays):
        base = _square(play.model - play.left.currents)
        left = replace(play.left, row=np.arange(len(play.left)))
        beside = anchored(play.rest, left, train, grid, np.random.default_rng(0))
        for c, (spacing, more) in enumerate(tried):
            if more and not len(beside):
                ratio[c, k] = ratio[0, k] if trust.any else 0.0
                continue
            known, made, model = play.rest, [], play.model
            if more:
                model = _trained(train, known, [beside], omega, generated)(play.left)
            else:  # nothing is learned for axes without rows of the path
                known = replace(known, currents=np.where(used, known.currents, np.nan))
            rows = _of_play(play, trust, spacing, grid, model)
            if more:
                made = [unsaid(beside, rows.row, rows.currents)]
            if len(rows) or more:
                helped = _trained(train, known, [*made, rows], omega, generated)(play.left)
                with np.errstate(divide="ignore", invalid="ignore"):
                    ratio[c, k] = 0.5 * np.log(_square(helped - play.left.currents) / base)
    terms, share, spacing, gain = list(trust.terms), trust.share.copy(), list(trust.spacing), list(trust.gain)
    of_use = [False] * 4
    for i in range(4):
        by_path = ratio[:-1, np.isfinite(ratio[:-1, :, i]).all(axis=0), i]
        if terms[i] is not None and by_path.shape[1] >= 2:
            mean, error = _mean_and_error(by_path)
            if mean[0] >= error[0]:
                terms[i], share[i], gain[i] = None, 0.0, 0.0
            else:
                mean, error = _mean_and_error(by_path - by_path[0])
                better = (mean + 2.0 * error < 0) & (mean < np.log(_GAIN))
                spacing[i] = spacings[int(np.argmin(np.where(better, mean, 0.0)))]
        beside = ratio[-1, :, i] - (0.0 if trust.terms[i] is None else ratio[0, :, i])
        of_use[i] = bool(np.mean(beside[np.isfinite(beside)]) < 0) if np.isfinite(beside).any() else False
    return replace(
        trust, terms=tuple(terms), share=share, spacing=tuple(spacing), gain=tuple(gain), anchored=tuple(of_use)
    )


def _of_play(play: _Play, trust: Trust, spacing: Spacing, grid: Grid, model: Float2D) -> Samples:
    """Rows of the path that was left out, as far as the equation is trusted there beside what a model says of them."""
    said = model.copy()
    for i, terms in enumerate(trust.terms):
        if terms is not None:
            said[:, i] += trust.share[i, play.where[:, i]] * (play.equations[_at(trust, i)][:, i] - model[:, i])
    silent = (trust.share[np.arange(4), play.where] == 0) | ~np.isfinite(said)
    take = taken(play.left, grid, (spacing,) * 4, np.random.default_rng(0))
    origin = np.full(len(play.left), PIE, np.int64)
    number = np.arange(len(play.left))
    rows = replace(play.left, origin=origin, row=number, currents=np.where(take & ~silent, said, np.nan))
    return rows.take(np.flatnonzero(np.isfinite(rows.currents).any(axis=1)))


def _trained(
    train: Train, real: Samples, made: Sequence[Samples], omega: float, generated: float
) -> Callable[[Samples], Float2D]:
    """A model of real rows of weight `omega` beside generated ones."""
    rows = Samples.concat([real, *made])
    weights = np.full((len(rows), 4), generated)
    weights[: len(real)] = omega
    return train(rows, weights)


def _mean_and_error(values: Float2D) -> tuple[Float1D, Float1D]:
    """(c,) each: mean over the plays (c, p), and its standard error."""
    return values.mean(axis=1), values.std(axis=1, ddof=1) / np.sqrt(values.shape[1])


def _at(trust: Trust, axis: int) -> int:
    """Index of an axis' equation among those that were tried."""
    return next(c for c, terms in enumerate(trust.tried) if terms is trust.terms[axis])


def _square(miss: Float2D) -> Float1D:
    """(4,): mean square over the rows where it is known; NaN where it never is."""
    number = np.isfinite(miss).sum(axis=0)
    return np.where(number > 0, np.nansum(miss**2, axis=0) / np.maximum(number, 1), np.nan)


def region(rows: Samples, real: Samples, equations: Sequence[GlobalEquation]) -> Int2D:
    """(n, 4): index into the regions of each row and axis; `equations` are fitted on `real`. A column that few samples
    move has little say in an equation without it, and a lot in one with it: the largest leverage counts."""
    out = np.zeros((len(rows), 4))
    for one in equations:
        limit = np.quantile(one.leverage(real), _QUANTILE, axis=0)
        out = np.maximum(out, one.leverage(rows) / np.maximum(limit, 1e-300))
    return np.digitize(out, LEVELS)


def currents(
    rows: Samples, real: Samples, machine: Machine, trust: Trust, train: Train, omega: float = 1.0,
    beside: Samples | None = None, generated: float = 1.0, also: Bool1D | None = None,
) -> tuple[Float2D, Float2D, Int2D, Float2D]:  # fmt: skip
    """Currents t + w (e - t) of the rows, their expected errors, their regions, and t: (n, 4) each; the first two NaN
    where w is 0.

    beside : anchored rows of weight `generated`, which t learns from as well
    also : (4,) - axes whose t is asked for although no equation is trusted there
    """
    used = np.array([terms is not None for terms in trust.terms])
    used = used if also is None else used | also
    model = np.full((len(rows), 4), np.nan)
    if used.any():
        known = [real] if beside is None else [real, beside]
        known, *made = (replace(r, currents=np.where(used, r.currents, np.nan)) for r in known)  # others need no model
        model = _trained(train, known, made, omega, generated)(rows)
    equations = {terms.id: fit_global(real, machine, terms) for terms in trust.tried}
    where = region(rows, real, list(equations.values()))
    axis = np.arange(4)
    share, error = trust.share[axis, where], trust.error[axis, where]
    said = model.copy()
    for i, terms in enumerate(trust.terms):
        if terms is not None:
            said[:, i] += share[:, i] * (equations[terms.id].predict(rows)[:, i] - model[:, i])
    silent = (share == 0) | ~np.isfinite(said)
    return np.where(silent, np.nan, said), np.where(silent, np.nan, error), where, model


def _plays(real: Samples) -> Iterator[tuple[str, Bool1D]]:
    """Kind of each play and the rows left out; none where too few rows would be left on either side."""
    n = len(real)
    fold, order = folds(real, 6), np.arange(n)
    quarter = np.random.default_rng(0).permutation(n) % 4
    plays = [("stretch", fold == k) for k in np.unique(fold)]
    plays += [("forward", order >= share * n) for share in (1 / 3, 1 / 2, 2 / 3)]
    plays += [("random", quarter == k) for k in (0, 1)]
    return ((kind, out) for kind, out in plays if out.sum() >= 20 and (~out).sum() >= 20)


def _sums(values: Float2D, where: Int2D) -> Float2D:
    """(4, regions): sums of (n, 4) values by region."""
    size = len(LEVELS) + 1
    return np.stack([np.bincount(where[:, i], values[:, i], size).astype(float) for i in range(4)])


def _shares(along: Float2D, square: Float2D, count: Float2D, kind: np.ndarray, keep: np.ndarray) -> Float2D:
    """(l, regions): shares from the plays (l, p) in `keep`; the sums are (p, regions)."""
    heard = (count >= _ROWS) & (square > 1e-20)
    best = np.where(heard, np.clip(along / np.where(heard, square, 1.0), -1.0, 1.5), 0.0)
    say = np.where(heard, np.sqrt(square / np.maximum(count, 1.0)), 0.0)
    use = (keep[:, None] & (kind == np.unique(kind)[:, None])[None]).astype(float)
    total, own = use @ say, use @ say**2
    with np.errstate(divide="ignore", invalid="ignore"):
        mean, effective = use @ (say * best) / total, total**2 / own
        spread = np.maximum(use @ (say * best**2) / total - mean**2, 0.0)
        low = mean - np.sqrt(spread / (effective - 1.0))
    low = np.where((use @ heard.astype(float) >= 2) & (effective > 1.3), low, np.inf).min(axis=1)
    share: Float2D = np.where(np.isfinite(low), _CAUTION * np.clip(low, 0.0, 1.0), 0.0)
    share[:, -1] = 0.0
    return np.where(share < _LEAST * _CAUTION, 0.0, share)


def _ratios(base: Float1D, along: Float2D, square: Float2D, count: Float2D, kind: np.ndarray) -> float:
    """Geometric mean of held-out RMSE with shares over that of the model, each play under the shares of the others."""
    share = _shares(along, square, count, kind, ~np.eye(len(kind), dtype=bool))
    after = base - 2 * (share * along).sum(axis=1) + (share**2 * square).sum(axis=1)
    told = base > 1e-20
    if not told.any():
        return 1.0
    return float(np.exp(0.5 * np.mean(np.log(np.maximum(after[told] / base[told], 1e-6)))))


def taken(path: Samples, grid: Grid, spacing: Sequence[Spacing], rng: np.random.Generator) -> Bool2D:
    """(n, 4): rows of the path that each axis takes, at most `density` from each of its bins, drawn at random."""
    draw, out = rng.random(len(path)), np.zeros((len(path), 4), bool)
    for one in dict.fromkeys(spacing):
        voxel = one.grid(grid).ids(path.reduced)
        order = np.lexsort((draw, voxel))
        _, first, count = np.unique(voxel[order], return_index=True, return_counts=True)
        place = np.empty(len(order), np.int64)
        place[order] = np.arange(len(order)) - np.repeat(first, count)
        out[:, [i for i in range(4) if spacing[i] == one]] = (place < one.density)[:, None]
    return out
