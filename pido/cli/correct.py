"""`pido correct DIR PART --out FILE.parquet`."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import click

from pido.cli.inputs import Input
from pido.cli.outputs import outside, replaceable


@click.command(name="correct")
@click.argument("diagnosis", type=click.Path(path_type=Path))
@click.argument("part", type=Input())
@click.option("--out", required=True, type=click.Path(path_type=Path, dir_okay=False), help="Parquet file to write")
@click.option("--after", multiple=True, type=Input(), help="a part made in between; give all, oldest first")
def command(diagnosis: Path, part: Path, out: Path, after: tuple[Path, ...]) -> None:
    """Apply the models of a diagnosis, unchanged, to a part that was not diagnosed.

    DIAGNOSIS is the folder that `pido diagnose --out` wrote. No curr_<axis> column of PART is read: it works where
    there is no recording of the current yet. What parts made since those of the diagnosis left behind (heat, wear) is
    carried on from the ones given with --after. Nothing is written into what is read, nor over a recording.

    \b
    pido correct diagnosis parts/p04 --out p04-corrected.parquet
    pido correct diagnosis parts/p06 --after parts/p04 --after parts/p05 --out p06-corrected.parquet
    """
    from pido.diagnosis import contract
    from pido.diagnosis.correct import correct, not_told_of
    from pido.recordings import read_recording

    outside(out, (diagnosis, part, *after))
    replaceable(out, _corrected, "corrected part")
    model = contract.read_model(diagnosis)
    recording, earlier = read_recording(part), [read_recording(each) for each in after]
    if missing := not_told_of(model, recording, earlier):
        orders = ", ".join(map(str, missing))
        click.echo(
            f"part {recording.part.part}: of the parts made before it, number {orders} in production order is not "
            "known; what was left behind there (heat, wear) is left out. Give it with --after.",
            err=True,
        )
    series = correct(model, recording, earlier)
    contract.write_series(series, out, contract.unit_of_series(model))
    click.echo(str(out))


def _corrected(columns: Collection[str]) -> bool:
    """Whether these are the columns of what this verb writes."""
    return any(name.startswith("mismatch_score_") for name in columns)
