"""When several names share out what is missing on one axis, and none is most of it, or when two take most of each other
back: one honest `unknown` in their place.

In:  the terms of an axis as they are proved, and their findings.
Out: the findings as they are, or one without a name that is the sum of the laws; the model stays the same.

Several laws at once are rare, and the textbook's forms, each in a box of its own, can imitate nearly anything. Where
two laws are really missing, the two that do most do nearly all; where one law is that nobody has named, each of many
does a little; the more so where most act in boxes, each in one of its own. Of some 900 sealed cases four had four
findings on an axis or more; three of these hid one law that is in no textbook. Two laws that oppose each other, one of
them a drift or in a box, are the difference of two textbook forms, which can imitate a third.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from pido.core.arrays import Float1D
from pido.diagnosis.answers import in_words, where_of
from pido.diagnosis.confirm import even, held_out, plain_errors
from pido.diagnosis.estimate import settle_shapes
from pido.diagnosis.finding import Evidence, Finding
from pido.diagnosis.forms import HOLDS_COULOMB
from pido.diagnosis.formulas import LEVEL
from pido.diagnosis.mechanisms.advice import SEVERAL
from pido.diagnosis.misfit import AT_STOPS
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.terms import Term, fit
from pido.diagnosis.whiten import Noise

MANY = 4  # laws on one axis
_MOST, _NEARLY_ALL = 0.5, 0.75  # of what all take away of the mean square on unseen folds, that one and two do alone
_MOST_OF_BOXES, _NEARLY_ALL_OF_BOXES = 0.7, 0.85  # the same where most laws act in boxes, each in one of its own
_TAKEN_BACK = 0.5  # of the power that two laws have each by itself, below which their sum has little of either
_CONSTANT_BACK = 0.7  # the same of a constant beside a law without a name, which may well have one of its own


def one_for_many(
    full: Mismatch,
    noise: Noise,
    terms: Sequence[Term],
    amplitudes: Sequence[Float1D],
    findings: Sequence[Finding],
    recorded: Float1D,
    level: float,
) -> tuple[list[Finding], str | None]:
    """The findings of `terms`, or one in place of them and a note that says what it is made of.

    recorded : (n,), A – the recorded current; level : A – noise of the axis
    """
    effects = [a @ t.columns(full.states) for t, a in zip(terms, amplitudes, strict=True)]
    if is_shared_out(full, terms):
        every = range(len(terms))
        one = _sum_of(every, full, noise, terms, effects, findings, recorded, level)
        return [one], (
            f"axis {full.axis}: {len(terms)} laws share out what is missing there ({_names(findings, every)}), and "
            "none of them is most of it. That many at once are less likely than one that no name is known for: they "
            "stand as one finding without a name, which corrects the simulation as it is."
        )
    two = opposed(terms, [e[full.usable] for e in effects])
    if two is None:
        return list(findings), None
    one = _sum_of(two, full, noise, terms, effects, findings, recorded, level)
    rest = [one if k == two[0] else f for k, f in enumerate(findings) if k != two[1]]
    return rest, (
        f"axis {full.axis}: two laws take most of each other back ({_names(findings, two)}). What is left of them is "
        "likelier one law that no name is known for: they stand as one finding without a name, which corrects the "
        "simulation as it is."
    )


def _names(findings: Sequence[Finding], which: Collection[int]) -> str:
    return ", ".join(findings[k].mechanism for k in which)


def _sum_of(
    which: Collection[int],
    full: Mismatch,
    noise: Noise,
    terms: Sequence[Term],
    effects: Sequence[Float1D],
    findings: Sequence[Finding],
    recorded: Float1D,
    level: float,
) -> Finding:
    """One finding without a name for those of `which`, beside the others."""
    axis, some = full.axis, [findings[k] for k in which]
    rest = [t for k, t in enumerate(terms) if k not in which]
    effect = np.sum([effects[k] for k in which], axis=0)
    where = where_of(full.states, Term(LEVEL), effect, full.edges, level)
    laws = [f"({k}) {f.equation}" for k, f in enumerate(some, start=1)]
    return Finding(
        axis=axis,
        mechanism="unknown",
        kind="unexplained",
        equation=f"dI_{axis} = sum of {len(laws)} laws, none of which is most of it: " + "; ".join(laws),
        parameters={f"{n}_{k}": e for k, f in enumerate(some, start=1) for n, e in f.parameters.items()},
        where=replace(
            where, summary=in_words(f"{axis} axis, over the intervals below; no single condition says where")
        ),
        evidence=Evidence(
            min(f.evidence.p_value for f in some),
            min(f.evidence.q_value for f in some),
            fit(full, noise, rest).bic - fit(full, noise, terms).bic,
        ),
        fit=held_out(full, noise, terms, rest, recorded),
        replaces=tuple(dict.fromkeys(name for f in some for name in f.replaces)),
        to_record=SEVERAL,
    )


def opposed(terms: Sequence[Term], effects: Sequence[Float1D]) -> tuple[int, int] | None:
    """The two laws that take most of each other back, of several such the two that do so most; None without.

    effects : per term (n,), A, on usable rows
    One of them has to bend the other: a drift, or a law in a box. Two laws that act everywhere may well oppose each
    other; a wrong zero and a law without a name hardly do.
    """
    most, which = 1.0, None
    for (i, a), (j, b) in itertools.combinations(enumerate(terms), 2):
        limit = _may_oppose(a, b)
        power = float(effects[i] @ effects[i] + effects[j] @ effects[j])
        both = effects[i] + effects[j]
        left = float(both @ both) / max(power, 1e-300)
        if left < min(limit, most):
            most, which = left, (i, j)
    return which


def _may_oppose(a: Term, b: Term) -> float:
    """Below how much of their power the sum of two terms makes them one; 0 where each stands by itself."""
    if {a.name, b.name} == {"sensor_offset", "unknown"}:
        return _CONSTANT_BACK
    may = (_bends(a) or _bends(b)) and all(map(_is_law, (a, b))) and not _belong_together(a, b)
    return _TAKEN_BACK if may else 0.0


def _bends(term: Term) -> bool:
    """Whether it can take back what another law says at some times or places only."""
    return term.mechanism.id == "thermal_drift" or bool(term.gates)


def _belong_together(a: Term, b: Term) -> bool:
    """Whether two laws oppose each other for a reason: two wrong coefficients of one friction curve, forms that mend
    each other around stops, and a friction along the travel or of a way, which holds Coulomb's."""
    own = {a.mechanism.id, b.mechanism.id}
    wrong = all(t.name.startswith("miscalibrated:") for t in (a, b))
    return wrong or own <= AT_STOPS or (bool(own & HOLDS_COULOMB) and "coulomb_friction" in own)


