"""A series of parts on one machine: what its axes, spindle and process do.

In:  a machine, how many parts and how long, a random generator. Out: `Part`s at the fine step, in the machine's axes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from benchmarks.newcomer.cutting import Cut, drill, mill
from benchmarks.newcomer.interpolator import Motion, interpolate
from benchmarks.newcomer.machines import Machine
from benchmarks.newcomer.programs import draw_path
from benchmarks.newcomer.toolpaths import Operation, Path
from pido.core.arrays import Bool1D, Float1D, Float2D, Int1D


@dataclass(frozen=True, eq=False)
class Part:
    """Per sample, (n,) or (n, 3): t s; pos mm; v mm/s; a mm/s²; angle deg, v_sp deg/s, a_sp deg/s²; f N, that the
    drives must provide; f_t N; m N·m; mrr mm³/s; edge mm; engaged; coolant 0/1; tool number; line : index of operation

    f_sim, m_sim, mrr_sim, f_t_sim : the same by the simulation; start : s, machine's clock; centre : mm, (3,), of the
    workpiece's top; size : mm, (2,), in the work plane; worn : per tool (mm³, s) that it had cut before
    """

    machine: Machine
    t: Float1D
    pos: Float2D
    v: Float2D
    a: Float2D
    angle: Float1D
    v_sp: Float1D
    a_sp: Float1D
    f: Float2D
    f_t: Float1D
    m: Float1D
    mrr: Float1D
    edge: Float1D
    engaged: Bool1D
    coolant: Float1D
    tool: Int1D
    line: Int1D
    f_sim: Float2D
    f_t_sim: Float1D
    m_sim: Float1D
    mrr_sim: Float1D
    start: float
    centre: Float1D
    size: Float1D
    worn: Mapping[int, tuple[float, float]]
    operations: tuple[Operation, ...]

    @property
    def speed(self) -> Float1D:
        """(n,), mm/s: of the path."""
        return np.linalg.norm(self.v, axis=1)

    @property
    def area(self) -> Float1D:
        """(n,), mm²: area removal AR = MRR / speed by the simulation (paper, eq. 7); 0 where nothing moves."""
        speed = self.speed
        return np.where(speed > 1e-6, self.mrr_sim / np.maximum(speed, 1e-6), 0.0)

    def thinned(self) -> Part:
        """At the samples of the log."""
        step = self.machine.fine
        rows = {f.name: getattr(self, f.name) for f in fields(self)}
        n = len(self.t)
        return replace(
            self, **{k: x[::step] for k, x in rows.items() if isinstance(x, np.ndarray) and len(x) == n and n > 3}
        )


@dataclass(frozen=True)
class Length:
    """parts : fewest and most that are shown; seconds : shortest and longest; rows : most in a case at the log's rate;
    fine_rows : most at the fine step
    """

    parts: tuple[int, int] = (5, 9)
    seconds: tuple[float, float] = (60.0, 240.0)
    rows: int = 400_000
    fine_rows: int = 480_000


def draw_parts(machine: Machine, length: Length, straight: bool, rng: np.random.Generator) -> list[Part]:
    """The parts to be shown and an unseen one. straight : all motion along one line"""
    number = int(rng.integers(length.parts[0], length.parts[1] + 1))
    room = min(length.rows / machine.rate, length.fine_rows * machine.dt)
    while number > length.parts[0] and room / (number + 1) < 1.15 * length.seconds[0]:
        number -= 1
    most = min(length.seconds[1], room / (number + 1))
    seconds = np.exp(rng.uniform(np.log(min(length.seconds[0], most)), np.log(most), number + 1))
    worn = {n: (float(rng.uniform(0, 3e4)), float(rng.uniform(0, 600))) for n in machine.cutters}
    pause = float(rng.uniform(10, 240))
    reach = np.sqrt(machine.kind.feeds_mm_s[0] * machine.kind.feeds_mm_s[1]) * float(rng.uniform(4, 9))
    size = np.minimum(reach * rng.uniform(0.7, 1.2, 2), 0.5 * machine.travel[list(machine.kind.plane[:2])])
    again = rng.random() < 0.4
    seeds = rng.integers(2**31, size=2 if again else number + 1)
    start, parts = 0.0, []
    for k in range(number + 1):
        own = np.random.default_rng(seeds[k % len(seeds)])
        path = draw_path(machine, size, 1.05 * float(seconds[k]), straight, own)
        parts.append(_part(machine, path, size, float(seconds[k]), start, dict(worn), rng))
        for n in worn:
            here = parts[-1].engaged & (parts[-1].tool == n)
            volume = float(np.sum(parts[-1].mrr[here]) * machine.dt)
            worn[n] = (worn[n][0] + volume, worn[n][1] + float(here.sum() * machine.dt))
        start += float(seconds[k]) + pause * float(rng.uniform(0.5, 1.5))
    return parts


def _part(
    machine: Machine,
    path: Path,
    size: Float1D,
    seconds: float,
    start: float,
    worn: Mapping[int, tuple[float, float]],
    rng: np.random.Generator,
) -> Part:
    """One part: motion, then spindle, then cut."""
    n = int(seconds / machine.dt)
    plane = list(machine.kind.plane)
    centre = machine.travel * rng.uniform(0.42, 0.58, 3)
    points = np.empty((len(path.points), 3))
    points[:, plane] = np.array(path.points)
    motion = interpolate(centre + points, np.array(path.feeds), np.array(path.rests), machine, n)
    line = np.array(path.of)[motion.step]
    ops = path.operations
    v_sp, a_sp, angle = _spindle(machine, ops, line, rng)
    filled = _filled(machine, np.array(path.cuts)[motion.step], rng)
    filled = np.where(np.linalg.norm(motion.v, axis=1) > 1e-3, filled, 0.0)
    cut, f = _forces(machine, ops, line, motion, v_sp, filled)
    t = machine.dt * np.arange(n, dtype=float)
    off = 1 + machine.force_error * _slow(t, rng)
    engaged = cut.removal > 0
    wet = np.array([op.coolant for op in ops])[line].astype(float)
    return Part(
        machine, t, motion.pos, motion.v, motion.a, angle, v_sp, a_sp, f, cut.tangential, cut.torque, cut.removal,
        cut.edge, engaged, wet, np.array([op.cutter for op in ops])[line], line,
        f * off[:, None], cut.tangential * off, cut.torque * off, cut.removal * off, start, centre, size, worn,
        tuple(ops),
    )  # fmt: skip


def _slow(t: Float1D, rng: np.random.Generator) -> Float1D:
    """(n,), about ±1: what a simulated force is off by, over tens of seconds."""
    knots = np.arange(0, t[-1] + 24, 8.0)
    return np.interp(t, knots, rng.uniform(-1.4, 1.4, len(knots)))


def _filled(machine: Machine, cuts: Float1D, rng: np.random.Generator) -> Float1D:
    """(n,), 0 to 1: how far the depths are really engaged, soft at entry and exit, with stretches of less stock."""
    n = len(cuts)
    soft = uniform_filter1d(cuts, 2 * max(1, round(0.06 / machine.dt)) + 1)
    rough = gaussian_filter1d(rng.normal(size=n), 0.8 / machine.dt, mode="wrap")
    level = np.clip(0.75 + 0.35 * rough / max(float(np.std(rough)), 1e-12), 0.15, 1.0)
    filled = soft * level
    return np.where(filled < 0.02, 0.0, filled)


def _spindle(
    machine: Machine, ops: list[Operation], line: Int1D, rng: np.random.Generator
) -> tuple[Float1D, Float1D, Float1D]:
    """(speed deg/s, acceleration deg/s², angle deg): to each operation's speed; off for a moment at a tool change."""
    dt, steepest = machine.dt, 6 * machine.kind.rpm[1] / machine.kind.run_up_s
    begins = np.flatnonzero(np.r_[True, np.diff(line) != 0])
    times, speeds, now = [-1.0], [0.0], 0.0
    for k, b in enumerate(begins):
        op, at = ops[line[b]], max(b * dt, times[-1] + dt)
        wants = [6 * op.rpm]
        if k > 0 and ops[line[begins[k - 1]]].cutter != op.cutter:
            wants = [0.0, *wants]
        end = begins[k + 1] * dt if k + 1 < len(begins) else len(line) * dt
        for want in wants:
            ramp = max(abs(want - now) / steepest, dt)
            times += [at, at + ramp]
            speeds += [now, want]
            at, now = at + ramp + (0.4 if want == 0 else 0.0), want
        while rng.random() < 0.5 and at + 6 < end:
            at += float(rng.uniform(4, 12))
            want = 6 * op.rpm * float(rng.uniform(0.85, 1.15))
            ramp = max(abs(want - now) / steepest, dt)
            times += [at, at + ramp]
            speeds += [now, want]
            at, now = at + ramp, want
    order = np.maximum.accumulate(np.array(times) + 1e-9 * np.arange(len(times)))
    v = np.interp(np.arange(len(line)) * dt, order, speeds)
    v = uniform_filter1d(v, 2 * max(1, round(0.08 * machine.kind.run_up_s / dt)) + 1, mode="nearest")
    v[v < 1e-3] = 0.0
    a = np.gradient(v, dt)
    a[np.abs(a) < 1e-2] = 0.0
    return v, a, np.mod(np.cumsum(v) * dt, 360.0)


