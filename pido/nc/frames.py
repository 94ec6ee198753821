"""Programmable frames and work offsets: programmed coordinates -> machine coordinates.

In:  TRANS, ROT, SCALE, MIRROR and their additive forms; zero offsets.
Out: `Frame`, an affine map p_machine = matrix @ p + shift (mm).
Source: SINUMERIK 840D sl "Fundamentals", chapter on frames. ROT with several angles turns about Z first, then about the
new Y, then about the new X (RPY).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pido.core.arrays import Float1D, Float2D


@dataclass(frozen=True, eq=False)
class Frame:
    """An affine map; matrix (3, 3), shift (3,) in mm."""

    matrix: Float2D
    shift: Float1D

    @property
    def is_diagonal(self) -> bool:
        """Each axis maps onto itself, so that one unknown axis (NaN) leaves the others known."""
        return not np.any(self.matrix - np.diag(np.diagonal(self.matrix)))

    def apply(self, points: Float2D) -> Float2D:
        """(n, 3) or (3,), mm: programmed points in the outer coordinates."""
        if self.is_diagonal:
            return points * np.diagonal(self.matrix) + self.shift
        return points @ self.matrix.T + self.shift

    def invert(self, points: Float2D) -> Float2D:
        """(n, 3) or (3,), mm: outer points in programmed coordinates."""
        if self.is_diagonal:
            return (points - self.shift) / np.diagonal(self.matrix)
        return (points - self.shift) @ np.linalg.inv(self.matrix).T

    def then(self, inner: Frame) -> Frame:
        """This frame with `inner` inside it: p -> self(inner(p))."""
        return Frame(self.matrix @ inner.matrix, self.matrix @ inner.shift + self.shift)


def identity() -> Frame:
    return Frame(np.eye(3), np.zeros(3))


def translation(by_mm: Float1D) -> Frame:
    return Frame(np.eye(3), np.asarray(by_mm, float))


def turn(degrees: Float1D) -> Frame:
    """ROT X.. Y.. Z..: Z first, then the new Y, then the new X."""
    x, y, z = degrees
    return Frame(Rotation.from_euler("ZYX", [z, y, x], degrees=True).as_matrix(), np.zeros(3))


def scaling(factors: Float1D) -> Frame:
    """SCALE X.. Y.. Z.. (factors), and MIRROR with factors -1."""
    return Frame(np.diag(np.asarray(factors, float)), np.zeros(3))
