"""Which version is in force, and the decisions that changed it.

In:  a version whose gate was passed, and a person's decision with name and reason.
Out: `registry/<machine>/champion.json`, replaced in one rename. It names one bundle, so four models, equation, limits
     and data digest move together or not at all. It carries its own audit record: if the process dies between the
     rename and the log, the next call completes the log from it.

A human may refuse what the gate let through; a gate that was not passed cannot be waived. No server is needed, and
MLflow's aliases follow afterwards (`pido.tracking.mirror`).
"""

from __future__ import annotations

import hashlib
import hmac
import json
import os
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from pido.core.clock import utc_now
from pido.core.errors import RegistryError, SettingsError
from pido.core.files import write_atomically
from pido.core.names import file_name, one_line
from pido.physics_journal import in_force, journal
from pido.store import Store
from pido.tracking import audit
from pido.tracking.audit import Record
from pido.tracking.bundle import Bundle, load, verify
from pido.tracking.ledger import Ledger, Version
from pido.tracking.withdrawn import parts, withdrawn
from pido.workspace import Workspace

TOKEN = "PIDO_APPROVAL_TOKEN"


@dataclass(frozen=True, slots=True)
class Standing:
    """A version and what became of it: champion, challenger, superseded, rejected, former champion."""

    version: Version
    state: str


def champion(workspace: Workspace, machine: str) -> Record | None:
    """The decision that is in force, or None while nothing was ever approved."""
    path = _pointer(workspace, machine)
    if not path.exists():
        return None
    try:
        return Record.of(path.read_bytes())
    except json.JSONDecodeError:
        raise RegistryError(f"{path}: unreadable; bring it back from a backup.") from None
    except ValueError as error:
        raise RegistryError(
            f"{path}: {error}, so it was changed outside the tool; bring it back from a backup."
        ) from None


def champion_bundle(workspace: Workspace, machine: str) -> Bundle | None:
    """The bundle in force, every byte of it checked, or None."""
    record = champion(workspace, machine)
    return None if record is None else verify(load(workspace.bundles, record.bundle))


def standings(workspace: Workspace, machine: str) -> list[Standing]:
    """All versions of a machine with what became of them, oldest first."""
    versions = Ledger(workspace.ledger).versions(machine)
    now = champion(workspace, machine)
    last = {r.version: r.action for r in history(workspace, machine) if r.action in audit.VERSIONS}
    today = current(workspace, machine)

    def state(v: Version) -> str:
        if now and now.version == v.version:
            return "champion"
        if last.get(v.version) == "reject":
            return "rejected"
        if v.version in last:
            return "former champion"
        return "challenger" if v == today else "superseded"

    return [Standing(v, state(v)) for v in versions]


def current(workspace: Workspace, machine: str) -> Version | None:
    """The version of today's parts, settings and physics, whatever was trained after it. Where none was trained for
    them yet, the newest without physics that is revoked and parts that are withdrawn; None where there is none."""
    ledger = Ledger(workspace.ledger)
    versions = {v.version: v for v in ledger.versions(machine)}
    try:
        today = ledger.iteration(workspace.run_key(machine, parts(workspace, machine)))
    except (SettingsError, OSError):
        today = None  # settings that cannot be read have no version; `pido iterate` says what is wrong with them
    if today is not None:
        return versions[today.version]
    out = trained_on_revoked(workspace, machine).keys() | trained_on_withdrawn(workspace, machine).keys()
    return next((v for number, v in reversed(versions.items()) if number not in out), None)


def trained_on_revoked(workspace: Workspace, machine: str) -> dict[int, list[str]]:
    """Versions that were trained with physics that is not in force, and which."""
    entries = journal(workspace, machine)
    if not entries:
        return {}
    now = {entry.term_name for entry in in_force(entries)}
    without: dict[int, list[str]] = {}
    for one in Ledger(workspace.ledger).iterations(machine):
        gone = sorted(set(one.summary.get("physics", {}).get("accepted", [])) - now)
        # The same models may come out of several iterations: physics that changed nothing is not in them.
        without[one.version] = min(gone, without.get(one.version, gone), key=len)
    return {version: gone for version, gone in without.items() if gone}


def trained_on_withdrawn(workspace: Workspace, machine: str) -> dict[int, list[str]]:
    """Versions that have learnt from parts that are withdrawn, and from which, by name."""
    gone = withdrawn(workspace, machine)
    if not gone:
        return {}
    found: dict[int, list[str]] = {}
    for version in Ledger(workspace.ledger).versions(machine):
        # A bundle that somebody has cleared away is approved by nobody.
        there = (workspace.bundles / version.bundle).exists()
        of_it = load(workspace.bundles, version.bundle).content.get("parts", []) if there else []
        learnt = set(Store(workspace.store).today(of_it).values())
        if names := [record.name for digest, record in gone.items() if digest in learnt]:
            found[version.version] = names
    return found


