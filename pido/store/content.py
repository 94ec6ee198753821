"""A recording as bytes: its digest, its Parquet file, and back.

In:  a Recording. Out: sha256 over what plant and machine said (part.json's fields and every column, by name), the same
whatever the file was called, whenever it came, in whatever order its columns stood; and Parquet read by column.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import pyarrow as pa
import pyarrow.parquet as pq

from pido.core.arrays import Array1D
from pido.core.axes import AXES
from pido.core.columns import CURRENT, TIME
from pido.core.errors import StoreError
from pido.core.part import PartInfo
from pido.core.recording import Recording

MEASURED = (TIME, *(f"pos_{axis}" for axis in AXES), *CURRENT.values())
"""What a machine measures, and nobody says or derives: two recordings that are equal in it are one."""
_LONGEST = 80


def digest(recording: Recording) -> str:
    """sha256, hex. NaN of any kind is one missing value; -0.0 is 0.0."""
    total = hashlib.sha256(b"pido.recording/1\n")
    total.update(_about(recording.part))
    _add(total, recording, recording.columns)
    return total.hexdigest()


def signals(recording: Recording) -> str | None:
    """sha256, hex, over MEASURED alone: the same whatever part.json says of it; None without currents."""
    present = [name for name in MEASURED if name in recording]
    if not set(present) & set(CURRENT.values()):
        return None
    total = hashlib.sha256(b"pido.signals/1\n")
    _add(total, recording, present)
    return total.hexdigest()


@dataclass(frozen=True, slots=True)
class Completed:
    """A stored recording with the columns that it `gained`; `left_out`: which it could not, and why, in words or ''."""

    recording: Recording
    gained: tuple[str, ...]
    left_out: str


def completed(stored: Recording, again: Recording) -> Completed:
    """The stored recording with what another one of the same samples adds to it: columns of which it has no value.

    Nothing of it changes: where another column differs, they may not be of one simulation or reading: none is added.
    """
    empty = {name for name in again.columns if name not in stored or not _has_values(stored.columns[name])}
    gained = tuple(name for name in again.columns if name in empty and _has_values(again.columns[name]))
    shared = [name for name in again.columns if name in stored and name not in empty]
    differs = [name for name in shared if _alone(stored, name) != _alone(again, name)]
    if not gained or not differs:
        added = {name: again.columns[name] for name in gained}
        notes = (f"delivered later: {', '.join(gained)}",) if gained else ()
        return Completed(replace(stored.with_columns(**added), notes=(*stored.notes, *notes)), gained, "")
    return Completed(
        stored, (), f"It brings {', '.join(gained)} too, left out because {', '.join(differs)} in it "
        f"{'is' if len(differs) == 1 else 'are'} not as stored: bring it with all columns as they came first, and the "
        "further ones beside them",
    )  # fmt: skip


IDENTIFYING = frozenset({"part", "machine", "order", "start_time_s", "duration_s", "sample_rate_hz"})
"""What a part.json says of which recording this is; all else says what was cut with what, from which rows follow."""


def says_otherwise(stored: PartInfo, again: PartInfo) -> dict[str, str]:
    """What another part.json of the same samples says otherwise, by key, in words; empty where nothing.

    >>> says_otherwise(PartInfo(part="p1", machine="m", material="C45"), PartInfo(part="p1", machine="m"))
    {'material': 'material (stored: "C45", here: nothing)'}
    """
    kept, came = (one.model_dump(mode="json", exclude_defaults=True) for one in (stored, again))
    differ = [name for name in type(stored).model_fields if kept.get(name) != came.get(name)]
    return {name: f"{name} (stored: {_brief(kept.get(name))}, here: {_brief(came.get(name))})" for name in differ}


def _brief(value: Any) -> str:
    text = "nothing" if value is None else orjson.dumps(value).decode()
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 2]} …"


def _has_values(values: Array1D) -> bool:
    return any(v is not None for v in values) if values.dtype == object else bool(np.isfinite(values).any())


def _alone(recording: Recording, name: str) -> bytes:
    total = hashlib.sha256()
    _add(total, recording, [name])
    return total.digest()


def _add(total: Any, recording: Recording, names: Iterable[str]) -> None:
    for name in sorted(names):
        values = recording.columns[name]
        total.update(f"\n{name}\0{len(values)}\0".encode())
        if values.dtype == object:
            total.update(orjson.dumps([None if v is None else str(v) for v in values]))
            continue
        plain = np.array(values, dtype="<f8") + 0.0
        plain[np.isnan(plain)] = np.nan
        total.update(plain.tobytes())


def _about(part: PartInfo) -> bytes:
    return orjson.dumps(part.model_dump(mode="json"), option=orjson.OPT_SORT_KEYS)


def write(recording: Recording, source: str, path: Path) -> None:
    """Columns as float64 (text as text), what is known about the part and the notes in the file's metadata."""
    arrays = {
        name: pa.array([None if v is None else str(v) for v in values], pa.string())
        if values.dtype == object
        else pa.array(np.asarray(values, float))
        for name, values in recording.columns.items()
    }
    about = {"part": recording.part.model_dump(mode="json"), "notes": recording.notes, "source": source}
    pq.write_table(
        pa.table(arrays).replace_schema_metadata({b"pido": orjson.dumps(about)}),
        path,
        compression="zstd",
        use_dictionary=False,
        column_encoding={n: "BYTE_STREAM_SPLIT" for n, a in arrays.items() if pa.types.is_floating(a.type)},
    )


def described(path: Path) -> PartInfo:
    """What is known about a stored part. Raises StoreError where it cannot be read."""
    return read(path, ()).part


def read(path: Path, columns: Iterable[str] | None, missing_ok: bool = False) -> Recording:
    """The stored recording, only `columns` and time where they are named. Raises StoreError where it cannot be read.

    missing_ok : columns that the part does not have are left out; otherwise they are an error
    """
    try:
        with pq.ParquetFile(path) as file:
            present = file.schema_arrow.names
            wanted = present if columns is None else ["time", *(c for c in columns if c != "time")]
            if missing_ok:
                wanted = [name for name in wanted if name in present]
            if missing := [name for name in wanted if name not in present]:
                raise StoreError(f"{path}: this part has no column {', '.join(missing)}; it has {', '.join(present)}.")
            about = orjson.loads((file.schema_arrow.metadata or {})[b"pido"])
            table = file.read(columns=wanted, use_threads=False)
    except (pa.ArrowInvalid, pa.ArrowException, OSError, KeyError) as error:
        raise StoreError(
            f"{path}: damaged or missing: {error}. Restore it from the backup, or ingest the part again."
        ) from None
    data: dict[str, Array1D] = {}
    for name in wanted:
        column = table.column(name)
        text = pa.types.is_string(column.type)
        data[name] = np.asarray(column.to_pylist(), object) if text else np.array(column.to_numpy(), dtype=float)
    return Recording(PartInfo.model_validate(about["part"]), data, tuple(about["notes"]))
