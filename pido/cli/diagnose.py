"""`pido diagnose PART [PART ...] --out DIR`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from pido.cli.inputs import Input, said_of
from pido.cli.outputs import Output


def _two_columns(_context: click.Context, _parameter: click.Parameter, pair: str | None) -> str | None:
    if pair is not None and not all(pair.partition(":")):
        raise click.BadParameter("give two column names, RECORDED:SIMULATED")
    return pair


@click.command(name="diagnose")
@click.argument("parts", nargs=-1, required=True, type=Input())
@click.option("--out", required=True, type=Output(file_okay=False), help="folder for the result")
@click.option(
    "--pair",
    metavar="RECORDED:SIMULATED",
    callback=_two_columns,
    help="compare these two columns instead of curr_<axis> and curr_<axis>_sim",
)
@click.option("--machine", help="name of the machine's settings (ranges and dead bands)")
@click.option(
    "--settings",
    type=Input(dir_okay=False),
    help="TOML with own machines; that of the parts, as their part.json names it, unless --machine says",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="seed of the bootstrap")
@click.option("--json", "as_json", is_flag=True, help="print diagnosis.json instead of the summary")
def command(
    parts: tuple[Path, ...],
    out: Path,
    pair: str | None,
    machine: str | None,
    settings: Path | None,
    seed: int,
    as_json: bool,
) -> None:
    """Compare simulation with recording and name the physics that is missing.

    Each of PARTS is a part folder or a file of any known format, as for `pido ingest`. Where curr_<axis>_sim columns
    are given, they are the simulation; otherwise the physical equation fitted on the same parts is. The folder --out
    gets diagnosis.json, details.json, model.json (for `pido correct`), one Parquet file per part and
    report.html, in the place of those of a diagnosis that is there; over anything else nothing is written.

    \b
    pido diagnose parts/p01 parts/p02 parts/p03 --out diagnosis
    pido diagnose parts/* --pair f_x:f_x_sim --out force-check
    pido diagnose parts/* --settings machines.toml --out diagnosis
    """
    import json

    from pido.cli.progress import Progress
    from pido.config import machine as machine_settings
    from pido.diagnoses import PAGE, diagnose_into, summary
    from pido.diagnosis.contract import check_place
    from pido.recordings import read_recording
    from pido.recordings.folder import says_machine

    check_place(out, PAGE)
    own = machine_settings(machine, settings) if machine else None
    recordings = [read_recording(part) for part in parts]
    named = [r.part.machine for r, part in zip(recordings, parts, strict=True) if says_machine(part)]
    if settings and own is None:
        machine = _machine_of(named, settings)
        own = machine_settings(machine, settings)
        click.echo(f"machine '{machine}', as {settings} has it", err=True)
    with Progress("diagnosing") as progress:
        result = diagnose_into(
            out,
            recordings,
            made_on=named[0] if named else machine,
            pair=pair,
            machine=own,
            seed=seed,
            on_progress=progress,
        )
    for note in [*said_of(recordings), *result.notes]:
        click.echo(note, err=True)
    if as_json:
        click.echo(json.dumps(json.loads((out / "diagnosis.json").read_text(encoding="utf-8")), indent=2))
        return
    for line in summary(result):
        click.echo(line)
    click.echo(f"report: {out / PAGE}", err=True)


def _machine_of(named: Sequence[str], settings: Path) -> str:
    """The machine of a settings file that the parts are of: the one that part.json names, or the only one there where
    no part names any.

    Raises click.UsageError where these leave it open.
    """
    from pido.config import machines_in

    there, of_parts = machines_in(settings), sorted(set(named))
    if len(of_parts) == 1 and of_parts[0] in there:
        return of_parts[0]
    if not of_parts and len(there) == 1:
        return there[0]
    says = "no part.json says which machine the parts are of"
    if of_parts:
        says = f"the parts are of {', '.join(map(repr, of_parts))}, as part.json says"
    raise click.UsageError(
        f"{settings} has {', '.join(map(repr, there)) or 'no machine'}, and {says}. Name the one to take with --machine"
    )
