"""Effects that act only in a part of the reduced space M = (v_x, v_y, AR): where, and which.

In:  the library of one axis, and what one step of the selection has already.
Out: a mechanism confined to a box, each limit moved to where it fits best; or None.
What is strong in a box may be weak everywhere, and what fits best everywhere may be another law, or the same in another
shape: so every shape of every mechanism is asked in every box of a coarse grid, and the best are fitted.
"""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array, vstack

from pido.core.arrays import Float1D, Float2D
from pido.diagnosis.boxes import (
    Float32,
    Grid,
    Places,
    Space,
    gains_of_each,
    gains_of_intervals,
    gains_together,
    grid_at,
    of_unit_length,
    own_products,
    some_of,
)
from pido.diagnosis.formulas import LEVEL, factor_on_current
from pido.diagnosis.gates import IN_PLACE, Gate
from pido.diagnosis.library import Basis, Library, Score, of_themselves, told_apart
from pido.diagnosis.select import refine
from pido.diagnosis.terms import Term

CLEARLY = 15.0  # BIC by which a box must beat the best mechanism that acts everywhere
_LIMIT_WORTH = CLEARLY / 2  # BIC that each limit must bring
_SHAPES = 3  # of a mechanism that are scored in their best box
_NAMES = 6  # mechanisms that are scored
_FINALISTS = 3  # mechanisms whose limits and shape are moved
_ROUNDS = 4
_SHARES = (1.0, 0.1, 0.01)  # of the values between two places, among which a limit is moved at last
_NEAR = 6  # places, on either side of a limit, that are tried with those spread over all
_REGIONS = frozenset({"material_hard_zone"})  # confined by themselves: to where, not to how fast
_NOT_OF_THE_SPEED = frozenset({"pos", "force", "m_sp", "mrr", "engaged", "ar", "coolant"})  # fields of a state
_NEAR_IT = 0.7  # of what is asked of a box, that it has to bring before its limits are known to the row
_ALL = 0.999  # of what is left: a sum over cells that takes more away has rounded
_CHUNK = 32  # terms looked at at a time


def best_region(
    library: Library,
    current: Basis,
    taken: Collection[str] = (),
    asked: float = 0.0,
    everywhere: Score | None = None,
) -> Score | None:
    """The best confined version of any mechanism that is not `taken`; None where there is none, or none that comes near
    what is `asked` of it, in BIC below that of what is there already.

    everywhere : the best that is not confined: it may be so by a speed in both directions, of which no box has more
        than one
    """
    space = library.space
    if space is None:
        return None
    best = _best_on(space, space.coarse, library, current, taken)
    if everywhere is not None and everywhere.term.name not in taken and _may_be_confined(library, everywhere.term):
        within = _sharpen(library, current, everywhere, space, either_way=True)
        best = min((s for s in (best, within) if s is not None and s.term.gates), key=_price, default=None)
    if best is None or current.bic - best.bic < _NEAR_IT * asked:
        return None
    # Once its limits are known, to the row, other laws can be asked within the same: one that falls with speed looks
    # weak in a box that begins a little too low.
    best = _to_the_row(library, current, _otherwise(library, current, best, space), space)
    again = _best_on(space, _grid_of(space, best.term), library, current, taken)
    if again is not None:
        best = min(best, _to_the_row(library, current, again, space), key=_price)
    return _with_fewer(library, current, best, space, _SHARES)


def within_same_limits(library: Library, current: Basis, term: Term, taken: Collection[str]) -> list[Score]:
    """The likeliest mechanisms that are not `taken`, and a level, in the box of `term`: in a small box, many laws are
    alike."""
    assert library.space is not None
    grid = _grid_of(library.space, term)
    box = next(k for k in range(len(grid.limits)) if set(grid.gates(k)) == set(term.gates))
    best: dict[str, tuple[float, Term]] = {}
    for other, gain in _scan(library, current, taken, grid):
        found = (float(gain[box]), replace(other, gates=term.gates))
        best[other.name] = max(best.get(other.name, found), found, key=lambda f: f[0])
    likeliest = heapq.nlargest(_NAMES, best.values(), key=lambda f: f[0])
    return [s for _, other in likeliest if (s := library.score(other, current)) is not None]


