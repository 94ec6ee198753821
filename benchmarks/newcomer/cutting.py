"""Mean forces of a milling cut or a drill, from immersion and chip (Altintas, Manufacturing Automation, 2.7 and 2.9).

In:  cutter, depths, feed per tooth, per sample. Out: forces along feed, across it and along the tool; torque; removal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Bool1D, Float1D

RADIAL, AXIAL, SIZE = 0.4, 0.25, 0.22
"""Shares of the radial and the axial force in the tangential one, and exponent of the chip thickness, –."""


@dataclass(frozen=True, eq=False)
class Cut:
    """(n,): forces in N that the drives must provide along the feed, to its left and along the infeed; tangential : N;
    torque : N·m; removal : mm³/s; edge : mm, mean length of engaged edge
    """

    along: Float1D
    left: Float1D
    infeed: Float1D
    tangential: Float1D
    torque: Float1D
    removal: Float1D
    edge: Float1D


def mill(v: Float1D, n: Float1D, D: Float1D, z: Float1D, a_p: Float1D, a_e: Float1D, down: Bool1D, k_c: float) -> Cut:
    """v : mm/s; n : 1/s of the spindle; D : mm; z : teeth; a_p, a_e : mm, depth times how far it is filled

        F_along = z a_p f_z K / (2 pi) * integral of (sin cos + r sin²) over the immersion

    >>> one = np.ones(1)
    >>> cut = mill(10 * one, 10 * one, 10 * one, one, one, 10 * one, one > 2, 1000.0)   # a slot, 1 mm per tooth
    >>> round(float(cut.torque[0] * 2 * np.pi * 10 / (cut.removal[0] * 1e-3 * 1000 * (2 / np.pi / 0.1) ** -0.22)), 6)
    1.0
    """
    turning = n > 0.3
    f_z = np.where(turning, v / (np.where(turning, n, 1.0) * z), 0.0)
    immersion = np.arccos(np.clip(1 - 2 * a_e / D, -1.0, 1.0))
    first = np.where(down, np.pi - immersion, 0.0)
    last = np.where(down, np.pi, immersion)
    K = k_c * _thin(f_z * 2 * a_e / (D * np.maximum(immersion, 1e-6)))
    per = z * a_p * f_z * K / (2 * np.pi)
    both = (np.sin(last) ** 2 - np.sin(first) ** 2) / 2
    square = (last - first) / 2 - (np.sin(2 * last) - np.sin(2 * first)) / 4
    tangential = per * (np.cos(first) - np.cos(last))
    return Cut(
        along=per * (both + RADIAL * square),
        left=per * (square - RADIAL * both),
        infeed=-AXIAL * tangential,
        tangential=tangential,
        torque=tangential * D / 2000,
        removal=np.where(turning, a_p * a_e * v, 0.0),
        edge=np.where(turning, a_p * z * immersion / (2 * np.pi), 0.0),
    )


def drill(v: Float1D, n: Float1D, D: Float1D, z: Float1D, filled: Float1D, k_c: float) -> Cut:
    """The same of a drill: v along the infeed, mm/s; filled : 0 to 1"""
    turning = n > 0.3
    per_tooth = np.where(turning, v / (np.where(turning, n, 1.0) * z), 0.0)
    K = k_c * _thin(per_tooth)
    tangential = K * per_tooth * z * D / 2 * filled
    zero = np.zeros_like(v)
    return Cut(
        along=0.6 * tangential,
        left=zero,
        infeed=zero,
        tangential=tangential,
        torque=tangential * D / 4000,
        removal=np.where(turning, np.pi / 4 * D**2 * v * filled, 0.0),
        edge=np.where(turning, z * D / 2 * filled, 0.0),
    )


def _thin(h: Float1D) -> Float1D:
    """–: how much more a chip thinner than 0.1 mm costs; below 2 µm nothing is cut any thinner."""
    return (np.maximum(h, 0.002) / 0.1) ** -SIZE
