"""Which physics is missing on one axis: from a laid-out mismatch to named terms that hold.

In:  one axis of all parts (`Mismatch`), the catalogue, what the simulation contains.
Out: `Answer`: terms, their noise, p values, what each could be mistaken for, what was tried and rejected.
Order of work: noise from a saturated fit; selection; noise again without what was found, and the search once more
(small
effects show only once the large ones are out); only then the strict tests.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pido.core.arrays import Bool1D, Float1D, Float2D
from pido.diagnosis.confirm import cross_residual, p_value, paired_p, q_values, whitened
from pido.diagnosis.estimate import settle_shapes
from pido.diagnosis.events import Rhythm, charge, find_events, find_rhythms
from pido.diagnosis.finding import Rejected
from pido.diagnosis.mechanisms.base import Mechanism
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.regions import CLEARLY, best_region
from pido.diagnosis.select import (
    MOST_TERMS,
    Basis,
    Library,
    Score,
    basis,
    best_addition,
    drop_useless,
    grid_terms,
    shortlist_of,
    suggested,
    swap,
)
from pido.diagnosis.terms import Term, fit
from pido.diagnosis.unknown import LEVEL, flexible_rest
from pido.diagnosis.whiten import Noise, averaged, estimate_noise

SIGNIFICANT = 0.01  # q value, over every axis, mechanism and shape that was tried
SIGNIFICANT_NAME = 0.05  # q value of a likelier name for an effect whose existence is proved under another
LEAST_EFFECT = 0.1  # of the noise level, rms where active: a smaller effect is of no use to anybody
# The same for what no law stands behind: noise itself wanders as much, over seconds and around single frequencies.
LEAST_NAMELESS = 0.4
TIED_TO_TIME = frozenset({"unknown", "external_force", "thermal_drift"})
LEAST_GAIN = 12.0  # BIC that a term must bring to be taken
# Share of what findings remove where a further one acts, below which it only mends the form of the others: of a term
# whose shape is free, and of one that can take a single form only.
MISFIT, MISFIT_PLAIN = 0.04, 0.01
# The same around stops and reversals. What acts there is quick beside the control loop and the filters that it goes
# through, and turns within micrometres that no record shows: a textbook form is right to a good part of it only. One
# that takes WORTH of the error on unseen folds away stays nevertheless: a correction is better with it.
MISFIT_AT_STOPS = 0.08
AT_STOPS = frozenset({"stribeck_friction", "standstill_friction", "presliding_hysteresis", "backlash"})
CANCELLED = 0.1  # of the power of the smaller of two effects: what is left where they are two halves of another one
SMALL = 0.12  # the same share for a finding that is small in its own right
_FEW_LASTING = 20  # rows
_NEARLY_ALL = 0.7
LASTING = 0.4  # correlation with itself one row later of what acts around stops and reversals
WORTH = 0.05  # share of the error on unseen folds that a term takes away by itself: it is no misfit of the others
CONFINED = 0.1  # of what the best mechanism gains that acts everywhere, by which one confined to a box must beat it
MORE_REMOVED = 0.1  # of what the terms remove on unseen folds, that others must remove beyond it to replace them
_CLOCK = frozenset({"uptime"})  # a signal that tells when, not what
SMALL_EFFECT = 0.5  # noise levels: what such a small finding removes, rms where it acts


@dataclass(frozen=True)
class Rival:
    """Another mechanism in the place of a term: how much worse, and the share of the term's gain that it keeps."""

    name: str
    delta_bic: float
    share: float
    term: Term


@dataclass
class Answer:
    """What was decided about one axis; the lists run parallel to `terms`."""

    axis: str
    terms: list[Term] = field(default_factory=list)
    p_values: list[float] = field(default_factory=list)
    q_values: list[float] = field(default_factory=list)
    delta_bic: list[float] = field(default_factory=list)
    rivals: list[list[Rival]] = field(default_factory=list)
    rejected: list[Rejected] = field(default_factory=list)
    noise: Noise | None = None
    notes: list[str] = field(default_factory=list)


