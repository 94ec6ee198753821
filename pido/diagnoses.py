"""A diagnosis with its files: what the command line, the flow and the demo have in common.

In:  recordings of one machine, a folder. Out: the `Diagnosis`, and in the folder all files of the contract, the models
that `pido correct` applies, and the page.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pido.core.columns import TIME
from pido.core.errors import DiagnosisError
from pido.core.machining import Machine
from pido.core.recording import Recording
from pido.diagnosis import contract
from pido.diagnosis.diagnose import diagnose
from pido.diagnosis.finding import Diagnosis, Finding
from pido.diagnosis.pair import pair_of
from pido.recordings.check import check
from pido.recordings.faults import ERROR
from pido.reports.diagnosis import diagnosis_page
from pido.reports.page import render

PAGE = "report.html"
_NO_MATTER = frozenset({"missing_column", "unknown_column", "too_short"})  # a diagnosis has its own say on these


def diagnose_into(
    folder: Path, recordings: Sequence[Recording], *, made_on: str | None = None, **how: Any
) -> Diagnosis:
    """Diagnose and write everything into `folder`.

    made_on : the parts' machine, where somebody said so and no reader assumed it; `accept-physics` asks for it
    how : as `pido.diagnosis.diagnose.diagnose` takes it

    Raises DiagnosisError, with nothing written, where something else is in the folder's place, nothing can be compared
    or time is no time.
    """
    contract.check_place(folder, PAGE)
    contract.check_names(r.part.part for r in recordings)
    doubts = check_all(recordings, how.get("machine"))
    found = diagnose(recordings, **how)
    if made_on is not None:
        found = replace(found, model={**found.model, "machine": made_on})
    found = replace(found, notes=(*doubts, *found.notes))
    contract.write(found, folder, **{PAGE: render(diagnosis_page(found, recordings))})
    return found


def check_all(recordings: Sequence[Recording], machine: Machine | None = None) -> list[str]:
    """What `pido ingest` would refuse the recordings for, as far as a diagnosis goes on in spite of it: faulty inputs
    are what it looks for, and a column that is missing costs it what follows from that column.

    Raises DiagnosisError for what no finding can express: time that is missing, repeats, goes backward, or is in
    another unit.
    """
    fatal, doubts = [], []
    for recording in recordings:
        for fault in check(recording, machine):
            if fault.severity == ERROR and fault.kind not in _NO_MATTER:
                part, says = f"part {recording.part.part}", f"{fault.what} {fault.advice}"
                if fault.column == TIME:  # its sentences name it themselves
                    fatal.append(f"{', '.join(filter(None, (part, fault.samples)))}: {says}")
                else:
                    doubts.append(f"{part}: {fault.column}: {says}")
    if fatal:
        raise DiagnosisError("\n".join(fatal))
    return doubts


def summary(found: Diagnosis) -> list[str]:
    """One line per finding, then the axes on which nothing was found, and those of which nothing is said."""
    lines = [f"{f.axis}   {f.mechanism}   {_what(f)}{_gain(f, found.beside_others(f))}" for f in found.findings]
    if clean := [axis for axis in found.clean_axes if axis not in found.unproved]:
        lines.append(f"{', '.join(clean)}   nothing significant")
    lines += [f"{axis}   something is seen that too few seconds show to prove it" for axis in found.unproved]
    if pair_of(found.model) is None:
        lines += [f"{axis}   not judged: {_why_not(axis, found.notes)}" for axis in found.not_judged]
    return lines


def _why_not(axis: str, notes: Sequence[str]) -> str:
    left_out = f"axis {axis} is left out: "
    return next((n.removeprefix(left_out) for n in notes if n.startswith(left_out)), "no current was recorded.")


def _what(finding: Finding) -> str:
    """Where it acts; of a finding without a name the formula, too, which is all that it says; of a wrong coefficient
    what it has to be multiplied by."""
    where = finding.where.summary
    if finding.factor is not None:
        mean = ", the mean of all" if finding.by_part is not None and finding.by_part.differs else ""
        return f"{where}: multiply the simulation's coefficient by {finding.factor.value:.3g}{mean}"
    return f"{where}: {finding.equation}" if finding.kind == "unexplained" else where


def _gain(finding: Finding, beside_others: bool) -> str:
    if not finding.modelled:
        return ""
    fit = finding.fit
    others = ", without it -> with it, beside the axis' other findings" if beside_others else ""
    return f"   RMSE {fit.rmse_before:.{fit.digits}g} -> {fit.rmse_after:.{fit.digits}g} ({fit.scheme}{others})"
