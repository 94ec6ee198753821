"""Which physics is missing on one axis: from a laid-out mismatch to named terms that hold.

In:  one axis of all parts (`Mismatch`), the catalogue, what the simulation contains.
Out: `Answer`: terms, their noise, p values, what each could be mistaken for, what was tried and rejected.
Order of work: noise from a saturated fit; selection; noise again without what was found, and the search once more
(small effects show only once the large ones are out); only then the strict tests.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pido.core.arrays import Float1D, Float2D, Int1D
from pido.diagnosis.confirm import (
    SIGNIFICANT,
    cross_residual,
    even,
    fold_of,
    forces_among,
    p_value,
    paired_p,
    plain_error,
    q_values,
    rms_held_out,
    whitened,
)
from pido.diagnosis.estimate import settle_shapes
from pido.diagnosis.events import ExternalForce, Rhythm, charge, find_events, find_rhythms
from pido.diagnosis.finding import Rejected
from pido.diagnosis.flexible import flexible_rest
from pido.diagnosis.library import Basis, Library, Score, basis
from pido.diagnosis.mechanisms.base import Mechanism
from pido.diagnosis.misfit import WORTH, useless
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.regions import CLEARLY, best_region
from pido.diagnosis.select import MOST_TERMS, best_addition, drop_useless, grid_terms, suggested, swap
from pido.diagnosis.signals import CLOCKS
from pido.diagnosis.terms import Component, Term, fit, without
from pido.diagnosis.whiten import Noise, averaged, estimate_noise

SIGNIFICANT_NAME = 0.05  # q value of a likelier name for an effect whose existence is proved under another
LEAST_GAIN = 12.0  # BIC that a term must bring to be taken
CONFINED = 0.1  # of what the best mechanism gains that acts everywhere, by which one confined to a box must beat it
MORE_REMOVED = 0.1  # of what the terms remove on unseen folds, that others must remove beyond it to replace them
_IN_A_BOX = 4.0  # blocks: what is there in fewer of them may be one event, which a box was drawn around
_NEARLY_ALL = 0.8  # of what all terms take away together: what takes so much does not mend the form of the others
_OWN = 0.5  # of the level of an interval that the state does not predict: it is a force by itself


@dataclass(frozen=True)
class Rival:
    """Another mechanism in the place of a term: how much worse, and the share of the term's gain that it keeps."""

    name: str
    delta_bic: float
    share: float
    term: Term


@dataclass
class Answer:
    """What was decided about one axis; the lists run parallel to `terms`.

    simulated : by the name of a term that the simulation contains, that term as it is there
    unproved : where no term stands, those that were likely, and that too few blocks of rows speak for
    few_seconds : whether the terms are shown by pieces of a few blocks (`pido.diagnosis.seldom`)
    """

    axis: str
    terms: list[Term] = field(default_factory=list)
    p_values: list[float] = field(default_factory=list)
    q_values: list[float] = field(default_factory=list)
    delta_bic: list[float] = field(default_factory=list)
    rivals: list[list[Rival]] = field(default_factory=list)
    simulated: dict[str, Component] = field(default_factory=dict)
    rejected: list[Rejected] = field(default_factory=list)
    noise: Noise | None = None
    notes: list[str] = field(default_factory=list)
    unproved: list[Term] = field(default_factory=list)
    few_seconds: bool = False


def candidates(
    mechanisms: Sequence[Mechanism], mismatch: Mismatch, contained: Mapping[str, Term]
) -> tuple[list[Term], list[Rejected]]:
    """Every shape of every mechanism that these data can show; what the simulation contains is named as such."""
    terms, rejected = [], []
    for mechanism in mechanisms:
        if mismatch.axis not in mechanism.axes:
            continue
        reason = mechanism.applies(mismatch.states)
        if reason is not None:
            rejected.append(Rejected(mismatch.axis, mechanism.id, reason))
            continue
        name = f"miscalibrated:{mechanism.id}" if mechanism.id in contained else mechanism.id
        offered = grid_terms(mechanism, mismatch.states, name)
        if mismatch.base_names and not (mechanism.transient or mechanism.id == "standstill_friction"):
            # The equation fits sgn(v) itself: what a held friction adds to it is that of standstill, by its own name.
            offered = [t for t in offered if not dict(t.shape).get("rest")]
        terms += offered
        if mechanism.id in contained:
            terms.append(replace(contained[mechanism.id], name=name))
    return terms, rejected


