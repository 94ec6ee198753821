"""What one axis did and carries along in one part: the state that mechanisms act on.

In:  recordings in production order, one axis.
Out: `AxisState` per part: motion, memory (held direction, reversals, wear, clock), load, surroundings.
What a recording cannot give is None, and mechanisms that need it do not apply; nothing is guessed. Two things are
derived where they are missing: speed from position and acceleration from speed, by central differences. Only the
simulated, never the recorded current is needed here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pido.core.arrays import Array1D, Bool1D, Float1D, Float2D
from pido.core.axes import AXES, LINEAR_AXES
from pido.core.columns import ACCELERATION, CURRENT, CURRENT_SIM, FORCE_SIM, POSITION
from pido.core.machining import Machine
from pido.core.part import PartTool
from pido.core.recording import Recording
from pido.core.spindle_tool import tool_in_spindle
from pido.diagnosis.bands import LINEAR_DEAD_BAND, dead_bands, numbers, speed_of
from pido.diagnosis.faults import beyond_load, displaced, faulty
from pido.physics.friction import held_direction

Worn = Mapping[str, tuple[float, float]]
"""Tool ('' where nothing says which) -> mm³, s that its present edge has cut."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of another axis, (n,) each: mm/s, mm/s² (spindle deg/s, deg/s²), -1/0/+1, bool.

    along : -1/0/+1, the direction while it moves, 0 at standstill; of averaged rows the mean, as of `held`
    wrong : rows in which one of its signals is faulty, None where none is
    """

    v: Float1D
    a: Float1D
    held: Float1D
    moving: Bool1D
    along: Float1D
    wrong: Bool1D | None = None

    @classmethod
    def with_band(cls, v: Float1D, a: Float1D, held: Float1D, band: float) -> Motion:
        """Of an axis that moves while |v| is above `band`, in the unit of v."""
        moving = np.abs(v) > band
        return cls(v, a, held, moving, held * moving)


@dataclass(frozen=True, eq=False)
class AxisState:
    """One axis of one part, (n,) each unless said otherwise. Optional fields are None where the data do not give them.

    held : sign of the last real motion, 0 while unknown; moving : |v| above the dead band; along : `held` while moving
    since_reversal : mm (deg) travelled, and since_reversal_s : s passed, since the last reversal; inf before the first
    segment : number of reversals so far
    way : mm (deg) travelled since the part began
    force, force_perp : N, process force along the axis and across it; forces : N, along every axis that has one
    m_sp : N·m; mrr : mm³/s; ar : mm²
    engaged : the tool cuts; edge_length : mm, axial depth of cut where the operations give it; end_length : mm, the
        same, in a plunge the radius of the tool, which then cuts with its end
    teeth_in_cut : mean number of teeth that are in the material at once; tool_radius : mm
    edge_in_cut : mm, edge of the whole operation in the material, in proportion to the area that is really removed
    cut_volume, cut_time : mm³, s that the present cutting edge has cut, `used_before` and earlier parts included
    clock : s, the machine's own; earlier : (start, end) on that clock of the parts made before, s
    places : machine position of each linear axis, mm; angle : of the spindle, deg
    wx, wy, wz : mm from the centre (top) of the workpiece; workpiece_size : its (x, y) size, mm
    lead : ball screw lead, mm; vertical : True where gravity acts along the axis
    sim, curr : A, simulated and recorded current; sims : A, simulated current of the other axes
    sim_held : -1..1, `along` in motion, and at rest how much of its friction the simulation holds there; None where
        that is nothing, or no other than `held` (see `sim_rest`)
    usable : rows that may be fitted
    ranges : (n, 2) – least and most, within rows that were averaged, of each variable that limits a region
    """

    axis: str
    part: str
    time: Float1D
    dt: float
    pos: Float1D | None
    v: Float1D
    a: Float1D
    held: Float1D
    moving: Bool1D
    along: Float1D
    since_reversal: Float1D
    since_reversal_s: Float1D
    segment: Float1D
    way: Float1D | None = None
    others: Mapping[str, Motion] = field(default_factory=dict)
    force: Float1D | None = None
    forces: Mapping[str, Float1D] = field(default_factory=dict)
    force_perp: Float1D | None = None
    m_sp: Float1D | None = None
    mrr: Float1D | None = None
    ar: Float1D | None = None
    engaged: Bool1D | None = None
    edge_length: Float1D | None = None
    end_length: Float1D | None = None
    teeth_in_cut: Float1D | None = None
    edge_in_cut: Float1D | None = None
    tool_radius: Float1D | None = None
    coolant: Float1D | None = None
    tool_id: Array1D | None = None
    tool_mass: Float1D | None = None
    cut_volume: Float1D | None = None
    cut_time: Float1D | None = None
    clock: Float1D | None = None
    earlier: tuple[tuple[float, float], ...] | None = None
    places: Mapping[str, Float1D] = field(default_factory=dict)
    angle: Float1D | None = None
    wx: Float1D | None = None
    wy: Float1D | None = None
    wz: Float1D | None = None
    workpiece_size: tuple[float, float] | None = None
    nc_line: Float1D | None = None
    lead: float | None = None
    vertical: bool | None = None
    sim: Float1D | None = None
    curr: Float1D | None = None
    sims: Mapping[str, Float1D] = field(default_factory=dict)
    sim_held: Float1D | None = None
    usable: Bool1D = field(default_factory=lambda: np.zeros(0, bool))
    ranges: Mapping[str, Float2D] = field(default_factory=dict)

    @property
    def speeds(self) -> dict[str, Float1D]:
        """Linear axis -> (n,), mm/s, as far as they are known."""
        each = {n: m.v for n, m in self.others.items()} | {self.axis: self.v}
        return {n: v for n, v in each.items() if n in LINEAR_AXES}


def axis_state(recording: Recording, axis: str, machine: Machine | None = None) -> AxisState:
    """The state of one axis in one part, without what earlier parts left behind."""
    return axis_states([recording], axis, machine)[0]


def axis_states(
    recordings: Sequence[Recording],
    axis: str,
    machine: Machine | None = None,
    bands: Mapping[str, float] | None = None,
    worn: Worn | None = None,
) -> tuple[AxisState, ...]:
    """The state of one axis in every part; wear and the machine's clock are carried from part to part.

    recordings : in production order
    machine : gives dead bands, leads and the vertical axis where a part's own data do not
    bands : the dead bands of `dead_bands` where they were read before, from other parts of the same machine
    worn : what the tools had cut before the first of the recordings
    """
    bands = dead_bands(recordings, machine, bands)
    carried = dict(worn or {})
    past: list[tuple[float, float]] = []
    clock_known = True
    states = []
    for recording in recordings:
        clock_known &= recording.part.start_time_s is not None
        states.append(_state(recording, axis, machine, bands, carried, tuple(past) if clock_known else None))
        if (run := running(recording)) is not None:
            past.append(run)
    return tuple(states)


def running(recording: Recording) -> tuple[float, float] | None:
    """First and last sample on the machine's clock, s, wherever its own time begins; None where no part.json says."""
    start = recording.part.start_time_s
    return None if start is None else (start, start + float(recording.time[-1] - recording.time[0]))


