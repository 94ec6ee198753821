"""The right name and the plainest form for a term, once it is known that something acts there.

In:  the terms of one axis, its library and noise.
Out: the same terms, each as the likeliest mechanism in its place (`likelier`), in the first of the textbook forms that
     fit equally well (`plainest`); and what else could stand in a term's place (`rivals_of`).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pido.core.arrays import Float1D
from pido.core.axes import LINEAR_AXES
from pido.diagnosis.confirm import cross_residual, even, plain_errors
from pido.diagnosis.formulas import LEVEL, Unnamed
from pido.diagnosis.gates import Gate
from pido.diagnosis.identify import CONFINED, LEAST_GAIN, Rival, numbers
from pido.diagnosis.late import Lagged
from pido.diagnosis.library import Library, basis
from pido.diagnosis.misfit import AT_STOPS, MISFIT, MISFIT_PLAIN, acting
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.regions import with_own_limits, within_same_limits
from pido.diagnosis.select import refine, shortlist_of
from pido.diagnosis.terms import Term, fit, without
from pido.diagnosis.unnamed import best_nameless
from pido.diagnosis.whiten import Noise

CONSTANT = ("gravity_load", "sensor_offset")  # a weight and a zero: the same on an axis that stands upright
_ALL_HELD = 0.95  # share of a Stribeck friction's power at standstill, above which it is what the axis holds there
HELD = 0.8  # share of a presliding friction's power at standstill, above which holding there is a finding of its own
HOLDS_COULOMB = frozenset({"presliding_hysteresis", "position_dependent_friction"})
VARIES = 0.25  # rms of what changes along the travel, of the mean: below it, friction is steady before it is uneven
_FEW_RIVALS = 5  # that are tried in the place of several terms
AS_GOOD = 1 / 0.998  # times an error on unseen folds: as good
_WORSE = 0.15  # of the error on unseen folds, by which one law for several may be worse: their forms mend each other
_MISSED = 0.25  # of what several laws remove where one of them acts: one law that lacks more there does not say it
# What turns with the motion: where it turns, the form of one may lack any share of what another mends.
_OF_TURNS = AT_STOPS | {"coulomb_friction", "friction_asymmetry"}
_ENDS = (0.01, 0.99)  # of the places at which a friction acts
_ALIKE = 2.0  # BIC by which a plainer form may be less likely
_ONE_WAY = {1.0: Gate("v", low=0.0), 2.0: Gate("v", high=0.0)}  # by the side on which an asymmetry acts
_WAY = 0.1  # mm, over which Coulomb's friction may turn; what takes longer, and no loop explains, is presliding
_LATE_S = (0.005, 0.01, 0.02, 0.04, 0.08)  # s, by which the loop of a drive may answer
_SAME_FORM, _SAME_LAW = 0.05, 0.1  # rms by which two forms, and two laws, may differ in a box, of one of them
LIKELIER = 6.0  # BIC by which another law in a term's place must be better to take it; within it both are as likely


def plainest(library: Library, noise: Noise, terms: Sequence[Term]) -> list[Term]:
    """Of textbook forms that fit equally well beside the other terms, the first.

    What sgn(v) lacks of a presliding friction includes what it holds at standstill. Where the two have sizes of their
    own, or nearly all of it is held at standstill, they are two findings.
    """
    out = _without_drift(library, _without_places(library, list(terms)))
    out = _bent_for_long_waves(library, noise, out)
    out = _viscous_one_way(library, out)
    out = _without_limits(library.mismatch, [_friction_in_a_cut(library, t, out) for t in out])
    out = _without_whole_presliding(library, out)
    standing = next((t for t in library.terms if t.mechanism.id == "standstill_friction"), None)
    if standing is not None and standing.name not in {t.name for t in out}:
        out = [_held_only(library.mismatch, t, standing) for t in out]
    if standing is not None and standing.name not in {t.name for t in out}:
        for i, term in enumerate(out):
            if term.mechanism.id == "presliding_hysteresis" and not term.gates:
                turned = term.with_shape(full=0.0)
                trial = [*out[:i], turned, *out[i + 1 :], standing]
                margin = LEAST_GAIN if _at_standstill(library.mismatch, term) > HELD else -LEAST_GAIN
                if basis(library, noise, trial).bic < basis(library, noise, out).bic + margin:
                    out = trial
                    break
    # Beside Coulomb's friction the forms of these two that hold it as well are the same sum, and no name of their own.
    coulomb = any(t.mechanism.id == "coulomb_friction" and not t.gates for t in out)
    for i, term in enumerate(out):
        for p in term.mechanism.shape:
            if not p.is_choice or (coulomb and term.mechanism.id in HOLDS_COULOMB):
                continue
            whole = basis(library, noise, out).bic
            for value in p.values:
                if value == dict(out[i].shape).get(p.name, 0.0):
                    break
                plainer = out[i].with_shape(**{p.name: value})
                trial = [*out[:i], plainer, *out[i + 1 :]]
                same = bool(out[i].gates) and _is_same(library, plainer, out[i])
                if same or (np.any(library.columns(plainer)) and basis(library, noise, trial).bic < whole + _ALIKE):
                    out = trial
                    break
    return out


def _bent_for_long_waves(library: Library, noise: Noise, terms: list[Term]) -> list[Term]:
    """`terms` with a slope and a bend for each wave along the travel that is longer than the way on which it acts,
    where they are as likely: of a wave of which a part is seen, neither length nor heights are known."""
    for i, term in enumerate(terms):
        if term.mechanism.id != "position_dependent_friction" or dict(term.shape)["form"] not in (0, 3):
            continue
        acts = acting(library.mismatch, np.abs(library.columns(term)).sum(axis=0))
        places = np.concatenate([np.zeros(len(s.time)) if s.pos is None else s.pos for s in library.mismatch.states])
        low, high = np.quantile(places[acts], _ENDS) if acts.any() else (0.0, 0.0)
        if not 0 < high - low < dict(term.shape)["L"]:
            continue
        form = 1.0 + dict(term.shape)["form"]
        bent = term.with_shape(form=form, L=float(high - low) / 2, p_0=float(low + high) / 2)
        trial = [*terms[:i], bent, *terms[i + 1 :]]
        if basis(library, noise, trial).bic < basis(library, noise, terms).bic + _ALIKE:
            terms = trial
    return terms


def _viscous_one_way(library: Library, terms: list[Term]) -> list[Term]:
    """`terms` with viscous friction between limits, one direction of the axis among them, for what differs between its
    directions in a box, where that does nearly all of it: a difference in a box has a step to be one."""
    viscous = next((t for t in library.terms if t.mechanism.id == "viscous_friction"), None)
    if viscous is None or viscous.name in {t.name for t in terms}:
        return terms
    for i, term in enumerate(terms):
        side = dict(term.shape).get("side") if term.mechanism.id == "friction_asymmetry" and term.gates else None
        if side in _ONE_WAY:
            gates = (*term.gates, replace(_ONE_WAY[side], variable=f"v_{library.mismatch.axis}"))
            trial = [*terms[:i], replace(viscous, gates=gates), *terms[i + 1 :]]
            if _lacks_little(*_left(library.mismatch, without(terms, i), trial, terms), share=MISFIT_PLAIN):
                return trial
    return terms


def _friction_in_a_cut(library: Library, term: Term, terms: Sequence[Term]) -> Term:
    """Coulomb's friction for what acts along sgn(v) in cuts of some areas, whatever is cut: an edge ploughs in all."""
    shape, areas = dict(term.shape), [g for g in term.gates if g.variable == "AR"]
    ploughs = term.mechanism.id == "edge_force" and (shape["along"], shape["length"]) == (1.0, 0.0)
    taken = any(t.name == "coulomb_friction" and not t.gates for t in terms)
    if not ploughs or not areas or taken or library.mismatch.axis not in LINEAR_AXES:
        return term
    cuts = [s.ar[s.ar > 0] for s in library.mismatch.states if s.ar is not None]
    least = min((float(ar.min()) for ar in cuts if len(ar)), default=0.0)
    in_cuts = () if any(np.isfinite(g.low) for g in areas) else (Gate("AR", low=0.5 * least),)
    for other in library.terms:
        if other.name == "coulomb_friction":
            friction = replace(other, gates=(*in_cuts, *term.gates))
            if _is_same(library, friction, term, _SAME_LAW):
                return friction
    return term


