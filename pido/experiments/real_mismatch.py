"""What the mismatch finder says of published recordings, against the paper's own equation as the simulation.

In:  a folder with recordings (any format that is read). Out: findings in order, errors on data left out.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pandas as pd

from pido.core.errors import PidoError
from pido.diagnosis.diagnose import diagnose
from pido.experiments.base import Outcome, Shown
from pido.experiments.data import DataError
from pido.recordings import read_recording

KINDS = {".csv", ".mat", ".json", ".parquet"}


def run(
    folder: Path, *, quick: bool, seed: int, on_progress: Callable[[int, int, str], None] = lambda done, of, what: None
) -> Outcome:
    """Diagnose every recording below `folder` by itself (`quick`: the first two). DataError where there is none."""
    files = [p for p in sorted(folder.rglob("*")) if p.suffix.lower() in KINDS]
    rows, refused = [], []
    for k, path in enumerate(files[:2] if quick else files):
        on_progress(k, len(files), path.name)
        try:
            result = diagnose([read_recording(path)], seed=seed)
        except PidoError as error:
            refused.append(f"{path.name}: {error}")
            continue
        for order, f in enumerate(result.findings, start=1):
            rows.append(
                {
                    "recording": path.stem, "order": order, "axis": f.axis, "mechanism": f.mechanism,
                    "RMSE before": f.fit.rmse_before, "RMSE after": f.fit.rmse_after, "scheme": f.fit.scheme,
                }
            )  # fmt: skip
        rows += [{"recording": path.stem, "axis": a, "mechanism": "nothing significant"} for a in result.clean_axes]
    if not rows:
        raise DataError(f"{folder}: no recording that can be diagnosed. {' '.join(refused)}")
    table = pd.DataFrame(rows)
    verdict = f"{table['recording'].nunique()} recordings, {int(table['order'].notna().sum())} findings."
    return Outcome(verdict, (Shown("Findings in order", table),), tuple(refused))