def with_own_limits(library: Library, current: Basis, term: Term) -> Term:
    """`term`, whose limits fitted another law, with those that fit it best itself."""
    score, space = library.score(term, current) if term.gates else None, library.space
    if score is None or space is None:
        return term
    return _to_the_row(library, current, _settle(library, current, score, space), space).term


def in_its_best_box(library: Library, current: Basis, scores: Iterable[Score]) -> Score | None:
    """The likeliest of some laws, each in its best box; None where all are best everywhere."""
    space = library.space
    if space is None:
        return None
    boxed = (_in_its_box(library, current, s, space.fine) for s in scores)
    return _settled(library, current, [s for s in boxed if s.term.gates], space)


def with_best_limits(library: Library, current: Basis, laws: Sequence[Term], gates: tuple[Gate, ...]) -> Score | None:
    """The likeliest of some laws in a box, or in one without the limits of one variable; each limit between the two
    rows between which it fits best."""
    space = library.space
    assert space is not None
    found = []
    for some in _without_one(gates):
        scores = (library.score(replace(law, gates=some), current) for law in laws)
        found.append(_settled(library, current, [s for s in scores if s is not None], space))
    best = min((s for s in found if s is not None), key=_price, default=None)
    return best and _with_fewer(library, current, _to_the_row(library, current, best, space), space, _SHARES)


def _settled(library: Library, current: Basis, scores: Iterable[Score], space: Space) -> Score | None:
    """The likeliest that is confined, once the limits of a few are settled."""
    few = heapq.nsmallest(_FINALISTS, scores, key=_price)
    settled = (_settle(library, current, s, space) for s in few)
    return min((s for s in settled if s.term.gates), key=_price, default=None)


def _without_one(gates: tuple[Gate, ...]) -> list[tuple[Gate, ...]]:
    """All limits, and those of all variables but one."""
    return [gates, *(tuple(g for g in gates if g.variable != v) for v in dict.fromkeys(g.variable for g in gates))]


def _grid_of(space: Space, term: Term) -> Grid:
    """The boxes between the limits of a term."""
    limits = {v: np.unique([_limit(g) for g in term.gates if g.variable == v]) for v in space.variables}
    return grid_at(space.variables, limits)


def _best_on(space: Space, grid: Grid, library: Library, current: Basis, taken: Collection[str]) -> Score | None:
    best: dict[str, Score] = {}
    for term in _promising(library, current, taken, grid):
        score = library.score(term, current)
        if score is not None and (term.name not in best or score.bic < best[term.name].bic):
            best[term.name] = score
    boxed = [_in_its_box(library, current, score, space.fine) for score in best.values()]
    return _settled(library, current, [_sharpen(library, current, score, space) for score in boxed], space)


def _in_its_box(library: Library, current: Basis, score: Score, fine: Grid) -> Score:
    """The same term in the box of a fine grid in which it takes away most, all limits at once, if that is better."""
    assert library.noise is not None
    plain = told_apart(score.term, _there(library.columns(replace(score.term, gates=()))))[0].astype(np.float32)
    rows = of_unit_length(of_themselves(library.noise, library.noise.whiten(plain), plain))
    gain = _gains(library, score.term, fine, rows, current.residual32, own_products(fine, rows))
    box, _ = _best_box(current, gain, fine, _charge_of_limit(library, current))
    found = library.score(replace(score.term, gates=fine.gates(box)), current)
    return score if found is None else min(score, found, key=_price)


def _price(score: Score) -> float:
    """BIC; a law is likelier than a level of its own, and in a small box the two are alike."""
    return score.bic + CLEARLY * (score.term.name == "unknown")