def _forces(
    machine: Machine, ops: list[Operation], line: Int1D, motion: Motion, v_sp: Float1D, filled: Float1D
) -> tuple[Cut, Float2D]:
    """(cut, forces on the machine's axes): along the feed, to its left in the work plane, and along the infeed."""
    per = lambda name: np.array([float(getattr(op, name)) for op in ops])[line]  # noqa: E731
    D = np.array([machine.cutters[op.cutter].diameter_mm for op in ops])[line]
    z = np.array([float(machine.cutters[op.cutter].teeth) for op in ops])[line]
    speed, n = np.linalg.norm(motion.v, axis=1), v_sp / 360.0
    bore, k_c = per("drill") > 0, machine.specific_n_mm2
    side = mill(speed, n, D, z, per("a_p") * filled, per("a_e"), per("down") > 0, k_c)
    deep = drill(speed, n, np.minimum(D, 12.0), z, filled, k_c)
    cut = Cut(**{f.name: np.where(bore, getattr(deep, f.name), getattr(side, f.name)) for f in fields(Cut)})
    heading = motion.v / np.maximum(speed, 1e-9)[:, None]
    u, w, infeed = machine.kind.plane
    flat = np.hypot(heading[:, u], heading[:, w]) + 1e-9
    f = cut.along[:, None] * heading
    f[:, u] -= cut.left * heading[:, w] / flat * (flat > 1e-3)
    f[:, w] += cut.left * heading[:, u] / flat * (flat > 1e-3)
    f[:, infeed] += cut.infeed
    return cut, f
