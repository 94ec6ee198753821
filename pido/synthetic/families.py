"""Families of parts, as generated SINUMERIK programs: impellers in POM-C; gear, plate and notch in steel and aluminium.

In:  how many, and what varies.
Out: `PartJob`s, with geometry, feed and speed of their own. Programs are written as a CAM system or a man writes them:
     zero offset, tool call, feed and speed in the block where they change.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pido import config
from pido.core.errors import SettingsError
from pido.core.machining import Machine, Stock, Tool
from pido.synthetic.parts import PartJob

IMPELLER_TOOLS = {
    "MILL_5": Tool("MILL_5", 5.0, 2, mass_kg=1.2),
    "BALL_6": Tool("BALL_6", 6.0, 2, kind="ball", corner_radius_mm=3.0, mass_kg=1.3),
}
STEEL_TOOL = {"MILL_10": Tool("MILL_10", 10.0, 4, mass_kg=1.6)}
BASELINE = {"S235JR": (576.0, 3200.0), "AL2007T4": (350.0, 3800.0), "POM-C": (1500.0, 8000.0)}
"""Feed in mm/min and spindle speed in 1/min (paper, section IV-A and VII-A)."""


def impellers(
    machine: Machine, n: int = 12, *, seed: int = 0, pause_s: float = 120.0, material: str = "POM-C"
) -> list[PartJob]:
    """n impellers of one family: number, sweep and height of the blades, feed and speed differ; blank 150 x 75 x 50 mm.

    A hub is milled around, channels between curved blades are cleared in layers, a ball mill goes along the blades.
    """
    if n < 1:
        raise SettingsError(f"a family of {n} parts: there must be at least one.")
    rng = np.random.default_rng(seed)
    jobs, clock = [], 0.0
    for k in range(n):
        blades = int(rng.integers(4, 8))
        sweep = rng.uniform(0.3, 1.1) * rng.choice([-1, 1])
        outer, hub = rng.uniform(29, 33), rng.uniform(9, 13)
        depth = rng.uniform(3.0, 6.0)
        feed, speed = BASELINE[material]
        feed *= rng.uniform(0.75, 1.25)
        speed = round(speed * rng.uniform(0.9, 1.05) / 10) * 10
        lines = _head(f"IMPELLER {k + 1:02d}: {blades} blades", "MILL_5", speed)
        lines += _circle(outer, min(depth, 3.0), feed)
        layers = np.linspace(0, depth, int(np.ceil(depth / 1.8)) + 1)[1:]
        for z in layers:
            for b in range(blades):
                lines += _channel(2 * np.pi * b / blades, sweep, hub, outer - 4.0, z, feed, speed)
        lines += ["M9", "G0 Z50", 'T="BALL_6"', "M6", f"S{speed * 0.9:.0f} M3", "M8"]
        for b in range(blades):
            lines += _blade_edge(2 * np.pi * (b + 0.5) / blades, sweep, hub, outer - 4.0, feed * 0.8)
        jobs.append(
            _job(machine, f"IMP-{k + 1:02d}", lines, IMPELLER_TOOLS, material, (150.0, 75.0, 50.0), k + 1, clock)
        )
        clock += 900.0 + pause_s
    return jobs


def gear(machine: Machine, material: str = "S235JR", **options: Any) -> list[PartJob]:
    """A ring with 12 teeth: motion in every direction of the plane. Options as `variants`."""
    return variants(machine, "gear", material, **options)


def plate(machine: Machine, material: str = "S235JR", **options: Any) -> list[PartJob]:
    """A plate with slots along the axes: motion along a few directions only. Options as `variants`."""
    return variants(machine, "plate", material, **options)


def notch(machine: Machine, material: str = "S235JR", **options: Any) -> list[PartJob]:
    """Notches of growing depth with ramps. Options as `variants`."""
    return variants(machine, "notch", material, **options)


def variants(
    machine: Machine, shape: str, material: str, *, vary: str = "none", a_p: float | None = None, start_s: float = 0.0
) -> list[PartJob]:
    """Three parts: all baseline ('none'); low, baseline, high depth ('a_p') or speed and feed ('SF') (table 1)."""
    if vary not in ("none", "a_p", "SF"):
        raise SettingsError(f"vary = '{vary}': known are none, a_p, SF.")
    feed, speed = BASELINE[material]
    depth = a_p or (6.0 if material != "POM-C" else 3.0)
    settings = {
        "none": [(depth, 1.0, 1.0)] * 3,
        "a_p": [(depth / 2, 1.0, 1.0), (depth, 1.0, 1.0), (2 * depth, 1.0, 1.0)],
        "SF": [(depth, 0.75, 0.75), (depth, 1.0, 1.0), (depth, 1.25, 1.25)],
    }[vary]
    draw = {"gear": _gear, "plate": _plate, "notch": _notch}[shape]
    jobs, clock = [], start_s
    for k, (z, f, s) in enumerate(settings):
        name = f"{shape.upper()}-{material.replace('-', '')}-{vary}-{k + 1}"
        lines = _head(name, "MILL_10", speed * s) + draw(z, feed * f, speed * s)
        jobs.append(_job(machine, name, lines, STEEL_TOOL, material, (80.0, 80.0, 40.0), k + 1, clock))
        clock += 420.0
    return jobs


def air_cut(machine: Machine, *, runs: int = 3) -> PartJob:
    """A contour of lines and arcs, faster from block to block, run several times without a workpiece."""
    lines = _head("AIR CUT", "MILL_10", 2000)
    lines += ["G0 X37.5 Y-10 Z10"]
    for _ in range(runs):
        lines += ["G0 X37.5 Y-10", "G0 Z-5"]
        corner = [
            (27.5, 10),
            (10, 27.5),
            (10, 47.5),
            (27.5, 65),
            (47.5, 65),
            (65, 47.5),
            (65, 27.5),
            (47.5, 10),
            (27.5, 10),
        ]
        lines += [f"G1 X37.5 Y10 S{2000} F360"]
        for i, (x, y) in enumerate(corner):
            speed, feed = 2000 + 150 * i, 360 + 27 * i
            if i % 2 == 1:
                was = corner[i - 1]
                middle = {1: (27.5, 27.5), 3: (27.5, 47.5), 5: (47.5, 47.5), 7: (47.5, 27.5)}[i]
                lines += [f"G2 X{x} Y{y} I{middle[0] - was[0]} J{middle[1] - was[1]} S{speed} F{feed}"]
            else:
                lines += [f"G1 X{x} Y{y} S{speed} F{feed}"]
        lines += ["G0 Z10"]
    return _job(machine, "AIRCUT", [*lines], STEEL_TOOL, None, None, 1, 0.0)


def random_contours(
    machine: Machine,
    n: int,
    rng: np.random.Generator,
    *,
    material: str | None = "S235JR",
    seconds: float = 80.0,
    coolant_with_cut: bool = False,
) -> list[PartJob]:
    """n different parts of `seconds` each: slots, arcs, pockets, ramps and air moves at changing feed, speed and depth.

    coolant_with_cut : coolant runs in every cut and never else, as many programs have it; otherwise in some of them
    """
    tools = STEEL_TOOL | {"MILL_6": Tool("MILL_6", 6.0, 3, mass_kg=2.4)}
    jobs, clock = [], 0.0
    for k in range(n):
        lines, spent = _head(f"PART {k + 1:02d}", "MILL_10", 3000), 4.0
        feed0, speed0 = BASELINE[material or "AL2007T4"]
        second = False
        while spent < seconds:
            if not second and spent > 0.6 * seconds:
                second = True
                lines += ["M9", "G0 Z50", 'T="MILL_6"', "M6", f"S{speed0:.0f} M3"]
                spent += 2.0
            feed = feed0 * rng.uniform(0.6, 2.2)
            speed = round(speed0 * rng.uniform(0.7, 1.35) / 50) * 50
            depth = float(rng.uniform(0.5, 3.0)) * (1.0 if material == "S235JR" else 1.6)
            wet = coolant_with_cut or rng.random() < 0.5
            block, way = _random_feature(rng, depth, feed, speed)
            lines += ["M8" if wet else "M9", *block]
            if coolant_with_cut:
                lines += ["M9"]
            spent += way / (feed / 60.0) + 2.5
            if rng.random() < 0.3:  # measuring moves: along one axis, faster than a cut, above the part
                at = rng.uniform(5, 75, 2)
                lines += ["G0 Z20", f"G1 X{at[0]:.3f} F{rng.uniform(600, 4000):.0f}", f"G1 Y{at[1]:.3f}", "G4 F0.8"]
                spent += 3.0
        blank = (80.0, 80.0, 40.0) if material else None
        jobs.append(_job(machine, f"p{k + 1:02d}", lines, tools, material, blank, k + 1, clock))
        clock += 2.5 * seconds + float(rng.uniform(30, 400))
    return jobs


def _head(title: str, tool: str, speed: float) -> list[str]:
    return [f";{title}", "G90 G94 G710", "G54", f'T="{tool}"', "M6", "G64", "G0 Z50", f"S{speed:.0f} M3"]


def _job(
    machine: Machine,
    name: str,
    lines: Sequence[str],
    tools: dict[str, Tool],
    material: str | None,
    blank: tuple[float, float, float] | None,
    order: int,
    clock: float,
) -> PartJob:
    """The blank's upper face, lower left corner, is the program's origin; it stands in the middle of the travel."""
    size = np.array(blank or (80.0, 80.0, 40.0))
    middle = np.array([np.mean(machine.axes[a].travel_mm) for a in ("x", "y", "z")])
    zero = np.round(middle - np.array([size[0] / 2, size[1] / 2, 0.0]), 0)
    stock = None
    if blank is not None:
        low = zero - np.array([0.0, 0.0, size[2]])
        high = zero + np.array([size[0], size[1], 0.0])
        stock = Stock((float(low[0]), float(low[1]), float(low[2])), (float(high[0]), float(high[1]), float(high[2])))
    program = "\n".join([*lines, "M9", "G0 Z50", "M5", "M30", ""])
    return PartJob(
        name=name,
        program=program,
        tools=tools,
        material=config.material(material) if material else None,
        stock=stock,
        zero_mm=(float(zero[0]), float(zero[1]), float(zero[2])),
        order=order,
        start_time_s=clock,
    )


def _circle(radius: float, depth: float, feed: float) -> list[str]:
    """Around the hub, outside the blades, in the middle of a 150 x 75 blank."""
    return [
        f"G0 X{75 + radius:.3f} Y37.5", "G0 Z2", "M8", f"G1 Z{-depth:.3f} F{feed / 3:.0f}",
        f"G3 X{75 + radius:.3f} Y37.5 I{-radius:.3f} J0 F{feed:.0f}", "G0 Z5",
    ]  # fmt: skip


def _arm(angle: float, sweep: float, hub: float, outer: float) -> list[tuple[float, float]]:
    """A curved channel from the hub outwards, as chords; mm in workpiece coordinates."""
    r = np.linspace(hub, outer, 7)
    phi = angle + sweep * (r - hub) / (outer - hub)
    return list(zip(75 + r * np.cos(phi), 37.5 + r * np.sin(phi), strict=True))


def _channel(angle: float, sweep: float, hub: float, outer: float, z: float, feed: float, speed: float) -> list[str]:
    way = _arm(angle, sweep, hub, outer)
    x, y = way[0]
    lines = ["M9", f"G0 X{x:.3f} Y{y:.3f}", "G0 Z2", "M8", f"G1 Z{-z:.3f} F{feed / 3:.0f} S{speed:.0f}"]
    lines += [f"G1 X{x:.3f} Y{y:.3f} F{feed:.0f}" for x, y in way[1:]]
    return [*lines, "G0 Z5"]


def _blade_edge(angle: float, sweep: float, hub: float, outer: float, feed: float) -> list[str]:
    way = _arm(angle, sweep, hub, outer)
    x, y = way[0]
    lines = [f"G0 X{x:.3f} Y{y:.3f}", "G0 Z2", f"G1 Z-0.4 F{feed / 3:.0f}"]
    lines += [f"G1 X{x:.3f} Y{y:.3f} Z{-0.4 - 0.1 * i:.3f} F{feed:.0f}" for i, (x, y) in enumerate(way[1:])]
    return [*lines, "G0 Z5"]


def _gear(z: float, feed: float, speed: float) -> list[str]:
    lines = ["M8", "G0 X-10 Y40", f"G0 Z{-z:.3f}"]
    points = []
    for i in range(24):
        r = 26.0 if i % 2 else 33.0
        phi = np.pi - 2 * np.pi * i / 24
        points.append((40 + r * np.cos(phi), 40 + r * np.sin(phi)))
    points.append(points[0])
    return [*lines, *[f"G1 X{x:.3f} Y{y:.3f} F{feed:.0f} S{speed:.0f}" for x, y in points], "G1 X-10 Y40"]


def _plate(z: float, feed: float, speed: float) -> list[str]:
    lines = ["M8"]
    for y in (15.0, 30.0, 45.0, 60.0):
        lines += [
            "G0 Z5",
            f"G0 X-10 Y{y}",
            f"G0 Z{-z:.3f}",
            f"G1 X70 F{feed:.0f} S{speed:.0f}",
            f"G1 Y{y + 5}",
            "G1 X-10",
        ]
    return lines


def _notch(z: float, feed: float, speed: float) -> list[str]:
    lines = ["M8"]
    for i, x in enumerate((15.0, 32.0, 49.0, 66.0)):
        depth = z * (i + 1) / 4
        lines += [
            "G0 Z5",
            f"G0 X{x} Y-10",
            "G0 Z0.5",
            f"G1 Y10 Z{-depth:.3f} F{feed:.0f} S{speed:.0f}",
            "G1 Y60",
            "G1 Y88 Z1",
        ]
    return lines


def _random_feature(rng: np.random.Generator, z: float, feed: float, speed: float) -> tuple[list[str], float]:
    """(blocks, length in mm) of a line from the edge, a zigzag, an arc or a ramp somewhere in a blank of 80 x 80 mm."""
    kind = rng.integers(4)
    f = f"F{feed:.0f} S{speed:.0f}"
    x, y = rng.uniform(15, 65, 2)
    down = f"G1 Z{-z:.3f} F{min(feed, 240) / 2:.0f}"
    if kind == 0:
        angle = rng.uniform(0, 2 * np.pi)
        length = rng.uniform(15, 40)
        x2, y2 = np.clip([x + length * np.cos(angle), y + length * np.sin(angle)], 8, 72)
        way = float(np.hypot(x2 - x, y2 - y))
        return ["G0 Z5", f"G0 X{x:.3f} Y{y:.3f}", "G0 Z1", down, f"G1 X{x2:.3f} Y{y2:.3f} {f}"], way + 8
    if kind == 1:
        width = rng.uniform(15, 30)
        x, y = min(x, 40.0), min(y, 55.0)
        lines = ["G0 Z5", f"G0 X{x:.3f} Y{y:.3f}", "G0 Z1", down]
        for i in range(3):
            side = x + width if i % 2 == 0 else x
            lines += [f"G1 X{side:.3f} {f}", f"G1 Y{y + 5 * (i + 1):.3f}"]
        return lines, 3 * width + 25
    if kind == 2:
        r = rng.uniform(6, 14)
        turn = rng.choice(["G2", "G3"])
        x, y = np.clip(x, 30, 50), np.clip(y, 20, 60)
        return ["G0 Z5", f"G0 X{x:.3f} Y{y:.3f}", "G0 Z1", down,
                f"{turn} X{x:.3f} Y{y:.3f} I{r * rng.choice([-1, 1]):.3f} J0 {f}"], 2 * np.pi * r + 8  # fmt: skip
    length = rng.uniform(20, 35)
    way = -length if x > 40 else length
    return ["G0 Z5", f"G0 X{x:.3f} Y{y:.3f}", "G0 Z0.5", f"G1 X{x + way:.3f} Z{-z:.3f} {f}", f"G1 X{x:.3f}"], 2 * length