def _is_law(term: Term) -> bool:
    """Whether it is of the motion or the process, with a name or without: no fault of the data, no force over
    intervals."""
    return term.name != "external_force" and term.mechanism.kind != "data_fault"


def is_shared_out(full: Mismatch, terms: Sequence[Term]) -> bool:
    """Whether so many laws are on one axis, and neither is one most of what they do nor are two nearly all of it.

    Beside the physical equation in place of a simulation they are not: inertia, Stribeck's friction and the forces of
    the cut are none of its terms, and all of them may be missing.
    """
    if len(terms) < MANY or full.base_names:
        return False
    # By itself each may have another shape than beside the others.
    single = (settle_shapes(full, even(full), [t]) for t in terms)
    none, every, *alone = (e**2 for e in plain_errors(full, (), terms, *single))
    all_do = none - every
    best = int(np.argmin(alone))
    boxes = len({t.gates for t in terms if t.gates})
    most, nearly_all = (_MOST_OF_BOXES, _NEARLY_ALL_OF_BOXES) if 2 * boxes > len(terms) else (_MOST, _NEARLY_ALL)
    if none - alone[best] > most * all_do:
        return False
    pairs = [[terms[best], t] for k, t in enumerate(terms) if k != best]
    return none - min(plain_errors(full, *pairs)) ** 2 <= nearly_all * all_do