def _is_same(library: Library, plainer: Term, term: Term, within: float = _SAME_FORM) -> bool:
    """Whether a form is a multiple of a plainer one but for a small share: a sign that rises smoothly is one that
    jumps wherever a box has only faster motion."""
    own, plain = (library.columns(t)[:, library.mismatch.usable] for t in (term, plainer))
    if not np.any(plain):
        return False
    rest = own - np.linalg.lstsq(plain.T, own.T, rcond=None)[0].T @ plain
    return bool(np.sum(rest**2) < within**2 * np.sum(own**2))


def fewest(library: Library, noise: Noise, terms: Sequence[Term]) -> list[Term]:
    """`terms`, with one mechanism in the place of several, or of one that acts in a box only, where it removes nearly
    all that they remove.

    One cause is likelier than two that happen together, and a law is likelier than a box that is as good. What they
    remove beyond it is no more than what any textbook form lacks; and it may take no more numbers than they do.
    """
    out = list(terms)
    # By the plain error, which decides here: weights that whiten would choose a form by its quick part.
    flat = even(library.mismatch)
    changed = len(terms) > 1 or any(t.gates for t in terms)
    if changed:
        library.whiten(flat)
    while changed:
        changed = False
        pairs = itertools.combinations(out, 2)
        for group in dict.fromkeys([tuple(out), *pairs, *((t,) for t in out)]):
            one = _one_for(library, flat, out, group)
            if one is not None:
                out = [*(t for t in out if t not in group), one]
                changed = True
                break
    library.whiten(noise)
    return out


