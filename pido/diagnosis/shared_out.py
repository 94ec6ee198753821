"""When many names share out what is missing on one axis, and none is most of it: one honest `unknown` in their place.

In:  the terms of an axis as they are proved, and their findings.
Out: the findings as they are, or a single one without a name that is the sum of the laws; the model stays the same.

Several laws at once are rare, and the textbook's forms, each in a box of its own, can imitate nearly anything. Where
two laws are really missing, the two that do most do nearly all; where one law is that nobody has named, each of many
does a little. Of some 900 sealed cases four had four findings on an axis or more; three of these hid one law that is in
no textbook.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pido.core.arrays import Float1D
from pido.diagnosis.answers import where_of
from pido.diagnosis.confirm import held_out, plain_errors
from pido.diagnosis.finding import Evidence, Finding
from pido.diagnosis.formulas import LEVEL
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.terms import Term, fit
from pido.diagnosis.whiten import Noise

MANY = 4  # laws on one axis
_MOST = 0.5  # of what all take away of the mean square on unseen folds, that one of few does alone
_NEARLY_ALL = 0.75  # the same of two


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
    if not is_shared_out(full, terms):
        return list(findings), None
    axis = full.axis
    effect = np.sum([a @ t.columns(full.states) for t, a in zip(terms, amplitudes, strict=True)], axis=0)
    where = where_of(full.states, Term(LEVEL), effect, full.edges, level)
    laws = [f"({k}) {f.equation}" for k, f in enumerate(findings, start=1)]
    names = ", ".join(f.mechanism for f in findings)
    one = Finding(
        axis=axis,
        mechanism="unknown",
        kind="unexplained",
        equation=f"dI_{axis} = sum of {len(laws)} laws, none of which is most of it: " + "; ".join(laws),
        parameters={f"{n}_{k}": e for k, f in enumerate(findings, start=1) for n, e in f.parameters.items()},
        where=replace(where, summary=f"{axis} axis, over the intervals below; no single condition says where"),
        evidence=Evidence(
            min(f.evidence.p_value for f in findings),
            min(f.evidence.q_value for f in findings),
            fit(full, noise, []).bic - fit(full, noise, terms).bic,
        ),
        fit=held_out(full, noise, terms, [], recorded),
        replaces=tuple(dict.fromkeys(name for f in findings for name in f.replaces)),
    )
    return [one], (
        f"axis {axis}: {len(laws)} laws share out what is missing there ({names}), and none of them is most of it. "
        "That many at once are less likely than one that no name is known for: they stand as one finding without a "
        "name, which corrects the simulation as it is."
    )


def is_shared_out(full: Mismatch, terms: Sequence[Term]) -> bool:
    """Whether so many laws are on one axis, and neither is one most of what they do nor are two nearly all of it."""
    if len(terms) < MANY:
        return False
    none, every, *alone = (e**2 for e in plain_errors(full, (), terms, *([t] for t in terms)))
    all_do = none - every
    best = int(np.argmin(alone))
    if none - alone[best] > _MOST * all_do:
        return False
    pairs = [[terms[best], t] for k, t in enumerate(terms) if k != best]
    return none - min(plain_errors(full, *pairs)) ** 2 <= _NEARLY_ALL * all_do
