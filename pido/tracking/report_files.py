"""What an iteration leaves in `runs/<run key>/`, so that it can be logged now or when MLflow is there again.

In:  the summary (plain values), generated rows, counts per bin, a stretch of the arriving part's predictions.
Out: `summary.json`, `generated.parquet`, `bins.parquet`, `trace.parquet`, written as one folder by a rename.
"""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pido.core.arrays import Float1D
from pido.core.errors import StoreError
from pido.core.files import write_atomically

TABLES = ("generated", "bins", "trace")
OTHER_END = "other_end"
"""In a trace: what `both` would have said of a standing axis, had it come to rest out of the other direction, A."""


@dataclass(frozen=True, eq=False)
class RunFiles:
    """A finished iteration.

    summary : run_key, machine, part, parts, settings, seed, code, bundle, data, balance, metrics, gate, seconds
    generated : one row per generated sample, with its origin ('pia', 'pie'), bin, source row and expected error
    bins : one row per relevant bin: v_x, v_y, ar (centre), before, after (samples)
    trace : the arriving part: time, and per axis the measured current, what the models said, and OTHER_END
    """

    summary: dict[str, Any]
    generated: pd.DataFrame
    bins: pd.DataFrame
    trace: pd.DataFrame

    def save(self, runs: Path) -> Path:
        """Write the folder of this run; one that is there already (the same key) is replaced as a whole."""
        folder = runs / self.summary["run_key"]
        temporary = runs / f".{folder.name}.{os.getpid()}.new"
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir(parents=True)
        for name in TABLES:
            getattr(self, name).to_parquet(temporary / f"{name}.parquet", index=False)
        write_atomically(temporary / "summary.json", json.dumps(self.summary, sort_keys=True, indent=1))
        shutil.rmtree(folder, ignore_errors=True)
        temporary.rename(folder)
        return folder


def load(runs: Path, run_key: str) -> RunFiles:
    """The files of a run. Raises StoreError where they are not there."""
    folder = runs / run_key
    try:
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        return RunFiles(summary, *(pd.read_parquet(folder / f"{name}.parquet") for name in TABLES))
    except OSError as error:
        raise StoreError(f"{folder}: the files of this iteration are not there ({error}); run it again.") from None


def foretold_at(runs: Path, run_key: str) -> Float1D:
    """When the rows were that a run's metrics are about, s; empty where its files are gone."""
    trace = runs / run_key / "trace.parquet"
    return pd.read_parquet(trace, columns=["time"])["time"].to_numpy(float) if trace.exists() else np.array([])