def _one_for(library: Library, flat: Noise, terms: Sequence[Term], group: Sequence[Term]) -> Term | None:
    """A mechanism that removes nearly all that `group` does beside the other terms, with no more numbers; or None."""
    if (len(group) == 1 and not group[0].gates) or any(t.name == "external_force" for t in group):
        return None
    if all(t.name == "unknown" for t in group):
        return None
    mismatch = library.mismatch
    rest = [t for t in terms if t not in group]
    none, whole = (cross_residual(mismatch, flat, t) ** 2 for t in (rest, terms))
    current = basis(library, flat, rest)
    found = []
    for score in shortlist_of(library.screen(current), {t.name for t in rest})[:_FEW_RIVALS]:
        term = refine(library, current, score).term
        if numbers([term]) > numbers(group):
            continue
        squares = (none, cross_residual(mismatch, flat, [*rest, term]) ** 2, whole)
        errors = [float(np.mean(x[mismatch.usable])) for x in squares]
        if _nearly_all(*errors) and not (len(group) > 1 and _misses(mismatch, flat, terms, group, term, squares)):
            found.append((numbers([term]), errors[1], term))
    if not found:
        return _law_over_boxes(library, flat, terms, group)
    fewest_numbers = min(n for n, _, _ in found)
    least = min(left for n, left, _ in found if n == fewest_numbers)
    # Of those as simple and as good the first of the catalogue.
    near = [t for n, left, t in found if n == fewest_numbers and left < AS_GOOD**2 * least]
    chosen = min(near, key=lambda t: next(i for i, m in enumerate(library.terms) if m.name == t.name))
    whole_presliding = next((t for _, _, t in found if is_whole_presliding(t)), None)
    if chosen.name == "coulomb_friction" and whole_presliding and _turns_over_a_way(mismatch, rest, whole_presliding):
        return whole_presliding
    return chosen


def _law_over_boxes(library: Library, flat: Noise, terms: Sequence[Term], group: Sequence[Term]) -> Term | None:
    """A law without a name of the quantity over which all of `group` have their boxes, where it does nearly all that
    they do with fewer numbers: an effect that grows with a quantity is found as several that begin somewhere."""
    over = frozenset[str].intersection(*(frozenset(g.variable for g in t.gates) for t in group))
    if len(group) < 2 or not over:
        return None
    rest = [t for t in terms if t not in group]
    for score in best_nameless(library, flat, rest):
        fewer = over & score.term.mechanism.reads and numbers([score.term]) < numbers(group)
        if fewer and _nearly_all(*_left(library.mismatch, rest, [*rest, score.term], terms)):
            return score.term
    return None


