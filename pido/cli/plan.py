"""`pido plan PROGRAM --job job.toml --workspace plant`."""

from __future__ import annotations

from pathlib import Path

import click

from pido.cli.inputs import Input
from pido.cli.outputs import Output
from pido.cli.places import workspace_option

SHOWN = 12


@click.command(name="plan")
@click.argument("program", type=Input(dir_okay=False))
@click.option("--job", "job_file", required=True, type=Input(dir_okay=False), help="machine, material, tools, raw part")
@workspace_option
@click.option("--out", type=Output(file_okay=False), help="folder for plan.json and report.html")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="of the draws")
@click.option("--json", "as_json", is_flag=True, help="print every bin as JSON")
def command(program: Path, job_file: Path, folder: Path, out: Path | None, seed: int, as_json: bool) -> None:
    """What a coming part needs, before the first chip.

    The program is simulated (as by `pido simulate`), its path is laid over the reduced space (v_x, v_y, AR), and for
    each relevant bin it is said how many real samples the workspace holds there and what PiDO would generate.

    \b
    pido plan impeller.MPF --job job.toml --workspace plant --out plan
    """
    import json

    import numpy as np

    from pido.cli.places import existing
    from pido.cli.simulate import summary
    from pido.config import load_job
    from pido.core.errors import StoreError
    from pido.core.files import write_atomically
    from pido.iteration import balance, refit
    from pido.parts import recipe_of
    from pido.process.samples import to_samples
    from pido.process.simulate import simulate_job
    from pido.reports.page import number, write_page
    from pido.reports.plan import plan_figures, plan_page, plan_rows
    from pido.reports.words import of_a_run
    from pido.rows import training_rows
    from pido.store import Store

    job = load_job(job_file)
    workspace = existing(folder)
    entries = Store(workspace.store).entries(job.machine.id)
    if not entries:
        raise StoreError(
            f"{folder}: holds no part of machine {job.machine.id} yet. Take one in first: pido iterate PART -w {folder}"
        )
    recording = simulate_job(program, job)
    path = to_samples(recording, job.machine, "", engaged_only=bool((recording["mrr_sim"] > 0).any()))
    recipe, method, digests = recipe_of(workspace), workspace.settings.method, [entry.digest for entry in entries]
    real = training_rows(workspace, job.machine.id, digests, method.rows_max)
    judged = training_rows(workspace, job.machine.id, digests, method.rows_max_choice)
    balanced = balance(real, path, refit(judged, job.machine, recipe, seed), job.machine, recipe, seed)

    report, grid = balanced.report, recipe.method.grid
    visited, count = np.unique(grid.ids(path.reduced), return_counts=True)
    seen = dict(zip(visited.tolist(), count.tolist(), strict=True))
    rows = plan_rows(report, grid, np.array([seen.get(int(b), 0) for b in report.bins]))
    elsewhere = sum(report.elsewhere)
    figures = {"part": program.stem, "machine": job.machine.id, **plan_figures(rows, elsewhere)}
    if out is not None:
        write_atomically(out / "plan.json", json.dumps({**figures, "bins": rows}, indent=1))
        page = plan_page(program.stem, rows, report.summary(), summary(recording), elsewhere)
        write_page(page, out / "report.html")
        click.echo(f"report: {out / 'report.html'}", err=True)
    if as_json:
        click.echo(json.dumps({**figures, "bins": rows}, indent=1))
        return
    for key, value in figures.items():
        click.echo(f"{of_a_run(key):<39}{number(value) if isinstance(value, float) else value}")
    click.echo(f"\n{'v_x':>8}{'v_y':>8}{'AR':>8}{'coming':>9}{'real':>8}{'PiA':>6}{'PiE':>6}   (mm/s, mm/s, mm²)")
    for row in rows[:SHOWN]:
        click.echo(
            f"{row['v_x']:>8g}{row['v_y']:>8g}{row['ar']:>8g}{row['coming']:>9d}{row['real']:>8d}"
            f"{row['pia']:>6d}{row['pie']:>6d}"
        )
    if len(rows) > SHOWN:
        click.echo(f"   … and {len(rows) - SHOWN} more bins (--json or --out)")