def worn_before(recordings: Sequence[Recording]) -> list[Worn]:
    """What the tools had cut before each of the recordings, which are in production order, and after the last."""
    worn: dict[str, tuple[float, float]] = {}
    found: list[Worn] = [{}]
    for recording in recordings:
        mrr = numbers(recording, "mrr_sim")
        engaged = _engaged(mrr, numbers(recording, "m_sp_sim"), _forces(recording))
        _wear(recording, _tool(recording), mrr, engaged, worn)
        found.append(dict(worn))
    return found


def _state(
    recording: Recording,
    axis: str,
    machine: Machine | None,
    bands: Mapping[str, float],
    worn: dict[str, tuple[float, float]],
    earlier: tuple[tuple[float, float], ...] | None,
) -> AxisState:
    time = recording.time
    motions = {a: m for a in AXES if (m := _judged(recording, a, bands)) is not None}
    still, recorded = np.zeros(len(time)), motions.pop(axis, None)
    own = recorded or Motion(still, still, still, still.astype(bool), still)
    pos = _position(recording, axis)
    since, since_s, segment = _since_reversal(time, own, pos)
    forces = _forces(recording)
    across = [f for a, f in forces.items() if a != axis]
    complete = len(across) == len([a for a in LINEAR_AXES if a != axis])
    m_sp, mrr = numbers(recording, "m_sp_sim"), numbers(recording, "mrr_sim")
    engaged = _engaged(mrr, m_sp, forces)
    info = recording.part
    tool = _tool(recording)
    volume, in_cut = _wear(recording, tool, mrr, engaged, worn)
    ar, depth = _area_removal(mrr, own, motions, axis), _operation(recording, "a_p")
    radius = _of_tool(recording, tool, lambda t: None if t.diameter_mm is None else t.diameter_mm / 2)
    piece = info.workpiece
    center = None if piece is None else piece.center_xy_mm
    top = None if piece is None else piece.top_z_mm
    places = {a: p for a in LINEAR_AXES if (p := _position(recording, a)) is not None}
    pos_x, pos_y, pos_z = (places.get(a) for a in LINEAR_AXES)
    lead = info.ball_screw_lead_mm.get(axis)
    vertical = info.vertical_axis
    if machine is not None:
        lead = machine.ball_screw_lead_mm.get(axis) if lead is None else lead
        vertical = machine.vertical_axis if vertical is None else vertical
    clock = None if info.start_time_s is None else info.start_time_s + time - time[:1]
    usable = np.isfinite(own.v) & np.isfinite(own.a) & ~beyond_load(recording)
    if own.wrong is not None:
        usable &= ~own.wrong
    dt = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    return AxisState(
        axis=axis,
        part=info.part,
        time=time,
        dt=dt,
        pos=pos,
        v=own.v,
        a=own.a,
        held=own.held,
        moving=own.moving,
        along=own.along,
        since_reversal=since,
        since_reversal_s=since_s,
        segment=segment,
        way=None if recorded is None else np.cumsum(np.where(own.moving, np.abs(own.v), 0.0)) * dt,
        others=motions,
        force=forces.get(axis),
        forces=forces,
        force_perp=np.sqrt(np.sum(np.square(across), axis=0)) if complete else None,
        m_sp=m_sp,
        mrr=mrr,
        ar=ar,
        engaged=engaged,
        edge_length=depth,
        end_length=_end_length(depth, radius, {**motions, axis: own}),
        teeth_in_cut=_teeth_in_cut(recording, tool, radius, ar, depth),
        edge_in_cut=_edge_in_cut(recording, tool, radius, ar, depth, {**motions, axis: own}),
        tool_radius=radius,
        coolant=c if (c := numbers(recording, "coolant")) is not None else _operation(recording, "coolant"),
        tool_id=tool,
        tool_mass=_of_tool(recording, tool, lambda t: t.mass_kg),
        cut_volume=volume,
        cut_time=in_cut,
        clock=clock,
        earlier=earlier,
        places=places,
        angle=_position(recording, "sp"),
        wx=None if center is None or pos_x is None else pos_x - center[0],
        wy=None if center is None or pos_y is None else pos_y - center[1],
        wz=None if top is None or pos_z is None else pos_z - top,
        workpiece_size=None if piece is None else piece.size_xy_mm,
        nc_line=numbers(recording, "nc_line"),
        lead=lead,
        vertical=None if vertical is None else vertical == axis,
        sim=numbers(recording, CURRENT_SIM[axis]),
        curr=numbers(recording, CURRENT[axis]),
        sims={a: i for a in AXES if a != axis and (i := numbers(recording, CURRENT_SIM[a])) is not None},
        usable=usable,
    )


