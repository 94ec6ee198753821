"""Effects that no vocabulary has: loads that a real machine could show, for which there is no name to find."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.signal import lfilter

from pido.core.arrays import Float1D
from pido.core.axes import LINEAR_AXES
from pido.synthetic.drive import CYCLE_S
from pido.synthetic.laws import Load, Shape
from pido.synthetic.parts import Course


def _spring(course: Course, axis: str, shape: Shape) -> Float1D:
    """A cable chain that pulls back with the square of the way from where it hangs slack."""
    return ((course.pos[axis] - shape["slack_mm"]) / 50.0) ** 2


def _swing(course: Course, axis: str, shape: Shape) -> Float1D:
    """A fixture that swings after each change of speed: a lightly damped oscillator, driven by acceleration."""
    w, zeta = 2 * np.pi * shape["frequency_hz"], shape["damping"]
    decay = np.exp(-zeta * w * CYCLE_S)
    poles = [1.0, -2 * decay * np.cos(w * np.sqrt(1 - zeta**2) * CYCLE_S), decay**2]
    return np.asarray(lfilter([w * CYCLE_S], poles, course.a[axis] / 1000.0))


def _whirl(course: Course, axis: str, shape: Shape) -> Float1D:
    """A spindle speed at which the machine's frame hums."""
    return np.exp(-(((np.abs(course.v_sp) - shape["speed_deg_s"]) / shape["width_deg_s"]) ** 2))


def _wiper(course: Course, axis: str, shape: Shape) -> Float1D:
    """A cover that is dragged along by two axes at once: the product of their speeds."""
    other = shape["other"]
    return course.v[axis] * course.v[other] / 100.0


def _fading(course: Course, axis: str, shape: Shape) -> Float1D:
    """Grease pushed aside: after each start friction falls with the way covered since the last stop."""
    v = course.v[axis]
    way = np.zeros(len(v))
    step = np.abs(v) * CYCLE_S
    total = np.cumsum(step)
    rest = np.maximum.accumulate(np.where(v == 0, total, 0.0))
    way = total - rest
    return np.exp(-way / shape["distance_mm"]) * np.tanh(v / 0.05)


def _draw_spring(axis: str, courses: list[Course], rng: np.random.Generator) -> dict[str, Any]:
    pos = courses[0].pos[axis]
    return {"slack_mm": float(rng.uniform(pos.min(), pos.max()))}


def _draw_whirl(axis: str, courses: list[Course], rng: np.random.Generator) -> dict[str, Any]:
    speeds = np.unique(np.round(np.abs(courses[0].v_sp[courses[0].cutting | (courses[0].v_sp != 0)]), -1))
    at = float(rng.choice(speeds)) if len(speeds) else 18000.0
    return {"speed_deg_s": at, "width_deg_s": 900.0}


def _draw_other(axis: str, courses: list[Course], rng: np.random.Generator) -> dict[str, Any]:
    return {"other": str(rng.choice([a for a in ("x", "y") if a != axis]))}


UNKNOWN: tuple[Load, ...] = (
    Load("unknown", LINEAR_AXES, _spring, draw=_draw_spring),
    Load("unknown", LINEAR_AXES, _swing,
         draw=lambda a, c, rng: {"frequency_hz": float(rng.uniform(2, 5)), "damping": 0.05}),
    Load("unknown", LINEAR_AXES, _whirl, draw=_draw_whirl),
    Load("unknown", ("x", "y"), _wiper, draw=_draw_other),
    Load("unknown", ("x", "y"), _fading, draw=lambda a, c, rng: {"distance_mm": float(rng.uniform(2, 8))}),
)  # fmt: skip
