"""The worker: one process that serves the flows of a workspace - arrivals, retraining, diagnosis, approval, trials.

In:  a workspace, and `PREFECT_API_URL`. Out: runs, each in a process of its own, at most three at a time (a second
machine need not wait for the first, nor a part for a diagnosis; iterations of one machine wait for each other at the
workspace's lock).
"""

from __future__ import annotations

import asyncio
import os
import threading
import time
from pathlib import Path
from typing import Any

import click
from prefect import Flow
from prefect.client.orchestration import get_client
from prefect.runner import Runner

from flows import ownership
from flows.diagnose import diagnose_newest
from flows.experiment import experiment
from flows.new_part import new_part, nightly, retrain_machine
from flows.promote import promote
from flows.warm import start_warm
from pido.workspace import Workspace

BEAT_S = 15.0


@click.command()
@click.option("--workspace", "folder", type=click.Path(file_okay=False, path_type=Path), required=True)
def main(folder: Path) -> None:
    """Serve the flows of one workspace until stopped.

    \b
    PREFECT_API_URL=http://127.0.0.1:4200/api python -m flows.serve --workspace plant
    """
    workspace = Workspace.open(folder)
    threading.Thread(target=_beat, args=(workspace.root / "worker.alive",), daemon=True).start()
    start_warm()
    offered: list[tuple[Flow[..., Any], str, dict[str, Any]]] = [
        (new_part, ownership.FIRST, {}),
        (retrain_machine, "on-request", {}),
        (nightly, "nightly", {"cron": os.environ.get("PIDO_NIGHTLY", "0 3 * * *")}),
        (diagnose_newest, "newest", {}),
        (promote, "approval", {}),
        (experiment, "on-request", {}),
    ]
    own = {"parameters": {"workspace": str(workspace.root)}, "tags": [ownership.tag(workspace.root)]}
    # Not paused while the worker is away: what is asked for meanwhile waits for it.
    runner = Runner(limit=3, pause_on_shutdown=False)
    with get_client(sync_client=True) as client:
        ending = ownership.ending(client, workspace)
        for flow, name, more in offered:
            runner.add_flow(flow, f"{name}{ending}", **own, **more)
        for flow, _, _ in offered:  # two that were first at the same moment: one of them starts again as the second
            ownership.deployment(client, workspace.root, flow.name)
    asyncio.run(runner.start())


def _beat(path: Path) -> None:
    """A sign of life for health checks."""
    while True:
        path.touch()
        time.sleep(BEAT_S)


if __name__ == "__main__":
    main()
