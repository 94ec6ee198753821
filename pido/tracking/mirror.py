"""MLflow's aliases brought up to what is in force: the registry in the workspace decides, MLflow follows.

In:  the standing of all versions of a machine.
Out: `champion` and `challenger` on the four registered models, and the state and gate of each version as tags.
Doing it twice changes nothing; a promoter that died half way is put right by the next call.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pido.core.files import write_atomically
from pido.core.names import file_name
from pido.tracking.ledger import Ledger
from pido.tracking.mlflow_store import BUNDLE, VERSION, client, ending, model_names, not_installed
from pido.tracking.promotion import history, standings
from pido.tracking.whereabouts import elsewhere, words
from pido.workspace import Workspace, digest_of

if TYPE_CHECKING:
    from mlflow import MlflowClient

ALIASES = ("champion", "challenger")


def reconcile(workspace: Workspace, machine: str) -> None:
    """Make MLflow say what the workspace says. Raises what MLflow raises when it cannot be reached."""
    with workspace.lock(f"mirror {machine}"):
        # Read inside the lock: of two that come at once, the later one brings the newer state.
        _follow(workspace, machine)


def behind(workspace: Workspace, machine: str) -> bool:
    """Whether a version or decision has changed since MLflow was last told. No server is asked."""
    try:
        return _mark(workspace, machine).read_text(encoding="utf-8") != _state(workspace, machine)
    except FileNotFoundError:
        return True


def up_to_date(workspace: Workspace) -> bool:
    """Whether MLflow has been told every iteration and every decision. No server is asked."""
    ledger = Ledger(workspace.ledger)
    return not ledger.not_logged(workspace.tracking_place) and not any(
        behind(workspace, machine) for machine in ledger.machines()
    )


def _follow(workspace: Workspace, machine: str) -> None:
    told = _state(workspace, machine)
    # The bundle as well as the number: older versions of several workspaces may have registered under one name.
    states = {(str(s.version.version), s.version.bundle): s for s in standings(workspace, machine)}
    decided = {(str(r.version), r.bundle): r for r in history(workspace, machine)}
    with client(workspace) as store:
        for name in model_names(machine, ending(workspace, store, machine)).values():
            registered = store.search_model_versions(f"name = '{name}'")
            found = {(v.tags.get(VERSION, ""), v.tags.get(BUNDLE, "")): v for v in registered}
            for which, version in found.items():
                if which in states:
                    gate = "passed" if states[which].version.gate.get("passed") else "not passed"
                    tags = {"pido.state": states[which].state, "pido.gate": gate}
                    if which in decided:
                        tags |= {"pido.decided_by": decided[which].by, "pido.reason": decided[which].reason}
                    _tag(store, name, version, tags)
            for alias in ALIASES:
                holder = [which for which, s in states.items() if s.state == alias and which in found]
                _point(store, name, alias, found[holder[-1]].version if holder else None)
    write_atomically(_mark(workspace, machine), told)


def try_reconcile(workspace: Workspace, machine: str) -> str:
    """`reconcile`; returns '' or, where MLflow cannot be reached or this process points elsewhere, why: the decision
    itself stands already."""
    if missing := not_installed():
        return missing
    if address := elsewhere(workspace)[0]:
        return words(address)
    from mlflow.exceptions import MlflowException

    try:
        reconcile(workspace, machine)
    except (MlflowException, OSError) as error:
        return str(error).splitlines()[0]
    return ""


def _mark(workspace: Workspace, machine: str) -> Path:
    return workspace.registry / file_name(machine) / "mirrored"


def _state(workspace: Workspace, machine: str) -> str:
    """Digest of what MLflow is to say, and of where."""
    versions = [(s.version.version, s.state) for s in standings(workspace, machine)]
    decisions = [r.hash for r in history(workspace, machine)]
    return digest_of([workspace.tracking_uri, versions, decisions])


def _tag(store: MlflowClient, name: str, version, tags: dict[str, str]) -> None:
    for key, value in tags.items():
        if version.tags.get(key) != value:
            store.set_model_version_tag(name, version.version, key, value)


def _point(store: MlflowClient, name: str, alias: str, version: str | None) -> None:
    models = store.search_registered_models(f"name = '{name}'")
    if not models:
        return
    now = models[0].aliases.get(alias)
    if version is None and now is not None:
        store.delete_registered_model_alias(name, alias)
    elif version is not None and str(now) != str(version):
        store.set_registered_model_alias(name, alias, version)
