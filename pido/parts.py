"""Parts come in: read, checked, turned into samples, stored; or rejected with the reason, and nothing else touched.

In:  a path, a workspace. Out: a part in the store and its samples in `derived/`; facts in the ledger.

What arrived is known by the digest of its bytes, the part in it by the digest of its content: the same part under
another name, with another order or tool, in another format's file or twice is one part: its samples say so. What comes
again with further columns (process quantities that were simulated later) completes it: an iteration is then due again.
"""

from __future__ import annotations

import logging
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pido import config
from pido.arrivals import machine_said
from pido.core.arrays import Int1D
from pido.core.errors import PidoError, RecordingError, SettingsFileError, StoreError, UnavailableError
from pido.core.machining import Machine, Material
from pido.core.recording import Recording
from pido.core.samples import Samples
from pido.departures import key_of
from pido.files.samples import load_lost, load_samples, save_samples
from pido.iteration import Recipe
from pido.monitoring.records import name_in
from pido.preparation import job_of, lacks, prepare
from pido.process.samples import may_be_engaged
from pido.recordings import read_recording
from pido.recordings.check import blanked, check
from pido.recordings.faults import ERROR
from pido.recordings.folder import says_machine
from pido.recordings.resample import resample
from pido.store import Entry, Store
from pido.tracking.ledger import Ledger
from pido.workspace import Workspace, code_version, digest_of

log = logging.getLogger(__name__)


def ingest(root: str, path: str, machine: str | None = None) -> dict[str, Any]:
    """Take an arrival in: {'machine', 'part' (digest), 'name', 'new', 'key', 'told'}. A known one changes nothing.

    key : the digest of what arrived; by it the arrival leaves the inbox (`pido.departures`)
    told : what its part.json says otherwise than that of the known part with its samples, and what to do, or ''
    Raises Refused for what cannot be used, again for what was rejected before, and for what another machine than the
    one it goes by has already; Changed for what is not at rest;
    UnavailableError or SettingsError where disk or settings are at fault, and not the part.
    """
    workspace = Workspace.open(root)
    ledger, store, place = Ledger(workspace.ledger), Store(workspace.store), Path(path)
    untouched, key = _marks(place), key_of(place)
    known = ledger.arrival(key)
    named = machine or workspace.settings.machine
    if known is not None and known.state == "taken" and known.part is not None and store.has(known.part):
        entry = entry_of(workspace, known.part)
        if gone := store.why_withdrawn(known.part):
            raise Refused(f"{place}: {gone}", key, entry.machine)
        if named not in (None, entry.machine) and not says_machine(place):
            raise Refused(_elsewhere(place, entry, named), key, named or "")
        return _answer(entry, key)
    if named is not None:
        machine_of(workspace, named)  # a wrong name in the settings is no fault of the parts that go by it
    from pido.store.content import digest

    def at_rest() -> bool:
        # The marks too: what was replaced and put back again has its old bytes, and was perhaps read in between.
        return _marks(place) == untouched and key_of(place) == key

    changed = Changed(f"{place}: was changed while it was read; it is taken when it has come to rest.")
    try:
        recording = _read(workspace, place, named)
        _check(recording, workspace, place)
        whole, same = store.as_kept(recording)
        name = digest(whole)
        told_otherwise = same is not None and name == same.digest and name != digest(recording)
        made = None if told_otherwise else _samples(workspace, whole, name)
        if not at_rest():
            raise changed
        entry = store.add(recording, source=place.name)
    except (Changed, UnavailableError, SettingsFileError):
        raise
    except PidoError as error:
        if at_rest():
            raise Refused(str(error), key, machine_said(place) or named or "") from error
        raise changed from None  # half of one and half of the other is no reason to reject either
    if made is not None and entry.digest == name:
        samples, lost = made
        save_samples(samples, samples_path(workspace, entry.digest), lost)
    for before in store.before(entry.digest):  # also where who completed it died before this
        ledger.completed(before, entry.digest, entry.machine, entry.part)
    ledger.took(key, place.name, entry.digest, entry.machine)
    return _answer(entry, key)


class Changed(PidoError):
    """An arrival that is not at rest yet. It is no reason to reject it."""


class Refused(PidoError):
    """An arrival that cannot be used, as `reason` says. `key`: the digest under which it was read; `machine`: whose it
    is, '' where nobody says so."""

    def __init__(self, reason: str, key: str = "", machine: str = "") -> None:
        super().__init__(reason)
        self.key, self.machine = key, machine


def samples_of(workspace: Workspace, digest: str) -> Samples:
    """Rows of a part to learn from: as kept, or made again from the store; without those of alarms answered as true."""
    samples = load_samples(rows_file(workspace, digest))
    entry = entry_of(workspace, digest)
    excluded = workspace.excluded(entry.machine)
    stretches = [
        at
        for key, where in excluded.items()
        if entry.part == name_in(key) or key in (digest, entry.digest)
        for at in where
    ]
    if not stretches:
        return samples
    time = at_rate(workspace, Store(workspace.store).load(digest, ())).time[samples.row]
    inside = np.any([(time >= start) & (time <= end) for start, end in stretches], axis=0)
    return samples.take(~inside)


def lost_of(workspace: Workspace, digest: str) -> Int1D:
    """(m,): samples of a part of which no row could be made for want of a value, though the tool may have been engaged;
    numbered as its rows are."""
    return load_lost(rows_file(workspace, digest))


def rows_file(workspace: Workspace, digest: str) -> Path:
    """The file with the rows of a part, which is made again from the store where it is gone."""
    path = samples_path(workspace, digest)
    if not path.exists():
        samples, lost = _samples(workspace, Store(workspace.store).load(digest), digest)
        save_samples(samples, path, lost)
    return path