def candidates(
    mechanisms: Sequence[Mechanism], mismatch: Mismatch, contained: Mapping[str, Term]
) -> tuple[list[Term], list[Rejected]]:
    """Every shape of every mechanism that these data can show; what the simulation contains is named as such."""
    terms, rejected = [], []
    for mechanism in mechanisms:
        reason = mechanism.applies(mismatch.states)
        if reason is not None:
            rejected.append(Rejected(mismatch.axis, mechanism.id, reason))
            continue
        name = f"miscalibrated:{mechanism.id}" if mechanism.id in contained else mechanism.id
        terms += grid_terms(mechanism, mismatch.states, name)
        if mechanism.id in contained:
            terms.append(replace(contained[mechanism.id], name=name))
    return terms, rejected


def first_noise(mismatch: Mismatch, terms: Sequence[Term]) -> Noise:
    """Noise of what is left when every mechanism helps at once: too many terms to believe, few enough to
    leave noise.
    """
    columns = coarse_columns(mismatch, terms)
    noise = None
    for last in (False, True):
        residual = left_over(mismatch, columns, noise)
        residual = flexible_rest(mismatch, residual) if last else residual
        noise = estimate_noise(residual, mismatch.starts, mismatch.noise_class, mismatch.usable, smooth_spectrum=True)
    assert noise is not None
    return noise


def noise_of(mismatch: Mismatch, noise: Noise, terms: Sequence[Term]) -> Noise:
    """Noise of what the joint fit of `terms` leaves, and a flexible model of the state cannot predict.

    A real machine always does a little more than the terms say. Taken for noise, that rest would be slow and
    strong, and
    whitening would then listen to fast transients only.
    """
    # What weights that listen to what is quick leave of a slow effect would make noise slower still.
    if plain_error(mismatch, terms) < rms_held_out(mismatch, noise, terms):
        noise = even(mismatch)
    residual = flexible_rest(mismatch, fit(mismatch, noise, terms).residual)
    return estimate_noise(residual, mismatch.starts, mismatch.noise_class, mismatch.usable)


def select_terms(library: Library, noise: Noise, start: Sequence[Term] = (), in_time: bool = True) -> list[Term]:
    """Forward steps with swaps and backward steps, confined versions included.

    in_time : with waves and forces over intervals, which are tied to no state
    """
    library.whiten(noise)
    terms = list(start)
    seen: set[tuple[str, ...]] = set()
    while True:
        if len(terms) >= MOST_TERMS:
            return terms
        current = basis(library, noise, terms)
        best = next_named(library, noise, terms)
        if best is None or best.bic > current.bic - LEAST_GAIN:
            if not in_time:
                return terms
            # Levels over a dozen intervals can stand for any law: they come when the laws have been asked. But laws
            # that only a few blocks speak for may have been standing for them.
            kept = _supported(library, noise, terms)
            best = next_in_time(library, noise, kept)
            if best is None or best.bic > current.bic - LEAST_GAIN:
                return terms
            terms = kept
        terms = swap(library, noise, [*terms, best.term])
        terms = drop_useless(library, noise, terms)
        names = tuple(sorted(f"{t.name}{t.gates}" for t in terms))
        if names in seen:
            return terms
        seen.add(names)


def seen_slowly(library: Library, noise: Noise, terms: Sequence[Term]) -> tuple[list[Term], Noise]:
    """What a search by averages over the noise's memory finds, where it makes the plain error smaller with less, or
    clearly smaller.

    Where no textbook form is quite the machine's, its quick part (how a load rises as the tool enters) is wrong first,
    and weights that whiten listen to nothing else.
    """
    mismatch = library.mismatch
    residual = flexible_rest(mismatch, fit(mismatch, noise, terms).residual)
    slow = averaged(noise, residual, mismatch.part, mismatch.usable)
    if slow is None:
        return list(terms), noise
    found = select_terms(library, slow, in_time=False)
    library.whiten(noise)
    plain = even(mismatch)
    nothing, former, trial = (cross_residual(mismatch, plain, t) ** 2 for t in ((), terms, found))
    more = float(np.sum((former - trial)[mismatch.usable]))
    clearly = more > MORE_REMOVED * float(np.sum((nothing - former)[mismatch.usable]))
    simpler = bool(found) and more > 0 and numbers(found) < numbers(terms) + clearly
    if simpler or (clearly and paired_p(former - trial, mismatch, mismatch.usable) < SIGNIFICANT):
        return found, slow
    return list(terms), noise


