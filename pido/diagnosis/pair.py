"""Two columns in place of an axis' currents: a measured force and its simulation, a torque, a power.

In:  recordings and 'RECORDED:SIMULATED'.
Out: the recordings with these two where a diagnosis looks for the currents; its answer in the pair's own unit.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from pido.core.axes import AXES
from pido.core.columns import ALIASES, CURRENT, CURRENT_SIM, UNITS
from pido.core.errors import DiagnosisError
from pido.core.recording import Recording
from pido.diagnosis.finding import Diagnosis, Finding

_SIMULATED = "_sim"


@dataclass(frozen=True)
class Pair:
    """Two columns, the axis whose motion explains them, and their unit ('' where nothing says it)."""

    recorded: str
    simulated: str
    axis: str
    unit: str

    @classmethod
    def parse(cls, text: str) -> Pair:
        """From 'RECORDED:SIMULATED'. The axis is in one of the names ('f_x', 'm_sp_sim'); x where it is in none."""
        recorded, _, simulated = text.partition(":")
        if not recorded or not simulated or ":" in simulated or recorded == simulated:
            raise DiagnosisError(
                f"--pair {text}: write RECORDED:SIMULATED, two different column names with a colon between them."
            )
        axis = _axis_in(recorded) or _axis_in(simulated) or "x"
        units = [UNITS[n] for n in (simulated, recorded, ALIASES.get(recorded, "")) if n in UNITS]
        return cls(recorded, simulated, axis, units[0] if units else "")

    def check(self) -> None:
        """Raises DiagnosisError, with the call that is meant, for a simulation in the place of the recording, and for
        columns of two axes."""
        if self.recorded.endswith(_SIMULATED) and not self.simulated.endswith(_SIMULATED):
            raise DiagnosisError(
                f"--pair {self}: '{self.recorded}' is simulated, and stands first. The recorded column comes first: "
                f"--pair {self.simulated}:{self.recorded}"
            )
        first, second = (_axis_in(name) for name in (self.recorded, self.simulated))
        if first and second and first != second:
            own = [name.removesuffix(_SIMULATED) for name in (self.recorded, self.simulated)]
            calls = " or ".join(f"--pair {name}:{name}{_SIMULATED}" for name in own)
            raise DiagnosisError(
                f"--pair {self}: '{self.recorded}' is of axis {first}, '{self.simulated}' of axis {second}. Compare "
                f"two columns of one axis: {calls}"
            )

    def __str__(self) -> str:
        return f"{self.recorded}:{self.simulated}"

    def of(self, recording: Recording) -> Recording:
        """The recording with the pair in place of all currents; without the recorded one where it has only the other.

        Raises DiagnosisError that names the columns there are.
        """
        columns = {k: v for k, v in recording.columns.items() if k not in (*CURRENT.values(), *CURRENT_SIM.values())}
        columns[CURRENT_SIM[self.axis]] = _numbers(recording, self.simulated)
        if _known_as(recording, self.recorded) is not None:
            columns[CURRENT[self.axis]] = _numbers(recording, self.recorded)
        return replace(recording, columns=columns)


def pair_of(model: Mapping[str, object]) -> Pair | None:
    """The pair that a diagnosis' model is of; None where it is of the currents."""
    text = model.get("pair")
    return Pair.parse(text) if isinstance(text, str) else None


def paired(parts: Sequence[Recording], text: str) -> list[Recording]:
    """Every part with the pair in place of its currents. Raises DiagnosisError where the two cannot be a recording and
    its simulation, or a part lacks one of them or all its values."""
    pair = Pair.parse(text)
    pair.check()
    for name in (pair.recorded, pair.simulated):
        if empty := [r.part.part for r in parts if not np.isfinite(_numbers(r, name)).any()]:
            raise DiagnosisError(
                f"--pair {text}: '{name}' has no value in {', '.join(empty)}. Leave these parts out, or name another "
                "column."
            )
    return [pair.of(recording) for recording in parts]


@contextmanager
def in_its_words(text: str | None) -> Iterator[None]:
    """What is refused inside is refused with the pair's own columns; as it is where there is no pair."""
    try:
        yield
    except DiagnosisError as error:
        if text is None:
            raise
        raise DiagnosisError(_columns(str(error), Pair.parse(text))) from None