def _promising(library: Library, current: Basis, taken: Collection[str], grid: Grid) -> Iterator[Term]:
    """The likeliest mechanisms in a few shapes, each in its best box of a grid."""
    limit = _charge_of_limit(library, current)
    ranked: dict[str, list[tuple[float, Term]]] = {}
    for term, gain in _scan(library, current, taken, grid):
        box, worth = _best_box(current, gain, grid, limit)
        value = worth - library.charge(term) - CLEARLY * (term.name == "unknown")
        ranked.setdefault(term.name, []).append((value, replace(term, gates=grid.gates(box))))
    names = heapq.nlargest(_NAMES, ranked, key=lambda name: max(v for v, _ in ranked[name]))
    for name in names:
        for _, term in heapq.nlargest(_SHAPES, ranked[name], key=lambda r: r[0]):
            yield term


def _charge_of_limit(library: Library, current: Basis) -> float:
    searched = library.charge(Term(LEVEL, gates=(Gate("AR"),))) - library.charge(Term(LEVEL))
    return searched + float(np.log(current.n)) + _LIMIT_WORTH


def _best_box(current: Basis, gain: Float32, grid: Grid, limit: float) -> tuple[int, float]:
    """The box in which what a term takes away is worth most, and that worth in BIC with its limits paid for.

    gain : (boxes,) – what the term takes away; limit : what each limit has to bring
    Of boxes with as many limits, what takes most away is worth most. All of the space is no box.
    """
    if not grid.by_limits:
        return 0, -np.inf
    most = [int(boxes[np.argmax(gain[boxes])]) for boxes in grid.by_limits.values()]
    taken = np.minimum(gain[most].astype(float) / current.rss, _ALL)
    worth = -current.n * np.log1p(-taken) - limit * np.array(list(grid.by_limits))
    best = int(np.argmax(worth))
    return most[best], float(worth[best])


def _scan(library: Library, current: Basis, taken: Collection[str], grid: Grid) -> Iterator[tuple[Term, Float32]]:
    """Terms that may be confined, each with what it takes away in every box."""
    assert library.noise is not None
    residual = current.residual32
    open_ = [
        (k, term, library.of_themselves[i:j])
        for k, (term, (i, j), varies) in enumerate(zip(library.terms, library.spans, library.varies, strict=True))
        if term.name not in taken and varies and _knows_places(term)
    ]
    coarse = library.space is not None and grid is library.space.coarse

    def own(k: int, rows: Float32) -> Float32:
        return library.in_groups[k] if coarse else own_products(grid, rows)

    singles = [each for each in open_ if len(each[2]) == 1 and _never_limits(library, each[1]) is None]
    for first in range(0, len(singles), _CHUNK):
        which, terms, rows = zip(*singles[first : first + _CHUNK], strict=True)
        signs = np.array([_sign(library, t) for t in terms])
        power = np.concatenate([own(k, row) for k, row in zip(which, rows, strict=True)])
        yield from zip(terms, gains_of_each(grid, np.concatenate(rows), residual, signs, power), strict=True)
    for k, term, rows in open_:
        if len(rows) > 1 or _never_limits(library, term) is not None:
            yield term, _gains(library, term, grid, rows, residual, own(k, rows))
    if "unknown" not in taken:
        laws = [LEVEL] if library.mismatch.sim is None else [LEVEL, factor_on_current(library.mismatch.axis)]
        for term in map(Term, laws):
            plain = library.columns(term).astype(np.float32)
            row = of_unit_length(of_themselves(library.noise, library.noise.whiten(plain), plain))
            yield term, gains_of_each(grid, row, residual, np.zeros(1), own_products(grid, row))[0]


def _knows_places(term: Term) -> bool:
    """A sensor knows nothing of speeds and cuts: what is wrong with the data is wrong everywhere."""
    return term.mechanism.kind != "data_fault" and term.mechanism.id not in _REGIONS