def _supported(library: Library, noise: Noise, terms: Sequence[Term]) -> list[Term]:
    """The terms that blocks of rows speak for, each beside all others."""
    model = whitened(library.mismatch, noise, terms)
    return [t for i, t in enumerate(terms) if p_value(model, i, library.mismatch.block) < SIGNIFICANT]


def by_error(library: Library, terms: Sequence[Term], questions: int) -> list[Term]:
    """`terms`, and what makes the plain error on unseen folds clearly smaller beside them, step by step.

    Weights that whiten listen to what is quick. On a real machine, whose terms are never complete, an effect that is
    slow beside them is seen by ordinary least squares only; blocks of rows say whether it is there.
    """
    mismatch = library.mismatch
    noise = even(mismatch)
    library.whiten(noise)
    terms, error = _harmless(mismatch, noise, terms)
    while len(terms) < MOST_TERMS:
        best = best_addition(library, basis(library, noise, terms), {t.name for t in terms})
        if best is None:
            break
        trial = settle_shapes(mismatch, noise, [*terms, best.term])
        less = rms_held_out(mismatch, noise, trial)
        if less > (1 - WORTH) * error:
            break
        p = p_value(whitened(mismatch, noise, trial), len(trial) - 1, mismatch.block)
        if p * np.exp(0.5 * library.charge(best.term)) * questions > SIGNIFICANT:
            break
        terms, error = trial, less
    return terms


def _harmless(mismatch: Mismatch, noise: Noise, terms: Sequence[Term]) -> tuple[list[Term], float]:
    """`terms` without those that make the error on unseen folds clearly larger, and that error."""
    kept, error = list(terms), rms_held_out(mismatch, noise, terms)
    while kept:
        without = [rms_held_out(mismatch, noise, kept[:i] + kept[i + 1 :]) for i in range(len(kept))]
        i = int(np.argmin(without))
        if without[i] > (1 - WORTH) * error:
            break
        kept, error = kept[:i] + kept[i + 1 :], without[i]
    return kept, error


def even(mismatch: Mismatch) -> Noise:
    """Noise that is the same everywhere and forgets at once."""
    return Noise(np.zeros(0), np.ones(mismatch.n), 1.0, mismatch.usable)


def rms_held_out(mismatch: Mismatch, noise: Noise, terms: Sequence[Term]) -> float:
    """A, on folds that were not fitted."""
    left = cross_residual(mismatch, noise, terms)[mismatch.usable]
    return float(np.sqrt(np.mean(left**2)))


def plain_error(mismatch: Mismatch, terms: Sequence[Term]) -> float:
    """A, on folds that were not fitted, under ordinary least squares."""
    return rms_held_out(mismatch, even(mismatch), terms)


def numbers(terms: Sequence[Term]) -> int:
    """Amplitudes and shapes."""
    return sum(len(t.mechanism.amplitudes) + t.free for t in terms)


def less_error(mismatch: Mismatch, terms: Sequence[Term], others: Sequence[Term], share: float) -> bool:
    """Whether `terms` make the plain error on unseen folds smaller than `others` do, by more than `share` of it."""
    return plain_error(mismatch, terms) < (1 - share) * plain_error(mismatch, others)


def next_named(library: Library, noise: Noise, terms: Sequence[Term]) -> Score | None:
    """The best single addition of the catalogue: a mechanism that acts anywhere, or one confined to a box."""
    current = basis(library, noise, terms)
    taken = {t.name for t in terms}
    residual = fit(library.mismatch, noise, terms).residual
    best = best_addition(library, current, taken, suggested(library, current, residual, taken))
    # A sensor knows nothing of speeds and cuts: what is wrong with the data is wrong everywhere.
    shortlist = [s for s in shortlist_of(library.screen(current), taken)[:8] if s.term.mechanism.kind != "data_fault"]
    if "unknown" not in taken:
        # Within a box even a constant is something that no mechanism of the catalogue says.
        shortlist.append(Score(Term(LEVEL), 0.0, current.bic, np.zeros(1)))
    confined = best_region(library, current, shortlist)
    everywhere = 0.0 if best is None else max(0.0, current.bic - best.bic)
    if confined is not None and (best is None or confined.bic < best.bic - CLEARLY - CONFINED * everywhere):
        best = confined
    return best


