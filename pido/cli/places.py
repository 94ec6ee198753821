"""What the verbs of production share: the workspace, the machine, and how a decision is shown."""

from __future__ import annotations

from pathlib import Path

import click

from pido.core.errors import RegistryError
from pido.tracking.audit import Record
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

workspace_option = click.option(
    "--workspace",
    "-w",
    "folder",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("plant"),
    show_default=True,
    envvar="PIDO_WORKSPACE",
    help="folder with store, models and MLflow; made if it is not there",
)
machine_option = click.option("--machine", default=None, help="needed where a workspace holds several machines")
by_option = click.option("--by", required=True, help="who decides")
reason_option = click.option("--reason", required=True, help="why; goes into the audit log")
mirror_option = click.option(
    "--mirror/--no-mirror", default=True, show_default=True, help="bring MLflow's aliases up to date afterwards"
)


def existing(folder: Path) -> Workspace:
    """The workspace at `folder`; asking about one that is not there does not make it."""
    if not (folder / "ledger.db").exists():
        raise RegistryError(f"{folder}: no workspace here (no ledger.db). Name one with --workspace.")
    return Workspace.open(folder)


def one_machine(workspace: Workspace, machine: str | None) -> str:
    """`machine`, or the only one of the workspace."""
    known = Ledger(workspace.ledger).machines()
    if machine is None and len(known) == 1:
        return known[0]
    if machine is None or machine not in known:
        raise RegistryError(
            f"{workspace.root}: {'name a machine' if machine is None else f'machine {machine!r} is not known here'} "
            f"with --machine. Known: {', '.join(known) or 'none yet'}."
        )
    return machine


def show(record: Record) -> None:
    """What is in force now, or what was refused."""
    if record.action == "reject":
        click.echo(f"{record.machine}: version {record.version} rejected by {record.by}: {record.reason}")
        return
    how = {"approve": "approved", "rollback": "rolled back"}[record.action]
    click.echo(
        f"{record.machine}: version {record.version} is champion ({how} by {record.by}, {record.at}: {record.reason})"
    )


def follow(workspace: Workspace, machine: str) -> None:
    """MLflow's aliases after a decision. The decision stands whether or not MLflow can be reached."""
    from pido.tracking import mirror

    fault = mirror.try_reconcile(workspace, machine)
    if fault:
        click.echo(f"MLflow's aliases will follow later: {fault}", err=True)
