"""The worker of a workspace as a process of its own, for tests with a real Prefect server."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from flows.server import die_with_parent, stop
from pido.workspace import Workspace

OFFERED = {
    "new-part/arrivals", "retrain/on-request", "nightly/nightly", "diagnose/newest", "promote/approval",
    "experiment/on-request",
}  # fmt: skip


@contextmanager
def served(workspace: Workspace, log: Path, client: Any, **environment: str) -> Iterator[None]:
    """Flows of `workspace` served, all of them on offer, while the block runs. `client`: Prefect's, of the server."""
    from flows import ownership

    def ready() -> bool:
        ours = [name for name, d in offered(client).items() if ownership.tag(workspace.root) in d.tags]
        return {name.removesuffix(f"-{workspace.id}") for name in ours} >= OFFERED

    own = {**os.environ, "PREFECT_RUNNER_POLL_FREQUENCY": "1", **environment}
    with log.open("wb") as out:
        worker = subprocess.Popen(
            [sys.executable, "-m", "flows.serve", "--workspace", str(workspace.root)],
            env=own, stdout=out, stderr=out, start_new_session=True, preexec_fn=die_with_parent,
        )  # fmt: skip

    def running() -> None:
        assert worker.poll() is None, log.read_text()[-2000:]

    try:
        waited(ready, 120, running)
        yield
    finally:
        stop(worker)


def offered(client: Any) -> dict[str, Any]:
    """Flow/deployment -> deployment."""
    flows = {f.id: f.name for f in client.read_flows()}
    return {f"{flows[d.flow_id]}/{d.name}": d for d in client.read_deployments()}


def waited(look: Callable[[], Any], patience_s: float, check: Callable[[], None] = lambda: None) -> Any:
    """What `look` returns once it is true."""
    end = time.monotonic() + patience_s
    while not (found := look()):
        check()
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.5)
    return found