def _nearly_all(none: float, left: float, whole: float) -> bool:
    """Whether what leaves the mean square `left` does nearly all that leaves `whole`, of `none` without either.

    Of a strong effect a small share is a lot: what makes a correction clearly worse stands for nothing.
    """
    return _lacks_little(none, left, whole, MISFIT) and whole > (1 - _WORSE) ** 2 * left


def _misses(
    mismatch: Mismatch,
    flat: Noise,
    terms: Sequence[Term],
    group: Sequence[Term],
    one: Term,
    squares: tuple[Float1D, Float1D, Float1D],
) -> bool:
    """Whether one of the laws of `group` has a place of its own, where `one` for all of them does not what they do.

    squares : (n,) each, A² – of what is left on unseen folds without `group`, with `one` in its place, and with `group`

    Backlash is little of all that a weight does, and nearly all that is left at reversals: a constant has no form that
    others could mend. What has no name may stand for the edges of any law.
    """
    for term, amplitudes in zip(terms, fit(mismatch, flat, terms).amplitudes, strict=True):
        alike = {term.mechanism.id, one.mechanism.id} <= _OF_TURNS
        if term not in group or term.name == "unknown" or alike:
            continue
        acts = acting(mismatch, amplitudes @ term.columns(mismatch.states))
        if not acts.any():
            continue
        none, left, whole = (float(np.mean(x[acts])) for x in squares)
        worse = one.mechanism.id in CONSTANT and whole < (1 - _WORSE) ** 2 * left
        if worse or not _lacks_little(none, left, whole, _MISSED):
            return True
    return False


def _lacks_little(none: float, left: float, whole: float, share: float) -> bool:
    """Whether what leaves the mean square `left` lacks less than a share of what `whole` takes from `none`."""
    return none - left > (1 - share) * (none - whole) > 0


def _left(mismatch: Mismatch, *models: Sequence[Term]) -> tuple[float, ...]:
    """Mean square that each of some models leaves on unseen folds, A^2."""
    return tuple(error**2 for error in plain_errors(mismatch, *models))


def _at_standstill(mismatch: Mismatch, term: Term) -> float:
    """Share of a term's power in rows in which the axis stands still."""
    power = np.sum(term.columns(mismatch.states) ** 2, axis=0) * mismatch.usable
    still = np.concatenate([~s.moving for s in mismatch.states])
    return float(np.sum(power[still]) / max(np.sum(power), 1e-300))


def _held_only(mismatch: Mismatch, term: Term, standing: Term) -> Term:
    """A friction that falls with speed so soon that nothing of it is left in motion, as what the axis holds at rest."""
    falls = term.mechanism.id == "stribeck_friction" and not term.gates
    return standing.behind(term.loop) if falls and _at_standstill(mismatch, term) > _ALL_HELD else term


def _without_limits(mismatch: Mismatch, terms: list[Term]) -> list[Term]:
    """`terms` without the limits of regions that hardly add to what the same mechanism removes everywhere."""
    for i, term in enumerate(terms):
        if not term.gates or term.name == "unknown":
            continue
        free = [*terms[:i], replace(term, gates=()), *terms[i + 1 :]]
        if _lacks_little(*_left(mismatch, without(terms, i), free, terms), share=CONFINED):
            terms = free
    return terms


def _without_places(library: Library, terms: list[Term]) -> list[Term]:
    """`terms` with Coulomb's friction and what changes along the travel for one that does both, where this varies by
    less than VARIES of its mean: the steady one is a finding by itself, and the other has to stand up beside it.
    """
    at = next((i for i, t in enumerate(terms) if t.mechanism.id == "position_dependent_friction"), None)
    coulomb = None if at is None else _coulomb(library, terms[at])
    if coulomb is None or at is None or coulomb.name in {t.name for t in terms}:
        return terms
    changing = _without_mean(library, terms[at])
    rest = [t for k, t in enumerate(terms) if k != at]
    assert library.noise is not None
    steady = with_own_limits(library, basis(library, library.noise, rest), replace(coulomb, gates=terms[at].gates))
    trial = [*terms[:at], steady, *terms[at + 1 :]]
    none, flat, whole = _left(library.mismatch, rest, trial, terms)
    if not (1 + VARIES**2) * (none - flat) > none - whole > 0:
        return terms
    return trial if changing is None else [*trial[: at + 1], changing, *trial[at + 1 :]]


