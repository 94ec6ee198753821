"""`pido correct DIR PART --out FILE.parquet`."""

from __future__ import annotations

from pathlib import Path

import click

from pido.cli.inputs import Input


@click.command(name="correct")
@click.argument("diagnosis", type=click.Path(path_type=Path))
@click.argument("part", type=Input())
@click.option("--out", required=True, type=click.Path(path_type=Path, dir_okay=False), help="Parquet file to write")
def command(diagnosis: Path, part: Path, out: Path) -> None:
    """Apply the models of a diagnosis, unchanged, to a part that was not diagnosed.

    DIAGNOSIS is the folder that `pido diagnose --out` wrote. No curr_<axis> column of PART is read: it works where
    there is no recording of the current yet.

    \b
    pido correct diagnosis parts/p04 --out p04-corrected.parquet
    """
    from pido.diagnosis import contract
    from pido.diagnosis.correct import correct
    from pido.recordings import read_recording

    model = contract.read_model(diagnosis)
    series = correct(model, read_recording(part))
    contract.write_series(series, out, contract.unit_of_series(model))
    click.echo(str(out))
