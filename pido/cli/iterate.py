"""`pido iterate`: one production iteration for each part, in this process, without a server."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pido.cli.inputs import Input
from pido.cli.places import workspace_option

if TYPE_CHECKING:
    from pido.workspace import Workspace


@click.command()
@click.argument("paths", nargs=-1, type=click.Path(path_type=Path))
@workspace_option
@click.option("--machine", default=None, help="machine of recordings that do not name theirs")
@click.option("--job", type=Input(dir_okay=False), help="what is cut with what")
@click.option("--air-cut", is_flag=True, default=None, help="parts without process quantities were cut in air")
@click.option("--seed", type=click.IntRange(min=0), default=None, help="of everything that draws at random")
@click.option(
    "--log-here",
    is_flag=True,
    help="where nothing names the server of before: log in the workspace",
)
@click.option("--json", "as_json", is_flag=True, help="for a machine to read")
def command(
    paths: tuple[Path, ...],
    folder: Path,
    machine: str | None,
    job: Path | None,
    air_cut: bool | None,
    seed: int | None,
    log_here: bool,
    as_json: bool,
) -> None:
    """Refit, balance, retrain, evaluate and log, once per part of PATHS; without PATHS, retrain on the known parts.

    A part that is known already costs nothing. What cannot be used is put into the rejected area with its reason, and
    the others go on; the exit code is then 1. What --machine, --job, --air-cut and --seed say is written into the
    workspace when it is made, and holds for all its parts.

    \b
    pido iterate parts/p01 parts/p02 --workspace plant
    pido iterate capture.json --job jobs/gear.toml --workspace plant
    """
    from pido.core.errors import InputError
    from pido.workspace import Workspace

    if not paths and not any((folder / name).exists() for name in ("ledger.db", "workspace.toml")):
        raise InputError(
            f"{folder}: no workspace here, so there is nothing to retrain on. Name one with --workspace, or make one "
            f"by taking a part in: pido iterate PART --workspace {folder}"
        )
    if paths and not any(os.path.lexists(path) for path in paths):
        raise InputError("\n".join(f"{path}: no such file or folder. Name a part that is there." for path in paths))
    for path in paths:
        if folder.resolve().is_relative_to(path.resolve()):
            raise InputError(f"{path}: holds the workspace {folder}, which changes. Put one beside the other.")
    workspace = Workspace.make(folder, job=job, machine=machine, air_cut=air_cut, seed=seed)
    if log_here:
        from pido.tracking import whereabouts

        whereabouts.remember(workspace)
    waiting = [path for path in paths if not _known(workspace, path)]
    if paths and not waiting:
        _say({"done": [], "known": len(paths), "rejected": []}, as_json)
        return
    from pido.cli.progress import Progress
    from pido.plain import retrain_all, run
    from pido.production import machines

    with Progress("iterating") as progress:
        answer = run(workspace, waiting, machine, progress) if paths else retrain_all(workspace, progress)
    answer["known"] = len(paths) - len(waiting)
    if not paths and not machines(str(workspace.root)):
        answer["nothing"] = "no part was taken in yet: bring one with `pido iterate PART`"
    _say(answer, as_json)
    if answer["rejected"]:
        raise SystemExit(1)


def _known(workspace: Workspace, path: Path) -> bool:
    """Whether this arrival went through an iteration, and the state of its machine is up to date. Nothing heavy is
    imported to find out."""
    from pido.core.errors import StoreError
    from pido.tracking import whereabouts
    from pido.tracking.ledger import Ledger
    from pido.tracking.withdrawn import parts
    from pido.workspace import arrival_digest

    if not workspace.ledger.exists():
        return False
    ledger = Ledger(workspace.ledger)
    try:
        arrival = ledger.arrival(arrival_digest(path))
    except StoreError:
        return False  # `run` says what is wrong with it
    if arrival is None or arrival.part is None:
        return False
    machine = ledger.machine_of(arrival.part)
    counted = [] if machine is None else parts(workspace, machine)
    if machine is None or arrival.part not in counted:
        return False  # `run` does it, or says that it was withdrawn
    done = ledger.iteration(workspace.run_key(machine, counted)) is not None
    place = whereabouts.elsewhere(workspace)[1] if workspace.tracks_alone else ""
    return done and not ledger.not_logged(place or workspace.tracking_place)


def _say(answer: dict[str, Any], as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps(answer, indent=1, sort_keys=True))
        return
    for one in answer["done"]:
        click.echo(f"{one['part']['name']}   {one['machine']} version {one['version']}, {one['n_parts']} part(s)")
        for axis, measured in one["metrics"].items():
            said = "   ".join(f"{name} {m['rmse']:.4g}" for name, m in measured.items())
            click.echo(f"  {axis:<3} RMSE in A: {said}")
        for words in one.get("physics", {}).get("words", []):
            click.echo(f"  {words}")
        click.echo(f"  gate: {one['gate']['words']}")
        if one.get("withdrawn"):
            click.echo(f"  trained without what is withdrawn: {', '.join(one['withdrawn'])}")
    if answer["known"]:
        click.echo(f"{answer['known']} part(s) known already: nothing to do")
    if not (answer["done"] or answer["known"] or answer["rejected"]):
        click.echo(answer.get("nothing", "nothing new since the last training: nothing to do"))
    for one in answer["rejected"]:
        click.echo(f"rejected {one['path']}: {one['reason'].removeprefix(one['path'] + ': ')}", err=True)
    if answer.get("fault"):
        click.echo(answer["fault"], err=True)
