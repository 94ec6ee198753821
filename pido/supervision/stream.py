"""A part watched while it is made: a CSV file that grows, sample by sample.

In:  a file in the columns of the contract that a recorder is still writing to.
Out: events as they happen: "alarm", one that begins; "ended", one that has ended, with its size and what it looks
     like; "end" of the part, with its verdict.

Samples come at any rate at or above the method's; each block of them is averaged into one. What a row needs must be in
the file: motion, currents, and the simulated process quantities (or `air_cut` in the settings). A whole-part verdict by
`pido monitor PART` also filters without phase; here a sample can only look back.
"""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.core.axes import AXES
from pido.core.columns import CURRENT, INPUTS, TIME, VELOCITY
from pido.core.errors import RecordingError
from pido.core.machining import Machine
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.core.samples import Samples
from pido.models.inputs import model_inputs
from pido.monitoring.alarms import Alarm, Verdict, Watch
from pido.monitoring.band import Band
from pido.monitoring.difficulty import state
from pido.monitoring.forest import quick
from pido.monitoring.likeness import looks_like
from pido.monitoring.records import followed_as
from pido.monitoring.standing import explained, other_end
from pido.parts import machine_of
from pido.physics.friction import held_direction
from pido.process.quantities import area_removal
from pido.process.samples import engaged, may_be_engaged
from pido.store import Store
from pido.supervision.book import Book, alarm_id
from pido.supervision.currents import Followed
from pido.supervision.growing import Growing, blocks
from pido.supervision.part import AROUND_S, Expectation, NamedAlarm, doubts, named, recorded
from pido.supervision.residuals import Said, support
from pido.workspace import Workspace

log = logging.getLogger(__name__)
REMEMBERED_S = 20.0
"""What an alarm is compared with signals over, at most."""
Event = dict[str, Any]
Prediction = Callable[[Samples], tuple[Said, Float1D, Float2D]]


class Stream:
    """One part on its way: rows in, events out. Holds no more than a window of the past."""

    def __init__(
        self,
        part: str,
        began: str,
        machine: Machine,
        predict: Prediction,
        band: Band,
        rate_hz: float,
        air_cut: bool = False,
    ) -> None:
        """began : digest of the part's beginning
        predict : rows to what is said of them, distances (n,) from the training rows, and model inputs (n, d)"""
        self._part, self._machine, self._predict, self._band = part, machine, predict, band
        self._watch = Watch(band, rate_hz)
        # The part that is taken in later has the same name.
        self.digest = followed_as(part, began)
        self._air_cut = air_cut
        self._rate_hz, self._last = rate_hz, -np.inf
        self._past: deque[tuple[float, Float1D, Float1D]] = deque(maxlen=round(rate_hz * REMEMBERED_S))
        self._held = dict.fromkeys(AXES, 0.0)
        self._open: dict[str, Alarm] = {}
        self.alarms: list[NamedAlarm] = []
        self.samples = 0

    def push(self, columns: Mapping[str, np.ndarray]) -> Iterator[Event]:
        """Rows in time order at the rate of the method; alarms that begin and end with them.

        columns : (n,) each – time, the 13 inputs, currents; tool_id and nc_line where they are known
        """
        recording = Recording(PartInfo(part=self._part, machine=self._machine.id), columns)
        samples = self._rows(recording)
        found, doubt, inputs = self._predict(samples)
        said = explained(found.currents, found.other_end, samples.currents)
        states = {axis: state(doubt, inputs, said[:, i]) for i, axis in enumerate(AXES)}
        residual = samples.currents - said
        judged = np.full(len(recording), self._air_cut) if self._air_cut else engaged(recording, self._machine)
        whole = np.isfinite(samples.inputs).all(axis=1)
        due = judged & whole | may_be_engaged(recording) & ~whole
        residual[~(judged & whole)] = np.nan
        self.samples += len(recording)
        for k in range(len(recording)):
            tool = str(columns["tool_id"][k]) if "tool_id" in columns else ""
            block = int(columns["nc_line"][k]) if "nc_line" in columns and np.isfinite(columns["nc_line"][k]) else -1
            now = float(recording.time[k])
            if now - self._last > 2.5 / self._rate_hz:
                self._watch.push({}, tool, block)  # a pause: no window reaches across it
            self._last = now
            self._past.append((now, samples.inputs[k], residual[k]))
            values: dict[str, float] = dict(zip(AXES, residual[k].tolist(), strict=True))
            outside = self._watch.push(values, tool, block, {axis: of[k] for axis, of in states.items()}, bool(due[k]))
            yield from self._changes(now, outside, tool, block)

    def end(self) -> Iterator[Event]:
        """The part has ended: what is still outside the band is an alarm up to here."""
        for axis in list(self._open):
            yield self._close(axis)

    def verdict(self) -> Verdict:
        """Of all rows so far."""
        return self._watch.verdict(self._part, [one.alarm for one in self.alarms])

    def _rows(self, recording: Recording) -> Samples:
        inputs = np.column_stack([np.asarray(recording[name], float) for name in INPUTS])
        direction = np.zeros((len(recording), len(AXES)))
        for i, axis in enumerate(AXES):
            held = held_direction(recording[VELOCITY[axis]], self._machine.dead_band(axis), self._held[axis])
            self._held[axis], direction[:, i] = float(held[-1]), held
        missing = np.full(len(recording), np.nan)
        currents = np.column_stack([recording.columns.get(CURRENT[a], missing) for a in AXES])
        rows = np.arange(self.samples, self.samples + len(recording))
        return Samples.real(inputs, area_removal(recording), currents, direction, self._part, rows)

    def _changes(self, now: float, outside: dict[str, tuple[float, float]], tool: str, block: int) -> Iterator[Event]:
        for axis, (spreads, size) in outside.items():
            alarm = self._open.get(axis)
            if alarm is None:
                start = max(0.0, now - self._band.window_s)
                alarm = Alarm(self._part, axis, start, now, tool, block, size, spreads)
                self._open[axis] = alarm
                begun = named(NamedAlarm(self._id(alarm), alarm, "unknown"))
                del begun["looks_like"]  # nobody knows before it has ended
                yield {"kind": "alarm", **begun}
            elif abs(spreads) > abs(alarm.spreads):
                self._open[axis] = replace(alarm, t_end=now, size_a=size, spreads=spreads, tool=tool, block=block)
            else:
                self._open[axis] = replace(alarm, t_end=now)
        for axis in [a for a, alarm in self._open.items() if a not in outside]:
            if now - self._open[axis].t_end > self._band.window_s:
                yield self._close(axis)

    def _id(self, alarm: Alarm) -> str:
        return alarm_id(self._machine.id, self.digest, alarm)

    def _close(self, axis: str) -> Event:
        alarm = self._open.pop(axis)
        around = [(x, r) for t, x, r in self._past if t >= alarm.t_start - AROUND_S]
        guess = "unknown"
        if around:
            inputs, residual = (np.array(values) for values in zip(*around, strict=True))
            signals: dict[str, Float1D] = dict(zip(INPUTS, inputs.T, strict=True))
            guess = looks_like(axis, residual[:, AXES.index(axis)], signals)
        ended = NamedAlarm(self._id(alarm), alarm, guess)
        self.alarms.append(ended)
        return {"kind": "ended", **named(ended)}


