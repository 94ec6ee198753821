"""Names for what one axis lacks: the whole search, from a first look at the mismatch to terms that stand up.

In:  one axis of all parts, laid out.
Out: a `Look` (noise, what the simulation contains, what is offered), and from it an `Answer`: the terms, their proofs,
     their rivals. Nothing is estimated for keeps yet.
Order: by quick rows, by error, by averages; what no name says; then forms, proofs, and the names once more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pido.core.arrays import Float1D
from pido.diagnosis.confirm import SIGNIFICANT, forces_among, less_error, no_more_error
from pido.diagnosis.contained import contained
from pido.diagnosis.events import Rhythm
from pido.diagnosis.finding import Rejected
from pido.diagnosis.forms import (
    AS_GOOD,
    CONSTANT,
    LIKELIER,
    fewest,
    is_whole_presliding,
    is_without_mean,
    likelier,
    plainest,
    rivals_of,
)
from pido.diagnosis.formulas import Formula, factor_on_current
from pido.diagnosis.identify import (
    LEAST_GAIN,
    SIGNIFICANT_NAME,
    Answer,
    by_error,
    candidates,
    confirm,
    first_noise,
    next_in_time,
    noise_of,
    seen_slowly,
    select_terms,
)
from pido.diagnosis.library import Library, basis, plausible
from pido.diagnosis.loop import longest, loop_of
from pido.diagnosis.mechanisms import CATALOGUE
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.one_law import one_law
from pido.diagnosis.pulses import repeating
from pido.diagnosis.quantities import QUANTITIES
from pido.diagnosis.seldom import of_few_seconds
from pido.diagnosis.select import shortlist_of
from pido.diagnosis.terms import Component, Term, fit, solve, without
from pido.diagnosis.unnamed import best_nameless, with_unknown
from pido.diagnosis.whiten import Averaged, Noise
from pido.diagnosis.within import nameless_within
from pido.physics.drive import AT_ONCE, Loop

_BEYOND_WRONG = 1.5  # times its share of the simulated current, above which a mechanism was not in it for what it is
_ANOTHER = 1.5  # times a length, speed or time constant of the simulation's: not the same
_CLEARLY_OTHER = 0.2  # of the power of an effect that the simulation's own term does not have
# Of a simulated weight: a constant that is less of it is the sensor's. Zeros of current sensors are good to a percent
# of their range, which is some times what the weight takes; what an axis weighs is hardly known better than that.
_ZERO = 0.02
_BENDS = 12.0  # BIC by which a saturation in a box must beat a factor on the current: it has a knee there
_QUANTITY = {  # that laws with one sign only are in proportion to, and how
    "inertia": ("a_{}", "u"),
    "viscous_friction": ("v_{}", "u"),
    "coulomb_friction": ("v_{}", "sgn u"),
    "spindle_inertia": ("a_{}", "u"),
    "spindle_viscous_drag": ("v_{}", "u"),
}
_STRAIGHT = 0.01  # of its power, that a factor leaves of it: its knee is far below nearly all of the current


@dataclass(frozen=True)
class Look:
    """What is known of an axis before its search: noise, what the simulation contains, what is offered."""

    mismatch: Mismatch
    noise: Noise
    inside: dict[str, Component]
    offered: list[Term]
    rejected: list[Rejected]


def first_look(mismatch: Mismatch, rng: np.random.Generator, clipped: bool = False) -> Look:
    """What can be said of an axis before its search. clipped : its recorded current ends at a limit."""
    plain, rejected = candidates(CATALOGUE, mismatch, {})
    noise = first_noise(mismatch, plain)
    inside = contained(mismatch, CATALOGUE, noise, rng)
    offered, _ = candidates(CATALOGUE, mismatch, {i: c.term for i, c in inside.items()})
    if clipped:
        # Below a limit only rows are left whose noise points away from it: they bend as a drive near its own does.
        offered = [t for t in offered if t.mechanism.id != "current_saturation"]
        rejected.append(Rejected(mismatch.axis, "current_saturation", "the recorded current ends at a limit before"))
    return Look(mismatch, noise, inside, offered, rejected)


def best_gain(mismatch: Mismatch, noise: Noise, look: Look) -> float:
    """2 log likelihood that the best single mechanism of those offered gains; a shift in time is none of one axis."""
    library = Library(mismatch, _not_timing(look.offered), _any_sign(look.inside))
    library.whiten(noise)
    nothing = basis(library, noise, [])
    most = max((s.gain for s in library.screen(nothing)), default=0.0)
    # Of unknown variance, as a delay is judged: what is left of a strong effect is no noise of the given level.
    return float(-nothing.n * np.log1p(-most / nothing.rss)) if most > 0 else 0.0


def search(look: Look, axes: int, timed: bool, rng: np.random.Generator) -> Answer:
    """Names for one axis; nothing is estimated for keeps yet. timed : a common delay is already out.

    What the loop of a drive makes of a law, several that answer at once can imitate: where some of those found do
    the same behind a lag, all is asked again behind it. Where the simulation has a loop, what it lacks passes the same.
    """
    answer = _search(look, axes, timed, rng)
    loop = loop_of(look.mismatch, answer.terms) or longest(part.term.loop for part in look.inside.values())
    if loop and (answer.terms or _anything(look, loop)):
        late = _search(look, axes, timed, rng, loop)
        if not answer.terms or _as_good(look.mismatch, late.terms, answer.terms):
            return late
    return answer


def _anything(look: Look, loop: Loop) -> bool:
    """Whether any law, named or not, says more behind a loop than chance does."""
    library = Library(look.mismatch, _not_timing(look.offered), _any_sign(look.inside), loop=loop)
    noise = noise_of(look.mismatch, look.noise, [])
    library.whiten(noise)
    least = min((s.bic for s in best_nameless(library, noise, [])), default=np.inf)
    return bool(least < basis(library, noise, []).bic - LEAST_GAIN)


def _search(look: Look, axes: int, timed: bool, rng: np.random.Generator, loop: Loop = AT_ONCE) -> Answer:
    """Names for one axis, behind a loop."""
    mismatch, noise = look.mismatch, look.noise
    answer = Answer(mismatch.axis, rejected=list(look.rejected))
    # A shift in time is common to all axes, and a limit is flat: both were decided before, and can only be rivals.
    names = [t for t in _not_timing(look.offered) if t.mechanism.id != "sensor_clipping"]
    library = Library(mismatch, names, _any_sign(look.inside), loop=loop)
    terms = select_terms(library, noise)
    # Again with the noise of what was found: it is never too small, as that of the saturated fit may be.
    noise = noise_of(mismatch, noise, terms)
    former = terms
    terms = select_terms(library, noise, terms)
    questions = axes * len({t.name for t in library.terms})
    terms = by_error(library, terms, questions)
    if terms != former:
        noise = noise_of(mismatch, noise, terms)
    terms, noise = seen_slowly(library, noise, terms, questions)
    library.whiten(noise)
    former = terms
    terms, note = with_unknown(library, noise, terms, int(rng.integers(2**31)))
    if note is not None:
        answer.notes.append(note)
    if terms != former and not isinstance(noise, Averaged):
        noise = noise_of(mismatch, noise, terms)
    wordy = _forces_alone(library, noise, terms)
    terms = plainest(library, noise, wordy)
    offered, terms = terms, confirm(library, noise, terms, answer, questions)
    if len(terms) < len(offered):
        # In plain words they may not stand up beside one another where in their own they did.
        terms = terms if wordy == offered else _retried(library, noise, wordy, terms, answer, questions)
        # What fell may have hidden what is simple, or stood for something that no name of the catalogue says.
        simple = plainest(library, noise, by_error(library, terms, questions))
        library.whiten(noise)
        terms = _retried(library, noise, simple, terms, answer, questions)
        # Where nothing stands, laws may have been made up for what comes and goes by itself. Beside a law it would
        # stand for what that law lacks.
        if not terms:
            for found in next_in_time(library, noise, terms):
                terms = _retried(library, noise, [found.term], terms, answer, questions)
            # A law is likelier than levels over intervals, which can stand for any.
            law, _ = with_unknown(library, noise, [], int(rng.integers(2**31)))
            if law and no_more_error(mismatch, law, terms):
                terms = _retried(library, noise, law, terms, answer, questions)
        wider, _ = with_unknown(library, noise, terms, int(rng.integers(2**31)))
        terms = _retried(library, noise, wider, terms, answer, questions)
    if all(forces_among([t]) for t in terms):
        trial = Answer(mismatch.axis)
        library, kept = of_few_seconds(library, noise, offered, trial, questions)
        answer.few_seconds = bool(kept)
        terms = _taken(answer, trial, kept) if kept else terms
    # Where two mechanisms shared one effect, the one that stayed need not be the likelier; nor its form the plainest.
    # One that takes the place of several is asked once more for likelier ones.
    for better in (likelier, fewest, likelier, plainest, one_law):
        terms = _renamed(library, noise, better(library, noise, terms), terms, answer, questions)
    terms = _renamed(library, noise, repeating(mismatch, noise, terms), terms, answer, questions)
    terms = _renamed(library, noise, nameless_within(library, noise, terms), terms, answer, questions)
    terms = _missing(library, noise, terms, look.inside)
    if terms:
        others = set(_not_timing(look.offered) if timed else look.offered).difference(names)
        library.take([t for t in look.offered if t in others])
    library.whiten(noise)
    answer.terms = terms
    answer.unproved = [] if terms else offered
    answer.noise = noise
    answer.simulated = {f"miscalibrated:{i}": c for i, c in look.inside.items()}
    whole = basis(library, noise, terms).bic
    answer.delta_bic = [basis(library, noise, without(terms, i)).bic - whole for i in range(len(terms))]
    answer.rivals = [rivals_of(library, noise, terms, i) for i in range(len(terms))]
    answer.rejected += _no_better(library, noise, answer)
    return answer


def _no_better(library: Library, noise: Noise, answer: Answer) -> list[Rejected]:
    """The mechanisms that were tried besides, each with what the likeliest of its shapes says beside what was found."""
    current = basis(library, noise, answer.terms)
    told = {t.name for t in answer.terms} | {r.mechanism for r in answer.rejected}
    return [
        Rejected(
            answer.axis,
            score.term.name,
            f"beside what was found its BIC is {score.bic - current.bic:+.0f}; "
            f"a finding needs {-LEAST_GAIN:.0f} or less, and a smaller error on unseen parts",
        )
        for score in shortlist_of(library.screen(current), told)
    ]


def _forces_alone(library: Library, noise: Noise, terms: list[Term]) -> list[Term]:
    """`terms` without what is slow beside forces over intervals, where forces found without it do as well: those that
    last for much of the time leave a constant as their mean, and waves and drifts for those that were not found yet."""
    if not forces_among(terms):
        return terms
    constant = [t for t in terms if t.mechanism.id in CONSTANT and not t.gates]
    slow = [t for t in terms if isinstance(t.mechanism, Rhythm) or (t.mechanism.id == "thermal_drift" and not t.gates)]
    for fewer in ([*constant, *slow] if slow else [], constant[:1]):
        if not fewer:
            continue
        rest = [t for t in terms if t not in fewer and not forces_among([t])]
        trial = [*rest, *(s.term for s in next_in_time(library, noise, rest) if forces_among([s.term]))]
        if no_more_error(library.mismatch, trial, terms, AS_GOOD):
            return trial
    return terms


def _missing(library: Library, noise: Noise, terms: Sequence[Term], inside: Mapping[str, Component]) -> list[Term]:
    """`terms`, with the plain name for what no wrong coefficient of the simulation explains.

    That is what is far larger than the simulation's own share of it, has another length, speed or time constant, acts
    in a box only, or is in proportion to another quantity: a tool's weight is no wrong weight of the axis. What takes
    something back in a box only has no name. A simulated
    friction that turns over a small way is Coulomb's all the same: where all of it is too large or too small, it is
    that number that is wrong.
    """
    terms = sensor_or_weight(library, noise, terms, inside)
    joint = fit(library.mismatch, noise, terms)
    coulomb = "miscalibrated:coulomb_friction"
    out = []
    for i, (term, amplitudes) in enumerate(zip(terms, joint.amplitudes, strict=True)):
        part = inside.get(term.mechanism.id)
        if part is not None and term.name != term.mechanism.id:
            effect = (amplitudes @ term.columns(library.mismatch.states))[library.mismatch.usable]
            size = float(np.sqrt(np.mean(effect**2)))
            new = size > _BEYOND_WRONG * part.size or _of_another_quantity(term, part.term)
            new |= _of_another_shape(library.mismatch, term, part.term, effect)
            # A wrong coefficient is wrong everywhere: what acts in a box only is something beside it.
            new |= bool(term.gates)
            if new and plausible(term.mechanism, library.polarity * amplitudes, np.zeros(len(amplitudes))):
                term = replace(term, name=term.mechanism.id)
            elif term.gates and term.mechanism.id in _QUANTITY:
                term = another_law(library, noise, terms, i) or _less_of_it(term, library.mismatch.axis)
            elif is_whole_presliding(term) and coulomb not in {t.name for t in terms}:
                inner = "coulomb_friction" in inside or is_whole_presliding(part.term)
                term = replace(term, name=coulomb) if inner else term
        out.append(term)
    return _without_knees(library, noise, out)


def another_law(library: Library, noise: Noise, terms: Sequence[Term], i: int) -> Term | None:
    """A law that the simulation lacks and that cannot be told from one that takes back some of a law that it has, in
    the box of this one: where an axis goes one way only, its friction is a constant like any other."""
    for rival in rivals_of(library, noise, terms, i):
        if rival.term.gates == terms[i].gates and rival.name == rival.term.mechanism.id != "unknown":
            return rival.term if rival.delta_bic < LIKELIER else None
    return None


def _less_of_it(term: Term, axis: str) -> Term:
    """A law of the catalogue that acts against its own direction in a box, as what no name says: a law of its quantity.
    The coefficient is right elsewhere."""
    name, form = _QUANTITY[term.mechanism.id]
    signal = name.format(axis)
    law = Formula(((signal, form),), QUANTITIES[signal].unit)
    return replace(term, mechanism=law, shape=(), name=law.id)


def _without_knees(library: Library, noise: Noise, terms: Sequence[Term]) -> list[Term]:
    """`terms`, with a saturation that bends nowhere in its box as what it is there: a factor on the current. A current
    saturates where it is high."""
    out = list(terms)
    for i, term in enumerate(terms):
        if term.mechanism.id == "current_saturation" and term.gates:
            current = factor_on_current(library.mismatch.axis)
            plain = [*out[:i], replace(term, mechanism=current, shape=(), name=current.id), *out[i + 1 :]]
            (bent,), (row,) = (library.columns(t)[:, library.mismatch.usable] for t in (term, plain[i]))
            left = bent - float(row @ bent) / max(float(row @ row), 1e-300) * row
            alike = float(left @ left) < _STRAIGHT * float(bent @ bent)
            if alike or basis(library, noise, plain).bic < basis(library, noise, out).bic + _BENDS:
                out = plain
    return out


def sensor_or_weight(
    library: Library, noise: Noise, terms: Sequence[Term], inside: Mapping[str, Component]
) -> list[Term]:
    """`terms`, with a constant on a vertical axis named by its size beside the simulated weight: the two fit equally
    well. Where no weight is simulated it is the weight, for an axis has one."""
    weight, own = inside.get("gravity_load"), next((t for t in library.terms if t.mechanism.id == "gravity_load"), None)
    sensor = next((t for t in library.terms if t.name == "sensor_offset"), None)
    if own is None or sensor is None:
        return list(terms)
    names = (sensor.name, own.name)
    which = [i for i, t in enumerate(terms) if t.name in names and not (t.gates or dict(t.shape).get("by_tool"))]
    if len(which) != 1:
        return list(terms)
    (i,) = which
    size = float(np.abs(fit(library.mismatch, noise, terms).amplitudes[i][0]))
    constant = replace(own, shape=(("by_tool", 0.0),))
    zero = weight is not None and size < _ZERO * weight.size
    return [*terms[:i], sensor if zero else constant, *terms[i + 1 :]]


def _of_another_quantity(term: Term, own: Term) -> bool:
    """Whether an effect is in proportion to something else than the simulation's own term is."""
    name = term.mechanism.quantity
    return name is not None and round(dict(term.shape)[name]) != round(dict(own.shape)[name])


