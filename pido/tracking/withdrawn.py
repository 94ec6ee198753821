"""Which parts count: all that went through an iteration, without those that somebody withdrew.

In:  the audit log and the ledger. Out: digests, and the decision that took each of the others out.

The audit log decides; the store's list of parts follows it (`pido.withdrawal.settle`). Light, and nothing is written:
`pido status` asks it of a workspace on a disk that cannot be written.
"""

from __future__ import annotations

from pido.tracking import audit
from pido.tracking.audit import Record
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace

WITHDRAW, REINSTATE = "withdraw", "reinstate"


def withdrawn(workspace: Workspace, machine: str) -> dict[str, Record]:
    """By digest: the decision by which a part is out now, oldest first."""
    last = {r.part: r for r in audit.read(workspace.decisions(machine)) if r.action in audit.PARTS}
    gone = sorted((r for r in last.values() if r.action == WITHDRAW), key=lambda r: r.number)
    return {r.part: r for r in gone}


def parts(workspace: Workspace, machine: str) -> list[str]:
    """Digests of the parts that count, in the order of arrival."""
    gone = withdrawn(workspace, machine)
    return [digest for digest in Ledger(workspace.ledger).parts(machine) if digest not in gone]
