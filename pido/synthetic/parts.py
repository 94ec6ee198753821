"""A part to be made, and the course of things while the machine makes it: what every load and friction depends on.

In:  `PartJob`: program, tools, raw part, material, and what happened before.
Out: `Course`: set points, process quantities and history at the control's cycle (500 Hz).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pido.core.arrays import Bool1D, Float1D, Int1D
from pido.core.axes import LINEAR_AXES
from pido.core.columns import FORCE_SIM, POSITION
from pido.core.errors import SettingsError
from pido.core.machining import Machine, Material, Stock, Tool
from pido.core.part import PartInfo
from pido.core.recording import Recording
from pido.nc import interpret
from pido.process.motion import Motion, plan_motion
from pido.process.precheck import check_program
from pido.process.quantities import process_quantities
from pido.process.removal import raw_part
from pido.synthetic.drive import CYCLE_S

PROCESS_HZ = 50
GRID_MM = 0.25
_FROM_PROCESS = (*FORCE_SIM.values(), "m_sp_sim", "mrr_sim", "a_p", "a_e", "phi_s")


@dataclass(frozen=True)
class PartJob:
    """What is to be made. `stock` None is an air cut; `zero_mm` is where the origin of G54 to G57 lies in the machine.

    start_time_s : the machine's clock at the first sample; order : from 1
    """

    name: str
    program: str
    tools: Mapping[str, Tool]
    material: Material | None = None
    stock: Stock | None = None
    zero_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    order: int = 1
    start_time_s: float = 0.0


@dataclass(frozen=True)
class History:
    """What the machine did before: when it ran (start, end in s of its clock), what each tool cut (mm³, s)."""

    runs: tuple[tuple[float, float], ...] = ()
    cut_mm3: Mapping[str, float] = field(default_factory=dict)
    cut_s: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Course:
    """n samples of 500 Hz of one part.

    pos, v, a : per axis x, y, z (mm), set points; v_sp, a_sp : deg/s, deg/s², set points
    force : per axis, N; torque N·m; mrr mm³/s; edge_mm : engaged edge length
    cut_mm3, cut_s : what the tool in the spindle has cut so far, earlier parts included
    tool : index into `tools`; tool_kg : its mass
    """

    job: PartJob
    history: History
    time: Float1D
    pos: dict[str, Float1D]
    v: dict[str, Float1D]
    a: dict[str, Float1D]
    v_sp: Float1D
    force: dict[str, Float1D]
    spindle_force: Float1D
    torque: Float1D
    mrr: Float1D
    edge_mm: Float1D
    a_p: Float1D
    a_e: Float1D
    radius_mm: Float1D
    cut_mm3: Float1D
    cut_s: Float1D
    coolant: Float1D
    nc_line: Int1D
    tool: Int1D
    tool_kg: Float1D
    tools: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.time)

    @property
    def cutting(self) -> Bool1D:
        return self.mrr > 0

    @property
    def area_removal(self) -> Float1D:
        """AR = MRR / ||v||, mm²."""
        speed = np.sqrt(sum(self.v[a] ** 2 for a in LINEAR_AXES))
        return np.divide(self.mrr, speed, out=np.zeros(len(self)), where=speed > 0.01)

    def warmth(self, tau_s: float) -> Float1D:
        """(n,) – 0 cold, 1 warm: first order with tau_s, heated while parts run, cooling in the pauses."""
        warm, clock = 0.0, None
        for start, end in self.history.runs:
            if clock is not None:
                warm *= np.exp(-(start - clock) / tau_s)
            warm = 1 - (1 - warm) * np.exp(-(end - start) / tau_s)
            clock = end
        if clock is not None:
            warm *= np.exp(-(self.job.start_time_s - clock) / tau_s)
        return 1 - (1 - warm) * np.exp(-self.time / tau_s)

    def after(self) -> History:
        """The history with this part in it."""
        start = self.job.start_time_s
        volume, seconds = dict(self.history.cut_mm3), dict(self.history.cut_s)
        for i, name in enumerate(self.tools):
            rows = np.flatnonzero(self.tool == i)
            if len(rows):
                volume[name], seconds[name] = float(self.cut_mm3[rows[-1]]), float(self.cut_s[rows[-1]])
        return History((*self.history.runs, (start, start + float(self.time[-1]))), volume, seconds)


def plan_course(job: PartJob, machine: Machine, history: History | None = None) -> Course:
    """What the control commands and what the tool feels, before any drive moves.

    Raises ProgramError (not understood, outside the travel, gouge, raw part smaller than the path) and SettingsError (a
    tool that is not in the list, an impossible machine, a part that begins before the one before it has ended).
    """
    history = history or History()
    if history.runs and job.start_time_s < history.runs[-1][1]:
        raise SettingsError(
            f"part {job.name} begins at {job.start_time_s:g} s, before the part before it ends "
            f"({history.runs[-1][1]:g} s). Give it a later start_time_s."
        )
    if job.stock is not None and job.material is None:
        raise SettingsError(f"part {job.name}: a raw part needs its material.")
    path = interpret(
        job.program,
        machine=machine,
        tools=job.tools,
        start=_home(machine, job),
        zero_offsets=dict.fromkeys(("G54", "G55", "G56", "G57"), job.zero_mm),
    )
    if job.stock is not None:
        check_program(path, raw_part(job.stock, GRID_MM, machine.tool_axis), dict(job.tools), machine)
    motion = plan_motion(path, machine, 1 / CYCLE_S)
    return _course(job, machine, history, motion)


def _home(machine: Machine, job: PartJob) -> tuple[float, float, float]:
    """Where the axes stand before the program: above the program's origin, as far up as the travel allows."""
    low, high = machine.axes[machine.tool_axis].travel_mm
    at = list(job.zero_mm)
    k = LINEAR_AXES.index(machine.tool_axis)
    at[k] = min(job.zero_mm[k] + 100.0, high) if low < high else high
    return at[0], at[1], at[2]