def in_its_unit(diagnosis: Diagnosis, text: str) -> Diagnosis:
    """The diagnosis of a pair, with the pair in its model, and its columns and unit wherever the mechanisms say current
    and ampere."""
    pair = Pair.parse(text)
    notes = tuple(_said(note, pair) for note in diagnosis.notes)
    if not any(map(_axis_in, (pair.recorded, pair.simulated))):
        notes = (*notes, f"--pair {text}: neither name holds an axis; the motion of {pair.axis} was looked at.")
    return replace(
        diagnosis,
        findings=tuple(_finding(f, pair) for f in diagnosis.findings),
        model={**diagnosis.model, "pair": text},
        rejected=tuple(replace(r, reason=_said(r.reason, pair)) for r in diagnosis.rejected),
        notes=notes,
    )


def _finding(finding: Finding, pair: Pair) -> Finding:
    where = finding.where
    return replace(
        finding,
        equation=_said(finding.equation, pair),
        parameters={n: replace(e, unit=unit_of(e.unit, pair.unit)) for n, e in finding.parameters.items()},
        where=replace(
            where, summary=_said(where.summary, pair), conditions=tuple(_said(c, pair) for c in where.conditions)
        ),
        alternatives=tuple(replace(a, to_tell_apart=_said(a.to_tell_apart, pair)) for a in finding.alternatives),
    )


def _columns(text: str, pair: Pair) -> str:
    """A text with the pair's columns in place of those of the current."""
    names = {CURRENT[pair.axis]: pair.recorded, CURRENT_SIM[pair.axis]: pair.simulated}
    return re.sub(r"\bcurr_\w+", lambda found: names.get(found[0], found[0]), text)


def _said(text: str, pair: Pair) -> str:
    """What a mechanism says of a current, of the pair.

    >>> _said("wherever the current of x reaches 300 A", Pair.parse("f_x:f_x_sim"))
    'wherever f_x reaches 300 N'
    >>> _said("curr_x(t) = I_sim(t - shift)", Pair.parse("f_x:f_x_sim"))
    'f_x(t) = f_x_sim(t - shift)'
    """
    words = {
        rf"\bdI_{pair.axis}\b|\bdI\b": f"d({pair.recorded})",
        r"\bI_sim\b|\b(the )?simulated current\b": pair.simulated,
        rf"\b(the |recorded )*current( of {pair.axis})?\b": pair.recorded,
        r"(?<=\d) A\b(?!/)": f" {pair.unit}".rstrip(),
    }
    for pattern, word in words.items():
        text = re.sub(pattern, lambda _, word=word: word, text)
    return _columns(text, pair)


def unit_of(unit: str, instead: str) -> str:
    """A unit with another one in place of the ampere; a dash where the two cancel.

    >>> [unit_of(unit, "N") for unit in ("A", "A/(mm/s)", "1/A²", "A/N", "mm", "–")]
    ['N', 'N/(mm/s)', '1/N²', '–', 'mm', '–']
    """
    swapped = re.sub(r"(?<![A-Za-z·])A(?![A-Za-z·])", instead or "[recorded]", unit)
    over, _, under = swapped.partition("/")
    return "–" if under.strip("()") == over else swapped


def _axis_in(name: str) -> str | None:
    """The axis that a column's name holds."""
    return next((axis for axis in AXES if axis in name.split("_")), None)


def _known_as(recording: Recording, name: str) -> str | None:
    """The column's name in the recording: its own, or the contract's where a reader gave it that."""
    return next((n for n in (name, ALIASES.get(name)) if n is not None and n in recording), None)


def _numbers(recording: Recording, name: str):
    found = _known_as(recording, name)
    if found is None:
        raise DiagnosisError(
            f"part {recording.part.part}: --pair names column '{name}', which is not there; it has "
            f"{', '.join(recording.columns)}."
        )
    if recording[found].dtype == object:
        raise DiagnosisError(f"part {recording.part.part}: column '{name}' holds text; --pair compares numbers.")
    return recording[found]
