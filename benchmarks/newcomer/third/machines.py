"""Ten kinds of machines that differ from those of the other editions and from each other.

In:  nothing. Out: `KINDS`. Makers' data sheets of such machines, rounded; each draw spreads them.
"""

from __future__ import annotations

from benchmarks.newcomer.machines import Kind

KINDS = (
    Kind("rack portal", (9000, 4200, 1500), 320, 320, 0.25, (10, 90), (150, 4000), 6.0, (30, 60), (25, 50, 100),
         (0.1, 0.5), "z", (0, 1, 2), 31.42, False, (63, 100, 160), 0.5,
         ("raster", "adaptive", "zigzag", "peck", "edges", "touch"), gains=(1.7, 1.1, 0.6), slides=0.6, lag_hz=(2, 7),
         colours=(2, 4, 3), short_s=(0.03, 0.4), shares={"inertia": (1.5, 4.0), "cutting_force": (0.2, 0.7)}),
    Kind("impeller mill", (700, 820, 560), 700, 7500, 0.03, (10, 120), (8e3, 20e3), 1.5, (5, 12), (200, 250, 500),
         (0.05, 0.3), "z", (0, 1, 2), 20, True, (3, 6, 12), 0.5,
         ("dome", "adaptive", "rosette", "thread", "freeform"), gains=(1.2, 1.0, 1.4), slides=0.6, lag_hz=(12, 40),
         colours=(5, 2, 1), cuts=(0.6, 2.5)),
    Kind("micro mill", (160, 150, 100), 350, 14000, 0.012, (1.5, 40), (2e4, 6e4), 1.0, (0.25, 0.5), (1000,),
         (0.02, 0.1), "z", (0, 1, 2), 24, False, (0.3, 0.6, 1.5), 0.6,
         ("dome", "rosette", "thread", "peel", "engrave"), slides=0.2, lag_hz=(25, 90), colours=(6, 3, 0.3),
         short_s=(0.002, 0.02), parts=(4, 6), shares={"inertia": (1.5, 3.5), "coulomb_friction": (0.2, 0.6)}),
    Kind("hobby router", (600, 420, 110), 55, 260, 0.08, (4, 30), (1e4, 2.4e4), 1.0, (0.8, 1.2), (20, 25, 50),
         (2.5, 5.0), "z", (0, 1, 2), 8, True, (1, 3, 6), 0.0, ("peel", "zigzag", "thread", "bevel", "raster", "pocket"),
         gains=(1.4, 1.0, 0.7), slides=1.3, colours=(6, 1, 1), outliers=0.002),
    Kind("lathe with a mill", (340, 150, 1500), 300, 2600, 0.08, (3, 45), (150, 4500), 5.0, (6, 18), (50, 100, 125),
         (0.1, 0.7), "x", (2, 0, 1), 10, True, (6, 10, 20), 0.3,
         ("bevel", "peck", "zigzag", "touch", "adaptive", "creep"), gains=(0.8, 0.6, 1.6), pace=(1.0, 0.8, 0.35),
         colours=(3, 3, 3), short_s=(0.01, 0.2), shares={"gravity_load": (1.0, 3.0)}),
    Kind("balanced column", (1100, 600, 700), 420, 3200, 0.06, (6, 70), (600, 9e3), 2.2, (5, 11), (100, 200, 250),
         (0.1, 0.5), "z", (0, 1, 2), 16, True, (10, 20, 50), 0.4,
         ("peck", "thread", "adaptive", "touch", "zigzag", "bevel"), gains=(1.0, 1.2, 1.5), pace=(1.0, 1.0, 0.7),
         shares={"gravity_load": (0.02, 0.3), "inertia": (1.0, 3.0)}, parts=(6, 10), seconds=(45.0, 150.0)),
    Kind("plain log", (760, 510, 480), 380, 3000, 0.06, (5, 60), (800, 8e3), 2.0, (3.5, 9), (20, 50, 100), (0.1, 0.8),
         "z", (0, 1, 2), 12, True, (6, 10, 16), 0.2, ("adaptive", "peck", "rosette", "raster", "bevel", "face"),
         bare=True, sim_step=0.004),
    Kind("box-way planer", (1600, 700, 600), 70, 260, 0.14, (1.5, 16), (100, 1800), 4.0, (8, 14), (50, 100, 200),
         (0.1, 0.6), "z", (0, 1, 2), 8, True, (25, 50, 80), 0.1,
         ("raster", "zigzag", "creep", "touch", "bevel", "ramp"), gains=(1.4, 1.0, 1.2), slides=1.8,
         colours=(2, 3, 3), short_s=(0.02, 0.3), also=("stribeck_friction",), v_s_mm_s=2.5, moves=(0.5, 2.0),
         shares={"inertia": (0.1, 0.5), "stribeck_friction": (0.5, 1.5)}),
    Kind("air-borne gantry", (650, 650, 180), 450, 4500, 0.03, (3, 60), (1e4, 4e4), 1.2, (1.6, 3), (250, 500),
         (0.03, 0.2), "z", (0, 1, 2), 30, False, (1, 2, 4), 0.5, ("raster", "dome", "rosette", "bevel", "peel"),
         gains=(1.5, 1.0, 0.8), slides=0.05, lag_hz=(15, 60), colours=(5, 3, 1), moves=(0.0, 0.2),
         shares={"inertia": (1.5, 4.0), "viscous_friction": (0.05, 0.3)}, force_errors=(0.0, 0.04, 0.1)),
    Kind("transfer unit", (450, 420, 520), 800, 9000, 0.03, (10, 90), (1500, 14e3), 0.8, (4, 9), (100, 200, 400),
         (0.2, 1.0), "y", (0, 1, 2), 20, True, (5, 8, 14), 0.4,
         ("peck", "thread", "peel", "touch", "bevel", "drill"), gains=(1.0, 1.6, 0.9), parts=(9, 14),
         seconds=(35.0, 70.0), colours=(4, 4, 0.5), sim_step=0.002, outliers=0.0005),
)  # fmt: skip
"""Kinds in the order in which a plan meets them."""
