"""When no name is right: one honest `unknown` in place of names that each explain a part.

In:  the terms that a selection chose on one axis, and its library.
Out: the same terms, or fewer of them and one term without a name.
A formula or a surface competes in the same currency as the mechanisms (BIC, charged for everything that was tried), and
has to win clearly; then every named term must still be needed beside it.
"""

from __future__ import annotations

import heapq
import itertools
import logging
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from pido.core.arrays import Float1D
from pido.diagnosis.arms import arms, eased
from pido.diagnosis.bends import bends
from pido.diagnosis.confirm import less_error, no_more_error, plain_errors
from pido.diagnosis.dynamics import Ringing, ringing_terms
from pido.diagnosis.estimate import LONGEST_LAG_S
from pido.diagnosis.flexible import Coarse, coarse, price, structure
from pido.diagnosis.formulas import (
    LOOKED_AT,
    Formula,
    Peak,
    Surface,
    Unnamed,
    curve_over_current,
    in_classes,
)
from pido.diagnosis.ground import Ground
from pido.diagnosis.identify import numbers
from pido.diagnosis.judge import Judge
from pido.diagnosis.latched import Latched, Switched, latched_terms, switched_terms
from pido.diagnosis.late import SHORTEST_S, Behind, Fading, Modulated, late_terms
from pido.diagnosis.late_arms import late_arms
from pido.diagnosis.late_eased import eased_lately
from pido.diagnosis.library import Basis, Library, Nameless, Score, basis
from pido.diagnosis.mechanisms.base import Mechanism
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.patches import patch_terms
from pido.diagnosis.products import gains_by_averages
from pido.diagnosis.resonant import resonant
from pido.diagnosis.rested import Rested, rested_terms
from pido.diagnosis.signals import Known
from pido.diagnosis.terms import Term, bic, fit
from pido.diagnosis.tools import ByTool, by_tool, tools_of
from pido.diagnosis.transients import Transient, transient_terms
from pido.diagnosis.waves import waves
from pido.diagnosis.whiten import Noise

log = logging.getLogger(__name__)
_STRUCTURE_P = 1e-4  # of a flexible model's gain on unseen folds
_LEAST_SHARE = 0.08  # of all that is systematic: a smaller rest is a textbook form that fits almost
_CLEARLY = 25.0  # BIC by which a model without a name must win
_CLEARLY_SHARE = 0.03  # and by this share of all that the named terms gain, in BIC and in sum of squares
_SEPARATE_SHARE = 0.12  # the same where it stands beside all names: a smaller rest is their misfit
_CURVE_SHARE = 0.3  # the same for a curve, and for what remembers beside names: both mend what any law lacks
_LESS_ERROR = 0.01  # of the error with names, in A on unseen folds, that a model without a name has to take away
_STILL_NEEDED = 0.35  # share of its former BIC gain that a named term must keep beside an unnamed one
_SAME = 0.97  # correlation with a mechanism of the catalogue that makes a formula that mechanism
_EDGE = 2.0  # widths of a peak, within which it mends the edge of a box
_EDGE_SHARE = 0.05  # of an edge, to which it is known
_PAIRS = 10
_SURFACES = 4  # that are asked for what they take away themselves
_ROWS = 3_000  # of the coarse residual, on which these are compared
_RIDGE = 1e-3  # of a knot's own power
_MANY = 3  # laws on one axis: so many at once are less likely than one that nobody has named
_KNOTS = (10, 24)  # of a curve over the current: few, or as many as what bends quickly takes
_ALIKE = 2.0  # BIC: one law with no more numbers than several is as likely, and the same where it is their sum
_ROUNDED = 1 + 1e-6  # times an error: the same
_FAR_MORE = 2.0  # times what others remove
_GOOD_SHARE = 0.1  # of a mismatch's mean square
_FINALISTS = 12
_OFFERED = 40  # by averages, whose quantities curves and surfaces are asked over
_TUNED = 3
_EXTENDED = 4  # products that are asked for with one more quantity
_CLASSES = 1_000  # of a quantity, in which peaks are compared
_CHARGE = 2 * np.log(LOOKED_AT)  # BIC
_REMEMBERS = (Ringing, Behind, Rested, Transient, Latched, Switched)
_FIRST_STEPS = (0.5, 0.4, 0.4, 0.4)  # of the shape parameters
_TRIALS = 20  # of a shape, per parameter


