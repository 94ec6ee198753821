"""`pido experiment NAME --data … --out …`."""

from __future__ import annotations

from pathlib import Path

import click
from click.core import ParameterSource

from pido.cli.inputs import Input
from pido.cli.outputs import Output

NAMES = (
    "importance", "weighting", "shares", "local-vs-global", "ablation", "rivals", "extended-equation", "concealed",
    "real-mismatch",
)  # fmt: skip
PROOFS = ("extended-equation", "concealed", "real-mismatch")
"""Not of the paper: what the mismatch finder is worth, to the equation, on sealed cases and on real recordings."""
_UNITS = tuple(name for name in NAMES if name not in PROOFS)
OPTIONS_OF = {
    "data": tuple(name for name in NAMES if name != "concealed"),
    "repeats": tuple(name for name in _UNITS if name != "local-vs-global"),
    "workers": (*_UNITS, "concealed"),
    "cluster": _UNITS,
    "machine": (*_UNITS, "extended-equation"),
    "job_file": _UNITS,
    "estimators": ("ablation", "rivals"),
    "percents": ("ablation", "rivals"),
    "delivered": ("ablation",),
    "cases": ("concealed",),
}
"""What has a meaning for some experiments alone, by the parameter's name; elsewhere it is a wrong call."""
NEEDS = {
    "extended-equation": "one recording, or a folder of one machine: --data PATH",
    "real-mismatch": "the folder of the published recordings: --data DIR",
}


@click.command(name="experiment")
@click.argument("name", type=click.Choice(NAMES))
@click.option(
    "--data",
    multiple=True,
    help="'worn', 'newer' (virtual machines), a recording, or a folder of recordings; repeatable",
)
@click.option("--repeats", type=click.IntRange(1), help="of what is random; 30 where not given, a few with --quick")
@click.option("--quick", is_flag=True, help="a small version, in under two minutes")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="of everything that is drawn")
@click.option("--workers", type=click.IntRange(1), help="processes on this machine; all cores where not given")
@click.option("--cluster", help="address of a Dask scheduler, or 'local'")
@click.option("--machine", help="settings of the machine, for recordings that do not name theirs")
@click.option("--job", "job_file", type=Input(dir_okay=False), help="what was cut with what")
@click.option(
    "--estimators", type=click.Choice(["default", "paper"]), default="default", show_default=True,
    help="extra trees for all axes, or boosting for the spindle as in the paper (slow)",
)  # fmt: skip
@click.option(
    "--percent", "percents", type=click.IntRange(1, 100), multiple=True,
    help="of a file to train on, in place of 10 to 100 and of adding files; of ablation and rivals; repeatable",
)  # fmt: skip
@click.option("--delivered", is_flag=True, help="of ablation: PiDO as delivered and its null alone, not as printed")
@click.option(
    "--out", type=Output(file_okay=False), default=Path("experiments"), show_default=True,
    help="folder for results and report",
)  # fmt: skip
@click.option(
    "--resume/--fresh",
    default=True,
    show_default=True,
    help="go on with the run that the folder holds, or replace whatever it holds",
)
@click.option("--cases", type=click.IntRange(1), help="of 'concealed'; 300 where not given, a few with --quick")
@click.option("--json", "as_json", is_flag=True, help="print verdict and tables as JSON")
@click.pass_context
def command(
    ctx: click.Context, name: str, data: tuple[str, ...], repeats: int | None, quick: bool, seed: int,
    workers: int | None, cluster: str | None, machine: str | None, job_file: Path | None, estimators: str,
    percents: tuple[int, ...], delivered: bool, out: Path, resume: bool, cases: int | None, as_json: bool,
) -> None:  # fmt: skip
    """Run an experiment of the paper, on any recordings, and see its figures beside the published ones.

    importance, weighting, shares, local-vs-global and ablation are the paper's; rivals goes past it.
    extended-equation, concealed and real-mismatch prove the mismatch finder: what it adds to the equation of one
    machine, on sealed cases, and on published recordings. Results go to OUT/NAME/DATA. A run that was stopped
    continues where it was; more repeats add to those that are there; a folder that holds another run is refused.

    \b
    pido experiment local-vs-global --data recordings/ --out results
    pido experiment ablation --data worn --data newer --repeats 30 --workers 4
    pido experiment ablation --data recordings/ --delivered --percent 10 --percent 40
    pido experiment concealed --cases 40 --seed 1 --workers 2 --out results
    pido experiment extended-equation --data recordings/aircut.csv
    pido experiment real-mismatch --data recordings/
    """
    import json

    from joblib import cpu_count

    from pido.cli.progress import Progress
    from pido.config import load_job
    from pido.experiments.places import folder_names
    from pido.experiments.runner import run_experiment
    from pido.reports.experiment import experiment_page
    from pido.reports.page import write_page

    _meaningful(ctx, name)
    if name in PROOFS:
        _prove(name, data, out / name, cases, seed, workers or cpu_count(), quick, resume, as_json, machine)
        return
    job = None if job_file is None else load_job(job_file)
    told = []
    for source, place in folder_names(data or ("worn",)).items():
        folder = out / name / place
        with Progress(f"{name}, {source}") as progress:
            result = run_experiment(
                name, source, folder=folder, repeats=repeats, seed=seed, workers=workers or cpu_count(),
                cluster=cluster, quick=quick, resume=resume, machine=machine, job=job, estimators=estimators,
                percents=percents, delivered=delivered, on_progress=progress,
            )  # fmt: skip
        outcome, fleet = result.outcome, result.fleet
        facts = (
            f"{fleet.name}: {len(fleet.sets)} sets, {sum(map(len, fleet.sets.values()))} rows, machine {fleet.machine.id}",  # noqa: E501
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
                    "tables": {t: json.loads(str(table.to_json(orient="records"))) for t, table, _ in tables},
                }
            )  # fmt: skip
            continue
        click.echo(f"{fleet.name}: {outcome.verdict}\n")
        for title, table, _ in tables[:3]:
            click.echo(f"{title}\n{table.to_string(index=False, float_format=lambda v: f'{v:.4g}')}\n")
    if as_json:
        click.echo(json.dumps(told, indent=1))