def _coulomb(library: Library, like: Term) -> Term | None:
    """Coulomb's friction, at rest as another friction is there."""
    offered = next((t for t in library.terms if t.mechanism.id == "coulomb_friction"), None)
    return None if offered is None else offered.with_shape(**_rest_of(like))


def _rest_of(term: Term) -> dict[str, float]:
    """What a friction does at rest, of its shape."""
    return {"rest": 0.0} | {name: value for name, value in term.shape if name in ("rest", "v_0")}


def _without_mean(library: Library, term: Term) -> Term | None:
    """A friction along the travel without its mean over it, of a curve what is steady; None where it has none."""
    shape = dict(term.shape)
    if shape["form"] in (2, 3, 4):
        return None
    if shape["form"] >= 1:
        shape = {
            **next(s for s in term.mechanism.starts(library.mismatch.states) if s["form"] == 1),
            **_rest_of(term),
        }
    return replace(term, shape=tuple({**shape, "form": 3.0 + (shape["form"] > 0)}.items()))


def is_without_mean(term: Term) -> bool:
    """Whether it is what changes of a friction along the travel, beside the steady one."""
    return term.mechanism.id == "position_dependent_friction" and dict(term.shape)["form"] in (3, 4)


# What a drift is where it does not drift, in the order of its choice `along`; and a wear, where it does not grow.
_STEADY = (CONSTANT, ("coulomb_friction",), ("viscous_friction", "spindle_viscous_drag"))
_UNWORN = ("cutting_force", "edge_force")


def _without_drift(library: Library, terms: list[Term]) -> list[Term]:
    """`terms` with a steady load for one that drifts with the temperature or grows with wear, where nearly all that it
    removes is its mean: a first order drift is a constant with three more numbers. Friction is never quite its law; a
    constant is.
    Where that steady load is among them already, what drifts in a box and adds little only mends its form there."""
    at = next((i for i, t in enumerate(terms) if t.mechanism.id in ("thermal_drift", "tool_wear")), None)
    if at is None:
        return terms
    wears = terms[at].mechanism.id == "tool_wear"
    along = 0 if wears else round(dict(terms[at].shape)["along"])
    lacks = MISFIT if along or wears else MISFIT_PLAIN
    rest = [t for k, t in enumerate(terms) if k != at]
    taken = {t.name for t in rest}
    steady = _UNWORN if wears else _STEADY[along]
    for other in library.terms:
        if other.mechanism.id not in steady or (other.name in taken and not terms[at].gates):
            continue
        if terms[at].gates and other.mechanism.id in CONSTANT:
            other = Term(LEVEL)  # what is constant in a box only is neither a weight nor a wrong zero
        trial = [*terms[:at], replace(other, gates=terms[at].gates), *terms[at + 1 :]]
        if not _lacks_little(*_left(library.mismatch, rest, trial, terms), share=lacks):
            continue
        if all(t.gates for t in rest if t.name == other.name):
            return trial  # of a law that acts in another box, it is a second one
        without = [t for t in rest if t.name != other.name]
        if _lacks_little(*_left(library.mismatch, without, rest, terms), share=MISFIT):
            return rest
    return terms


def _without_whole_presliding(library: Library, terms: list[Term]) -> list[Term]:
    """`terms` with Coulomb's friction for a whole presliding one, where this turns over so small a way that Coulomb's,
    held at rest, does nearly all of it; and with what Coulomb's lacks of it, where that stands beside it."""
    offered = [t for t in library.terms if t.name == "coulomb_friction"]
    at = next((i for i, t in enumerate(terms) if is_whole_presliding(t) and not t.gates), None)
    if not offered or at is None:
        return terms
    before, whole, after = terms[:at], terms[at], terms[at + 1 :]
    # The equation fits sgn(v) itself.
    if library.mismatch.base_names or any(t.name == "coulomb_friction" and not t.gates for t in terms):
        # The same sum, with all of Coulomb's friction in its name.
        return [*before, whole.with_shape(full=2.0), *after]
    rest = [*before, *after]
    if _turns_over_a_way(library.mismatch, rest, whole):
        return terms
    trials = ([*before, coulomb, *after] for coulomb in offered)
    return next((t for t in trials if _nearly_all(*_left(library.mismatch, rest, t, terms))), terms)