def _may_be_confined(library: Library, term: Term) -> bool:
    """A constant is a load everywhere; within a box it is something that no mechanism of the catalogue says."""
    return _knows_places(term) and bool(np.any(np.ptp(library.columns(term), axis=1)))


def _never_limits(library: Library, term: Term) -> str | None:
    """The variable that never limits a term: what differs between the directions of an axis is, with a limit of its
    speed, friction in one of them."""
    return f"v_{library.mismatch.axis}" if term.mechanism.id == "friction_asymmetry" else None


def _gains(library: Library, term: Term, grid: Grid, rows: Float32, residual: Float32, power: Float32) -> Float32:
    """(boxes,) – what the rows of a term, whitened, take away; nothing where a box limits what never limits it.

    power : (pairs, groups) – `own_products` of the rows
    """
    variable = _never_limits(library, term)
    own, theirs = (grid, None) if variable is None else grid.without(variable)
    if len(rows) == 1 and own.lattices:
        (gain,) = gains_of_each(own, rows, residual, np.array([_sign(library, term)]), power)
    else:
        gain = gains_together(own, rows, residual, power) if own.lattices else np.zeros(0, np.float32)
    if theirs is None:
        return gain
    out = np.zeros(len(theirs), np.float32)
    out[theirs] = gain
    return out


def _sign(library: Library, term: Term) -> float:
    """Sign that the amplitude must have, 0 where it may have any."""
    amplitude, *others = term.mechanism.amplitudes
    if others:  # of which these data show the first alone
        return 0.0
    one_side = amplitude.low == 0.0 and term.name not in library.any_sign
    return library.polarity if one_side else 0.0


def _settle(library: Library, current: Basis, score: Score, space: Space) -> Score:
    """Limits and shape moved to where they fit best, without the limits that are not worth it."""
    best = score
    for _ in range(_ROUNDS):
        former = best
        best = refine(library, current, _sharpen(library, current, best, space))
        if best.bic > former.bic - 1.0:
            break
    return best


def _to_the_row(library: Library, current: Basis, score: Score, space: Space) -> Score:
    """Each limit between the two rows between which it fits best."""
    for share in _SHARES:
        score = _sharpen(library, current, score, space, share)
    return score


def _sharpen(
    library: Library,
    current: Basis,
    score: Score,
    space: Space,
    share: float = 0.0,
    but: str = "",
    either_way: bool = False,
) -> Score:
    """The best interval of one variable after another, the most worth first.

    share : of the values between two places, between which the limits there are are moved; 0: at places only
    but : a variable that is left as it is
    either_way : whether what comes in the place of others may limit it that does not already
    """
    while True:
        found = []
        for variable, at in space.places.items():
            if variable == but or variable == _never_limits(library, score.term):
                continue
            own = [_limit(g) for g in score.term.gates if g.variable == variable]
            if variable in IN_PLACE and not (own or (either_way and _may_limit(library, variable, score.term))):
                continue
            limits = space.between_rows(variable, own, share) if share else _limits_near(at, own)
            if len(limits):
                found.append(_best_interval(library, current, score, variable, limits, space))
        best = min(found, key=_with_limits, default=score)
        if _with_limits(best) > _with_limits(score) - 1.0:
            return score
        score = best


def _may_limit(library: Library, speed: str, term: Term) -> bool:
    """Whether a speed without its sign may limit a term: not that of the own axis, unless the term is of the
    cut or of a place.

    What the motion alone says, and depends on how fast its axis goes either way, is a law of that speed.
    """
    return speed != f"|v_{library.mismatch.axis}|" or not _NOT_OF_THE_SPEED.isdisjoint(term.mechanism.follows_from)


