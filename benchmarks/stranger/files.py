"""A case as files: part folders as a plant would write them, and the truth apart from them.

In:  a `Case`, two folders. Out: `p01`, `p02`, ... (recording.parquet, part.json), the last one unseen; and in the
sealed folder `truth.json` with, per part, `effect_<axis>` (A) and `acts_<axis>`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d

from benchmarks.sealed_truth import Case, name_of, write_truth
from benchmarks.stranger.fairness import acting
from benchmarks.stranger.parts import Part
from pido.core.arrays import Array1D, Float1D, Float2D
from pido.core.axes import AXES, LINEAR_AXES
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.recordings.folder import write_folder


def write_case(case: Case, folder: Path, sealed: Path) -> list[Path]:
    """The part folders, in order, the unseen one last."""
    rng = np.random.default_rng(case.seed)
    error = _smooth_error(rng)
    places = []
    for k, part in enumerate(case.parts):
        info = PartInfo.model_validate(_about(case, k))
        columns = {**_motion(part), **_process(part, error), **_optional(case, part)}
        for a in AXES:
            columns |= {f"curr_{a}": case.recorded[a][k], f"curr_{a}_sim": case.sim[a][k]}
        places.append(write_folder(Recording(info, columns), folder / info.part))
    machine = case.parts[0].plant.family.name
    acts = {a: _acting(case, a) for a in AXES}
    write_truth(sealed, case.task, machine, case.effects, case.effect, acts)
    return places


def _acting(case: Case, axis: str) -> list[Array1D]:
    """Per part (n,) bool: by one threshold for all parts."""
    lengths = [len(p.t) for p in case.parts]
    return np.split(acting(np.concatenate(case.effect[axis])), np.cumsum(lengths)[:-1])


def _motion(part: Part) -> dict[str, Float1D]:
    """Set points, or what an encoder of finite resolution makes of them."""
    plant = part.plant
    v, a, pos = part.v, part.a, part.pos
    if plant.encoder_mm > 0:
        pos = np.round(pos / plant.encoder_mm) * plant.encoder_mm
        v = np.round(v * plant.rate / plant.encoder_mm) * plant.encoder_mm / plant.rate
    if plant.differentiated and plant.rate >= 100:
        a = _differentiated(v, plant.rate)
    columns = {"time": part.t}
    for k, name in enumerate(LINEAR_AXES):
        columns |= {f"pos_{name}": pos[:, k], f"v_{name}": v[:, k], f"a_{name}": a[:, k]}
    return columns | {"pos_sp": part.angle, "v_sp": part.v_sp, "a_sp": part.a_sp}


def _differentiated(v: Float2D, rate: float) -> Float2D:
    """mm/s²: central differences, averaged over three samples."""
    a = uniform_filter1d(np.gradient(v, 1 / rate, axis=0), 3, axis=0)
    return np.where(np.abs(a) < 1e-3, 0.0, a)


def _smooth_error(rng: np.random.Generator) -> tuple[Float1D, Float1D]:
    return rng.uniform(3.0, 30.0, 3), rng.uniform(0, 2 * np.pi, 3)


def _process(part: Part, error: tuple[Float1D, Float1D]) -> dict[str, Float1D]:
    """Forces and removal as a simulation says them: right but for some per cent that vary slowly."""
    periods, phases = error
    waves = np.sin(2 * np.pi * part.t[:, None] / periods + phases).sum(axis=1) * np.sqrt(2 / 3)
    off = 1 + part.plant.force_error * waves
    columns = {f"f_{a}_sim": part.plant.force_sign * part.f[:, k] * off for k, a in enumerate(LINEAR_AXES)}
    return columns | {"f_sp_sim": part.f_t * off, "m_sp_sim": part.m * off, "mrr_sim": part.mrr * off}


def _optional(case: Case, part: Part) -> dict[str, Float1D]:
    there = {"nc_line": part.nc_line, "tool_id": part.tool, "coolant": part.coolant}
    return {name: np.asarray(there[name], float) for name in case.columns}


def _about(case: Case, k: int) -> dict[str, Any]:
    part, plant = case.parts[k], case.parts[k].plant
    about: dict[str, Any] = {"part": name_of(k), "machine": "plant"}
    if not case.rich:
        return about
    changes = np.flatnonzero(np.r_[True, np.diff(part.tool) != 0])
    size = 0.6 * plant.travel
    tools = {
        str(n): {"diameter_mm": c.diameter_mm, "teeth": c.teeth, "mass_kg": c.mass_kg,
                 "used_before": {"cut_volume_mm3": part.worn[n][0], "cut_time_s": part.worn[n][1]}}
        for n, c in plant.tools.items()
    }  # fmt: skip
    about |= {
        "order": k + 1, "start_time_s": part.start, "duration_s": float(part.t[-1]), "sample_rate_hz": plant.rate,
        "tools": tools, "tool_changes": [{"t": float(part.t[c]), "tool_id": int(part.tool[c])} for c in changes],
        "operations": [dict(o) for o in part.operations], "vertical_axis": plant.vertical,
        "workpiece": {"center_xy_mm": part.center[:2].tolist(), "size_xy_mm": size[:2].tolist(),
                      "top_z_mm": float(part.center[2])},
    }  # fmt: skip
    if not plant.linear_motor:
        about["ball_screw_lead_mm"] = {a: float(plant.lead[i]) for i, a in enumerate(LINEAR_AXES)}
    return about
