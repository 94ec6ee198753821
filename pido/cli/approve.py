"""`pido approve`: put a version in force."""

from __future__ import annotations

from typing import Any

import click

from pido.cli.places import decide, decision


@click.command()
@click.argument("version", type=int)
@decision(wait=True)
def command(version: int, **asked: Any) -> None:
    """Promote VERSION, which passed its gate: its four models, equation and limits go into force in one step.

    Where another champion is in force than its gate compared it with, it is judged again beside that one first.

    \b
    pido approve 7 --by "A. Ito" --reason "three good parts" --workspace plant
    """
    from pido.approval import approve

    decide(approve, version, **asked)
