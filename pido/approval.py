"""Approval: what goes into force was compared with the champion that it replaces.

In:  a version that passed its gate, and a person's decision with name and reason.
Out: the record of the decision (`pido.tracking.promotion`).

A gate compares with the champion of its day. Where another one is in force by now, as behind a form that waited for
weeks, the version is judged again beside that one, and a person's word counts only if it passes.
"""

from __future__ import annotations

from pido.core.errors import RegistryError
from pido.tracking import promotion
from pido.tracking.audit import Record
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace


def approve(workspace: Workspace, machine: str, version: int, *, by: str, reason: str) -> Record:
    """Put `version` in force. Approving the champion again changes nothing.

    Raises RegistryError for what `promotion.approve` raises it for, and where the version does not pass beside the
    champion in force.
    """
    promotion.check_person(workspace, by, reason)
    now = promotion.champion(workspace, machine)
    found = promotion.version_of(workspace, machine, version)
    if now is not None and now.version != version and promotion.outdated(found, now):
        from pido.comparison import judge_again

        gate = judge_again(workspace, found)
        if not gate["passed"]:
            raise RegistryError(
                f"{machine} version {version} passed its gate {promotion.beside(workspace, found)}. Version "
                f"{now.version} is in force now, and beside that one it does not pass: {gate['words']}. Approve a "
                "version that was made since; `pido rollback` goes back to one that was in force."
            )
        Ledger(workspace.ledger).judged(machine, version, gate)
    return promotion.approve(workspace, machine, version, by=by, reason=reason)
