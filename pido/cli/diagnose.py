"""`pido diagnose PART [PART ...] --out DIR`."""

from __future__ import annotations

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
@click.option("--settings", type=Input(dir_okay=False), help="TOML with own machines")
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
    pido diagnose parts/* --machine our_mill --settings machines.toml --out diagnosis
    """
    if settings and not machine:
        raise click.UsageError("--settings says what machines are like; name the one of these parts with --machine")
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