def _judged(recording: Recording, axis: str, bands: Mapping[str, float]) -> Motion | None:
    """The motion of an axis with the rows that its signals make unusable."""
    found = motion(recording, axis, bands)
    if found is None:
        return None
    wrong = faulty(recording, axis)
    return replace(found, wrong=wrong) if wrong.any() else found


def motion(recording: Recording, axis: str, bands: Mapping[str, float]) -> Motion | None:
    """Speed, acceleration and direction of one axis, derived where they are missing; None without any."""
    v, a = speed_of(recording, axis), numbers(recording, ACCELERATION[axis])
    if v is None:
        return None
    if a is None:
        a = np.gradient(v, recording.time) if len(v) > 1 else np.zeros(len(v))
    return Motion.with_band(v, a, held_direction(v, bands[axis]), bands[axis])


def _since_reversal(time: Float1D, own: Motion, pos: Float1D | None) -> tuple[Float1D, Float1D, Float1D]:
    known = own.held != 0
    last = np.maximum.accumulate(np.where(known, np.arange(len(known)), -1))
    before = np.r_[0.0, np.where(last[:-1] >= 0, own.held[np.maximum(last[:-1], 0)], 0.0)]
    turns = known & (before != 0) & (own.held != before)
    at = np.maximum.accumulate(np.where(turns, np.arange(len(turns)), -1))
    step = np.diff(time, prepend=time[:1])
    if pos is None or own.v is None:
        way = np.cumsum(np.abs(np.nan_to_num(own.v)) * own.moving * step)
    else:
        # Where the position is not known, the speed says how far the axis went.
        moved = np.diff(pos, prepend=pos[:1])
        moved = np.where(np.isfinite(moved), moved, np.nan_to_num(own.v) * step)
        way = np.cumsum(np.abs(moved) * own.moving)
    # The axis turned about half a sample before the first sample of the new direction.
    origin = np.maximum(at - 1, 0)
    since = np.where(at >= 0, way - (way[origin] + way[np.maximum(at, 0)]) / 2, np.inf)
    since_s = np.where(at >= 0, time - (time[origin] + time[np.maximum(at, 0)]) / 2, np.inf)
    return since, since_s, np.cumsum(turns).astype(float)


