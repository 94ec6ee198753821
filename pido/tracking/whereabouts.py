"""Where a workspace's iterations were last logged: a shell that points elsewhere is told so, and makes no MLflow of its
own by the way.

In:  a workspace. Out: `mlflow.json` in it, MLflow's address without secrets; in words, what a shell has to be told.
"""

from __future__ import annotations

import json
from pathlib import Path

from pido.core.files import write_atomically
from pido.workspace import Workspace, without_secrets


def remember(workspace: Workspace) -> None:
    """MLflow where this process has it is where this workspace's iterations are."""
    now = {"place": workspace.tracking_place, "address": without_secrets(workspace.tracking_uri)}
    if _last(workspace) != now:
        write_atomically(_file(workspace), json.dumps(now))


def elsewhere(workspace: Workspace) -> tuple[str, str]:
    """(Address, place) of the server that the iterations were last logged at, where the environment of this process
    names another one or none; else ('', ''). What the settings name holds for every shell."""
    last = _last(workspace)
    place = last.get("place", "own")
    if workspace.settings.tracking_uri or place in ("own", workspace.tracking_place):
        return "", ""
    return last["address"], place


def named_nowhere(workspace: Workspace) -> str:
    """Why this process logs nothing, a sentence: iterations were last logged at a server, and neither settings nor
    environment of this process name any. '' where it logs."""
    address, _ = elsewhere(workspace)
    if not address or not workspace.tracks_alone:
        return ""
    return (
        f"Not logged from here: iterations are {words(address)}. Nothing is lost: a worker or watcher that knows that "
        "server logs it within a minute. `pido iterate --log-here` logs all of them in the workspace's own mlflow.db"
    )


def words(address: str) -> str:
    """What a shell that points elsewhere is told."""
    return (
        f"logged at {address}; this shell points elsewhere: export MLFLOW_TRACKING_URI={address} (and "
        "MLFLOW_TRACKING_USERNAME, MLFLOW_TRACKING_PASSWORD where it asks for them)"
    )


def _last(workspace: Workspace) -> dict[str, str]:
    try:
        last = json.loads(_file(workspace).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}  # never logged, or cut short on a full disk: the next iteration writes it again
    return last if isinstance(last, dict) and {"place", "address"} <= last.keys() else {}


def _file(workspace: Workspace) -> Path:
    return workspace.root / "mlflow.json"
