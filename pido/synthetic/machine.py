"""A virtual three-axis mill: what it commands, what its drives do, what its sensors write, what its simulation says.

In:  `PartJob`s in the order of production, effects that the machine has and its simulation lacks, a seed.
Out: per part the recording with `curr_<axis>_sim`, and the truth behind it.

The simulation integrates the same machine along the same commands without the effect and without the sensors'
noise. So with no effect, recording and simulation differ by the noise alone; with one, by the answer of the whole
control loop to it, not by the effect's formula.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pido.core.arrays import Array1D, Float1D
from pido.core.axes import AXES, LINEAR_AXES
from pido.core.columns import ACCELERATION, CURRENT, CURRENT_SIM, FORCE_SIM, POSITION, VELOCITY
from pido.core.errors import SettingsError
from pido.core.machining import Machine
from pido.core.recording import Recording
from pido.synthetic.describe import part_info
from pido.synthetic.drive import CYCLE_S, Drive, DriveMotion, run_axis
from pido.synthetic.effects import Effective
from pido.synthetic.faults import CURRENT_FAULTS, faulty_current, faulty_signal
from pido.synthetic.laws import Setup
from pido.synthetic.parts import Course, History, PartJob, plan_course
from pido.synthetic.sensors import Sensors, derivative, quantised, smoothed, wrapped
from pido.synthetic.spindle import Spindle, run_spindle

RATES_HZ = (50.0, 500.0)


@dataclass(frozen=True)
class VirtualMill:
    """machine: limits; drives: per linear axis; thermal_share: by how much Coulomb friction falls when warm.

    reaction: share of the simulated process force that the drives feel. Forces are those of one tooth at its mean chip
    (paper, section III-B), which over the engagement and with the published coefficients is several times the
    mean force.
    """

    machine: Machine
    drives: Mapping[str, Drive]
    spindle: Spindle
    sensors: Sensors
    reaction: float = 0.3
    thermal_share: float = 0.05
    thermal_s: float = 900.0

    def __post_init__(self) -> None:
        missing = set(LINEAR_AXES) - set(self.drives) | set(AXES) - set(self.sensors.current)
        if missing:
            raise SettingsError(
                f"virtual mill {self.machine.id}: no drive or current sensor for {', '.join(sorted(missing))}."
            )
        for axis in LINEAR_AXES:
            self.drives[axis].check(axis)
        self.spindle.check()
        self.sensors.check()
        if not 0 <= self.thermal_share < 1 or not self.thermal_s > 0:
            raise SettingsError("thermal_share must lie in 0..1 and thermal_s above 0.")
        if not self.reaction >= 0:
            raise SettingsError(f"reaction = {self.reaction:g} is negative.")

    def plan(self, jobs: Sequence[PartJob]) -> list[Course]:
        """The courses of parts that are made one after another; each knows what was before it."""
        courses: list[Course] = []
        history = History()
        for job in jobs:
            courses.append(plan_course(job, self.machine, history))
            history = courses[-1].after()
        return courses

    def setup(self, axis: str, course: Course) -> Setup:
        """One axis as the machine is by nature."""
        n = len(course)
        if axis == "sp":
            cut = self.reaction * course.torque * np.tanh(course.v_sp / 60.0)
            return Setup(axis, self.spindle, cut, np.zeros(n), self.reaction)
        drive = self.drives[axis]
        cooler = -self.thermal_share * drive.coulomb_n * course.warmth(self.thermal_s)
        return Setup(axis, drive, -self.reaction * course.force[axis], cooler, self.reaction)


@dataclass(frozen=True, eq=False)
class Truth:
    """What is true of one part. effect: per axis what recording - simulation has beyond noise, A.

    noise: per axis the noise in the recorded current; single: the current of each effect alone, in their order.
    """

    effects: tuple[Effective, ...]
    effect: dict[str, Float1D]
    single: tuple[Float1D, ...]
    noise: dict[str, Float1D]
    faulty: tuple[dict[str, Any], ...] = ()


@dataclass(frozen=True, eq=False)
class Produced:
    recording: Recording
    truth: Truth
    job: PartJob
    course: Course = field(repr=False)


def run(setup: Setup, course: Course) -> DriveMotion:
    """Integrate one axis of one part."""
    if isinstance(setup.drive, Spindle):
        return run_spindle(setup.drive, course.v_sp, setup.load)
    a = setup.axis
    return run_axis(setup.drive, course.pos[a], course.v[a], course.a[a], setup.load, setup.level)


def produce(
    mill: VirtualMill,
    courses: Sequence[Course],
    effects: Sequence[Effective] = (),
    *,
    seed: int = 0,
    rate_hz: float = 50.0,
    with_simulation: bool = True,
) -> list[Produced]:
    """Make the parts. Same mill, courses, effects and seed: same bytes.

    rate_hz : 500 (as sampled) or 50 (means over 82 ms)
    Raises SettingsError for another rate or an axis that an effect cannot act on.
    """
    if rate_hz not in RATES_HZ:
        raise SettingsError(f"rate_hz = {rate_hz:g}: the control records at 500 Hz, or 50 Hz smoothed.")
    out = []
    for course, child in zip(courses, np.random.SeedSequence(seed).spawn(len(courses)), strict=True):
        out.append(_one(mill, course, tuple(effects), np.random.default_rng(child), rate_hz, with_simulation))
    return out


def simulated(mill: VirtualMill, course: Course, axis: str, effects: Sequence[Effective]) -> DriveMotion:
    """What the simulation expects of an axis: the machine with each effect at what the simulation has of it."""
    return run(_with(mill, course, axis, effects, real=False), course)


def real(mill: VirtualMill, course: Course, axis: str, effects: Sequence[Effective]) -> DriveMotion:
    """What the machine does."""
    return run(_with(mill, course, axis, effects, real=True), course)


def _with(mill: VirtualMill, course: Course, axis: str, effects: Sequence[Effective], real: bool) -> Setup:
    setup = mill.setup(axis, course)
    for e in effects:
        if e.effect.axis == axis and e.law is not None:
            setup = e.law.put(setup, course, e.amplitude if real else e.simulated, e.shape)
    return setup


def _one(
    mill: VirtualMill,
    course: Course,
    effects: tuple[Effective, ...],
    rng: np.random.Generator,
    rate_hz: float,
    sim: bool,
) -> Produced:
    columns: dict[str, Array1D] = {"time": course.time}
    noise: dict[str, Float1D] = {}
    clean: dict[str, Float1D] = {}
    expected: dict[str, Float1D] = {}
    for axis in AXES:
        mine = [e for e in effects if e.effect.axis == axis]
        lawful = [e for e in mine if e.law is not None]
        motion = real(mill, course, axis, mine)
        expected[axis] = simulated(mill, course, axis, mine).current if lawful else motion.current
        clean[axis] = motion.current
        if axis == "sp":
            pos = mill.sensors.position(motion.pos, rng, mill.sensors.encoder_deg)
            force = course.spindle_force
        else:
            pos = mill.sensors.position(motion.pos, rng)
            force = course.force[axis]
        sensor = mill.sensors.current[axis]
        written = quantised(motion.current + sensor.noise(force, rng), sensor.resolution_a)
        for e in mine:
            if e.effect.id in CURRENT_FAULTS:
                faulted = faulty_current(e.effect.id, written, course.time, e.amplitude, e.shape)
                clean[axis] = faulty_current(e.effect.id, clean[axis], course.time, e.amplitude, e.shape)
                written = faulted
        noise[axis] = written - clean[axis]
        columns |= _motion_columns(axis, pos) | {CURRENT[axis]: written}
    wrong = [e for e in effects if e.effect.id == "input_fault" and e.shape["part"] == course.job.name]
    right: dict[str, Array1D] = {"time": course.time}
    for e in wrong:
        a = e.effect.axis
        right |= {name: columns[name] for name in (VELOCITY[a], ACCELERATION[a])}
        columns |= _wrong_input(columns, e)
    columns |= {FORCE_SIM[a]: course.force[a] for a in LINEAR_AXES}
    columns |= {FORCE_SIM["sp"]: course.spindle_force, "m_sp_sim": course.torque, "mrr_sim": course.mrr}
    if sim:
        columns |= {CURRENT_SIM[a]: expected[a] for a in AXES}
    columns |= {"nc_line": course.nc_line.astype(float), "tool_id": course.tool + 1.0, "coolant": course.coolant}
    effect = {a: clean[a] - expected[a] for a in AXES}
    single = tuple(_alone(mill, course, e) for e in effects)
    if rate_hz == 50.0:
        columns, right = smoothed(columns), smoothed(right)
        effect, noise = ({a: at_50(v) for a, v in d.items()} for d in (effect, noise))
        single = tuple(at_50(v) for v in single)
    for e in wrong:  # the simulation reads the file, so it is wrong at the file's rate
        a = e.effect.axis
        shift = _imagined(mill.drives[a], a, columns) - _imagined(mill.drives[a], a, right)
        effect[a] = effect[a] - shift
        single = tuple(old - shift if f is e else old for old, f in zip(single, effects, strict=True))
        if sim:
            columns[CURRENT_SIM[a]] = columns[CURRENT_SIM[a]] + shift
    faulty = tuple({"axis": e.effect.axis, **{k: e.shape[k] for k in ("t_start", "t_end")}} for e in wrong)
    recording = Recording(part_info(mill.machine, course, rate_hz, float(columns["time"][-1])), wrapped(columns))
    return Produced(recording, Truth(effects, effect, single, noise, faulty), course.job, course)


def at_50(values: Float1D) -> Float1D:
    """From 500 Hz to the samples of a 50 Hz recording."""
    return smoothed({"time": np.arange(len(values)) * CYCLE_S, CURRENT["x"]: values})[CURRENT["x"]]


def _motion_columns(axis: str, pos: Float1D) -> dict[str, Array1D]:
    v = derivative(pos)
    return {POSITION[axis]: pos, VELOCITY[axis]: v, ACCELERATION[axis]: derivative(v)}


def _alone(mill: VirtualMill, course: Course, e: Effective) -> Float1D:
    """The current of one effect when it is the only one; of a wrong input nothing is in the machine itself."""
    return np.zeros(len(course)) if e.effect.id == "input_fault" else effect_current(mill, course, e)


def effect_current(mill: VirtualMill, course: Course, e: Effective) -> Float1D:
    """(n,), A at 500 Hz: what the effect alone changes in the noise-free current."""
    axis = e.effect.axis
    expected = simulated(mill, course, axis, [e]).current
    if e.law is not None:
        return real(mill, course, axis, [e]).current - expected
    return faulty_current(e.effect.id, expected, course.time, e.amplitude, e.shape) - expected


def _wrong_input(columns: Mapping[str, Array1D], e: Effective) -> dict[str, Array1D]:
    start, stop = (int(e.shape[k] / CYCLE_S) for k in ("t_start", "t_end"))
    axis = e.effect.axis
    return _motion_columns(axis, faulty_signal(e.shape["fault"], columns[POSITION[axis]], start, stop, e.amplitude))


def _imagined(drive: Drive, axis: str, columns: Mapping[str, Array1D]) -> Float1D:
    """What a simulation that reads motion from the file expects: rigid mass, Coulomb and viscous friction; A."""
    v, a = columns[VELOCITY[axis]], columns[ACCELERATION[axis]]
    force = (drive.motor_kg + drive.table_kg) * 1e-3 * a + drive.viscous * v + drive.coulomb_n * np.tanh(v / 0.05)
    return np.clip(force / drive.force_per_ampere, -drive.current_max_a, drive.current_max_a)
