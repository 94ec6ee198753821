"""The whole method as one value and two calls: adapt to the data at hand, then balance them for the coming part.

In:  real samples, the coming part's path, the machine, a `Method`; for adapting, a way to train a model.
Out: generated rows with weights, the report, and the equations they came from.

`paper`'s rows fill the coming part's bins. Where a model is at hand, `adaptive` takes rows of the coming path (PiE),
and rows between recorded ones wherever these lie (PiA), as far as models gained by them on rows held out.

`paper`    everything as printed: 17 terms, table 2, eq. 15 and 16, no gate
`adaptive` terms, width and reach of the weights per axis from held-out rows; a gate; and, with a model at hand, per
           axis and region how far the equation's word is followed and how densely, from plays of an arrival, or not
           at all; and where a path is unlike all that could be played, whichever wavers less
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Literal

import numpy as np

from pido.core.arrays import Float2D, Int1D
from pido.core.axes import AXES
from pido.core.errors import FitError
from pido.core.machining import Machine
from pido.core.samples import PIA, PIE, Samples, Train
from pido.equations.choose import PAPER_CHOICE, AxisEquations, Choice, candidates, choose, fit_chosen
from pido.equations.terms import TermSet
from pido.feature_space.density import locate, occupancy, relevant_bins
from pido.feature_space.grid import EQUATION_GRID, SAMPLING_GRID, Grid, touched
from pido.feature_space.regional import HeldOut
from pido.sampling.anchored import anchored, of_path, unsaid
from pido.sampling.gate import BEYOND_DRIVE, NO_SUPPORT, NOT_RECORDED, OPEN, PASSED, WORSE_THAN_MODEL, Gate
from pido.sampling.inputs import ForceModel
from pido.sampling.loss import certainty_weights, loss_weights
from pido.sampling.optimise import Report, occupancy_of, optimise
from pido.sampling.shares import ShareRule, fill, nothing
from pido.sampling.steady import steadier
from pido.sampling.trust import LEVELS, Trust, currents, learn, taken

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Method:
    """Settings of one run, in words and numbers (`pido.config.MethodSettings` builds it)."""

    grid: Grid = SAMPLING_GRID
    equation_grid: Grid = EQUATION_GRID
    share: ShareRule = field(default_factory=ShareRule)
    gate: Gate = field(default_factory=lambda: Gate(margin=0.9))
    nuisance: Literal["planned", "joint", "paper"] = "planned"
    adaptive: bool = True
    omega_data: float = 1.0
    omega_generated: float = 1.0
    weigh_by_certainty: bool = True


PAPER_METHOD = Method(gate=OPEN, nuisance="paper", adaptive=False, weigh_by_certainty=False)


@dataclass(frozen=True, eq=False)
class Adaptation:
    """What the data decided. It holds until they have grown by a good part; keep it and hand it in again.

    choice : equation per axis; model_error : what the model is off by on held-out rows
    shares : rule per axis; rows : number of real samples it rests on
    trust : how far the equation's word is followed where; None: as `shares` and the gate say, unproven
    gain : its relative change of held-out RMSE per axis
    """

    choice: Choice
    model_error: HeldOut | None
    shares: tuple[ShareRule, ...]
    gain: dict[str, tuple[float, ...]]
    rows: int
    trust: Trust | None = None

    def outdated(self, rows: int, growth: float = 1.5) -> bool:
        """Whether the data have grown so much that adapting again is due."""
        return rows >= growth * max(self.rows, 1)


@dataclass(frozen=True, eq=False)
class Balanced:
    """Generated rows, their weights (n, 4) beside real rows of weight omega_data, the report.

    fitted : fits the equations; rows of a trusted path do without, and fits may take longer than all else
    """

    generated: Samples
    weights: Float2D
    report: Report
    fitted: Callable[[], AxisEquations]

    @cached_property
    def equations(self) -> AxisEquations:
        """Fitted when first asked for."""
        return self.fitted()


def adapt(
    real: Samples,
    machine: Machine,
    method: Method,
    *,
    train: Train | None = None,
    model_error: HeldOut | None = None,
    extended: Sequence[TermSet] = (),
    choice: Choice | None = None,
) -> Adaptation:
    """Choose equations, and how far they are trusted, from held-out rows.

    train : a quick form of the model; without it, or with a gate that does not compare with the model, the share rule
        of `method` stands for all axes, unproven
    model_error : held-out errors of the model for the gate, where there is no `train`
    extended : term sets with accepted physics
    choice : equations chosen before, or by hand; generated rows do not depend on them where there is `train`
    """
    if not method.adaptive:
        return Adaptation(_as_printed(extended), None, (method.share,) * 4, {}, len(real))
    if choice is None:
        choice = choose(real, machine, candidates(*extended), grid=method.equation_grid, coverage=method.grid)
    start = Adaptation(choice, model_error, (method.share,) * 4, {}, len(real))
    if train is None or not method.gate.compare:
        return start
    trust = learn(
        real, machine, train, extended, omega=method.omega_data, generated=method.omega_generated,
        grid=method.grid, density=method.share.density,
    )  # fmt: skip
    to_density, none = (replace(method.share, pia=nothing, pie=rule) for rule in (fill, nothing))
    shares = tuple(none if terms is None else to_density for terms in trust.terms)
    return replace(start, shares=shares, gain={"trusted": trust.gain}, trust=trust)


def _as_printed(extended: Sequence[TermSet]) -> Choice:
    """Table 2 for all axes; where physics was accepted, the last of the extended equations in place of the 17 terms."""
    own = tuple(
        replace(candidate, terms=extended[-1]) if extended and extended[-1].concerns(axis) else candidate
        for axis, candidate in zip(AXES, PAPER_CHOICE.near, strict=True)
    )
    return replace(PAPER_CHOICE, near=own, beyond=own)


def balance_for(
    path: Samples,
    real: Samples,
    machine: Machine,
    method: Method,
    adaptation: Adaptation | None = None,
    *,
    rng: np.random.Generator,
    forces: ForceModel | None = None,
    train: Train | None = None,
) -> Balanced:
    """Rows that balance `real` for the part that takes `path` (its currents are not looked at).

    train : the model, where the adaptation has learned how far the equation is trusted beside it
    """
    if not len(real):
        raise FitError("there are no real samples yet: the method balances what has been recorded, add a part first.")
    adaptation = adaptation or Adaptation(PAPER_CHOICE, None, (method.share,) * 4, {}, len(real))
    path = replace(path, currents=np.full((len(path), 4), np.nan))
    fitted = partial(
        fit_chosen, real, _equation_bins(path, method), machine, adaptation.choice,
        grid=method.equation_grid, coverage=method.grid, blend=method.adaptive,
    )  # fmt: skip
    if adaptation.trust is not None and train is not None:
        return _trusted(path, real, machine, fitted, method, adaptation.trust, train, rng)
    return _balanced(path, real, fitted(), method, adaptation, rng, forces)


def _trusted(
    path: Samples, real: Samples, machine: Machine, fitted: Callable[[], AxisEquations], method: Method, trust: Trust,
    train: Train, rng: np.random.Generator,
) -> Balanced:  # fmt: skip
    """Rows of the coming path itself (PiE), up to the target density per bin, with currents as far as the equation is
    trusted there, or all the way where it wavers far less than the model; and rows anchored in recorded ones (PiA),
    where these have helped."""
    needed = relevant_bins(path.reduced, method.grid)
    asks = taken(path, method.grid, trust.spacing, rng)
    some = np.flatnonzero(asks.any(axis=1))
    steady, its_error, own_error = steadier(path.take(some), real, machine, trust.tried, train)
    followed = np.any(np.isfinite(steady), axis=0)  # axes: their whole path goes with such rows
    asks = asks[some] & ([terms is not None for terms in trust.terms] | followed)
    ask = asks.any(axis=1)
    rows, asks, steady, its_error, own_error = (
        path.take(some[ask]), asks[ask], steady[ask], its_error[ask], own_error[ask]
    )  # fmt: skip
    follow, at = np.isfinite(steady), some[ask]
    n = len(rows)
    rows = replace(of_path(rows, method.grid), row=np.full(n, -1, np.int64), expected_error=np.zeros((n, 4)))
    beside = real.take(slice(0, 0))
    if any(trust.anchored):
        beside = replace(real, currents=np.where(trust.anchored, real.currents, np.nan))
        beside = anchored(beside, replace(path, row=np.arange(len(path))), train, method.grid, rng)
    verdict = np.full((n, 4), PASSED)
    if n:
        said, error, where, own = currents(
            rows, real, machine, trust, train, method.omega_data, beside, method.omega_generated, followed
        )
        said, error = np.where(follow, steady, said), np.where(follow, its_error, error)
        rest = followed & np.isnan(said)
        said, error = np.where(rest, own, said), np.where(rest, own_error, error)
        most = np.array([machine.current_max_a.get(axis, np.inf) for axis in AXES])
        verdict[np.isnan(said)] = WORSE_THAN_MODEL
        verdict[(where == len(LEVELS)) & ~follow & ~rest] = NO_SUPPORT
        verdict[np.abs(said) > most] = BEYOND_DRIVE
        passed = (verdict == PASSED) & asks
        rows = replace(rows, currents=np.where(passed, said, np.nan), expected_error=np.where(passed, error, np.nan))
        beside = unsaid(beside, at, rows.currents)
    beside = replace(beside, row=np.where(beside.origin == PIE, -1, beside.row))
    generated = Samples.concat([rows.take(((verdict == PASSED) & asks).any(axis=1)), beside])
    asked = np.bincount(locate(needed, rows.voxel)[1], minlength=len(needed)) if n else np.zeros_like(needed)
    refused = np.stack([((verdict == reason) & asks).sum(axis=0) for reason in range(NOT_RECORDED + 1)])
    n_real = occupancy(real.reduced, method.grid).count_in(needed)
    pia = occupancy_of(generated, PIA, needed)
    report = Report(needed, n_real, pia, asked, pia, np.zeros_like(pia), refused).counting(generated)
    log.info("%s", report.summary())
    return Balanced(generated, np.full((len(generated), 4), method.omega_generated), report, fitted)


def _balanced(
    path: Samples, real: Samples, equations: AxisEquations, method: Method, adaptation: Adaptation,
    rng: np.random.Generator, forces: ForceModel | None = None,
) -> Balanced:  # fmt: skip
    needed = relevant_bins(path.reduced, method.grid)
    made, reports = [], []
    rules = list(dict.fromkeys(adaptation.shares))
    for rule in rules:
        rows, report = optimise(
            real, needed, equations, rule, method.grid, rng=rng, gate=method.gate,
            equation_error=adaptation.choice.held_out, model_error=adaptation.model_error,
            planned=path if method.nuisance == "planned" else None, forces=forces, nuisance=method.nuisance,
        )  # fmt: skip
        foreign = [i for i in range(4) if adaptation.shares[i] != rule]
        currents = rows.currents.copy()
        currents[:, foreign] = np.nan
        keep = np.flatnonzero(np.isfinite(currents).any(axis=1))
        made.append(replace(rows, currents=currents).take(keep))
        reports.append(report)
    generated = Samples.concat(made)
    omega = loss_weights(generated.origin, method.omega_data, method.omega_generated)
    weights = np.repeat(omega[:, None], 4, axis=1)
    if method.weigh_by_certainty and adaptation.model_error is not None:
        typical = np.nan_to_num(adaptation.model_error.rmse()[1], nan=1.0, posinf=1.0)
        weights = certainty_weights(generated.origin, generated.expected_error, typical, method.omega_generated)
    report = (reports[0] if len(reports) == 1 else _joined(reports)).counting(generated)
    return Balanced(generated, weights, report, lambda: equations)


def _equation_bins(path: Samples, method: Method) -> Int1D:
    """All bins in which a row for this path can be generated."""
    return touched(relevant_bins(path.reduced, method.grid), method.grid, method.equation_grid)


def _joined(reports: list[Report]) -> Report:
    sums = {name: np.sum([getattr(r, name) for r in reports], axis=0) for name in ("asked_pia", "asked_pie", "refused")}
    return replace(reports[0], **sums)
