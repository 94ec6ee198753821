"""One servo axis, integrated in time: control, motor, ball screw, table, friction with an internal state.

In:  set points of position, speed and acceleration at the control's cycle, the force that the axis has to overcome,
     and what adds to its Coulomb friction; `Drive` holds the constants.
Out: motor position and speed, motor current, at the same cycle.

Two masses (motor with screw, table) are joined by the screw's stiffness and by its lost motion. Friction is a LuGre
bristle (Canudas de Wit, Olsson, Åström, Lischinsky 1995), stepped with the exact solution for constant speed, so that
it is stable at any speed; a second, softer bristle may carry a share of it. A position controller (P) with speed
feed-forward sets the speed controller (PI), whose output is the torque-giving current; its limit stops the integrator.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from pido.core.arrays import Float1D, Float2D
from pido.core.errors import SettingsError

CYCLE_S = 0.002
"""The control's cycle, s: set points and recordings at 500 Hz."""
SUBSTEPS = 8
"""Steps of the integration per cycle (4 kHz)."""


@dataclass(frozen=True, slots=True)
class Drive:
    """Constants of one linear axis; forces at the table, masses as seen at the table.

    motor_kg, table_kg : rotating parts (motor, screw) and moving parts
    force_per_ampere : N/A, torque constant times 2 pi / lead times efficiency
    screw_n_mm, screw_zeta : stiffness of the screw, N/mm, and its damping ratio
    lost_motion_mm : play between screw and table
    coulomb_n, stribeck_n, stribeck_mm_s, viscous : friction; N, N above Coulomb at v = 0, mm/s, N per mm/s
    asymmetry : Coulomb friction is (1 + asymmetry) forwards and (1 - asymmetry) backwards
    bristle_n_mm : stiffness of the bristle, N/mm
    soft_share, soft_mm : share of the friction that needs a distance soft_mm to build up
    hold : share of the friction that stays after a stop; the rest creeps away within creep_s
    gravity_n : weight that the axis carries, N
    ripple_n, ripple_mm, ripple_phase : torque ripple, N, period in mm and phase in rad
    position_gain, speed_bandwidth, integral_s : 1/s, rad/s and s of the controllers
    acceleration_feed_forward : share of the inertia that the control feeds forward
    current_max_a : limit of the drive
    knee_a, bend : above knee_a the current is more than proportional: i = u + bend (u - knee)^2 for torque u (in A)
    inertia_share : share of the inertia's current in the recorded current: the current of a machine with that
        share of the mass on the same motion
    """

    motor_kg: float = 700.0
    table_kg: float = 900.0
    force_per_ampere: float = 450.0
    screw_n_mm: float = 2.0e5
    screw_zeta: float = 0.1
    lost_motion_mm: float = 0.0
    coulomb_n: float = 200.0
    stribeck_n: float = 40.0
    stribeck_mm_s: float = 1.0
    viscous: float = 1.0
    asymmetry: float = 0.0
    bristle_n_mm: float = 5.0e4
    soft_share: float = 0.0
    soft_mm: float = 0.05
    hold: float = 1.0
    creep_s: float = 0.05
    gravity_n: float = 0.0
    ripple_n: float = 0.0
    ripple_mm: float = 20.0
    ripple_phase: float = 0.0
    position_gain: float = 40.0
    speed_bandwidth: float = 300.0
    integral_s: float = 0.02
    acceleration_feed_forward: float = 0.9
    current_max_a: float = 60.0
    knee_a: float = 1.0e9
    bend: float = 0.0
    inertia_share: float = 1.0

    def check(self, axis: str) -> None:
        """Raises SettingsError that lists every constant that no machine can have."""
        positive = ("motor_kg", "table_kg", "force_per_ampere", "screw_n_mm", "stribeck_mm_s", "bristle_n_mm",
                    "soft_mm", "creep_s", "ripple_mm", "position_gain", "speed_bandwidth", "integral_s",
                    "current_max_a")  # fmt: skip
        not_negative = ("screw_zeta", "lost_motion_mm", "coulomb_n", "stribeck_n", "viscous", "hold", "knee_a", "bend")
        faults = [
            f"{name} = {getattr(self, name):g} must be above 0" for name in positive if not getattr(self, name) > 0
        ]
        faults += [
            f"{name} = {getattr(self, name):g} is negative" for name in not_negative if not getattr(self, name) >= 0
        ]
        if not abs(self.asymmetry) < 1:
            faults.append(f"asymmetry = {self.asymmetry:g} must lie between -1 and 1")
        if not 0 <= self.soft_share <= 1:
            faults.append(f"soft_share = {self.soft_share:g} must lie between 0 and 1")
        resonance = math.sqrt(self.screw_n_mm * 1e3 * (1 / self.motor_kg + 1 / self.table_kg)) if not faults else 0.0
        if resonance * CYCLE_S / SUBSTEPS > 0.7:
            faults.append(f"the screw's resonance of {resonance / 2 / math.pi:.0f} Hz is too fast for steps of 0.25 ms")
        if faults:
            raise SettingsError(f"axis {axis}: this drive cannot be: " + "; ".join(faults) + ".")


