"""Part folders of a case, as a plant would hand them over, and the truth in a folder of its own.

FOLDER/parts/<part>/recording.parquet, part.json, program.mpf
FOLDER/sealed/truth.json, <part>.parquet     (never inside a part folder: no reader of recordings comes by)
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import orjson
import pyarrow as pa
import pyarrow.parquet as pq

from pido.core.axes import AXES
from pido.core.names import file_name
from pido.synthetic.cases import Case
from pido.synthetic.describe import PROGRAM
from pido.synthetic.effects import acts
from pido.synthetic.machine import Produced


def write_part(produced: Produced, folder: Path) -> Path:
    """One part folder below `folder`; returns it."""
    place = folder / file_name(produced.job.name)
    place.mkdir(parents=True, exist_ok=True)
    recording = produced.recording
    pq.write_table(pa.table(dict(recording.columns)), place / "recording.parquet")
    info = recording.part.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    (place / "part.json").write_bytes(orjson.dumps(info, option=orjson.OPT_INDENT_2))
    (place / PROGRAM).write_text(produced.job.program, encoding="utf-8")
    return place


def write_case(case: Case, folder: Path, sealed: Path | None = None) -> list[Path]:
    """Parts below `folder`/parts and the truth in `sealed` (default `folder`/sealed). Returns the part folders."""
    places = [write_part(p, folder / "parts") for p in case.parts]
    sealed = sealed or folder / "sealed"
    sealed.mkdir(parents=True, exist_ok=True)
    (sealed / "truth.json").write_bytes(
        orjson.dumps(case.truth(), option=orjson.OPT_INDENT_2 | orjson.OPT_SERIALIZE_NUMPY, default=_plain)
    )
    for p in case.parts:
        pq.write_table(pa.table(truth_columns(p)), sealed / f"{file_name(p.job.name)}.parquet")
    return places


def truth_columns(produced: Produced) -> dict[str, Any]:
    """time; per axis effect_<axis> (A), acts_<axis>, noise_<axis> (A); effect_<k> of each effect alone."""
    truth = produced.truth
    columns: dict[str, Any] = {"time": produced.recording.time}
    for axis in AXES:
        columns[f"effect_{axis}"] = truth.effect[axis]
        columns[f"acts_{axis}"] = acts(truth.effect[axis]) & (np.abs(truth.effect[axis]) > 1e-9)
        columns[f"noise_{axis}"] = truth.noise[axis]
    columns |= {f"effect_{k}": current for k, current in enumerate(truth.single, start=1)}
    return columns


def _plain(value: Any) -> Any:
    return str(value)
