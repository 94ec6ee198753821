"""Simulation against recording: what is wrong, where, and what physics it is.

In:  the parts of one machine, as recordings.
Out: a `Diagnosis`: findings with proof, axes without one, the mismatch of every sample, models for other parts.
Order: faulty inputs are set aside; then what is not physics (time, clipping) in competition with what is; then, per
axis, the search of `pido.diagnosis.search`; amplitudes, intervals and proof on every row at the end.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from joblib import Parallel, cpu_count, delayed
from threadpoolctl import threadpool_limits

from pido.core.arrays import Float1D
from pido.core.columns import CURRENT, CURRENT_SIM
from pido.core.machining import Machine
from pido.core.memory import kept_memory
from pido.core.recording import Recording
from pido.diagnosis.answers import finding_of, note_of_unproved
from pido.diagnosis.bands import dead_bands
from pido.diagnosis.baseline import equation_inputs, equation_names, equation_rows, supported_terms, uneven_inputs
from pido.diagnosis.beyond import ranges, ranges_of_columns
from pido.diagnosis.comparable import comparable_axes, in_order, moving_s, without_empty, without_wild
from pido.diagnosis.confirm import (
    LESS_WHERE_WRONG,
    SIGNIFICANT,
    even,
    forces_among,
    held_out,
    less_error_there,
    plain_error,
    rms_held_out,
)
from pido.diagnosis.datafaults import Limits, at_limit, clipped, clipping_finding, input_findings, timing_finding
from pido.diagnosis.estimate import Estimated, estimate, settle_shapes
from pido.diagnosis.faults import input_faults
from pido.diagnosis.finding import Diagnosis, Estimate, Finding, HeldOut, PartSeries, Rejected
from pido.diagnosis.flexible import flexible_rest
from pido.diagnosis.identify import Answer
from pido.diagnosis.in_time import exactly, in_its_time, in_time
from pido.diagnosis.limits import on_every_row, straight_within
from pido.diagnosis.locate import score
from pido.diagnosis.loop import answered
from pido.diagnosis.misfit import acting
from pido.diagnosis.mismatch import FEW_PARTS, Mismatch, lay_out, search_stride
from pido.diagnosis.models import AxisModel, Equation, as_json, known_of
from pido.diagnosis.pair import in_its_unit, in_its_words, paired
from pido.diagnosis.rounding import Rounding, rounding_of
from pido.diagnosis.search import Look, first_look
from pido.diagnosis.seldom import in_pieces
from pido.diagnosis.shared_out import one_for_many
from pido.diagnosis.sim_rest import with_simulated_rest
from pido.diagnosis.state import AxisState, axis_states, running, worn_before
from pido.diagnosis.terms import Term, fit, without
from pido.diagnosis.timing import Delay
from pido.diagnosis.unnamed import clearly_less
from pido.diagnosis.whiten import Noise, estimate_noise, robust_sd

log = logging.getLogger(__name__)
_MAPPED_FROM = 1 << 12  # bytes of a column, which processes share rather than have each for itself
_WORTH_PROCESSES = 100_000  # rows times axes, above which each axis gets a process
Result = TypeVar("Result")
_LESS_ERROR = 0.998  # of the error on unseen folds that has to be left at most with a finding
_LESS_WHERE = 0.015  # of the error where a finding acts, that it has to take away there: a sixth of half the noise does
_CLEARLY_LESS_THERE = 0.9  # of the error where a finding acts, that may be left where it acts too seldom to tell in all
_BY_CHANCE = 0.05  # one-sided p of the paired test, above which unseen parts do not show what acts too seldom to tell
_PLAIN_IS_BETTER = 0.99  # of the error on unseen folds: below it, amplitudes are those of ordinary least squares


def _silent(done: int, of: int, what: str) -> None:
    """Progress that nobody watches."""


def diagnose(
    recordings: Sequence[Recording],
    *,
    pair: str | None = None,
    machine: Machine | None = None,
    seed: int = 0,
    on_progress: Callable[[int, int, str], None] = _silent,
) -> Diagnosis:
    """Compare, locate, name, model and prove, for all parts of one machine together.

    pair : 'RECORDED:SIMULATED', two columns to compare in place of the currents of their axis
    on_progress : called with (steps done, steps in all, what comes next)

    Raises DiagnosisError where nothing can be compared.
    """
    # Its arrays are small: threads of BLAS and trees that wait for one another cost more than they bring.
    with threadpool_limits(limits=1):
        return _diagnose(recordings, pair, machine, np.random.default_rng(seed), on_progress)


def _diagnose(
    recordings: Sequence[Recording],
    pair: str | None,
    machine: Machine | None,
    rng: np.random.Generator,
    on_progress: Callable[[int, int, str], None],
) -> Diagnosis:
    notes: list[str] = []
    parts = in_order(recordings, notes)
    parts = without_empty(parts, notes) if pair is None else paired(parts, pair)
    parts = without_wild(parts, notes)
    with in_its_words(pair):
        axes = comparable_axes(parts, machine, notes)
    if len(parts) < FEW_PARTS:
        notes.append(
            f"{len(parts)} part(s) only: proof is by contiguous blocks of the same recording, not by parts that were "
            "not fitted. Effects that differ between parts (wear, heat) cannot be judged."
        )
    findings: list[Finding] = []
    rejected: list[Rejected] = []
    models: dict[str, AxisModel] = {}
    series: dict[str, dict[str, tuple[Float1D, Float1D, Float1D]]] = {r.part.part: {} for r in parts}
    limits = {a: clipped(parts, a) for a in axes}
    count = 2 * len(axes)
    several = len(axes) * sum(len(r) for r in parts) > _WORTH_PROCESSES
    jobs = min(len(axes), cpu_count()) if several else 1
    for recording in parts:
        input_faults(recording)  # found once, and known in all processes

    def each(work: Callable[..., Result], given: Mapping[str, tuple[Any, ...]], done: int, what: str):
        """Result of `work` for every axis, each with random numbers of its own."""
        calls = {a: (*given[a], r) for a, r in zip(axes, rng.spawn(len(axes)), strict=True)}
        return _each(work, calls, jobs, lambda k, a: on_progress(done + k, count, f"{what} axis {a}"))

    looks = each(_look_at, {a: (parts, a, machine, limits[a]) for a in axes}, 0, "first look at")
    delays, answers = in_its_time(looks, limits, lambda work, given, what: each(work, given, 0, what))
    looks.clear()
    for delay in dict.fromkeys(delays.values()):
        whole = {a: _lay_out(parts, a, machine, limits[a], searching=False) for a in delay.by_axis}
        exact = exactly(delay, whole, answers)
        findings.append(timing_finding(exact, whole))
        delays |= {a: exact for a, d in delays.items() if d is delay}
    findings += input_findings(parts, axes, set(delays.values()), notes)
    proved = each(
        _prove, {a: (parts, answers[a], machine, limits[a], delays.get(a)) for a in axes}, len(axes), "proof of"
    )
    for axis, work in proved.items():
        findings += work.findings
        rejected += work.rejected
        notes += work.notes
        models[axis] = work.model
        for recording, values in zip(parts, work.series, strict=True):
            series[recording.part.part][axis] = values
    on_progress(count, count, "done")
    findings.sort(key=lambda f: -_strength(f, models))
    # A shift is one finding, on the axis that shows it best.
    found = {f.axis for f in findings} | {a for delay in delays.values() for a in delay.axes}
    bands = dead_bands(parts, machine)
    result = Diagnosis(
        findings=tuple(findings),
        clean_axes=tuple(a for a in axes if a not in found),
        parts={
            r.part.part: PartSeries(r.time, *({a: v[i] for a, v in series[r.part.part].items()} for i in range(3)))
            for r in parts
        },
        model={
            **as_json(models),
            "history": _history(parts),
            "parts": [r.part.part for r in parts],
            "orders": [r.part.order for r in parts],
            "worn": worn_before(parts),
            "dead_bands": bands,
        },
        rejected=tuple(rejected),
        notes=tuple(notes),
        moving_s={axis: moving_s(parts, axis, bands) for axis in axes},
        unproved=tuple(a for a in axes if a not in found and proved[a].unproved),
    )
    return result if pair is None else in_its_unit(result, pair)


def _each(
    work: Callable[..., Result], calls: Mapping[str, tuple[Any, ...]], jobs: int, tell: Callable[[int, str], None]
) -> dict[str, Result]:
    """What `work` makes of every axis, in so many processes."""
    made: Iterator[Any] = (_keeping_memory(work, *given) for given in calls.values())
    if jobs > 1:
        made = _in_processes(jobs, (delayed(_keeping_memory)(work, *given) for given in calls.values()))
    out: dict[str, Result] = {}
    for k, axis in enumerate(calls):
        tell(k, axis)
        out[axis] = next(made)
    return out


def _in_processes(jobs: int, calls: Iterable[Any]) -> Iterator[Any]:
    """Every step has the same options: others would start all processes anew."""
    return iter(Parallel(n_jobs=jobs, return_as="generator", max_nbytes=_MAPPED_FROM, mmap_mode="c")(calls))


def _keeping_memory(work: Callable[..., Result], *given: Any) -> Result:
    with kept_memory():
        return work(*given)


def _strength(finding: Finding, models: dict[str, AxisModel]) -> float:
    """What a finding takes away from the error, in noise of its axis; faulty inputs come before everything."""
    if not finding.modelled:
        return float("inf")
    gain = max(finding.fit.rmse_before**2 - finding.fit.rmse_after**2, 0.0)
    return gain / models[finding.axis].noise_level ** 2 + 1e-12 * finding.evidence.delta_bic


def _history(parts: Sequence[Recording]) -> list[list[float]]:
    """When the machine was running, on its own clock, s: heat is carried on from there."""
    runs = [run for r in parts if (run := running(r)) is not None]
    return [list(run) for run in runs] if len(runs) == len(parts) else []


@dataclass
class _Work:
    """What one axis came to."""

    model: AxisModel
    findings: list[Finding] = field(default_factory=list)
    rejected: list[Rejected] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    series: list[tuple[Float1D, Float1D, Float1D]] = field(default_factory=list)
    unproved: bool = False  # whether something is seen that too few seconds show


def _lay_out(
    parts: Sequence[Recording],
    axis: str,
    machine: Machine | None,
    limits: Limits,
    searching: bool,
) -> Mismatch:
    states = with_simulated_rest(axis_states(parts, axis, machine))
    simulated = CURRENT_SIM[axis] in parts[0]
    targets = [r[CURRENT[axis]] - (r[CURRENT_SIM[axis]] if simulated else 0.0) for r in parts]
    if (rounding := _rounding(parts, axis)) is not None:
        targets = [t - rounding.bias(r[CURRENT_SIM[axis]]) for r, t in zip(parts, targets, strict=True)]
    if limits:
        targets = [np.where(at_limit(r, axis, limits), np.nan, t) for r, t in zip(parts, targets, strict=True)]
    bases, names = (None, ()) if simulated else _equation(parts, states)
    rows = sum(len(r) for r in parts)
    stride = search_stride(rows, parts[0].sample_rate_hz) if searching else 1
    return lay_out(states, targets, bases, names, stride)


def _rounding(parts: Sequence[Recording], axis: str) -> Rounding | None:
    return rounding_of(parts, axis) if CURRENT_SIM[axis] in parts[0] else None


def _look_at(
    parts: Sequence[Recording], axis: str, machine: Machine | None, limits: Limits, rng: np.random.Generator
) -> Look:
    return first_look(_lay_out(parts, axis, machine, limits, searching=True), rng, clipped=bool(limits))


def _prove(
    parts: Sequence[Recording],
    answer: Answer,
    machine: Machine | None,
    limits: Limits,
    delay: Delay | None,
    rng: np.random.Generator,
) -> _Work:
    full = _lay_out(parts, answer.axis, machine, limits, searching=False)
    work = _settle(full if delay is None else in_time(full, delay), parts, answer, rng, delay, limits)
    if (rounding := _rounding(parts, answer.axis)) is not None:
        work.notes.append(rounding.note(answer.axis))
    if limits:
        limit = clipping_finding(parts, answer.axis, limits, work.model.noise_level)
        work.findings += [limit] if limit.evidence.p_value < SIGNIFICANT else []
    return work


def _settle(
    full: Mismatch,
    parts: Sequence[Recording],
    answer: Answer,
    rng: np.random.Generator,
    delay: Delay | None,
    limits: Limits,
) -> _Work:
    """The final fit on every row, its proof, and the series of every part."""
    recorded = full.target + (full.sim if full.sim is not None and not full.base_names else 0.0)
    rest = flexible_rest(full, fit(full, even(full), answer.terms).residual)
    noise = estimate_noise(rest, full.starts, full.noise_class, full.usable)
    terms, noises = settled(full, noise, answer.terms)
    terms = answered(full, noises[0], terms)
    if search_stride(full.n, parts[0].sample_rate_hz) > 1:
        terms = straight_within(full, noises[0], on_every_row(full, noises[0], terms))
    terms = [t.with_shape(**t.mechanism.from_the_middle(dict(t.shape), full.states)) for t in terms]
    offered = [*answer.unproved, *terms]
    whole = full
    if terms and answer.few_seconds:
        full = in_pieces(full, noises[0], terms) or full
    terms, proofs, found = proved(full, noises, terms, answer, recorded, rng)
    # The equation by itself is ordinary least squares: that is how it would be used as a simulation.
    alone = fit(full, even(full), [])
    level = robust_sd(found.fit.residual[full.usable])
    equation = None
    if full.base_names:
        seen = ranges_of_columns(parts, equation_inputs(full.base_names), full.usable)
        equation = Equation(full.base_names, alone.base, found.fit.base, seen)
    model = AxisModel(
        full.axis,
        level,
        tuple(terms),
        found.fit.amplitudes,
        equation,
        limits=dict(limits),
        largest=tuple(
            float(np.max(np.abs(a @ t.columns(full.states)), initial=0.0))
            for t, a in zip(terms, found.fit.amplitudes, strict=True)
        ),
        known=known_of(full.states),
        seen=tuple(ranges(t, full.states, full.usable) for t in terms),
        **({} if delay is None or full.base_names else delay.in_a_model(full.parts)),
    )
    findings = []
    for i, term in enumerate(terms):
        effect = found.fit.amplitudes[i] @ term.columns(full.states)
        swallowed = _replaced(full, alone.base, fit(full, noises[0], [term]).base)
        findings.append(
            finding_of(whole, answer, i, found.parameters[i], effect, level, proofs[i], swallowed, noises[0])
        )
    findings, note = one_for_many(full, noises[0], terms, found.fit.amplitudes, findings, recorded, level)
    unproved = None if findings else note_of_unproved(whole, noises[0], offered)
    answer.notes += [n for n in (note, unproved) if n is not None]
    answer.notes += uneven_inputs(parts, full.axis) if full.base_names else []
    series = []
    for recording, state in zip(parts, full.states, strict=True):
        simulated = model.simulated(recording, state)
        effect = model.effect(simulated, recording, state)
        series.append((effect, score(effect, level), simulated + effect))
    return _Work(model, findings, answer.rejected, answer.notes, series, unproved is not None)


def settled(full: Mismatch, quick: Noise, terms: Sequence[Term]) -> tuple[list[Term], tuple[Noise, Noise]]:
    """`terms` with their shapes settled on every row; the weights that they are settled under, and the other ones.

    Where the terms lack something that is slow, weights that listen to what is `quick` fit them to the wrong part:
    their sizes, or already their shapes.
    """
    slow = even(full)
    shaped = settle_shapes(full, quick, terms)
    error = _PLAIN_IS_BETTER * rms_held_out(full, quick, shaped)
    start = next((t for t in (shaped, terms) if plain_error(full, t) < error), None)
    return (shaped, (quick, slow)) if start is None else (settle_shapes(full, slow, start), (slow, quick))


def proved(
    full: Mismatch,
    noises: tuple[Noise, Noise],
    terms: Sequence[Term],
    answer: Answer,
    recorded: Float1D,
    rng: np.random.Generator,
) -> tuple[list[Term], list[HeldOut], Estimated]:
    """The terms that make the error on unseen folds smaller, in A and not only in units of noise, and whose size is
    known to differ from zero; the proof, and what was estimated.
    """
    noise, other = noises
    kept = list(terms)
    while True:
        proofs = [held_out(full, noise, kept, without(kept, i), recorded) for i in range(len(kept))]
        amplitudes = fit(full, noise, kept).amplitudes
        acts = [acting(full, a @ t.columns(full.states)) for t, a in zip(kept, amplitudes, strict=True)]
        lesser = [LESS_WHERE_WRONG if t.name.startswith("miscalibrated:") else _LESS_WHERE for t in kept]
        least = [min(_LESS_ERROR, 1 - less * float(np.mean(rows))) for less, rows in zip(lesser, acts, strict=True)]
        seldom = [i for i, p in enumerate(proofs) if not p.rmse_after < least[i] * p.rmse_before]
        idle = [
            i for i in seldom if less_error_there(full, noise, kept, without(kept, i), acts[i]) > _CLEARLY_LESS_THERE
        ]
        reason = "the error on unseen parts is hardly smaller with it"
        if not idle:
            # What acts too seldom to tell in all has to be there more than once. A force over one interval never is.
            idle = [i for i in seldom if proofs[i].p_value > _BY_CHANCE and not forces_among([kept[i]])]
            reason = f"a paired test does not show it on unseen parts (p > {_BY_CHANCE:g})"
        if not idle:
            idle = _rests(full, kept)
            reason = "it has no name, and is no more than what the form of a named law may lack"
        if not idle:
            found = estimate(full, noise, kept, rng, other)
            idle = [i for i, t in enumerate(kept) if _may_be_nothing(t, found.parameters[i])]
            reason = "the 95 % interval of its size holds zero"
            if not idle:
                answer.terms = kept
                return kept, proofs, found
        i = max(idle, key=lambda k: proofs[k].rmse_after - proofs[k].rmse_before)
        answer.rejected.append(Rejected(full.axis, kept[i].name, reason))
        kept = settle_shapes(full, noise, without(kept, i))  # beside it they were others
        for each in (answer.p_values, answer.q_values, answer.delta_bic, answer.rivals):
            del each[i]


def _rests(full: Mismatch, kept: Sequence[Term]) -> list[int]:
    """Places of terms without a name that, now that all shapes are settled, take away hardly anything beside laws
    with one."""
    if all(t.name == "unknown" for t in kept):
        return []
    unnamed = [i for i, t in enumerate(kept) if t.name == "unknown"]
    return [i for i in unnamed if not clearly_less(full, kept, without(kept, i))]


def _may_be_nothing(term: Term, parameters: Mapping[str, Estimate]) -> bool:
    """Whether a law of one size and no free shape could as well have the other sign. Several sizes are judged together,
    a curve without a name by what it removes; and beside a shape that is hardly known the size is not known either.
    """
    if term.name == "unknown" or any(not p.is_choice for p in term.mechanism.shape):
        return False
    sizes = [p for a in term.mechanism.amplitudes if (p := parameters.get(a.name)) is not None]
    return len(sizes) == 1 and sizes[0].ci95[0] < 0.0 < sizes[0].ci95[1]


def _replaced(full: Mismatch, alone: Float1D, joint: Float1D) -> tuple[str, ...]:
    """Terms of the equation that lose most of their size, or turn round, once a finding is in."""
    size = np.sqrt(np.mean(full.base**2, axis=1)) if len(full.base) else np.zeros(0)
    loud = np.abs(alone) * size > 0.1 * np.max(np.abs(alone) * size, initial=0.0)
    lost = (np.abs(joint) < 0.3 * np.abs(alone)) | (joint * alone < 0)
    return tuple(n for n, is_lost, is_loud in zip(full.base_names, lost, loud, strict=True) if is_lost and is_loud)


def _equation(parts: Sequence[Recording], states: Sequence[AxisState]):
    rows = [equation_rows(r, s) for r, s in zip(parts, states, strict=True)]
    moving = [
        {s.axis: np.asarray(s.moving, float), **{n: np.asarray(o.moving, float) for n, o in s.others.items()}}
        for s in states
    ]
    keep = supported_terms(rows, moving)
    return [r[keep] for r in rows], tuple(equation_names()[k] for k in keep)
