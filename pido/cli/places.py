"""What the verbs of production share: the workspace, the machine, and how a decision is shown."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import click

from pido.core.errors import RegistryError
from pido.core.names import one_line
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
    help="folder with store, models and MLflow; `iterate` and `watch` make it",
)
machine_option = click.option("--machine", default=None, help="needed where a workspace holds several machines")
by_option = click.option("--by", required=True, help="who decides")
reason_option = click.option("--reason", required=True, help="why; goes into the audit log")


def decision(*, wait: bool) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """The options of a decision about a version; `wait`: whether MLflow's aliases are awaited unless asked not to."""
    mirror = click.option(
        "--mirror/--no-mirror", default=wait, show_default=True, help="wait until MLflow's aliases have followed"
    )

    def with_options(verb: Callable[..., None]) -> Callable[..., None]:
        for option in (mirror, machine_option, workspace_option, reason_option, by_option):
            verb = option(verb)
        return verb

    return with_options


def decide(
    action: Callable[..., Record], *version: int, folder: Path, machine: str | None, by: str, reason: str, mirror: bool
) -> None:
    """Take the decision, show what is in force now, and let MLflow follow."""
    workspace = existing(folder)
    machine = one_machine(workspace, machine)
    show(action(workspace, machine, *version, by=by, reason=reason))
    if mirror:
        follow(workspace, machine)


def existing(folder: Path) -> Workspace:
    """The workspace at `folder`; asking about one that is not there does not make it."""
    if not (folder / "ledger.db").exists():
        raise RegistryError(
            f"{folder}: no workspace here (no ledger.db). Name one with --workspace, or "
            f"make one by taking a part in: pido iterate PART --workspace {folder}"
        )
    return Workspace.open(folder)


def one_machine(workspace: Workspace, machine: str | None) -> str:
    """`machine`, or the only one of the workspace."""
    known = Ledger(workspace.ledger).machines()
    if machine is None and len(known) == 1:
        return known[0]
    if machine is None or machine not in known:
        raise RegistryError(
            f"{workspace.root}: {'several machines here' if machine is None else f'no machine {machine!r} here'}. "
            f"Name one with --machine. Known: {', '.join(known)}."
            if known
            else f"{workspace.root}: no machine has a part here yet. Bring one in: pido iterate PART"
        )
    return machine


def show(record: Record) -> None:
    """What is in force now, or what was refused."""
    by, reason = one_line(record.by), one_line(record.reason)
    if record.action == "reject":
        click.echo(f"{record.machine}: version {record.version} rejected by {by}: {reason}")
        return
    how = {"approve": "approved", "rollback": "rolled back"}[record.action]
    click.echo(f"{record.machine}: version {record.version} is champion ({how} by {by}, {record.at}: {reason})")


def follow(workspace: Workspace, machine: str) -> None:
    """MLflow's aliases after a decision. The decision stands whether or not MLflow can be reached."""
    from pido.tracking import mirror

    fault = mirror.try_reconcile(workspace, machine)
    if fault:
        click.echo(f"The decision stands; MLflow's aliases will follow later: {fault}", err=True)
