"""The layout in which the paper's impeller recordings are published: one folder per trial, one table of experiments.

In:  parts made at 500 Hz. Out:

    FOLDER/<TRIAL>/processed_data/<TRIAL>_hfdata.csv, <TRIAL>_hfblockevent.csv, <TRIAL>_header.csv
    FOLDER/nc_data/<TRIAL>.nc
    FOLDER/DoE.csv   (published as DoE.xlsx; the same table)

The raw 10 kHz force file of a trial is not written: the virtual mill has no force platform.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pido.core.names import file_name
from pido.synthetic.machine import Produced
from pido.synthetic.sinumerik import FIRST_CYCLE, NAME, NUMBER, blocks, signals


def write_published(parts: Sequence[Produced], folder: Path) -> list[Path]:
    """Returns the trials' folders. Raises SettingsError for a part that was not made at 500 Hz."""
    places = [_trial(produced, folder) for produced in parts]
    _doe(parts).to_csv(folder / "DoE.csv", index=False)
    return places


def _trial(produced: Produced, folder: Path) -> Path:
    trial = file_name(produced.job.name)
    data = folder / trial / "processed_data"
    data.mkdir(parents=True, exist_ok=True)
    table = signals(produced)
    counter = FIRST_CYCLE + np.arange(len(produced.recording))
    frame = pd.DataFrame({"CYCLE": counter, **{name: np.round(values, 6) for name, values in table.items()}})
    frame.to_csv(data / f"{trial}_hfdata.csv", index=False)
    starts, text, tool = blocks(produced)
    pd.DataFrame(
        {"HFProbeCounter": counter[starts], "Channel": 1, "SelectedTool": tool, "ActiveTool": tool, "GCode": text}
    ).to_csv(data / f"{trial}_hfblockevent.csv", index=False)
    axis = {str(number): NAME[a] for a, number in NUMBER.items()}
    listed = [("CYCLE", "INTEGER", "Cycle", "CYCLE"), *((s, "DOUBLE", axis[s.split("|")[1]], s) for s in table)]
    pd.DataFrame(listed, columns=["SignalName", "Type", "Axis", "Address"]).to_csv(
        data / f"{trial}_header.csv", index=False
    )
    (folder / "nc_data").mkdir(exist_ok=True)
    (folder / "nc_data" / f"{trial}.nc").write_text(produced.job.program, encoding="utf-8")
    return folder / trial


def _doe(parts: Sequence[Produced]) -> pd.DataFrame:
    """One row per trial: order, material, tools, blank, feed and speed while cutting."""
    rows = []
    for p in parts:
        c, job = p.course, p.job
        cut = c.cutting
        speed = np.sqrt(sum(c.v[a] ** 2 for a in ("x", "y", "z")))
        blank = np.subtract(job.stock.high_mm, job.stock.low_mm) if job.stock else [None] * 3
        rows.append({
            "trial": job.name, "order": job.order, "material": job.material.name if job.material else None,
            "tools": " ".join(job.tools), "blank_x_mm": blank[0], "blank_y_mm": blank[1], "blank_z_mm": blank[2],
            "feed_mm_min": float(np.median(speed[cut]) * 60) if cut.any() else None,
            "speed_rpm": float(np.median(c.v_sp[cut]) / 6) if cut.any() else None,
            "max_depth_mm": float(c.a_p.max()), "duration_s": float(c.time[-1]),
        })  # fmt: skip
    return pd.DataFrame(rows)
