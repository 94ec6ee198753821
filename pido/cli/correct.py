"""`pido correct DIR PART --out FILE.parquet`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pido.cli.inputs import Input, said_of
from pido.cli.outputs import Output, not_of_another_format, outside, replaceable

if TYPE_CHECKING:
    from pido.core.recording import Recording


@click.command(name="correct")
@click.argument("diagnosis", type=click.Path(path_type=Path))
@click.argument("part", type=Input())
@click.option("--out", required=True, type=Output(dir_okay=False), help="Parquet file to write")
@click.option("--after", multiple=True, type=Input(), help="a part made in between; give all, oldest first")
def command(diagnosis: Path, part: Path, out: Path, after: tuple[Path, ...]) -> None:
    """Apply the models of a diagnosis, unchanged, to a part that was not diagnosed.

    DIAGNOSIS is the folder that `pido diagnose --out` wrote, or a file in it. No curr_<axis> column of PART is read: it
    works where there is no recording of the current yet. What the diagnosed parts left behind (heat, wear) is in the
    diagnosis; what parts made since then left behind is carried on from those given with --after. Where the part goes
    beyond what a finding was fitted on, that is said, here and in the file's metadata (pido.notes). Nothing is written
    into what is read, or over a recording.

    \b
    pido correct diagnosis parts/p04 --out p04-corrected.parquet
    pido correct diagnosis parts/p06 --after parts/p04 --after parts/p05 --out p06-corrected.parquet
    """
    from pido.diagnoses import check_all
    from pido.diagnosis import contract
    from pido.diagnosis.beyond import beyond, longer_pauses
    from pido.diagnosis.comparable import finite
    from pido.diagnosis.correct import (
        correct,
        not_applied,
        not_told_of,
        own_shift,
        wear_not_kept,
        without_currents,
    )
    from pido.recordings import read_recording

    folder = _folder_of(diagnosis)
    outside(out, (folder, part, *after))
    replaceable(out, contract.is_series, "corrected part")
    not_of_another_format(out, "NAME.parquet is written.")
    model = contract.read_model(folder)
    read = [read_recording(each) for each in (part, *after)]
    for place, one in zip((part, *after), read, strict=True):
        _same_machine(model, place, one)
    notes = said_of(read)
    recording, *earlier = (finite(one, notes) for one in read)
    notes += check_all([*map(without_currents, (recording, *earlier))])
    this = f"part {recording.part.part}:"
    if missing := not_told_of(model, recording, earlier):
        orders = ", ".join(map(str, missing))
        notes.append(
            f"{this} of the parts made before it, number {orders} in production order is not known; what was left "
            "behind there (heat, wear) is left out. Give it with --after."
        )
    if wear_not_kept(model, recording, earlier):
        notes.append(
            f"{this} this diagnosis is of a version that did not keep what its own parts wore off; that is left out. "
            "Give them with --after, oldest first, or run 'pido diagnose' again."
        )
    for name in not_applied(model, recording):
        notes.append(
            f"{this} {name} is not applied: it is known over times of the diagnosed parts only, tied to nothing that "
            "was recorded, and predicts no other part. report.html says what to record to find what it is."
        )
    for axis, mean in own_shift(model, recording).items():
        notes.append(
            f"{this} the diagnosed parts are each shifted in time by their own on axis {axis}; that of this part is "
            f"not known, and their mean, {mean * 1e3:.3g} ms, stands in for it. Align recording and simulation of "
            "each part at its first motion."
        )
    notes += [f"{this} {outside_of_it}" for outside_of_it in beyond(model, recording)]
    for axis, (pause, longest) in longer_pauses(model, recording, earlier).items():
        notes.append(
            f"{this} {axis}: thermal_drift was fitted on pauses of at most {longest:.3g} s between parts; this part "
            f"comes after {pause:.4g} s. How far the machine cooled in them is extrapolated."
        )
    for note in notes:
        click.echo(note, err=True)
    series = correct(model, recording, earlier)
    contract.write_series(series, out, contract.unit_of_series(model), notes)
    click.echo(str(out))


def _folder_of(diagnosis: Path) -> Path:
    """The folder of a diagnosis, by itself, a file in it, or its folder of series or one of these."""
    from pido.diagnosis.contract import MODEL

    folder = diagnosis.parent if diagnosis.is_file() else diagnosis
    above = folder.absolute().parent
    is_series = folder.absolute().name == "parts" and not (folder / MODEL).exists() and (above / MODEL).exists()
    return above if is_series else folder


def _same_machine(model: Mapping[str, Any], place: Path, recording: Recording) -> None:
    """Raises DiagnosisError for a part of another machine, where both say theirs."""
    from pido.core.errors import DiagnosisError
    from pido.recordings.folder import says_machine

    made_on = model.get("machine")
    if made_on is not None and says_machine(place) and recording.part.machine != made_on:
        raise DiagnosisError(
            f"{place}: part {recording.part.part} is of machine '{recording.part.machine}', and the diagnosis of "
            f"'{made_on}': what one machine lacks, another need not. Diagnose parts of this one."
        )
