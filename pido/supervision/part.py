"""A part judged: the champion's prediction, the band, a verdict, and alarms in words.

In:  a workspace, and a part: a stored one by name or digest, or a recording's path, which is only looked at.
Out: `Judgement`; `keep` writes it into the machine's book.

A part that the champion was trained on would be judged by what the model remembers of it. It is judged by what was said
of it before it came, and the notes say so.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pido import production
from pido.core.arrays import Float1D, Int1D
from pido.core.axes import AXES
from pido.core.columns import INPUTS
from pido.core.errors import RegistryError, StoreError
from pido.core.recording import Recording
from pido.core.samples import Samples
from pido.models.axis_models import AxisModels
from pido.models.inputs import model_inputs
from pido.monitoring.alarms import LEAST_JUDGED, Alarm, Verdict, judge
from pido.monitoring.answers import to_calibrate_on
from pido.monitoring.band import Band, learn
from pido.monitoring.likeness import looks_like
from pido.monitoring.residuals import LEAST_THERE, PartResiduals
from pido.parts import at_rate, look_at, lost_of, machine_of, samples_of
from pido.store import Store
from pido.supervision.book import Book, alarm_id
from pido.supervision.residuals import Said, held_out, known_residuals, on_the_clock, support
from pido.tracking import bundle, promotion
from pido.tracking.bundle import Bundle
from pido.workspace import Workspace

log = logging.getLogger(__name__)
NOT_JUDGED = "not judged"
"""The third verdict, beside `alarms` and `good`."""
AROUND_S = 3.0
"""Before and after an alarm, what the residual is compared with signals over: a constant then shows as a step."""


@dataclass(frozen=True, slots=True)
class NamedAlarm:
    """An alarm with its identifier, the mechanism that it looks like at first sight, and what was said of it so far."""

    id: str
    alarm: Alarm
    looks_like: str
    answered: str = ""


@dataclass(frozen=True, eq=False)
class Judgement:
    """model : which version said what was expected; notes : what was assumed or could not be done."""

    part: str
    digest: str
    machine: str
    model: str
    verdict: Verdict
    alarms: tuple[NamedAlarm, ...]
    band: Band
    residuals: PartResiduals
    notes: tuple[str, ...]

    def record(self) -> dict[str, Any]:
        """As plain values, for the book and for `--json`."""
        said = recorded(self.verdict, self.band, self.alarms, self.notes)
        return {"part": self.part, "digest": self.digest, "machine": self.machine, "model": self.model, **said}


def recorded(verdict: Verdict, band: Band, alarms: Sequence[NamedAlarm], notes: Sequence[str]) -> dict[str, Any]:
    """A verdict as plain values."""
    return {
        "good": verdict.good,
        "verdict": outcome(verdict),
        "judged": round(verdict.judged, 4),
        "too_wide": round(verdict.too_wide, 4),
        "blind": list(verdict.blind),
        "familiar": verdict.familiar,
        "unwatched": list(verdict.unwatched),
        "band": {
            "parts": band.parts,
            "threshold": {axis: round(of.threshold, 4) for axis, of in band.axes.items()},
            "draws": {axis: round(of.draws, 4) for axis, of in band.axes.items()},
            "tolerate": band.tolerate,
            "window_s": band.window_s,
        },
        "alarms": [named(a) for a in alarms],
        "notes": list(notes),
    }


def outcome(verdict: Verdict) -> str:
    """`alarms`, `good`, or NOT_JUDGED: without an alarm, where too little was judged for silence to say something."""
    return "alarms" if verdict.alarms else "good" if verdict.good else NOT_JUDGED


def headline(record: Mapping[str, Any]) -> str:
    """A verdict's record in a few words.

    >>> headline({"alarms": [], "good": False, "judged": 0.19})
    'not judged: only 19% of it could be'
    >>> headline({"alarms": [], "good": True, "judged": 0.75, "blind": ["x"]})
    'nothing unusual on the other axes; not judged: x'
    """
    only = f"only {record['judged']:.0%} of it could be"
    blind = ", ".join(record.get("blind", ()))
    if record["alarms"]:
        few = f"; {only} judged" if record["judged"] < LEAST_JUDGED else ""
        return f"{len(record['alarms'])} alarm(s){few}{f'; {NOT_JUDGED}: {blind}' if blind else ''}"
    if record["good"]:
        return f"nothing unusual on the other axes; {NOT_JUDGED}: {blind}" if blind else "nothing unusual"
    wide = f"; the band is too wide on {blind}" if blind else ""
    return f"{NOT_JUDGED}{f': {only}' if record['judged'] else ''}{wide}"


def not_judged(verdict: Verdict, band: Band) -> str:
    """Why the part, or some of it, could not be judged; empty where all of it was."""
    if len(verdict.unwatched) == len(AXES):
        return "no axis has both a recorded current and a band"
    if not verdict.windows:
        return f"no stretch with the tool in engagement lasts {band.window_s:g} s, the shortest that is judged"
    why = []
    if verdict.lost > 0.005:
        why.append(f"for {verdict.lost:.0%} of the part the recording lacks too many values: not judged there")
    if verdict.unlike > 0.005:
        why.append(f"{verdict.unlike:.0%} of the part is unlike anything that the model was tried on: not judged there")
    if verdict.too_wide > 0.005:
        axes = f", above all {', '.join(verdict.blind)}" if verdict.blind else ""
        why.append(
            f"for {verdict.too_wide:.0%} of the part{axes}, the band from {band.parts} part(s) reaches as far as all "
            "that the axis draws, so a current twice as large could pass: not judged there until more good parts are "
            "taken in"
        )
    return "; ".join(why)


def missing(verdict: Verdict) -> str:
    """Which values the recording lacks; empty where none. Where a whole axis was not recorded, it is unwatched."""
    if not verdict.lacking:
        return ""
    shares = ", ".join(f"{axis} {share:.1%}" for axis, share in verdict.lacking.items())
    return (
        f"values are missing where the tool is engaged ({shares}) and are never filled in: a window is judged by the "
        f"rest of it where at least {LEAST_THERE:.0%} is there. Look for a loose sensor or a channel that drops out."
    )


def doubts(verdict: Verdict, band: Band) -> list[str]:
    """Which values the recording lacks, and what could not be judged: the notes of a verdict."""
    return [words for words in (missing(verdict), not_judged(verdict, band)) if words]


def named(one: NamedAlarm) -> dict[str, Any]:
    """An alarm as plain values; what was said of it is in the book already."""
    a = one.alarm
    return {
        "id": one.id, "part": a.part, "axis": a.axis, "t_start": round(a.t_start, 3), "t_end": round(a.t_end, 3),
        "tool": a.tool, "block": a.block, "size_a": round(a.size_a, 4), "spreads": round(a.spreads, 2),
        "looks_like": one.looks_like,
    }  # fmt: skip


def monitor(workspace: Workspace, part: str, *, machine: str | None = None, tolerate: float = 1.0) -> Judgement:
    """Judge one part.

    part : path of a recording, or name or digest of a stored part
    tolerate : false alarms per 100 good parts, all axes together
    Raises RegistryError while the machine has no model, StoreError for a part that is nowhere, FitError without any
    residual to learn a band from; what `ingest` raises for a recording that cannot be used.
    """
    recording, samples, lost, digest = _find(workspace, part, machine)
    machine = recording.part.machine
    expect = Expectation.of(workspace, machine)
    notes = list(expect.notes)
    if digest in Store(workspace.store).today(expect.bundle.content["parts"]).values():
        earlier = held_out(workspace, machine, digest, expect.models.inputs)
        if earlier is None:
            raise StoreError(
                f"part {recording.part.part}: {expect.model} was trained on it, and what was expected of it before is "
                "gone. Judge a part that is not among the training parts, or run `pido iterate` on it again."
            )
        residuals = earlier
        rows = _rows_on(residuals, recording, samples)
        notes.append("the model has learnt from this part since; it is judged by what was expected before it came")
    else:
        inputs = model_inputs(samples, expect.models.inputs)
        doubt = expect.distance(inputs)
        said = Said.by(expect.models, inputs, machine_of(workspace, machine))
        residuals, rows = on_the_clock(digest, recording, samples, inputs, said, doubt, lost)
    band = expect.band(tolerate, without=digest)
    verdict = judge(residuals, band)
    signals = {name: samples.inputs[:, i] for i, name in enumerate(INPUTS)}
    if "coolant" in recording:
        signals["coolant"] = np.asarray(recording["coolant"], float)[samples.row]
    answered = Book(workspace, machine).answered()
    alarms = tuple(
        NamedAlarm(name, a, _likeness(a, residuals, rows, signals), answered.get(name, ""))
        for a in verdict.alarms
        for name in [alarm_id(machine, digest, a)]
    )
    notes += doubts(verdict, band)
    return Judgement(recording.part.part, digest, machine, expect.model, verdict, alarms, band, residuals, tuple(notes))


def keep(workspace: Workspace, judgement: Judgement) -> None:
    """Write the verdict and its alarms into the machine's book."""
    Book(workspace, judgement.machine).verdict(judgement.record())


