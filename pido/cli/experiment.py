"""`pido experiment NAME --data … --out …`."""

from __future__ import annotations

from pathlib import Path

import click

NAMES = ("importance", "weighting", "shares", "local-vs-global", "ablation", "rivals")


@click.command(name="experiment")
@click.argument("name", type=click.Choice(NAMES))
@click.option(
    "--data",
    multiple=True,
    help="'worn', 'newer' (virtual machines), a recording, or a folder of recordings; repeatable",
)
@click.option("--repeats", type=click.IntRange(1), help="of what is random; 30 where not given, a few with --quick")
@click.option("--quick", is_flag=True, help="a small version, in under two minutes")
@click.option("--seed", default=0, show_default=True, help="of everything that is drawn")
@click.option("--workers", type=click.IntRange(1), help="processes on this machine; all cores where not given")
@click.option("--cluster", help="address of a Dask scheduler, or 'local'")
@click.option("--machine", help="settings of the machine, for recordings that do not name theirs")
@click.option(
    "--job", "job_file", type=click.Path(path_type=Path, exists=True, dir_okay=False), help="what was cut with what"
)
@click.option(
    "--estimators", type=click.Choice(["default", "paper"]), default="default", show_default=True,
    help="extra trees for all axes, or boosting for the spindle as in the paper (slow)",
)  # fmt: skip
@click.option(
    "--out", type=click.Path(path_type=Path, file_okay=False), default=Path("experiments"), show_default=True,
    help="folder for results and report",
)  # fmt: skip
@click.option("--resume/--fresh", default=True, show_default=True, help="use what the folder holds already")
@click.option("--json", "as_json", is_flag=True, help="print verdict and tables as JSON")
def command(
    name: str, data: tuple[str, ...], repeats: int | None, quick: bool, seed: int, workers: int | None,
    cluster: str | None, machine: str | None, job_file: Path | None, estimators: str, out: Path, resume: bool, as_json: bool,
) -> None:  # fmt: skip
    """Run an experiment of the paper, on any recordings, and see its figures beside the published ones.

    importance, weighting, shares, local-vs-global and ablation are the paper's; rivals goes past it. A run that was
    stopped continues where it was; more repeats add to those that are there.

    \b
    pido experiment local-vs-global --data recordings/ --out results
    pido experiment ablation --data worn --data newer --repeats 30 --workers 4
    """
    import json
    import os

    from pido.cli.progress import Progress
    from pido.config import load_job
    from pido.experiments.runner import run_experiment
    from pido.reports.experiment import experiment_page
    from pido.reports.page import write_page

    job = None if job_file is None else load_job(job_file)
    told = []
    for source in data or ("worn",):
        folder = out / name / _folder_name(source)
        with Progress(f"{name}, {source}") as progress:
            result = run_experiment(
                name, source, folder=folder, repeats=repeats, seed=seed, workers=workers or os.cpu_count() or 1,
                cluster=cluster, quick=quick, resume=resume, machine=machine, job=job, estimators=estimators,
                on_progress=progress,
            )  # fmt: skip
        outcome, fleet = result.outcome, result.fleet
        facts = (
            f"{fleet.name}: {len(fleet.sets)} sets, {sum(map(len, fleet.sets.values()))} rows, machine {fleet.machine.id}",
            f"repeats {result.options.repeats}, seed {seed}, estimators {estimators}{', quick' if quick else ''}; "
            f"{result.units} units, {result.found} of them from an earlier run",
            *fleet.notes,
        )
        tables = [(shown.title, shown.table, shown.text) for shown in outcome.tables]
        page = experiment_page(
            f"{result.experiment.title}: {fleet.name}", result.experiment.source, outcome.verdict, tables,
            outcome.differs, facts,
        )  # fmt: skip
        write_page(page, folder / "report.html")
        click.echo(f"report: {folder / 'report.html'}", err=True)
        if as_json:
            told.append(
                {
                    "experiment": name, "data": source, "verdict": outcome.verdict, "differs": outcome.differs,
                    "tables": {t: json.loads(table.to_json(orient="records")) for t, table, _ in tables},
                }
            )  # fmt: skip
            continue
        click.echo(f"{fleet.name}: {outcome.verdict}\n")
        for title, table, _ in tables[:3]:
            click.echo(f"{title}\n{table.to_string(index=False, float_format=lambda v: f'{v:.4g}')}\n")
    if as_json:
        click.echo(json.dumps(told, indent=1))


def _folder_name(source: str) -> str:
    """A name for the results of these data."""
    return "".join(c if c.isalnum() or c in "-_" else "-" for c in Path(source).stem) or "data"
