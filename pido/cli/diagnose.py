"""`pido diagnose PART [PART ...] --out DIR`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from pido.diagnosis.finding import Diagnosis


def _two_columns(_context: click.Context, _parameter: click.Parameter, pair: str | None) -> str | None:
    if pair is not None and not all(pair.partition(":")):
        raise click.BadParameter("give two column names, RECORDED:SIMULATED")
    return pair


@click.command(name="diagnose")
@click.argument("parts", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", required=True, type=click.Path(path_type=Path, file_okay=False), help="folder for the result")
@click.option(
    "--pair",
    metavar="RECORDED:SIMULATED",
    callback=_two_columns,
    help="compare these two columns instead of curr_<axis> and curr_<axis>_sim",
)
@click.option("--machine", help="name of the machine's settings (ranges and dead bands)")
@click.option("--seed", default=0, show_default=True, help="seed of the bootstrap")
@click.option("--json", "as_json", is_flag=True, help="print diagnosis.json instead of the summary")
def command(
    parts: tuple[Path, ...], out: Path, pair: str | None, machine: str | None, seed: int, as_json: bool
) -> None:
    """Compare simulation with recording and name the physics that is missing.

    Where curr_<axis>_sim columns are given, they are the simulation; otherwise the physical equation fitted on the
    same parts is. DIR gets diagnosis.json, details.json, model.json (for `pido correct`), one Parquet file per part
    and report.html.

    \b
    pido diagnose parts/p01 parts/p02 parts/p03 --out diagnosis
    pido diagnose parts/* --pair f_x:f_x_sim --out force-check
    """
    import json

    from pido.cli.progress import Progress
    from pido.config import machine as machine_settings
    from pido.diagnosis import contract
    from pido.diagnosis.diagnose import diagnose
    from pido.recordings import read_recording
    from pido.reports.diagnosis import diagnosis_page
    from pido.reports.page import write_page

    recordings = [read_recording(part) for part in parts]
    with Progress("diagnosing") as progress:
        result = diagnose(
            recordings,
            pair=pair,
            machine=machine_settings(machine) if machine else None,
            seed=seed,
            on_progress=progress,
        )
    contract.write(result, out)
    write_page(diagnosis_page(result, recordings), out / "report.html")
    if as_json:
        click.echo(json.dumps(json.loads((out / "diagnosis.json").read_text(encoding="utf-8")), indent=2))
        return
    for line in summary(result):
        click.echo(line)
    for note in result.notes:
        click.echo(note, err=True)
    click.echo(f"report: {out / 'report.html'}", err=True)


def summary(result: Diagnosis) -> list[str]:
    """One line per finding, then the axes on which nothing was found."""
    lines = [
        f"{f.axis}   {f.mechanism}   {f.where.summary}   "
        f"RMSE {f.fit.rmse_before:.3g} -> {f.fit.rmse_after:.3g} ({f.fit.scheme})"
        for f in result.findings
    ]
    if result.clean_axes:
        lines.append(f"{', '.join(result.clean_axes)}   nothing significant")
    return lines
