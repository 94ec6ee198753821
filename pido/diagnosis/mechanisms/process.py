"""What cutting adds: force, edges, wear, hard places, coolant.

In:  `AxisState`. Out: mechanisms of the catalogue. All need a simulated process load, and say so where there is none.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pido.core.arrays import Float1D
from pido.core.axes import LINEAR_AXES
from pido.diagnosis.mechanisms.base import Mechanism, Parameter, choice, column, nothing, which
from pido.diagnosis.mechanisms.friction import at_rest, direction
from pido.diagnosis.state import AxisState, speed_along_path


def load(state: AxisState) -> Float1D | None:
    """(n,) – what the process does to this axis: N along a linear axis, N·m at the spindle."""
    return state.m_sp if state.axis == "sp" else state.force


def _load_in(axis: str) -> str:
    """`load` as an equation names it."""
    return "M_sp" if axis == "sp" else "f_i"


def engages(states: Sequence[AxisState]) -> str | None:
    """Why an effect of cutting cannot be seen."""
    if any(s.engaged is None for s in states):
        return "no simulated process load (mrr_sim, m_sp_sim or f_*_sim)"
    return None if any(np.any(s.engaged) for s in states) else "the tool never cuts in these parts"


def _loaded(states: Sequence[AxisState]) -> str | None:
    if any(load(s) is None for s in states):
        return "no simulated process load of this axis"
    return engages(states)


class CuttingForce(Mechanism):
    """The process force along the axis itself."""

    id = "cutting_force"
    equation = "dI = k * F"
    amplitudes = (Parameter("k", "A/N"),)
    axes = LINEAR_AXES
    summary = "{axis} axis, while cutting, in proportion to the process force"
    follows_from = ("force", "m_sp", "mrr")

    def regressors(self, state, **shape):
        return nothing(state) if state.force is None else column(state.force)

    def needs(self, states):
        return _loaded(states)


class EdgeForce(Mechanism):
    """Ploughing by every engaged millimetre of edge.

    along : 0 constant, 1 sign of the motion, 2 share of the feed, 3 direction of the process force; at the spindle 0
        constant, 1 sign of its motion, 2 that at the lever of the tool's radius
    length : 0 as often as the tool is engaged, 1 axial depth of cut, 2 that times the mean number of teeth in cut,
        3 the same with the tool's radius for the depth of a plunge, which cuts with the end of the tool, 4 that of the
        whole operation, by the share of its area that is removed
    """

    id = "edge_force"
    equation = (
        "dI = K_e * b while engaged, along the feed or the process force, at the spindle times the tool's radius; "
        "b = 1, a_p, or a_p * teeth in cut, in a plunge with that radius for a_p, as far as the tool is in the material"
    )
    amplitudes = (Parameter("K_e", "A, per mm or mm²"),)
    shape = (choice("along", 4), choice("length", 5))
    summary = "{axis} axis, whenever the tool is engaged, however thin the chip"
    follows_from = ("engaged", "force", "edge_length", "edge_in_cut", "tool_radius", "ar")

    def regressors(self, state, *, along, length):
        edge, side = _edge(state, round(length)), _side(state, round(along))
        if state.engaged is None or edge is None or side is None:
            return nothing(state)
        return column(edge * state.engaged * side)

    def equation_in(self, axis, shape):
        along, length = round(shape["along"]), round(shape["length"])
        share = ("", "sgn(v)", "tool radius * sgn(v)" if axis == "sp" else "v / feed", "f_i / |F|")[along]
        edge = ("", "a_p", "a_p * teeth in cut", "a_p * teeth in cut", "AR / a_e * teeth in cut")[length]
        product = " * ".join(part for part in ("K_e", edge, share) if part)
        more = ("", f", {at_rest()}", f", {at_rest()}", "; F = whole process force")[along]
        plunge = ("; in plunges the tool radius stands for a_p", "; in plunges AR / (pi * tool radius) * teeth")
        return f"dI = {product} while engaged{more}{plunge[length - 3] if length >= 3 else ''}"

    def starts(self, states):
        ends = any(
            s.end_length is not None
            and s.edge_length is not None
            and not np.array_equal(s.end_length, s.edge_length, equal_nan=True)
            for s in states
        )
        by_area = all(s.edge_in_cut is not None for s in states)
        known = {0.0, 1.0, 2.0, *((3.0,) if ends else ()), *((4.0,) if by_area else ())}
        return tuple(shape for shape in super().starts(states) if shape["length"] in known)

    def needs(self, states):
        return engages(states)


def _edge(state: AxisState, length: int) -> Float1D | None:
    """(n,), mm or 1 – edge in the material."""
    if length == 0:
        return np.ones(len(state.time))
    if length == 4:
        return state.edge_in_cut
    length_in_cut = state.edge_length if length < 3 or state.end_length is None else state.end_length
    if length_in_cut is None or (length > 1 and state.teeth_in_cut is None):
        return None
    edge = np.nan_to_num(length_in_cut)
    return edge if length == 1 or state.teeth_in_cut is None else edge * np.nan_to_num(state.teeth_in_cut)


def _side(state: AxisState, along: int) -> Float1D | None:
    """(n,) in -1..1 – share of a force of the cut that acts along this axis; or its lever at the spindle, mm."""
    if along == 0:
        return np.ones(len(state.time))
    if along == 1:
        return direction(state)
    if state.axis == "sp":
        lever = state.tool_radius if along == 2 else None
        return None if lever is None else np.nan_to_num(lever) * direction(state)
    if along == 2:
        speed = speed_along_path(state.speeds)
        return np.where(speed > 0, state.v * state.moving / np.maximum(speed, 1e-9), 0.0)
    if state.force is None:
        return None
    size = np.sqrt(np.sum([f**2 for f in state.forces.values()], axis=0))
    return np.where(size > 0, state.force / np.maximum(size, 1e-300), 0.0)


class ToolWear(Mechanism):
    """Cutting load that grows with use; `by`: 0 volume (cm³), 1 time in cut (min); `of`: 0 load, 1 edge, 2 along v."""

    id = "tool_wear"
    equation = "dI = W * V * F, or W * V while engaged; V = volume or time that the edge has cut"
    amplitudes = (Parameter("W", "A per cm³ or min, per N, N·m or 1"),)
    shape = (choice("by", 2), choice("of", 4))
    summary = "{axis} axis, while cutting, growing with what the tool has cut"
    follows_from = ("cut_volume", "cut_time", "force", "m_sp")

    def regressors(self, state, *, by, of):
        used = state.cut_volume if round(by) == 0 else state.cut_time
        if used is None or state.engaged is None:
            return nothing(state)
        used = used / (1000.0 if round(by) == 0 else 60.0)
        factor = (load(state), state.engaged.astype(float), state.engaged * direction(state), state.m_sp)[which(of, 4)]
        return nothing(state) if factor is None else column(used * factor)

    def equation_in(self, axis, shape):
        used = ("volume that the edge has cut, cm³", "time that the edge has cut, min")[round(shape["by"])]
        of = (
            f"V * {_load_in(axis)}",
            "V while engaged",
            f"V * sgn(v) while engaged, {at_rest()}",
            "V * M_sp",
        )[which(shape["of"], 4)]
        return f"dI = W * {of}; V = {used}"

    def needs(self, states):
        return engages(states)


class MaterialHardZone(Mechanism):
    """A place of the workpiece that cuts harder or softer.

    x_c, y_c : mm from the workpiece's centre, or in machine coordinates (`frame` 1) where that is not known
    r : mm, radius of a disc or half length of a box along x; `form`: 0 disc, 1 box; q : the box' half width over r
    """

    id = "material_hard_zone"
    becomes = frozenset({"cutting_force"})
    equation = "dI = H * F inside a disc or box of the workpiece"
    amplitudes = (Parameter("H", "A per N or N·m"),)
    shape = (
        Parameter("x_c", "mm", values=(0.0,)),
        Parameter("y_c", "mm", values=(0.0,)),
        Parameter("r", "mm", low=0.1, high=2000.0, scale="log", points=5),
        Parameter("q", "–", low=0.05, high=20.0, scale="log", values=(1.0,)),
        choice("form", 2),
        choice("frame", 2),
    )
    looked_at = 500
    follows_from = ("wx", "force", "m_sp")

    def regressors(self, state, *, x_c, y_c, r, q, form, frame):
        force, place = load(state), _place(state, round(frame) == 1)
        if force is None or place is None:
            return nothing(state)
        dx, dy = np.abs(place[0] - x_c) / r, np.abs(place[1] - y_c) / r
        way = np.hypot(dx, dy) if round(form) == 0 else np.maximum(dx, dy / q)
        # An edge as wide as a twentieth of the zone lets a search move it; a tool is never as sharp as a line.
        inside = 0.5 * (1.0 - np.tanh((np.nan_to_num(way, nan=np.inf) - 1.0) / 0.05))
        return column(inside * force)

    def equation_in(self, axis, shape):
        zone = ("sqrt((x - x_c)^2 + (y - y_c)^2) < r", "|x - x_c| < r and |y - y_c| < q * r")[round(shape["form"])]
        frame = ("from the workpiece's centre", "in machine coordinates")[round(shape["frame"])]
        return f"dI = H * {_load_in(axis)} inside {zone}, x and y {frame}"

    def idle(self, shape):
        return frozenset({"q"}) if round(shape["form"]) == 0 else frozenset()

    def needs(self, states):
        if any(_place(s, True) is None for s in states):
            return "the place of the tool is not known (pos_x, pos_y)"
        return _loaded(states)

    def starts(self, states):
        """Discs around sixteen places of what was cut; boxes come from what is left of the mismatch."""
        frame = float(not all(_place(s, False) is not None for s in states))
        x, y = _cut_places(states, frame == 1)
        if len(x) == 0:
            return ()
        ends = [np.quantile(v, [0.02, 0.98]) for v in (x, y)]
        size = max(float(np.ptp(e)) for e in ends)
        centres = [[float(e[0] + (e[1] - e[0]) * k) for k in (0.125, 0.375, 0.625, 0.875)] for e in ends]
        return tuple(
            {"x_c": cx, "y_c": cy, "r": size * share, "q": 1.0, "form": 0.0, "frame": frame}
            for cx in centres[0]
            for cy in centres[1]
            for share in (0.12, 0.25)
        )

    def suggest(self, states, left):
        """The rectangle in which the load weighs most differently from everywhere else, as a box and as a disc."""
        frame = float(not all(_place(s, False) is not None for s in states))
        x, y, force, value = [], [], [], []
        for s, v in zip(states, left, strict=True):
            place, f = _place(s, frame == 1), load(s)
            if place is None or f is None:
                return ()
            good = np.isfinite(v) & np.isfinite(place[0]) & np.isfinite(place[1]) & (np.nan_to_num(f) != 0)
            x.append(place[0][good])
            y.append(place[1][good])
            force.append(f[good])
            value.append(v[good])
        found = best_rectangle(np.concatenate(x), np.concatenate(y), np.concatenate(force), np.concatenate(value))
        if found is None:
            return ()
        (x_c, half_x), (y_c, half_y) = found
        disc = float(np.sqrt(4 * half_x * half_y / np.pi))
        both = {"x_c": x_c, "y_c": y_c, "frame": frame}
        return (
            {**both, "r": disc, "q": 1.0, "form": 0.0},
            {**both, "r": half_x, "q": half_y / half_x, "form": 1.0},
        )

    def around(self, name, shape, states):
        form, r = round(shape["form"]), shape["r"]
        if name == "x_c":
            return shape[name] - 0.6 * r, shape[name] + 0.6 * r
        if name == "y_c":
            half = 0.6 * r * (shape["q"] if form == 1 else 1.0)
            return shape[name] - half, shape[name] + half
        if name == "r" or (name == "q" and form == 1):
            return shape[name] / 1.8, shape[name] * 1.8
        return shape[name], shape[name]

    def free(self, shape):
        return 3 if round(shape["form"]) == 0 else 4

    def conditions(self, axis, shape):
        r = shape["r"]
        half = r * (shape["q"] if round(shape["form"]) == 1 else 1.0)
        x, y = (shape["x_c"] - r, shape["x_c"] + r), (shape["y_c"] - half, shape["y_c"] + half)
        frame = "machine coordinates" if round(shape["frame"]) == 1 else "from the workpiece's centre"
        what = "disc" if round(shape["form"]) == 0 else "box"
        where = f"x {x[0]:.4g} to {x[1]:.4g} mm, y {y[0]:.4g} to {y[1]:.4g} mm ({frame})"
        return f"{axis} axis, while cutting in a {what}, {where}", (
            f"{x[0]:.4g} < x < {x[1]:.4g}",
            f"{y[0]:.4g} < y < {y[1]:.4g}",
        )


def best_rectangle(
    x: Float1D, y: Float1D, force: Float1D, value: Float1D, bins: int = 30
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """The rectangle inside which value = k * force has the k that differs most from outside: (centre, half) of x and y.

    x, y : (n,), mm; force, value : (n,). Least squares over all rectangles of a grid; None where nothing varies.
    """
    if len(x) < 50 or not np.any(force) or np.ptp(x) == 0 or np.ptp(y) == 0:
        return None
    value = value - force * float(force @ value) / float(force @ force)
    edges = [np.linspace(v.min(), v.max(), bins + 1) for v in (x, y)]
    at = [np.clip(np.searchsorted(e, v, side="right") - 1, 0, bins - 1) for e, v in zip(edges, (x, y), strict=True)]
    cell = at[0] * bins + at[1]
    sums = []
    for weight in (force * value, force**2):
        grid = np.bincount(cell, weight, minlength=bins**2).reshape(bins, bins)
        sums.append(np.pad(grid.cumsum(0).cumsum(1), ((1, 0), (1, 0))))
    first, last = np.triu_indices(bins + 1, k=1)
    strips = [s[last] - s[first] for s in sums]
    inner, own = (s[:, last] - s[:, first] for s in strips)
    whole = float(force @ force)
    inside = (own > 1e-3 * whole) & (own < 0.9 * whole)
    gain = np.where(inside, inner**2 * (1 / np.maximum(own, 1e-12) + 1 / np.maximum(whole - own, 1e-12)), 0.0)
    i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
    if gain[i, j] <= 0:
        return None
    spans = [(edges[0][first[i]], edges[0][last[i]]), (edges[1][first[j]], edges[1][last[j]])]
    (x_c, half_x), (y_c, half_y) = [(float(a + b) / 2, float(b - a) / 2) for a, b in spans]
    return (x_c, half_x), (y_c, half_y)


def _place(state: AxisState, machine: bool) -> tuple[Float1D, Float1D] | None:
    """x and y of the tool, mm, from the workpiece's centre or of the machine."""
    x, y = (state.places.get("x"), state.places.get("y")) if machine else (state.wx, state.wy)
    return None if x is None or y is None else (x, y)


