"""The worker: one process that serves the flows of a workspace - arrivals, retraining, diagnosis, approval, trials.

In:  a workspace, and `PREFECT_API_URL`. Out: runs, each in a process of its own. Each kind of work has slots of its
own, so that a part waits for no diagnosis, and a decision for nothing: arrivals of two machines at a time (iterations
of one machine wait for each other at the workspace's lock), one diagnosis, three of night, retraining, experiments.

What an operator pauses on Prefect's pages stays so when the worker starts again; only the times of the night follow the
settings.
"""

from __future__ import annotations

import asyncio
import logging
import os
import threading
import time
from pathlib import Path
from typing import Any

import click
from prefect import Flow
from prefect.client.orchestration import get_client
from prefect.client.schemas.actions import DeploymentScheduleCreate
from prefect.client.schemas.responses import DeploymentResponse
from prefect.client.schemas.schedules import CronSchedule
from prefect.runner import Runner

from flows import ownership
from flows.diagnose import diagnose_newest
from flows.experiment import experiment
from flows.new_part import new_part, nightly, retrain_machine
from flows.promote import promote
from flows.submit import AT_ONCE
from flows.warm import start_warm
from pido.workspace import Workspace

BEAT_S = 15.0
MACHINES = 2
"""Whose arrivals are worked on at a time. Of each, AT_ONCE runs are asked for (`flows.submit`): one at work, and one
that waits for it with next to no memory of its own."""


@click.command()
@click.option("--workspace", "folder", type=click.Path(file_okay=False, path_type=Path), required=True)
def main(folder: Path) -> None:
    """Serve the flows of one workspace until stopped.

    \b
    PREFECT_API_URL=http://127.0.0.1:4200/api python -m flows.serve --workspace plant
    """
    workspace = Workspace.open(folder)
    os.environ.setdefault("PREFECT_LOGGING_EXTRA_LOGGERS", "pido")  # what the library says is in the run's log as well
    threading.Thread(target=_beat, args=(workspace.root / "worker.alive",), daemon=True).start()
    start_warm()
    # Each poll says how many runs wait for a slot: of parts that wait for their turn, a line each second.
    logging.getLogger("prefect.runner").addFilter(lambda record: "at capacity" not in record.getMessage())
    arrivals, decisions, diagnoses, others = (_runner(limit) for limit in (AT_ONCE * MACHINES, None, 1, 3))
    offered: list[tuple[Flow[..., Any], str, Runner, str | None]] = [
        (new_part, ownership.FIRST, arrivals, None),
        (promote, "approval", decisions, None),
        (diagnose_newest, "newest", diagnoses, None),
        (retrain_machine, "on-request", others, None),
        (nightly, "nightly", others, os.environ.get("PIDO_NIGHTLY", "0 3 * * *")),
        (experiment, "on-request", others, None),
    ]
    own: dict[str, Any] = {"parameters": {"workspace": str(workspace.root)}, "tags": [ownership.tag(workspace.root)]}
    with get_client(sync_client=True) as client:
        ending = ownership.ending(client, workspace)
        for flow, name, runner, cron in offered:
            known = ownership.named(client, flow.name, f"{name}{ending}")
            times: dict[str, Any] = {"cron": cron} if known is None else _as_left(known, cron)
            runner.add_flow(flow, f"{name}{ending}", **own, **times)
        for flow, *_ in offered:  # two that were first at the same moment: one of them starts again as the second
            ownership.deployment(client, workspace.root, flow.name)
    asyncio.run(_serve(arrivals, decisions, diagnoses, others))


def _runner(limit: int | None) -> Runner:
    # Not paused while the worker is away: what is asked for meanwhile waits for it.
    return Runner(limit=limit, pause_on_shutdown=False)


async def _serve(*runners: Runner) -> None:
    """All of them until stopped; where one fails, none goes on."""
    async with asyncio.TaskGroup() as together:
        for runner in runners:
            together.create_task(runner.start())


def _as_left(known: DeploymentResponse, cron: str | None) -> dict[str, Any]:
    """Whether a deployment and its schedules are paused, and which there are, as the operator has left it; `cron`
    alone follows the settings."""
    schedules = []
    for left in known.schedules:
        same = DeploymentScheduleCreate(
            schedule=left.schedule, active=left.active, max_scheduled_runs=left.max_scheduled_runs,
            parameters=left.parameters, slug=left.slug,
        )  # fmt: skip
        if cron is not None and isinstance(same.schedule, CronSchedule):
            same.schedule.cron = cron
        schedules.append(same)
    return {"paused": known.paused, "schedules": schedules}


def _beat(path: Path) -> None:
    """A sign of life for health checks."""
    while True:
        path.touch()
        time.sleep(BEAT_S)


if __name__ == "__main__":
    main()