def with_unknown(library: Library, noise: Noise, terms: list[Term], seed: int) -> tuple[list[Term], str | None]:
    """`terms`, or what remains of them beside one `unknown`; and a sentence about what is left over."""
    mismatch = library.mismatch
    nothing = basis(library, noise, [])
    best_terms, best = terms, _charged(library, noise, terms)
    for start in (terms, []) if terms else (terms,):
        for found in best_nameless(library, noise, start):
            trial = _needed(library, noise, start, found.term)
            instead = library.score(found.term, basis(library, noise, trial[:-1]))
            if instead is not None and is_known(library, noise, instead):
                continue  # it is what has gone for it in other words
            tried = _charged(library, noise, trial)
            share = _share_asked(found.term, beside=len(trial) > max(1, len(terms)))
            margin = _CLEARLY + min(share, _SEPARATE_SHARE) * max(nothing.bic - best.bic, 0.0)
            more = best.rss - tried.rss > share * max(nothing.rss - best.rss, 0.0)
            if len(trial) < len(best_terms) and numbers(trial) <= numbers(best_terms):
                # A name comes first because a law of the textbook is likely; that several act at once is not.
                margin, more = -_ALIKE, True
            likelier = tried.bic < best.bic - margin and more
            # A form that is smooth where a sign is sharp fits the transients of a filtered current better than the law
            # itself: the plain error has to be smaller as well, and not only the quick part of it.
            plainly = likelier and (
                clearly_less(mismatch, trial, best_terms) or _says_the_rest_too(mismatch, trial, best_terms)
            )
            if plainly or says_it_all(mismatch, trial, best_terms):
                best_terms, best = trial, tried
    best_terms = _curve_instead(library, noise, best_terms)
    joint = fit(mismatch, noise, best_terms)
    left = structure(mismatch, joint.residual, noise, seed)
    named = _explained(mismatch, best_terms, joint.amplitudes)
    share = left.explained / max(left.explained + named, 1e-30)
    log.info("axis %s: %.0f %% of what is systematic is left over, p = %.1g", mismatch.axis, 100 * share, left.p_value)
    if left.p_value < _STRUCTURE_P and share > _LEAST_SHARE:
        return best_terms, (
            f"axis {mismatch.axis}: a flexible model still predicts {share:.0%} of what is systematic there, "
            "and neither a mechanism nor a formula or curve describes it."
        )
    return best_terms, None


def _curve_instead(library: Library, noise: Noise, terms: list[Term]) -> list[Term]:
    """A curve over the simulated current in place of many laws that it replaces, or of laws that do far less."""
    mismatch = library.mismatch
    if mismatch.sim is None:
        return terms
    rough, fine = (curve_over_current(mismatch, count) for count in _KNOTS)
    if rough is None or fine is None:
        return terms
    by_rough, by_fine = ([Term(curve).behind(library.loop)] for curve in (rough, fine))
    if len(terms) >= _MANY and says_it_all(mismatch, by_rough, terms):
        return by_rough
    # What is no more likely by averages, which are soon compared, does not do far more.
    few = coarse(mismatch, fit(mismatch, noise, []).residual, noise)
    curve = fine.over({name: (np.nan_to_num(mismatch.sim[few.rows]), "A") for name in fine.reads})
    named = np.concatenate([np.zeros((0, len(few.rows))), *(library.columns(t)[:, few.rows] for t in terms)])
    likely = price(curve[:, curve.any(axis=0)], few) < price(named.T, few)
    return by_fine if likely and _says_far_more(mismatch, by_fine, terms) else terms


