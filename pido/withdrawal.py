"""A part is taken out again: it was recorded, exported or named wrongly.

In:  a part of a workspace, and a person's decision with name and reason.
Out: its record in the audit log; the store's list of parts without it.

Nothing is deleted. From then on the part is not learnt from, judges no version and no limit, its alarms are closed, and
another recording may be taken in under its name; a version that has learnt from it is not approved any more, nor what
it said of other parts used. `reinstate` brings it back.

The log is written first, and the store follows it. Who dies in between leaves a decision that the next call, or the
next iteration, carries out.
"""

from __future__ import annotations

from collections.abc import Iterable

from pido.core.errors import StoreError
from pido.store import Entry, Store
from pido.tracking import promotion
from pido.tracking.audit import Record
from pido.tracking.withdrawn import REINSTATE, WITHDRAW, withdrawn
from pido.workspace import Workspace

_SHORTEST = 8
"""Digits by which a digest may be named."""
_NAMED = 20


def withdraw(
    workspace: Workspace, part: str, *, by: str, reason: str, machine: str | None = None
) -> tuple[Record, bool]:
    """(The decision, whether it is new). A part that is out stays out, under the name of who took it out.

    part : name or digest
    Raises StoreError for a part that is not there, RegistryError as approval does for want of a name, a reason or the
    credential.
    """
    promotion.check_person(workspace, by, reason)
    settle(workspace)
    store = Store(workspace.store)
    found = _one(part, store.entries(machine)) or _one(part, store.withdrawn(machine))
    if found is None:
        raise _unknown(workspace, part, store.entries(machine))
    if known := withdrawn(workspace, found.machine).get(found.digest):
        return known, False
    record = promotion.about_part(
        workspace, WITHDRAW, found.machine, found.digest, name=found.part, by=by, reason=reason
    )
    store.withdraw(found.digest)
    return record, True


def reinstate(
    workspace: Workspace, part: str, *, by: str, reason: str, machine: str | None = None
) -> tuple[Record, bool]:
    """(The decision, whether it is new). Raises StoreError where the part was not withdrawn, or another recording has
    its name by now; RegistryError as `withdraw`."""
    promotion.check_person(workspace, by, reason)
    settle(workspace)
    store = Store(workspace.store)
    found = _one(part, store.withdrawn(machine))
    if found is None:
        if there := _one(part, store.entries(machine)):
            raise StoreError(f"part '{there.part}' of machine '{there.machine}' is not withdrawn: nothing to undo.")
        raise _unknown(workspace, part, store.withdrawn(machine))
    # The store first: it knows whether the name is free. Undone by `settle` as long as the log does not say so.
    store.reinstate(found.digest)
    return promotion.about_part(
        workspace, REINSTATE, found.machine, found.digest, name=found.part, by=by, reason=reason
    ), True


def settle(workspace: Workspace, machine: str | None = None) -> None:
    """Bring the store's list of parts (of one machine) up to the audit log, where a process died between the two."""
    store = Store(workspace.store)
    is_out = {entry.digest for entry in store.withdrawn(machine)}
    machines = {entry.machine for entry in (*store.entries(machine), *store.withdrawn(machine))}
    said = {digest for each in machines for digest in withdrawn(workspace, each)}
    for digest in sorted(said - is_out):
        store.withdraw(digest)
    for digest in sorted(is_out - said):
        store.reinstate(digest)


def _one(part: str, entries: Iterable[Entry]) -> Entry | None:
    found = [e for e in entries if part == e.part or (len(part) >= _SHORTEST and e.digest.startswith(part))]
    if len(found) > 1:
        several = ", ".join(f"{e.digest[:12]} of {e.machine}" for e in found)
        raise StoreError(f"'{part}' is {several}: name one by its digest, or its machine with --machine.")
    return found[0] if found else None


def _unknown(workspace: Workspace, part: str, entries: Iterable[Entry]) -> StoreError:
    names = [entry.part for entry in entries]
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return StoreError(
        f"{workspace.root}: no part '{part}' here. Known: {', '.join(names[-_NAMED:]) or 'none'}{more}. A part is "
        "named as its part.json names it, or by its digest."
    )
