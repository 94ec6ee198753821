"""A plant, drawn: how large, how fast, how it is driven, what it cuts with, how its currents are measured.

In:  a generator. Out: a `Plant`: values only, in mm, s, N, A, 1/min.
Ranges are those of catalogues and of Altintas, Manufacturing Automation (2012), chapters 2, 5 and 6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pido.core.arrays import Float1D


@dataclass(frozen=True)
class Family:
    """Ranges (low, high) that a kind of machine is drawn from."""

    name: str
    travel: tuple[float, float]  # mm
    rapid: tuple[float, float]  # m/min
    a_max: tuple[float, float]  # m/s²
    feed: tuple[float, float]  # mm/s
    diameter: tuple[float, float]  # mm
    rpm: tuple[float, float]  # 1/min
    current: tuple[float, float]  # A
    k_c11: tuple[float, float]  # N/mm²
    vertical: str = "z"
    linear_motor: float = 0.0  # chance


FAMILIES = (
    Family("micro mill", (150, 250), (5, 15), (1, 4), (3, 20), (0.8, 4), (12e3, 45e3), (0.05, 1.5), (500, 1600),
           linear_motor=0.5),
    Family("bench mill", (300, 700), (12, 36), (1.5, 5), (6, 50), (4, 20), (2e3, 14e3), (0.4, 12), (600, 2200)),
    Family("horizontal mill", (500, 1000), (25, 60), (3, 8), (6, 70), (8, 63), (800, 9e3), (2, 40), (600, 2400), "y"),
    Family("gantry", (1500, 3000), (20, 50), (1, 4), (8, 90), (16, 80), (500, 6e3), (4, 60), (700, 2200),
           linear_motor=0.2),
    Family("router", (900, 2500), (20, 60), (1, 5), (25, 200), (3, 20), (8e3, 24e3), (0.4, 8), (20, 700)),
    Family("fast mill", (300, 800), (40, 60), (6, 15), (10, 120), (2, 16), (6e3, 30e3), (1, 25), (500, 2000),
           linear_motor=1.0),
)  # fmt: skip


@dataclass(frozen=True)
class Cutter:
    """diameter_mm : mm; teeth : –; mass_kg : of tool and holder"""

    diameter_mm: float
    teeth: int
    mass_kg: float


@dataclass(frozen=True)
class Plant:
    """One machine with its control, its tools and its sensors."""

    family: Family
    travel: Float1D  # (3,), mm
    rapid: float  # mm/s
    a_max: float  # mm/s²
    box_s: tuple[float, float]  # s, lengths of the control's two smoothing filters (acceleration, jerk)
    vertical: str
    linear_motor: bool
    lead: Float1D  # (3,), mm, of the ball screws, or the pole pitch of linear motors
    rate: float  # Hz, of the recording
    fine: int  # steps of the simulation per sample
    tools: dict[int, Cutter]
    k_c11: float  # N/mm²
    m_c: float  # –, Kienzle's exponent
    ratios: Float1D  # (3,), feed, normal and axial force per tangential force
    force_sign: float  # +1: forces in the columns are the drive's load; -1: they act on the tool
    spindle_acc: float  # rpm/s
    current: Float1D  # (4,), A, of each axis' order of magnitude
    sign_width: Float1D  # (3,), mm/s, of the simulation's tanh(v / width); 0: the exact sign
    lag_s: tuple[float, ...]  # time constants of the current's servo lag; empty: none
    bits: int
    noise: Float1D  # (4,), –, rms over the rms of the simulated current
    colour: tuple[float, float]  # share of the noise's power that is AR(1), and its coefficient per sample
    restless: tuple[str, float]  # what the noise grows with ("", "cut" or "speed"), and by how much
    encoder_mm: float  # 0: velocities are set points
    differentiated: bool  # accelerations are the encoder's, differentiated twice
    force_error: float  # –, rms of the smooth relative error of simulated forces

    @property
    def dt(self) -> float:
        """s, step of the simulation."""
        return 1.0 / (self.rate * self.fine)


def draw_plant(rng: np.random.Generator) -> Plant:
    """A machine of one of the families."""
    family = FAMILIES[rng.integers(len(FAMILIES))]
    rate = float(rng.choice([20, 25, 50, 50, 100, 100, 125, 200, 250, 500]))
    a_max = 1000.0 * rng.uniform(*family.a_max)
    linear = bool(rng.random() < family.linear_motor)
    return Plant(
        family=family,
        travel=rng.uniform(*family.travel, 3) * [1.0, 0.8, 0.6],
        rapid=1000.0 / 60.0 * rng.uniform(*family.rapid),
        a_max=a_max,
        box_s=(max(0.012, 2 * family.feed[1] / a_max), float(rng.uniform(0.008, 0.05))),
        vertical=family.vertical,
        linear_motor=linear,
        lead=rng.choice([24.0, 30.0, 32.0, 60.0] if linear else [5.0, 10.0, 12.0, 16.0, 20.0, 25.0, 40.0], 3),
        rate=rate,
        fine=max(1, int(np.ceil(200.0 / rate))),
        tools=_tools(family, rng),
        k_c11=_log(rng, *family.k_c11),
        m_c=float(rng.uniform(0.15, 0.35)),
        ratios=np.array([rng.uniform(0.5, 0.9), rng.choice([-1, 1]) * rng.uniform(0.15, 0.5), rng.uniform(0.1, 0.35)]),
        force_sign=float(rng.choice([-1.0, 1.0])),
        spindle_acc=family.rpm[1] / rng.uniform(1.0, 4.0),
        current=_log(rng, *family.current) * rng.uniform(0.6, 1.6, 4),
        sign_width=np.full(3, rng.choice([0.0, 0.0, rng.uniform(0.1, 1.0)])),
        lag_s=_lag(rng),
        bits=int(rng.integers(8, 15)),
        noise=rng.uniform(0.02, 0.07, 4),
        colour=(float(rng.uniform(0.0, 0.3)), float(rng.uniform(0.3, 0.85))),
        restless=(str(rng.choice(["", "", "cut", "speed"])), float(rng.uniform(0.2, 0.8))),
        encoder_mm=float(rng.choice([0.0, 0.0, 1e-5, 5e-5, 1e-4])),
        differentiated=bool(rng.random() < 0.35),
        force_error=float(rng.choice([0.0, rng.uniform(0.01, 0.03)])),
    )


def _tools(family: Family, rng: np.random.Generator) -> dict[int, Cutter]:
    low, high = family.diameter
    diameters = np.round(np.exp(np.linspace(np.log(low), np.log(high), 4)) * rng.uniform(0.9, 1.1, 4), 1)
    numbers = rng.choice(np.arange(1, 40), 4, replace=False)
    masses = np.sort(0.05 + 0.08 * diameters * rng.uniform(0.7, 1.4, 4))
    return {
        int(n): Cutter(float(d), int(rng.integers(2, 5)), round(float(m), 2))
        for n, d, m in zip(numbers, diameters, masses, strict=True)
    }


def _lag(rng: np.random.Generator) -> tuple[float, ...]:
    if rng.random() > 0.25:
        return ()
    tau = float(rng.uniform(0.005, 0.04))
    return (tau,) if rng.random() < 0.5 else (tau / 2, tau / 2)


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