def is_whole_presliding(term: Term) -> bool:
    """Whether it is all of a friction that turns over a way, Coulomb's included."""
    return term.mechanism.id == "presliding_hysteresis" and dict(term.shape)["full"] == 1.0


def _turns_over_a_way(mismatch: Mismatch, rest: Sequence[Term], presliding: Term) -> bool:
    """Whether a friction is presliding by its own name: it turns over a long way, and Coulomb's that a drive's loop
    answers late leaves more error; at one feed, a time is a way."""
    if dict(presliding.shape)["x_0"] <= _WAY:
        return False
    forms = ((f"held_{mismatch.axis}", "u"), (f"v_{mismatch.axis}", "sgn u"))
    late = [Term(Lagged(name, form, "–"), (("tau", tau),)) for name, form in forms for tau in _LATE_S]
    turning, *answering = plain_errors(mismatch, [*rest, presliding], *([*rest, term] for term in late))
    return min(answering) >= AS_GOOD * turning


def rivals_of(library: Library, noise: Noise, terms: Sequence[Term], which: int) -> list[Rival]:
    """Every other mechanism in the place of one term, the rest refitted; nearest first. Of a law without a name that
    is confined to a place, the mechanism that it is there comes before all."""
    rest = [t for i, t in enumerate(terms) if i != which]
    whole = basis(library, noise, terms)
    without = basis(library, noise, rest)
    gain = max(without.rss - whole.rss, 1e-9)
    taken = {t.name for t in rest} | {terms[which].name}
    boxed = within_same_limits(library, without, terms[which], taken) if terms[which].gates else []
    others = shortlist_of([*library.screen(without), *boxed], taken)
    out = []
    for k, score in enumerate(others[:8]):
        found = refine(library, without, score) if k < 4 else score
        out.append(Rival(found.term.name, found.bic - whole.bic, found.gain / gain, found.term))
    out.sort(key=lambda r: r.delta_bic)
    law = terms[which].mechanism
    if isinstance(law, Unnamed) and (name := law.without_limits(library.mismatch.axis)):
        return [Rival(name, 0.0, 1.0, terms[which]), *(r for r in out if r.name != name)]
    return out


def likelier(library: Library, noise: Noise, terms: Sequence[Term]) -> list[Term]:
    """The same terms with each that another mechanism beats in its place, now that others have gone, replaced by it."""
    out = list(terms)
    for i, term in enumerate(terms):
        if term.name in ("unknown", "external_force"):
            continue
        rest = basis(library, noise, [t for k, t in enumerate(out) if k != i])
        # The shape of the term itself was found beside others that have gone.
        own = library.score(term, rest)
        own = None if own is None else refine(library, rest, own)
        gain = 0.0 if own is None else max(0.0, basis(library, noise, out).bic - own.bic)
        rivals = [r for r in rivals_of(library, noise, out, i) if r.name != "unknown" and not _holds(r.term, term)]
        if rivals and rivals[0].delta_bic < -LIKELIER - gain and not _says_more(library, out, i, rivals[0].term):
            out[i] = rivals[0].term
        elif own is not None and gain > 0:
            out[i] = own.term
    return out


def _says_more(library: Library, terms: Sequence[Term], i: int, rival: Term) -> bool:
    """Whether a rival takes more numbers, or wears, and removes no more than any textbook form lacks beside a term."""
    wears = rival.mechanism.id == "tool_wear" and terms[i].mechanism.id in _UNWORN
    if numbers([rival]) <= numbers([terms[i]]) and not wears:
        return False
    rest = [t for k, t in enumerate(terms) if k != i]
    lacks = MISFIT_PLAIN if terms[i].mechanism.id in CONSTANT else MISFIT
    return _lacks_little(*_left(library.mismatch, rest, terms, [*rest, rival]), share=lacks)


def _holds(rival: Term, term: Term) -> bool:
    """Whether a rival is the term itself and more: a whole presliding friction holds Coulomb's."""
    return term.mechanism.id == "coulomb_friction" and dict(rival.shape).get("full") == 1.0
