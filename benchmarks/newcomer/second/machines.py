"""Eight kinds of machines that differ from those of the first edition and from each other.

In:  nothing. Out: `KINDS`. Makers' data sheets of such machines, rounded; each draw spreads them.
"""

from __future__ import annotations

from benchmarks.newcomer.machines import Kind

KINDS = (
    Kind("jig borer", (450, 350, 300), 80, 600, 0.08, (2, 15), (800, 6e3), 2.5, (1.0, 3.0), (100, 200, 500),
         (0.03, 0.2), "z", (0, 1, 2), 5, True, (6, 12, 20), 0.3,
         ("helix", "drill", "probe", "contour", "spiral", "edges"), gains=(1.0, 1.3, 0.8), slides=0.25, lag_hz=(10, 40),
         colours=(6, 2, 1)),
    Kind("nesting router", (3000, 1500, 450), 900, 2600, 0.1, (25, 150), (9e3, 18e3), 0.5, (5, 8), (20, 25, 50),
         (0.5, 2.0), "z", (0, 1, 2), 25, False, (6, 12, 18), 0.2,
         ("edges", "trochoid", "pocket", "air", "drill", "terraces"), gains=(1.6, 1.0, 0.5), slides=0.8,
         colours=(2, 5, 2), short_s=(0.03, 0.3)),
    Kind("dental mill", (130, 110, 90), 70, 2200, 0.025, (2, 22), (15e3, 50e3), 1.5, (0.18, 0.3), (250, 500, 1000),
         (0.2, 1.2), "z", (0, 1, 2), 2, True, (0.6, 1, 2.5), 0.4,
         ("freeform", "spiral", "helix", "engrave", "terraces", "probe"), slides=1.2, colours=(5, 4, 0.5),
         short_s=(0.004, 0.04)),
    Kind("floor borer", (6000, 2500, 1200), 220, 450, 0.2, (4, 40), (120, 2500), 8.0, (22, 40), (20, 40), (0.1, 0.5),
         "y", (0, 1, 2), 20, False, (50, 100, 160), 0.2, ("face", "ramp", "drill", "edges", "contour", "creep"),
         gains=(1.5, 1.2, 0.7), slides=0.3, lag_hz=(3, 9), colours=(3, 4, 2), short_s=(0.02, 0.3)),
    Kind("knee mill", (650, 300, 350), 50, 220, 0.12, (1.5, 14), (150, 3000), 2.0, (4, 5), (25, 50, 100), (0.3, 1.2),
         "z", (0, 1, 2), 5.08, True, (6, 12, 25), 0.0, ("ramp", "pocket", "face", "terraces", "probe", "creep"),
         gains=(1.0, 0.8, 1.5), slides=1.8, colours=(2, 4, 2), short_s=(0.02, 0.2)),
    Kind("die sinker", (1200, 850, 600), 550, 5500, 0.035, (15, 150), (6e3, 24e3), 2.2, (4, 10), (125, 250, 500),
         (0.05, 0.4), "z", (0, 1, 2), 20, True, (6, 12, 20), 0.5,
         ("freeform", "trochoid", "spiral", "ramp", "contour", "helix"), gains=(1.0, 1.4, 1.1), slides=0.7,
         lag_hz=(12, 45), colours=(5, 3, 1)),
    Kind("bar centre", (3500, 400, 350), 650, 3500, 0.07, (15, 110), (5e3, 20e3), 0.6, (6, 5), (40, 80, 160),
         (0.1, 0.8), "y", (0, 2, 1), 40, False, (5, 10, 16), 0.3,
         ("drill", "edges", "trochoid", "face", "air", "terraces"), gains=(1.8, 0.7, 0.9), slides=0.9,
         colours=(3, 5, 1), short_s=(0.01, 0.15)),
    Kind("tapping centre", (500, 380, 300), 800, 11000, 0.02, (8, 70), (4e3, 16e3), 0.6, (2.5, 6), (200, 400, 800),
         (0.1, 0.6), "z", (0, 1, 2), 16, True, (4, 8, 12), 0.5, ("drill", "helix", "edges", "pocket", "air", "spiral"),
         slides=0.6, lag_hz=(15, 60), colours=(4, 4, 0.7), short_s=(0.004, 0.05)),
)  # fmt: skip
"""Kinds in the order in which a plan meets them."""
