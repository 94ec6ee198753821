"""Diagnoses that were asked for and are not done: what `pido status` says of them, and which are asked for again.

In:  a workspace, a machine, what the diagnosis is of (parts, settings, code). Out: one file per machine in the
workspace's `wanted/`, which goes when the diagnosis is done.

Prefect knows of runs, this of wishes: a run that was killed, or that nobody could be asked for, leaves the wish behind.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from pido.core.errors import StoreError
from pido.core.files import write_atomically
from pido.core.names import file_name
from pido.workspace import Workspace

FOLDER = "wanted"


@dataclass(frozen=True, slots=True)
class Wanted:
    """of : parts, settings and code; asked : a run was asked for; again : how often once more, because one was lost
    run : id of the flow run that has begun, '' before; fault : why it ended without an answer, '' where it did not"""

    machine: str
    of: tuple[str, ...]
    asked: bool = False
    again: int = 0
    run: str = ""
    fault: str = ""


def wanted(workspace: Workspace) -> list[Wanted]:
    """All of a workspace, by machine."""
    files = sorted((workspace.root / FOLDER).glob("*.json"))
    found = [one for file in files if (one := _read(file)) is not None]
    return sorted(found, key=lambda one: one.machine)


def of_machine(workspace: Workspace, machine: str) -> Wanted | None:
    """What is wanted of this machine, None where nothing is."""
    return _read(_file(workspace, machine))


def wish(workspace: Workspace, machine: str, of: list[str]) -> None:
    """A diagnosis is wanted now. A run that is at work on the same stays known."""

    def change(old: Wanted | None) -> Wanted:
        at_work = old is not None and old.of == tuple(of) and not lost(workspace, old)
        return Wanted(machine, tuple(of), run=old.run if old is not None and at_work else "")

    _change(workspace, machine, change)


def asked(workspace: Workspace, machine: str, instead_of: str | None = None) -> None:
    """A run was asked for. instead_of : the one that was lost, '' where it had not begun; None where none was lost"""

    def change(old: Wanted | None) -> Wanted | None:
        if old is None:
            return None
        run = "" if old.run == instead_of else old.run  # the new one may have begun by now
        return replace(old, asked=True, again=old.again + (instead_of is not None), run=run)

    _change(workspace, machine, change)


def begun(workspace: Workspace, machine: str, of: list[str], run: str) -> None:
    """The flow run `run` is at work on it, whoever has asked for it."""

    def change(old: Wanted | None) -> Wanted:
        again = old.again if old is not None and old.of == tuple(of) else 0
        return Wanted(machine, tuple(of), asked=True, again=again, run=run)

    _change(workspace, machine, change)


def failed(workspace: Workspace, machine: str, of: list[str] | tuple[str, ...], fault: str) -> None:
    """It ended without an answer for a reason that another try would meet again."""

    def change(old: Wanted | None) -> Wanted | None:
        return replace(old, fault=fault) if old is not None and old.of == tuple(of) else old

    _change(workspace, machine, change)


def done(workspace: Workspace, machine: str, of: list[str] | tuple[str, ...]) -> None:
    """It is done; what was wished for meanwhile, of other parts, stays wanted."""
    _change(workspace, machine, lambda old: None if old is None or old.of == tuple(of) else old)


def lost(workspace: Workspace, one: Wanted) -> bool:
    """Whether its run has begun, and nobody is at work on it any more."""
    return bool(one.run) and not one.fault and not workspace.locked(f"run {one.run}")


def words(workspace: Workspace, one: Wanted) -> str:
    """How it stands with it and what to do, as words that follow the machine's name."""
    start = "start `diagnose` on Prefect's page Deployments, with this machine"
    if one.fault:
        return f"failed, and is not tried again before the next part: {one.fault}. To try it sooner, {start}"
    if not lost(workspace, one):
        return (
            "at work" if one.run else "asked for, and not begun" if one.asked else "wanted; nobody could be asked yet"
        )
    if one.again:
        return (
            "its process was killed, also when it was asked for again (memory, perhaps): it is not asked for before "
            f"the next part. To try it sooner, {start}"
        )
    return "its process was killed while it ran; `pido watch --prefect`, which the plant runs, asks for it once more"


def _file(workspace: Workspace, machine: str) -> Path:
    return workspace.root / FOLDER / f"{file_name(machine)}.json"


def _read(file: Path) -> Wanted | None:
    try:
        said = json.loads(file.read_text(encoding="utf-8"))
        return Wanted(**{**said, "of": tuple(said["of"])})
    except FileNotFoundError:
        return None
    except (ValueError, TypeError, KeyError):
        raise StoreError(f"{file}: damaged. Delete it: the next part's iteration asks for a diagnosis anew.") from None


def _change(workspace: Workspace, machine: str, change: Callable[[Wanted | None], Wanted | None]) -> None:
    file = _file(workspace, machine)
    with workspace.lock(f"wanted {machine}"):
        old = _read(file)
        new = change(old)
        if new is None:
            file.unlink(missing_ok=True)
        elif new != old:
            write_atomically(file, json.dumps(asdict(new)))