def next_in_time(library: Library, noise: Noise, terms: Sequence[Term]) -> Score | None:
    """The best single addition that is tied to no state: a wave in time, or forces over intervals."""
    current = basis(library, noise, terms)
    best: Score | None = None
    for rhythm, period in find_rhythms(library.mismatch, noise, current.residual):
        score = _tune(library, current, rhythm, period)
        if score is not None and (best is None or score.bic < best.bic):
            best = score
    if "external_force" not in {t.name for t in terms}:
        events = find_events(library.mismatch, noise, current.residual)
        if events is not None:
            # What the state predicts is no force by itself, however well levels over intervals describe it.
            rest = flexible_rest(library.mismatch, fit(library.mismatch, noise, terms).residual, without=_CLOCK)
            events = find_events(library.mismatch, noise, noise.whiten(rest[None])[0])
        if events is not None:
            score = library.score(Term(events), current)
            # Each interval's ends were searched for.
            if score is not None:
                ends = max(0.0, charge(library.mismatch) - np.log(current.n))
                score = replace(score, bic=score.bic + len(events.intervals) * ends)
                if best is None or score.bic < best.bic - CLEARLY:
                    best = score
    return best


def _tune(library: Library, current: Basis, rhythm: Rhythm, period: float) -> Score | None:
    """The wave with its period moved to where all parts agree; charged for every frequency that was looked at."""
    longest = max(float(s.time[-1] - s.time[0]) for s in library.mismatch.states)
    first, last = library.mismatch.states[0].clock, library.mismatch.states[-1].clock
    span = last[-1] - first[0] if rhythm.clock and first is not None and last is not None else longest
    best: Score | None = None
    # Steps of a quarter wave over the whole span, as far as the resolution of one part leaves open.
    steps = int(np.clip(2 * span / longest, 4, 60))
    for k in range(-steps, steps + 1):
        frequency = 1 / period + k * 0.5 / longest / steps
        if frequency <= 0:
            continue
        found = library.score(Term(rhythm, (("T", 1 / frequency),)), current)
        if found is not None and (best is None or found.bic < best.bic):
            best = found
    return None if best is None else replace(best, bic=best.bic + 2 * np.log(library.mismatch.n))


def confirm(
    library: Library, noise: Noise, terms: list[Term], answer: Answer, questions: int, level: float = SIGNIFICANT
) -> list[Term]:
    """Terms that stand up to blocks, to parts that were not fitted, and to the number of questions."""
    mismatch = library.mismatch
    while terms:
        # Whitened rows tell quick effects best, plain ones slow effects; both are judged by blocks, and two looks cost
        # twice. Each shape that was tried is a question of its own.
        both = [whitened(mismatch, n, terms) for n in (noise, even(mismatch))]
        p = [2 * min(p_value(model, i, mismatch.block) for model in both) for i in range(len(terms))]
        tried = [min(1.0, v * _claims(library, t)) for v, t in zip(p, terms, strict=True)]
        q = q_values(tried, questions)
        worst = int(np.argmax(q))
        reason = f"q = {q[worst]:.2g}, not significant over {questions} questions" if q[worst] > level else None
        if reason is None:
            worst, reason = _useless(mismatch, noise, terms)
        if reason is None:
            answer.p_values, answer.q_values = tried, q
            break
        answer.rejected.append(Rejected(mismatch.axis, terms[worst].name, reason))
        terms = terms[:worst] + terms[worst + 1 :]
    return terms


def _claims(library: Library, term: Term) -> float:
    """How many shapes, limits of a region and, without a name, formulas were looked at before this term was chosen."""
    unnamed = term.mechanism.looked_at if term.name == "unknown" else 1
    return float(np.exp(0.5 * library.charge(term))) * unnamed


