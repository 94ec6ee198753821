"""An arrival leaves the inbox: taken, or rejected with its reason, and only as the one that it was.

In:  a path, and the digest under which what lay there was read. Out: that arrival in `taken/` or in the rejected area.

A control may deliver under one name again and again, also while an iteration runs. So an arrival first gets a place of
its own beside the inbox' names, where nobody delivers to, and is looked at there: another one goes back. What a killed
process has left in such a place goes back too (`bring_back`).
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pido.core.errors import StoreError, UnavailableError
from pido.core.files import refusal
from pido.store import Store
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace, arrival_digest, digest_of

_APART = ".leaving-"
_LOCK = "arrivals that leave"


def key_of(path: Path) -> str:
    """The digest of an arrival; of its name where it holds what is not read (links)."""
    try:
        return arrival_digest(path)
    except StoreError:
        return digest_of(["unreadable", path.name])


def put_away(workspace: Workspace, path: Path, key: str) -> Path | None:
    """Move the arrival `key` out of the inbox. Where another one lies at `path`, or none, nothing changes: None.

    Raises Stuck for what may not be moved.
    """
    with _apart(workspace, path, key) as own:
        if own is None:
            return None
        target = workspace.taken / f"{key[:16]}-{path.name}"
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists():
            shutil.rmtree(own) if own.is_dir() else own.unlink()
        else:
            shutil.move(own, target)
        return target


def reject(workspace: Workspace, path: Path, key: str, reason: str, move: bool, machine: str = "") -> Path | None:
    """Put the arrival `key` into the rejected area with the reason beside it, and on record. Where another one lies at
    `path`, or none, nothing changes: None.

    move : out of the inbox; else it is a user's own file, and a copy is put there
    machine : whose it is, if somebody said so
    Raises Stuck, with the reason, for what may not be moved: a copy of it is put there once.
    """
    ledger, store = Ledger(workspace.ledger), Store(workspace.store)
    known = ledger.arrival(key)
    # On record without the place that it leaves.
    recorded = reason.removeprefix(f"{path}: ").replace(str(path), path.name)
    try:
        with _apart(workspace, path, key) if move else _copied(workspace, path, key) as own:
            if own is None:
                return None
            if known is None or known.part is None or not store.has(known.part):  # else it stays that part
                ledger.rejected(key, path.name, recorded, machine)
            put = store.reject(own, reason, source=path)
            ledger.put_aside(key, os.path.relpath(put, workspace.root))
            return put
    except Stuck as stuck:
        if known is None or (known.state == "rejected" and known.reason != recorded):
            reject(workspace, path, key, reason, move=False, machine=machine)
        raise Stuck(f"{reason} {stuck}") from None


class Stuck(UnavailableError):
    """An arrival that may not be taken out of the inbox."""


def bring_back(workspace: Workspace, inbox: Path) -> bool:
    """Give arrivals that a killed process has set apart their names in the inbox again.

    Returns whether one still waits because its name is in use: call it again.
    """
    if not any(inbox.glob(f"{_APART}*")):
        return False
    with halted(workspace):
        return not all([_back(place) for place in inbox.glob(f"{_APART}*")])


@contextmanager
def halted(workspace: Workspace) -> Iterator[None]:
    """No arrival leaves the inbox while the block runs; whoever wants to put one away waits."""
    with workspace.lock(_LOCK):
        yield


@contextmanager
def _apart(workspace: Workspace, path: Path, key: str) -> Iterator[Path | None]:
    """The arrival `key` where nobody delivers to, or None. What is still there at the end has its name again."""
    with halted(workspace):
        # Looked at in its place first: a part that is just being delivered is not disturbed.
        if not _is(path, key):
            yield None
            return
        place = Path(tempfile.mkdtemp(prefix=_APART, dir=path.parent))
        own = place / path.name
        try:
            _take_out(path, own)
            yield own if _is(own, key) else None
        finally:
            _back(place)


def _take_out(path: Path, own: Path) -> None:
    try:
        path.rename(own)
    except FileNotFoundError:
        pass  # gone meanwhile
    except OSError as error:  # a folder of somebody else's, in which nothing may be changed
        raise Stuck(f"It stays in the inbox. {refusal(error)}") from None


@contextmanager
def _copied(workspace: Workspace, path: Path, key: str) -> Iterator[Path | None]:
    """A copy of the arrival `key`, or None."""
    place = workspace.work / "rejecting"
    with halted(workspace):
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        own = place / path.name
        try:
            if path.is_dir():
                shutil.copytree(path, own, symlinks=True)
            elif os.path.lexists(path):
                shutil.copy2(path, own, follow_symlinks=False)
            yield own if _is(own, key) else None
        finally:
            shutil.rmtree(place, ignore_errors=True)


def _is(path: Path, key: str) -> bool:
    try:
        return os.path.lexists(path) and key_of(path) == key
    except FileNotFoundError:  # replaced while it was looked at
        return False


def _back(place: Path) -> bool:
    """What is in a place of its own goes back to its name, if that is free; whether the place is gone."""
    for own in list(place.iterdir()):
        if not _named_again(own, place.parent / own.name):
            return False
    place.rmdir()
    return True


def _named_again(own: Path, name: Path) -> bool:
    """Rename without replacing anything; whether it could be done."""
    if own.is_file() and not own.is_symlink():
        try:
            os.link(own, name)  # unlike a rename it fails where the name has come into use just now
            own.unlink()
            return True
        except FileExistsError:
            return False
        except OSError:
            pass  # a disk without hard links
    if os.path.lexists(name):
        return False
    try:
        own.rename(name)
    except OSError:  # a folder with something in it has come just now
        return False
    return True
