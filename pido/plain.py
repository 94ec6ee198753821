"""Iterations in this process, without a server: what `pido iterate` and the watcher without Prefect do.

In:  a workspace and paths. Out: what each iteration found; what was rejected, and why.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pido import departures, parts, production
from pido.arrivals import production_order
from pido.workspace import Workspace

Progress = Callable[[int, int, str], None]


def run(
    workspace: Workspace,
    paths: Sequence[Path],
    machine: str | None,
    progress: Progress,
    *,
    from_inbox: bool = False,
    patient: bool = False,
) -> dict[str, Any]:
    """One iteration per part, in production order: {'done', 'rejected', 'fault'}.

    from_inbox : arrivals are moved away when they are done, or into the rejected area; else files stay where they are,
        and one that is not at rest is among the rejected
    patient : what cannot be read may still be on its way (a slow copy that paused): leave it for a later look

    Raises UnavailableError or OSError where the workspace cannot be read or written now, SettingsError where its
    settings cannot be used: nothing is rejected for that.
    """
    root = str(workspace.root)
    done: list[dict[str, Any]] = []
    rejected: list[dict[str, str]] = []
    fault = ""
    order = sorted(paths, key=production_order)
    for number, path in enumerate(order):
        progress(number, len(order), path.name)
        try:
            arrived = parts.ingest(root, str(path), machine)
        except parts.Changed as changed:
            if not from_inbox:
                rejected.append({"path": str(path), "reason": str(changed)})
            continue  # in an inbox it is seen again when it has come to rest
        except parts.Refused as refused:
            if patient:
                continue
            departures.reject(workspace, path, refused.key, str(refused), move=from_inbox, machine=refused.machine)
            rejected.append({"path": str(path), "reason": str(refused)})
            continue
        key, fault, new = one(root, arrived["machine"], arrived["part"])
        done += [production.outcome(root, key)] if new else []
        if from_inbox:
            departures.put_away(workspace, path, arrived["key"])
    progress(len(order), len(order), "done")
    return {"done": done, "rejected": rejected, "fault": fault}


def retrain_all(workspace: Workspace, progress: Progress) -> dict[str, Any]:
    """Every machine's challenger brought up to its parts and settings, also when nothing arrived.

    Raises PidoError with each machine that failed, after all were tried.
    """
    root = str(workspace.root)
    waiting = production.machines(root)
    done: list[dict[str, Any]] = []

    def retrained(machine: str) -> None:
        progress(waiting.index(machine), len(waiting), machine)
        key, _, new = one(root, machine, None)
        done.extend([production.outcome(root, key)] if new else [])

    _, fault = production.every_machine(root, retrained, production.log)
    return {"done": done, "rejected": [], "fault": fault}


def one(root: str, machine: str, part: str | None) -> tuple[str, str, bool]:
    """All stages of one iteration inside the machine's lock: (its key, why MLflow has not got it yet or '', whether
    this state was new)."""
    with Workspace.open(root).lock(machine):
        key = production.begin(root, machine, part)
        new = not production.done(root, key)
        if new:
            for stage in production.STAGES:
                stage(root, key)
            production.clear(root, key)
        return key, production.log(root)["fault"], new
