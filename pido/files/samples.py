"""Samples on disk: exactly the rows that went in, bit for bit, and a digest that does not depend on the file format.

In:  `Samples` and a path. Out: a Parquet file, and back. Names: the 13 inputs, `ar`, `curr_<axis>`, `dir_<axis>`,
`part`, `row`, `origin` ('real', 'pia', 'pie'), `voxel`, `expected_error_<axis>`.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import fields
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from pido.core.arrays import Int1D
from pido.core.axes import AXES
from pido.core.columns import CURRENT, INPUTS
from pido.core.files import replacing
from pido.core.samples import ORIGINS, Samples

_LOST = "lost"


def frame(samples: Samples) -> pd.DataFrame:
    """One row per sample."""
    columns: dict[str, np.ndarray] = {name: samples.inputs[:, i] for i, name in enumerate(INPUTS)}
    columns["ar"] = samples.ar
    for i, axis in enumerate(AXES):
        columns[CURRENT[axis]] = samples.currents[:, i]
        columns[f"dir_{axis}"] = samples.direction[:, i]
        columns[f"expected_error_{axis}"] = samples.expected_error[:, i]
    columns |= {"part": samples.part, "row": samples.row, "voxel": samples.voxel}
    columns["origin"] = np.asarray(ORIGINS, dtype=object)[samples.origin]
    return pd.DataFrame(columns)


def save_samples(samples: Samples, path: Path, lost: Int1D | None = None) -> Path:
    """Write; a reader sees a whole file or none.

    lost : (m,), samples of the part of which no row could be made; kept beside the rows
    """
    table = frame(samples)
    if lost is not None and len(lost):
        table.attrs[_LOST] = lost.tolist()
    with replacing(path) as temporary:
        table.to_parquet(temporary, index=False)
    return path


def load_lost(path: Path) -> Int1D:
    """(m,): what was `lost` when the file was written."""
    kept = json.loads((pq.read_schema(path).metadata or {}).get(b"PANDAS_ATTRS", b"{}"))
    return np.array(kept.get(_LOST, []), np.int64)


def load_samples(path: Path) -> Samples:
    """The rows of a file written by `save_samples`."""
    table = load_frame(path)

    def block(names: list[str]) -> np.ndarray:
        return np.ascontiguousarray(table[names].to_numpy(dtype=float))

    return Samples(
        inputs=block(list(INPUTS)),
        ar=table["ar"].to_numpy(dtype=float),
        currents=block(list(CURRENT.values())),
        direction=block([f"dir_{axis}" for axis in AXES]),
        part=table["part"].to_numpy(dtype=object),
        row=table["row"].to_numpy(dtype=np.int64),
        origin=np.array([ORIGINS.index(name) for name in table["origin"]], dtype=np.int64),
        voxel=table["voxel"].to_numpy(dtype=np.int64),
        expected_error=block([f"expected_error_{axis}" for axis in AXES]),
    )


def load_frame(path: Path) -> pd.DataFrame:
    """The same rows as a table."""
    return pd.read_parquet(path)


def samples_digest(samples: Samples) -> str:
    """SHA-256 of all fields and rows, in their order."""
    total = hashlib.sha256(str(len(samples)).encode())
    for field in fields(Samples):
        values = getattr(samples, field.name)
        total.update(field.name.encode())
        if values.dtype == object:
            total.update("\0".join(map(str, values)).encode())
        else:
            total.update(np.ascontiguousarray(values).tobytes())
    return total.hexdigest()
