"""`pido withdraw PART`: take a part out that was recorded or exported wrongly, and bring it back."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from pido.cli.places import by_option, existing, reason_option, workspace_option

if TYPE_CHECKING:
    from pido.tracking.audit import Record
    from pido.workspace import Workspace


@click.command()
@click.argument("part")
@by_option
@reason_option
@workspace_option
@click.option("--machine", default=None, help="needed where several machines have a part of this name")
@click.option("--undo", is_flag=True, help="bring a withdrawn part back")
def command(part: str, by: str, reason: str, folder: Path, machine: str | None, undo: bool) -> None:
    """Take PART (its name, or its digest) out of a workspace. Nothing is deleted.

    From then on it is not learnt from, judges no version and no limit of the monitor, and its alarms are closed.
    Another recording may be taken in under its name, the corrected one, or the same with a part.json that was corrected
    in material, tools, program or workpiece. Versions that have learnt from it cannot be approved; the next
    `pido iterate` trains without it. The decision stands in the audit log beside those on versions.

    \b
    pido withdraw p03 --by "A. Ito" --reason "exported in mA" --workspace plant
    pido withdraw p03 --undo --by "A. Ito" --reason "it was A after all" --workspace plant
    """
    from pido.withdrawal import reinstate, withdraw

    workspace = existing(folder)
    action = reinstate if undo else withdraw
    record, new = action(workspace, part, by=by, reason=reason, machine=machine)
    done = "brought back" if undo else "withdrawn" if new else "withdrawn already, and nothing was changed"
    what = f"{record.machine}: part {record.name} ({record.part[:12]})"
    click.echo(f"{what} {done}, by {record.by}, {record.at}: {record.reason}")
    for line in _what_follows(workspace, record, undo):
        click.echo(line)


def _what_follows(workspace: Workspace, record: Record, undo: bool) -> list[str]:
    from pido.tracking import promotion
    from pido.tracking.ledger import Ledger
    from pido.tracking.withdrawn import parts

    machine, ledger = record.machine, Ledger(workspace.ledger)
    left = parts(workspace, machine)
    today = ledger.iteration(workspace.run_key(machine, left)) if left else None
    if not left:
        following = "no part is left to train on"
    elif today is not None:
        following = f"version {today.version} was trained on just the parts that count now"
    else:
        following = f"the next `pido iterate` retrains {'with' if undo else 'without'} it"
    if undo:
        return [f"  {following}"]
    lines = [f"  another recording may be taken in as part {record.name}; its alarms are closed; {following}"]
    now = promotion.champion(workspace, machine)
    if now and now.version in promotion.trained_on_withdrawn(workspace, machine):
        kept = "stays in force until another one is approved, or `pido rollback`"
        lines.append(f"  version {now.version}, the champion, has learnt from it, and {kept}")
    return lines
