"""NC programs and motion beside a real machine: what is understood, how true, how fast.

In:  the published DMC 60H recordings (PIDO_REAL_DATA, else ../shared/data); a generated program of a million lines.
Out: rows {work, peer, ratio, goal, error}; ratio is goal over measured (1 and more: reached), `error` says the number.

`python -m benchmarks.motion` prints them. Dynamics are fitted on the first half of the feed blocks of the first of
three runs of V_S235JR_VALIDATION.MPF and judged on the other two.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pido.config import machine
from pido.nc import interpret
from pido.process.motion import Dynamics, block_times, fit_dynamics, follow, plan_motion
from pido.process.motion.fit import box_mean

DATA = Path(os.environ.get("PIDO_REAL_DATA") or Path(__file__).parents[2] / "shared" / "data") / "kit_dmc60h"
PROGRAMS = ("AL2007_TRAINING.MPF", "AL2007_VALIDATION.MPF", "V_S235JR_VALIDATION.MPF", "V_S235_TRAINING.MPF")
RUNS_S = ((1.0, 82.0), (82.8, 163.0), (163.5, 243.4))
BOX_S = 0.082  # the publishers averaged over this time


QUICK = {"lines": 10_000}


def run(lines: int = 1_000_000) -> list[dict[str, Any]]:
    """Speed always; truth where the recordings are there."""
    rows = [_interpretation(lines), _planning()]
    return rows + (_beside_the_machine() if DATA.is_dir() else [])


def _row(work: str, goal: float, measured: float, unit: str, peer: str = "goal") -> dict[str, Any]:
    return {"work": work, "peer": peer, "ratio": goal / max(measured, 1e-12), "goal": f"<= {goal:g} {unit}",
            "error": f"{measured:.3g} {unit}"}  # fmt: skip


def _interpretation(lines: int) -> dict[str, Any]:
    rng = np.random.default_rng(0)
    points = np.cumsum(rng.normal(0, 0.1, (lines, 3)), axis=0)
    text = "G0 X0 Y0 Z0\nG1 F1000\n" + "\n".join(
        f"N{i} X{x:.3f} Y{y:.3f} Z{z:.3f}" for i, (x, y, z) in enumerate(points)
    )
    begin = time.perf_counter()
    path = interpret(text, start=(0.0, 0.0, 0.0))
    seconds = time.perf_counter() - begin
    return _row(f"interpret {len(path)} lines", 20.0 * lines / 1e6, seconds, "s")


def _planning() -> dict[str, Any]:
    rng = np.random.default_rng(1)
    points = np.cumsum(rng.normal(0, 0.5, (40_000, 2)), axis=0) % 300
    text = "G0 X0 Y0 Z0\nG64\nG1 F6000\n" + "\n".join(f"X{x:.3f} Y{y:.3f}" for x, y in points)
    path, mill = interpret(text, start=(0.0, 0.0, 0.0)), machine("cmx600v")
    dynamics = Dynamics(kv_per_s=30.0)
    plan_motion(path.take(slice(0, 10)), mill, dynamics=dynamics)  # compiled before it is timed
    begin = time.process_time()
    motion = plan_motion(path, mill, dynamics=dynamics)
    seconds = (time.process_time() - begin) * 1e5 / len(motion)
    return _row("plan 100 000 samples at 50 Hz with look-ahead and servo lag, CPU time", 1.0, seconds, "s")


def _beside_the_machine() -> list[dict[str, Any]]:
    understood = [len(interpret(DATA / name)) > 0 for name in PROGRAMS]
    mill = machine("dmc60h")
    path = interpret(DATA / "V_S235JR_VALIDATION.MPF", machine=mill)
    table = pd.read_csv(DATA / "S235JR_part2_aircut_1.csv")
    place = table[["pos_x", "pos_y", "pos_z"]].to_numpy()
    t = np.arange(len(place)) / 50.0
    runs = [slice(int(50 * a), int(50 * b)) for a, b in RUNS_S]
    dynamics = fit_dynamics(path, mill, t[runs[0]], place[runs[0]], box_s=BOX_S, blocks=slice(0, 13))
    motion = plan_motion(path, mill, 500.0, dynamics)
    _, planned = block_times(path, motion.time, box_mean(motion.pos[:, :3], BOX_S * 500.0), np.zeros(3))
    count = f"{sum(understood)} of {len(understood)}"
    share = float(np.mean(understood))
    rows = [
        {"work": "published programs understood", "peer": "all words", "ratio": share, "goal": "all", "error": count}
    ]
    for number, part in enumerate(runs[1:], 2):
        found = follow(path, place[part])
        _, recorded = block_times(path, t[part], place[part])
        error = np.diff(planned) - np.diff(recorded)
        total = abs(error.sum()) / np.sum(np.diff(recorded))
        rows += [
            _row(f"run {number}: path, one translation, rms", 0.02, float(np.sqrt(np.mean(found.distance**2))), "mm"),
            _row(f"run {number}: block times, rms", 25.0, 1e3 * float(np.sqrt(np.mean(error**2))), "ms"),
            _row(f"run {number}: total time", 0.3, 100 * float(total), "%"),
        ]
    fitted = f"kv {dynamics.kv_per_s:.1f} 1/s, window {1e3 * dynamics.stop_window_mm:.1f} um, "
    fitted += f"spindle {dynamics.spindle_acc_deg_s2:.3g} deg/s2"
    rows.append({"work": "fitted on 12 blocks of run 1", "peer": "", "ratio": np.nan, "goal": "", "error": fitted})
    return rows


if __name__ == "__main__":
    print(pd.DataFrame(run()).to_string(index=False))
