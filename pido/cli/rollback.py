"""`pido rollback`: bring the previous champion back."""

from __future__ import annotations

from pathlib import Path

import click

from pido.cli.places import (
    by_option,
    existing,
    follow,
    machine_option,
    one_machine,
    reason_option,
    show,
    workspace_option,
)  # fmt: skip


@click.command()
@by_option
@reason_option
@workspace_option
@machine_option
@click.option(
    "--mirror/--no-mirror", default=False, show_default=True, help="wait until MLflow's aliases have followed"
)
def command(by: str, reason: str, folder: Path, machine: str | None, mirror: bool) -> None:
    """Put the champion before the present one back in force, within a second; called again, the one before that.

    \b
    pido rollback --by "A. Ito" --reason "alarms since Tuesday" --workspace plant
    """
    from pido.tracking import promotion

    workspace = existing(folder)
    machine = one_machine(workspace, machine)
    show(promotion.rollback(workspace, machine, by=by, reason=reason))
    if mirror:
        follow(workspace, machine)