@dataclass(frozen=True, eq=False)
class Expectation:
    """What a machine's model expects: champion, or the newest challenger while nothing was ever approved."""

    workspace: Workspace
    machine: str
    bundle: Bundle
    models: AxisModels
    model: str
    notes: tuple[str, ...]

    @classmethod
    def of(cls, workspace: Workspace, machine: str) -> Expectation:
        """Raises RegistryError while the machine has no model at all."""
        in_force = promotion.champion(workspace, machine)
        found = promotion.champion_bundle(workspace, machine)
        if in_force is not None and found is not None:
            return cls(
                workspace, machine, found, production.models_in(found), f"champion version {in_force.version}", ()
            )
        version = promotion.current(workspace, machine)
        if version is None:
            raise RegistryError(
                f"{workspace.root}: machine '{machine}' has no model yet. `pido iterate PART` makes the first one."
            )
        found = bundle.verify(bundle.load(workspace.bundles, version.bundle))
        note = "no version was approved yet: the newest challenger says what is expected"
        return cls(
            workspace,
            machine,
            found,
            production.models_in(found),
            f"challenger version {version.version}",
            (note,),
        )

    def distance(self, inputs: np.ndarray) -> Float1D:
        """(n,): how far model inputs lie from the rows that this model was trained on."""
        return support(self.workspace, self.bundle.content["parts"], self.models.inputs).distance(inputs)

    def band(self, tolerate: float, without: str = "") -> Band:
        """From the held-out residuals that this model has on the machine's other parts, with what people said of their
        alarms; without parts that could not be judged, unless there are no others."""
        book = Book(self.workspace, self.machine)
        known = known_residuals(self.workspace, self.machine, self.bundle, self.models, without)
        unjudged = book.unjudged()
        judged = [part for part in known if part.part not in unjudged]
        if known and not judged:
            log.warning("%s: no part could be judged; the band is learnt from those that could not", self.machine)
        return learn(to_calibrate_on(judged or known, book.open_alarms(), book.answers()), tolerate)


