"""From terms that hold to findings that people and programs read.

In:  the joint model of one axis on every row, its tests, and what each term could be mistaken for.
Out: `Finding` values in the words and units of the contract.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pido.core.arrays import Float1D, Int1D
from pido.diagnosis.by_part import by_part
from pido.diagnosis.events import ExternalForce, Rhythm
from pido.diagnosis.finding import (
    NOT_TOLD_APART,
    Alternative,
    Estimate,
    Evidence,
    Finding,
    HeldOut,
    Interval,
    Kind,
    Where,
)
from pido.diagnosis.gates import gate_variable, inside
from pido.diagnosis.identify import Answer, Rival
from pido.diagnosis.locate import (
    active,
    intervals,
    lasting,
    nc_lines,
    rhythm,
    score,
    strongest_stretch,
    voxels,
    workpiece_area,
)
from pido.diagnosis.mechanisms.advice import recording_that_names, recording_that_tells
from pido.diagnosis.mechanisms.base import Told
from pido.diagnosis.mismatch import Mismatch
from pido.diagnosis.quantities import in_words as said_of
from pido.diagnosis.quantities import meanings
from pido.diagnosis.seldom import blocks_of
from pido.diagnosis.state import AxisState, coolant_recorded
from pido.diagnosis.switches import gate_words
from pido.diagnosis.terms import Component, Term, fit
from pido.diagnosis.units import units
from pido.diagnosis.unknowns import recording_of_unknown
from pido.diagnosis.whiten import Noise

_MOST_ALTERNATIVES = 4
_SEEN = 60.0  # BIC of a law by itself, from which on it is told though too little of the recordings proves it
_ALIKE = 0.9  # of the power of what is missing of a law, that the simulation's own form of it has


def kind_of(term: Term) -> Kind:
    """What the contract calls this sort of finding."""
    if term.name.startswith("miscalibrated:"):
        return "miscalibrated"
    return term.mechanism.kind


def finding_of(
    mismatch: Mismatch,
    answer: Answer,
    which: int,
    parameters: dict[str, Estimate],
    effect: Float1D,
    noise_level: float,
    held_out: HeldOut,
    replaces: tuple[str, ...],
    noise: Noise,
) -> Finding:
    """One term of one axis as a finding.

    effect : (n,), A on every row of `mismatch`; noise : that the term was fitted under
    """
    term = answer.terms[which]
    known = units(term.mechanism, dict(term.shape), mismatch.axis)
    idle = term.mechanism.idle(dict(term.shape))
    told = words(term, mismatch.states, {n: e.value for n, e in parameters.items()})
    every = None
    if isinstance(term.mechanism, ExternalForce):
        every = rhythm(intervals_of(mismatch.states, effect, mismatch.edges, noise_level))
    where = where_of(mismatch.states, term, effect, mismatch.edges, noise_level, told)
    factor, parts = factor_of(mismatch, term, answer.simulated.get(term.name), effect, parameters), None
    if factor is not None:
        amplitude = parameters[term.mechanism.amplitudes[0].name].value
        parts = by_part(mismatch, noise, answer.terms, which, amplitude, factor.value)
    if parts is not None and parts.differs:
        least, most = (end(e.value for e in parts.factors.values()) for end in (min, max))
        where = replace(
            where, summary=f"{where.summary}; its factor differs from part to part, from {least:.3g} to {most:.3g}"
        )
    again = ""
    if answer.few_seconds and (few := blocks_of(mismatch, effect)) is not None:
        part, start, end = _seconds_of(mismatch, few)
        seconds = f"part {part} from {start:.4g} to {end:.4g} s"
        where = replace(where, summary=f"{where.summary}; shown by a few seconds alone, most of them in {seconds}")
        again = f"the motion of {seconds} again, in further parts: this law is shown by these few seconds alone"
    return Finding(
        axis=mismatch.axis,
        mechanism=term.name,
        kind=kind_of(term),
        equation=equation_text(term, mismatch.axis),
        parameters={n: replace(e, unit=known.get(n, e.unit)) for n, e in parameters.items() if n not in idle},
        where=where,
        evidence=Evidence(answer.p_values[which], answer.q_values[which], answer.delta_bic[which]),
        fit=held_out,
        replaces=replaces,
        alternatives=alternatives_of(term, answer.rivals[which]),
        factor=factor,
        by_part=parts,
        said=told.name,
        to_record=again or told.to_record or to_record(term, every, coolant_recorded(mismatch.states), mismatch.states),
    )


def note_of_unproved(mismatch: Mismatch, noise: Noise, terms: Sequence[Term]) -> str | None:
    """What is said of an axis on which nothing stands, of the law that would explain most; None where none is likely.

    An effect of a few seconds is seen, and could be any law that these seconds have in common, or an event.
    """
    alone = {t: fit(mismatch, noise, [t]) for t in terms}
    best = min(alone, key=lambda t: alone[t].bic, default=None)
    if best is None or fit(mismatch, noise, []).bic - alone[best].bic < _SEEN:
        return None
    effect = alone[best].amplitudes[0] @ best.columns(mismatch.states)
    few = blocks_of(mismatch, effect)
    if few is None:
        return None  # it was seen often enough to be proved, had it been a law
    part, start, end = _seconds_of(mismatch, few[:1])
    law = "a law without a name" if best.name == "unknown" else best.mechanism.id
    return (
        f"axis {mismatch.axis}: something is there that is more than noise, nearly all of it in {len(few)} of "
        f"{mismatch.block[-1] + 1} stretches, most in part {part} from {start:.4g} to {end:.4g} s. It could be {law} "
        f"({words(best, mismatch.states).summary}), and so little does not prove that it is. Record that motion again, "
        "in further parts."
    )


def _seconds_of(mismatch: Mismatch, blocks: Int1D) -> tuple[str, float, float]:
    """Part, first and last second of some blocks, the strongest first, in the part that this one is of."""
    part = mismatch.part[np.flatnonzero(mismatch.block == blocks[0])[0]]
    rows = np.flatnonzero(np.isin(mismatch.block, blocks) & (mismatch.part == part)) - mismatch.edges[part]
    time = mismatch.states[part].time
    return mismatch.states[part].part, float(time[rows[0]]), float(time[rows[-1]])


def to_record(term: Term, every: float | None, coolant: bool = False, states: Sequence[AxisState] = ()) -> str:
    """What would tell what a term is that is tied to times alone, or that has no name; '' for any other.

    every : s, after which it comes again; None where it has no rhythm; coolant : whether it is recorded when it is on
    states : of the diagnosed parts, by which a law without a name is told what they leave open
    """
    if isinstance(term.mechanism, Rhythm):
        return recording_that_names(dict(term.shape)["T"], coolant)
    if isinstance(term.mechanism, ExternalForce):
        return recording_that_names(every, coolant)
    return recording_of_unknown(term, states) if term.name == "unknown" and states else ""


def factor_of(
    mismatch: Mismatch,
    term: Term,
    simulated: Component | None,
    effect: Float1D,
    parameters: dict[str, Estimate],
) -> Estimate | None:
    """What the simulation's own coefficient of a term has to be multiplied by, with its 95 % interval.

    simulated : the term in the simulated current. effect : (n,), A – what is missing of it. None where it has several
    coefficients, acts in a box, or what is missing has not the form of what is there.
    The interval is that of a ratio: of what is missing, and of the simulation's own coefficient, which is read from its
    current (Gauss's propagation of errors).
    """
    if simulated is None or term.gates or len(term.mechanism.amplitudes) != 1:
        return None
    own, amplitudes = simulated.term.behind(term.loop), simulated.amplitudes
    there, missing = ((amplitudes @ own.columns(mismatch.states))[mismatch.usable], effect[mismatch.usable])
    power = float(there @ there)
    share = float(missing @ there) / power if power > 0 else 0.0
    if share**2 * power < _ALIKE * float(missing @ missing):
        return None
    size = parameters[term.mechanism.amplitudes[0].name]
    low, high = sorted(share * (end / size.value - 1) for end in size.ci95)
    of_its_own = 1.96 * share * float(simulated.unsure[0] / amplitudes[0])
    return Estimate(1 + share, "–", (1 + share - np.hypot(low, of_its_own), 1 + share + np.hypot(high, of_its_own)))


_ORDERS = {1: "first order", 2: "two equal lags", 3: "three equal lags"}


def equation_text(term: Term, axis: str) -> str:
    """The mechanism's equation in the form of the term, with the axis' name put in, and its region."""
    text = term.mechanism.equation_in(axis, dict(term.shape))
    text = re.sub(r"\bdI\b(?!_)", f"dI_{axis}", text)
    text = re.sub(r"_i\b", f"_{axis}", text)
    text = re.sub(r"(?<![\w|])(v|a|pos)(?![\w_(])", rf"\1_{axis}", text)
    text = re.sub(r"\|(v|a)\|", rf"|\1_{axis}|", text)
    if term.name == "unknown":
        text = "; ".join([text, *meanings(text)])
    if term.loop:
        text += f"; answered late by the drive, {_ORDERS[term.loop.lags]}, {term.lag:.2g} s"
    if term.gates:
        text += ", only where " + " and ".join(g.condition for g in term.gates)
    return text


def where_of(
    states: Sequence[AxisState],
    term: Term,
    effect: Float1D,
    edges: Int1D,
    noise_level: float,
    told: Told | None = None,
) -> Where:
    """Intervals per part, bins of M, NC blocks and the place on the workpiece where a term acts.

    told : `words` of the term, with its sizes where they are known
    """
    act = active(effect, noise_level)
    found = intervals_of(states, effect, edges, noise_level)
    summary, conditions = (words(term, states) if told is None else told)[:2]
    along = term.mechanism.id == "position_dependent_friction" and not any("pos_" in c for c in conditions)
    if along and (stretch := strongest_stretch(states, effect)) is not None:
        summary += f"; most of it from {stretch[0]:.4g} to {stretch[1]:.4g} mm"
    if isinstance(term.mechanism, ExternalForce):
        every = rhythm(found)
        summary += f"{'' if every is None else f'; it comes again every {every:.3g} s'}; it predicts no other part"
        found = _of_each_force(term.mechanism, states, effect, edges, noise_level)
    acts = [act[int(i) : int(j)] for i, j in itertools.pairwise(edges)]
    plane = [_plane(s) for s in states]
    return Where(
        summary=summary,
        conditions=conditions,
        intervals=tuple(found),
        voxels=voxels(states, acts, plane),
        nc_lines=nc_lines(states, acts),
        workpiece=workpiece_area(states, acts) if _tied_to_a_place(term) else None,
    )


def intervals_of(states: Sequence[AxisState], effect: Float1D, edges: Int1D, noise_level: float) -> list[Interval]:
    """Stretches of every part in which an effect (n,), A, is a noticeable part of its usual size."""
    act, scores = active(effect, noise_level), score(effect, noise_level)
    found = []
    for state, (i, j) in zip(states, itertools.pairwise(map(int, edges)), strict=True):
        found += intervals(state.part, state.time, act[i:j], scores[i:j])
    return found


def _of_each_force(
    force: ExternalForce, states: Sequence[AxisState], effect: Float1D, edges: Int1D, noise_level: float
) -> list[Interval]:
    """The interval of each force, in the order of the forces: what is read beside an interval is its own size."""
    scores, found = score(effect, noise_level), []
    place = {s.part: (s.time, int(i)) for s, i in zip(states, edges[:-1], strict=True)}
    for part, start, end in force.intervals:
        time, first = place[part]
        i, j = np.searchsorted(time, (start, end))
        last = float(time[max(int(j) - 1, int(i))])
        found.append(Interval(part, *lasting(time, start, last), float(np.mean(scores[first + i : first + j]))))
    return found


def _tied_to_a_place(term: Term) -> bool:
    """Whether where on the workpiece a term acts is part of what it says, not of where the parts went."""
    places = re.compile(r"(pos|from)_[xyz]")
    return term.mechanism.id == "material_hard_zone" or any(map(places.fullmatch, term.mechanism.reads))


def words(term: Term, states: Sequence[AxisState], sizes: Mapping[str, float] | None = None) -> Told:
    """The operator's words of the mechanism, confined to the term's region. sizes : its amplitudes by name"""
    rows = [inside(s, term.gates) > 0 for s in states]
    told = term.mechanism.told_in(states, rows, dict(term.shape), sizes or {})
    regions = " and ".join(gate_words(g, states) for g in term.gates).replace(" and only where ", " and ")
    plain = said_of(told.summary, term.mechanism.reads)
    summary = f"{plain}, {regions}" if regions else plain
    conditions = (*told.conditions, *(g.condition for g in term.gates))
    return told._replace(summary=in_words(summary), conditions=conditions)


def in_words(summary: str) -> str:
    """What an operator reads: axis sp is the spindle.

    >>> in_words("while the sp axis speeds up")
    'while the spindle speeds up'
    """
    return summary.replace("sp axis", "spindle")


def alternatives_of(term: Term, rivals: Sequence[Rival]) -> tuple[Alternative, ...]:
    """Mechanisms that do as well in this term's place, or explain most of the same, with the recording that would tell.

    Last those that say the finding's own law in more words: they are no other explanation.
    """
    near = [r for r in rivals if r.delta_bic < NOT_TOLD_APART or r.share > 0.75]
    near.sort(key=lambda r: term.mechanism.id in r.term.mechanism.becomes)
    return tuple(
        Alternative(r.name, float(r.delta_bic), recording_that_tells(term.mechanism.id, r.name))
        for r in near[:_MOST_ALTERNATIVES]
    )


def _plane(state: AxisState) -> tuple[Float1D, Float1D] | None:
    v_x, v_y = gate_variable(state, "v_x"), gate_variable(state, "v_y")
    return None if v_x is None or v_y is None else (np.asarray(v_x, float), np.asarray(v_y, float))
