"""A case as files: part folders as a plant would write them, and the truth apart from them.

In:  a `Case`, two folders. Out: `p01`, `p02`, ... (recording.parquet, part.json), the last one unseen, and the truth.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.newcomer.fair import acting, split
from benchmarks.newcomer.parts import Part
from benchmarks.sealed_truth import Case, name_of, write_truth
from pido.core.arrays import Float1D
from pido.core.axes import AXES, LINEAR_AXES
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings.folder import write_folder


def write_case(case: Case, folder: Path, sealed: Path) -> list[Path]:
    """The part folders, in order, the unseen one last."""
    places = []
    for k, part in enumerate(case.parts):
        info = PartInfo.model_validate(_about(case, k))
        columns = {**_motion(part), **_process(part), **_optional(case, part)}
        for a in AXES:
            columns |= {f"curr_{a}": case.recorded[a][k], f"curr_{a}_sim": case.sim[a][k]}
        places.append(write_folder(Recording(info, columns), folder / info.part))
    acts = {a: split(acting(np.concatenate(list(case.effect[a]))), case.effect[a]) for a in AXES}
    write_truth(sealed, case.task, case.parts[0].machine.kind.name, case.effects, case.effect, acts)
    return places


def _motion(part: Part) -> dict[str, Float1D]:
    """Set points; positions as an encoder counts them, where the machine logs those."""
    count = part.machine.count_mm
    pos = np.round(part.pos / count) * count if count > 0 else part.pos
    columns = {"time": part.t}
    for k, name in enumerate(LINEAR_AXES):
        columns |= {f"pos_{name}": pos[:, k], f"v_{name}": part.v[:, k], f"a_{name}": part.a[:, k]}
    return columns | {"pos_sp": part.angle, "v_sp": part.v_sp, "a_sp": part.a_sp}


def _process(part: Part) -> dict[str, Float1D]:
    sign = part.machine.force_sign
    columns = {f"f_{a}_sim": sign * part.f_sim[:, k] for k, a in enumerate(LINEAR_AXES)}
    return columns | {"f_sp_sim": part.f_t_sim, "m_sp_sim": part.m_sim, "mrr_sim": part.mrr_sim}


def _optional(case: Case, part: Part) -> dict[str, Float1D]:
    there = {"nc_line": part.line, "tool_id": part.tool, "coolant": part.coolant}
    return {name: np.asarray(there[name], float) for name in case.columns}


def _about(case: Case, k: int) -> dict[str, Any]:
    part, machine = case.parts[k], case.parts[k].machine
    about: dict[str, Any] = {"part": name_of(k), "machine": "m1"}
    if not case.rich:
        return about
    changes = np.flatnonzero(np.r_[True, np.diff(part.tool) != 0])
    tools = {
        str(n): {"diameter_mm": c.diameter_mm, "teeth": c.teeth, "mass_kg": c.mass_kg,
                 "used_before": {"cut_volume_mm3": part.worn[n][0], "cut_time_s": part.worn[n][1]}}
        for n, c in machine.cutters.items()
    }  # fmt: skip
    operations = [
        {"nc_line": line, "tool_id": op.cutter, "feed_mm_s": op.feed_mm_s, "rpm": op.rpm, "a_p": op.a_p,
         "a_e": op.a_e, "coolant": int(op.coolant)}
        for line, op in enumerate(part.operations)
    ]  # fmt: skip
    size = np.full(3, float(part.size.max()))
    size[list(machine.kind.plane[:2])] = part.size
    about |= {
        "order": k + 1, "start_time_s": part.start, "duration_s": float(part.t[-1]), "sample_rate_hz": machine.rate,
        "tools": tools, "tool_changes": [{"t": float(part.t[c]), "tool_id": int(part.tool[c])} for c in changes],
        "operations": operations, "vertical_axis": machine.kind.vertical,
        "workpiece": {"center_xy_mm": part.centre[:2].tolist(), "size_xy_mm": size[:2].tolist(),
                      "top_z_mm": float(part.centre[2])},
    }  # fmt: skip
    if machine.kind.screw:
        about["ball_screw_lead_mm"] = dict.fromkeys(LINEAR_AXES, float(machine.kind.pitch_mm))
    return about