def _useless(mismatch: Mismatch, noise: Noise, terms: Sequence[Term]) -> tuple[int, str | None]:
    """The first term that is too small, brings nothing on unseen folds, or only mends the misfit of the others."""
    joint = fit(mismatch, noise, terms)
    effects = [a @ t.columns(mismatch.states) for t, a in zip(terms, joint.amplitudes, strict=True)]
    every = cross_residual(mismatch, noise, terms)
    level = float(np.median(noise.level))
    i = _cancelled(effects, mismatch.usable)
    if i is not None:
        return i, "another finding takes nearly all of it back: together they stand for something else"
    for i, term in enumerate(terms):
        acts = acting(mismatch, effects[i])
        rms = float(np.sqrt(np.mean(effects[i][acts] ** 2))) if acts.any() else 0.0
        least = LEAST_NAMELESS if term.name in TIED_TO_TIME else LEAST_EFFECT
        if rms < least * level:
            return i, f"{rms:.2g} A where it acts, under {least:.0%} of the noise"
        others = [t for k, t in enumerate(terms) if k != i]
        single = term.mechanism.transient and lasting(mismatch, term) < LASTING
        if single and not _goes_on(mismatch, acts, others, terms):
            return i, "it lasts for single rows only, which a rounded sign or a late sample also leaves"
        if less_error(mismatch, terms, others, WORTH):
            continue
        if term.mechanism.id == "external_force":
            # A force over intervals of one part can be proved on other seconds of the same part only.
            fold = mismatch.block % 5
            before, after = (cross_residual(mismatch, noise, t, fold) for t in (others, terms))
        else:
            before, after = cross_residual(mismatch, noise, others), every
        gain = noise.whiten(before[None])[0] ** 2 - noise.whiten(after[None])[0] ** 2
        if gain.sum() <= 0 or paired_p(gain, mismatch, mismatch.usable) > 0.05:
            return i, "no gain on parts that were not fitted"
    i = _mends_at_stops(mismatch, noise, terms)
    if i is not None:
        return i, "it hardly adds to what the others around stops and reversals remove: it mends their form"
    return _misfit(mismatch, noise, terms, effects)


def _mends_at_stops(mismatch: Mismatch, noise: Noise, terms: Sequence[Term]) -> int | None:
    """Of several terms around stops and reversals the one that is missed least, where that is little of what they
    remove together; None where each is needed.
    """
    family = [i for i, t in enumerate(terms) if t.mechanism.id in AT_STOPS]
    if len(family) < 2:
        return None

    def error(without: Sequence[int]) -> float:
        left = cross_residual(mismatch, noise, [t for i, t in enumerate(terms) if i not in without])
        return float(np.sum(left[mismatch.usable] ** 2))

    whole = error([])
    missed = {i: error([i]) - whole for i in family}
    least = min(family, key=missed.__getitem__)
    little = missed[least] < MISFIT_AT_STOPS * (error(family) - whole)
    worth = less_error(mismatch, terms, [t for k, t in enumerate(terms) if k != least], WORTH)
    return least if little and not worth else None


def _cancelled(effects: Sequence[Float1D], rows: Bool1D) -> int | None:
    """An effect that the others, alone or together, take back nearly everywhere; None where there is none.

    Of two that take each other back, the smaller.
    """
    if len(effects) < 2:
        return None
    every = np.array([e[rows] for e in effects])
    power = np.sum(every**2, axis=1)
    whole = np.sum(every, axis=0)
    for i in np.argsort(power):
        beside = [every[j] for j in range(len(every)) if j != i] + [whole - every[i]]
        if any(np.sum((every[i] + o) ** 2) < CANCELLED * min(power[i], float(o @ o)) for o in beside):
            return int(i)
    return None


