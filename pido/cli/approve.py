"""`pido approve`: put a version in force."""

from __future__ import annotations

from pathlib import Path

import click

from pido.cli.places import (
    by_option,
    existing,
    follow,
    machine_option,
    mirror_option,
    one_machine,
    reason_option,
    show,
    workspace_option,
)  # fmt: skip


@click.command()
@click.argument("version", type=int)
@by_option
@reason_option
@workspace_option
@machine_option
@mirror_option
def command(version: int, by: str, reason: str, folder: Path, machine: str | None, mirror: bool) -> None:
    """Promote VERSION, which passed its gate: its four models, equation and limits go into force in one step.

    \b
    pido approve 7 --by "A. Ito" --reason "three good parts" --workspace plant
    """
    from pido.tracking import promotion

    workspace = existing(folder)
    machine = one_machine(workspace, machine)
    show(promotion.approve(workspace, machine, version, by=by, reason=reason))
    if mirror:
        follow(workspace, machine)
