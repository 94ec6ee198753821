"""Cutting force of a milling tool by Kienzle's law (paper, section III-B, eq. 1 and 2).

In:  engagement (a_e, a_p, arc), feed per tooth, tool and material.
Out: chip thickness, forces on the tool, spindle force and torque.

All functions work on scalars and on arrays (n,). Where nothing is cut (a_p, a_e or f_z is 0) every force is 0.
"""

from __future__ import annotations

import numpy as np

from pido.core.arrays import Float1D, Float2D
from pido.core.machining import Material
from pido.physics.frames import rotate_about_w

THIN_CHIP_MM = 0.01
"""Below this chip thickness (about the radius of a cutting edge) k_c no longer rises in end cutting, mm."""


def feed_per_tooth(v_f: Float1D, v_sp: Float1D, teeth: int) -> Float1D:
    """Feed per tooth f_z = v_f / (n · teeth), with n = |v_sp| / 360.

    v_f in mm/s, v_sp in deg/s, result in mm. NaN where the spindle stands still while the tool is fed: there is no
    chip then, and no law for the force.

    >>> round(float(feed_per_tooth(9.6, 19200.0, 4)), 6)  # 576 mm/min, 3200 rpm (paper, section IV-A)
    0.045
    """
    n = np.abs(np.asarray(v_sp, float)) / 360.0
    v_f = np.asarray(v_f, float)
    f_z = np.divide(v_f, n * teeth, out=np.full(np.broadcast(v_f, n).shape, np.nan), where=n > 0)
    return np.where((n == 0) & (v_f == 0), 0.0, f_z)


def engagement_arc(low: Float1D, high: Float1D, radius: Float1D) -> tuple[Float1D, Float1D]:
    """Angles between feed direction and the two ends of the engaged arc.

        alpha = arcsin(y / R),   phi_s = alpha_high - alpha_low

    Parameters
    ----------
    low, high : (n,), mm – edges of the engaged band, measured to the left of the feed direction, -R <= low <= high <= R
    radius : (n,), mm

    Returns
    -------
    alpha_low, alpha_high : (n,), rad – from -pi/2 to pi/2

    >>> low, high = engagement_arc(0.0, 5.0, 5.0)  # half immersion
    >>> round(float(np.degrees(high - low)), 6)
    90.0
    """
    radius = np.asarray(radius, float)
    return np.arcsin(np.clip(low / radius, -1, 1)), np.arcsin(np.clip(high / radius, -1, 1))


def mean_chip_thickness(
    f_z: Float1D, a_e: Float1D, D: Float1D | float, phi_s: Float1D, kappa: float = np.pi / 2
) -> Float1D:
    """Mean undeformed chip thickness of a milling cut.

        h_m = (2 / phi_s) * f_z * (a_e / D) * sin(kappa)

    The 114.6 of the usual form is 360/pi: it takes phi_s in degrees, this function in rad.

    Parameters
    ----------
    f_z : scalar or (n,), mm – feed per tooth
    a_e, D : scalar or (n,), mm – radial depth of cut and tool diameter, 0 <= a_e <= D
    phi_s : scalar or (n,), rad – engagement angle, 0 <= phi_s <= pi; 0 where nothing is cut
    kappa : scalar, rad – cutting edge angle; pi/2 for an end mill

    Returns
    -------
    scalar or (n,), mm; 0 where nothing is cut

    Raises ValueError, naming the first such sample, where a_e > D.
    Source: Neugebauer, Werkzeugmaschinen (2012); paper, section III-B.

    >>> round(float(mean_chip_thickness(f_z=0.1, a_e=10.0, D=10.0, phi_s=np.pi)), 6)  # full slot
    0.063662
    """
    f_z, a_e, D, phi_s = (np.asarray(v, float) for v in (f_z, a_e, D, phi_s))
    wrong = np.atleast_1d(a_e > D * (1 + 1e-9))
    if wrong.any():
        raise ValueError(f"a_e is the part of D that cuts, so a_e <= D; not so in sample {int(np.argmax(wrong))}")
    h = np.divide(2 * f_z * a_e * np.sin(kappa), phi_s * D, out=np.zeros(np.broadcast(f_z, a_e, phi_s, D).shape),
                  where=phi_s > 0)  # fmt: skip
    return h[()]


def kienzle_forces(a_p: Float1D, h_m: Float1D, material: Material, kappa: float = np.pi / 2) -> Float2D:
    """Force of one tooth at its mean chip: cutting, normal and passive component.

        b = a_p / sin(kappa)
        F_c  = b * h_m^(1 - z) * k_c11 * K
        F_cn = b * h_m^(1 - x) * k_f11 * K
        F_p  = b * h_m^(1 - y) * k_p11 * K

    Parameters
    ----------
    a_p : scalar or (n,), mm – axial depth of cut
    h_m : scalar or (n,), mm – mean chip thickness

    Returns
    -------
    (..., 3), N – (F_c, F_cn, F_p); 0 where h_m or a_p is 0, also for an exponent above 1

    Valid for chips of about 0.01 to 2 mm. Source: Kienzle (1952); paper, section III-B.

    >>> steel = Material("S235JR", k_c11=1990.0, z=0.7019, k_f11=351.0, x=0.4911, k_p11=247.0, y=0.2)
    >>> kienzle_forces(6.0, 1.0, steel).tolist()  # at h_m = 1 mm the coefficients themselves stand
    [11940.0, 2106.0, 1482.0]
    """
    h_m = np.asarray(h_m, float)
    b = np.asarray(a_p, float) / np.sin(kappa)
    cuts = (h_m > 0) | np.isnan(h_m)
    h = np.where(cuts, h_m, 1.0)
    laws = ((material.z, material.k_c11), (material.x, material.k_f11), (material.y, material.k_p11))
    return np.stack([np.where(cuts, b * h ** (1 - m) * k * material.K, 0.0) for m, k in laws], axis=-1)