def _charged(library: Library, noise: Noise, terms: Sequence[Term]) -> Basis:
    """`terms`, with what was looked at for every one of them that has no name."""
    whole = basis(library, noise, terms)
    return replace(whole, searched=whole.searched + _CHARGE * sum(t.name == "unknown" for t in terms))


def clearly_less(mismatch: Mismatch, trial: Sequence[Term], terms: Sequence[Term]) -> bool:
    """Whether `trial` leaves clearly less error on unseen folds than `terms`.

    Clearly is a share of the error, or of what is removed where this is little: of a faint effect all is less.
    """
    none, former, now = (error**2 for error in plain_errors(mismatch, (), terms, trial))
    return former - now > min(2 * _LESS_ERROR * former, _CLEARLY_SHARE * (none - now))


def says_it_all(mismatch: Mismatch, few: Sequence[Term], many: Sequence[Term]) -> bool:
    """Whether at least two terms fewer, with no more numbers, leave less error on unseen folds; also than each alone of
    those that they replace, which the others may have spoilt."""
    fewer = len(few) <= len(many) - 2 and numbers(few) <= numbers(many)
    replaced = [[t] for t in many if t not in few]
    return fewer and all(less_error(mismatch, few, others, 0.0) for others in (many, *replaced))


def _says_the_rest_too(mismatch: Mismatch, few: Sequence[Term], many: Sequence[Term]) -> bool:
    """Whether one law without a name leaves no more error on unseen folds than another one beside names."""
    halves = len(few) < len(many) and any(t.name == "unknown" for t in many)
    return halves and no_more_error(mismatch, few, many, _ROUNDED)


def _says_far_more(mismatch: Mismatch, one: Sequence[Term], terms: Sequence[Term]) -> bool:
    """Whether a law of the current itself removes a good share of all on unseen folds, and twice what `terms` do."""
    none, former, now = (error**2 for error in plain_errors(mismatch, (), terms, one))
    return none - now > max(_FAR_MORE * (none - former), _GOOD_SHARE * none)


def _share_asked(unnamed: Term, beside: bool) -> float:
    """Share of what the names gain that a model without a name has to add to it."""
    if isinstance(unnamed.mechanism, Surface) or (beside and isinstance(unnamed.mechanism, _REMEMBERS)):
        return _CURVE_SHARE
    return _SEPARATE_SHARE if beside else _CLEARLY_SHARE


def _needed(library: Library, noise: Noise, named: Sequence[Term], unnamed: Term) -> list[Term]:
    """Named terms that are still needed beside the unnamed one, and that one."""
    kept = list(named)
    former = basis(library, noise, kept).bic
    worth = {t: basis(library, noise, [o for o in kept if o is not t]).bic - former for t in kept}
    while kept:
        whole = basis(library, noise, [*kept, unnamed]).bic
        now = [basis(library, noise, [*[o for o in kept if o is not t], unnamed]).bic - whole for t in kept]
        shares = [n / max(worth[t], 1e-9) for n, t in zip(now, kept, strict=True)]
        weakest = int(np.argmin(shares))
        if shares[weakest] >= _STILL_NEEDED and now[weakest] > 12.0:
            break
        kept = kept[:weakest] + kept[weakest + 1 :]
    return [*kept, unnamed]


def best_nameless(library: Library, noise: Noise, start: Sequence[Term]) -> list[Score]:
    """The best law without a name, and a curve or surface over the same quantities where that is clearly better."""
    return _looked_for(library, noise, tuple(start)).best


def laws_beside(library: Library, noise: Noise, start: Sequence[Term]) -> list[Score]:
    """The laws without a name that say most, each in the shape that was looked at first, the likeliest first."""
    return _looked_for(library, noise, tuple(start)).laws


