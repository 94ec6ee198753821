"""The whole method as one value and two calls: adapt to the data at hand, then balance them for the coming part.

In:  real samples, the coming part's path, the machine, a `Method`; for adapting, a way to train a model.
Out: generated rows with weights, the report, and the equations they came from.

`paper`    everything as printed: 17 terms, table 2, eq. 15 and 16, no gate
`adaptive` terms, width and reach of the weights per axis from held-out rows; a gate; and per axis the share rule that
           made a model better on held-out parts, or none at all
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from pido.core.arrays import Float2D, Int1D
from pido.core.axes import AXES
from pido.core.errors import FitError
from pido.core.machining import Machine
from pido.core.samples import Samples
from pido.equations.choose import PAPER_CHOICE, AxisEquations, Choice, candidates, choose, fit_chosen
from pido.equations.terms import TermSet
from pido.feature_space.density import relevant_bins
from pido.feature_space.grid import EQUATION_GRID, SAMPLING_GRID, Grid, touched
from pido.feature_space.regional import HeldOut, folds, interleaved
from pido.sampling.gate import OPEN, Gate
from pido.sampling.inputs import ForceModel
from pido.sampling.loss import certainty_weights, loss_weights
from pido.sampling.optimise import Report, optimise
from pido.sampling.shares import ShareRule, generous_pie, nothing

log = logging.getLogger(__name__)

Train = Callable[[Samples, Float2D], Callable[[Samples], Float2D]]
"""Samples and weights (n, 4) to a predictor of currents (n, 4): any model."""


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
    shares : rule per axis that helped on held-out parts; gain : its relative change of held-out RMSE per axis and rule
    rows : number of real samples it rests on
    """

    choice: Choice
    model_error: HeldOut | None
    shares: tuple[ShareRule, ...]
    gain: dict[str, tuple[float, ...]]
    rows: int

    def outdated(self, rows: int, growth: float = 1.5) -> bool:
        """Whether the data have grown so much that adapting again is due."""
        return rows >= growth * max(self.rows, 1)


@dataclass(frozen=True, eq=False)
class Balanced:
    """Generated rows, their weights (n, 4) beside real rows of weight omega_data, the report, the equations."""

    generated: Samples
    weights: Float2D
    report: Report
    equations: AxisEquations


def adapt(
    real: Samples,
    machine: Machine,
    method: Method,
    *,
    train: Train | None = None,
    model_error: HeldOut | None = None,
    extended: Sequence[TermSet] = (),
    rng: np.random.Generator,
) -> Adaptation:
    """Choose equations and shares from held-out rows.

    train : a quick form of the model; without it the share rule of `method` stands for all axes, unproven
    model_error : held-out errors of the model for the gate (`pido.models.axis_models.held_out_errors`)
    extended : term sets with accepted physics
    """
    if not method.adaptive:
        return Adaptation(_as_printed(extended), None, (method.share,) * 4, {}, len(real))
    choice = choose(real, machine, candidates(*extended), grid=method.equation_grid, coverage=method.grid)
    start = Adaptation(choice, model_error, (method.share,) * 4, {}, len(real))
    return start if train is None else _proven(real, machine, method, start, train, rng)


def _as_printed(extended: Sequence[TermSet]) -> Choice:
    """Table 2 for all axes; with accepted physics, the last of the extended equations in place of the 17 terms."""
    if not extended:
        return PAPER_CHOICE
    own = tuple(replace(candidate, terms=extended[-1]) for candidate in PAPER_CHOICE.near)
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
) -> Balanced:
    """Rows that balance `real` for the part that takes `path` (its currents are not looked at)."""
    if not len(real):
        raise FitError("there are no real samples yet: the method balances what has been recorded, add a part first.")
    adaptation = adaptation or Adaptation(PAPER_CHOICE, None, (method.share,) * 4, {}, len(real))
    path = replace(path, currents=np.full((len(path), 4), np.nan))
    equations = fit_chosen(
        real, _equation_bins(path, method), machine, adaptation.choice,
        grid=method.equation_grid, coverage=method.grid, blend=method.adaptive,
    )  # fmt: skip
    return _balanced(path, real, equations, method, adaptation, rng, forces)


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
    report = reports[0] if len(reports) == 1 else _joined(reports)
    return Balanced(generated, weights, report, equations)


def _equation_bins(path: Samples, method: Method) -> Int1D:
    """All bins in which a row for this path can be generated."""
    return touched(relevant_bins(path.reduced, method.grid), method.grid, method.equation_grid)


def _joined(reports: list[Report]) -> Report:
    most = {
        name: np.max([getattr(r, name) for r in reports], axis=0) for name in ("asked_pia", "asked_pie", "pia", "pie")
    }
    return replace(reports[0], refused=np.sum([r.refused for r in reports], axis=0), **most)


def _proven(
    real: Samples, machine: Machine, method: Method, start: Adaptation, train: Train, rng: np.random.Generator
) -> Adaptation:
    """Play the arrival of a part with rows at hand: leave a stretch or direction out, balance for it, see who wins."""
    rules = {"as set": method.share, "generous": replace(method.share, pie=generous_pie)}
    # parts that go where others have been, and parts (or stretches) that may not: every play costs a model per rule
    plays = [(interleaved(real), k) for k in range(3)] + [(folds(real, 3), k) for k in range(3)]
    change: dict[str, list[np.ndarray]] = {name: [] for name in rules}
    for fold, k in plays:
        out = fold == k
        if out.sum() < 20 or (~out).sum() < 20:
            continue
        rest, left = real.take(~out), real.take(out)
        path = replace(left, currents=np.full((len(left), 4), np.nan))
        bins = _equation_bins(path, method)
        equations = fit_chosen(
            rest, bins, machine, start.choice, grid=method.equation_grid, coverage=method.grid, blend=True
        )
        plain = _rmse(left, train(rest, np.full((len(rest), 4), method.omega_data))(left))
        for name, rule in rules.items():
            extra = _balanced(path, rest, equations, method, replace(start, shares=(rule,) * 4), rng)
            weights = np.vstack([np.full((len(rest), 4), method.omega_data), extra.weights])
            better = _rmse(left, train(Samples.concat([rest, extra.generated]), weights)(left))
            with np.errstate(invalid="ignore", divide="ignore"):
                change[name].append(better / plain - 1.0)
    shares, none = [], replace(method.share, pia=nothing, pie=nothing)
    table = {name: np.array(values).reshape(-1, 4) for name, values in change.items()}
    for i, axis in enumerate(AXES):
        best, rule = 0.0, none
        for name, values in table.items():
            own = values[np.isfinite(values[:, i]), i]
            if len(own) < 3:
                continue
            # what helps on the whole and hurts much in no play; doing nothing is the plainest rule
            if own.mean() < min(best, -0.01) and own.max() <= 0.05:
                best, rule = float(own.mean()), rules[name]
        shares.append(rule)
        log.info("%s: generated rows %s (%+.1f %% held-out RMSE)", axis, "none" if rule is none else "used", 100 * best)
    gain = {name: tuple(np.nan_to_num(values.mean(axis=0)).tolist()) for name, values in table.items() if len(values)}
    return replace(start, shares=tuple(shares), gain=gain)


def _rmse(samples: Samples, predicted: Float2D) -> np.ndarray:
    square = (samples.currents - predicted) ** 2
    known = np.isfinite(square)
    number = known.sum(axis=0)
    return np.where(number > 0, np.sqrt(np.where(known, square, 0.0).sum(axis=0) / np.maximum(number, 1)), np.nan)
