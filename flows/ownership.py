"""Whose is what on a Prefect server that several workspaces share.

In:  a workspace. Out: its tag, which its deployments carry and their runs inherit; its deployments by flow; what the
names of its deployments end with, and the keys of its artifacts.
"""

from __future__ import annotations

from pathlib import Path

from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.client.schemas.filters import (
    DeploymentFilter,
    DeploymentFilterName,
    DeploymentFilterTags,
    FlowFilter,
    FlowFilterName,
)
from prefect.client.schemas.responses import DeploymentResponse

from flows import pages
from pido.core.errors import PidoError
from pido.workspace import Workspace, WorkspaceSettings

ARRIVALS, FIRST = "new-part", "arrivals"
"""The flow of arrivals, and the name of its deployment."""
_TAG = "workspace:"


class NotServedError(PidoError):
    """No worker has offered the flow for this workspace on this server."""


def tag(root: Path | str) -> str:
    """Of all that belongs to the workspace at `root`."""
    # Its folder alone: settings that cannot be read do not hinder anyone who asks for a run.
    return _TAG + Workspace(Path(root), WorkspaceSettings()).id


def deployment(client: SyncPrefectClient, root: Path | str, flow: str) -> DeploymentResponse:
    """The workspace's own deployment of a flow. Raises NotServedError where no worker has offered it yet."""
    found = _deployments(client, flow, DeploymentFilter(tags=DeploymentFilterTags(all_=[tag(root)])))
    if not found:
        raise NotServedError(f"no worker serves {flow} for {root}")
    return found[0]


def named(client: SyncPrefectClient, flow: str, name: str) -> DeploymentResponse | None:
    """A deployment by flow and name, or None."""
    found = _deployments(client, flow, DeploymentFilter(name=DeploymentFilterName(any_=[name])))
    return found[0] if found else None


def ending(client: SyncPrefectClient, workspace: Workspace) -> str:
    """What the names of this workspace's deployments end with: nothing for the first on a server, else its id.

    A name that it has there stays. Deployments without any workspace's tag are those of the folder that they name.
    """
    known = _known_ending(client, workspace)
    if known is not None:
        return known
    for first in _deployments(client, ARRIVALS, DeploymentFilter(name=DeploymentFilterName(any_=[FIRST]))):
        if any(t.startswith(_TAG) for t in first.tags) or first.parameters.get("workspace") != str(workspace.root):
            return f"-{workspace.id}"
    return ""


def key(workspace: Workspace, kind: str, machine: str = "") -> str:
    """Under which Prefect lists all artifacts of a kind (about a machine), apart from those of other workspaces.

    It ends as the names of the workspace's deployments do. Without any it ends with the id: nothing on the server says
    then which workspace is the first.
    """
    with get_client(sync_client=True) as client:
        known = _known_ending(client, workspace)
    return pages.key(kind, machine) + (f"-{workspace.id}" if known is None else known)


def _known_ending(client: SyncPrefectClient, workspace: Workspace) -> str | None:
    """What the names of its deployments end with, None where no worker has offered any."""
    own = DeploymentFilter(tags=DeploymentFilterTags(all_=[tag(workspace.root)]))
    known = _deployments(client, ARRIVALS, own)
    return known[0].name.removeprefix(FIRST) if known else None


def _deployments(client: SyncPrefectClient, flow: str, which: DeploymentFilter) -> list[DeploymentResponse]:
    wanted = FlowFilter(name=FlowFilterName(any_=[flow]))
    return client.read_deployments(flow_filter=wanted, deployment_filter=which)