@dataclass(frozen=True, slots=True)
class DriveMotion:
    """(n,) each, at the control's cycle: motor position mm, speed mm/s, current A and the inertia's share of it, A."""

    pos: Float1D
    v: Float1D
    current: Float1D
    inertia: Float1D


def run_axis(drive: Drive, pos: Float1D, v: Float1D, a: Float1D, load_n: Float1D, level_n: Float1D) -> DriveMotion:
    """Drive one axis along its set points.

    Parameters
    ----------
    pos, v, a : (n,), mm, mm/s, mm/s² – set points, `CYCLE_S` apart
    load_n : (n,), N – force that the motor has to overcome in addition (without gravity), positive against +
    level_n : (n,), N – what comes on top of the Coulomb friction (guideway load, position)
    """
    d = drive
    total = (d.motor_kg + d.table_kg) * 1e-3  # N per mm/s²
    constants = np.array([
        d.motor_kg * 1e-3, d.table_kg * 1e-3, d.force_per_ampere, d.screw_n_mm,
        2 * d.screw_zeta * math.sqrt(d.screw_n_mm * d.motor_kg * d.table_kg * 1e-6 / total), d.lost_motion_mm,
        d.coulomb_n, d.stribeck_n, d.stribeck_mm_s, d.viscous, d.asymmetry, d.bristle_n_mm,
        0.6 * math.sqrt(d.bristle_n_mm * d.table_kg * 1e-3), d.soft_share, d.soft_mm, d.hold, d.creep_s, d.gravity_n,
        d.ripple_n, 2 * math.pi / d.ripple_mm, d.ripple_phase, d.position_gain, total * d.speed_bandwidth, d.integral_s,
        d.acceleration_feed_forward * total, d.current_max_a, d.knee_a, d.bend,
    ])  # fmt: skip
    inputs = np.ascontiguousarray(np.column_stack([pos, v, a, load_n, level_n]))
    out = _integrate(constants, inputs, CYCLE_S, SUBSTEPS)
    inertia = out[:, 3] * total / d.force_per_ampere
    return DriveMotion(out[:, 0], out[:, 1], out[:, 2] - (1 - d.inertia_share) * inertia, inertia)


@njit(cache=True, error_model="numpy", inline="always")
def _bent(u, knee, bend):
    """Current that gives the torque u (both in A)."""
    over = abs(u) - knee
    return u if over <= 0.0 else math.copysign(abs(u) + bend * over * over, u)


@njit(cache=True, error_model="numpy", inline="always")
def _torque(i, knee, bend):
    """Torque (in A) of the current i: the inverse of `_bent`."""
    over = abs(i) - knee
    if over <= 0.0 or bend == 0.0:
        return i
    return math.copysign(knee + (math.sqrt(1.0 + 4.0 * bend * over) - 1.0) / (2.0 * bend), i)


