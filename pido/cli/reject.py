"""`pido reject`: refuse a version."""

from __future__ import annotations

from typing import Any

import click

from pido.cli.places import decide, decision


@click.command()
@click.argument("version", type=int)
@decision(wait=True)
def command(version: int, **asked: Any) -> None:
    """Refuse VERSION for good, also one that passed its gate.

    \b
    pido reject 7 --by "A. Ito" --reason "tool was worn" --workspace plant
    """
    from pido.tracking import promotion

    decide(promotion.reject, version, **asked)