def _find(workspace: Workspace, part: str, machine: str | None) -> tuple[Recording, Samples, Int1D, str]:
    """Recording at the method's rate, its rows, what was lost (`pido.parts.lost_of`), its digest."""
    store = Store(workspace.store)
    known = [e for e in store.entries(machine) if part == e.part or (len(part) >= 8 and e.digest.startswith(part))]
    if len(known) > 1:
        raise StoreError(f"'{part}' is a part of {', '.join(e.machine for e in known)}: name one with --machine.")
    if known:
        recording = at_rate(workspace, store.load(known[0].digest))
        digest = known[0].digest
        return recording, samples_of(workspace, digest), lost_of(workspace, digest), digest
    if not Path(part).exists():
        raise StoreError(f"'{part}' is neither a file or folder nor a part in {workspace.store}.")
    return look_at(workspace, Path(part), machine)


def _rows_on(residuals: PartResiduals, recording: Recording, samples: Samples) -> np.ndarray:
    return np.clip(np.searchsorted(residuals.time, recording.time[samples.row] - 1e-6), 0, len(residuals.time) - 1)


def _likeness(alarm: Alarm, residuals: PartResiduals, rows: np.ndarray, signals: Mapping[str, Float1D]) -> str:
    time = residuals.time[rows]
    around = (time >= alarm.t_start - AROUND_S) & (time <= alarm.t_end + AROUND_S)
    residual = residuals.residual[rows[around], AXES.index(alarm.axis)]
    return looks_like(alarm.axis, residual, {name: values[around] for name, values in signals.items()})
