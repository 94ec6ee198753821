"""The spindle drive, integrated in time: speed control, inertia, drag, windage, torque of the cut.

In:  speed set points at the control's cycle and the torque of the cut; `Spindle` holds the constants.
Out: angle, speed and motor current at the same cycle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from pido.core.arrays import Float1D, Float2D
from pido.core.errors import SettingsError
from pido.synthetic.drive import CYCLE_S, SUBSTEPS, DriveMotion


@dataclass(frozen=True, slots=True)
class Spindle:
    """Constants of the spindle.

    inertia_kg_m2, torque_per_ampere (N·m/A); coulomb_nm; viscous (N·m per rad/s); windage (N·m per (rad/s)²);
    bandwidth (rad/s) and integral_s of the speed controller; current_max_a; knee_a, bend and inertia_share as in
    `Drive`.
    """

    inertia_kg_m2: float = 0.05
    torque_per_ampere: float = 1.0
    coulomb_nm: float = 0.35
    viscous: float = 6.0e-4
    windage: float = 6.0e-7
    bandwidth: float = 60.0
    integral_s: float = 0.08
    current_max_a: float = 45.0
    knee_a: float = 1.0e9
    bend: float = 0.0
    inertia_share: float = 1.0

    def check(self) -> None:
        """Raises SettingsError that lists every constant that no spindle can have."""
        positive = ("inertia_kg_m2", "torque_per_ampere", "bandwidth", "integral_s", "current_max_a")
        not_negative = ("coulomb_nm", "viscous", "windage", "knee_a", "bend")
        faults = [
            f"{name} = {getattr(self, name):g} must be above 0" for name in positive if not getattr(self, name) > 0
        ]
        faults += [
            f"{name} = {getattr(self, name):g} is negative" for name in not_negative if not getattr(self, name) >= 0
        ]
        if faults:
            raise SettingsError("spindle: this drive cannot be: " + "; ".join(faults) + ".")


def run_spindle(spindle: Spindle, v: Float1D, load_nm: Float1D) -> DriveMotion:
    """Drive the spindle along its set points.

    v : (n,), deg/s, signed; load_nm : (n,), N·m – torque that the motor has to overcome, positive against +

    Returns angle (deg), speed (deg/s), current (A).
    """
    s = spindle
    constants = np.array([
        s.inertia_kg_m2, s.torque_per_ampere, s.coulomb_nm, s.viscous, s.windage, s.inertia_kg_m2 * s.bandwidth,
        s.integral_s, s.current_max_a, s.knee_a, s.bend,
    ])  # fmt: skip
    out = _integrate(constants, np.radians(v), np.ascontiguousarray(load_nm, dtype=float), CYCLE_S, SUBSTEPS)
    inertia = out[:, 3] * s.inertia_kg_m2 / s.torque_per_ampere
    return DriveMotion(
        np.degrees(out[:, 0]), np.degrees(out[:, 1]), out[:, 2] - (1 - s.inertia_share) * inertia, inertia
    )


@njit(cache=True, error_model="numpy")
def _integrate(c, v_ref, load, cycle, substeps) -> Float2D:
    inertia, k_t, coulomb, viscous, windage, kp, t_i, i_max, knee, bend = c
    n = len(v_ref)
    dt = cycle / substeps
    out = np.empty((n, 4))
    angle = 0.0
    speed = v_ref[0]
    drag = coulomb * math.tanh(speed / 0.5) + viscous * speed + windage * speed * abs(speed) + load[0]
    integral = drag
    for k in range(n):
        j = min(k + 1, n - 1)
        a_sum = 0.0
        for s in range(substeps):
            w = s / substeps
            error = v_ref[k] * (1 - w) + v_ref[j] * w - speed
            current = (kp * error + integral) / k_t
            if current > i_max:
                current = i_max
            elif current < -i_max:
                current = -i_max
            else:
                integral += kp * error * dt / t_i
            if s == 0:
                out[k, 0] = angle
                out[k, 1] = speed
                out[k, 2] = current
            over = abs(current) - knee
            torque = current
            if over > 0.0 and bend > 0.0:
                torque = math.copysign(knee + (math.sqrt(1.0 + 4.0 * bend * over) - 1.0) / (2.0 * bend), current)
            # tanh over 0.5 rad/s: a bearing turns on without a bristle to hold it
            drag = coulomb * math.tanh(speed / 0.5) + viscous * speed + windage * speed * abs(speed)
            a = (k_t * torque - drag - load[k] * (1 - w) - load[j] * w) / inertia
            speed += a * dt
            angle += speed * dt
            a_sum += a
        out[k, 3] = a_sum / substeps
    return out