def about_part(
    workspace: Workspace, action: str, machine: str, part: str, *, name: str, by: str, reason: str
) -> Record:
    """Put a decision about a part on record. What follows from it is the caller's (`pido.withdrawal`)."""
    with _deciding(workspace, machine):
        _recover(workspace, machine)
        path = _log(workspace, machine)
        record = audit.next_record(
            path, action=action, machine=machine, part=part, name=name, by=by, reason=reason, at=utc_now()
        )
        audit.append(path, record)
        return record


def history(workspace: Workspace, machine: str) -> list[Record]:
    """All decisions on a machine's versions and parts, oldest first; the chain is checked."""
    return _complete(audit.read(_log(workspace, machine)), champion(workspace, machine))


def approve(workspace: Workspace, machine: str, version: int, *, by: str, reason: str) -> Record:
    """Put `version` in force. Approving the champion again changes nothing.

    Raises RegistryError if there is no such version, its gate was not passed, or passed beside another champion than
    the one in force (`pido.approval` judges it again), it was rejected or trained with physics that is revoked or on a
    part that is withdrawn, its bundle is damaged, or the credential is wrong.
    """
    check_person(workspace, by, reason)
    with _deciding(workspace, machine):
        _recover(workspace, machine)
        found = version_of(workspace, machine, version)
        now = champion(workspace, machine)
        if now and now.version == version:
            return now
        check_version(workspace, found)
        if now and outdated(found, now):
            raise RegistryError(
                f"{machine} version {version} passed its gate {beside(workspace, found)}, and version {now.version} is "
                f"in force now. `pido approve {version}` judges it beside that one first."
            )
        return _put_in_force(workspace, "approve", found, by, reason)


def check_version(workspace: Workspace, version: Version) -> None:
    """Raises RegistryError where nobody may approve `version`: its gate was not passed, it was rejected or trained with
    physics that is revoked or on a part that is withdrawn, or its bundle is damaged."""
    named, number = f"{version.machine} version {version.version}", version.version
    if not version.gate.get("passed"):
        raise RegistryError(
            f"{named} did not pass its gate and is not approved: {version.gate.get('words', '')}"
            ". A failed gate cannot be waived; the next parts bring a new version."
        )
    if any(r.version == number and r.action == "reject" for r in history(workspace, version.machine)):
        raise RegistryError(f"{named} was rejected and stays so; approve another version.")
    if gone := trained_on_revoked(workspace, version.machine).get(number):
        raise RegistryError(
            f"{named} was trained with physics that is revoked: {', '.join(gone)}. `pido iterate` trains without it, "
            "or finds the version that was, and `pido status` says which that is."
        )
    if gone := trained_on_withdrawn(workspace, version.machine).get(number):
        raise RegistryError(
            f"{named} has learnt from what is withdrawn: part {', '.join(gone)}. `pido iterate` trains without it, or "
            "finds the version that was, and `pido status` says which that is."
        )
    verify(load(workspace.bundles, version.bundle))


def outdated(version: Version, now: Record | None) -> bool:
    """Whether a gate was passed beside another champion than the one in force. Old gates may not say beside which."""
    gate = version.gate
    return now is not None and bool(gate.get("passed")) and gate.get("champion", now.bundle) != now.bundle


def beside(workspace: Workspace, version: Version) -> str:
    """In words, which champion the gate of `version` compared it with."""
    versions = Ledger(workspace.ledger).versions(version.machine)
    known = [v.version for v in versions if v.bundle == version.gate["champion"]]
    return f"beside version {known[0]}" if known else "while nothing was in force"


def reject(workspace: Workspace, machine: str, version: int, *, by: str, reason: str) -> Record:
    """Refuse `version` for good. The champion is not rejected but rolled back."""
    check_person(workspace, by, reason)
    with _deciding(workspace, machine):
        _recover(workspace, machine)
        found = version_of(workspace, machine, version)
        now = champion(workspace, machine)
        if now and now.version == version:
            raise RegistryError(f"{machine} version {version} is the champion: use `pido rollback` to take it out.")
        for record in history(workspace, machine):
            if record.version == version and record.action == "reject":
                return record
        record = _record(workspace, "reject", found, by, reason)
        audit.append(_log(workspace, machine), record)
        return record