def _of_another_shape(mismatch: Mismatch, term: Term, own: Term, effect: Float1D) -> bool:
    """Whether an effect (on usable rows) is not what the simulation's own term says, and its shape another one too."""
    shape, simulated = dict(term.shape), dict(own.shape)
    numbers = [p.name for p in term.mechanism.shape if p.scale == "log" and not p.is_choice]
    ratios = [abs(np.log(shape[n] / simulated[n])) for n in numbers if shape[n] > 0 and simulated[n] > 0]
    if not ratios or max(ratios) < np.log(_ANOTHER):
        return False
    columns = replace(own, gates=term.gates).columns(mismatch.states)[:, mismatch.usable]
    left = effect - solve(columns, effect)[0] @ columns
    return float(left @ left) > _CLEARLY_OTHER * float(effect @ effect)


def _retried(
    library: Library, noise: Noise, other: list[Term], terms: list[Term], answer: Answer, questions: int
) -> list[Term]:
    """What of `other` stands up to the strict tests, where it is no less than `terms` or leaves less error."""
    kept, trial = _confirmed(library, noise, other, terms, questions, SIGNIFICANT)
    if not kept or kept == terms:
        return terms
    more = len(kept) >= len(terms) or less_error(library.mismatch, kept, terms, 0.0)
    return _taken(answer, trial, kept) if more else terms


