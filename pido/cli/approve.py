"""`pido approve`: put a version in force."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from pido.cli.places import decide, decision

if TYPE_CHECKING:
    from pido.tracking.audit import Record
    from pido.workspace import Workspace


@click.command()
@click.argument("version", type=int)
@decision(wait=True)
def command(version: int, **asked: Any) -> None:
    """Promote VERSION, which passed its gate: its four models, equation and limits go into force in one step.

    Where another champion is in force than its gate compared it with, it is judged again beside that one first.

    \b
    pido approve 7 --by "A. Ito" --reason "three good parts" --workspace plant
    """
    decide(_informed, version, **asked)


def _informed(workspace: Workspace, machine: str, version: int, **who: str) -> Record:
    """Approve, and say what the gate's words may not have said."""
    from pido.approval import approve, doubts
    from pido.tracking.promotion import version_of

    record = approve(workspace, machine, version, **who)
    for doubt in doubts(workspace, version_of(workspace, machine, version)):
        click.echo(f"warning: {doubt}", err=True)
    return record