def _otherwise(library: Library, current: Basis, score: Score, space: Space) -> Score:
    """The same term without the limits of one variable, and the others settled."""
    best = _with_fewer(library, current, score, space, (0.0,))
    return best if best is score else _settle(library, current, best, space)


def _with_fewer(library: Library, current: Basis, score: Score, space: Space, shares: tuple[float, ...]) -> Score:
    """The same term without the limits of one variable, and the others moved: limits of two variables may stand for
    those of a third."""
    best = score
    for variable in dict.fromkeys(g.variable for g in score.term.gates):
        rest = tuple(g for g in score.term.gates if g.variable != variable)
        fewer = library.score(replace(score.term, gates=rest), current)
        for share in shares:
            if fewer is not None:
                fewer = _sharpen(library, current, fewer, space, share, but=variable, either_way=True)
        if fewer is not None:
            best = min(best, fewer, key=_with_limits)
    return best


def _limits_near(places: Places, limits: list[float]) -> Float1D:
    """Some of all places, and all that are near one of `limits`."""
    near = [places.limits[max(0, k - _NEAR) : k + _NEAR + 1] for k in np.searchsorted(places.limits, limits)]
    return np.unique(np.concatenate([some_of(places), *near]))


def _best_interval(
    library: Library, current: Basis, score: Score, variable: str, limits: Float1D, space: Space
) -> Score:
    """The same term between the limits of one variable that fit best, its other limits as they are.

    Nothing is approximated: between two limits, whitened rows are the sum of those of the classes there. A loop answers
    late to what is inside: rows pass it once they are in their classes.
    """
    others = tuple(g for g in score.term.gates if g.variable != variable)
    columns = told_apart(score.term, _there(library.columns(replace(score.term, gates=others).at_once())))[0]
    k, part = len(columns), space.between(variable, limits)
    each = vstack([csr_array((part.data * c[part.indices], part.indices, part.indptr), part.shape) for c in columns])
    whitened = csr_array(each @ (library.whitening_late if score.term.loop else library.whitening).T)
    sign = _sign(library, score.term) if len(columns) == 1 else 0.0
    first, last, gain = gains_of_intervals(whitened, k, current.Q32, current.residual32, sign)
    # What is narrower than the least step between two levels is no range of speeds, but where a sign turns.
    least = 0.0 if variable in IN_PLACE else -np.inf
    low, high = np.r_[least, limits][first], np.r_[limits, np.inf][last]
    gain[high - low < space.places[variable].gaps.min()] = 0.0
    if variable == f"|v_{library.mismatch.axis}|" and "pos" in score.term.mechanism.follows_from:
        # What is less where its places pass faster is smoothed by the drive and its loop, and in no range of speeds.
        gain[first == 0] = 0.0
    count = (first > 0).astype(int) + (last < len(limits)) + len(others)
    worth = -current.n * np.log1p(-np.minimum(gain / current.rss, _ALL)) - count * _charge_of_limit(library, current)
    at = int(np.argmax(worth))
    sides = [Gate(variable, low=float(limits[first[at] - 1]))] if first[at] > 0 else []
    sides += [Gate(variable, high=float(limits[last[at]]))] if last[at] < len(limits) else []
    gates = (*others, *sides)
    found = None if set(gates) == set(score.term.gates) else library.score(replace(score.term, gates=gates), current)
    return found if found is not None and _with_limits(found) < _with_limits(score) else score


def _there(columns: Float2D) -> Float2D:
    """The columns that a form of a law has: all others are zero, and take nothing away in any box."""
    return columns[columns.any(axis=1)]


def _with_limits(score: Score) -> float:
    """BIC, and what each limit must bring beyond it; where an area and a rate limit alike, it is the area."""
    rate = any(g.variable == "MRR" for g in score.term.gates)
    return score.bic + _LIMIT_WORTH * len(score.term.gates) + CLEARLY * rate


def _limit(gate: Gate) -> float:
    return gate.low if np.isfinite(gate.low) else gate.high
