"""Approval from Prefect's pages: a form on a suspended run. The decision itself is the workspace's stored state.

In:  workspace, machine, version. Out: the same record as `pido approve` or `pido reject` writes.

A suspended run holds no process; after the answer the flow starts again from its top, so everything before the form is
read-only. It waits 30 days (the default of an hour would fail it); a run that expires loses nothing, for the version
waits in the workspace. Where another champion went into force meanwhile, the version is judged again beside that one.
Do not combine it with an automation on missing heartbeats: a suspended run sends none.
"""

from __future__ import annotations

from typing import Any

from prefect import flow
from prefect.flow_runs import suspend_flow_run
from prefect.input import RunInput

from flows.submit import alive
from pido.approval import approve
from pido.core.errors import RegistryError
from pido.tracking import mirror, promotion
from pido.workspace import Workspace, digest_of

WAIT_S = 30 * 86400


class Decision(RunInput):
    """What the form asks."""

    approve: bool
    by: str
    reason: str


@flow(name="promote", flow_run_name="promote {machine} version {version}")
def promote(workspace: str, machine: str, version: int) -> dict[str, Any]:
    """Show the gate's words, wait for a person, write the decision down."""
    place = Workspace.open(workspace)
    with alive(place):
        standing = {s.version.version: s for s in promotion.standings(place, machine)}.get(version)
        if standing is None:
            raise RegistryError(f"{machine} has no version {version}.")
        if standing.state == "champion":
            return {"machine": machine, "version": version, "action": "approve"}
        gate = standing.version.gate
        verdict = "passed" if gate.get("passed") else "NOT passed"
        page = f"# {machine}: version {version}\n\nGate {verdict}. {gate.get('words', '')}"
        # Waiting, the run has no process and holds no lock; answered, it has both again.
        answer = suspend_flow_run(
            wait_for_input=Decision.with_initial_data(description=page, approve=False, by="", reason=""),
            timeout=WAIT_S,
            key=digest_of([machine, version])[:16],  # Prefect's keys take no spaces, slashes or umlauts
        )
        decide = approve if answer.approve else promotion.reject
        record = decide(place, machine, version, by=answer.by, reason=answer.reason)
        mirror.try_reconcile(place, machine)
        return {"machine": machine, "version": version, "action": record.action}
