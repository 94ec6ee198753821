"""What only a few seconds of all recordings show: they are cut into pieces, by which it can be judged.

In:  one axis of all parts on which nothing stands, or forces over intervals alone, and the laws that are likely.
Out: the likeliest of them, where it stands by pieces of these seconds and says more than a force would; the same axis
     with their blocks in pieces, each an observation, left out in turn.
Blocks as long as those of all recordings are one or two observations here, which prove nothing. The pieces are shorter
than what a real machine's current forgets in; how far sums over blocks of full length scatter is still asked of all
others. What is shown by seconds of one part is shown for these: it is said of every such finding.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pido.core.arrays import Float1D, Int1D
from pido.diagnosis.identify import LEAST_GAIN, Answer, confirm, next_in_time
from pido.diagnosis.library import Library, basis
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.regions import within_same_limits
from pido.diagnosis.terms import Term, fit
from pido.diagnosis.whiten import Noise

_MOST_OF_IT = 0.9  # of what a law does
_FEW, _SHARE_OF_THEM = 3, 0.1  # blocks that are too few to prove it, and the share of all that are
_PIECES = 12  # that the few blocks are cut into, together
_SHORTEST_S, _FEWEST_ROWS = 0.2, 5  # of a piece, in which the law acts
_FOLDS = 5
# What no few seconds can show: what changes over hours, an event, what has no name.
_NOT_AT_ONCE = frozenset({"unknown", "external_force", "thermal_drift", "tool_wear"})


def of_few_seconds(
    library: Library, noise: Noise, offered: Sequence[Term], answer: Answer, questions: int
) -> tuple[Library, list[Term]]:
    """The likeliest law of those offered, or in their boxes, where a few seconds alone show it, it stands by their
    pieces, and forces over intervals say clearly less; and the library in which the pieces are blocks.

    answer : into which its proofs go
    """
    boxed = [_in_its_box(library, noise, t) for t in offered if t.gates]
    laws = [t for t in itertools.chain(offered, *boxed) if t.name not in _NOT_AT_ONCE]
    by_bic = {t: basis(library, noise, [t]).bic for t in laws}
    best = min(by_bic, key=lambda t: by_bic[t], default=None)
    pieces = None if best is None else in_pieces(library.mismatch, noise, [best])
    if best is None or pieces is None:
        return library, []
    in_time = min((s.bic for s in next_in_time(library, noise, [])), default=np.inf)
    if by_bic[best] > in_time - LEAST_GAIN:
        return library, []
    fine = library.on(pieces)
    kept = confirm(fine, noise, [best], answer, questions)
    return (fine, kept) if kept else (library, [])


def _in_its_box(library: Library, noise: Noise, term: Term) -> list[Term]:
    """The laws that are likely in the box of a term, which may be one of those that no few seconds can show."""
    return [s.term for s in within_same_limits(library, basis(library, noise, []), term, _NOT_AT_ONCE)]


def blocks_of(mismatch: Mismatch, effect: Float1D) -> Int1D | None:
    """The blocks that have nearly all of an effect (n,), A, the strongest first; None where they are not few."""
    power = np.bincount(mismatch.block, np.where(mismatch.usable, effect**2, 0.0))
    ranked = np.argsort(-power)
    count = 1 + int(np.searchsorted(np.cumsum(power[ranked]), _MOST_OF_IT * power.sum()))
    return ranked[:count] if power.sum() > 0 and count <= max(_FEW, _SHARE_OF_THEM * len(power)) else None


def in_pieces(mismatch: Mismatch, noise: Noise, terms: Sequence[Term]) -> Mismatch | None:
    """The axis with the few blocks in which `terms` act cut into pieces; None where these are not few."""
    effect = np.sum(
        [a @ t.columns(mismatch.states) for t, a in zip(terms, fit(mismatch, noise, terms).amplitudes, strict=True)],
        axis=0,
    )
    few = blocks_of(mismatch, effect)
    if few is None:
        return None
    power = np.where(mismatch.usable & np.isin(mismatch.block, few), effect**2, 0.0)
    least = max(_FEWEST_ROWS, int(np.ceil(_SHORTEST_S / mismatch.step)))
    piece = np.zeros(mismatch.n, int)
    for k in few:
        rows = np.flatnonzero(mismatch.block == k)
        piece[rows] = _even_pieces(power[rows], _PIECES * power[rows].sum() / power.sum(), least)
    block = np.unique(np.stack([mismatch.block, piece]), axis=1, return_inverse=True)[1].ravel()
    return replace(mismatch, block=block, left_out=block % _FOLDS)


def _even_pieces(power: Float1D, count: float, least: int) -> Int1D:
    """(n,) – the piece of each row of a block, of about the same power each, and of so many rows at least."""
    share = np.cumsum(power) / power.sum()
    ends, start = [], 0
    for k in range(1, max(1, round(count))):
        end = max(int(np.searchsorted(share, k / round(count))) + 1, start + least)
        if len(power) - end < least:
            break
        ends.append(end)
        start = end
    return np.searchsorted(ends, np.arange(len(power)), side="right")