def first_noise(mismatch: Mismatch, terms: Sequence[Term]) -> Noise:
    """Noise of what is left when every mechanism helps: too many terms to believe, few enough to leave noise."""
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
    strong, and whitening would then listen to fast transients only.
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
            price, trial = _with_time(library, noise, terms)
            if price > current.bic - LEAST_GAIN:
                return terms
            terms = trial
        else:
            terms = [*terms, best.term]
        terms = swap(library, noise, terms)
        terms = drop_useless(library, noise, terms)
        names = tuple(sorted(f"{t.name}{t.gates}" for t in terms))
        if names in seen:
            return terms
        seen.add(names)


def seen_slowly(library: Library, noise: Noise, terms: Sequence[Term], questions: int) -> tuple[list[Term], Noise]:
    """What a search by averages over the noise's memory finds, where that of it which stands up makes the plain error
    smaller with less, or clearly smaller.

    Where no textbook form is quite the machine's, its quick part (how a load rises as the tool enters) is wrong first,
    and weights that whiten listen to nothing else. What is confined to a box is there at few times, and all others say
    nothing about it: it is proved by the tests that every finding has to stand.
    """
    mismatch = library.mismatch
    residual = flexible_rest(mismatch, fit(mismatch, noise, terms).residual)
    slow = averaged(noise, residual, mismatch.part, mismatch.usable)
    if slow is None:
        return list(terms), noise
    found = select_terms(library, slow, in_time=False)
    # What was proposed beside a strong effect mends its form, and makes the error smaller: only what stands up counts.
    pairs = ((noise, list(terms)), (slow, found))
    former, kept = (confirm(library, n, t, Answer(mismatch.axis), questions) for n, t in pairs)
    plain, fold = even(mismatch), fold_of(mismatch, [*former, *kept])
    nothing, before, after = (cross_residual(mismatch, plain, t, fold) ** 2 for t in ((), former, kept))
    more = float(np.sum((before - after)[mismatch.usable]))
    clearly = more > MORE_REMOVED * float(np.sum((nothing - before)[mismatch.usable]))
    better = bool(kept) and more > 0 and numbers(kept) < numbers(former) + clearly
    if not better and clearly:
        better = paired_p(before - after, mismatch, mismatch.usable) < SIGNIFICANT
    if not better and clearly and any(t.gates for t in kept):
        better = kept == found
    library.whiten(noise)
    return (found, slow) if better else (list(terms), noise)


def _with_time(library: Library, noise: Noise, terms: Sequence[Term]) -> tuple[float, list[Term]]:
    """`terms`, as far as something supports them, with the best addition that is tied to no state; and their BIC with
    all that was tried for it, inf without one.

    Levels over a dozen intervals can stand for any law: they come when the laws have been asked. But laws that only a
    few blocks speak for may have been standing for them, or those that a few forces of some blocks each have made up.
    """
    kept = _supported(library, noise, terms)
    best: tuple[float, list[Term]] = (np.inf, kept)
    for beside in [kept, []] if kept and not forces_among(kept) else [kept]:
        for found in next_in_time(library, noise, beside):
            tried = found.bic - basis(library, noise, [*beside, found.term]).bic
            trial = drop_useless(library, noise, [*kept, found.term])
            best = min(best, (basis(library, noise, trial).bic + tried, trial), key=lambda b: b[0])
    return best


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
    fold = fold_of(mismatch, terms)
    terms, error = _harmless(mismatch, noise, terms, fold)
    while len(terms) < MOST_TERMS:
        best = best_addition(library, basis(library, noise, terms), {t.name for t in terms})
        if best is None:
            break
        trial = settle_shapes(mismatch, noise, [*terms, best.term])
        less = rms_held_out(mismatch, noise, trial, fold)
        if less > (1 - WORTH) * error:
            break
        p = p_value(whitened(mismatch, noise, trial), len(trial) - 1, mismatch.block)
        if p * np.exp(0.5 * library.charge(best.term)) * questions > SIGNIFICANT:
            break
        terms, error = trial, less
    return terms


def _harmless(mismatch: Mismatch, noise: Noise, terms: Sequence[Term], fold: Int1D) -> tuple[list[Term], float]:
    """`terms` without those that make the error on unseen folds clearly larger, and that error."""
    kept, error = list(terms), rms_held_out(mismatch, noise, terms, fold)
    while kept:
        errors = [rms_held_out(mismatch, noise, without(kept, i), fold) for i in range(len(kept))]
        i = int(np.argmin(errors))
        if errors[i] > (1 - WORTH) * error:
            break
        kept, error = without(kept, i), errors[i]
    return kept, error


def numbers(terms: Sequence[Term]) -> int:
    """Amplitudes and shapes."""
    return sum(len(t.mechanism.amplitudes) - t.idle + t.free for t in terms)


