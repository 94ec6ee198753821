"""The coming part before it is cut: NC program -> motion, engagement, forces, removal, as a recording.

In:  program, machine, material, tools, raw part.
Out: `Recording` in the contract's columns, without currents; every sample knows its NC line.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from pido.core.columns import PROCESS
from pido.core.machining import Job, Machine, Material, MeshStock, Stock, Tool
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.nc import interpret
from pido.process.height_map import DEFAULT_GRID_MM, HeightMap
from pido.process.motion import Dynamics, plan_motion
from pido.process.precheck import check_program
from pido.process.quantities import Teeth, process_quantities
from pido.process.removal import raw_part

Point = tuple[float, float, float]


def simulate_program(
    program: Path | str,
    *,
    machine: Machine,
    tools: Mapping[str, Tool],
    material: Material | None = None,
    stock: Stock | MeshStock | HeightMap | None = None,
    part: PartInfo | None = None,
    rate_hz: float = 50.0,
    grid_mm: float = DEFAULT_GRID_MM,
    start: Point | None = None,
    zero_offsets: Mapping[str, Point] | None = None,
    subprograms: Path | Mapping[str, str] | None = None,
    dynamics: Dynamics | None = None,
    teeth: Teeth = "one",
) -> Recording:
    """What `machine` will do and feel when it runs `program`.

    Without `stock` the run is an air cut: forces and removal are 0, and the notes say so.

    Raises ProgramError (not understood, outside the travel, gouge, raw part smaller than the path, spindle at rest in
    the material) and SettingsError (tool not in the list, impossible machine), all before any motion is planned.
    """
    if stock is not None and material is None:
        raise ValueError("a raw part needs its material")
    toolpath = interpret(
        program, machine=machine, tools=tools, start=start, zero_offsets=zero_offsets, subprograms=subprograms
    )
    raw = None
    if stock is not None:
        raw = raw_part(stock, grid_mm, machine.tool_axis)
        check_program(toolpath, raw, dict(tools), machine)
    if part is None:
        name = Path(program).stem if isinstance(program, Path) else "program"
        part = PartInfo(part=name, machine=machine.id, material=material.name if material else None)
    motion = plan_motion(toolpath, machine, rate_hz, dynamics)
    recording = motion.recording(part)
    recording = replace(recording, notes=(*recording.notes, *toolpath.notes))
    if raw is None or material is None:
        return as_air_cut(recording)
    return process_quantities(
        recording, stock=raw, tools=tools, material=material, machine=machine, grid_mm=grid_mm, teeth=teeth
    )


def simulate_job(program: Path | str, job: Job, part: PartInfo | None = None) -> Recording:
    """`simulate_program` with everything that a job file says.

    Raises as it does, and SettingsError for dynamics that `process.motion.Dynamics` does not have.
    """
    return simulate_program(
        program,
        machine=job.machine,
        tools=job.tools,
        material=job.material,
        stock=job.stock,
        part=part,
        rate_hz=job.rate_hz,
        grid_mm=job.grid_mm,
        start=job.start,
        zero_offsets=job.zero_offsets,
        subprograms=Path(job.subprograms) if job.subprograms else None,
        dynamics=Dynamics.of(job.machine, job.dynamics),
        teeth=job.teeth,
    )


def as_air_cut(recording: Recording) -> Recording:
    """The recording with forces, torque and removal of 0: nothing was in the machine. Whoever calls this knows that."""
    nothing = np.zeros(len(recording))
    recording = recording.with_columns(**dict.fromkeys(PROCESS, nothing))
    return replace(recording, notes=(*recording.notes, "taken as an air cut: no forces, no removal"))
