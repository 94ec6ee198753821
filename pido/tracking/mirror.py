"""MLflow's aliases brought up to what is in force: the registry in the workspace decides, MLflow follows.

In:  the standing of all versions of a machine.
Out: `champion` and `challenger` on the four registered models, and the state and gate of each version as tags.
Doing it twice changes nothing; a promoter that died half way is put right by the next call.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from pido.tracking.mlflow_store import client, model_names, not_installed
from pido.tracking.promotion import history, standings
from pido.workspace import Workspace

if TYPE_CHECKING:
    from mlflow import MlflowClient

log = logging.getLogger(__name__)
ALIASES = ("champion", "challenger")


def reconcile(workspace: Workspace, machine: str) -> None:
    """Make MLflow say what the workspace says. Raises what MLflow raises when it cannot be reached."""
    states = {str(s.version.version): s for s in standings(workspace, machine)}
    decided = {str(r.version): r for r in history(workspace, machine)}
    with client(workspace) as store:
        for name in model_names(machine).values():
            found = {v.tags.get("pido.version"): v for v in store.search_model_versions(f"name = '{name}'")}
            for number, version in found.items():
                if number in states:
                    gate = "passed" if states[number].version.gate.get("passed") else "not passed"
                    tags = {"pido.state": states[number].state, "pido.gate": gate}
                    if number in decided:
                        tags |= {"pido.decided_by": decided[number].by, "pido.reason": decided[number].reason}
                    _tag(store, name, version, tags)
            for alias in ALIASES:
                holder = [n for n, s in states.items() if s.state == alias and n in found]
                _point(store, name, alias, found[holder[-1]].version if holder else None)


def try_reconcile(workspace: Workspace, machine: str) -> str:
    """`reconcile`; returns '' or, where MLflow cannot be reached, why: the decision itself stands already."""
    if missing := not_installed():
        return missing
    from mlflow.exceptions import MlflowException

    try:
        reconcile(workspace, machine)
    except (MlflowException, OSError) as error:
        log.warning("MLflow's aliases of %s are not up to date: %s", machine, error)
        return str(error).splitlines()[0]
    return ""


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
