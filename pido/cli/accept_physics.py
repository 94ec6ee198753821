"""`pido accept-physics DIAGNOSIS --finding AXIS:MECHANISM`."""

from __future__ import annotations

from pathlib import Path

import click

from pido.cli.inputs import Input
from pido.cli.places import by_option, existing, machine_option, one_machine, reason_option, workspace_option


@click.command(name="accept-physics")
@click.argument("diagnosis", required=False, type=Input(file_okay=False))
@click.option("--finding", metavar="AXIS:MECHANISM", help="which finding; or its number in diagnosis.json, from 1")
@click.option("--revoke", metavar="ID", help="take an accepted finding out of force")
@by_option
@reason_option
@workspace_option
@machine_option
def command(
    diagnosis: Path | None,
    finding: str | None,
    revoke: str | None,
    by: str,
    reason: str,
    folder: Path,
    machine: str | None,
) -> None:
    """Extend the physical equation of a machine with a finding: the next iterations fit and generate with it.

    DIAGNOSIS is the folder that `pido diagnose --out` wrote, or a workspace's diagnosis/MACHINE.

    Refused, with exit code 1, is what the equation has already: a term of its own (inertia, Coulomb and viscous
    friction of the axis), whose size each iteration fits, or the same mechanism on the same axis, also the same finding
    again, until that is revoked. Refused is also what follows from more than a generated row has, and that is nothing
    but the 13 inputs and the direction of motion: a place along the travel, a time, what was before, an effect without
    a name. Apply that to parts by `pido correct`. The diagnosis' report.html offers what can be accepted, and says why
    the rest cannot.

    Every acceptance and revocation is a line of the workspace's journal. `pido iterate` without parts retrains at once,
    and says what the extended equation gained or lost on rows left out; the run in MLflow says so too.

    \b
    pido accept-physics diagnosis --finding x:stribeck_friction --by "A. Ito" --reason "on 3 parts" --workspace plant
    pido accept-physics --revoke 1f0c22ab --by "A. Ito" --reason "guideway was replaced" --workspace plant
    """
    from pido import accepted

    if revoke is not None and (diagnosis is not None or finding is not None):
        raise click.UsageError("give DIAGNOSIS and --finding, or --revoke ID")
    workspace = existing(folder)
    machine = one_machine(workspace, machine)
    if revoke is not None:
        entry = accepted.revoke(workspace, machine, revoke, by=by, reason=reason)
    elif diagnosis is not None and finding is not None:
        which = int(finding) if finding.isdecimal() else finding
        entry = accepted.accept(workspace, machine, diagnosis, which, by=by, reason=reason)
    else:
        raise click.UsageError("give DIAGNOSIS and --finding, or --revoke ID")
    click.echo(f"{entry.id}   {machine} {entry.axis} {entry.mechanism}   {entry.action}, version {entry.version}")