def _course(job: PartJob, machine: Machine, history: History, motion: Motion) -> Course:
    n = len(motion.time)
    names = tuple(job.tools)
    if not any(motion.tool_id):
        raise SettingsError(f'part {job.name}: the program takes no tool; begin it with T="name" and M6.')
    index = np.array([names.index(t) if t else 0 for t in motion.tool_id])
    process = _process(job, machine, motion, names, index)
    time = np.arange(n, dtype=np.float64) * CYCLE_S
    volume, seconds = np.zeros(n), np.zeros(n)
    for i, name in enumerate(names):
        mine = index == i
        volume[mine] = history.cut_mm3.get(name, 0.0) + np.cumsum(process["mrr_sim"] * mine)[mine] * CYCLE_S
        seconds[mine] = history.cut_s.get(name, 0.0) + np.cumsum((process["mrr_sim"] > 0) & mine)[mine] * CYCLE_S
    tools = [job.tools[name] for name in names]
    radius = np.array([t.diameter_mm / 2 for t in tools])[index]
    teeth = np.array([t.teeth for t in tools])[index]
    return Course(
        job=job,
        history=history,
        time=time,
        pos={a: motion.pos_sp[:, k].copy() for k, a in enumerate(LINEAR_AXES)},
        v={a: motion.v_sp[:, k].copy() for k, a in enumerate(LINEAR_AXES)},
        a={a: motion.a_sp[:, k].copy() for k, a in enumerate(LINEAR_AXES)},
        v_sp=motion.v[:, 3].copy(),
        force={a: process[FORCE_SIM[a]] for a in LINEAR_AXES},
        spindle_force=process[FORCE_SIM["sp"]],
        torque=process["m_sp_sim"],
        mrr=process["mrr_sim"],
        edge_mm=process["a_p"] * process["phi_s"] * teeth / (2 * np.pi),
        a_p=process["a_p"],
        a_e=process["a_e"],
        radius_mm=radius,
        cut_mm3=volume,
        cut_s=seconds,
        coolant=np.asarray(motion.coolant, float),
        nc_line=np.asarray(motion.nc_line),
        tool=index,
        tool_kg=np.array([t.mass_kg or 1.0 for t in tools])[index],
        tools=names,
    )


def _process(job: PartJob, machine: Machine, motion: Motion, names: tuple[str, ...], tool: Int1D) -> dict[str, Float1D]:
    """Forces and removal at the control's cycle, from a removal simulation at `PROCESS_HZ`."""
    n = len(motion.time)
    if job.stock is None or job.material is None:
        return {name: np.zeros(n) for name in _FROM_PROCESS}
    every = round(1 / CYCLE_S / PROCESS_HZ)
    rows = np.arange(0, n, every)
    columns = {"time": rows * CYCLE_S, "v_sp": motion.v[rows, 3], "tool_id": np.array(names, dtype=object)[tool[rows]]}
    columns |= {POSITION[a]: motion.pos_sp[rows, k] for k, a in enumerate(LINEAR_AXES)}
    path = Recording(PartInfo(part=job.name, machine=machine.id), columns)
    cut = process_quantities(
        path, stock=job.stock, tools=job.tools, material=job.material, machine=machine, grid_mm=GRID_MM
    )
    at = np.arange(n) * CYCLE_S
    return {name: np.interp(at, path.time, np.nan_to_num(cut[name])) for name in _FROM_PROCESS}
