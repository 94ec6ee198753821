"""Approval: what goes into force was compared with the champion that it replaces.

In:  a version that passed its gate, and a person's decision with name and reason.
Out: the record of the decision (`pido.tracking.promotion`); for whoever asks people, why there would be none.

A gate compares with the champion of its day. Where another one is in force by now, as behind a form that waited for
weeks, the version is judged again beside that one, and a person's word counts only if it passes. Nor does it count
while the parts that the gate judged by are full of alarms that nobody has answered.
"""

from __future__ import annotations

from typing import Any

from pido.core.errors import PidoError, RegistryError
from pido.tracking import promotion
from pido.tracking.audit import Record
from pido.tracking.ledger import Ledger, Version
from pido.workspace import Workspace


def approve(workspace: Workspace, machine: str, version: int, *, by: str, reason: str) -> Record:
    """Put `version` in force. Approving the champion again changes nothing.

    Raises RegistryError for what `promotion.approve` raises it for, where the version does not pass beside the
    champion in force, and where the parts of its gate are full of open alarms.
    """
    promotion.check_person(workspace, by, reason)
    found = promotion.version_of(workspace, machine, version)
    if gate := _beside_the_champion(workspace, found):
        Ledger(workspace.ledger).judged(machine, version, gate)
    _check_alarms(workspace, found)
    return promotion.approve(workspace, machine, version, by=by, reason=reason)


def refusal(workspace: Workspace, version: Version) -> str:
    """Why `approve` would refuse `version` as things stand, whoever asks; '' where it would not. Nothing is written."""
    try:
        promotion.check_version(workspace, version)
        _check_alarms(workspace, version)
        _beside_the_champion(workspace, version)
    except PidoError as error:
        return str(error)
    return ""


def doubts(workspace: Workspace, version: Version) -> list[str]:
    """What whoever approves `version` is to know beside the gate's words: open alarms as of now, errors beyond all."""
    from pido.comparison import alarms_now

    return [*alarms_now(workspace, version)[1], *version.gate.get("doubts", ())]


def _check_alarms(workspace: Workspace, version: Version) -> None:
    now = promotion.champion(workspace, version.machine)
    in_force = now is not None and now.version == version.version
    if in_force or not version.gate.get("passed") or not workspace.book(version.machine).exists():
        return
    from pido.comparison import alarms_now

    if why := alarms_now(workspace, version)[0]:
        raise RegistryError(why)


def _beside_the_champion(workspace: Workspace, version: Version) -> dict[str, Any] | None:
    """The gate beside the champion in force, where `version` passed its own beside another one.

    Raises RegistryError where it does not pass.
    """
    now = promotion.champion(workspace, version.machine)
    if now is None or now.version == version.version or not promotion.outdated(version, now):
        return None
    from pido.comparison import judge_again

    gate = judge_again(workspace, version)
    if not gate["passed"]:
        raise RegistryError(
            f"{version.machine} version {version.version} passed its gate {promotion.beside(workspace, version)}. "
            f"Version {now.version} is in force now, and beside that one it does not pass: {gate['words']}. Approve a "
            "version that was made since; `pido rollback` goes back to one that was in force."
        )
    return gate