def _cut_places(states: Sequence[AxisState], machine: bool) -> tuple[Float1D, Float1D]:
    """x and y of every sample that carries a load."""
    xs, ys = [], []
    for s in states:
        place, force = _place(s, machine), load(s)
        if place is None or force is None:
            continue
        good = (np.nan_to_num(force) != 0) & np.isfinite(place[0]) & np.isfinite(place[1])
        xs.append(place[0][good])
        ys.append(place[1][good])
    return (np.concatenate(xs), np.concatenate(ys)) if xs else (np.zeros(0), np.zeros(0))


class CoolantLoad(Mechanism):
    """A load while coolant is on; `along`: 0 constant, 1 against the motion."""

    id = "coolant_load"
    equation = "dI = C * coolant"
    amplitudes = (Parameter("C", "A"),)
    shape = (choice("along", 2),)
    summary = "{axis} axis, while coolant is on"
    follows_from = ("coolant",)

    def regressors(self, state, *, along):
        if state.coolant is None:
            return nothing(state)
        return column(np.nan_to_num(state.coolant) * (direction(state) if round(along) == 1 else 1.0))

    def equation_in(self, axis, shape):
        return f"{self.equation} * sgn(v), {at_rest()}" if round(shape["along"]) == 1 else self.equation

    def needs(self, states):
        if any(s.coolant is None for s in states):
            return "it is not known when coolant is on"
        values = np.concatenate([s.coolant for s in states if s.coolant is not None])
        return None if np.nanmin(values) < np.nanmax(values) else "coolant never changes"

    def conditions(self, axis, shape):
        return self.summary.format(axis=axis), ("coolant = 1",)
