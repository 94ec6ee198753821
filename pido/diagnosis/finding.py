"""What a diagnosis says: the contract `pido.diagnosis/1` as values, and nothing of how it was found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from pido.core.arrays import Float1D
from pido.core.axes import AXES

NOT_TOLD_APART = 20.0
"""Difference in BIC below which two mechanisms are equally good for the data."""
Kind = Literal["missing_physics", "miscalibrated", "data_fault", "unexplained"]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A parameter in its unit with its 95 % confidence interval."""

    value: float
    unit: str
    ci95: tuple[float, float]

    @property
    def fixed(self) -> bool:
        """Whether it was set with the form of a law and not estimated: the interval that the contract asks for has no
        width."""
        return self.ci95[0] == self.value == self.ci95[1]


@dataclass(frozen=True, slots=True)
class ByPart:
    """The factor of a wrong coefficient part by part.

    p_value : how often parts that have one and the same would differ as much
    spread : standard deviation of the factors, beyond that of measuring them
    differs : whether they do, by enough to matter
    """

    factors: Mapping[str, Estimate]
    p_value: float
    spread: float
    differs: bool


@dataclass(frozen=True, slots=True)
class Interval:
    """A stretch of one part in which a mechanism acts, s; score in 0..1."""

    part: str
    t_start: float
    t_end: float
    score: float


@dataclass(frozen=True, slots=True)
class FaultySignal:
    """A stretch of one part, s, in which a column is wrong, and why."""

    part: str
    column: str
    t_start: float
    t_end: float
    reason: str


@dataclass(frozen=True, slots=True)
class Where:
    """In words an operator understands, as conditions on columns, as intervals, bins, NC blocks and places."""

    summary: str
    conditions: tuple[str, ...] = ()
    intervals: tuple[Interval, ...] = ()
    voxels: tuple[tuple[float, float, float], ...] = ()  # centres (v_x, v_y, AR) of the bins that it fills
    nc_lines: tuple[int, ...] = ()
    workpiece: str | None = None  # where on the workpiece, if it is tied to a place
    faults: tuple[FaultySignal, ...] = ()  # of a faulty input: each stretch of each column


@dataclass(frozen=True, slots=True)
class Evidence:
    """Is it more than noise? By parts and blocks, corrected for the number of questions asked."""

    p_value: float
    q_value: float
    delta_bic: float


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Before and after; the scheme says on which data. `unseen`: on data that the fit had not seen."""

    scheme: str
    rmse_before: float
    rmse_after: float
    r2_before: float
    r2_after: float
    p_value: float

    @property
    def unseen(self) -> bool:
        return self.scheme.startswith("leave-one")

    @property
    def digits(self) -> int:
        """Fewest, from three to seven, in which the errors before and after differ: a rare effect is little of all."""
        differ = (d for d in range(3, 7) if f"{self.rmse_before:.{d}g}" != f"{self.rmse_after:.{d}g}")
        return next(differ, 7)


@dataclass(frozen=True, slots=True)
class Alternative:
    """A mechanism that explains most of what the finding does, and the recording that would tell them apart. These data
    cannot where `delta_bic` is below NOT_TOLD_APART; above, it fits them less well."""

    mechanism: str
    delta_bic: float
    to_tell_apart: str = ""


@dataclass(frozen=True, slots=True)
class Finding:
    """One mechanism on one axis."""

    axis: str
    mechanism: str
    kind: Kind
    equation: str
    parameters: Mapping[str, Estimate]
    where: Where
    evidence: Evidence
    fit: HeldOut
    replaces: tuple[str, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    factor: Estimate | None = None  # that a miscalibrated coefficient of the simulation has to be multiplied by
    by_part: ByPart | None = None  # that factor, part by part
    said: str = ""  # what it is in plain words, where that is more than its identifier says
    to_record: str = ""  # what would tell what it is, where the finding itself cannot

    @property
    def of_its_parts_only(self) -> bool:
        """Whether it is tied to times of the diagnosed parts, so that it says nothing of any other."""
        return self.mechanism == "external_force" and "T" not in self.parameters  # what comes again has a period

    @property
    def modelled(self) -> bool:
        """Whether it has a model that takes error away; rows of a faulty input are set aside instead."""
        return self.mechanism != "input_fault"


@dataclass(frozen=True, slots=True)
class Rejected:
    """What was tried on an axis and why it was not kept."""

    axis: str
    mechanism: str
    reason: str


@dataclass(frozen=True, slots=True)
class PartSeries:
    """Sample by sample of one part: (n,) each, keyed by axis."""

    time: Float1D
    mismatch: Mapping[str, Float1D]  # systematic part of recorded - simulated current, A
    score: Mapping[str, Float1D]  # 0..1: how surely the sample is inside a mismatch
    corrected: Mapping[str, Float1D]  # simulation + all findings, A


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """All that was found, what was not, and the models that `correct` applies to other parts.

    `model` is plain JSON data: everything that `pido.diagnosis.correct` needs, and nothing of the recordings.
    """

    findings: tuple[Finding, ...]
    clean_axes: tuple[str, ...]
    parts: Mapping[str, PartSeries]
    model: Mapping[str, object]
    rejected: tuple[Rejected, ...] = ()
    notes: tuple[str, ...] = field(default=())  # what could not be answered on these data, and why
    moving_s: Mapping[str, float | None] = field(default_factory=dict)  # per judged axis, of `comparable.moving_s`
    unproved: tuple[str, ...] = ()  # of the clean axes, those on which more is seen than too few seconds can prove

    @property
    def not_judged(self) -> tuple[str, ...]:
        """Axes of whose current nothing is said."""
        judged = {*self.clean_axes, *(f.axis for f in self.findings if f.modelled)}
        judged |= {axis for series in self.parts.values() for axis in series.corrected}
        return tuple(axis for axis in AXES if axis not in judged)

    def beside_others(self, finding: Finding) -> bool:
        """Whether the errors of a finding, before and after, both contain the other findings of its axis."""
        others = any(f is not finding and f.axis == finding.axis for f in self.findings)
        return others and finding.fit.unseen
