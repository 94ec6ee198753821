"""A diagnosis with its files: what the command line, the flow and the demo have in common.

In:  recordings of one machine, a folder. Out: the `Diagnosis`, and in the folder all files of the contract, the models
that `pido correct` applies, and the page.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pido.core.recording import Recording
from pido.diagnosis import contract
from pido.diagnosis.diagnose import diagnose
from pido.diagnosis.finding import Diagnosis, Finding, HeldOut
from pido.reports.diagnosis import diagnosis_page
from pido.reports.page import render

PAGE = "report.html"


def diagnose_into(folder: Path, recordings: Sequence[Recording], **how: Any) -> Diagnosis:
    """Diagnose and write everything into `folder`. how : as `pido.diagnosis.diagnose.diagnose` takes it.

    Raises DiagnosisError, with nothing written, where nothing can be compared.
    """
    contract.check_names(r.part.part for r in recordings)
    found = diagnose(recordings, **how)
    contract.write(found, folder, **{PAGE: render(diagnosis_page(found, recordings))})
    return found


def summary(found: Diagnosis) -> list[str]:
    """One line per finding, then the axes on which nothing was found."""
    lines = [f"{f.axis}   {f.mechanism}   {_what(f)}{_gain(f.fit, found.beside_others(f))}" for f in found.findings]
    if found.clean_axes:
        lines.append(f"{', '.join(found.clean_axes)}   nothing significant")
    return lines


def _what(finding: Finding) -> str:
    """Where it acts; of a finding without a name the formula, too, which is all that it says; of a wrong coefficient
    what it has to be multiplied by."""
    where = finding.where.summary
    if finding.factor is not None:
        return f"{where}: multiply the simulation's coefficient by {finding.factor.value:.3g}"
    return f"{where}: {finding.equation}" if finding.kind == "unexplained" else where


def _gain(fit: HeldOut, beside_others: bool) -> str:
    """Nothing for rows that were set aside: no fit was made."""
    if not math.isfinite(fit.rmse_before):
        return ""
    others = ", without it -> with it, beside the axis' other findings" if beside_others else ""
    return f"   RMSE {fit.rmse_before:.{fit.digits}g} -> {fit.rmse_after:.{fit.digits}g} ({fit.scheme}{others})"