@njit(cache=True, error_model="numpy")
def _integrate(c, inputs, cycle, substeps) -> Float2D:
    (m_m, m_t, k_f, k_s, d_s, play, f_c, f_str, v_str, f_v, asym, sigma, sigma_1, soft, soft_mm, hold, creep, gravity,
     r_amp, r_k, r_phase, kv, kp, t_i, ff_a, i_max, knee, bend) = c  # fmt: skip
    n = len(inputs)
    dt = cycle / substeps
    out = np.empty((n, 4))
    x_m = inputs[0, 0]
    v_m = 0.0
    # At rest in balance: the screw is already pressed, the integrator already holds the load.
    ripple0 = r_amp * math.sin(r_k * x_m + r_phase)
    rest = gravity + inputs[0, 3]
    side = 0.0 if rest == 0.0 else math.copysign(play / 2, rest)
    x_t = x_m - side - rest / k_s
    v_t = 0.0
    integral = _bent((rest + ripple0) / k_f, knee, bend) * k_f
    stiff = 0.0
    yielding = 0.0
    kept = 0.0
    kept_yielding = 0.0
    for k in range(n):
        j = min(k + 1, n - 1)
        a_sum = 0.0
        current = 0.0
        for s in range(substeps):
            w = s / substeps
            h = w * w * (3 - 2 * w)
            p_ref = (
                inputs[k, 0] * (1 - h) + inputs[j, 0] * h
                + cycle * (w * (1 - w) * (1 - w) * inputs[k, 1] - w * w * (1 - w) * inputs[j, 1])
            )  # fmt: skip
            v_ref = inputs[k, 1] * (1 - w) + inputs[j, 1] * w
            a_ref = inputs[k, 2] * (1 - w) + inputs[j, 2] * w
            load = inputs[k, 3] * (1 - w) + inputs[j, 3] * w + gravity
            level = inputs[k, 4] * (1 - w) + inputs[j, 4] * w
            # control: P on position with speed feed-forward, PI on speed
            error = kv * (p_ref - x_m) + v_ref - v_m
            demand = kp * error + integral + ff_a * a_ref
            current = demand / k_f
            if current > i_max:
                current = i_max
            elif current < -i_max:
                current = -i_max
            else:
                integral += kp * error * dt / t_i
            if s == 0:
                out[k, 0] = x_m
                out[k, 1] = v_m
                out[k, 2] = current
            force = k_f * _torque(current, knee, bend) - r_amp * math.sin(r_k * x_m + r_phase)
            # screw with play
            twist = x_m - x_t
            press = 0.0
            if abs(twist) >= play / 2:
                press = k_s * (twist - math.copysign(play / 2, twist)) + d_s * (v_m - v_t)
            # friction of the table
            g = f_c * (1 + asym if v_t > 0 else 1 - asym) + f_str * math.exp(-((v_t / v_str) ** 2)) + level
            g = max(g, 0.0)
            g_stiff = g * (1 - soft)
            g_soft = g * soft
            sign = 1.0 if v_t > 0 else -1.0
            before = stiff
            if g_stiff > 0.0:
                stiff = g_stiff * sign + (stiff - g_stiff * sign) * math.exp(-sigma * abs(v_t) * dt / g_stiff)
            else:
                stiff = 0.0
            if g_soft > 0.0:
                yielding = g_soft * sign + (yielding - g_soft * sign) * math.exp(-abs(v_t) * dt / soft_mm)
            else:
                yielding = 0.0
            damping = sigma_1 * (stiff - before) / (sigma * dt) if g_stiff > 0.0 else 0.0
            if v_ref != 0.0:
                kept = stiff
                kept_yielding = yielding
            elif hold < 1.0:
                # What is not held creeps away once the axis is told to stand.
                fade = math.exp(-dt / creep)
                stiff = hold * kept + (stiff - hold * kept) * fade
                yielding = hold * kept_yielding + (yielding - hold * kept_yielding) * fade
            friction = stiff + yielding + damping + f_v * v_t
            a_m = (force - press) / m_m
            a_t = (press - friction - load) / m_t
            v_m += a_m * dt
            v_t += a_t * dt
            x_m += v_m * dt
            x_t += v_t * dt
            a_sum += (m_m * a_m + m_t * a_t) / (m_m + m_t)
        out[k, 3] = a_sum / substeps
    return out
