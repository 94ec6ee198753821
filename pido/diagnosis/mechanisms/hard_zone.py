"""Places of the workpiece that cut harder or softer: an inclusion, a weld, a skin.

In:  `AxisState` with a simulated process load and the place of the tool. Out: a mechanism of the catalogue, and what of
     a mismatch speaks for which place.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from pido.core.arrays import Float1D, Float2D, Int1D
from pido.diagnosis.mechanisms.base import Mechanism, Parameter, choice, column, nothing, up_to_edge, which
from pido.diagnosis.mechanisms.process import load, load_in, loaded
from pido.diagnosis.state import AxisState

_FORMS = ("disc", "box", "layer", "ball")
_BINS = 30  # along a direction, in which places are compared
_DEPTHS = 9  # of the middle of a ball, that are compared
_FEWEST_ROWS = 50
_LEAST, _MOST = 1e-3, 0.9  # share of the load's power inside a zone
_NORMALS = ((0.0, 0.0), *((float(a), float(t)) for t in (15, 30, 45, 60, 75) for a in range(0, 360, 30)))
_UPRIGHT = tuple((float(a), 90.0) for a in range(0, 180, 15))
_TURNED = (8.0, 4.0, 2.0)  # °, by which a normal is turned to where it fits best


class MaterialHardZone(Mechanism):
    """A place of the workpiece that cuts harder or softer.

    x_c, y_c, z_c : mm from the middle of the workpiece's top, or in machine coordinates (`frame` 1) where it is unknown
    `form`: 0 disc, 1 box, both through all of the depth; 2 layer between two planes; 3 ball
    r : mm, radius of a disc or ball, half length of a box along x, half thickness of a layer; q : the box' half width
    over r; azimuth, tilt : °, of the layer's normal, from x and from z; d : mm, of its middle along the normal
    """

    id = "material_hard_zone"
    becomes = frozenset({"cutting_force"})
    equation = "dI = H * F inside a disc, box, layer or ball of the workpiece"
    amplitudes = (Parameter("H", "A per N or N·m"),)
    shape = (
        Parameter("x_c", "mm", values=(0.0,)),
        Parameter("y_c", "mm", values=(0.0,)),
        Parameter("z_c", "mm", values=(0.0,)),
        Parameter("r", "mm", low=0.1, high=2000.0, scale="log", points=5),
        Parameter("q", "–", low=0.05, high=20.0, scale="log", values=(1.0,)),
        Parameter("azimuth", "°", values=(0.0,)),
        Parameter("tilt", "°", values=(0.0,)),
        Parameter("d", "mm", values=(0.0,)),
        choice("form", len(_FORMS)),
        choice("frame", 2),
    )
    looked_at = 1000
    follows_from = ("wx", "force", "m_sp")

    def regressors(self, state, *, form, frame, **zone):
        force, place = load(state), _place(state, round(frame) == 1)
        if force is None or place is None:
            return nothing(state)
        inside = up_to_edge(np.nan_to_num(_way(place, form, **zone), nan=np.inf))
        return column(inside * force)

    def equation_in(self, axis, shape):
        zone = (
            "sqrt((x - x_c)^2 + (y - y_c)^2) < r",
            "|x - x_c| < r and |y - y_c| < q * r",
            "|(x * cos(azimuth) + y * sin(azimuth)) * sin(tilt) + z * cos(tilt) - d| < r",
            "sqrt((x - x_c)^2 + (y - y_c)^2 + (z - z_c)^2) < r",
        )[which(shape["form"], len(_FORMS))]
        frame = ("from the middle of the workpiece's top", "in machine coordinates")[round(shape["frame"])]
        return f"dI = H * {load_in(axis)} inside {zone}, x, y and z {frame}"

    def idle(self, shape):
        return frozenset({p.name for p in self.shape if not p.is_choice} - _numbers(shape["form"]))

    def needs(self, states):
        if any(_place(s, True) is None for s in states):
            return "the place of the tool is not known (pos_x, pos_y)"
        return loaded(states)

    def starts(self, states):
        """Discs around sixteen places of what was cut; others come from what is left of the mismatch."""
        frame = _frame(states)
        places = [p for s in states if (p := _cut_places(s, frame)) is not None]
        x, y = (np.concatenate([p[k] for p in places]) for k in (0, 1)) if places else (np.zeros(0), np.zeros(0))
        if len(x) == 0:
            return ()
        ends = [np.quantile(v, [0.02, 0.98]) for v in (x, y)]
        size = max(float(np.ptp(e)) for e in ends)
        centres = [[float(e[0] + (e[1] - e[0]) * k) for k in (0.125, 0.375, 0.625, 0.875)] for e in ends]
        return tuple(
            _shape(0, frame, x_c=cx, y_c=cy, r=size * share)
            for cx in centres[0]
            for cy in centres[1]
            for share in (0.12, 0.25)
        )

    def suggest(self, states, left):
        """Where the load weighs most differently from everywhere else: a rectangle, as box, disc and ball; a layer."""
        frame = _frame(states)
        rows = []
        for s, v in zip(states, left, strict=True):
            place, force = _place(s, frame), load(s)
            if place is None or force is None:
                return ()
            good = np.isfinite(v) & np.isfinite(place).all(axis=0) & (np.nan_to_num(force) != 0)
            rows.append(np.vstack([place, force, v])[:, good])
        *place, force, value = np.concatenate(rows, axis=1)
        if any(_depth(s, frame) is None for s in states):
            place[2] = np.zeros(len(force))
        found = best_rectangle(place[0], place[1], force, value)
        out = [] if found is None else _around_rectangle(found, frame)
        layer = best_layer(np.array(place), force, value)
        if layer is not None:
            azimuth, tilt, d, r = layer
            out.append(_shape(2, frame, azimuth=azimuth, tilt=tilt, d=d, r=r))
        if found is not None and np.ptp(place[2]) > 0:
            (x, _), (y, _) = found
            ball = _best_ball(np.array(place), x, y, force, value)
            out += [] if ball is None else [_shape(3, frame, x_c=x, y_c=y, z_c=ball[0], r=ball[1])]
        return tuple(out)

    def around(self, name, shape, states):
        if name not in _numbers(shape["form"]):
            return shape[name], shape[name]
        here, r = shape[name], shape["r"]
        match name:
            case "azimuth" | "tilt":
                return here - 20.0, here + 20.0
            case "r" | "q":
                return here / 1.8, here * 1.8
            case _:
                half = 0.6 * r * (shape["q"] if name == "y_c" and which(shape["form"], len(_FORMS)) == 1 else 1.0)
                return here - half, here + half

    def free(self, shape):
        return len(_numbers(shape["form"]))

    def conditions(self, axis, shape):
        form, r = which(shape["form"], len(_FORMS)), shape["r"]
        frame = "machine coordinates" if round(shape["frame"]) == 1 else "from the middle of the workpiece's top"
        if form == 2:
            normal, d = _normal(shape["azimuth"], shape["tilt"]), shape["d"]
            along = " ".join(f"{n:+.3g} {a}" for n, a in zip(normal, "xyz", strict=True) if abs(n) > 0.005).lstrip("+")
            limits = f"{d - r:.4g} < {along} < {d + r:.4g}"
            return f"{axis} axis, while cutting in a layer, {limits} mm ({frame})", (limits,)
        half = {"x": r, "y": r * (shape["q"] if form == 1 else 1.0), **({"z": r} if form == 3 else {})}
        ends = {a: (shape[f"{a}_c"] - h, shape[f"{a}_c"] + h) for a, h in half.items()}
        where = ", ".join(f"{a} {low:.4g} to {high:.4g} mm" for a, (low, high) in ends.items())
        conditions = tuple(f"{low:.4g} < {a} < {high:.4g}" for a, (low, high) in ends.items())
        return f"{axis} axis, while cutting in a {_FORMS[form]}, {where} ({frame})", conditions


def _numbers(form: float) -> frozenset[str]:
    """Names of the numbers that a form has."""
    names = ({"x_c", "y_c", "r"}, {"x_c", "y_c", "r", "q"}, {"azimuth", "tilt", "d", "r"}, {"x_c", "y_c", "z_c", "r"})
    return frozenset(names[which(form, len(_FORMS))])


def _shape(form: int, frame: bool, **numbers: float) -> dict[str, float]:
    """A shape with what its form does without at its usual value."""
    usual = {p.name: (p.values or (1.0,))[0] for p in MaterialHardZone.shape}
    return {**usual, **numbers, "form": float(form), "frame": float(frame)}


def _normal(azimuth: float, tilt: float) -> Float1D:
    """(3,) – unit vector, angles in ° from x and from z."""
    a, t = np.radians([azimuth, tilt])
    return np.array([np.cos(a) * np.sin(t), np.sin(a) * np.sin(t), np.cos(t)])


def _way(
    place: Float2D, form: float, r: float, x_c: float = 0.0, y_c: float = 0.0, q: float = 1.0, z_c: float = 0.0,
    azimuth: float = 0.0, tilt: float = 0.0, d: float = 0.0,
) -> Float1D:  # fmt: skip
    """(n,) – distance from the middle of a zone, 1 at its edge. A shape that was stored before it had a form's numbers
    is of another form."""
    dx, dy, dz = np.abs(place - np.array([[x_c], [y_c], [z_c]])) / r
    match which(form, len(_FORMS)):
        case 0:
            return np.hypot(dx, dy)
        case 1:
            return np.maximum(dx, dy / q)
        case 2:
            return np.abs(_normal(azimuth, tilt) @ place - d) / r
        case _:
            return np.sqrt(dx**2 + dy**2 + dz**2)


def _around_rectangle(found: tuple[tuple[float, float], tuple[float, float]], frame: bool) -> list[dict[str, float]]:
    """A rectangle (centre, half of x and y) as a disc of its area, and as a box."""
    (x, half_x), (y, half_y) = found
    disc = float(np.sqrt(4 * half_x * half_y / np.pi))
    return [
        _shape(0, frame, x_c=x, y_c=y, r=disc),
        _shape(1, frame, x_c=x, y_c=y, r=half_x, q=half_y / half_x),
    ]


def best_rectangle(
    x: Float1D, y: Float1D, force: Float1D, value: Float1D
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """The rectangle inside which value = k * force has the k that differs most from outside: (centre, half) of x and y.

    x, y : (n,), mm; force, value : (n,). Least squares over all rectangles of a grid; None where nothing varies.
    """
    if len(x) < _FEWEST_ROWS or not np.any(force) or np.ptp(x) == 0 or np.ptp(y) == 0:
        return None
    value = _beside_one_for_all(force, value)
    edges, at = zip(*(_binned(v) for v in (x, y)), strict=True)
    (inner, own), first, last = over_rectangles(at[0] * _BINS + at[1], (force * value, force**2), _BINS)
    gain = _differs(inner, own, float(force @ force))
    i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
    if gain[i, j] <= 0:
        return None
    return _middle(edges[0], first[i], last[i]), _middle(edges[1], first[j], last[j])


def over_rectangles(cell: Int1D, weights: Iterable[Float1D], cells: int) -> tuple[Float2D, Int1D, Int1D]:
    """(weights, k, k) – sums of each weight (n,) inside every rectangle of a grid of `cells` by `cells`, by its ends
    along the one place and along the other; those ends, (k,) cells each.

    cell : (n,) – number of each row's cell, that along the first place times `cells` plus that along the second
    """
    sums = [np.bincount(cell, weight, minlength=cells**2) for weight in weights]
    grid = np.pad(np.reshape(sums, (-1, cells, cells)).cumsum(1).cumsum(2), ((0, 0), (1, 0), (1, 0)))
    first, last = np.triu_indices(cells + 1, k=1)
    strips = grid[:, last] - grid[:, first]
    return strips[:, :, last] - strips[:, :, first], first, last


def best_layer(place: Float2D, force: Float1D, value: Float1D) -> tuple[float, float, float, float] | None:
    """The layer inside which value = k * force has the k that differs most from outside: azimuth and tilt of its normal
    in °, its middle along that, and half of its thickness.

    place : (3, n), mm; force, value : (n,). Normals every 15 to 30°, the best of them turned; None where nothing
    varies.
    """
    if len(force) < _FEWEST_ROWS or not np.any(force):
        return None
    value = _beside_one_for_all(force, value)
    deep = np.ptp(place[2]) > 0

    def gain(azimuth: float, tilt: float) -> tuple[float, tuple[float, float, float, float] | None]:
        found = _best_interval(_normal(azimuth, tilt) @ place, force, value)
        return (0.0, None) if found is None else (found[2], (azimuth, tilt, found[0], found[1]))

    best, layer = max((gain(*n) for n in (*_UPRIGHT, *(_NORMALS if deep else ()))), key=lambda g: g[0])
    for step in _TURNED:
        while layer is not None:
            azimuth, tilt, *_ = layer
            turned = [(azimuth + step, tilt), (azimuth - step, tilt)]
            turned += [(azimuth, tilt + step), (azimuth, tilt - step)] if deep else []
            better, other = max((gain(*n) for n in turned), key=lambda g: g[0])
            if better <= best:
                break
            best, layer = better, other
    return layer


def _best_ball(place: Float2D, x: float, y: float, force: Float1D, value: Float1D) -> tuple[float, float] | None:
    """Depth and radius of the ball about x and y inside which value = k * force has the k that differs most."""
    value = _beside_one_for_all(force, value)
    best, ball = 0.0, None
    for z in np.linspace(place[2].min(), place[2].max(), _DEPTHS):
        edges, at = _binned(np.linalg.norm(place - np.array([[x], [y], [z]]), axis=0))
        inner, own = (np.bincount(at, weight, minlength=_BINS).cumsum() for weight in (force * value, force**2))
        gain = _differs(inner, own, float(force @ force))
        k = int(np.argmax(gain))
        if gain[k] > best:
            best, ball = float(gain[k]), (float(z), float(edges[k + 1]))
    return ball


def _best_interval(along: Float1D, force: Float1D, value: Float1D) -> tuple[float, float, float] | None:
    """Middle, half width and gain of the interval in which value = k * force differs most from outside."""
    if len(along) < _FEWEST_ROWS or np.ptp(along) == 0 or not np.any(force):
        return None
    edges, at = _binned(along)
    inner, own = (np.r_[0.0, np.bincount(at, weight, minlength=_BINS).cumsum()] for weight in (force * value, force**2))
    first, last = np.triu_indices(_BINS + 1, k=1)
    gain = _differs(inner[last] - inner[first], own[last] - own[first], float(force @ force))
    k = int(np.argmax(gain))
    return (*_middle(edges, first[k], last[k]), float(gain[k])) if gain[k] > 0 else None


def _beside_one_for_all(force: Float1D, value: Float1D) -> Float1D:
    """(n,) – what one k for all rows leaves of value = k * force."""
    return value - force * float(force @ value) / float(force @ force)


def _binned(values: Float1D) -> tuple[Float1D, Int1D]:
    edges = np.linspace(values.min(), values.max(), _BINS + 1)
    return edges, np.clip(np.searchsorted(edges, values, side="right") - 1, 0, _BINS - 1)


def _differs(inner: Float2D | Float1D, own: Float2D | Float1D, whole: float) -> Float2D:
    """What a k of its own takes away inside, `inner` = sum of force * value and `own` of force² there; the values are
    what a k for all leaves, so that both sums over all rows are 0 and `whole`."""
    inside = (own > _LEAST * whole) & (own < _MOST * whole)
    gain = inner**2 * (1 / np.maximum(own, 1e-12) + 1 / np.maximum(whole - own, 1e-12))
    return np.where(inside, gain, 0.0)


def _middle(edges: Float1D, first: int, last: int) -> tuple[float, float]:
    return float(edges[first] + edges[last]) / 2, float(edges[last] - edges[first]) / 2


def _frame(states: Sequence[AxisState]) -> bool:
    """Whether places are of the machine, because those of a workpiece are not known."""
    return any(_place(s, False) is None for s in states)


def _place(state: AxisState, machine: bool) -> Float2D | None:
    """(3, n) – place of the tool, mm, from the middle of the workpiece's top or of the machine; z 0 where only that is
    not known."""
    x, y = (state.places.get(a) for a in "xy") if machine else (state.wx, state.wy)
    z = _depth(state, machine)
    return None if x is None or y is None else np.vstack([x, y, np.zeros(len(x)) if z is None else z])


def _depth(state: AxisState, machine: bool) -> Float1D | None:
    return state.places.get("z") if machine else state.wz


def _cut_places(state: AxisState, machine: bool) -> Float2D | None:
    """(3, m) – place of every sample that carries a load."""
    place, force = _place(state, machine), load(state)
    if place is None or force is None:
        return None
    return place[:, (np.nan_to_num(force) != 0) & np.isfinite(place).all(axis=0)]
