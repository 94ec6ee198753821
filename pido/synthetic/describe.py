"""What a plant knows about a part that the virtual mill made: the content of its part.json."""

from __future__ import annotations

import numpy as np

from pido.core.machining import Machine
from pido.core.part import Operation, PartInfo, PartTool, ToolChange, UsedBefore, Workpiece
from pido.synthetic.parts import Course

PROGRAM = "program.mpf"


def part_info(machine: Machine, course: Course, rate_hz: float, duration_s: float) -> PartInfo:
    """Identity, order, clock, tools with what they cut before, operations, workpiece."""
    job = course.job
    tools = {
        str(i + 1): PartTool(
            diameter_mm=job.tools[name].diameter_mm,
            teeth=job.tools[name].teeth,
            mass_kg=job.tools[name].mass_kg,
            corner_radius_mm=job.tools[name].corner_radius_mm,
            used_before=UsedBefore(
                cut_volume_mm3=course.history.cut_mm3.get(name, 0.0), cut_time_s=course.history.cut_s.get(name, 0.0)
            ),
        )
        for i, name in enumerate(course.tools)
    }
    changed = np.flatnonzero(np.diff(course.tool, prepend=-1))
    workpiece = None
    if job.stock is not None:
        low, high = np.array(job.stock.low_mm), np.array(job.stock.high_mm)
        size, middle = high - low, (low + high) / 2
        workpiece = Workpiece(
            center_xy_mm=(float(middle[0]), float(middle[1])),
            size_xy_mm=(float(size[0]), float(size[1])),
            top_z_mm=float(high[2]),
            blank_mm=(float(size[0]), float(size[1]), float(size[2])),
        )
    return PartInfo(
        part=job.name,
        machine=machine.id,
        order=job.order,
        start_time_s=job.start_time_s,
        duration_s=duration_s,
        sample_rate_hz=rate_hz,
        material=job.material.name if job.material else None,
        program=PROGRAM,
        tools=tools,
        tool_changes=tuple(ToolChange(t=float(course.time[i]), tool_id=int(course.tool[i]) + 1) for i in changed),
        operations=_operations(course),
        ball_screw_lead_mm=dict(machine.ball_screw_lead_mm),
        vertical_axis=machine.vertical_axis,
        workpiece=workpiece,
    )


def _operations(course: Course) -> tuple[Operation, ...]:
    """One entry per NC block that was executed, in order."""
    starts = np.flatnonzero(np.diff(course.nc_line, prepend=-1))
    ends = np.append(starts[1:], len(course))
    speed = np.sqrt(sum(course.v[a] ** 2 for a in ("x", "y", "z")))
    found = []
    for start, end in zip(starts, ends, strict=True):
        rows = slice(start, end)
        middle = (start + end) // 2
        cut = course.mrr[rows] > 0
        found.append(
            Operation(
                nc_line=int(course.nc_line[start]),
                tool_id=int(course.tool[start]) + 1,
                feed_mm_s=round(float(np.median(speed[rows])), 4),
                rpm=round(float(course.v_sp[middle]) / 6.0, 2),
                a_p=round(float(course.a_p[rows][cut].mean()), 4) if cut.any() else None,
                a_e=round(float(course.a_e[rows][cut].mean()), 4) if cut.any() else None,
                coolant=bool(course.coolant[start]),
            )
        )
    return tuple(found)
