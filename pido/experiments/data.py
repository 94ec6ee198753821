"""What an experiment is run on: sets of samples of one machine, each one a part, a run or a stretch.

In:  'worn' or 'newer' (the virtual machines, with the paper's design), or files and folders of recordings.
Out: `Fleet`: machine, sets by name, and one sentence per thing that was assumed.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import maximum_filter1d

from pido import config
from pido.core.arrays import Bool1D, Float2D, Int1D
from pido.core.axes import LINEAR_AXES
from pido.core.columns import CURRENT, POSITION, VELOCITY
from pido.core.errors import PidoError, SettingsError
from pido.core.machining import Job, Machine
from pido.core.recording import Recording
from pido.core.samples import Samples
from pido.preparation import job_of, prepare
from pido.recordings import READERS, read_recording
from pido.recordings.check import blanked, check
from pido.recordings.faults import ERROR

log = logging.getLogger(__name__)

VIRTUAL = ("worn", "newer")
RATE_HZ = 50.0
FEW_ROWS = 300
"""Sets with fewer rows are left out: an axis cannot be judged on a few seconds."""
FASTEST_MM_S = 15.0
"""Of an air cut only rows up to this speed count (paper, section IV-B): no chip is cut faster on these machines."""


class DataError(PidoError):
    """Recordings that an experiment cannot use."""


@dataclass(frozen=True, eq=False)
class Fleet:
    """Sets of one machine, in the order in which they were made.

    group : what a set belongs to (material and shape of the design, the recording that a run was cut from)
    """

    name: str
    machine: Machine
    sets: dict[str, Samples]
    group: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def samples(self, names: Sequence[str]) -> Samples:
        """The rows of several sets, one after another."""
        return Samples.concat([self.sets[name] for name in names])

    def digest(self) -> str:
        """sha256 of everything that decides a result."""
        result = hashlib.sha256(repr((self.machine, sorted(self.group.items()))).encode())
        for name, samples in self.sets.items():
            result.update(name.encode())
            for values in (samples.inputs, samples.ar, samples.currents, samples.direction, samples.row):
                result.update(np.ascontiguousarray(values).tobytes())
        return result.hexdigest()


def load_fleet(
    data: str, family: str, *, machine: str | None = None, job: Job | None = None, seed: int = 0, count: int = 12
) -> Fleet:
    """Sets to experiment on.

    data : 'worn' or 'newer' for a virtual machine, else a recording or a folder of them
    family : 'impellers' (validation) or 'design' (gear, plate, notch in two materials), for virtual machines
    machine, job : for recordings that do not say what machine they are of and what was cut
    count : number of impellers
    Raises DataError where fewer than two sets are usable, no axis has a current that changes, or two recordings are of
    one part.
    """
    fleet = _virtual(data, family, seed, count) if data in VIRTUAL else _recorded(Path(data), machine, job)
    if not any(varies(samples.currents).any() for samples in fleet.sets.values()) and fleet.sets:
        raise DataError(
            f"{data}: no axis has a current that changes, and currents are what is predicted. " + " ".join(fleet.notes)
        )
    if len(fleet.sets) < 2:
        raise DataError(
            f"{data}: {len(fleet.sets)} usable set(s) of samples; an experiment leaves one out, so it needs two. "
            + " ".join(fleet.notes)
        )
    return fleet


def _virtual(which: str, family: str, seed: int, count: int) -> Fleet:
    from pido.process.samples import to_samples
    from pido.synthetic.families import impellers, variants
    from pido.synthetic.machine import produce
    from pido.synthetic.mills import newer_vertical, worn_horizontal

    mill = {"worn": worn_horizontal, "newer": newer_vertical}[which]()
    if family == "impellers":
        jobs, group = impellers(mill.machine, count, seed=seed), {}
    elif family == "design":
        jobs, group, clock = [], {}, 0.0
        for material, short in (("AL2007T4", "AL"), ("S235JR", "ST")):
            for shape, letter in (("gear", "G"), ("plate", "P"), ("notch", "N")):
                if (short, letter) == ("AL", "N"):
                    continue  # table 1 has the notch in steel only
                for vary, suffixes in (("none", "123"), ("SF", ("SFl", "SF", "SFh")), ("a_p", ("apl", "ap", "aph"))):
                    if letter == "N" and vary != "none":
                        continue
                    made = variants(mill.machine, shape, material, vary=vary, start_s=clock)
                    for one, suffix in zip(made, suffixes, strict=True):
                        name = f"D{short}_{letter}{suffix}"
                        jobs.append(replace(one, name=name))
                        group[name] = f"D{short}_{letter}"
                    clock += 420.0 * len(made)
    else:
        raise SettingsError(f"family '{family}': known are impellers and design.")
    made = produce(mill, mill.plan(jobs), seed=seed, with_simulation=False)
    sets = {p.job.name: to_samples(p.recording, mill.machine, p.job.name) for p in made}
    return Fleet(f"virtual, {which}", mill.machine, sets, group, (f"{len(sets)} virtual parts, seed {seed}",))


def _recorded(path: Path, machine: str | None, job: Job | None) -> Fleet:
    if not path.exists():
        raise DataError(f"{path}: no such file or folder; virtual machines are called {' and '.join(VIRTUAL)}.")
    files = [path] if _readable(path) else [p for p in sorted(path.iterdir()) if _readable(p)]
    if not files:
        raise DataError(f"{path}: no recording in it. Give a recording, or a folder that holds recordings.")
    recordings = read_each(files, machine)
    names = {r.part.machine for r in recordings}
    if len(names) > 1:
        raise DataError(f"{path}: recordings of several machines ({', '.join(sorted(names))}). Give one machine's.")
    own = config.machine(names.pop())
    notes, sets, group = [], {}, {}
    for recording in recordings:
        samples, said = rows_of(recording, own, job)
        notes += [f"{recording.part.part}: {note}" for note in said]
        pieces = _pieces(recording, samples) if len(recordings) == 1 else {recording.part.part: samples}
        for name, piece in pieces.items():
            if len(piece) < FEW_ROWS:
                notes.append(f"{name}: left out, {len(piece)} usable rows (of {FEW_ROWS})")
                continue
            sets[name], group[name] = piece, recording.part.part
        if len(pieces) > 1:
            notes.append(f"{recording.part.part}: cut into {', '.join(pieces)}")
    return Fleet(path.name, own, sets, group, tuple(notes))


def read_each(files: Sequence[Path], machine: str | None) -> list[Recording]:
    """The recordings of these files. Raises DataError where two of them are of one part: a part is trained on or tested
    on, and two of one name would be told apart by nothing."""
    found: dict[str, tuple[Path, Recording]] = {}
    for file in files:
        recording = read_recording(file, machine=machine)
        if (name := recording.part.part) in found:
            raise DataError(
                f"{found[name][0]} and {file}: both are recordings of part '{name}'. Give each part its own name "
                "(`part` in part.json, else the file's name), or take one of them out of the folder."
            )
        found[name] = file, recording
    return [recording for _, recording in found.values()]


def rows_of(recording: Recording, machine: Machine, job: Job | None = None) -> tuple[Samples, tuple[str, ...]]:
    """Checked rows of one recording at 50 Hz or its own lower rate, as production makes them; of an air cut those at
    the levels where the tool works. A part about which nobody says what was cut is taken as an air cut.

    An axis whose current was not recorded, or cannot be used, has NaN and a note; one whose current never changes has a
    note. Raises DataError where none has a current, and for other faults that make a recording unusable; RecordingError
    where no row is left.
    """
    from pido.recordings.resample import resample

    faults = check(recording, machine)
    lost = {f.column: f for f in faults if f.column in CURRENT.values() and f.severity == ERROR}
    if errors := [f for f in faults if f.severity == ERROR and f.column not in lost]:
        lines = "\n".join(f"  {fault}" for fault in errors)
        raise DataError(f"{recording.part.part}: {len(errors)} fault(s) that make it unusable:\n{lines}")
    idle = [f for f in faults if f.kind == "constant" and f.column in CURRENT.values()]
    left_out = tuple(
        f"without a current of axis {f.column.removeprefix('curr_')}: {f.what}" for f in (*lost.values(), *idle)
    )
    if not {*CURRENT.values()} & {*recording.columns} - {*lost}:
        raise DataError(f"{recording.part.part}: no axis has a current that can be used. {' '.join(left_out)}")
    recording = blanked(recording, faults)
    if recording.sample_rate_hz > 1.01 * RATE_HZ:
        recording = resample(recording, RATE_HZ)
    materials = {name: config.material(name) for name in config.shipped("materials")}
    known = job_of(recording, job, machine, materials)
    samples, said = prepare(recording, machine, known, recording.part.part, air_cut=True)
    notes = (*left_out, *said)
    if not (samples.ar > 0).any():
        works = working(recording, machine)[samples.row]
        notes = (
            *notes,
            f"{int(works.sum())} of {len(samples)} rows are at working levels, up to {FASTEST_MM_S:g} mm/s",
        )
        samples = samples.take(works)
    return samples, notes


def varies(currents: Float2D) -> Bool1D:
    """(4,): axes whose currents (n, 4) were recorded and change.

    >>> varies(np.array([[1.0, np.nan, 0.1, np.nan], [2.0, np.nan, 0.1, 3.0]])).tolist()
    [True, False, False, False]
    """
    recorded = (column[np.isfinite(column)] for column in currents.T)
    return np.array([len(values) > 0 and bool(np.ptp(values) > 0) for values in recorded])


def working(recording: Recording, machine: Machine) -> Bool1D:
    """(n,): rows of an air cut that would cut: slower than 15 mm/s in the plane, at rest along the tool, and at a level
    where the machine does so for 2 s at least; with the spindle turning where it ever turns."""
    axis = machine.tool_axis
    plane = [a for a in LINEAR_AXES if a != axis]
    speed = np.hypot(*(recording[VELOCITY[a]] for a in plane))
    level = np.asarray(recording[POSITION[axis]], float)
    step = 0.1
    cell = np.floor(np.nan_to_num(level) / step + 0.5).astype(np.int64)
    feeds = (speed > 5 * max(machine.dead_band(a) for a in plane)) & (speed < FASTEST_MM_S) & np.isfinite(level)
    cells, count = np.unique(cell[feeds], return_counts=True)
    enough = cells[count >= 2.0 * recording.sample_rate_hz]
    spindle = np.abs(np.nan_to_num(recording[VELOCITY["sp"]]))
    turns = spindle > machine.spindle_dead_band_deg_s
    still = np.abs(recording[VELOCITY[axis]]) <= np.maximum(machine.dead_band(axis), 0.05 * speed)
    return np.isin(cell, enough) & (speed < FASTEST_MM_S) & still & (turns | (not turns.any()))


def _pieces(recording: Recording, samples: Samples) -> dict[str, Samples]:
    """A single recording in parts: the runs of its program if it repeats, else three stretches of equal length."""
    edges, word = runs(recording), "run"
    if len(edges) < 2:
        edges, word = np.quantile(samples.row, [0.0, 1 / 3, 2 / 3]).astype(np.int64), "stretch"
    which = np.maximum(np.searchsorted(edges, samples.row, side="right") - 1, 0)
    result = {}
    for k in range(len(edges)):
        name = f"{word} {k + 1}"
        piece = samples.take(which == k)
        result[name] = replace(piece, part=np.full(len(piece), name, dtype=object))
    return result


def runs(recording: Recording, alike: float = 0.5) -> Int1D:
    """(k,): row at which each run of a repeated program begins; one where it does not repeat.

    The first lag at which the velocities are like themselves (a peak of their correlation, above `alike` and near the
    highest) is the length of a run; a run begins in the middle of the longest rest around each multiple of it.
    """
    signals = [np.nan_to_num(recording[VELOCITY[a]]) for a in LINEAR_AXES]
    n = len(recording)
    # three seconds of mean: pauses between runs differ
    box = np.ones(max(1, round(3 * recording.sample_rate_hz)))
    box /= len(box)
    v = np.column_stack([np.convolve(np.clip(s, -FASTEST_MM_S, FASTEST_MM_S), box, mode="same") for s in signals])
    size = 1 << (2 * n - 1).bit_length()
    power = np.abs(np.fft.rfft(v, size, axis=0)) ** 2
    same = np.fft.irfft(power.sum(axis=1), size)[:n]
    square = np.cumsum((v**2).sum(axis=1))
    least = n // 10
    lags = np.arange(least, int(0.75 * n))
    if not len(lags) or square[-1] == 0:
        return np.zeros(1, np.int64)
    head, tail = square[n - 1 - lags], square[-1] - square[lags - 1]
    likeness = same[lags] / np.sqrt(np.maximum(head * tail, 1e-12))
    if likeness.max() < alike:
        return np.zeros(1, np.int64)
    peak = likeness == maximum_filter1d(likeness, max(3, n // 20))
    lag = int(lags[np.flatnonzero(peak & (likeness >= max(alike, 0.7 * likeness.max())))[0]])
    rest = np.abs(v).max(axis=1) < 0.05
    starts = [0]
    for k in range(1, round(n / lag)):
        low, high = int((k - 0.25) * lag), min(int((k + 0.25) * lag), n)
        begin = np.flatnonzero(np.diff(np.r_[0, rest[low:high].astype(int), 0]) == 1)
        end = np.flatnonzero(np.diff(np.r_[0, rest[low:high].astype(int), 0]) == -1)
        longest = int(np.argmax(end - begin)) if len(begin) else -1
        starts.append(low + int(begin[longest] + end[longest]) // 2 if longest >= 0 else k * lag)
    return np.array(starts, np.int64)


def _readable(path: Path) -> bool:
    return any(reader.recognises(path) for reader in READERS)
