"""`pido report`: pages for people, one self-contained HTML file each."""

from __future__ import annotations

from pathlib import Path

import click

from pido.cli.inputs import Input
from pido.cli.outputs import Output
from pido.cli.places import existing, machine_option, one_machine, workspace_option

out_option = click.option("--out", required=True, type=Output(dir_okay=False), help="HTML file")


@click.group()
def command() -> None:
    """Write the page of an iteration, a plan, a monitored part or an experiment: one file that opens offline.

    `pido diagnose` writes the page of a diagnosis itself.

    \b
    pido report iteration --workspace plant --out iteration.html
    pido report monitor p07 --workspace plant --out p07.html
    """


@command.command(short_help="Did the models get better, and what was generated.")
@click.option("--version", type=int, help="of the models; the newest where it is left out")
@workspace_option
@machine_option
@out_option
def iteration(version: int | None, folder: Path, machine: str | None, out: Path) -> None:
    """Did the models get better, where were data missing, what was generated, and what does the gate say.

    \b
    pido report iteration --workspace plant --version 7 --out iteration.html
    """
    from pido.core.errors import RegistryError
    from pido.reports.iteration import iteration_page
    from pido.reports.page import write_page
    from pido.tracking import report_files
    from pido.tracking.fate import fate
    from pido.tracking.ledger import Ledger

    workspace = existing(folder)
    machine = one_machine(workspace, machine)
    done = Ledger(workspace.ledger).iterations(machine)
    chosen = [one for one in done if version is None or one.version == version]
    if not chosen:
        known = ", ".join(str(one.version) for one in done)
        raise RegistryError(f"{machine} has no version {version}. Versions: {known or 'none yet'}.")
    files = report_files.load(workspace.runs, chosen[-1].run_key)
    earlier = [one.summary for one in done[: done.index(chosen[-1]) + 1]]
    became = fate(workspace, machine, chosen[-1].version)
    write_page(iteration_page(files, chosen[-1].version, earlier, became), out)
    click.echo(out)


@command.command(short_help="Recorded and expected currents of a part, and its alarms.")
@click.argument("part")
@workspace_option
@click.option("--machine", default=None, help="machine of a recording that does not name its own")
@click.option("--tolerate", type=click.FloatRange(0, 100, min_open=True, max_open=True), default=1.0, show_default=True,
              help="false alarms per 100 good parts, all axes together")  # fmt: skip
@out_option
def monitor(part: str, folder: Path, machine: str | None, tolerate: float, out: Path) -> None:
    """Recorded and expected currents of PART, the band and the alarms. PART as in `pido monitor`.

    \b
    pido report monitor parts/p07 --workspace plant --out p07.html
    """
    from pido.reports.monitor import monitor_page
    from pido.reports.page import write_page
    from pido.supervision.part import monitor as judge

    write_page(monitor_page(judge(existing(folder), part, machine=machine, tolerate=tolerate)), out)
    click.echo(out)


@command.command(short_help="What a coming part needs; of a plan made before.")
@click.argument("plan", type=Input())
@out_option
def plan(plan: Path, out: Path) -> None:
    """The page of a plan that was made before: PLAN is its plan.json, or the folder that holds it.

    \b
    pido report plan plan/plan.json --out plan.html
    """
    import json

    from pido.core.errors import SettingsError
    from pido.reports.page import write_page
    from pido.reports.plan import ELSEWHERE, is_rows, plan_page

    file = plan / "plan.json" if plan.is_dir() else plan
    why = ""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        why = "no such file" if isinstance(error, FileNotFoundError) else f"not readable as JSON: {error}"
    else:
        if not (
            isinstance(content, dict)
            and "part" in content
            and is_rows(content.get("bins"))
            and isinstance(content.get(ELSEWHERE, 0), int)
        ):
            why = "not a plan: it needs a part, and bins with their numbers"
    if why:
        raise SettingsError(f"{file}: {why}. `pido plan PROGRAM --out FOLDER` writes plan.json.")
    rows, part = content.pop("bins"), str(content.pop("part"))
    write_page(plan_page(part, rows, "", content, content.get(ELSEWHERE, 0)), out)
    click.echo(out)


@command.command(short_help="An experiment that was run before.")
@click.argument("result", type=Input(file_okay=False))
@out_option
def experiment(result: Path, out: Path) -> None:
    """The page of an experiment that was run before: RESULT is the folder that `pido experiment` wrote.

    \b
    pido report experiment experiments/local-vs-global --out local-vs-global.html
    """
    from pido.core.errors import SettingsError
    from pido.core.files import write_atomically

    others = ("diagnosis.json", "plan.json")  # whose pages have the same name
    pages = sorted(p for p in result.rglob("report.html") if not any((p.parent / other).exists() for other in others))
    if len(pages) != 1:
        found = ", ".join(str(page.parent) for page in pages) or "none"
        raise SettingsError(
            f"{result}: must hold the page of one experiment, as `pido experiment` writes it; found: {found}."
        )
    write_atomically(out.absolute(), pages[0].read_bytes())
    click.echo(out)