def _forces(recording: Recording) -> dict[str, Float1D]:
    """Simulated force along every linear axis that has one, N."""
    return {a: f for a in LINEAR_AXES if (f := numbers(recording, FORCE_SIM[a])) is not None}


def _engaged(mrr: Float1D | None, m_sp: Float1D | None, forces: Mapping[str, Float1D]) -> Bool1D | None:
    load = mrr if mrr is not None else m_sp
    if load is None:
        if not forces:
            return None
        load = np.sqrt(np.sum(np.square(list(forces.values())), axis=0))
    top = float(np.nanmax(np.abs(load), initial=0.0))
    return np.abs(load) > 1e-6 * top


def speed_along_path(speeds: Mapping[str, Float1D]) -> Float1D:
    """(n,), mm/s – of the tool, from those of its linear axes, at least one of them."""
    path: Float1D = np.linalg.norm([speeds[a] for a in LINEAR_AXES if a in speeds], axis=0)
    return path


def _area_removal(mrr: Float1D | None, own: Motion, others: Mapping[str, Motion], axis: str) -> Float1D | None:
    moved = {**others, axis: own}
    if mrr is None or any(a not in moved for a in LINEAR_AXES):
        return None
    speed = speed_along_path({a: m.v for a, m in moved.items()})
    return np.where(speed > LINEAR_DEAD_BAND, mrr / np.maximum(speed, LINEAR_DEAD_BAND), 0.0)


def _end_length(depth: Float1D | None, radius: Float1D | None, moved: Mapping[str, Motion]) -> Float1D | None:
    """The axial depth of cut; where the tool goes mainly along its axis, its radius."""
    if depth is None or radius is None or any(a not in moved for a in LINEAR_AXES):
        return depth
    return np.where(_plunges(moved) & (depth > 0) & np.isfinite(radius), radius, depth)


def _plunges(moved: Mapping[str, Motion]) -> Bool1D:
    """Whether the tool goes mainly along its axis."""
    return np.abs(moved["z"].v) > np.maximum(np.hypot(moved["x"].v, moved["y"].v), LINEAR_DEAD_BAND)


def _teeth_in_cut(
    recording: Recording, tool: Array1D | None, radius: Float1D | None, ar: Float1D | None, depth: Float1D | None
) -> Float1D | None:
    """z * phi / (2 pi), engagement angle phi = arccos(1 - 2 a_e / D) (Altintas, Manufacturing Automation, ch. 2).

    a_e is what the material removed in each sample says, or else the operation. Without a tool's number of teeth, one.
    """
    width, teeth = _operation(recording, "a_e"), _of_tool(recording, tool, lambda t: t.teeth or 1)
    if ar is not None and depth is not None:
        width = np.where(depth > 0, ar / np.where(depth > 0, depth, 1.0), np.nan if width is None else width)
    if width is None or teeth is None or radius is None:
        return None
    return _teeth_over(width, teeth, radius)


def _teeth_over(width: Float1D, teeth: Float1D, radius: Float1D) -> Float1D:
    """(n,) – mean number of teeth in the material over a radial depth of cut."""
    return teeth * np.arccos(1.0 - np.clip(width / radius, 0.0, 2.0)) / (2.0 * np.pi)


