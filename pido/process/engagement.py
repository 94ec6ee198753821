"""How a tool stands in the material at each sample.

In:  what `pido.process.removal` measured per step: volumes, their lateral moment, axial depth.
Out: a_p, a_e, the engaged arc, and the share of the end: what a force law needs.

For an end mill the identity AR = a_p · a_e holds by construction. A ball or bull nose at depth a_p is as wide as its
underside there, D_eff, and fills a section A(a_p) < D_eff · a_p in a full slot: a_e = D_eff · AR / A(a_p), so that a
full slot has a_e = D_eff, and the force law gets the mean depth A / D_eff, so that b · h_m still follows AR.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Float1D
from pido.core.machining import Tool
from pido.physics.cutting import engagement_arc

RESOLVED_MM = 0.01
"""Walls in the map are no finer than this. What a shorter step removes beyond one tool width is a remainder of the
steps before it: as depth of cut it would be metres."""
STILL_MM = 1e-4
"""Over a shorter way the side does not cut: where z > 1, as for aluminium, Kienzle's force grows without bound as the
chip vanishes."""


@dataclass(frozen=True, eq=False)
class Engagement:
    """n samples.

    a_p : mm – axial depth of cut; a_e : mm – radial depth of cut; d_eff : mm – diameter at that depth
    edge_depth : mm – axial depth that the force law takes (a_p of an end mill, the mean depth of a ball)
    alpha_low, alpha_high : rad – ends of the engaged arc, from the feed direction to the left; phi_s: difference
    end_area : mm² – removed by the end, per mm of axial feed
    """

    a_p: Float1D
    a_e: Float1D
    d_eff: Float1D
    edge_depth: Float1D
    alpha_low: Float1D
    alpha_high: Float1D
    end_area: Float1D

    @property
    def phi_s(self) -> Float1D:
        """(n,), rad: engagement angle, 0 where the side does not cut."""
        return self.alpha_high - self.alpha_low


def tool_shape(tool: Tool) -> tuple[float, float, float]:
    """(radius of the flat end, corner radius, slope of a conical end) in mm, mm and mm per mm."""
    radius = tool.diameter_mm / 2
    if tool.kind == "ball":
        return 0.0, radius, 0.0
    if tool.kind == "bull":
        return radius - tool.corner_radius_mm, tool.corner_radius_mm, 0.0
    if tool.kind == "drill" and tool.kappa_deg < 90:
        return 0.0, 0.0, float(1 / np.tan(np.radians(tool.kappa_deg)))
    return radius, 0.0, 0.0


def width_and_section(tool: Tool, a_p: Float1D) -> tuple[Float1D, Float1D]:
    """Width of the tool at height a_p above its tip (mm), and the area of its silhouette below that height (mm²).

    >>> ball = Tool("B10", diameter_mm=10.0, teeth=2, kind="ball")
    >>> width, area = width_and_section(ball, np.array([5.0]))  # half a disc of radius 5
    >>> round(float(width[0]), 6), round(float(area[0] / (np.pi * 25 / 2)), 6)
    (10.0, 1.0)
    """
    flat, corner, slope = tool_shape(tool)
    D = tool.diameter_mm
    a_p = np.asarray(a_p, float)
    if corner > 0:
        a = np.minimum(a_p, corner)
        half = np.sqrt(np.maximum(corner**2 - (corner - a) ** 2, 0.0))
        width = 2 * (flat + half)
        area = 2 * flat * a + corner**2 * np.arccos(1 - a / corner) - (corner - a) * half
        return width, area + D * (a_p - a)
    if slope > 0:
        a = np.minimum(a_p, D / 2 * slope)
        return 2 * a / slope, a**2 / slope + D * (a_p - a)
    return np.full(a_p.shape, D), D * a_p


def engagement(
    tool: Tool, side: Float1D, end: Float1D, offset: Float1D, depth: Float1D, across: Float1D, down: Float1D
) -> Engagement:
    """Engagement of one tool.

    Parameters
    ----------
    side, end : (n,), mm³ – removed at the side and by the end in a step
    offset : (n,), mm – centroid of the side's volume, to the left of the path
    depth : (n,), mm – axial depth at the side
    across, down : (n,), mm – length of the step across the tool, and into the depth
    """
    cuts = (side > 0) & (depth > 0) & (across > STILL_MM)
    a_p = np.where(cuts, depth, 0.0)
    d_eff, section = width_and_section(tool, a_p)
    fill = np.divide(side, across * section, out=np.zeros(len(side)), where=cuts & (section > 0))
    a_e = np.minimum(fill, 1.0) * d_eff
    edge_depth = np.divide(section, d_eff, out=np.zeros(len(side)), where=d_eff > 0)
    # What a long step removes beyond one tool width (a corner, a curved path) cuts over the whole arc, only deeper.
    edge_depth = edge_depth * np.maximum(fill * np.minimum(across / RESOLVED_MM, 1.0), 1.0)
    room = (d_eff - a_e) / 2
    middle = np.clip(np.where(cuts, offset, 0.0), -room, room)
    radius = np.where(d_eff > 0, d_eff / 2, 1.0)
    low, high = engagement_arc(middle - a_e / 2, middle + a_e / 2, radius)
    end_area = np.divide(end, down, out=np.zeros(len(side)), where=(end > 0) & (down > 0))
    return Engagement(a_p, a_e, d_eff, edge_depth, low, high, end_area)
