"""A recording becomes rows to learn from: to the method's rate, process quantities along its path, samples.

In:  a recording, its machine, and what was cut with what (`Job`), where that is known.
Out: `Samples` of the part, and one sentence per thing that was assumed on the way.

Process quantities that were recorded with the part are used as they are, each for itself. What rows need beyond them
comes from a height map of the stock along the recorded path. A part about which nobody says what was cut is refused,
unless the settings call it an air cut, and no load was recorded: then what is missing is zero, and all its moving
samples count.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pido.core.arrays import Bool1D
from pido.core.columns import CURRENT, INPUTS, PROCESS
from pido.core.errors import RecordingError, SettingsError
from pido.core.machining import Job, Machine, Material, Stock, Tool
from pido.core.recording import Recording
from pido.core.samples import Samples
from pido.process.quantities import process_quantities
from pido.process.samples import load_in, not_engaged, to_samples

log = logging.getLogger(__name__)


def job_of(recording: Recording, default: Job | None, machine: Machine, materials: Mapping[str, Material]) -> Job:
    """The job of a part: what its part.json says, and the settings' job for what it does not say.

    Raises SettingsError for a material that no settings file defines.
    """
    info = recording.part
    job = default or Job(machine, {})
    if info.material is not None:
        if info.material not in materials:
            raise SettingsError(
                f"part {info.part}: material '{info.material}' is not known. Known: {', '.join(sorted(materials))}."
            )
        job = replace(job, material=materials[info.material])
    tools = dict(job.tools)
    for name, tool in info.tools.items():
        if tool.diameter_mm and tool.teeth:
            radius = tool.corner_radius_mm or 0.0
            kind = "ball" if 2 * radius >= tool.diameter_mm else "bull" if radius else "end"
            tools[name] = Tool(name, tool.diameter_mm, tool.teeth, kind, radius, mass_kg=tool.mass_kg)
    return replace(job, tools=tools, stock=_stock(recording) or job.stock)


def prepare(
    recording: Recording, machine: Machine, job: Job, part: str, *, air_cut: bool = False
) -> tuple[Samples, tuple[str, ...]]:
    """Rows of one part, and what was assumed.

    recording : at the method's rate, checked; samples with a missing input are left out
    part : digest of the part
    Raises RecordingError where no sample is left, or no sample has the tool engaged; SettingsError where nobody says
    what was cut.
    """
    recording, notes = _with_process(recording, machine, job, air_cut)
    engaged_only = bool((recording["mrr_sim"] > 0).any())
    if not engaged_only and not air_cut:
        raise RecordingError(f"part {recording.part.part}: no sample has the tool engaged. {not_engaged(recording)}")
    if not engaged_only and (load := load_in(recording.columns)):
        notes.append(f"mrr_sim is 0 throughout, so all its moving samples count as air_cut = true says, though {load}")
    samples = to_samples(recording, machine, part, engaged_only=engaged_only)
    usable = (
        np.isfinite(samples.inputs).all(axis=1) & np.isfinite(samples.ar) & np.isfinite(samples.currents).any(axis=1)
    )
    if not usable.all():
        notes.append(f"{int((~usable).sum())} of {len(samples)} samples left out: an input or all currents are missing")
    samples = samples.take(usable)
    if not len(samples):
        raise RecordingError(f"part {recording.part.part}: no usable sample is left. Look at what `pido ingest` says.")
    return samples, tuple(notes)


def lacks(recording: Recording) -> Bool1D:
    """(n,): samples without one of the inputs that were recorded, or without any current."""
    inputs = [np.isfinite(recording[name]) for name in INPUTS if name in recording]
    currents = [np.isfinite(recording[name]) for name in CURRENT.values() if name in recording]
    there = np.logical_and.reduce(inputs) & np.logical_or.reduce(currents)
    return np.asarray(~there) & np.ones(len(recording), bool)


def _with_process(recording: Recording, machine: Machine, job: Job, air_cut: bool) -> tuple[Recording, list[str]]:
    """The recording with all process quantities that rows need, and what was assumed for those it had not. What was
    recorded stays as it is; a column that holds no value was not recorded."""
    recorded = [name for name in PROCESS if name in recording and np.isfinite(recording[name]).any()]
    missing = [name for name in INPUTS if name in PROCESS and name not in recorded]
    if not missing:
        return recording, []
    alone = f"{', '.join(missing)} alone; {_were(recorded)} recorded" if recorded else ""
    if job.material and job.tools and job.stock:
        simulated = process_quantities(
            recording,
            stock=job.stock,
            tools=job.tools,
            material=job.material,
            machine=machine,
            grid_mm=job.grid_mm,
            teeth=job.teeth,
        )
        how = f"simulated along the recorded path: {job.material.name}, height map"
        return (
            simulated.with_columns(**{name: recording[name] for name in recorded}),
            [f"{how}: {alone}" if recorded else f"forces and removal {how}"],
        )
    load = load_in(recording.columns)
    if air_cut and not load:
        recording = recording.with_columns(**dict.fromkeys(missing, np.zeros(len(recording))))
        return recording, [
            "taken as an air cut: no forces, no removal" + (f" (assumed of {alone})" if recorded else "")
        ]
    unknown = [name for name in ("material", "tools", "stock") if not getattr(job, name)]
    what = f"{_were(missing)} not recorded" if recorded else "no process quantities were recorded"
    if air_cut:
        what += f" and cannot be taken as 0, though air_cut = true: {load}"
    not_known = f"{', '.join(unknown)} {'is' if len(unknown) == 1 else 'are'} not known"
    ways = f'Say it in part.json or in a job file (workspace.toml: [jobs] {machine.id} = "job.toml")'
    if recorded:
        not_known = f"to simulate it {not_known}"
        ways = f"Bring the recording with {', '.join(missing)}. {ways.replace('Say it', 'Or say what was cut')}"
    if not load:
        ways += ", or set air_cut = true"
    raise SettingsError(f"part {recording.part.part}: {what}, and {not_known}. {ways}.")


def _were(names: list[str]) -> str:
    return f"{', '.join(names)} {'was' if len(names) == 1 else 'were'}"


def _stock(recording: Recording) -> Stock | None:
    """The blank of part.json as a block, if it is fully given. Middle, top and size are along x, y and z of the machine
    whichever way its tool points (ISO 841), so a horizontal spindle needs nothing more."""
    piece = recording.part.workpiece
    if piece is None or piece.center_xy_mm is None or piece.top_z_mm is None or piece.blank_mm is None:
        return None
    (cx, cy), (sx, sy, sz), top = piece.center_xy_mm, piece.blank_mm, piece.top_z_mm
    return Stock((cx - sx / 2, cy - sy / 2, top - sz), (cx + sx / 2, cy + sy / 2, top))