def _looked_for(library: Library, noise: Noise, start: tuple[Term, ...]) -> Nameless:
    """Asked once for terms and a noise: when terms have fallen, it is asked again beside the same or nothing."""
    ground = ground_of(library, noise)
    if start not in library.nameless:
        library.nameless[start] = _nameless(library, noise, start, ground)
    return library.nameless[start]


def _nameless(library: Library, noise: Noise, start: tuple[Term, ...], ground: Ground) -> Nameless:
    mismatch = library.mismatch
    current = basis(library, noise, start)
    residual = fit(mismatch, noise, start).residual
    few = coarse(mismatch, residual, noise)
    ranked = heapq.nlargest(_OFFERED, _by_gain(ground, few), key=lambda g: g[0])
    offered = [t.behind(library.loop) for _, t in ranked]
    quick = [Term(law).behind(library.loop) for law in ground.quick.best(residual)]
    late = [
        *ringing_terms(mismatch, residual, ground.whole),
        *late_terms(ground.lately, few),
        *late_arms(ground.lately, few),
        *eased_lately(ground.lately, few),
    ]
    late += rested_terms(mismatch, few)
    judge = Judge(mismatch, noise, residual)
    late += [*transient_terms(judge, ground.seldom), *latched_terms(judge, ground.whole)]
    late += [*switched_terms(judge, ground.whole), *patch_terms(judge, ground.whole)]
    scores = [s for t in (*offered[:_FINALISTS], *quick, *late) if (s := library.score(t, current)) is not None]
    laws: dict[Mechanism, Score] = {}
    for score in sorted(scores, key=lambda s: s.bic):
        if not _at_an_edge(score.term, start):
            laws.setdefault(score.term.mechanism, score)
    laws = _of_one_more(library, current, laws, ground, residual)
    tuned = (tune(library, current, s) for s in laws.values() if not is_known(library, noise, s))
    new = (s for s in tuned if not (is_known(library, noise, s) or _at_an_edge(s.term, start)))
    # A shape may be far from its best where it was looked at first.
    best = min(itertools.islice(new, _TUNED), key=lambda s: s.bic, default=None)
    likeliest = list(laws.values())
    if best is None:
        return Nameless(likeliest, [])
    curve = best = of_fewer_quantities(library, noise, current, best)
    wanted: list[frozenset[str]] = []
    for term in offered:
        names = term.mechanism.reads
        for each in (names, *(frozenset({n}) for n in names)):
            if each not in wanted:
                wanted.append(each)
    asked = [s for s in ground.surfaces if frozenset(s.variables) in wanted[:_PAIRS]]
    for surface in dict.fromkeys([*asked, *_ranked_surfaces(ground.surfaces, ground.thin, few)[:_SURFACES]]):
        found = library.score(Term(surface).behind(library.loop), current)
        if found is not None and found.bic < curve.bic - _CLEARLY and not is_known(library, noise, found):
            curve = found
    return Nameless(likeliest, [best] if curve is best else [best, curve])


def _of_one_more(
    library: Library, current: Basis, laws: dict[Mechanism, Score], ground: Ground, residual: Float1D
) -> dict[Mechanism, Score]:
    """`laws`, the likeliest first, and products of the best with one more quantity, or with a size of its own for each
    tool, where that is clearly likelier."""
    best = [(law, s) for law, s in laws.items() if isinstance(law, Formula) and law.factors][:_EXTENDED]
    tools = tools_of(library.mismatch.states)
    pairs = [(law, s) for law, s in laws.items() if isinstance(law, Formula) and len(law.factors) > 1 and law.seen]
    found = dict(laws)
    for law, score in pairs[:_EXTENDED]:
        for more in ground.quick.of_one_more(residual, law):
            one = library.score(replace(score.term, mechanism=more), current)
            if one is not None and one.bic < score.bic - _CLEARLY:
                found[more] = one
    for law, score in best if tools else ():
        one = library.score(replace(score.term, mechanism=ByTool(tools, law)), current)
        if one is not None and one.bic < score.bic - _CLEARLY:
            found[one.term.mechanism] = one
    return dict(sorted(found.items(), key=lambda each: each[1].bic))