def rollback(workspace: Workspace, machine: str, *, by: str, reason: str) -> Record:
    """Put the champion before the present one back in force; called again, the one before that. What was rejected
    since, or trained with physics that was revoked or on parts that were withdrawn since, is passed over.

    Raises RegistryError where none is left, its bundle is damaged, or the credential is wrong.
    """
    check_person(workspace, by, reason)
    with _deciding(workspace, machine):
        _recover(workspace, machine)
        past = history(workspace, machine)
        *before, now = _in_force_one_after_another(past) or [0]
        no_more = {
            "rejected since": {r.version for r in past if r.action == "reject"},
            "physics revoked since": set(trained_on_revoked(workspace, machine)),
            "parts withdrawn since": set(trained_on_withdrawn(workspace, machine)),
        }
        left = [v for v in before if v != now and not any(v in versions for versions in no_more.values())]
        if not left:
            found = {why: sorted(versions.intersection(before) - {now}) for why, versions in no_more.items()}
            said = "; ".join(f"{why}: version {', '.join(map(str, v))}" for why, v in found.items() if v)
            raise RegistryError(
                f"{machine}: there is no champion before the present one to go back to{f' ({said})' if said else ''}. "
                "Another version that passed its gate takes its place: pido approve VERSION."
            )
        found = version_of(workspace, machine, left[-1])
        verify(load(workspace.bundles, found.bundle))
        return _put_in_force(workspace, "rollback", found, by, reason)


def _in_force_one_after_another(past: list[Record]) -> list[int]:
    """The champions up to the present one, without those that a rollback took out again."""
    stack: list[int] = []
    for record in past:
        if record.action == "approve":
            stack.append(record.version)
        elif record.action == "rollback":
            stack.pop()
            while stack[-1] != record.version:
                stack.pop()
    return stack


def _deciding(workspace: Workspace, machine: str) -> AbstractContextManager[None]:
    """One decision at a time. Not the iteration's lock: a rollback does not wait until models are trained."""
    return workspace.lock(f"decisions {machine}", timeout_s=30.0)


def _put_in_force(workspace: Workspace, action: str, version: Version, by: str, reason: str) -> Record:
    record = _record(workspace, action, version, by, reason)
    write_atomically(_pointer(workspace, version.machine), json.dumps(record.plain(), sort_keys=True, indent=1))
    audit.append(_log(workspace, version.machine), record)
    return record


def _recover(workspace: Workspace, machine: str) -> None:
    """Complete the log where a process died between replacing the pointer and writing the record."""
    now = champion(workspace, machine)
    path = _log(workspace, machine)
    if now and now not in audit.read(path):
        audit.append(path, now)


def _complete(records: list[Record], now: Record | None) -> list[Record]:
    if now is None or now in records:
        return records
    if now.previous != (records[-1].hash if records else audit.GENESIS):
        raise RegistryError(
            f"{now.machine}: champion and audit log do not belong together; bring both back from a backup."
        )
    return [*records, now]


def _record(workspace: Workspace, action: str, version: Version, by: str, reason: str) -> Record:
    return audit.next_record(
        _log(workspace, version.machine),
        action=action,
        machine=version.machine,
        version=version.version,
        bundle=version.bundle,
        by=by,
        reason=reason,
        at=utc_now(),
    )


def version_of(workspace: Workspace, machine: str, version: int) -> Version:
    """A version by its number. RegistryError lists those that there are where it is not one of them."""
    known = {v.version: v for v in Ledger(workspace.ledger).versions(machine)}
    if version not in known:
        raise RegistryError(
            f"{machine} has no version {version}. Versions: {', '.join(map(str, known)) or 'none yet'}."
        )
    return known[version]


def check_person(workspace: Workspace, by: str, reason: str) -> None:
    """Raises RegistryError without a name in one line and a reason, or without the credential where the workspace asks
    for one."""
    if one_line(by) != by:
        raise RegistryError(f"--by {one_line(by)!r}: a name is one line, without control characters.")
    if not by.strip() or not reason.strip():
        raise RegistryError("A decision needs who made it and why: give --by and --reason.")
    check_credential(workspace)


def check_credential(workspace: Workspace) -> None:
    """Raises RegistryError without the credential where the workspace asks for one."""
    wanted = workspace.settings.approval_token_sha256
    given = hashlib.sha256(os.environ.get(TOKEN, "").encode()).hexdigest()
    if wanted and not hmac.compare_digest(wanted, given):
        raise RegistryError(f"This workspace asks for a credential: set {TOKEN} to the token that was handed out.")


def _pointer(workspace: Workspace, machine: str) -> Path:
    return workspace.registry / file_name(machine) / "champion.json"


def _log(workspace: Workspace, machine: str) -> Path:
    return workspace.decisions(machine)
