"""Two machines: one like a horizontal mill of 1997 with worn guideways, one like a newer vertical one.

Constants are plausible values of each class, drawn together from makers' data sheets and from the order of magnitude
of a published air cut (idle and friction currents, weight, acceleration). Noise and
held friction were chosen after looking at that air cut; no constant comes from an optimisation against it.
"""

from __future__ import annotations

from pido import config
from pido.core.machining import Machine
from pido.synthetic.drive import Drive
from pido.synthetic.machine import VirtualMill
from pido.synthetic.sensors import CurrentSensor, Sensors
from pido.synthetic.spindle import Spindle


def worn_horizontal(machine: Machine | None = None) -> VirtualMill:
    """Vertical axis y carries 5 A; heavy z; friction with a strong Stribeck rise; noisy currents."""
    return VirtualMill(
        machine=machine or config.machine("dmc60h"),
        drives={
            "x": Drive(900, 800, 450, coulomb_n=205, stribeck_n=60, stribeck_mm_s=1.0, viscous=1.4,
                       lost_motion_mm=0.003, ripple_n=8, ripple_mm=21.0, hold=0.7, soft_share=0.25, soft_mm=0.08),
            "y": Drive(1000, 900, 480, coulomb_n=200, stribeck_n=45, stribeck_mm_s=0.6, viscous=1.5, gravity_n=-2590,
                       lost_motion_mm=0.002, ripple_n=5, ripple_mm=20.0, hold=0.7, soft_share=0.25, soft_mm=0.08),
            "z": Drive(1100, 1000, 450, coulomb_n=160, stribeck_n=30, stribeck_mm_s=1.2, viscous=1.3,
                       lost_motion_mm=0.004, ripple_n=6, ripple_mm=20.0, hold=0.7, soft_share=0.25, soft_mm=0.08),
        },
        spindle=Spindle(0.055, 1.0, coulomb_nm=0.45, viscous=5e-4, windage=7e-7),
        sensors=Sensors(
            {
                "x": CurrentSensor(0.012, 0.12, 0.08),
                "y": CurrentSensor(0.009, 0.12, 0.055),
                "z": CurrentSensor(0.010, 0.12, 0.06),
                "sp": CurrentSensor(0.008, 0.3, 0.06, 0.004),
            }
        ),
        thermal_share=0.08,
        thermal_s=1200.0,
    )  # fmt: skip


def newer_vertical(machine: Machine | None = None) -> VirtualMill:
    """Vertical axis z; rolling guideways with little friction; quieter currents."""
    return VirtualMill(
        machine=machine or config.machine("cmx600v"),
        drives={
            "x": Drive(400, 500, 380, coulomb_n=120, stribeck_n=20, stribeck_mm_s=1.5, viscous=0.8,
                       ripple_n=3, ripple_mm=12.0),
            "y": Drive(450, 600, 380, coulomb_n=130, stribeck_n=25, stribeck_mm_s=1.5, viscous=0.9,
                       ripple_n=3, ripple_mm=12.0),
            "z": Drive(450, 450, 400, coulomb_n=150, stribeck_n=25, stribeck_mm_s=1.2, viscous=1.0, gravity_n=1400,
                       ripple_n=4, ripple_mm=12.0),
        },
        spindle=Spindle(0.03, 0.9, coulomb_nm=0.3, viscous=4e-4, windage=5e-7),
        sensors=Sensors(
            {
                "x": CurrentSensor(0.010, 0.2, 0.05, 0.002),
                "y": CurrentSensor(0.010, 0.2, 0.05, 0.002),
                "z": CurrentSensor(0.012, 0.2, 0.05, 0.002),
                "sp": CurrentSensor(0.008, 0.3, 0.05, 0.003),
            },
            encoder_noise_mm=2e-6,
        ),
        thermal_share=0.05,
        thermal_s=700.0,
    )  # fmt: skip
