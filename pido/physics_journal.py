"""The journal of accepted physics: every acceptance and revocation of a finding, one JSON line each.

In:  a workspace and a machine.
Out: entries, which of them are in force, and what the last iteration did with one. What a term is, `pido.accepted`
knows. The journal is sealed as the audit log is (`pido.tracking.seal`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from pido.core.errors import RegistryError
from pido.core.files import write_atomically
from pido.tracking.seal import check, seal, seal_of, whole_lines
from pido.workspace import Workspace

ACTIONS = ("accept", "revoke")


@dataclass(frozen=True)
class Entry:
    """A line of the journal. action : one of ACTIONS, or one that a later release knows; id : the same
    finding has the same one."""

    version: int
    action: str
    id: str
    axis: str
    mechanism: str
    by: str
    reason: str
    at: str
    term: dict[str, Any]
    equation: str
    model: str  # SHA-256 of the model.json that it comes from
    more: Mapping[str, Any] = field(default_factory=dict, hash=False)  # fields that a later release has written

    @property
    def term_name(self) -> str:
        """What it is called in equations, and where a run says with what it was trained."""
        return f"{self.axis} {self.mechanism} {self.id}"


def journal(workspace: Workspace, machine: str) -> list[Entry]:
    """All that was ever accepted and revoked, oldest first. RegistryError where it was changed outside the tool."""
    path = workspace.physics_journal(machine)
    sealed = seal_of(path)
    lines = whole_lines(path)
    check(path, sealed, lines)
    try:
        return [_entry(json.loads(line)) for line in lines]
    except (ValueError, TypeError, AttributeError):
        raise RegistryError(f"{path}: unreadable; bring it back from a backup.") from None


def _entry(written: Mapping[str, Any]) -> Entry:
    own = {one.name for one in fields(Entry)} - {"more"}
    more = {name: value for name, value in written.items() if name not in own}
    return Entry(**{name: value for name, value in written.items() if name in own}, more=more)


def in_force(entries: Sequence[Entry]) -> list[Entry]:
    """What was accepted and not revoked since, oldest first. Other actions, of a later release, decide nothing."""
    last = {e.id: e for e in entries if e.action in ACTIONS}
    return sorted((e for e in last.values() if e.action == "accept"), key=lambda e: e.version)


def outcome(entry: Entry, version: int, physics: Mapping[str, Any]) -> str:
    """What the iteration that made a version did with a finding in force. physics : as that iteration says it"""
    name = f"{entry.axis} {entry.mechanism}"
    if entry.term_name not in physics.get("accepted", []):
        return f"{name} is accepted; the next iteration tries it"
    error = physics.get("held_out", {}).get(entry.axis)
    held_out = f": {error['with']:.3g} A with it, {error['without']:.3g} A without, on rows held out" if error else ""
    if "in_equation" not in physics:  # an older version of the tool does not say
        return f"{name} is accepted, and was tried for version {version}{held_out}"
    if entry.term_name in physics["in_equation"]:
        return f"{name} extends the equation of version {version}{held_out}"
    return f"{name} is accepted, but the equation of version {version} does without it{held_out}"


def write(workspace: Workspace, machine: str, entries: Sequence[Entry]) -> None:
    """All entries, oldest first; the caller holds the machine's lock."""
    plain = [asdict(e) for e in entries]
    lines = [json.dumps(e.pop("more") | e, sort_keys=True) for e in plain]
    write_atomically(workspace.physics_journal(machine), "\n".join(lines) + "\n")
    seal(workspace.physics_journal(machine))