def _renamed(
    library: Library, noise: Noise, other: list[Term], terms: list[Term], answer: Answer, questions: int
) -> list[Term]:
    """`other`, which say the same in better names, where all stand up, or those that leave hardly more error."""
    kept, trial = _confirmed(library, noise, other, terms, questions, SIGNIFICANT_NAME)
    # Friction is steady before it is uneven, and stays so where what changes along the travel does not stand alone.
    stand = bool(kept) and all(is_without_mean(t) for t in other if t not in kept)
    holds = kept != terms and (stand or _as_good(library.mismatch, kept, terms))
    if [t.name for t in kept] == [t.name for t in terms]:
        holds = holds and no_more_error(library.mismatch, kept, terms)
    return _taken(answer, trial, kept) if holds else terms


def _confirmed(
    library: Library, noise: Noise, other: list[Term], terms: list[Term], questions: int, level: float
) -> tuple[list[Term], Answer]:
    """What of `other` stands up, with its proofs; nothing is tested where it is `terms` again."""
    trial = Answer(library.mismatch.axis)
    return (terms if other == terms else confirm(library, noise, other, trial, questions, level)), trial


def _taken(answer: Answer, trial: Answer, kept: list[Term]) -> list[Term]:
    """`kept`, with its proofs put into the answer."""
    names = {t.name for t in kept}
    answer.rejected = [r for r in answer.rejected if r.mechanism not in names]
    answer.p_values, answer.q_values = trial.p_values, trial.q_values
    return kept


def _as_good(mismatch: Mismatch, fewer: Sequence[Term], terms: Sequence[Term]) -> bool:
    """Whether no more terms leave an error on unseen folds that is hardly larger."""
    return 0 < len(fewer) <= len(terms) and no_more_error(mismatch, fewer, terms, AS_GOOD)


def _not_timing(terms: Sequence[Term]) -> list[Term]:
    return [t for t in terms if t.mechanism.id != "time_misalignment"]


def _any_sign(inside: Mapping[str, Component]) -> frozenset[str]:
    return frozenset(f"miscalibrated:{i}" for i in inside)
