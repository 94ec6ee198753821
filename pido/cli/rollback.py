"""`pido rollback`: bring the previous champion back."""

from __future__ import annotations

from typing import Any

import click

from pido.cli.places import decide, decision


@click.command()
@decision(wait=False)
def command(**asked: Any) -> None:
    """Put the champion before the present one back in force, within a second; called again, the one before that.

    What was rejected since, or trained with physics that was revoked since, is passed over.

    \b
    pido rollback --by "A. Ito" --reason "alarms since Tuesday" --workspace plant
    """
    from pido.tracking import promotion

    decide(promotion.rollback, **asked)