def forces_on_tool(tooth: Float2D, alpha_mid: Float1D, feed_angle: Float1D, clockwise: Float1D) -> Float2D:
    """The force of `kienzle_forces`, turned into the machine's directions (paper, eq. 1).

        F = R_z(theta) (F_c, F_cn, F_p)^T,   theta = feed_angle + alpha_mid + pi/2

    The paper leaves theta open. Here the tooth stands in the middle of its engaged arc, at the polar angle
    beta = feed_angle + alpha_mid. A clockwise spindle (M3) moves it along (sin beta, -cos beta); the cutting force on
    the tool is opposite to that motion, the normal force points from the chip to the tool's centre, and the passive
    force away from the workpiece. That is R_z(beta + pi/2). With a counterclockwise spindle F_c changes its sign.

    Parameters
    ----------
    tooth : (n, 3), N – F_c, F_cn, F_p
    alpha_mid : (n,), rad – middle of the engaged arc, from the feed direction to the left
    feed_angle : (n,), rad – direction of the feed in the plane across the tool, from u towards v
    clockwise : (n,) – +1 for M3, -1 for M4

    Returns
    -------
    (n, 3), N – force on the tool along u, v, w

    >>> forces_on_tool(np.array([[100.0, 30.0, 5.0]]), np.zeros(1), np.zeros(1), np.ones(1)).round(9).tolist()
    [[-30.0, 100.0, 5.0]]
    """
    signed = np.array(tooth, float)
    signed[..., 0] *= clockwise
    return rotate_about_w(signed, np.asarray(feed_angle) + alpha_mid + np.pi / 2)


def end_cutting_forces(
    f_z: Float1D, volume_share: Float1D, radius: float, material: Material, kappa: float = np.pi / 2
) -> Float2D:
    """Force of the end teeth where the tool moves into the depth: plunge, drill, ramp, helix.

    The paper's milling force has no term for it. Here the end edge reaches from the axis to the radius,
    b = R / sin(kappa), and its chip comes from the axial feed per tooth, h = f_z sin(kappa). k_c stops rising below
    `THIN_CHIP_MM`: a ramp's axial chip is a micrometre, where an exponent near 1 would ask for more force the less is
    cut.

    Parameters
    ----------
    f_z : (n,), mm – axial feed per tooth
    volume_share : (n,) – removed by the end, as a share of the whole disc times the axial feed, 0 to 1
    radius : scalar, mm
    kappa : scalar, rad – half the point angle of a drill; pi/2 for an end mill

    Returns
    -------
    (n, 2), N – (F_c at the tool's circumference with the same torque, axial force on the tool away from the workpiece)

    F_c acts all along the edge, so its lever is R/2: half of it at the circumference gives the same torque, and the
    power k_c * MRR follows exactly.
    """
    h = np.asarray(f_z, float) * np.sin(kappa)
    thick = np.maximum(h, THIN_CHIP_MM)
    b = radius * np.asarray(volume_share, float)
    tooth = (
        kienzle_forces(b, thick, material, kappa)
        * np.where(h > 0, h / thick, np.where(np.isnan(h), np.nan, 0.0))[..., None]
    )
    return np.stack([tooth[..., 0] / 2, tooth[..., 1]], axis=-1)


def spindle_force(across: Float2D) -> Float1D:
    """F_sp = sqrt(F_u^2 + F_v^2) in N, from the two forces across the tool (..., >= 2) (paper, eq. 2).

    >>> float(spindle_force(np.array([30.0, 40.0, 7.0])))
    50.0
    """
    return np.hypot(across[..., 0], across[..., 1])


def spindle_torque(f_sp: Float1D, D: Float1D | float) -> Float1D:
    """M_sp = F_sp * D/2 in N·m, with F_sp in N and D in mm (paper, section III-B).

    >>> float(spindle_torque(50.0, 10.0))
    0.25
    """
    return f_sp * D / 2 * 1e-3


def engaged_teeth(phi_s: Float1D, teeth: int) -> Float1D:
    """Teeth in the cut at a time, on average: teeth * phi_s / (2 pi). phi_s in rad.

    The paper's forces are those of one tooth. Times this number they are the mean force, and spindle power is then
    k_c(h_m) * MRR exactly when F_c alone carries the torque.

    >>> float(engaged_teeth(np.pi, 4))  # full slot, four teeth
    2.0
    """
    return teeth * np.asarray(phi_s, float) / (2 * np.pi)