def look_at(workspace: Workspace, path: Path, machine: str | None = None) -> tuple[Recording, Samples, Int1D, str]:
    """A recording that is only looked at, not taken in: at the method's rate, its rows, what was lost (`lost_of`), its
    digest, or that of the stored part whose samples it has. Nothing is stored.

    Raises RecordingError, SettingsError or StoreError for a recording that cannot be used.
    """
    from pido.store.content import digest

    recording = _read(workspace, path, machine or workspace.settings.machine)
    _check(recording, workspace, path)
    store = Store(workspace.store)
    whole, same = store.as_kept(recording)
    if same is None:
        store.compare_currents(recording)
    recording, name = whole, digest(whole) if same is None else same.digest
    samples, lost = _samples(workspace, recording, name)
    return at_rate(workspace, recording), samples, lost, name


def at_rate(workspace: Workspace, recording: Recording) -> Recording:
    """The recording at the method's rate, as its rows are numbered; a slower one stays as it is."""
    faster = recording.sample_rate_hz > 1.01 * workspace.settings.rate_hz
    return resample(recording, workspace.settings.rate_hz) if faster else recording


def samples_path(workspace: Workspace, digest: str) -> Path:
    """Where the rows of a part are kept: they depend on the part, the settings and the code."""
    machine = entry_of(workspace, digest).machine if Store(workspace.store).has(digest) else ""
    under = digest_of([workspace.settings_digest(machine), code_version()])[:12]
    return workspace.derived / f"{digest[:24]}-{under}.parquet"


def entry_of(workspace: Workspace, digest: str) -> Entry:
    """What the store's index knows about a part."""
    entry = Store(workspace.store).entry(digest)
    if entry is not None:
        return entry
    raise StoreError(f"{workspace.store}: no part with digest {digest[:12]}.")


def machine_of(workspace: Workspace, name: str) -> Machine:
    """A machine by name: as its job says, from the workspace's own file, or as shipped."""
    job = workspace.job(name)
    if job is not None:
        return job.machine
    own = workspace.settings.machines_file
    return config.machine(name, None if own is None else workspace.root / own)


def recipe_of(workspace: Workspace) -> Recipe:
    """The method and the models that the settings ask for."""
    method = workspace.settings.method
    return Recipe(method.build(), method.estimators, method.inputs)


def _elsewhere(path: Path, entry: Entry, named: str) -> str:
    return (
        f"{path}: these bytes are part '{entry.part}' of machine '{entry.machine}' already, and stay so; now they come "
        f"as '{named}'. If they are of '{named}', bring them as a part folder whose part.json says it; "
        f"'{entry.machine}' has learnt from them, until a backup from before is restored. If not, name "
        f"'{entry.machine}' with --machine."
    )


def _answer(entry: Entry, key: str) -> dict[str, Any]:
    return {
        "machine": entry.machine,
        "part": entry.digest,
        "name": entry.part,
        "new": entry.new,
        "key": key,
        "told": entry.told,
    }


def _marks(path: Path) -> list[tuple[str, int, int, int]]:
    """Name, inode and times of all that arrived: whatever writes, replaces or renames a file changes them."""
    found = []
    for file in sorted([path, *(() if path.is_symlink() else path.rglob("*"))]):
        with suppress(FileNotFoundError):  # gone meanwhile: a change as well
            s = file.lstat()
            found.append((str(file), s.st_ino, s.st_mtime_ns, s.st_ctime_ns))
    return found


def _read(workspace: Workspace, path: Path, machine: str | None) -> Recording:
    if path.is_symlink() or (path.is_dir() and any(p.is_symlink() for p in path.rglob("*"))):
        raise RecordingError(f"{path}: symbolic links are not followed; bring the files themselves.")
    if not (path.is_file() or path.is_dir()):
        raise RecordingError(f"{path}: no such file or folder.")
    fastest = None if machine is None else machine_of(workspace, machine).spindle_max_deg_s
    recording = read_recording(path, machine=machine, spindle_max_deg_s=fastest)
    for note in recording.notes:
        log.info("%s: %s", path.name, note)
    return recording


def _check(recording: Recording, workspace: Workspace, path: Path) -> None:
    faults = check(recording, machine_of(workspace, recording.part.machine))
    fatal = [f for f in faults if f.severity == ERROR]
    if fatal:
        lines = "\n".join(f"  {fault}" for fault in fatal)
        raise RecordingError(f"{path}: {len(fatal)} fault(s) that make it unusable:\n{lines}")


def _samples(workspace: Workspace, recording: Recording, digest: str) -> tuple[Samples, Int1D]:
    """Recording at its own rate -> rows at the method's rate, and the samples (as rows are numbered) of which none
    could be made for want of a value, though the tool may have been engaged."""
    settings = workspace.settings
    machine = machine_of(workspace, recording.part.machine)
    whole, recording = recording, at_rate(workspace, blanked(recording, check(recording, machine)))
    job = job_of(recording, workspace.job(recording.part.machine), machine, _materials(workspace))
    samples, notes = prepare(recording, machine, job, digest, air_cut=settings.air_cut)
    for note in notes:
        log.info("%s: %s", recording.part.part, note)
    lost = lacks(recording)
    lost[samples.row] = False
    if lost.any():
        said = {name: whole[name] for name in ("time", "mrr_sim") if name in whole}
        lost &= may_be_engaged(at_rate(workspace, Recording(whole.part, said)))
    return replace(samples, part=np.full(len(samples), digest, dtype=object)), np.flatnonzero(lost)


def _materials(workspace: Workspace) -> dict[str, Material]:
    own = workspace.settings.materials_file
    path = None if own is None else workspace.root / own
    names = set(config.shipped("materials")) | set(config.read_toml(path) if path else {})
    return {name: config.material(name, path) for name in sorted(names)}
