"""Coordinates of the tool and of the machine.

In:  vectors in machine coordinates x, y, z, and the axis along which the tool points.
Out: the same vectors as (u, v, w): w along the tool, u and v across it, right-handed.

Forces and removal are written for a tool along w; a machine whose spindle points along x or y only changes the order
of its axes. The order is cyclic, so a clockwise spindle stays clockwise.
"""

from __future__ import annotations

import numpy as np

from pido.core.arrays import Float1D, Float2D

TOOL_FRAME = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}
"""Per tool axis: which machine axis stands at u, v and w."""


def to_tool_frame(xyz: Float2D, tool_axis: str) -> Float2D:
    """(n, 3) in x, y, z as (n, 3) in u, v, w.

    >>> to_tool_frame(np.array([[1.0, 2.0, 3.0]]), "y").tolist()  # w is y, u is z, v is x
    [[3.0, 1.0, 2.0]]
    """
    return np.ascontiguousarray(np.asarray(xyz, float)[..., TOOL_FRAME[tool_axis]])


def to_machine_frame(uvw: Float2D, tool_axis: str) -> Float2D:
    """(n, 3) in u, v, w as (n, 3) in x, y, z: undoes `to_tool_frame`.

    >>> to_machine_frame(np.array([[3.0, 1.0, 2.0]]), "y").tolist()
    [[1.0, 2.0, 3.0]]
    """
    back = np.argsort(TOOL_FRAME[tool_axis])
    return np.ascontiguousarray(np.asarray(uvw, float)[..., back])


def rotate_about_w(vectors: Float2D, theta: Float1D) -> Float2D:
    """R_z(theta) times each vector: counterclockwise by theta, seen against w.

    Parameters
    ----------
    vectors : (n, 3)
    theta : (n,), rad

    >>> rotate_about_w(np.array([[1.0, 0.0, 5.0]]), np.array([np.pi / 2])).round(12).tolist()
    [[0.0, 1.0, 5.0]]
    """
    c, s = np.cos(theta), np.sin(theta)
    a, b, w = np.moveaxis(np.asarray(vectors, float), -1, 0)
    return np.stack([c * a - s * b, s * a + c * b, w], axis=-1)