def next_named(library: Library, noise: Noise, terms: Sequence[Term]) -> Score | None:
    """The best single addition of the catalogue: a mechanism that acts anywhere, or one confined to a box."""
    current = basis(library, noise, terms)
    taken = {t.name for t in terms}
    residual = fit(library.mismatch, noise, terms).residual
    best = best_addition(library, current, taken, suggested(library, current, residual, taken))
    everywhere = 0.0 if best is None else max(0.0, current.bic - best.bic)
    asked = max(LEAST_GAIN, CLEARLY + (1 + CONFINED) * everywhere)
    # A law that acts in a box may act in a second one; in two of its own axis' speed it would be another law of that.
    count = Counter(t.name for t in terms if _is_elsewhere(t, library.mismatch.axis))
    confined = best_region(library, current, {t.name for t in terms if count[t.name] != 1}, asked, best)
    return confined if confined is not None and current.bic - confined.bic > asked else best


def _is_elsewhere(term: Term, axis: str) -> bool:
    """Whether a term is confined by more than the speed of its own axis."""
    return any(gate.variable.strip("|") != f"v_{axis}" for gate in term.gates)


def next_in_time(library: Library, noise: Noise, terms: Sequence[Term]) -> list[Score]:
    """The best single additions that are tied to no state: a wave in time, and forces over intervals."""
    current = basis(library, noise, terms)
    waves = [_tune(library, current, *found) for found in find_rhythms(library.mismatch, noise, current.residual)]
    out = sorted((w for w in waves if w is not None), key=lambda w: w.bic)[:1]
    events = None
    if not forces_among(terms):
        events = find_events(library.mismatch, noise, current.residual)
    if events is not None:
        events = _of_no_state(library.mismatch, noise, fit(library.mismatch, noise, terms).residual, events)
    score = None if events is None else library.score(Term(events), current)
    if events is not None and score is not None:
        # Each interval's ends were searched for.
        ends = max(0.0, charge(library.mismatch) - np.log(current.n))
        out.append(replace(score, bic=score.bic + len(events.intervals) * ends))
    return out


def _of_no_state(mismatch: Mismatch, noise: Noise, left: Float1D, events: ExternalForce) -> ExternalForce | None:
    """The intervals whose level in what is `left`, (n,) in A, is not what the state predicts from other parts; None
    where these leave no events: levels over intervals describe any law."""
    rest = flexible_rest(mismatch, left, without=frozenset(CLOCKS), by_part=True)
    if find_events(mismatch, noise, noise.whiten(rest[None])[0]) is None:
        return None
    inside = Term(events).columns(mismatch.states) * mismatch.usable
    own = np.abs(inside @ rest) > _OWN * np.abs(inside @ left)
    kept = tuple(i for i, is_own in zip(events.intervals, own, strict=True) if is_own)
    return ExternalForce(kept) if kept else None


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
        # Blocks that differ tell what only mends the form of others, or was made up from what they leave.
        most = _most_of_all(library, noise, terms)
        p = [
            2 * min(p_value(m, i, mismatch.block, i == most, _IN_A_BOX if t.gates else 0.0) for m in both)
            for i, t in enumerate(terms)
        ]
        tried = [min(1.0, v * _claims(library, t)) for v, t in zip(p, terms, strict=True)]
        q = q_values(tried, questions)
        worst = int(np.argmax(q))
        reason = f"q = {q[worst]:.2g}, not significant over {questions} questions" if q[worst] > level else None
        if reason is None:
            worst, reason = useless(library, noise, terms)
        if reason is None:
            answer.p_values, answer.q_values = tried, q
            break
        answer.rejected.append(Rejected(mismatch.axis, terms[worst].name, reason))
        terms = without(terms, worst)
    return terms


def _most_of_all(library: Library, noise: Noise, terms: Sequence[Term]) -> int | None:
    """Which term takes away nearly all that the terms do together, if that is a law of the catalogue or in a box; None
    where two of them do, which then take each other back."""
    nothing, whole = basis(library, noise, []).rss, basis(library, noise, terms).rss
    rest = [basis(library, noise, without(terms, i)).rss for i in range(len(terms))]
    most = [i for i, left in enumerate(rest) if left - whole >= _NEARLY_ALL * (nothing - whole)]
    named = len(most) == 1 and (bool(terms[most[0]].gates) or terms[most[0]].name != "unknown")
    return most[0] if named else None


def _claims(library: Library, term: Term) -> float:
    """How many shapes, limits of a region and, where data alone decide the form, formulas or intervals were looked at
    before this term was chosen."""
    free = term.mechanism.looked_at if term.name in ("unknown", "external_force") else 1
    return float(np.exp(0.5 * library.charge(term))) * free


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