def _misfit(
    mismatch: Mismatch, noise: Noise, terms: Sequence[Term], effects: Sequence[Float1D]
) -> tuple[int, str | None]:
    """The term that adds the least to those stronger than it where it acts, if that is only what their forms lack.

    In the order in which each adds most: beside all others, a true effect may look small because they share it out.
    Where the simulation was moved in time, that is the first model: what the samples do not say between them, and what
    a filter or a clock that is not quite even adds, is left of every change of the current.
    """
    before = cross_residual(mismatch, noise, [])
    moved = mismatch.before_moving
    none = before if moved is None else moved
    level = float(np.median(noise.level))
    kept: list[int] = []
    at_stops = 0.0
    least, which = np.inf, 0
    while len(kept) < len(terms):
        left = [i for i in range(len(terms)) if i not in kept]
        trials = {i: cross_residual(mismatch, noise, [terms[k] for k in [*kept, i]]) for i in left}
        i = min(left, key=lambda k: float(np.sum(noise.whiten(trials[k][None])[0] ** 2)))
        acts = acting(mismatch, effects[i])
        added = float(np.mean((before**2 - trials[i] ** 2)[acts])) if acts.any() else 0.0
        share = added / max(float(np.mean((none**2 - trials[i] ** 2)[acts])), 1e-30) if acts.any() else 0.0
        whole = float(np.sum((before**2 - trials[i] ** 2)[mismatch.usable]))
        of_stops = _of_stops(terms[i], [terms[k] for k in kept])
        if of_stops and at_stops > 0:
            # A form that acts in few rows mends them well: it is asked for its share of all that the others remove.
            share = min(share, whole / at_stops)
        at_stops += max(whole, 0.0) if terms[i].mechanism.id in AT_STOPS else 0.0
        free = terms[i].free > 0 or len(terms[i].mechanism.amplitudes) > 1
        small = share < (MISFIT_AT_STOPS if of_stops else MISFIT if free else MISFIT_PLAIN)
        small = small or (share < SMALL and added < (SMALL_EFFECT * level) ** 2)
        if moved is None:
            small = small and not less_error(mismatch, terms, [t for k, t in enumerate(terms) if k != i], WORTH)
        small = small or (moved is not None and share < SMALL)
        if (kept or moved is not None) and small and share < least and terms[i].mechanism.id != "external_force":
            least, which = share, i
        kept.append(i)
        before = trials[i]
    if np.isinf(least):
        return 0, None
    return which, f"{max(least, 0.0):.1%} of what is removed where it acts: a misfit of stronger findings"


def _of_stops(term: Term, stronger: Sequence[Term]) -> bool:
    """Whether a term acts around stops and reversals, or is what no name says beside one that does."""
    beside = term.name == "unknown" and any(t.mechanism.id in AT_STOPS for t in stronger)
    return beside or term.mechanism.id in AT_STOPS


def lasting(mismatch: Mismatch, term: Term) -> float:
    """Correlation of a term with itself one row later: near zero where it is there for single rows only."""
    rows = term.columns(mismatch.states) * mismatch.usable
    return float(np.sum(rows[:, 1:] * rows[:, :-1]) / max(np.sum(rows**2), 1e-300))


def _goes_on(mismatch: Mismatch, acts: Bool1D, others: Sequence[Term], terms: Sequence[Term]) -> bool:
    """Whether a term explains nearly all of what is there where it goes on acting for more than one row.

    At a slow reversal lost motion takes several rows, a late sample does not.
    """
    on = acts & np.r_[False, acts[:-1]]
    if np.sum(on) < _FEW_LASTING:
        return False
    plain = even(mismatch)
    before, after = (cross_residual(mismatch, plain, t) ** 2 for t in (others, terms))
    gain = (before - after) * on
    return bool(np.sum(gain) > _NEARLY_ALL * np.sum(before[on])) and paired_p(gain, mismatch, on) < SIGNIFICANT


def acting(mismatch: Mismatch, effect: Float1D) -> Bool1D:
    """(n,) – usable rows in which an effect is more than a tenth of its largest."""
    size = np.abs(effect)
    return mismatch.usable & (size > 0.1 * float(np.max(size[mismatch.usable], initial=0.0)))


def coarse_columns(mismatch: Mismatch, terms: Sequence[Term]) -> Float2D:
    """(k, n) – base, and three shapes of every mechanism: about all that the catalogue can express."""
    by_name: dict[str, list[Term]] = {}
    for t in terms:
        by_name.setdefault(t.name, []).append(t)
    rows = []
    for group in by_name.values():
        at = sorted({0, len(group) // 2, len(group) - 1})
        rows += [group[i].columns(mismatch.states) for i in at]
    return np.concatenate([mismatch.base, *rows])


def left_over(mismatch: Mismatch, columns: Float2D, noise: Noise | None) -> Float1D:
    """Residual of a ridge fit; rows beyond eight robust deviations are let go in a second pass."""
    rows = columns if noise is None else noise.whiten(columns)
    y = mismatch.target if noise is None else noise.whiten(mismatch.target[None])[0]
    size = np.sqrt(np.einsum("ij,ij->i", rows, rows))
    rows, columns = rows[size > 0] / size[size > 0, None], columns[size > 0] / size[size > 0, None]
    gram = rows @ rows.T + 1e-5 * np.eye(len(rows))
    return mismatch.target - np.linalg.solve(gram, rows @ y) @ columns
