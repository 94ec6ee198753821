"""`pido reject`: refuse a version."""

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
    """Refuse VERSION for good, also one that passed its gate.

    \b
    pido reject 7 --by "A. Ito" --reason "tool was worn" --workspace plant
    """
    from pido.tracking import promotion

    workspace = existing(folder)
    machine = one_machine(workspace, machine)
    show(promotion.reject(workspace, machine, version, by=by, reason=reason))
    if mirror:
        follow(workspace, machine)
