"""The paper's models beside the default ones, on parts that neither has seen.

In:  the published recordings of a milling machine (PIDO_REAL_DATA, else ../shared/data); without them, nothing.
Out: rows {work, peer, ratio, goal, error}: ratio is the paper's held-out RMSE of the spindle over the default's, and
     the same for training time. Each recording is left out once; the process inputs (forces, removal) are not known
     for them and are zero, so both see motion only.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np

from benchmarks.table import Row, row
from pido.config import machine
from pido.core.columns import FORCE_SIM
from pido.core.errors import RecordingError
from pido.core.samples import Samples
from pido.models.axis_models import AxisModels
from pido.process.samples import to_samples
from pido.recordings import read_recording

FOLDER = Path(os.environ.get("PIDO_REAL_DATA") or Path(__file__).parents[2] / "shared" / "data") / "umich_smart_mill"
QUICK = {"most": 3}
MACHINE = "smart_mill"


def run(most: int = 9) -> list[Row]:
    """Spindle and feed axes, over all recordings left out once."""
    parts = _parts(most)
    if len(parts) < 2:
        return []
    errors: dict[str, list[np.ndarray]] = {"paper": [], "default": []}
    seconds = dict.fromkeys(errors, 0.0)
    for k, left in enumerate(parts):
        rest = Samples.concat([part for i, part in enumerate(parts) if i != k])
        for choice, found in errors.items():
            start = time.process_time()
            models = AxisModels.fit(rest, choice=choice, inputs="paper", n_jobs=1)
            seconds[choice] += time.process_time() - start
            found.append((left.currents - models.predict(left)) ** 2)
    rmse = {choice: np.sqrt(np.nanmean(np.vstack(found), axis=0)) for choice, found in errors.items()}
    count = f"{sum(map(len, parts))} rows of {len(parts)} recordings, each left out once"
    told = f"RMSE {rmse['paper'][3]:.3g} A beside {rmse['default'][3]:.3g} A"
    return [
        row(f"spindle current, {count}", "paper's boosting over extra trees", rmse["paper"][3] / rmse["default"][3],
            "–", told),
        row("the same, training time (CPU)", "paper's models over default", seconds["paper"] / seconds["default"], "–",
            f"{seconds['paper']:.1f} s beside {seconds['default']:.1f} s"),
    ]  # fmt: skip


def _parts(most: int) -> list[Samples]:
    mill, found = machine(MACHINE), []
    for path in sorted(FOLDER.glob("experiment_*.csv"))[:most]:
        try:
            recording = read_recording(path, machine=MACHINE)
        except RecordingError:
            continue  # a recording that the reader refuses has its reason in `pido ingest`
        zero = np.zeros(len(recording))
        recording = recording.with_columns(**dict.fromkeys((*FORCE_SIM.values(), "m_sp_sim", "mrr_sim"), zero))
        rows = to_samples(recording, mill, path.stem, engaged_only=False)
        rows = rows.take(np.isfinite(rows.inputs).all(axis=1) & np.isfinite(rows.currents).any(axis=1))
        if len(rows):
            found.append(rows)
    return found