def _edge_in_cut(
    recording: Recording,
    tool: Array1D | None,
    radius: Float1D | None,
    ar: Float1D | None,
    depth: Float1D | None,
    moved: Mapping[str, Motion],
) -> Float1D | None:
    """Edge in the material, mm: of the whole operation, a_p times the mean number of teeth in cut, by the share of its
    area a_p * a_e that is removed. A plunge has all teeth over the tool's radius in the material, and its whole area.
    """
    width, teeth = _operation(recording, "a_e"), _of_tool(recording, tool, lambda t: t.teeth or 1)
    if ar is None or depth is None or width is None or teeth is None or radius is None:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        edge = np.where(_plunges(moved), teeth / (np.pi * radius), _teeth_over(width, teeth, radius) / width) * ar
    return np.where(ar > 0, np.nan_to_num(edge, nan=0.0, posinf=0.0), 0.0)


def _of_tool(recording: Recording, tool: Array1D | None, what: Callable[[PartTool], float | None]) -> Float1D | None:
    """(n,): what each sample's tool has; NaN where that is not known; None where it is of no tool."""
    known = {k: value for k, t in recording.part.tools.items() if (value := what(t)) is not None}
    if tool is None or not known:
        return None
    out = np.full(len(tool), np.nan)
    for key in dict.fromkeys(tool):
        out[tool == key] = known.get(str(key), np.nan)
    return out


def _tool(recording: Recording) -> Array1D | None:
    """(n,) text – tool per sample, '' where it is not known; the only one there is where nothing else says."""
    tool, tools = tool_in_spindle(recording), recording.part.tools
    if tool is None and len(tools) == 1:
        return np.full(len(recording), next(iter(tools)), dtype=object)
    return tool


def seconds_of_each(time: Float1D) -> Float1D:
    """(n,), s – since the sample before, at most 1: what was not recorded for longer was no cut."""
    return np.minimum(np.diff(time, prepend=time[:1]), 1.0)


def _wear(
    recording: Recording,
    tool: Array1D | None,
    mrr: Float1D | None,
    engaged: Bool1D | None,
    worn: dict[str, tuple[float, float]],
) -> tuple[Float1D | None, Float1D | None]:
    """Volume and time that the cutting edge has cut so far; `worn` carries them from part to part."""
    if engaged is None:
        return None, None
    step = seconds_of_each(recording.time)
    keys = np.full(len(engaged), "", dtype=object) if tool is None else tool
    cut = np.zeros(len(engaged)) if mrr is None else np.nan_to_num(mrr) * step
    volume, seconds = np.zeros(len(engaged)), np.zeros(len(engaged))
    for key in dict.fromkeys(keys):
        rows = keys == key
        about = recording.part.tools.get(str(key))
        before = worn.get(str(key), (0.0, 0.0))
        if about is not None and about.used_before is not None:
            before = (about.used_before.cut_volume_mm3, about.used_before.cut_time_s)
        volume[rows] = before[0] + np.cumsum(cut[rows])
        seconds[rows] = before[1] + np.cumsum((engaged * step)[rows])
        worn[str(key)] = (float(volume[rows][-1]), float(seconds[rows][-1]))
    return (None if mrr is None else volume), seconds


def coolant_recorded(states: Sequence[AxisState]) -> bool:
    """Whether every part says when coolant is on."""
    return all(s.coolant is not None for s in states)


def _operation(recording: Recording, what: str) -> Float1D | None:
    """An entry of the operations of part.json for every sample, by its NC block; NaN where no entry says."""
    operations = sorted(recording.part.operations, key=lambda o: o.nc_line)
    line = numbers(recording, "nc_line")
    if line is None or all(getattr(o, what) is None for o in operations):
        return None
    values = np.array([np.nan, *(np.nan if (x := getattr(o, what)) is None else float(x) for o in operations)])
    return values[np.searchsorted([o.nc_line for o in operations], line, side="right")]


def _position(recording: Recording, axis: str) -> Float1D | None:
    """The position of an axis, NaN where it cannot be told."""
    pos = numbers(recording, POSITION[axis])
    if pos is None:
        return None
    lost = displaced(recording, axis)
    return np.where(lost, np.nan, pos) if lost.any() else pos