def follow_file(
    workspace: Workspace,
    path: Path,
    *,
    machine: str | None = None,
    tolerate: float = 1.0,
    idle_s: float = 10.0,
    sleep: Callable[[float], None] = time.sleep,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[Event]:
    """Events of a part whose file is being written; the verdict goes into the machine's book at its end: when the file
    did not grow for `idle_s`, or when the next part is written into one of its name.

    Raises RecordingError for columns that are missing, a time that cannot be one, or a rate below the method's;
    StoreError where its currents are in mA, as an arriving part is refused; what `monitor` raises without a model or a
    band.
    """
    name = machine or workspace.settings.machine
    if name is None:
        raise RecordingError(f"{path}: a CSV file does not name its machine: give --machine.")
    expect = Expectation.of(workspace, name)
    band = expect.band(tolerate)
    predict = _quick_prediction(workspace, expect)
    for note in expect.notes:
        log.warning("%s", note)
    stream: Stream | None = None
    currents = Followed(Store(workspace.store), path.stem, name)
    file = Growing(path, idle_s, sleep, clock)
    for began, table in blocks(file, workspace.settings.rate_hz, workspace.settings.air_cut):
        if stream is None:
            step = np.diff(table[TIME])
            rate = 1.0 / float(np.median(step[step > 0])) if step.any() else workspace.settings.rate_hz
            place = machine_of(workspace, name)
            stream = Stream(path.stem, began, place, predict, band, rate, workspace.settings.air_cut)
        currents.push(table)
        yield from stream.push(table)
    if stream is None:
        raise RecordingError(f"{path}: no sample was written within {idle_s:g} s.")
    odd = currents.end()
    yield from stream.end()
    verdict = stream.verdict()
    ending = f"{path}: the next part is written into it; this one ended there. Follow it again for the next one."
    new_notes = [*([ending] if file.replaced else []), *([odd] if odd else []), *doubts(verdict, band)]
    for note in new_notes:
        log.warning("%s", note)
    notes = [*expect.notes, *new_notes]
    said = recorded(verdict, band, stream.alarms, notes)
    record = {
        "part": path.stem, "digest": stream.digest, "machine": name, "model": expect.model, "followed": True, **said
    }  # fmt: skip
    Book(workspace, name).verdict(record)
    yield {"kind": "end", "samples": stream.samples, **record}


def _quick_prediction(workspace: Workspace, expect: Expectation) -> Prediction:
    kind, machine = expect.models.inputs, machine_of(workspace, expect.machine)
    near = support(workspace, expect.bundle.content["parts"], kind)
    by_axis = {axis: quick(model) for axis, model in expect.models.models.items()}

    def predict(samples: Samples) -> tuple[Said, Float1D, Float2D]:
        columns = model_inputs(samples, kind)
        usable = np.isfinite(columns).all(axis=1)
        out, doubt = np.full((len(columns), len(AXES)), np.nan), np.full(len(columns), np.nan)
        for i, axis in enumerate(AXES):
            if axis in by_axis and usable.any():
                out[usable, i] = by_axis[axis](columns[usable])
        doubt[usable] = near.distance(columns[usable])
        return Said(out, other_end(by_axis, columns, machine)), doubt, columns

    return predict
