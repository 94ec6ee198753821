"""Seven kinds of machines that differ in kind, and one draw of each.

In:  a random generator. Out: a `Machine`: what its axes and spindle can do, how it is logged.
Handbook figures (Altintas, Manufacturing Automation; Weck/Brecher, Werkzeugmaschinen 3), each spread by some tens of
per cent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pido.core.arrays import Float1D
from pido.core.axes import LINEAR_AXES


@dataclass(frozen=True)
class Kind:
    """travel_mm, v_mm_s (rapid), a_mm_s2 : x, y, z; jerk_s : time in which an acceleration is built up

    rpm : of the spindle's work; rpm_s : run-up from 0 to the highest; amps : of an axis' friction, and the spindle's
    rates_hz : of the log; steps : converter steps per noise rms, lowest and highest; plane : the axes of the work plane
    and the infeed; pitch_mm : of screw, rack or magnets; screw : whether part.json would name a lead
    gains : x, y, z, how many A an axis takes beside the others, –; slides : Coulomb friction in that of a slideway, –
    lag_hz : lowest and highest; colours : how much of white, short and long noise, as weights; short_s : of the short
    moves, cuts : how much noisier an axis is that moves, one that cuts, lowest and highest, –
    outliers : share of single samples that are far off, –
    pace : x, y, z, how fast beside the others, –; parts, seconds : fewest and most that are shown, shortest and longest
    shares : of a term of the simulation, where they are not the usual ones; also : further terms that it has
    v_s_mm_s : of a simulated Stribeck friction; sim_step : of simulated currents, in an axis' friction, –
    bare : whether a log and part.json hold no more than they must
    """

    name: str
    travel_mm: tuple[float, float, float]
    v_mm_s: float
    a_mm_s2: float
    jerk_s: float
    feeds_mm_s: tuple[float, float]
    rpm: tuple[float, float]
    run_up_s: float
    amps: tuple[float, float]
    rates_hz: tuple[float, ...]
    steps: tuple[float, float]
    vertical: str
    plane: tuple[int, int, int]
    pitch_mm: float
    screw: bool
    tools_mm: tuple[float, ...]
    lag: float
    jobs: tuple[str, ...]
    gains: tuple[float, float, float] = (1.0, 1.0, 1.0)
    slides: float = 1.0
    lag_hz: tuple[float, float] = (6.0, 30.0)
    colours: tuple[float, float, float] = (4.0, 4.0, 1.0)
    short_s: tuple[float, float] = (0.008, 0.12)
    moves: tuple[float, float] = (0.0, 0.8)
    cuts: tuple[float, float] = (0.1, 1.2)
    outliers: float = 0.0
    pace: tuple[float, float, float] = (1.0, 1.0, 1.0)
    parts: tuple[int, int] = (5, 9)
    seconds: tuple[float, float] = (60.0, 240.0)
    shares: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    also: tuple[str, ...] = ()
    v_s_mm_s: float = 1.0
    sim_step: float = 0.0
    force_errors: tuple[float, ...] = (0.0, 0.02, 0.05)
    bare: bool = False


KINDS = (
    Kind("benchtop", (300, 200, 80), 45, 350, 0.06, (3, 25), (8e3, 22e3), 2.0, (0.5, 0.9), (20, 25, 50), (0.8, 2.5),
         "z", (0, 1, 2), 4, True, (1, 3, 6), 0.0, ("pocket", "engrave", "face", "drill", "creep", "contour")),
    Kind("portal", (4200, 2600, 1000), 420, 1100, 0.15, (25, 180), (3e3, 12e3), 3.0, (9, 12), (50, 100), (0.1, 0.6),
         "z", (0, 1, 2), 30, False, (20, 50, 80), 0.3, ("face", "contour", "pocket", "drill", "freeform", "creep")),
    Kind("linear motor", (520, 460, 320), 600, 9000, 0.02, (20, 220), (9e3, 28e3), 1.2, (2.2, 7), (250, 500, 1000),
         (0.05, 0.3), "z", (0, 1, 2), 32, False, (2, 6, 10), 0.5, ("freeform", "contour", "pocket", "engrave", "air")),
    Kind("retrofit", (720, 420, 350), 60, 160, 0.1, (1.5, 18), (250, 2200), 2.5, (3, 6), (20, 50, 100), (0.4, 1.5),
         "z", (0, 1, 2), 6, True, (10, 20, 40), 0.0, ("face", "pocket", "drill", "creep", "contour", "air")),
    Kind("horizontal", (800, 750, 780), 500, 4000, 0.05, (10, 90), (1200, 9e3), 1.8, (6, 14), (100, 250), (0.1, 0.6),
         "y", (0, 1, 2), 16, True, (12, 25, 63), 0.4, ("face", "drill", "pocket", "contour", "air", "creep")),
    Kind("trunnion", (600, 520, 460), 400, 5000, 0.03, (6, 110), (4e3, 18e3), 1.5, (3, 6), (100, 250, 500), (0.1, 0.5),
         "z", (0, 1, 2), 12, True, (4, 8, 16), 0.4, ("freeform", "contour", "engrave", "creep", "pocket", "air")),
    Kind("turn-mill", (380, 160, 900), 250, 2200, 0.06, (2, 40), (120, 1500), 6.0, (5, 18), (50, 100, 200), (0.1, 0.8),
         "x", (2, 0, 1), 10, True, (8, 16, 32), 0.25, ("face", "contour", "drill", "pocket", "creep", "freeform")),
)  # fmt: skip
"""Kinds in the order in which a plan meets them."""


@dataclass(frozen=True)
class Cutter:
    diameter_mm: float
    teeth: int
    mass_kg: float


@dataclass(frozen=True, eq=False)
class Machine:
    """One machine of a kind. travel, v_max, a_max, sign_width : (3,), mm, mm/s, mm/s², mm/s

    rate : Hz, of the log; fine : steps of calculation per logged sample; lag : (natural frequency Hz, damping) or None
    amps : A, of an axis' friction; noise_share : of the noise in the size of a simulated current, –
    force_sign : +1 or −1, which of the two bodies a simulated force acts on; force_error : – ; count_mm : of an encoder
    """

    kind: Kind
    travel: Float1D
    v_max: Float1D
    a_max: Float1D
    jerk_s: float
    sign_width: Float1D
    rate: float
    fine: int
    lag: tuple[float, float] | None
    force_sign: float
    force_error: float
    count_mm: float
    cutters: Mapping[int, Cutter]
    specific_n_mm2: float
    amps: Mapping[str, float]
    noise_share: float

    @property
    def dt(self) -> float:
        """s, of the fine step."""
        return 1.0 / (self.rate * self.fine)


FINE_HZ = 200.0
"""A calculation is at least this fine, however slowly a machine is logged."""


def draw_machine(kind: Kind, rng: np.random.Generator) -> Machine:
    """One machine: its rate, lag, cutters and sizes."""
    rate = float(rng.choice(kind.rates_hz))
    sizes = enumerate(kind.tools_mm)
    numbers = rng.permutation(np.arange(1, 30))
    cutters = {
        int(numbers[k]): Cutter(
            diameter_mm=round(d * _near(rng, 0.1), 1),
            teeth=int(rng.choice([2, 3, 4])),
            mass_kg=round((0.2 + 0.05 * d) * _near(rng), 2),
        )
        for k, d in sizes
    }
    drawn_lag = (float(rng.uniform(*kind.lag_hz)), float(rng.uniform(0.7, 1.1)))
    return Machine(
        kind=kind,
        travel=np.array(kind.travel_mm, float) * [_near(rng, 0.1) for _ in range(3)],
        v_max=kind.v_mm_s * np.array([_near(rng) for _ in range(3)]) * kind.pace,
        a_max=kind.a_mm_s2 * np.array([_near(rng) for _ in range(3)]) * kind.pace,
        jerk_s=kind.jerk_s * _near(rng),
        sign_width=np.full(3, 0.0 if rng.random() < 0.4 else 0.004 * kind.feeds_mm_s[1]),
        rate=rate,
        fine=max(1, int(np.ceil(FINE_HZ / rate))),
        lag=drawn_lag if rng.random() < kind.lag else None,
        force_sign=float(rng.choice([-1.0, 1.0])),
        force_error=float(rng.choice(kind.force_errors)),
        count_mm=float(rng.choice([0.0, 1e-4, 1e-3])) if rate <= 100 else 0.0,
        cutters=cutters,
        specific_n_mm2=float(rng.choice([700.0, 1100.0, 1900.0])) * _near(rng),
        amps={a: g * kind.amps[0] * _near(rng) for a, g in zip(LINEAR_AXES, kind.gains, strict=True)}
        | {"sp": kind.amps[1] * _near(rng)},
        noise_share=float(np.exp(rng.uniform(np.log(0.02), np.log(0.12)))),
    )


def _near(rng: np.random.Generator, by: float = 0.25) -> float:
    """A factor about one, – ."""
    return float(np.exp(rng.uniform(-by, by)))
