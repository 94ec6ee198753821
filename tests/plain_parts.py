"""Parts of a plain made-up machine, cheap enough for tests: contours on one plane, textbook currents.

In:  how many parts, a seed. Out: part folders' content (`Recording`), 50 Hz, in the contract's columns.

    I_axis = I_c sgn(v) + b v + m a + k F + offset + noise        I_sp = I_0 + c omega + k M + noise

sgn(v) is that of the last motion. Each part takes other directions and feeds than the one before, so that its bins are
partly new. The machine is simple on purpose, and says nothing about a real one.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pido.core.columns import CURRENT_SIM, FORCE_SIM
from pido.core.part import PartInfo
from pido.core.recording import Recording

RATE_HZ = 50.0
_SPINDLE_DEG_S = 22_800.0
_I_C, _B, _M, _K = (0.8, 0.6, 0.4), (0.02, 0.03, 0.01), (2e-3, 3e-3, 4e-3), (4e-3, 4e-3, 2e-3)
_LEVEL = (0.1, -0.2, 1.5)
_I_SP, _C_SP, _K_SP = 0.5, 2e-5, 0.8
_NOISE_A = 0.05


def parts(count: int, seed: int = 0, machine: str = "cmx600v") -> Iterator[Recording]:
    """`count` parts of one machine, in production order."""
    for number in range(1, count + 1):
        rng = np.random.default_rng([seed, number])
        yield _recording(number, rng, machine)


def _recording(number: int, rng: np.random.Generator, machine: str) -> Recording:
    position, feed = _path(number, rng)
    n = len(position)
    dt = 1.0 / RATE_HZ
    v = np.gradient(position, dt, axis=0)
    a = np.gradient(v, dt, axis=0)
    depth, width = 2.0 + number % 3, 4.0  # mm
    speed = np.linalg.norm(v[:, :2], axis=1)
    mrr = depth * width * speed * (np.abs(v[:, 2]) < 0.5)
    force = 600.0 * depth * (np.maximum(speed, 1e-9) / feed) ** 0.75 * (mrr > 0)  # N, Kienzle's exponent 1 - z
    along = v[:, :2] / np.maximum(speed, 1e-9)[:, None]
    f = np.column_stack([-force * along[:, 0], -force * along[:, 1], 0.3 * force])
    torque = force * 0.005  # N·m at a radius of 5 mm
    held = np.column_stack([_last_direction(v[:, i]) for i in range(3)])
    current = held * _I_C + v * _B + a * _M - f * _K + np.array(_LEVEL)
    spindle = _I_SP + _C_SP * _SPINDLE_DEG_S + _K_SP * torque
    columns = {"time": np.arange(n) * dt}
    for i, axis in enumerate("xyz"):
        columns[f"pos_{axis}"], columns[f"v_{axis}"], columns[f"a_{axis}"] = position[:, i], v[:, i], a[:, i]
        columns[f"curr_{axis}"] = current[:, i] + rng.normal(0, _NOISE_A, n)
        columns[FORCE_SIM[axis]] = f[:, i]
    columns |= {
        "pos_sp": np.cumsum(np.full(n, _SPINDLE_DEG_S * dt)),
        "v_sp": np.full(n, _SPINDLE_DEG_S),
        "a_sp": np.zeros(n),
        "curr_sp": spindle + rng.normal(0, _NOISE_A, n),
        "f_sp_sim": force,
        "m_sp_sim": torque,
        "mrr_sim": mrr,
        "nc_line": np.floor(np.arange(n) / n * 12),
    }
    info = PartInfo(part=f"demo-{number:02d}", machine=machine, order=number, start_time_s=400.0 * number)
    return Recording(info, columns)


def _path(number: int, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """(n, 3) positions along a closed contour of straight legs and a circle, and its feed in mm/s."""
    feed = float(rng.uniform(4.0, 9.0))
    corners = 3 + number % 4
    turn = rng.uniform(0, 2 * np.pi)
    angle = turn + np.linspace(0, 2 * np.pi, corners + 1)
    outline = 25.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    circle = np.linspace(0, 2 * np.pi, 120)
    ring = np.array([12.0, 0.0]) + 10.0 * np.column_stack([np.cos(circle), np.sin(circle)])
    plane = np.vstack([outline, ring])
    points = np.column_stack([plane + 200.0, np.full(len(plane), -5.0)])
    points = np.vstack([points[0] + [0, 0, 5.0], points, points[-1] + [0, 0, 5.0]])
    length = np.r_[0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    s = np.arange(0.0, length[-1], feed / RATE_HZ)
    path = np.column_stack([np.interp(s, length, points[:, i]) for i in range(3)])
    kernel = np.hanning(13)[1:-1]  # axes do not turn corners at full speed
    smooth = [np.convolve(np.pad(path[:, i], 5, mode="edge"), kernel / kernel.sum(), mode="valid") for i in range(3)]
    return np.column_stack(smooth), feed


def _last_direction(v: np.ndarray, dead_band: float = 0.02) -> np.ndarray:
    moving = np.where(np.abs(v) > dead_band, np.sign(v), 0.0)
    last = np.maximum.accumulate(np.where(moving != 0, np.arange(len(v)), 0))
    return moving[last]


def with_simulation(recording: Recording, without: tuple[tuple[str, str], ...] = ()) -> Recording:
    """The same part with `curr_*_sim`: the machine's own currents but for the (axis, mechanism) pairs left out.

    Mechanisms: coulomb_friction, viscous_friction, inertia, cutting_force; spindle_torque_load on sp.
    """
    simulated = {}
    for i, axis in enumerate("xyz"):
        laws = {
            "coulomb_friction": _last_direction(recording[f"v_{axis}"]) * _I_C[i],
            "viscous_friction": recording[f"v_{axis}"] * _B[i],
            "inertia": recording[f"a_{axis}"] * _M[i],
            "cutting_force": -recording[FORCE_SIM[axis]] * _K[i],
        }
        simulated[CURRENT_SIM[axis]] = _LEVEL[i] + sum(v for name, v in laws.items() if (axis, name) not in without)
    torque = 0.0 if ("sp", "spindle_torque_load") in without else _K_SP * recording["m_sp_sim"]
    simulated["curr_sp_sim"] = _I_SP + _C_SP * recording["v_sp"] + torque
    return recording.with_columns(**simulated)