def _meaningful(ctx: click.Context, name: str) -> None:
    """Raises UsageError for an option that was given and means nothing for this experiment."""
    for param in ctx.command.params:
        of = OPTIONS_OF.get(param.name or "", NAMES)
        if name not in of and ctx.get_parameter_source(param.name or "") is not ParameterSource.DEFAULT:
            raise click.UsageError(f"{param.opts[0]} is an option of {', '.join(of)}, not of {name}.")


def _prove(
    name: str, data: tuple[str, ...], folder: Path, cases: int | None, seed: int, workers: int, quick: bool,
    resume: bool, as_json: bool, machine: str | None,
) -> None:  # fmt: skip
    """One of the tool's own proofs: run, page, tables."""
    import json
    import shutil

    from pido.cli.progress import Progress
    from pido.experiments.places import claim, folder_names, place_digest
    from pido.reports.experiment import experiment_page
    from pido.reports.page import write_page

    count = cases or (2 if quick else 300)
    run = {"experiment": name, "data": "sealed cases", "data_digest": "", "seed": seed}
    if name == "concealed":
        claim(folder, run | {"options": {"quick": quick, "cases": count}}, fresh=not resume)
    elif len(data) != 1:
        raise click.UsageError(f"{name} needs {NEEDS[name]}")
    elif Path(data[0]).exists():
        place = folder_names(data)[data[0]]
        run |= {"data": place, "data_digest": place_digest(data[0]), "options": {"quick": quick, "machine": machine}}
        folder = folder / place
        claim(folder, run, fresh=not resume)
    if not resume:
        shutil.rmtree(folder / "rows", ignore_errors=True)
    with Progress(name) as progress:
        if name == "concealed":
            from pido.experiments import concealed
            from pido.experiments.concealed_rivals import RIVALS

            solvers = concealed.solvers_named((concealed.TOOL, *(("lasso",) if quick else RIVALS)))
            table = concealed.run(
                concealed.plan(count, seed), folder, solvers=solvers, workers=workers, on_progress=progress
            )
            outcome, title = concealed.summarise(table), "Concealed effects"
            facts = [f"{count} cases, seed {seed}{', quick' if quick else ''}; all rows in cases.parquet"]
        elif name == "extended-equation":
            from pido.experiments import extended_equation

            outcome = extended_equation.run(
                Path(data[0]), machine=machine, quick=quick, seed=seed, on_progress=progress
            )
            title = "The extended equation"
            facts = [f"recordings in {Path(data[0]).name}, seed {seed}{', quick' if quick else ''}"]
        else:
            from pido.experiments import real_mismatch

            outcome = real_mismatch.run(Path(data[0]), quick=quick, seed=seed, on_progress=progress)
            title = "Real machines"
            facts = [f"recordings in {Path(data[0]).name}, seed {seed}"]
    tables = [(shown.title, shown.table, shown.text) for shown in outcome.tables]
    page = experiment_page(title, "proof of the mismatch finder", outcome.verdict, tables, outcome.differs, facts)
    write_page(page, folder / "report.html")
    click.echo(f"report: {folder / 'report.html'}", err=True)
    if as_json:
        told = {t: json.loads(str(table.to_json(orient="records"))) for t, table, _ in tables}
        click.echo(json.dumps({"experiment": name, "verdict": outcome.verdict, "tables": told}, indent=1))
        return
    click.echo(f"{outcome.verdict}\n")
    for shown, table, _ in tables:
        click.echo(f"{shown}\n{table.to_string(index=False)}\n")
