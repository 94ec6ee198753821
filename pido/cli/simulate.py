"""`pido simulate PROGRAM --job job.toml --out part.parquet`."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pido.cli.inputs import Input
from pido.cli.outputs import not_of_another_format, replaceable

if TYPE_CHECKING:
    from pido.core.recording import Recording


@click.command(name="simulate")
@click.argument("program", type=Input(dir_okay=False))
@click.option("--job", "job_file", required=True, type=Input(dir_okay=False), help="machine, material, tools, raw part")
@click.option(
    "--out", required=True, type=click.Path(path_type=Path), help="NAME.parquet, or a folder (with its part.json)"
)
@click.option("--part", "name", help="identifier of the part  [default: name of the program]")
@click.option("--engagement", is_flag=True, help="add a_p, a_e (mm) and phi_s (rad), which no recording has")
@click.option("--json", "as_json", is_flag=True, help="print the summary as JSON")
def command(program: Path, job_file: Path, out: Path, name: str | None, engagement: bool, as_json: bool) -> None:
    """An NC program to motion, engagement, forces and the 13 inputs.

    The columns are those of a recording, without currents; each sample knows its NC line. A rapid through the raw
    part, a raw part smaller than the path, a tool that is not in the list or a word that is not understood ends the
    call before anything is written. Without [stock] in the job the run is an air cut. A recording at --out that was not
    simulated stays as it is, and ends the call.

    \b
    pido simulate impeller.MPF --job job.toml --out impeller.parquet

    \b
    job.toml:
      machine = "dmc60h"            # pido/settings, or a file of your own: machines = "mine.toml"
      material = "S235JR"
      zero_offsets = { G57 = [0.0, 0.0, 0.0] }
      [stock]                       # or: mesh = "raw.stl"
      low_mm = [0.0, 0.0, -50.0]
      high_mm = [75.0, 150.0, 0.0]
      [tools.FRAESER_10St]
      diameter_mm = 10.0
      teeth = 4
    """
    from dataclasses import replace

    from pido.config import load_job
    from pido.core.files import writable
    from pido.core.part import PartInfo
    from pido.process.quantities import ENGAGEMENT
    from pido.process.simulate import simulate_job
    from pido.recordings.folder import ABOUT, DATA, write_columns, write_folder

    not_of_another_format(out, "NAME.parquet is written, or a folder.")
    alone = out.suffix.lower() == ".parquet" and not out.is_dir()
    file = out if alone else out / DATA
    replaceable(file, _simulated, "simulated recording")
    if not file.exists() and not alone:
        replaceable(out / ABOUT, _simulated, "simulated part")
    writable(file)
    job = load_job(job_file)
    info = PartInfo(
        part=name or program.stem,
        machine=job.machine.id,
        material=job.material.name if job.material else None,
        program=program.name,
        vertical_axis=job.machine.vertical_axis,
    )
    recording = simulate_job(program, job, info)
    written = (
        recording
        if engagement
        else replace(
            recording, columns={name: values for name, values in recording.columns.items() if name not in ENGAGEMENT}
        )
    )
    if alone:
        write_columns(written, out)
    else:
        write_folder(written, out)
    figures = summary(recording)
    if as_json:
        import json

        click.echo(json.dumps(figures, indent=2))
    else:
        from pido.reports.words import of_a_run

        for key, value in figures.items():
            click.echo(f"{of_a_run(key):<32}{f'{value:g}' if isinstance(value, float) else value}")
    for note in recording.notes:
        click.echo(note, err=True)


def _simulated(columns: Collection[str]) -> bool:
    """Whether these are the columns of what this verb writes: each sample has its NC line and load, and no current."""
    from pido.core.columns import CURRENT, CURRENT_SIM, PROCESS

    currents = {*CURRENT.values(), *CURRENT_SIM.values()}
    return {"nc_line", *PROCESS} <= set(columns) and currents.isdisjoint(columns)


def summary(recording: Recording) -> dict[str, Any]:
    """What a person asks first: how long, how much, how hard."""
    import numpy as np

    from pido.process.quantities import area_removal

    ar = area_removal(recording)
    cuts = ar > 0
    time = recording.time
    return {
        "part": recording.part.part,
        "samples": len(recording),
        "duration_s": float(time[-1] - time[0]),
        "in_cut_s": float(cuts.sum() / recording.sample_rate_hz),
        "removed_mm3": float(np.trapezoid(recording["mrr_sim"], time)),
        "largest_mrr_mm3_s": float(recording["mrr_sim"].max()),
        "median_ar_mm2": float(np.median(ar[cuts])) if cuts.any() else 0.0,
        "largest_f_sp_n": float(np.nanmax(recording["f_sp_sim"])),
        "largest_m_sp_nm": float(np.nanmax(recording["m_sp_sim"])),
    }
