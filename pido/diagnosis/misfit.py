"""Whether a term is a finding, or only mends what the others lack.

In:  the terms of one axis as a joint model, and its noise.
Out: the first term that is too small, brings nothing on unseen folds, or stands for the misfit of stronger ones, and
     the reason in words.
No textbook form is quite the machine's. What a true effect has beyond its form is real, and significant; it is still no
mechanism of its own.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2

from pido.core.arrays import Bool1D, Float1D
from pido.diagnosis.confirm import (
    SIGNIFICANT,
    Whitened,
    cross_residual,
    even,
    fold_of,
    forces_among,
    less_error,
    p_value,
    paired_p,
)
from pido.diagnosis.gates import PATH_SPEED
from pido.diagnosis.library import Library
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.terms import Term, fit, solve
from pido.diagnosis.whiten import Noise

_LEAST_EFFECT = 0.1  # of the noise level, rms where active: a smaller effect is of no use to anybody
# The same for what no law stands behind: noise itself wanders as much, over seconds and around single frequencies.
_LEAST_NAMELESS = 0.4
_TIED_TO_TIME = frozenset({"unknown", "external_force", "thermal_drift"})
# Share of what findings remove where a further one acts, below which it only mends the form of the others: of a term
# whose shape is free, and of one that can take a single form only.
MISFIT, MISFIT_PLAIN = 0.04, 0.01
# The same around stops and reversals. What acts there is quick beside the control loop and the filters that it goes
# through, and turns within micrometres that no record shows: a textbook form is right to a good part of it only. One
# that takes WORTH of the error on unseen folds away stays nevertheless: a correction is better with it.
_MISFIT_AT_STOPS = 0.08
_ALONG_TRAVEL = frozenset({"torque_ripple", "position_dependent_friction"})
AT_STOPS = frozenset({"stribeck_friction", "standstill_friction", "presliding_hysteresis", "backlash"})
_SAME_LENGTH = 0.02  # relative, by which two waves may differ that are one
_CANCELLED = 0.1  # of the power of the smaller of two effects: what is left where they are two halves of another one
_TAKEN_BACK = 0.6  # of what a gain does to one mechanism of the simulation: with so much of it gone it is no gain
_UNEVEN = 0.4  # of the size of a law, by which it may differ from part to part: it has no quite true form
_UNEVEN_P = 1e-6
_FEWEST_PARTS, _SOME = 4, 1e-3  # parts with at least this share of a law's power
_SMALL = 0.12  # the same share for a finding that is small in its own right
_WARMS_S = 10.5  # what changes faster ends at the shortest time constant of a drift
_FEW_LASTING = 20  # rows
_NEARLY_ALL = 0.7
_FEW_BLOCKS = 4
_UNSEEN = 0.05  # p value of a gain on unseen folds, after all other tests
_UNSEEN_IN_A_BOX = 0.02  # the same of a law in a box: there are more boxes than laws to choose from
_MANY_VISITS = 12  # blocks that meet a box, of which single ones do not speak for all
_LASTING = 0.4  # correlation with itself one row later of what acts around stops and reversals
WORTH = 0.05  # share of the error on unseen folds that a term takes away by itself: it is no misfit of the others
_IN_MOTION = (0.02, 0.5)  # of the power of such a law: with less it is none, with more nothing is asked
_SMALL_EFFECT = 0.5  # noise levels: what such a small finding removes, rms where it acts


def useless(library: Library, noise: Noise, terms: Sequence[Term]) -> tuple[int, str | None]:
    """The first term that is too small, brings nothing on unseen folds, or only mends the misfit of the others."""
    mismatch = library.mismatch
    joint = fit(mismatch, noise, terms)
    effects = [a @ t.columns(mismatch.states) for t, a in zip(terms, joint.amplitudes, strict=True)]
    every = cross_residual(mismatch, noise, terms)
    level = float(np.median(noise.level))
    i = cancelled(effects, mismatch.usable)
    if i is not None:
        return i, "another finding takes nearly all of it back: together they stand for something else"
    i = _gain_of_some(library, terms, effects)
    if i is not None:
        return i, "another finding takes it back for a part of the simulated current: a gain scales all of it"
    for i, term in enumerate(terms):
        acts = acting(mismatch, effects[i])
        rms = float(np.sqrt(np.mean(effects[i][acts] ** 2))) if acts.any() else 0.0
        least = _LEAST_NAMELESS if term.name in _TIED_TO_TIME else _LEAST_EFFECT
        if rms < least * level:
            return i, f"{rms:.2g} A where it acts, under {least:.0%} of the noise"
        if term.mechanism.id == "thermal_drift" and dict(term.shape)["tau"] < _WARMS_S:
            return i, f"it changes within {dict(term.shape)['tau']:.3g} s: nothing warms so fast"
        others = [t for k, t in enumerate(terms) if k != i]
        held_in_a_box = term.gates and bool(dict(term.shape).get("rest")) and term.mechanism.id not in AT_STOPS
        asked = term.mechanism.id in _ALONG_TRAVEL or held_in_a_box
        if asked and not _seen_in_motion(mismatch, others, terms, effects[i]):
            return i, "nearly all of it is at standstill, where what is left of friction differs from stop to stop"
        single = term.mechanism.transient and lasting(mismatch, term) < _LASTING
        if single and not _goes_on(mismatch, acts, others, terms):
            return i, "it lasts for single rows only, which a rounded sign or a late sample also leaves"
        if less_error(mismatch, terms, others, WORTH):
            continue
        judge, after = noise, every
        if forces_among([term]):
            # Where its ends are a row beside the true ones, whitened rows would count little else.
            judge, fold = even(mismatch), fold_of(mismatch, [term])
            before, after = (cross_residual(mismatch, judge, t, fold) for t in (others, terms))
        else:
            before = cross_residual(mismatch, noise, others)
        boxed = bool(term.gates)
        blocks = len(np.unique(mismatch.block[acts]))
        few = len(terms) == 1 and (blocks < _MANY_VISITS if boxed else _seldom(term, blocks))
        if not _holds_unseen(mismatch, judge, before, after, acts, few, _UNSEEN_IN_A_BOX if boxed else _UNSEEN):
            return i, "no gain on parts that were not fitted"
    i = _differs_by_part(mismatch, terms, effects, joint.residual)
    if i is not None:
        return i, "it has another size in every part: no law of the catalogue has"
    i = _same_wave(mismatch.axis, terms, effects)
    if i is not None:
        return i, "the same wave as another finding, where the axis is fast: a drive and a sample pass less of it there"
    i = _mends_at_stops(mismatch, noise, terms)
    if i is not None:
        return i, "it hardly adds to what the others around stops and reversals remove: it mends their form"
    return _mends_form(mismatch, noise, terms, effects)


def _holds_unseen(
    mismatch: Mismatch, noise: Noise, before: Float1D, after: Float1D, acts: Bool1D, few: bool, least: float
) -> bool:
    """Whether what other folds say of a term is there in each, (n,) in A `before` and `after` it is taken out.

    few : it acts in a few blocks only, and all say how far their sums scatter; least : p value that is asked
    """
    b, a = noise.whiten(np.array([before, after]))
    gain = b**2 - a**2
    if gain.sum() <= 0:
        return False
    # Blocks in which it never acts say nothing for it or against it.
    met = np.bincount(mismatch.block, acts)[mismatch.block] > 0
    if paired_p(gain, mismatch, mismatch.usable & met) <= least:
        return True
    return few and p_value(Whitened((b - a)[None], b, (slice(0, 1),)), 0, mismatch.block, pooled=True) <= least


def _seen_in_motion(mismatch: Mismatch, others: Sequence[Term], terms: Sequence[Term], effect: Float1D) -> bool:
    """Whether a law along the travel, or a friction in a box, `effect` (n,) in A of `terms`, is there while the axis
    travels: at standstill it says one number for each stop, and what is left of friction differs from stop to stop by
    itself."""
    moving = np.concatenate([s.moving for s in mismatch.states]) & mismatch.usable
    power = effect**2 * mismatch.usable
    share = float(power[moving].sum()) / max(float(power.sum()), 1e-300)
    if share > _IN_MOTION[1]:
        return True
    before, after = (cross_residual(mismatch, even(mismatch), t) for t in (others, terms))
    return share > _IN_MOTION[0] and paired_p(before**2 - after**2, mismatch, moving) <= _UNSEEN


def _seldom(term: Term, blocks: int) -> bool:
    """Whether a law acts in so few blocks that they alone say little: the run-ups of a spindle in two short parts."""
    return term.name != "unknown" and blocks < _FEW_BLOCKS


def _same_wave(axis: str, terms: Sequence[Term], effects: Sequence[Float1D]) -> int | None:
    """A wave along the travel, as long as a stronger one, for some speeds without the slowest."""
    waves = [i for i, t in enumerate(terms) if t.mechanism.id in _ALONG_TRAVEL]
    for i, j in itertools.permutations(waves, 2):
        length, other = (dict(terms[k].shape)["L"] for k in (i, j))
        fast = any(
            g.variable in (f"v_{axis}", f"|v_{axis}|", PATH_SPEED) and (g.low > 0 or g.high < 0) for g in terms[i].gates
        )
        weaker = float(effects[i] @ effects[i]) < float(effects[j] @ effects[j])
        if fast and weaker and abs(length / other - 1) < _SAME_LENGTH:
            return i
    return None


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
    if missed[least] >= _MISFIT_AT_STOPS * (error(family) - whole):
        return None
    return None if less_error(mismatch, terms, [t for k, t in enumerate(terms) if k != least], WORTH) else least


def _differs_by_part(
    mismatch: Mismatch, terms: Sequence[Term], effects: Sequence[Float1D], residual: Float1D
) -> int | None:
    """The law whose size differs most from part to part, where that is more than _UNEVEN of its mean size and more than
    blocks scatter; None where each is the same everywhere, as far as parts can tell, or has no other to mend.

    Source: variance between studies (DerSimonian and Laird 1986), with the variance of each from its blocks.
    """
    most, which = _UNEVEN, None
    for i, (term, effect) in enumerate(zip(terms, effects, strict=True) if len(terms) > 1 else ()):
        if term.name in _TIED_TO_TIME or term.mechanism.id == "tool_wear":
            continue
        x, left = effect * mismatch.usable, (residual + effect) * mismatch.usable
        power, inner = (np.bincount(mismatch.part, v) for v in (x**2, x * left))
        some = power > _SOME * power.sum()
        if some.sum() < _FEWEST_PARTS:
            continue
        size = np.where(some, inner / np.where(some, power, 1.0), 0.0)
        scatter = np.bincount(mismatch.block, (left - size[mismatch.part] * x) * x) ** 2
        first = np.unique(mismatch.block, return_index=True)[1]
        variance = (
            np.bincount(mismatch.part[first], scatter[mismatch.block[first]], len(power))[some] / power[some] ** 2
        )
        weight = 1 / np.maximum(variance, 1e-12)
        mean = float(weight @ size[some] / weight.sum())
        excess = float(weight @ (size[some] - mean) ** 2)
        free = int(some.sum()) - 1
        between = max(0.0, excess - free) / float(weight.sum() - np.sum(weight**2) / weight.sum())
        share = np.sqrt(between) / max(abs(mean), 1e-12)
        if share > most and chi2.sf(excess, free) < _UNEVEN_P:
            most, which = share, i
    return which


def cancelled(effects: Sequence[Float1D], rows: Bool1D) -> int | None:
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
        if any(np.sum((every[i] + o) ** 2) < _CANCELLED * min(power[i], float(o @ o)) for o in beside):
            return int(i)
    return None


def _gain_of_some(library: Library, terms: Sequence[Term], effects: Sequence[Float1D]) -> int | None:
    """A sensor's gain of which a wrong coefficient takes most back, for what the simulation has of that mechanism.

    A sensor scales the whole current. What leaves a part of it as it was is a wrong coefficient of the other parts.
    """
    mismatch = library.mismatch
    i = next((i for i, t in enumerate(terms) if t.name == "sensor_gain" and not t.gates), None)
    wrong = [k for k, t in enumerate(terms) if t.name.startswith("miscalibrated:")]
    if i is None or not wrong:
        return None
    # As the simulation has it, a mechanism is the last of its name.
    inside = {t.name: t for t in library.terms if t.name.startswith("miscalibrated:")}
    parts = [(name, row) for name, t in inside.items() for row in library.columns(t)]
    rows = mismatch.usable
    X = np.array([row[rows] for _, row in parts])
    shares = solve(np.r_[X, np.ones((1, X.shape[1]))], effects[i][rows])[0]
    for k in wrong:
        own = np.sum(
            [b * x for b, (name, _), x in zip(shares, parts, X, strict=False) if name == terms[k].name], axis=0
        )
        if -float(np.dot(effects[k][rows], own)) > _TAKEN_BACK * float(np.dot(own, own)) > 0:
            return i
    return None


def _mends_form(
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
        small = share < (_MISFIT_AT_STOPS if of_stops else MISFIT if free else MISFIT_PLAIN)
        small = small or (share < _SMALL and added < (_SMALL_EFFECT * level) ** 2)
        if moved is None:
            small = small and not less_error(mismatch, terms, [t for k, t in enumerate(terms) if k != i], WORTH)
        small = small or (moved is not None and share < _SMALL)
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
