"""Approval from Prefect's pages: a form on a suspended run. The decision itself is the workspace's stored state.

In:  workspace, machine, version. Out: the same record as `pido approve` or `pido reject` writes, also on a page.

A suspended run holds no process; after the answer the flow starts again from its top, so everything before the form is
read-only. It waits 30 days (the default of an hour would fail it); a run that expires loses nothing, for the version
waits in the workspace. Where another champion went into force meanwhile, the version is judged again beside that one.
Do not combine it with an automation on missing heartbeats: a suspended run sends none.

Prefect holds an answer against the form before it takes it: one without a choice, a name or a reason is refused in the
form's own words, and the run goes on waiting. What would be refused afterwards is not offered: approval of a version
that may not be approved, or any decision where the worker lacks the credential.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from prefect import flow, get_run_logger
from prefect.artifacts import create_markdown_artifact
from prefect.client.schemas.objects import State
from prefect.flow_runs import suspend_flow_run
from prefect.input import RunInput
from prefect.states import Completed
from pydantic import Field

from flows.ownership import key
from flows.pages import in_markdown
from flows.submit import alive
from pido.approval import approve, doubts, refusal
from pido.core.errors import RegistryError
from pido.tracking import mirror, promotion
from pido.tracking.audit import Record
from pido.tracking.ledger import Version
from pido.workspace import Workspace, digest_of

WAIT_S = 30 * 86400
_SAID = r"\S"
"""Something is written there."""
_NAME = r"^[^\x00-\x1f\x7f-\x9f]*[^\s\x00-\x1f\x7f-\x9f][^\x00-\x1f\x7f-\x9f]*$"
"""The same, in one line."""


class Decision(RunInput):
    """What the form asks. Nothing is decided beforehand."""

    decision: Literal["approve", "reject"] = Field(description="reject is final: this version can never be approved")
    by: str = Field(description="your name", min_length=1, pattern=_NAME)
    reason: str = Field(description="why; it is kept with the decision", min_length=1, pattern=_SAID)


class Rejection(Decision):
    """The form of a version that may not be approved. An answer to one that offered more, before that was so, is read
    all the same."""

    decision: Literal["approve", "reject"] = Field(
        description=Decision.model_fields["decision"].description, json_schema_extra={"enum": ["reject"]}
    )


@flow(name="promote", flow_run_name="promote {machine} version {version}", persist_result=False)
def promote(workspace: str, machine: str, version: int) -> State:
    """Show the gate's words, wait for a person, write the decision down. A rejection is final."""
    place = Workspace.open(workspace)
    with alive(place):
        standing = {s.version.version: s for s in promotion.standings(place, machine)}.get(version)
        if standing is None:
            raise RegistryError(f"{machine} has no version {version}.")
        if standing.state == "champion":
            return _said(f"{machine}: version {version} is in force: there is nothing to decide.", place, machine)
        if standing.state == "rejected":
            return _said(
                f"{machine}: version {version} was rejected and stays so: nothing is left to decide.", place, machine
            )
        promotion.check_credential(place)
        refused = refusal(place, standing.version)
        asked = Rejection if refused else Decision
        # Waiting, the run has no process and holds no lock; answered, it has both again.
        answer = suspend_flow_run(
            wait_for_input=asked.with_initial_data(
                description=form(standing.version, refused, doubts(place, standing.version))
            ),
            timeout=WAIT_S,
            key=digest_of([machine, version])[:16],  # Prefect's keys take no spaces, slashes or umlauts
        )
        decide = approve if answer.decision == "approve" else promotion.reject
        record = decide(place, machine, version, by=answer.by, reason=answer.reason)
        if fault := mirror.try_reconcile(place, machine):
            get_run_logger().warning("The decision stands; MLflow's aliases will follow later: %s", fault)
        return _said(decided(record), place, machine)


def form(version: Version, refused: str, warned: Sequence[str] = ()) -> str:
    """What stands over the form, Markdown.

    refused : why approval is not offered, '' where it is; warned : what is to be known beside the gate's words
    """
    title = in_markdown(f"{version.machine}: version {version.version}")
    passed = [f"Gate passed: {in_markdown(version.gate.get('words', ''))}."] if version.gate.get("passed") else []
    may = f"Approval is not offered: {in_markdown(refused)}" if refused else "Approve puts it in force."
    final = "**Reject is final: a version that was rejected can never be approved.** To decide later, close this form."
    warnings = [f"Warning: {in_markdown(each)}." for each in warned]
    return "\n\n".join([f"# {title}", *passed, *warnings, may, final])


def decided(record: Record) -> str:
    """A decision in words.

    A version that was rejected before stays so, under the name of who did it.
    """
    what = "rejected for good" if record.action == "reject" else "in force"
    return f"{record.machine}: version {record.version} is {what}, decided by {record.by}, {record.at}: {record.reason}"


def _said(words: str, place: Workspace, machine: str) -> State:
    """Into the run's log, onto its page and into its state."""
    get_run_logger().info("%s", words)
    text = in_markdown(words)
    create_markdown_artifact(key=key(place, "decision", machine), markdown=text, description=text)
    return Completed(message=words)