def of_fewer_quantities(library: Library, noise: Noise, current: Basis, score: Score) -> Score:
    """A product without the factors without which it is as likely: a sign that never turns where the rest acts; and a
    law of some tools without those of which it says nothing."""
    law = score.term.mechanism
    if (isinstance(law, Formula) and len(law.factors) > 1) or isinstance(law, ByTool):
        for fewer in law.of_fewer():
            found = library.score(replace(score.term, mechanism=fewer), current)
            if found is not None and found.bic < score.bic + _ALIKE and not is_known(library, noise, found):
                return of_fewer_quantities(library, noise, current, found)
    return score


def ground_of(library: Library, noise: Noise) -> Ground:
    """Of the last noise that was asked about."""
    if library.ground is None or library.ground.noise is not noise:
        library.ground, library.nameless = Ground(library.mismatch, noise), {}
    return library.ground


def _ranked_surfaces(every: Sequence[Surface], known: Known, few: Coarse) -> list[Surface]:
    """By the BIC of the coarse residual, least first: what two quantities do together may show in neither of them."""
    step = max(1, len(few.rows) // _ROWS)
    root = np.sqrt(few.weights[::step])
    values, thin = few.values[::step] * root, {n: (v[::step], unit) for n, (v, unit) in known.items()}

    def bic_of(surface: Surface) -> float:
        rows = surface.over(thin) * root[:, None]
        gram, inner = rows.T @ rows, rows.T @ values
        met = np.diag(gram) > 0
        beta = np.linalg.solve(gram[np.ix_(met, met)] + _RIDGE * np.diag(np.diag(gram)[met]), inner[met])
        return bic(float(values @ values - beta @ inner[met]), len(values), int(met.sum()))

    return sorted(every, key=bic_of)


def _by_gain(ground: Ground, few: Coarse) -> list[tuple[float, Term]]:
    """Formulas, peaks, bends, arms, what is eased, resounds or differs by tool, and waves, each with what it takes away
    from the coarse residual alone; waves also over what tells when something happens."""
    axis, known = ground.mismatch.axis, ground.thin
    gains = [(gain, Term(formula)) for formula, gain in gains_by_averages(ground.formulas, known, few)]
    gains += [(gain, Term(peak, tuple(shape.items()))) for peak, shape, gain in _gains_of_peaks(ground, few)]
    gains += [(gain, Term(law)) for gain, law in (*bends(axis, known, few), *arms(axis, known, few))]
    gains += eased(axis, known, few)
    gains += resonant(axis, known, few)
    gains += by_tool(axis, known, few, ground.mismatch.states)
    gains += waves(axis, ground.thin_seldom, few)
    return gains


def _gains_of_peaks(ground: Ground, few: Coarse) -> Iterator[tuple[Peak, dict[str, float], float]]:
    """Peaks, each with what it would take away by itself; rows are sorted into narrow classes of the quantity first."""
    for peak, group in itertools.groupby(ground.peaks, key=lambda each: each[0]):
        values, shapes = ground.thin[peak.signal][0], [shape for _, shape in group]
        side, u = peak.side(values), peak.place(values)
        at, middle = in_classes(u, _CLASSES)
        inner = np.bincount(at, few.weights * few.values * side, _CLASSES)
        size = np.bincount(at, few.weights * side**2, _CLASSES)
        c, w = (np.array([[shape[name]] for shape in shapes]) for name in ("c", "w"))
        rows = np.exp(-(((middle - c) / w) ** 2))
        towards, own = rows @ inner, rows**2 @ size
        gains = np.where(own > 0, towards**2 / np.where(own > 0, own, 1.0), 0.0)
        yield from ((peak, shape, gain) for shape, gain in zip(shapes, gains.tolist(), strict=True))


def tune(library: Library, current: Basis, score: Score) -> Score:
    """The shape of an unnamed term moved to its best, and the best of its variants; a simpler one where the term is not
    clearly better."""
    best, size, mechanism = score, dict(score.term.shape), score.term.mechanism
    if not isinstance(mechanism, Unnamed) or not size:
        return score

    def loss(by: Float1D) -> float:
        nonlocal best
        found = library.score(replace(score.term, shape=tuple(mechanism.moved(size, by).items())), current)
        if found is not None and found.bic < best.bic:
            best = found
        return current.rss if found is None else current.rss - found.gain

    steps = _FIRST_STEPS[: max(2, len(size))]
    options = {"maxfev": _TRIALS * len(steps), "initial_simplex": np.r_[[np.zeros(len(steps))], np.diag(steps)]}
    minimize(loss, np.zeros(len(steps)), method="Nelder-Mead", options=options)
    others = (library.score(replace(best.term, mechanism=other), current) for other in mechanism.variants())
    tuned = [tune(library, current, s) for s in others if s is not None]
    clearly = _CLEARLY + _CLEARLY_SHARE * max(current.bic - best.bic, 0.0)
    simpler = [s for s in tuned if len(s.amplitudes) < len(best.amplitudes) and s.bic < best.bic + clearly]
    return min(simpler or [best, *tuned], key=lambda s: s.bic)


def is_known(library: Library, noise: Noise, score: Score) -> bool:
    """Whether a model without a name is a mechanism of the catalogue in other words."""
    if _is_late_inertia(library.mismatch.axis, score.term):
        return True
    effect = score.amplitudes @ _at_once(score.term).columns(library.mismatch.states)
    row = noise.whiten(effect[None]).astype(np.float32)[0]
    length = float(np.sqrt(row @ row))
    if length == 0:
        return True
    singles = [i for i, j in library.spans if j - i == 1]
    size = np.sqrt(
        [max(float(g[0, 0]), 1e-30) for g, (i, j) in zip(library.grams, library.spans, strict=True) if j - i == 1]
    )
    return bool(np.max(np.abs((library.whitened @ row)[singles]) / size, initial=0.0) > _SAME * length)


def _is_late_inertia(axis: str, term: Term) -> bool:
    """Whether it is k * v * tau s / (1 + tau s) = k * tau * a behind a lag as short as that of a drive's loop."""
    law = term.mechanism
    own = isinstance(law, Fading) and (law.signal, law.form, law.only) == (f"v_{axis}", "u", "")
    return own and dict(term.shape)["tau"] < LONGEST_LAG_S


def _at_once(term: Term) -> Term:
    """The term; where it follows what a cause was within the lag of a drive's loop, as it would without that lag: heat
    takes longer, and a loop makes any law late."""
    if not isinstance(term.mechanism, Modulated) or dict(term.shape)["tau"] >= LONGEST_LAG_S:
        return term
    return term.with_shape(tau=SHORTEST_S)


def _at_an_edge(term: Term, beside: Sequence[Term]) -> bool:
    """Whether it is a peak where the box of another term ends: that edge is known to a row or two only."""
    peak = term.mechanism
    if not isinstance(peak, Peak):
        return False
    edges = [e for t in beside for g in t.gates if g.variable == peak.signal for e in (g.low, g.high)]
    places, shape = peak.place(np.array([e for e in edges if np.isfinite(e)])), dict(term.shape)
    return bool(np.any(np.abs(places - shape["c"]) < np.maximum(_EDGE * shape["w"], _EDGE_SHARE * np.abs(places))))


def _explained(mismatch: Mismatch, terms: Sequence[Term], amplitudes: Sequence[Float1D]) -> float:
    if not terms:
        return 0.0
    effect = np.sum([a @ t.columns(mismatch.states) for t, a in zip(terms, amplitudes, strict=True)], axis=0)
    return float(np.mean(effect[mismatch.usable] ** 2))
